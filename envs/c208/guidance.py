"""Flies the legs between published waypoints on the true aircraft, in position and in time.

The generic follower of :mod:`envs.follower` commands what the plan does now; an aircraft that rolls
does it most of a second later. Here the plan's curvature, acceleration and climb are looked up as
far ahead as the aircraft lags, and only what is left is fed back.
"""

import bisect
import math
from typing import NamedTuple

import numpy as np

from envs.angles import wrap
from envs.backend import FLOATS
from envs.c208.autopilot import ROLL_DELAY
from envs.follower import PERIOD, Vehicle
from envs.frames import Air, Ground
from envs.kinematics import Limits, VehicleState, advance
from envs.profile import Height, Profile, height_flown
from envs.waypoints import Legs
from envs.wind import NO_WIND, Wind, over_ground

_SEARCH = 2  # steps towards the point abeam; each squares what is left of the error
_UNBOUNDED = Limits(0.0, 1e3, -1e3, 1e3, 1e3)


class Lookahead(NamedTuple):
    """How far ahead the plan is looked up, s, and the gains of what is fed back."""

    turn: float = ROLL_DELAY
    speed: float = 0.5
    climb: float = 1.1
    across: float = 0.30  # lateral acceleration per distance to the left, 1/s^2
    heading: float = 1.1  # turn rate per heading error, 1/s
    along: float = 0.25  # acceleration per distance ahead, 1/s^2
    along_rate: float = 1.0  # acceleration per speed error, 1/s


LOOKAHEAD = Lookahead()


class Path:
    """A plan's legs ``[L]`` as plain floats, which give the state over the ground at a time in
    microseconds.

    The wind carries the legs along from time 0 on; the plan's clock was 0 at the time ``began``, s.
    """

    def __init__(self, legs: Legs[Air], wind: Wind = NO_WIND, began: float = 0.0) -> None:
        self._wind, self._began = wind, began
        arcs = legs.x.shape[-1]
        part = (legs.duration / arcs)[:, None]
        begins = legs.time[:, None] + part * [[float(number) for number in range(arcs)]]
        self._begins = begins.ravel().tolist()
        fields = (legs.x, legs.y, legs.heading, legs.speed, legs.acceleration, legs.yaw_rate)
        self._arcs = list(zip(*(field.ravel().tolist() for field in fields), strict=True))
        self.ends = began + float(legs.time[-1] + legs.duration[-1])

    def at(self, time: float) -> VehicleState[Ground]:
        """Return the state at a time; before and after the plan its first and last arc go on."""
        clock = time - self._began
        index = max(bisect.bisect_right(self._begins, clock) - 1, 0)
        x, y, heading, speed, acceleration, yaw_rate = self._arcs[index]
        state: VehicleState[Air] = VehicleState(x, y, wrap(heading, FLOATS), speed)
        seconds = clock - self._begins[index]
        # The closed form of an arc holds for turns of less than a radian.
        pieces = max(1, math.ceil(abs(yaw_rate * seconds)))
        for _ in range(pieces):
            state = advance(state, acceleration, yaw_rate, seconds / pieces, _UNBOUNDED, FLOATS)
        return over_ground(state, self._wind, time)


class Guide:
    """Turns where the aircraft is into commands; remembers how late it is, so that the place abeam
    is found again.
    """

    def __init__(self, path: Path, gains: Lookahead = LOOKAHEAD, late: float = 0.0) -> None:
        self._path, self._gains, self.late = path, gains, late
        """How much later than planned the aircraft was at its place when last asked, s; negative
        when early.
        """

    def commands(
        self, state: VehicleState[Ground], time: float, dt: float = PERIOD
    ) -> tuple[float, float]:
        """Return the acceleration (m/s^2) and turn rate (rad/s) for a period from a time of the
        plan's clock on.
        """
        path, gains = self._path, self._gains
        # Across the path the point abeam counts, not where the plan is by now: a late aircraft
        # flies the same path.
        abeam = time - self.late
        place = path.at(abeam)
        for _ in range(_SEARCH):
            abeam += _offset(state, place)[0] / max(place.speed, 1.0)
            place = path.at(abeam)
        self.late = time - abeam
        left = _offset(state, place)[1]
        pace = state.speed / max(place.speed, 1.0)
        first, last = abeam + pace * gains.turn, abeam + pace * (gains.turn + dt)
        turn = wrap(path.at(last).heading - path.at(first).heading, FLOATS) / dt
        correction = gains.heading * wrap(state.heading - place.heading, FLOATS)
        turn -= correction + gains.across * left / max(state.speed, 1.0)
        planned = path.at(time)
        # The mean speed between both points gives the distance on straight and curved paths alike.
        ahead = -self.late * 0.5 * (place.speed + planned.speed)
        speeds = path.at(time + gains.speed).speed, path.at(time + gains.speed + dt).speed
        acceleration = (speeds[1] - speeds[0]) / dt
        acceleration -= gains.along * ahead + gains.along_rate * (state.speed - planned.speed)
        return acceleration, turn


def height_to_hold(
    profile: Profile, acceleration: float, time: float, gains: Lookahead = LOOKAHEAD
) -> Height:
    """Return the altitude of a profile at a time of its clock, s, and the climb as long after that
    as the aircraft lags; the climb changes with an acceleration, m/s^2.
    """
    soon = np.array([time, time + gains.climb])
    altitude, climb = height_flown(profile, acceleration, soon)
    return Height(float(altitude[0]), float(climb[1]))


def follow(
    vehicle: Vehicle[Ground], path: Path, until: float, gains: Lookahead = LOOKAHEAD
) -> tuple[list[VehicleState[Ground]], list[float]]:
    """Fly a plan from its beginning and return the state and the lateness (s) after every
    period.
    """
    guide, states, late = Guide(path, gains), [], []
    for number in range(round(until / PERIOD)):
        acceleration, turn = guide.commands(vehicle.state, number * PERIOD)
        vehicle.step(acceleration, turn, PERIOD)
        states.append(vehicle.state)
        late.append(guide.late)
    return states, late


def _offset(state: VehicleState[Ground], place: VehicleState[Ground]) -> tuple[float, float]:
    """Return how far ahead of a place and to its left a state is, m."""
    cosine, sine = math.cos(place.heading), math.sin(place.heading)
    x, y = state.x - place.x, state.y - place.y
    return x * cosine + y * sine, y * cosine - x * sine
