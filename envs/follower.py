"""The follower: flies the legs between published waypoints on any vehicle, in position and in time.

Feed-forward of the legs' mean controls over the coming period, and feedback of the errors against
where the plan is now; both loops are critically damped, so that no error of the start overshoots.
:func:`deviation` says how far a flight is from its plan: across it, along it, and in time.
"""

from typing import Generic, NamedTuple, Protocol

import numpy as np

from envs.angles import wrap
from envs.arrays import Array
from envs.frames import Air, F
from envs.kinematics import Limits, VehicleState, advance
from envs.waypoints import Legs, at
from envs.wind import Wind

PERIOD = 0.1
"""Control period, s."""

_STEPS = 3  # of the search for the nearest point; each one squares what is left of the error


class Gains(NamedTuple):
    """Gains of the feedback, SI units and radians."""

    along: float = 0.25  # acceleration per distance ahead, 1/s^2 (natural frequency 0.5 rad/s)
    speed: float = 1.0  # acceleration per speed error, 1/s
    across: float = 0.25  # lateral acceleration per distance to the left, 1/s^2
    heading: float = 1.0  # yaw rate per heading error, 1/s


GAINS = Gains()


def gains(dt: float) -> Gains:
    """Return the feedback where plans have a time step of ``dt``, s, instead of 1 s: as quick in
    time steps.
    """
    return Gains(
        GAINS.along / (dt * dt), GAINS.speed / dt, GAINS.across / (dt * dt), GAINS.heading / dt
    )


class Vehicle(Protocol[F]):
    """A vehicle that takes an acceleration and a yaw rate."""

    @property
    def state(self) -> VehicleState[F]:
        """Position, heading and speed now."""
        ...

    def step(self, acceleration: Array, yaw_rate: Array, dt: float) -> None:
        """Fly on for ``dt`` seconds under an acceleration (m/s^2) and a yaw rate (rad/s, positive
        to the left).
        """
        ...


class KinematicVehicle(Generic[F]):
    """The surrogate's kinematics as a vehicle; one or many aircraft ``[...]``."""

    def __init__(self, state: VehicleState[F], limits: Limits) -> None:
        self.state = state
        self._limits = limits

    def step(self, acceleration: Array, yaw_rate: Array, dt: float) -> None:
        """Fly on for ``dt`` seconds; commands beyond the limits are cut off there."""
        limits = self._limits
        acceleration = np.clip(acceleration, limits.acceleration_min, limits.acceleration_max)
        yaw_rate = np.clip(yaw_rate, -limits.yaw_rate_max, limits.yaw_rate_max)
        self.state = advance(self.state, acceleration, yaw_rate, dt, limits, np)


def guidance(
    legs: Legs[Air],
    state: VehicleState[F],
    time: Array,
    dt: float = PERIOD,
    gains: Gains = GAINS,
    wind: Wind | None = None,
) -> tuple[Array, Array]:
    """Return the acceleration (m/s^2) and yaw rate (rad/s) for the coming period of ``dt`` s,
    ``[...]`` each.

    The plan's legs are ``[..., L]``, the time is on its clock, s. With the wind whose air mass the
    legs are in, state and commands are over the ground.
    """
    return steer(at(legs, time, wind), at(legs, time + dt, wind), state, dt, gains)


def steer(
    before: VehicleState[F],
    after: VehicleState[F],
    state: VehicleState[F],
    dt: float = PERIOD,
    gains: Gains = GAINS,
) -> tuple[Array, Array]:
    """Return the commands that lead along two states of the plan one period apart, as
    :func:`guidance` does.
    """
    ahead, left = offset(state, before)
    acceleration = (
        (after.speed - before.speed) / dt
        - gains.speed * (state.speed - before.speed)
        - gains.along * ahead
    )
    turn = wrap(after.heading - before.heading, np) / dt
    heading_error = wrap(state.heading - before.heading, np)
    yaw_rate = (
        turn - gains.heading * heading_error - gains.across * left / np.maximum(state.speed, 1.0)
    )
    return acceleration, yaw_rate


class Deviation(NamedTuple):
    """Errors of a state against a plan; fields ``[...]``, SI units and radians."""

    cross_track: Array  # distance from the path, m, positive to its left
    along_track: Array
    """Distance ahead of where the plan is now, along the path, m; negative when behind."""
    time: Array  # how much later than planned the aircraft is at its place, s; negative when early
    heading: Array  # against the path's heading there, rad, positive to the left
    speed: Array  # against the plan's speed there, m/s


def offset(state: VehicleState[F], reference: VehicleState[F]) -> tuple[Array, Array]:
    """Return where a state is in the frame of a reference: ahead and to the left, m, ``[...]``
    each.
    """
    sine, cosine = np.sin(reference.heading), np.cos(reference.heading)
    x, y = state.x - reference.x, state.y - reference.y
    return x * cosine + y * sine, y * cosine - x * sine


def deviation(legs: Legs[Air], state: VehicleState[Air], time: Array) -> Deviation:
    """Compare a state ``[...]`` with the legs ``[..., L]`` of a plan at a time on its clock, s.

    The point of the path abeam of the aircraft is found from where the plan is now, by its speed;
    the errors of path and time are so kept apart on curves too.
    """
    abeam = time + np.zeros(np.shape(state.x))
    for _ in range(_STEPS):
        reference = at(legs, abeam)
        ahead, _left = offset(state, reference)
        abeam = abeam + ahead / np.maximum(reference.speed, 1.0)
    reference = at(legs, abeam)
    _ahead, left = offset(state, reference)
    late = time - abeam
    planned = at(legs, time)
    # Mean speed between both points: exact for constant acceleration.
    along = -late * 0.5 * (reference.speed + planned.speed)
    return Deviation(
        left,
        along,
        late,
        wrap(state.heading - reference.heading, np),
        state.speed - reference.speed,
    )
