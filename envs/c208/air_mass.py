"""Commands over the ground and through the air: what of an acceleration and a turn of the track is
one along the path through the air, and the other way round.

The frames themselves are those of :mod:`envs.wind`.
"""

import math

from envs.frames import Air, F, Ground
from envs.kinematics import VehicleState
from envs.wind import Wind


def air_commands(
    state: VehicleState[Ground], acceleration: float, yaw_rate: float, wind: Wind
) -> tuple[float, float]:
    """Return an acceleration (m/s^2) and a turn rate (rad/s) of the track as those of the path
    through the air.

    The acceleration as a vector is the same in both frames. The state is in plain floats.
    """
    return _carry(state, acceleration, yaw_rate, wind.east, wind.north)


def ground_commands(
    state: VehicleState[Air], acceleration: float, yaw_rate: float, wind: Wind
) -> tuple[float, float]:
    """Return commands in the air mass as those over the ground."""
    return _carry(state, acceleration, yaw_rate, -wind.east, -wind.north)


def _carry(
    state: VehicleState[F],
    acceleration: float,
    yaw_rate: float,
    moves_east: float,
    moves_north: float,
) -> tuple[float, float]:
    """Return commands as a frame has them that moves with a velocity, m/s."""
    if moves_east == 0.0 and moves_north == 0.0:
        return acceleration, yaw_rate
    cosine, sine = math.cos(state.heading), math.sin(state.heading)
    across = state.speed * yaw_rate
    east, north = acceleration * cosine - across * sine, acceleration * sine + across * cosine
    vx, vy = state.speed * cosine - moves_east, state.speed * sine - moves_north
    speed = max(math.hypot(vx, vy), 1.0)
    return (east * vx + north * vy) / speed, (north * vx - east * vy) / (speed * speed)


def air_demands(
    state: VehicleState[Ground],
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
    air_east, air_north = state.speed * cosine - wind.east, state.speed * sine - wind.north
    airspeed = max(math.hypot(air_east, air_north), 1.0)
    ahead = (cosine * air_east + sine * air_north) / airspeed
    aside = (sine * air_east - cosine * air_north) / airspeed
    along = acceleration * ahead - across * aside
    # What the engine cannot give must not be sought by banking: the turn over the ground comes
    # first.
    return along, (across + max(reach[0], min(reach[1], along)) * aside) / max(ahead, 0.5)
