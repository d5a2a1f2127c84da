"""Over the ground and through the air: the same motion seen from two frames, one of which the wind
carries.

Both frames coincide at time 0. Distances between aircraft are the same in both, headings and speeds
are not.
"""

import math
from typing import Any

import numpy as np

from envs.angles import wrap
from envs.backend import FLOATS
from envs.kinematics import VehicleState

Wind = tuple[float, float]  # velocity of the air towards east and north, m/s
NO_WIND: Wind = (0.0, 0.0)


def through_air(state: VehicleState, wind: Wind, time: Any) -> VehicleState:
    """Return a state over the ground, ``[...]`` or plain floats, as the air mass sees it, ``time``
    s after 0.
    """
    east, north = wind
    if east == 0.0 and north == 0.0:
        return state
    x, y = state.x - east * time, state.y - north * time
    if isinstance(state.speed, float):
        vx, vy = (
            state.speed * math.cos(state.heading) - east,
            state.speed * math.sin(state.heading) - north,
        )
        return VehicleState(x, y, wrap(math.atan2(vy, vx), FLOATS), math.hypot(vx, vy))
    vx, vy = state.speed * np.cos(state.heading) - east, state.speed * np.sin(state.heading) - north
    return VehicleState(x, y, wrap(np.arctan2(vy, vx), np), np.hypot(vx, vy))


def over_ground(state: VehicleState, wind: Wind, time: Any) -> VehicleState:
    """Return a state in the air mass as the ground sees it; arguments as of :func:`through_air`."""
    return through_air(state, (-wind[0], -wind[1]), time)


def air_commands(
    state: VehicleState, acceleration: float, yaw_rate: float, wind: Wind
) -> tuple[float, float]:
    """Return an acceleration (m/s^2) and a turn rate (rad/s) of the track as those of the path
    through the air.

    The acceleration as a vector is the same in both frames. The state is over the ground, in plain
    floats.
    """
    if wind == NO_WIND:
        return acceleration, yaw_rate
    cosine, sine = math.cos(state.heading), math.sin(state.heading)
    across = state.speed * yaw_rate
    east, north = acceleration * cosine - across * sine, acceleration * sine + across * cosine
    vx, vy = state.speed * cosine - wind[0], state.speed * sine - wind[1]
    speed = max(math.hypot(vx, vy), 1.0)
    return (east * vx + north * vy) / speed, (north * vx - east * vy) / (speed * speed)


def ground_commands(
    state: VehicleState, acceleration: float, yaw_rate: float, wind: Wind
) -> tuple[float, float]:
    """Return commands in the air mass as those over the ground; the state is the one in the air."""
    return air_commands(state, acceleration, yaw_rate, (-wind[0], -wind[1]))


def air_demands(
    state: VehicleState,
    acceleration: float,
    yaw_rate: float,
    wind: Wind,
    reach: tuple[float, float],
) -> tuple[float, float]:
    """Return the accelerations along and across the path through the air that make commands over
    the ground, m/s^2.

    ``reach`` are the accelerations along the path that the engine can give; the rest as of
    :func:`air_commands`.
    """
    cosine, sine = math.cos(state.heading), math.sin(state.heading)
    across = state.speed * yaw_rate
    air_east, air_north = state.speed * cosine - wind[0], state.speed * sine - wind[1]
    airspeed = max(math.hypot(air_east, air_north), 1.0)
    ahead = (cosine * air_east + sine * air_north) / airspeed
    aside = (sine * air_east - cosine * air_north) / airspeed
    along = acceleration * ahead - across * aside
    # What the engine cannot give must not be sought by banking: the turn over the ground comes
    # first.
    return along, (across + max(reach[0], min(reach[1], along)) * aside) / max(ahead, 0.5)
