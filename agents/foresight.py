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
from typing import Any

import numpy as np

from envs.angles import sincos
from envs.backend import FLOATS
from envs.kinematics import SURROGATE
from envs.observation import Decoded

__all__ = ["COUNT", "HORIZON", "separations"]

_SPANS = (1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 5.0, 5.0, 6.0, 6.0, 8.0, 8.0, 10.0, 10.0, 12.0, 15.0)
"""Durations of the pieces, s."""

HORIZON = sum(_SPANS)
"""How far ahead is looked, s."""

COUNT = 12
"""Manoeuvres: to the left, to the right, straight on, to the goal; of each braking, at a steady speed, accelerating."""

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
        return _at_once(geometry, goal_bearing)
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


def _threefold(values: np.ndarray, like: Any, xp: Any) -> Any:
    """Return three numbers as ``[3, ...]`` beside a component ``[...]``, or ``[1, 3]`` beside a graph's column."""
    if hasattr(like, "ndim"):
        return xp.asarray(values, like.dtype).reshape((3,) + (1,) * like.ndim)
    return xp.row(values)


def _apart(values: Any, xp: Any) -> list[Any]:
    """Return the three components of :func:`_threefold`."""
    return [values[i] for i in range(3)] if hasattr(values, "ndim") else list(xp.columns(values, 3))


_PIECES = np.array(_SPANS)
_AWAY = np.exp(1j * np.stack([_QUARTER, -_QUARTER, 0.0 * _QUARTER]))
_HOMEWARD = np.exp(1j * _SWUNG)
_GAINS = np.ascontiguousarray(_GAINED.T)


def _at_once(geometry: Decoded, goal_bearing: float) -> list[float]:
    """Do the same for plain floats, all pieces at once: in the complex plane, so that there is little to call."""
    swinging = int(np.searchsorted(_SWUNG, abs(goal_bearing)))
    home = _HOMEWARD.copy() if goal_bearing >= 0.0 else _HOMEWARD.conj()
    home[swinging:] = complex(math.cos(goal_bearing), math.sin(goal_bearing))
    headings = np.concatenate((_AWAY, home[np.newaxis]))  # [4, K]
    way = _GAINS + geometry.own_speed  # [3, K]
    np.minimum(np.maximum(way, SURROGATE.speed_min, out=way), SURROGATE.speed_max, out=way)
    way *= _PIECES
    drift = complex(geometry.intruder_vx, geometry.intruder_vy) * _PIECES
    step = drift - headings[:, np.newaxis] * way  # [4, 3, K]
    end = step.cumsum(axis=-1)
    end += complex(geometry.intruder_x, geometry.intruder_y)
    along, across = step.real, step.imag
    back = (end.real * along + end.imag * across) / (along * along + across * across + 0.01)
    end -= np.minimum(np.maximum(back, 0.0, out=back), 1.0, out=back) * step
    x, y = end.real, end.imag
    return np.sqrt((x * x + y * y).min(axis=-1)).ravel().tolist()
