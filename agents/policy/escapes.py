"""How far the ownship stays from all intruders if it flies one of 22 simple manoeuvres from now on.

Whether a conflict can still be solved, by which turn and at which speed, is a question of metres that the closest
approach on straight courses does not answer. Here the ownship turns by one of ten angles at its greatest yaw rate and
flies on straight, braking, accelerating or at a steady speed; intruders fly straight on. A manoeuvre is a chain of
ten chords between points of its path, and the separation along a chord is that of its closest point: within some
hundredths of a separation of that of the exact path.
"""

import math
import sys
from typing import Any

import numpy as np

from agents.policy.scene import Scene
from envs.aircraft import Ratios
from envs.angles import atan2, sincos

HORIZON = 10.0
"""How far ahead is looked, D / ``speed_max`` (paper: 100 s)."""

_ANGLES = (25.0, 55.0, 90.0, 150.0)  # degrees, to either side
_FIXED = [
    *((side * angle, throttle) for angle in _ANGLES for side in (1.0, -1.0) for throttle in (-1.0, 1.0)),
    *((0.0, throttle) for throttle in (-1.0, 0.0, 1.0)),
]

TURNS = np.radians([turn for turn, _ in _FIXED])
"""Heading changes, rad, left positive, ``[19]``; after them come three turns to the goal."""

THROTTLES = np.array([*(throttle for _, throttle in _FIXED), -1.0, 0.0, 1.0])
"""Acceleration of each manoeuvre in limits, ``[22]``."""

COUNT = len(THROTTLES)

_CURVED = 5  # chords of the turn; the others are straight
_LATER = np.cumsum([1.0, 2.0, 3.0, 4.0, 5.0]) / 15.0
_PIECES = _CURVED + len(_LATER)
_OF_TURN = np.concatenate([np.arange(1, _CURVED + 1) / _CURVED, np.ones(len(_LATER))])  # [P]
_OF_REST = np.concatenate([np.zeros(_CURVED), _LATER])
_MIDDLE = np.concatenate([(np.arange(_CURVED) + 0.5) / _CURVED, np.ones(len(_LATER))])
_BENT = np.concatenate([np.full(_CURVED, 0.5 / _CURVED), np.zeros(len(_LATER))])  # half a chord's angle, of the turn
_LONGEST = 0.9 * HORIZON


def paths(seen: Scene, xp: Any) -> tuple[Any, Any, Any, Any, Any, Any]:
    """Return where the ownship flies in each manoeuvre, six times ``[22, 10, ...]``.

    Of each chord's end the time and the place x, y; of the chord its span of time and its step x, y; in the order
    times, spans, step x, step y, x, y.
    """
    speed, ratios = seen.own_speed, seen.ratios
    dtype, axes = speed.dtype, (1,) * speed.ndim

    def table(values: Any) -> Any:
        return xp.asarray(np.asarray(values, dtype).reshape(np.shape(values) + axes))

    bearing = atan2(seen.goal_y, seen.goal_x, xp)
    turns = xp.concatenate([xp.broadcast_to(table(TURNS), (len(TURNS), *speed.shape)), xp.stack([bearing] * 3)])
    turning = xp.minimum(xp.abs(turns) * ratios.turn_radius, _LONGEST)  # [M, ...]
    times = turning[:, None] * table(_OF_TURN)[None] + (HORIZON - turning)[:, None] * table(_OF_REST)[None]
    spans = times - xp.concatenate([xp.zeros_like(times[:, :1]), times[:, :-1]], axis=1)  # [M, P, ...]

    throttle = table(THROTTLES)
    rate = xp.where(throttle < 0.0, ratios.acceleration_min, ratios.acceleration_max) * xp.abs(throttle)
    speeds = xp.clip(speed + rate[:, None] * times, xp.minimum(ratios.speed_min, speed), xp.maximum(speed, 1.0))
    before = xp.concatenate([xp.broadcast_to(speed, speeds[:, :1].shape), speeds[:, :-1]], axis=1)
    bent = turns[:, None] * table(_BENT)[None]
    way = 0.5 * (speeds + before) * spans * (1.0 - bent * bent * (1.0 / 6.0))
    # The sines of fixed angles are data; only the goal's bearing needs them computed.
    sine, cosine = sincos(bearing[None] * table(_MIDDLE), xp)
    fixed = TURNS[:, None] * _MIDDLE
    wide = (len(TURNS), _PIECES, *speed.shape)
    ahead = xp.concatenate([xp.broadcast_to(table(np.cos(fixed)), wide), xp.stack([cosine] * 3)])
    aside = xp.concatenate([xp.broadcast_to(table(np.sin(fixed)), wide), xp.stack([sine] * 3)])
    step_x, step_y = way * ahead, way * aside
    return times, spans, step_x, step_y, xp.cumsum(step_x, axis=1), xp.cumsum(step_y, axis=1)


def kept(seen: Scene, xp: Any) -> Any:
    """Return the least separation from any intruder within :data:`HORIZON` of each manoeuvre, D, ``[22, ...]``.

    Args:
        seen: fields ``[...]`` and ``[..., K]`` with K >= 1.
    """
    # Relative to each intruder, [M, P, K, ...]: where a chord ends, and how it got there.
    times, spans, step_x, step_y, own_x, own_y = (field[:, :, None] for field in _together(paths(seen, xp), xp))
    start_x, start_y, vx, vy = (_first(field, xp) for field in (seen.x, seen.y, seen.vx, seen.vy))
    x, y = start_x + vx * times - own_x, start_y + vy * times - own_y
    step_x, step_y = vx * spans - step_x, vy * spans - step_y
    # How much of the chord lies behind its closest point.
    back = xp.clip((x * step_x + y * step_y) / (step_x * step_x + step_y * step_y + 1e-8), 0.0, 1.0)
    x, y = x - back * step_x, y - back * step_y
    return xp.sqrt(xp.min(x * x + y * y, axis=(1, 2)))


class KeptByOne:
    """:func:`kept` for one scene of plain floats after the other: what hangs on the limits alone is computed once."""

    def __init__(self, ratios: Ratios) -> None:
        """Prepare the manoeuvres of an aircraft; ratios are floats."""
        self._ratios = ratios
        fixed = TURNS[:, None] * _MIDDLE
        turning = np.minimum(np.abs(np.append(TURNS, [0.0] * 3)) * ratios.turn_radius, _LONGEST)[:, None]
        self._times = turning * _OF_TURN + (HORIZON - turning) * _OF_REST  # [22, P]
        self._ahead, self._aside = (np.append(of(fixed), np.zeros((3, _PIECES)), axis=0) for of in (np.cos, np.sin))
        bent = np.append(TURNS, [0.0] * 3)[:, None] * _BENT
        self._short = 0.5 * (1.0 - bent * bent * (1.0 / 6.0))
        rate = np.where(THROTTLES < 0.0, ratios.acceleration_min, ratios.acceleration_max) * np.abs(THROTTLES)
        self._rate = rate[:, None]

    def __call__(self, seen: Scene) -> np.ndarray:
        """Return the least separation of each manoeuvre, D, ``[22]``; without intruders far away."""
        speed, ratios = seen.own_speed, self._ratios
        bearing = math.atan2(seen.goal_y, seen.goal_x)
        turning = min(abs(bearing) * ratios.turn_radius, _LONGEST)
        times, ahead, aside, short = self._times.copy(), self._ahead.copy(), self._aside.copy(), self._short.copy()
        times[-3:] = turning * _OF_TURN + (HORIZON - turning) * _OF_REST
        middle, bent = bearing * _MIDDLE, bearing * _BENT
        ahead[-3:], aside[-3:], short[-3:] = np.cos(middle), np.sin(middle), 0.5 * (1.0 - bent * bent * (1.0 / 6.0))
        whole = np.empty((COUNT, _PIECES + 1))
        whole[:, 0] = 0.0
        whole[:, 1:] = times
        spans = whole[:, 1:] - whole[:, :-1]
        speeds = speed + self._rate * whole
        np.maximum(speeds, min(ratios.speed_min, speed), out=speeds)
        np.minimum(speeds, max(speed, 1.0), out=speeds)
        way = (speeds[:, 1:] + speeds[:, :-1]) * spans * short
        step_x, step_y = way * ahead, way * aside
        own_x, own_y = step_x.cumsum(axis=1), step_y.cumsum(axis=1)
        least = np.full(COUNT, 1e6)
        for x0, y0, vx, vy in zip(seen.x, seen.y, seen.vx, seen.vy, strict=True):
            x, y = (x0 + vx * times) - own_x, (y0 + vy * times) - own_y
            over_x, over_y = vx * spans - step_x, vy * spans - step_y
            back = (x * over_x + y * over_y) / (over_x * over_x + over_y * over_y + 1e-8)
            np.maximum(back, 0.0, out=back)
            np.minimum(back, 1.0, out=back)
            x -= back * over_x
            y -= back * over_y
            np.minimum(least, (x * x + y * y).min(axis=1), out=least)
        return np.sqrt(least)


def steering(seen: Scene, xp: Any) -> Any:
    """Return the turn of each manoeuvre at its beginning, 1 to the left at the greatest yaw rate, ``[..., 22]``.

    A turn to the goal that takes less than a tenth of a unit of time (a time step) is as gentle as that.
    """
    bearing = atan2(seen.goal_y, seen.goal_x, xp)
    home = xp.clip(bearing * seen.ratios.turn_radius * 10.0, -1.0, 1.0)
    fixed = xp.asarray(np.sign(TURNS).astype(bearing.dtype))
    parts = [xp.broadcast_to(fixed, (*bearing.shape, len(TURNS))), xp.stack([home] * 3, axis=-1)]
    return xp.concatenate(parts, axis=-1)


def _first(field: Any, xp: Any) -> Any:
    """Return the intruders' axis first; in numpy in memory too, so that inner loops run along many rows."""
    moved = xp.moveaxis(field, -1, 0)
    return np.ascontiguousarray(moved) if xp is np else moved


def _together(fields: tuple[Any, ...], xp: Any) -> tuple[Any, ...]:
    """Return fields that are computed once, before what follows is computed for every intruder."""
    if xp is np:
        return fields
    # Arrays of jax come with jax; where numpy flies it is not imported.
    return sys.modules["jax"].lax.optimization_barrier(fields)
