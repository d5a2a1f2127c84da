"""The wind: the same motion seen over the ground and in the air mass, and what of an aircraft's
limits is left where the wind is not known exactly.

Both frames coincide at time 0; after t seconds the air has carried its frame by w t. Distances
between aircraft are the same in both, headings and speeds are not. Accelerations as vectors are the
same too.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from envs.angles import wrap
from envs.arrays import Array, ArrayModule
from envs.backend import FLOATS
from envs.compiled import scalar
from envs.frames import Air, Ground
from envs.kinematics import Limits, VehicleState

_LEAST = 1e-9  # m/s^2 by which a quotient is kept finite


class Wind(NamedTuple):
    """Velocity of the air over the ground, which is the same everywhere and does not change; plain
    numbers, or arrays ``[N]``.
    """

    east: Array = 0.0  # towards the east, m/s
    north: Array = 0.0  # towards the north, m/s
    std: Array = 0.0  # one sigma of both, m/s; 0: known exactly

    @property
    def speed(self) -> Array:
        """How fast it is, m/s."""
        return np.hypot(self.east, self.north)


NO_WIND = Wind()


def through_air(state: VehicleState[Ground], wind: Wind, time: Array) -> VehicleState[Air]:
    """Return a state, ``[...]`` or plain floats, as the air mass sees it, ``time`` s after 0."""
    return _carry(state, wind.east, wind.north, time)


def over_ground(state: VehicleState[Air], wind: Wind, time: Array) -> VehicleState[Ground]:
    """Return a state as the ground sees it; arguments as of :func:`through_air`."""
    return _carry(state, -wind.east, -wind.north, time)


def _carry(state: VehicleState[Any], east: Array, north: Array, time: Array) -> VehicleState[Any]:
    """Return a state as a frame sees it that moves with a velocity, m/s."""
    if isinstance(east, float | int) and east == 0.0 and north == 0.0:
        return state
    x, y = state.x - east * time, state.y - north * time
    if isinstance(state.speed, float):
        vx = state.speed * math.cos(state.heading) - east
        vy = state.speed * math.sin(state.heading) - north
        return VehicleState(x, y, wrap(math.atan2(vy, vx), FLOATS), math.hypot(vx, vy))
    vx, vy = state.speed * np.cos(state.heading) - east, state.speed * np.sin(state.heading) - north
    return VehicleState(x, y, wrap(np.arctan2(vy, vx), np), np.hypot(vx, vy))


def turn_through_air(state: VehicleState[Ground], turn_rate: float, wind: Wind) -> float:
    """Return the turn rate of an aircraft through the air whose track over the ground turns at a
    rate, both rad/s; the state is in plain floats.

    What turns at a rate r through the air accelerates by r u across its velocity u there; its
    ground velocity v turns by the part of that across itself, r (u v) / v^2. Where the wind is so
    strong that the track says nothing of the turn, the rate of the track is returned.
    """
    air = through_air(state, wind, 0.0)
    product = air.speed * state.speed * math.cos(air.heading - state.heading)
    if product <= 0.25 * state.speed * state.speed:
        return turn_rate
    return turn_rate * state.speed * state.speed / product


def turned_error(turn: Array, error: Array) -> Array:
    """Return by how much the ground velocity of an aircraft after a turn through the air, rad, is
    off at most where the wind is off by ``error``, m/s (theorem ``turned_in_other_wind`` of
    proofs/Wind.v).
    """
    return np.minimum(np.abs(turn), 2.0) * error


@scalar
def aim_point(
    own: VehicleState[Air],
    goal: tuple[Array, Array],
    drift: tuple[Array, Array] | None,
    latest: float,
    xp: ArrayModule,
) -> tuple[Array, Array]:
    """Return where aircraft meet their goals by flying straight ahead, m, ``[...]`` each.

    Args:
        own: states.
        goal: where the goals are now, m.
        drift: velocity of the goals, m/s; None: they stand still.
        latest: where a goal cannot be met within so many seconds, its place then is returned.
        xp: array namespace.
    """
    if drift is None:
        return goal
    (dx, dy), x, y = drift, goal[0] - own.x, goal[1] - own.y
    closing, square = -(x * dx + y * dy), x * x + y * y
    faster = own.speed * own.speed - dx * dx - dy * dy
    quotient = closing + xp.sqrt(xp.maximum(closing * closing + faster * square, 0.0))
    latest = max(latest, 0.0)
    met = quotient * latest > square
    time = xp.where(met, square / xp.maximum(quotient, _LEAST), latest + 0.0 * square)
    return goal[0] + dx * time, goal[1] + dy * time


def narrow(limits: Limits, error: float) -> Limits:
    """Return limits that a motion must keep in the air mass of a wind, so that it keeps the given
    ones in that of every wind that differs by ``error`` m/s at most (theorem ``narrow_sound`` of
    proofs/Wind.v).

    The motion over the ground and its acceleration as a vector are the same in all of them. With
    an error e, an airspeed v, a turn rate r and an acceleration a along the path, in the other air
    mass

    - the airspeed differs from v by e at most,
    - the acceleration along the path differs from a share of a by ``e |r|`` at most: the path's
      direction turns by an angle whose sine is ``e / v`` at most,
    - the turn rate is ``(v |r| + |a| e / v) / (v - e)`` at most.

    The turn rate is narrowed for the lowest airspeed that is left, at which that bound is greatest,
    and so far that half of the weaker acceleration is left. Speeds that cross, or a turn rate or
    acceleration that is not positive, mean that nothing is left. Near standing still the turn rate
    has no bound; so what can fly very slowly, as what hovers, must not fly slower than twice the
    error, nor slower than the strongest acceleration divided by the turn rate.
    """
    if error == 0.0:
        return limits
    strongest = max(limits.acceleration_max, -limits.acceleration_min)
    lowest = max(limits.speed_min, 2.0 * error, strongest / limits.yaw_rate_max)
    slow = lowest + error
    turn = limits.yaw_rate_max * lowest / slow - strongest * error / (slow * slow)
    weakest = min(limits.acceleration_max, -limits.acceleration_min)
    turn = min(turn, 0.5 * weakest / error)
    lost = max(turn, 0.0) * error
    return Limits(
        slow,
        limits.speed_max - error,
        limits.acceleration_min + lost,
        limits.acceleration_max - lost,
        turn,
    )
