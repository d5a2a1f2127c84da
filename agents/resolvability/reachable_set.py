"""An outer bound of the states in which no intruder has been met yet: a proof where the gaps close
one by one.

The states are followed forward in time as sets, each an interval of headings, one of speeds and a
polygon of positions. In each segment of time every set branches into those of its histories that
end in one cell of heading and speed (cf. :func:`agents.resolvability.reachable_bound.narrow`); at
each test time what lies inside an intruder's disc is cut off
(:func:`agents.resolvability.outer_polygon.outside`); after the segment the polygons are cut along a
grid, and the sets of one cell are merged. If nothing is left, every history has violated the
separation.
"""

from typing import NamedTuple

import numpy as np

from agents.resolvability.outer_polygon import beside, corners, outside
from agents.resolvability.reachable_bound import DIRECTIONS, Funnel, speeds, towards
from envs.arrays import Array
from envs.kinematics import Limits
from envs.trees import column, take


class States(NamedTuple):
    """Sets of states at one time; fields ``[M]``, in the frame of the ownship's start."""

    turn_low: Array  # heading less the initial heading, not wrapped, rad
    turn_high: Array
    speed_low: Array  # m/s
    speed_high: Array
    supports: Array  # of the positions, [M, D], m


class Cells(NamedTuple):
    """How finely states are divided. It decides how strong a proof is, not whether it holds."""

    turn: float  # rad
    speed: float  # m/s
    place: float  # m
    tests: int  # test times in a segment
    most: int  # sets at one time, beyond which the proof is given up


def last_time(
    speed: float,
    discs: tuple[Array, Array, Array],
    goal: tuple[float, float, float],
    stride: float,
    cells: Cells,
    limits: Limits,
) -> float:
    """Return the time at which the last history has met an intruder, s; nan where that is not
    proven.

    Args:
        speed: initial, m/s.
        discs: x and y of the intruders at the test times, ``[K, T]``, and the radii to stay out of,
            ``[K]``, m.
        goal: x, y and the distance from it, m, within which a history counts as ended; it holds for
            one stride's flight as well, because it is asked at the test times alone.
        stride: between test times, s.
    """
    x, y, radius = discs
    short_of = np.cos(DIRECTIONS) * goal[0] + np.sin(DIRECTIONS) * goal[1] - goal[2]
    short_of = short_of - max(limits.speed_max, speed) * stride
    zero = np.zeros(1)
    states = States(zero, zero, zero + speed, zero + speed, np.zeros((1, DIRECTIONS.size)))
    for first in range(0, x.shape[1], cells.tests):
        tests = min(cells.tests, x.shape[1] - first)
        parent, ended = branches(states, tests * stride, cells, limits)
        if parent.size > cells.most:
            break
        before = take(states, parent)
        supports, row = before.supports, np.arange(parent.size)
        for test, grown in enumerate(moves(before, ended, tests, stride, limits)):
            supports = supports + grown[row]
            if not np.all(np.any(supports < short_of, axis=1)):
                return np.nan
            at = first + test
            supports, nonempty = _outside_all(supports, x[:, at], y[:, at], radius)
            supports, row = supports[nonempty], row[nonempty]
            if not row.size:
                return (first + test + 1) * stride
        states = merge(take(ended, row)._replace(supports=supports), cells)
        if _passes(states, x[:, first + tests :], y[:, first + tests :], radius, stride):
            break
    return np.nan


def _outside_all(supports: Array, x: Array, y: Array, radius: Array) -> tuple[Array, Array]:
    """Shrink polygons to what they have outside the discs of all intruders ``[K]``; return also
    whether anything is left, bool ``[M]``.
    """
    nonempty = np.ones(len(supports), dtype=bool)
    for place_x, place_y, far in zip(x, y, radius, strict=True):
        supports, left = outside(supports, place_x, place_y, far)
        nonempty &= left
    return supports, nonempty


def branches(states: States, seconds: float, cells: Cells, limits: Limits) -> tuple[Array, States]:
    """Return the cells of turn and speed ``[B]`` in which sets ``[M]`` can end: the set each comes
    from, and bounds.
    """
    slowest, fastest = speeds(states.speed_low, states.speed_high, seconds, limits)
    turned = limits.yaw_rate_max * seconds
    parent, turn_low, turn_high = _divide(
        states.turn_low - turned, states.turn_high + turned, cells.turn
    )
    again, speed_low, speed_high = _divide(slowest[parent], fastest[parent], cells.speed)
    ended = States(
        turn_low[again], turn_high[again], speed_low, speed_high, np.zeros((again.size, 0))
    )
    return parent[again], ended


def moves(before: States, ended: States, tests: int, stride: float, limits: Limits) -> Array:
    """Bound how far histories between two sets of bounds move in each stride (s) of a segment;
    yield ``[M, D]``, m.

    The integrand is that of :func:`agents.resolvability.reachable_bound.support`, by the trapezium
    over a whole stride. Between kinks it is s cos(b), with s and b linear in time, or greater than
    such functions by a change between them: its second derivative is no less than -(s w^2 + 2 a w),
    so that the trapezium misses at most that times stride^3 /
    12. A bound on the turn has one kink, from w to -w, in the segment: interpolated over its
    stride, it misses a triangle of w stride^2 / 4. A bound on the speed has kinks of 2 a in all,
    which miss a stride^2 / 4. All of them are added in the first stride, for both bounds: a
    direction may depend on the one and later on the other.
    """
    rate, strongest = limits.yaw_rate_max, max(limits.acceleration_max, -limits.acceleration_min)
    top_speed = max(limits.speed_max, float(np.max(before.speed_high)))
    bend = (top_speed * rate * rate + 2.0 * strongest * rate) * stride**3 / 12.0
    kinks = 0.5 * (top_speed * rate + strongest) * stride * stride

    def largest_speeds(time: float) -> Array:
        """Return the largest speed in each direction, ``[M, D]``."""
        remaining = tests * stride - time
        turn_low = np.maximum(before.turn_low - rate * time, ended.turn_low - rate * remaining)
        turn_high = np.minimum(before.turn_high + rate * time, ended.turn_high + rate * remaining)
        slowest, fastest = speeds(before.speed_low, before.speed_high, time, limits)
        fastest = np.minimum(fastest, ended.speed_high - limits.acceleration_min * remaining)
        slowest = np.maximum(slowest, ended.speed_low - limits.acceleration_max * remaining)
        return towards(column(Funnel(turn_low, turn_high, slowest, fastest)), DIRECTIONS)

    largest = largest_speeds(0.0)
    for test in range(tests):
        after = largest_speeds((test + 1) * stride)
        yield 0.5 * stride * (largest + after) + bend + (kinks if test == 0 else 0.0)
        largest = after


def merge(states: States, cells: Cells) -> States:
    """Cut polygons along a grid, and merge the sets of one cell of turn, speed and place."""
    quarter = DIRECTIONS.size // 4
    for ahead in (0, quarter):
        states = _cut_along_grid(states, ahead, cells.place)
    reach = states.supports
    middle = [0.5 * (reach[:, k] - reach[:, k + 2 * quarter]) / cells.place for k in (0, quarter)]
    turn = 0.5 * (states.turn_low + states.turn_high) / cells.turn
    speed = 0.5 * (states.speed_low + states.speed_high) / cells.speed
    key = np.floor(np.stack([turn, speed, *middle]))
    order = np.lexsort(key)
    key, states = key[:, order], take(states, order)
    first = np.flatnonzero(np.concatenate([[True], np.any(key[:, 1:] != key[:, :-1], axis=0)]))
    lowest, highest = np.minimum.reduceat, np.maximum.reduceat
    return States(
        lowest(states.turn_low, first),
        highest(states.turn_high, first),
        lowest(states.speed_low, first),
        highest(states.speed_high, first),
        highest(states.supports, first, axis=0),
    )


def _cut_along_grid(states: States, ahead: int, place: float) -> States:
    """Cut polygons at every multiple of ``place`` in one direction; overlaps of up to a millimetre
    stay.
    """
    behind = ahead + DIRECTIONS.size // 2
    pieces = []
    while True:
        lowest = -states.supports[:, behind]
        line = (np.floor((lowest + 1e-3) / place) + 1.0) * place
        crosses = line < states.supports[:, ahead] - 1e-3
        pieces.append(take(states, ~crosses))
        if not crosses.any():
            break
        states, line = take(states, crosses), line[crosses]
        pieces.append(states._replace(supports=beside(states.supports, ahead, line)))
        states = states._replace(supports=beside(states.supports, behind, -line))
    return States(*(np.concatenate(field) for field in zip(*pieces, strict=True)))


def _passes(states: States, x: Array, y: Array, radius: Array, stride: float) -> bool:
    """Return whether a straight flight stays clear of intruders ``[K, T]``: it would always be
    among the survivors.
    """
    # The mean of a polygon's corners lies in it.
    place_x, place_y = (np.mean(corner, axis=1) for corner in corners(states.supports))
    time = stride * np.arange(1, x.shape[1] + 1)
    for turn in (states.turn_low, states.turn_high):
        for speed in (states.speed_low, states.speed_high):
            clear = np.ones(turn.size, dtype=bool)
            for other_x, other_y, apart in zip(x, y, radius, strict=True):
                east = place_x[:, None] + np.outer(speed * np.cos(turn), time) - other_x
                north = place_y[:, None] + np.outer(speed * np.sin(turn), time) - other_y
                clear &= np.all(east * east + north * north > apart * apart, axis=1)
            if clear.any():
                return True
    return False


def _divide(low: Array, high: Array, width: float) -> tuple[Array, Array, Array]:
    """Cut intervals ``[M]`` at the multiples of a width; return the number of each piece's
    interval, and its ends.
    """
    first = np.floor(low / width)
    count = np.maximum(np.ceil(high / width) - first, 1.0).astype(int)
    of = np.repeat(np.arange(count.size), count)
    cell = first[of] + np.arange(of.size) - np.repeat(np.cumsum(count) - count, count)
    return of, np.maximum(low[of], cell * width), np.minimum(high[of], (cell + 1.0) * width)
