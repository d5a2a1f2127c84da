"""How far the ownship stays from all intruders if it flies one of 22 simple manoeuvres from now on.

The ownship turns by one of ten angles at its greatest yaw rate and flies on straight, braking,
accelerating or at a steady speed; intruders fly straight on. A manoeuvre is a chain of ten chords
between points of its path, and the separation along a chord is that of its closest point: within
some hundredths of a separation of that of the path.

:class:`ScalarMinSeparation` is :func:`min_separation` for one scene: numpy's calls, or where it is
compiled the loops of :func:`scalar_min_separations`. Tests hold the three together.
"""

import math
import sys
from functools import reduce
from types import ModuleType
from typing import NamedTuple

import numpy as np

from agents.policy.scene import Scene
from envs.aircraft import Ratios
from envs.angles import atan2, sincos
from envs.arrays import Array, ArrayModule
from envs.backend import EXACT_FLOATS
from envs.compiled import scalar
from envs.trees import map_leaves

HORIZON = 10.0
"""How far ahead is looked, D / ``speed_max`` (paper: 100 s)."""

_ANGLES = (25.0, 55.0, 90.0, 150.0)  # degrees, to either side
_TO_GOAL = 3  # manoeuvres that turn to the goal: braking, steady, accelerating
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

_SIGNS = np.sign(TURNS)
_SIGNS_OF_ALL = np.append(_SIGNS, np.zeros(_TO_GOAL))

# The chords: five of the turn, then five of the straight rest, each longer than the one before.
_CURVED = 5
_LATER = np.cumsum([1.0, 2.0, 3.0, 4.0, 5.0]) / 15.0
_PIECES = _CURVED + len(_LATER)

# Of each chord, [10]: the end, in shares of the turn and of the rest; the middle, in shares of the
# turn; half the angle over which it is bent, in shares of the turn.
_STRAIGHT = np.zeros(len(_LATER))
_OF_TURN = np.concatenate([(np.arange(_CURVED) + 1.0) / _CURVED, np.ones(len(_LATER))])
_OF_REMAINDER = np.concatenate([np.zeros(_CURVED), _LATER])
_MIDDLE = np.concatenate([(np.arange(_CURVED) + 0.5) / _CURVED, np.ones(len(_LATER))])
_HALF_ANGLE = np.concatenate([np.full(_CURVED, 0.5 / _CURVED), _STRAIGHT])
_LONGEST = 0.9 * HORIZON


class Paths(NamedTuple):
    """Where the ownship flies in each manoeuvre; fields ``[22, 10, ...]``, a chord each."""

    times: Array  # at the chord's end
    spans: Array  # of time
    step_x: Array
    step_y: Array
    x: Array  # at the chord's end
    y: Array


class _Intruders(NamedTuple):
    """Intruders that fly straight on, in units of the scene; fields ``[..., K]``, or of one
    ``[...]``.
    """

    x: Array
    y: Array
    vx: Array
    vy: Array
    weight: Array | None = None  # square of the distance scale; None: 1 of all


def paths(scene: Scene, xp: ArrayModule) -> Paths:
    """Return the paths of all manoeuvres from a scene ``[...]``, in units of the scene."""
    speed, ratios = scene.own_speed, scene.ratios
    dtype, axes = speed.dtype, (1,) * speed.ndim

    def table(values: Array) -> Array:
        return xp.asarray(np.asarray(values, dtype).reshape(np.shape(values) + axes))

    bearing = atan2(scene.goal_y, scene.goal_x, xp)
    fixed_turns = xp.broadcast_to(table(TURNS), (len(TURNS), *speed.shape))
    turns = xp.concatenate([fixed_turns, xp.stack([bearing] * _TO_GOAL)])

    turning = xp.minimum(xp.abs(turns) * ratios.turn_radius, _LONGEST)  # [M, ...]
    of_turn, of_remainder = table(_OF_TURN)[None], table(_OF_REMAINDER)[None]
    times = turning[:, None] * of_turn + (HORIZON - turning)[:, None] * of_remainder
    started = xp.concatenate([xp.zeros_like(times[:, :1]), times[:, :-1]], axis=1)
    spans = times - started  # [M, P, ...]

    throttle = table(THROTTLES)
    limit = xp.where(throttle < 0.0, ratios.acceleration_min, ratios.acceleration_max)
    acceleration = limit * xp.abs(throttle)
    slowest, fastest = xp.minimum(ratios.speed_min, speed), xp.maximum(speed, 1.0)
    speeds = xp.clip(speed + acceleration[:, None] * times, slowest, fastest)
    before = xp.concatenate([xp.broadcast_to(speed, speeds[:, :1].shape), speeds[:, :-1]], axis=1)

    # A chord is shorter than its arc by a sixth of the square of half the angle.
    half_angle = turns[:, None] * table(_HALF_ANGLE)[None]
    lengths = 0.5 * (speeds + before) * spans * (1.0 - half_angle * half_angle * (1.0 / 6.0))

    # The sines of fixed angles are data; only the goal's bearing needs them computed.
    sine, cosine = sincos(bearing[None] * table(_MIDDLE), xp)
    fixed = TURNS[:, None] * _MIDDLE
    wide = (len(TURNS), _PIECES, *speed.shape)
    fixed_cosine = xp.broadcast_to(table(np.cos(fixed)), wide)
    fixed_sine = xp.broadcast_to(table(np.sin(fixed)), wide)
    step_x = lengths * xp.concatenate([fixed_cosine, xp.stack([cosine] * _TO_GOAL)])
    step_y = lengths * xp.concatenate([fixed_sine, xp.stack([sine] * _TO_GOAL)])
    return Paths(times, spans, step_x, step_y, xp.cumsum(step_x, axis=1), xp.cumsum(step_y, axis=1))


def min_separation(scene: Scene, xp: ArrayModule) -> Array:
    """Return the least separation from any of K >= 1 intruders within :data:`HORIZON`, ``[22,
    ...]``, in D, or in the separation of an intruder that has one of its own.
    """
    path = paths(scene, xp)
    weight = None if scene.distance_scale is None else scene.distance_scale * scene.distance_scale
    intruders = _Intruders(scene.x, scene.y, scene.vx, scene.vy, weight)
    if xp is np:
        # One intruder after the other stays in cache.
        fields = [field for field in intruders if field is not None]
        rows = np.ascontiguousarray(np.moveaxis(np.stack(fields), -1, 0))  # [K, 4 or 5, ...]
        nearest = (_squares(_Intruders(*row), path, np).min(axis=1) for row in rows)
        return np.sqrt(reduce(np.minimum, nearest))
    # Arrays of jax come with jax, which is loaded then; where numpy flies it is not imported.
    return xp.sqrt(_least_squares(path, intruders, xp, sys.modules["jax"].lax))


def _least_squares(path: Paths, intruders: _Intruders, xp: ArrayModule, lax: ModuleType) -> Array:
    """Return the square of the least separation, ``[22, ...]``, compiled: one chord after the
    other, so that a running minimum is all that is kept of the separations from K intruders.
    """
    # Without the barrier the compiler would compute the path again for every intruder.
    path, intruders = lax.optimization_barrier((path, intruders))
    count = intruders.x.shape[-1]
    if not isinstance(count, int):  # exported for any number of intruders: all of them at once
        wide = Paths(*(field[..., None] for field in path))
        return xp.min(_squares(intruders, wide, xp), axis=(1, -1))

    def nearer(chord: Array, nearest: Array) -> Array:
        path_at = Paths(
            *(lax.dynamic_index_in_dim(field, chord, axis=1, keepdims=False) for field in path)
        )
        for number in range(count):
            row = map_leaves(lambda field, number=number: field[..., number], intruders)
            nearest = xp.minimum(nearest, _squares(row, path_at, xp))
        return nearest

    farthest = xp.full_like(path.x[:, 0], xp.inf)
    return lax.fori_loop(0, _PIECES, nearer, farthest)


def _squares(intruders: _Intruders, path: Paths, xp: ArrayModule) -> Array:
    """Return the square of the separation from intruders along each chord of a path."""
    vx, vy = intruders.vx, intruders.vy
    x, y = intruders.x + vx * path.times - path.x, intruders.y + vy * path.times - path.y
    over_x, over_y = vx * path.spans - path.step_x, vy * path.spans - path.step_y
    # How much of the chord lies behind its closest point.
    share = (x * over_x + y * over_y) / (over_x * over_x + over_y * over_y + 1e-8)
    share = xp.minimum(xp.maximum(share, 0.0), 1.0)
    x, y = x - share * over_x, y - share * over_y
    square = x * x + y * y
    return square if intruders.weight is None else square * intruders.weight


class _Chords(NamedTuple):
    """The chords of one turn, fields ``[10]``."""

    times: Array  # at the end
    cosine: Array  # of the course
    sine: Array
    shortening: Array  # length over the sum of the speeds at both ends, times the span


@scalar
def _chords(turn: float, radius: float) -> _Chords:
    """Return the chords of a turn (rad, left positive) on a circle of a radius (D)."""
    turning = min(abs(turn) * radius, _LONGEST)
    middle, half_angle = turn * _MIDDLE, turn * _HALF_ANGLE
    times = turning * _OF_TURN + (HORIZON - turning) * _OF_REMAINDER
    shortening = 0.5 * (1.0 - half_angle * half_angle * (1.0 / 6.0))
    return _Chords(times, np.cos(middle), np.sin(middle), shortening)


class ScalarMinSeparation:
    """:func:`min_separation` for one scene of plain floats after the other: what follows from the
    limits alone is computed once.
    """

    def __init__(self, ratios: Ratios) -> None:
        """Prepare the manoeuvres of an aircraft; ratios are floats."""
        self._ratios = ratios
        # Of each manoeuvre, after a column for the start; the turns to the goal are not known yet.
        self.fixed = np.zeros((4, COUNT, _PIECES + 1))
        fixed = [_chords(turn, ratios.turn_radius) for turn in TURNS]
        self.fixed[:, :-_TO_GOAL, 1:] = np.stack(fixed, axis=1)
        limit = np.where(THROTTLES < 0.0, ratios.acceleration_min, ratios.acceleration_max)
        self.acceleration = limit * np.abs(THROTTLES)

    def __call__(self, scene: Scene) -> np.ndarray:
        """Return the least separation of each manoeuvre, D, ``[22]``; without intruders far
        away.
        """
        speed, ratios, chords = scene.own_speed, self._ratios, self.fixed.copy()
        to_goal = _chords(math.atan2(scene.goal_y, scene.goal_x), ratios.turn_radius)
        chords[:, -_TO_GOAL:, 1:] = np.array(to_goal)[:, None]
        ends, courses, shortening = chords[0], chords[1:3, :, 1:], chords[3, :, 1:]
        times, spans = ends[:, 1:], ends[:, 1:] - ends[:, :-1]
        speeds = speed + self.acceleration[:, None] * ends
        np.maximum(speeds, min(ratios.speed_min, speed), out=speeds)
        np.minimum(speeds, max(speed, 1.0), out=speeds)
        # Both axes at once, [2, 22, 10] and for intruders [2, K, 22, 10]: half the calls, the same
        # bits.
        steps = (speeds[:, 1:] + speeds[:, :-1]) * spans * shortening * courses
        own, steps = steps.cumsum(axis=2)[:, None], steps[:, None]
        place, velocity = np.array(((scene.x, scene.y), (scene.vx, scene.vy)))[..., None, None]
        relative, over = place + velocity * times - own, velocity * spans - steps
        (ahead, aside), (along, across) = relative * over, over * over
        along += across
        along += 1e-8
        share = ahead + aside
        share /= along
        np.maximum(share, 0.0, out=share)
        np.minimum(share, 1.0, out=share)
        relative -= share * over
        relative *= relative
        square = relative[0] + relative[1]
        if scene.distance_scale is not None:
            square *= np.square(scene.distance_scale)[:, None, None]
        return np.sqrt(np.minimum.reduce(square, axis=(0, 2), initial=1e6))


@scalar
def scalar_min_separations(
    scene: Scene, distance_scale: np.ndarray, fixed: np.ndarray, acceleration: np.ndarray
) -> np.ndarray:
    """Return what :class:`ScalarMinSeparation` does, in loops to be compiled.

    Args:
        scene: of plain floats, the intruders' fields arrays.
        distance_scale: of each intruder, ``[K]``.
        fixed: chords of the manoeuvres of an aircraft, and
        acceleration: theirs; attributes of that class.
    """
    speed, slowest, fastest = (
        scene.own_speed,
        min(scene.ratios.speed_min, scene.own_speed),
        max(scene.own_speed, 1.0),
    )
    to_goal = _chords(math.atan2(scene.goal_y, scene.goal_x), scene.ratios.turn_radius)
    # At the ends of all chords, one manoeuvre after the other, [22 * 10].
    time, span, x, y, step_x, step_y, nearest = np.empty((7, COUNT * _PIECES))
    for m in range(COUNT):
        own_x, own_y, begin, before = 0.0, 0.0, 0.0, min(max(speed, slowest), fastest)
        for p in range(_PIECES):
            if m < COUNT - _TO_GOAL:
                end, cosine, sine, shortening = (
                    fixed[0, m, p + 1],
                    fixed[1, m, p + 1],
                    fixed[2, m, p + 1],
                    fixed[3, m, p + 1],
                )
            else:
                end, cosine, sine, shortening = (
                    to_goal.times[p],
                    to_goal.cosine[p],
                    to_goal.sine[p],
                    to_goal.shortening[p],
                )
            after = min(max(speed + acceleration[m] * end, slowest), fastest)
            length = (after + before) * (end - begin) * shortening
            i = m * _PIECES + p
            time[i], span[i], step_x[i], step_y[i] = (
                end,
                end - begin,
                length * cosine,
                length * sine,
            )
            own_x += step_x[i]
            own_y += step_y[i]
            x[i], y[i], begin, before, nearest[i] = own_x, own_y, end, after, 1e6
    for k in range(len(scene.x)):
        vx, vy, weight = scene.vx[k], scene.vy[k], distance_scale[k] * distance_scale[k]
        for i in range(COUNT * _PIECES):
            there_x, there_y = scene.x[k] + vx * time[i] - x[i], scene.y[k] + vy * time[i] - y[i]
            over_x, over_y = vx * span[i] - step_x[i], vy * span[i] - step_y[i]
            along = over_x * over_x + over_y * over_y + 1e-8
            back = min(max((there_x * over_x + there_y * over_y) / along, 0.0), 1.0)
            there_x -= back * over_x
            there_y -= back * over_y
            nearest[i] = min(nearest[i], (there_x * there_x + there_y * there_y) * weight)
    return np.sqrt(_least_of_rows(nearest))


@scalar
def _least_of_rows(values: np.ndarray) -> np.ndarray:
    """Return the smallest of each ten values, ``[22]``."""
    least = np.empty(COUNT)
    for m in range(COUNT):
        least[m] = values[m * _PIECES]
        for p in range(1, _PIECES):
            least[m] = min(least[m], values[m * _PIECES + p])
    return least


def steering(scene: Scene, xp: ArrayModule) -> Array:
    """Return the turn of each manoeuvre at its beginning, 1 to the left at the greatest yaw rate,
    ``[..., 22]``.
    """
    to_goal = _turn_to_goal(scene, xp)
    fixed = xp.broadcast_to(xp.asarray(_SIGNS.astype(to_goal.dtype)), (*to_goal.shape, len(_SIGNS)))
    return xp.concatenate([fixed, xp.stack([to_goal] * _TO_GOAL, axis=-1)], axis=-1)


@scalar
def scalar_turns(scene: Scene) -> np.ndarray:
    """Return :func:`steering` of one scene of plain floats."""
    turns = _SIGNS_OF_ALL.copy()
    turns[-_TO_GOAL:] = _turn_to_goal(scene, EXACT_FLOATS)
    return turns


@scalar
def _turn_to_goal(scene: Scene, xp: ArrayModule) -> Array:
    """Return the turn to the goal; one that takes less than a tenth of a unit of time (a time step)
    is as gentle.
    """
    return xp.clip(
        atan2(scene.goal_y, scene.goal_x, xp) * scene.ratios.turn_radius * 10.0, -1.0, 1.0
    )
