"""The best of a fan of extremal flights: a lower bound of the separation that can be kept, without any grid.

To maximise the distance at one closest approach is, by Pontryagin's principle, to turn at full rate onto one course and
to hold it, at the strongest deceleration first (perhaps for no time) and then the strongest acceleration. Every flight
of the fan can be flown, so that the best of them never promises too much.
"""

import math
from typing import Any

import numpy as np

from envs.kinematics import Limits, VehicleState, advance

__all__ = ["best_separation"]

_TURN = math.radians(1.5)  # in a time step at full rate
_COURSES = np.radians(np.arange(-220.0, 220.1, 2.0))
_SWITCHES = (0, 2, 4, 8, 12, 16, 22, 28, 36, 48, math.inf)  # time steps of deceleration
_BLOCK = 8


def best_separation(
    own_speed: float, intruder_heading: float, intruder_speed: float, x: Any, y: Any, limits: Limits, horizon: float
) -> Any:
    """Return the largest smallest distance of any flight of the fan within a horizon (s), m, ``[M]``.

    The ownship starts at the origin, heading along x; the intruder flies straight from (x, y), m, ``[M]``. m/s, rad.
    """
    step = _TURN / limits.yaw_rate_max
    own_x, own_y = _fan(own_speed, limits, step, math.ceil(horizon / step))
    time = step * np.arange(own_x.shape[1])
    vx, vy = intruder_speed * math.cos(intruder_heading), intruder_speed * math.sin(intruder_heading)
    left = (own_x - vx * time).astype(np.float32)
    over = (own_y - vy * time).astype(np.float32)
    chord_x, chord_y = np.diff(left), np.diff(over)
    length = np.maximum(chord_x * chord_x + chord_y * chord_y, np.float32(1e-6))
    best = np.empty(np.shape(x))
    for first in range(0, best.size, _BLOCK):
        part = slice(first, first + _BLOCK)
        # Relative position at the beginning of each chord, [M', F, T].
        from_x = left[:, :-1] - np.asarray(x, np.float32)[part, None, None]
        from_y = over[:, :-1] - np.asarray(y, np.float32)[part, None, None]
        along = np.clip(-(from_x * chord_x + from_y * chord_y) / length, 0.0, 1.0)
        from_x += along * chord_x
        from_y += along * chord_y
        best[part] = np.sqrt(np.max(np.min(from_x * from_x + from_y * from_y, axis=2), axis=1))
    return best


def _fan(speed: float, limits: Limits, step: float, count: int) -> tuple[Any, Any]:
    """Return the positions of all flights at times 0, step, 2 step, ..., m, ``[F, T + 1]``."""
    course, switch = (grid.ravel() for grid in np.meshgrid(_COURSES, _SWITCHES))
    zero = np.zeros(course.size)
    own = VehicleState(zero, zero, zero, zero + speed)
    left_to_turn, x, y = course.copy(), [own.x], [own.y]
    for index in range(count):
        turn = np.clip(left_to_turn, -_TURN, _TURN)
        thrust = np.where(index >= switch, limits.acceleration_max, limits.acceleration_min)
        own = advance(own, thrust, turn / step, step, limits, np)
        left_to_turn = left_to_turn - turn
        x.append(own.x)
        y.append(own.y)
    return np.stack(x, axis=1), np.stack(y, axis=1)
