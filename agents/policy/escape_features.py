"""How far the ownship stays from the intruder if it flies one of twelve simple manoeuvres from now on.

The ownship turns left or right by a quarter, flies on, or turns to its goal, and brakes, holds its speed or accelerates
meanwhile, all at the surrogate's limits (paper, table "Surrogate vs. true dynamic parameters"); the intruder flies
straight on. A manoeuvre is a chain of straight pieces, and the separation along a piece is that of its closest point:
below 1500 m that of the exact path but for some metres, some tens where a turn to the goal ends within a long piece.
"""

import math
from functools import cache, reduce
from operator import add
from typing import Any

import numpy as np

from envs.angles import sincos
from envs.backend import FLOATS
from envs.kinematics import SURROGATE
from envs.observation import Decoded

# Durations of the pieces, s.
_SPANS = (1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 5.0, 5.0, 6.0, 6.0, 8.0, 8.0, 10.0, 10.0, 12.0, 15.0)

HORIZON = sum(_SPANS)
"""How far ahead is looked, s."""

COUNT = 12
"""Manoeuvres: to the left, to the right, straight on, to the goal; of each braking, at a steady speed, accelerating."""

_ALIKE = 0.05  # between what manoeuvres keep, squashed as the network sees it: 1.5 m near 1000 m, 10 m at 1050 m
_HARDLY_ALIKE = 0.002  # the same where it is pressed: 6 cm
_FROM, _UPTO = 0.25, 0.1  # squashed, what the best one keeps where it begins to be pressed, 10 m, and is fully, 3.3 m

# Of the middle of each piece, in time.
_MIDDLES = np.cumsum(_SPANS) - 0.5 * np.array(_SPANS)
_SWUNG = np.minimum(SURROGATE.yaw_rate_max * _MIDDLES, math.pi)  # rad, the longest turn there is
_QUARTER = np.minimum(_SWUNG, 0.5 * math.pi)
_GAINED = np.multiply.outer(_MIDDLES, [SURROGATE.acceleration_min, 0.0, SURROGATE.acceleration_max])  # m/s [K, 3]


def separations(geometry: Decoded, goal_bearing: Any, xp: Any) -> list[Any]:
    """Return the least separation within :data:`HORIZON` of each manoeuvre, m, :data:`COUNT` times ``[...]``.

    Args:
        geometry: in the ownship's frame, fields ``[...]``.
        goal_bearing: direction of the goal from the ownship's heading, rad in [-pi, pi], left positive, ``[...]``.
    """
    arrays = np if xp is FLOATS else xp
    spans, swung, ahead, aside, gains = _tables(
        np.ndim(geometry.own_speed), np.dtype(getattr(geometry.own_speed, "dtype", float))
    )
    goal_sine, goal_cosine = sincos(goal_bearing, xp)
    turning = arrays.abs(goal_bearing) > swung  # [K, ...]
    home = (
        arrays.where(turning, ahead[3], goal_cosine),
        arrays.where(turning, aside[3] * arrays.copysign(1.0, goal_bearing), goal_sine),
    )
    cosine, sine = (
        arrays.concatenate([arrays.broadcast_to(fixed[:3], (3, *turning.shape)), last[None]])[:, None]
        for fixed, last in zip((ahead, aside), home, strict=True)
    )
    way = arrays.clip(gains + geometry.own_speed, SURROGATE.speed_min, SURROGATE.speed_max) * spans  # [3, K, ...]
    step_x = geometry.intruder_vx * spans - way * cosine  # [4, 3, K, ...]
    step_y = geometry.intruder_vy * spans - way * sine
    x, y = (
        arrays.cumsum(arrays.concatenate([step[:, :, :1] + first, step[:, :, 1:]], axis=2), axis=2)
        for step, first in ((step_x, geometry.intruder_x), (step_y, geometry.intruder_y))
    )
    # How much of the piece lies behind its closest point; a hundredth of a metre matters to nobody.
    back = arrays.clip((x * step_x + y * step_y) / (step_x * step_x + step_y * step_y + 0.01), 0.0, 1.0)
    x, y = x - back * step_x, y - back * step_y
    kept = arrays.sqrt(arrays.min(x * x + y * y, axis=2)).reshape((COUNT, *turning.shape[1:]))
    return kept.tolist() if xp is FLOATS else list(kept)


def advice(kept: list[Any], goal_bearing: Any, xp: Any) -> list[Any]:
    """Return what the best manoeuvre keeps, and how it accelerates and turns, 1 at the limit: 3 times ``[...]``.

    Of manoeuvres that keep nearly as much it is the mean of what they do, so that nothing hangs on rounding.

    Args:
        kept: of each manoeuvre, squashed to (-1, 1), :data:`COUNT` times ``[...]``.
    """
    most = reduce(xp.maximum, kept)
    return [most, *_blended(kept, most, goal_bearing, _ALIKE, xp)]


def pressed(kept: list[Any], goal_bearing: Any, xp: Any) -> list[Any]:
    """Return whether metres decide, 0 to 1, and that times what the one best manoeuvre does: 3 times ``[...]``.

    The mean of :func:`advice` is of manoeuvres 1.5 m apart, which is blunt where the best one keeps little.
    """
    most = reduce(xp.maximum, kept)
    near = xp.clip((_FROM - most) * (1.0 / (_FROM - _UPTO)), 0.0, 1.0)
    acceleration, turn = _blended(kept, most, goal_bearing, _HARDLY_ALIKE, xp)
    return [near, near * acceleration, near * turn]


def _blended(kept: list[Any], most: Any, goal_bearing: Any, alike: float, xp: Any) -> tuple[Any, Any]:
    """Return acceleration and turn of the manoeuvres that keep nearly as much as the best, 1 at the limit."""
    shares = []
    for each in kept:
        behind = (most - each) * (1.0 / alike)
        shares.append(1.0 / (1.0 + behind * behind))
    left, right, straight, home = (reduce(add, shares[first : first + 3]) for first in range(0, COUNT, 3))
    braking, accelerating = reduce(add, shares[0::3]), reduce(add, shares[2::3])
    whole = left + right + straight + home
    to_goal = xp.clip(goal_bearing * (1.0 / SURROGATE.yaw_rate_max), -1.0, 1.0)
    return (accelerating - braking) / whole, (left - right + home * to_goal) / whole


_AHEAD = np.stack([np.cos(_QUARTER), np.cos(_QUARTER), np.ones_like(_QUARTER), np.cos(_SWUNG)])  # [4, K]
_ASIDE = np.stack([np.sin(_QUARTER), -np.sin(_QUARTER), np.zeros_like(_QUARTER), np.sin(_SWUNG)])
_GAINS = np.ascontiguousarray(_GAINED.T)  # [3, K]


@cache
def _tables(dims: int, dtype: np.dtype[Any]) -> tuple[np.ndarray, ...]:
    """Return spans, turns and gains of the pieces as they meet fields of so many axes."""
    return tuple(
        np.array(each.reshape(each.shape + (1,) * dims), dtype)
        for each in (np.array(_SPANS), _SWUNG, _AHEAD, _ASIDE, _GAINS)
    )
