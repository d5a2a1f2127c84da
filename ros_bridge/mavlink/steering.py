"""From a plan and where the aircraft is to the roll, airspeed and altitude that the autopilot is
told.

The guidance is that of the true aircraft of the evaluation (:mod:`envs.c208.guidance`): the plan is
looked up as far ahead as the aircraft lags, across the path and along it in time. What it asks for
is a turn rate and an acceleration; an autopilot takes a roll angle, and an airspeed that it reaches
with a lag of its own. Its altitude follows the one that it is told late and through a filter of
first order: so the plan's is looked up as much later, and the filter undone by the plan's climb.
"""

import math
from typing import NamedTuple

import numpy as np

from envs import frames
from envs.c208.guidance import Guide, Lookahead, Path
from envs.follower import deviation, offset
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.profile import Height, Profile, height_flown
from envs.waypoints import Legs, Waypoint, at, legs, plan_states
from envs.wind import NO_WIND, Wind, through_air
from ros_bridge.mavlink.vehicle import GRAVITY, HeightLag, Vehicle

PERIOD = 0.1
"""Between two commands, s."""

SPEED_LAG = 3.0
"""How much later than demanded an airspeed is flown, s. What is left of it is among the measured
distances along the plan (docs/reference/mavlink-measured.md).
"""

GAINS = Lookahead(turn=0.5, across=0.30, heading=1.1)
_ALONG = 0.15  # speed per distance behind, 1/s
_SHARE = 0.02  # of a new offset that is taken over each period: in 5 s


class Command(NamedTuple):
    """What the autopilot is told."""

    roll: float  # rad, positive to the right
    airspeed: float  # m/s
    altitude: float | None = None  # m above mean sea level; None: it keeps what it has


class Steered(NamedTuple):
    """A period of the follower."""

    time: float  # s
    cross_track: float  # m
    along_track: float
    late: float  # s
    speed: float  # over the ground, m/s
    airspeed: float
    command: Command
    above: float = math.nan  # the plan's altitude, m; nan: the plan is in the plane


class Air(NamedTuple):
    """The air that the aircraft flies in."""

    wind: tuple[float, float] = (0.0, 0.0)  # its velocity, m/s east and north
    offset: float = 0.0  # of the airspeed that is indicated from the true one, m/s


def sense(
    air: Air, state: VehicleState[Ground], wind: tuple[float, float] | None, airspeed: float | None
) -> Air:
    """Return the air after one more period: the airspeed's offset follows slowly."""
    wind = wind or (0.0, 0.0)
    if airspeed is None:
        return Air(wind, air.offset)
    east = state.speed * math.cos(state.heading) - wind[0]
    north = state.speed * math.sin(state.heading) - wind[1]
    off = airspeed - math.hypot(east, north)
    return Air(wind, air.offset + _SHARE * (off - air.offset))


class Follower(NamedTuple):
    """A plan that is followed."""

    legs: Legs[frames.Air]
    path: Path  # the legs as plain floats
    wind: Wind  # in whose air mass the legs are
    height: "PlannedHeight | None" = None  # None: the plan is in the plane
    late: float = 0.0  # how much later than planned the aircraft was at its place, s


class PlannedHeight(NamedTuple):
    """The altitude of a plan as it is flown."""

    profile: Profile  # times from the plan's request
    acceleration: float  # with which climbs change, m/s^2

    def at(self, time: float) -> Height:
        """Return altitude and climb at a time, s."""
        return height_flown(self.profile, self.acceleration, time)

    def to_demand(self, time: float, lag: HeightLag) -> float:
        """Return the altitude that an autopilot is told at a time, s, so that it has the plan's, m
        above mean sea level.
        """
        ahead = self.at(time + lag.delay)
        return ahead.altitude + lag.filter * ahead.climb


def guide(
    own: VehicleState[Ground],
    waypoints: tuple[Waypoint, ...],
    wind: Wind | None,
    height: PlannedHeight | None = None,
) -> Follower:
    """Return the follower of a plan from its first state and its waypoints, times from its
    request, the wind that it is flown in, and its altitude.
    """
    curve = legs(plan_states(own, waypoints, wind=wind))
    return Follower(curve, Path(curve, wind or NO_WIND), wind or NO_WIND, height)


def errors(
    follower: Follower, state: VehicleState[Ground], time: float
) -> tuple[float, float, float]:
    """Return how far a state over the ground is from the plan at a time, s: across it and along
    it, m, and in time, s, all in the air mass.
    """
    in_air = through_air(state, follower.wind, time)
    off = deviation(follower.legs, in_air, np.float64(time))
    return float(off.cross_track), float(off.along_track), float(off.time)


def command(
    follower: Follower,
    state: VehicleState[Ground],
    time: float,
    air: Air,
    vehicle: Vehicle,
    bank_max: float,
) -> tuple[Command, Follower]:
    """Return roll, airspeed and altitude for the coming period, and the follower after it.

    Args:
        follower: of the plan.
        state: now.
        time: on the plan's clock, s.
        air: that the aircraft flies in.
        vehicle: that is told.
        bank_max: rad.
    """
    guidance = Guide(follower.path, GAINS, follower.late)
    _, turn = guidance.commands(state, time, PERIOD)
    roll = -math.atan(turn * state.speed / GRAVITY)
    ahead = at(follower.legs, np.float64(time + SPEED_LAG), follower.wind)
    planned = at(follower.legs, np.float64(time), follower.wind)
    late = offset(state, planned)[0]
    gain = -_ALONG * float(late) / max(float(ahead.speed), 1.0)
    east = float(ahead.speed * np.cos(ahead.heading)) * (1.0 + gain) - air.wind[0]
    north = float(ahead.speed * np.sin(ahead.heading)) * (1.0 + gain) - air.wind[1]
    airspeed = math.hypot(east, north) + air.offset
    demand = Command(
        min(max(roll, -bank_max), bank_max),
        min(max(airspeed, vehicle.airspeed_min), vehicle.airspeed_max),
        None if follower.height is None else follower.height.to_demand(time, vehicle.height_lag),
    )
    return demand, follower._replace(late=guidance.late)
