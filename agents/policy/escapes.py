"""How far the ownship stays from all intruders if it flies one of 22 simple manoeuvres from now on.

The ownship turns by one of ten angles at its greatest yaw rate and flies on straight, braking,
accelerating or at a steady speed; intruders fly straight on. A manoeuvre is a chain of ten chords
between points of its path, and the separation along a chord is that of its closest point: within
some hundredths of a separation of that of the path.
"""

import math
import sys
from functools import reduce
from typing import Any

import numpy as np

from agents.policy.scene import Scene
from envs.aircraft import Ratios
from envs.angles import atan2, sincos
from envs.backend import EXACT_FLOATS

HORIZON = 10.0
"""How far ahead is looked, D / ``speed_max`` (paper: 100 s)."""

_ANGLES = (25.0, 55.0, 90.0, 150.0)  # degrees, to either side
_FIXED = [
    *(
        (side * angle, throttle)
        for angle in _ANGLES
        for side in (1.0, -1.0)
        for throttle in (-1.0, 1.0)
    ),
    *((0.0, throttle) for throttle in (-1.0, 0.0, 1.0)),
]

TURNS = np.radians([turn for turn, _ in _FIXED])
"""Heading changes, rad, left positive, ``[19]``; after them come three turns to the goal."""

THROTTLES = np.array([*(throttle for _, throttle in _FIXED), -1.0, 0.0, 1.0])
"""Acceleration of each manoeuvre in limits, ``[22]``."""

COUNT = len(THROTTLES)

_CURVED = 5  # chords of the turn; the others are straight
_LATER = np.cumsum([1.0, 2.0, 3.0, 4.0, 5.0]) / 15.0
_SIGNS = np.sign([*TURNS, 0.0, 0.0, 0.0])
_PIECES = _CURVED + len(_LATER)
_OF_TURN = np.concatenate([np.arange(1, _CURVED + 1) / _CURVED, np.ones(len(_LATER))])  # [P]
_OF_REST = np.concatenate([np.zeros(_CURVED), _LATER])
_MIDDLE = np.concatenate([(np.arange(_CURVED) + 0.5) / _CURVED, np.ones(len(_LATER))])
_BENT = np.concatenate(
    [np.full(_CURVED, 0.5 / _CURVED), np.zeros(len(_LATER))]
)  # half a chord's angle, of the turn
_LONGEST = 0.9 * HORIZON


def paths(seen: Scene, xp: Any) -> tuple[Any, Any, Any, Any, Any, Any]:
    """Return where the ownship flies in each manoeuvre, six times ``[22, 10, ...]``.

    Of each chord's end the time and the place x, y; of the chord its span of time and its step x,
    y; in the order times, spans, step x, step y, x, y.
    """
    speed, ratios = seen.own_speed, seen.ratios
    dtype, axes = speed.dtype, (1,) * speed.ndim

    def table(values: Any) -> Any:
        return xp.asarray(np.asarray(values, dtype).reshape(np.shape(values) + axes))

    bearing = atan2(seen.goal_y, seen.goal_x, xp)
    turns = xp.concatenate(
        [xp.broadcast_to(table(TURNS), (len(TURNS), *speed.shape)), xp.stack([bearing] * 3)]
    )
    turning = xp.minimum(xp.abs(turns) * ratios.turn_radius, _LONGEST)  # [M, ...]
    times = (
        turning[:, None] * table(_OF_TURN)[None]
        + (HORIZON - turning)[:, None] * table(_OF_REST)[None]
    )
    spans = times - xp.concatenate(
        [xp.zeros_like(times[:, :1]), times[:, :-1]], axis=1
    )  # [M, P, ...]

    throttle = table(THROTTLES)
    rate = xp.where(throttle < 0.0, ratios.acceleration_min, ratios.acceleration_max) * xp.abs(
        throttle
    )
    speeds = xp.clip(
        speed + rate[:, None] * times, xp.minimum(ratios.speed_min, speed), xp.maximum(speed, 1.0)
    )
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
    """Return the least separation from any of K >= 1 intruders within :data:`HORIZON`, D, ``[22,
    ...]``.
    """
    path, intruders = paths(seen, xp), (seen.x, seen.y, seen.vx, seen.vy)
    if xp is np:
        # One intruder after the other stays in cache.
        each = np.ascontiguousarray(np.moveaxis(np.stack(intruders), -1, 0))  # [K, 4, ...]
        return np.sqrt(reduce(np.minimum, (_squares(one, path, np).min(axis=1) for one in each)))
    # Arrays of jax come with jax; where numpy flies it is not imported. The path is computed once,
    # before what follows is computed for every intruder.
    path = (field[:, :, None] for field in sys.modules["jax"].lax.optimization_barrier(path))
    return xp.sqrt(
        xp.min(_squares([xp.moveaxis(field, -1, 0) for field in intruders], path, xp), axis=(1, 2))
    )


def _squares(intruders: Any, path: Any, xp: Any) -> Any:
    """Return the square of the separation along each chord of :func:`paths` from intruders (x, y,
    vx, vy), D^2.
    """
    x0, y0, vx, vy = intruders
    times, spans, step_x, step_y, own_x, own_y = path
    x, y = x0 + vx * times - own_x, y0 + vy * times - own_y
    over_x, over_y = vx * spans - step_x, vy * spans - step_y
    # How much of the chord lies behind its closest point.
    back = (x * over_x + y * over_y) / (over_x * over_x + over_y * over_y + 1e-8)
    back = xp.minimum(xp.maximum(back, 0.0), 1.0)
    x, y = x - back * over_x, y - back * over_y
    return x * x + y * y


def _chords(turn: float, radius: float) -> tuple[np.ndarray, ...]:
    """Return the times of a turn's chords, their cosines and sines, and how they are shortened,
    ``[10]`` each.
    """
    turning = min(abs(turn) * radius, _LONGEST)
    middle, bent = turn * _MIDDLE, turn * _BENT
    times = turning * _OF_TURN + (HORIZON - turning) * _OF_REST
    return times, np.cos(middle), np.sin(middle), 0.5 * (1.0 - bent * bent * (1.0 / 6.0))


class KeptByOne:
    """:func:`kept` for one scene of plain floats after the other: what hangs on the limits alone is
    computed once.
    """

    def __init__(self, ratios: Ratios) -> None:
        """Prepare the manoeuvres of an aircraft; ratios are floats."""
        self._ratios = ratios
        # Of each manoeuvre, after a column for the start; the turns to the goal are not known yet.
        self._fixed = np.zeros((4, COUNT, _PIECES + 1))
        self._fixed[:, :-3, 1:] = np.stack(
            [_chords(turn, ratios.turn_radius) for turn in TURNS], axis=1
        )
        rate = np.where(THROTTLES < 0.0, ratios.acceleration_min, ratios.acceleration_max) * np.abs(
            THROTTLES
        )
        self._rate = rate[:, None]

    def __call__(self, seen: Scene) -> np.ndarray:
        """Return the least separation of each manoeuvre, D, ``[22]``; without intruders far
        away.
        """
        speed, ratios, known = seen.own_speed, self._ratios, self._fixed.copy()
        to_goal = _chords(math.atan2(seen.goal_y, seen.goal_x), ratios.turn_radius)
        known[0, -3:, 1:], known[1, -3:, 1:], known[2, -3:, 1:], known[3, -3:, 1:] = to_goal
        whole, courses, short = known[0], known[1:3, :, 1:], known[3, :, 1:]
        times, spans = whole[:, 1:], whole[:, 1:] - whole[:, :-1]
        speeds = speed + self._rate * whole
        np.maximum(speeds, min(ratios.speed_min, speed), out=speeds)
        np.minimum(speeds, max(speed, 1.0), out=speeds)
        # Both axes at once, [2, 22, 10] and for intruders [2, K, 22, 10]: half the calls, the same
        # bits.
        steps = (speeds[:, 1:] + speeds[:, :-1]) * spans * short * courses
        own, steps = steps.cumsum(axis=2)[:, None], steps[:, None]
        place, velocity = np.array(((seen.x, seen.y), (seen.vx, seen.vy)))[..., None, None]
        there, over = place + velocity * times - own, velocity * spans - steps
        (ahead, aside), (along, across) = there * over, over * over
        back = np.minimum(np.maximum((ahead + aside) / (along + across + 1e-8), 0.0), 1.0)
        there -= back * over
        there *= there
        return np.sqrt((there[0] + there[1]).min(axis=(0, 2), initial=1e6))


def steering(seen: Scene, xp: Any) -> Any:
    """Return the turn of each manoeuvre at its beginning, 1 to the left at the greatest yaw rate,
    ``[..., 22]``.
    """
    home = _home(seen, xp)
    fixed = xp.broadcast_to(xp.asarray(_SIGNS[:-3].astype(home.dtype)), (*home.shape, len(TURNS)))
    return xp.concatenate([fixed, xp.stack([home] * 3, axis=-1)], axis=-1)


def steering_of_one(seen: Scene) -> np.ndarray:
    """Return :func:`steering` of one scene of plain floats."""
    turns = _SIGNS.copy()
    turns[-3:] = _home(seen, EXACT_FLOATS)
    return turns


def _home(seen: Scene, xp: Any) -> Any:
    """Return the turn to the goal; one that takes less than a tenth of a unit of time (a time step)
    is as gentle.
    """
    return xp.clip(atan2(seen.goal_y, seen.goal_x, xp) * seen.ratios.turn_radius * 10.0, -1.0, 1.0)
