"""How far the ownship stays from the intruder if it flies one of twelve simple manoeuvres from now on.

Whether a conflict can still be solved, by which turn and at which speed, is a question of metres that the closest
approach on straight courses does not answer. Here the ownship turns left or right by a quarter, flies on, or turns to
its goal, and brakes, holds its speed or accelerates meanwhile, all at the surrogate's limits (paper, table "Surrogate
vs. true dynamic parameters"); the intruder flies straight on.

A manoeuvre is a chain of straight pieces, short ones first, and the separation along a piece is that of its closest
point. Below 1500 m it is that of the exact path but for some metres, and for some tens of metres where a turn to the
goal ends within a long piece.
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

__all__ = ["ADVICE", "COUNT", "HORIZON", "PRESSED", "advice", "pressed", "separations"]

_SPANS = (1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 5.0, 5.0, 6.0, 6.0, 8.0, 8.0, 10.0, 10.0, 12.0, 15.0)
"""Durations of the pieces, s."""

HORIZON = sum(_SPANS)
"""How far ahead is looked, s."""

COUNT = 12
"""Manoeuvres: to the left, to the right, straight on, to the goal; of each braking, at a steady speed, accelerating."""

ADVICE = 3
"""Numbers that :func:`advice` gives."""

PRESSED = 3
"""Numbers that :func:`pressed` gives."""

_ALIKE = 0.05
"""Between what manoeuvres keep, squashed as the network sees it: 1.5 m near 1000 m, 10 m at 1050 m."""

_HARDLY_ALIKE = 0.002
"""The same where it is pressed: 6 cm."""

_FROM, _UPTO = 0.25, 0.1
"""What the best manoeuvre keeps, squashed, where it begins to be pressed, 10 m, and where it is altogether, 3.3 m."""

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
        xp: array namespace.
    """
    if xp is FLOATS:
        return _at_once(geometry, goal_bearing).tolist()
    if xp is np and goal_bearing.size <= _FEW:
        return _in_blocks(geometry, goal_bearing)
    goal_sine, goal_cosine = sincos(goal_bearing, xp)
    size, hand = xp.abs(goal_bearing), xp.copysign(1.0, goal_bearing)
    ways = [(geometry.intruder_x, geometry.intruder_y)] * 4
    least: list[Any] = [None] * 4
    for span, swung, quarter, gained in zip(_SPANS, _SWUNG.tolist(), _QUARTER.tolist(), _GAINED, strict=True):
        turning = size > swung
        home = (
            xp.where(turning, math.cos(swung), goal_cosine),
            xp.where(turning, math.sin(swung) * hand, goal_sine),
        )
        cosine, sine = math.cos(quarter), math.sin(quarter)
        speeds = _threefold(gained, geometry.own_speed, xp) + geometry.own_speed
        way = xp.clip(speeds, SURROGATE.speed_min, SURROGATE.speed_max) * span  # [3, ...]
        drift_x, drift_y = geometry.intruder_vx * span, geometry.intruder_vy * span
        for number, (ahead, aside) in enumerate(((cosine, sine), (cosine, -sine), (1.0, 0.0), home)):
            step_x, step_y = drift_x - way * ahead, drift_y - way * aside
            x, y = ways[number][0] + step_x, ways[number][1] + step_y
            ways[number] = x, y
            # How much of the piece lies behind its closest point; a hundredth of a metre matters to nobody.
            back = (x * step_x + y * step_y) / (step_x * step_x + step_y * step_y + 0.01)
            back = xp.clip(back, 0.0, 1.0)
            x, y = x - back * step_x, y - back * step_y
            square = x * x + y * y
            before = least[number]
            least[number] = square if before is None else xp.minimum(before, square)
    return [each for square in least for each in _apart(xp.sqrt(square), xp)]


def advice(kept: list[Any], goal_bearing: Any, xp: Any) -> list[Any]:
    """Return what the best manoeuvre keeps, and how it accelerates and turns, 1 at the limit: 3 times ``[...]``.

    Of manoeuvres that keep nearly as much it is the mean of what they do, so that nothing hangs on rounding.

    Args:
        kept: of each manoeuvre, squashed to (-1, 1), :data:`COUNT` times ``[...]``.
        goal_bearing: as for :func:`separations`.
        xp: array namespace.
    """
    most = reduce(xp.maximum, kept)
    return [most, *_blended(kept, most, goal_bearing, _ALIKE, xp)]


def pressed(kept: list[Any], goal_bearing: Any, xp: Any) -> list[Any]:
    """Return whether metres decide, 0 to 1, and that times what the one best manoeuvre does: 3 times ``[...]``.

    The mean of :func:`advice` is of manoeuvres 1.5 m apart and blunt: where one brakes, the other accelerates, and the
    first keeps a metre more, it tells hardly anything, and with two metres to spare that metre is lost. Here it takes
    6 cm, but only where the best manoeuvre keeps little, for elsewhere such advice would flutter.

    Args:
        kept: as for :func:`advice`.
        goal_bearing: as for :func:`separations`.
        xp: array namespace.
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


def _threefold(values: np.ndarray, like: Any, xp: Any) -> Any:
    """Return three numbers as ``[3, ...]`` beside a component ``[...]``, or ``[1, 3]`` beside a graph's column."""
    if hasattr(like, "ndim"):
        return xp.asarray(values, like.dtype).reshape((3,) + (1,) * like.ndim)
    return xp.row(values)


def _apart(values: Any, xp: Any) -> list[Any]:
    """Return the three components of :func:`_threefold`."""
    return [values[i] for i in range(3)] if hasattr(values, "ndim") else list(xp.columns(values, 3))


_FEW = 256
"""Rows up to which numpy takes all pieces at once, which saves calls; of more rows it takes one piece after the other,
which saves memory. Both do the same operations in the same order, so that a row has the same bits in any company."""

_ROWS = 32
"""Rows taken at once: what lies between stays in cache."""


def _in_blocks(geometry: Decoded, goal_bearing: np.ndarray) -> list[np.ndarray]:
    """Return the separations of arrays of any shape, a few rows at a time."""
    shape, dtype = goal_bearing.shape, goal_bearing.dtype
    flat = [np.broadcast_to(field, shape).reshape(-1) for field in (*geometry, goal_bearing)]
    kept = np.empty((COUNT, goal_bearing.size), dtype)
    for first in range(0, goal_bearing.size, _ROWS):
        rows = slice(first, first + _ROWS)
        *fields, bearing = (field[rows] for field in flat)
        kept[:, rows] = _at_once(Decoded(*fields), bearing)
    return list(kept.reshape((COUNT, *shape)))


_AHEAD = np.stack([np.cos(_QUARTER), np.cos(_QUARTER), np.ones_like(_QUARTER), np.cos(_SWUNG)])  # [4, K]
_ASIDE = np.stack([np.sin(_QUARTER), -np.sin(_QUARTER), np.zeros_like(_QUARTER), np.sin(_SWUNG)])
_GAINS = np.ascontiguousarray(_GAINED.T)  # [3, K]


def _at_once(geometry: Decoded, goal_bearing: Any) -> np.ndarray:
    """Do the same in numpy, ``[12, N]`` of arrays ``[N]`` and ``[12]`` of floats: all pieces at once, few calls."""
    dims, dtype = np.ndim(geometry.own_speed), np.result_type(geometry.own_speed)
    spans, swung, ahead, aside, gains = _tables(dims, dtype)
    goal_sine, goal_cosine = sincos(goal_bearing, np if dims else FLOATS)
    turning = np.abs(goal_bearing) > swung
    shape = (4, *turning.shape)
    cosine, sine = np.empty(shape, dtype), np.empty(shape, dtype)
    cosine[:3], sine[:3] = ahead[:3], aside[:3]
    cosine[3] = np.where(turning, ahead[3], goal_cosine)
    sine[3] = np.where(turning, aside[3] * np.copysign(1.0, goal_bearing), goal_sine)
    way = gains + geometry.own_speed  # [3, K, ...]
    np.maximum(way, SURROGATE.speed_min, out=way)
    np.minimum(way, SURROGATE.speed_max, out=way)
    way *= spans
    step_x = geometry.intruder_vx * spans - way * cosine[:, np.newaxis]  # [4, 3, K, ...]
    step_y = geometry.intruder_vy * spans - way * sine[:, np.newaxis]
    x, y = step_x.copy(), step_y.copy()
    x[:, :, 0] += geometry.intruder_x
    y[:, :, 0] += geometry.intruder_y
    np.cumsum(x, axis=2, out=x)
    np.cumsum(y, axis=2, out=y)
    back = x * step_x
    back += y * step_y
    back /= step_x * step_x + step_y * step_y + 0.01
    np.maximum(back, 0.0, out=back)
    np.minimum(back, 1.0, out=back)
    step_x *= back
    step_y *= back
    x -= step_x
    y -= step_y
    x *= x
    y *= y
    x += y
    return np.sqrt(x.min(axis=2)).reshape((COUNT, *turning.shape[1:]))


@cache
def _tables(dims: int, dtype: np.dtype[Any]) -> tuple[np.ndarray, ...]:
    """Return spans, turns and gains of the pieces as they meet fields of so many axes."""
    return tuple(
        np.array(each.reshape(each.shape + (1,) * dims), dtype)
        for each in (np.array(_SPANS), _SWUNG, _AHEAD, _ASIDE, _GAINS)
    )
