"""What holds between the manoeuvres that bands look at: proven free, or not.

Manoeuvres that lead to neighbouring targets part by no more than the difference of their targets
allows. So the one in the middle of an interval, with that added to what it must keep, proves the
interval; where it does not, the interval is cut in parts, down to a 64th of the first.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from envs.arrays import Array, Bool, Float

Judge = Callable[[Array, Array, Array], tuple[Array, Array]]
"""Judges intervals ``[R, C]`` of some rows, numbers ``[R]``, from their lowest to their highest
changes: whether each is proven free, and when something in it may be lost first, s.
"""

_CUTS, _ROUNDS = 8, 2  # of an interval that is not proven
_SAME = 1e-9  # rad or m/s


class Between(NamedTuple):
    """What is proven about the targets; fields ``[N, B]``."""

    low: Array  # from which change on to its own the manoeuvres are free
    high: Array  # to which
    # when one half-way to the neighbouring targets at most may be lost, s; inf: none is
    nearby: Array


class _Intervals(NamedTuple):
    """Intervals of changes; fields ``[M]``, rows in ascending order."""

    row: Array
    gap: Array  # number of the gap between two targets that they lie in
    low: Array
    high: Array

    def pick(self, numbers: Array) -> "_Intervals":
        """Return some of them."""
        return _Intervals(*(field[numbers] for field in self))

    def cut(self) -> "_Intervals":
        """Return their parts."""
        share = np.arange(_CUTS + 1) / _CUTS
        edges = self.low[:, None] + (self.high - self.low)[:, None] * share
        edges[:, -1] = self.high
        row, gap = np.repeat(self.row, _CUTS), np.repeat(self.gap, _CUTS)
        return _Intervals(row, gap, edges[:, :-1].ravel(), edges[:, 1:].ravel())


def prove_between(
    change: Float[Array, "N B"], closed: Bool[Array, "N B"], judge: Judge, *, circle: bool
) -> Between:
    """Return what is proven about targets that are reached by changes ``[N, B]``, of which some are
    closed.

    On a ``circle`` changes go from -pi to pi, which are two manoeuvres to one heading.
    """
    count, targets = change.shape
    order = np.argsort(change, axis=1, kind="stable")
    sorted_change = np.take_along_axis(change, order, axis=1)
    shut = np.take_along_axis(closed, order, axis=1)
    first, last = sorted_change[:, :1], sorted_change[:, -1:]
    ends = (np.full_like(first, -np.pi), np.full_like(last, np.pi)) if circle else (first, last)
    edges = np.concatenate([ends[0], sorted_change, ends[1]], axis=1)
    # Between two closed targets nothing is looked for.
    before, after = np.roll(shut, 1, axis=1), shut
    look = ~np.concatenate([before & after, (after & np.roll(after, -1, axis=1))[:, -1:]], axis=1)
    row, gap = np.nonzero(look & (np.diff(edges, axis=1) > 0.0))
    unproven, loss = _unproven(_Intervals(row, gap, edges[row, gap], edges[row, gap + 1]), judge)

    # From the left edge of a gap on to the first interval that is not proven, and from the last one
    # on to its right edge.
    until = np.where(look, edges[:, 1:], edges[:, :-1])
    since = np.where(look, edges[:, :-1], edges[:, 1:])
    np.minimum.at(until, unproven[:2], unproven.low)
    np.maximum.at(since, unproven[:2], unproven.high)
    low = np.where(shut, sorted_change, np.minimum(since[:, :-1], sorted_change))
    high = np.where(shut, sorted_change, np.maximum(until[:, 1:], sorted_change))

    nearby = np.full((count, targets), np.inf)
    whole = 2.0 * np.pi if circle else 0.0
    left = np.concatenate([last - whole, sorted_change], axis=1)[unproven[:2]]
    right = np.concatenate([sorted_change, first + whole], axis=1)[unproven[:2]]
    middle = 0.5 * (left + right)
    for touches, number in (
        (unproven.low < middle, (unproven.gap - 1) % targets),
        (unproven.high > middle, unproven.gap % targets),
    ):
        np.minimum.at(nearby, (unproven.row[touches], number[touches]), loss[touches])
    place = np.argsort(order, axis=1, kind="stable")
    return Between(*(np.take_along_axis(field, place, axis=1) for field in (low, high, nearby)))


def _unproven(intervals: _Intervals, judge: Judge) -> tuple[_Intervals, Array]:
    """Return the least parts of intervals that are not proven to be free, and when something in
    each may be lost first, s.
    """
    for _ in range(_ROUNDS):
        intervals = intervals.pick(~_judge(intervals, judge)[0]).cut()
    proven, loss = _judge(intervals, judge)
    return intervals.pick(~proven), loss[~proven]


def _judge(intervals: _Intervals, judge: Judge) -> tuple[Array, Array]:
    """Judge intervals ``[M]``, those of one row beside one another."""
    rows, start, size = np.unique(intervals.row, return_index=True, return_counts=True)
    if rows.size == 0:
        return np.zeros(0, dtype=bool), np.zeros(0)
    place = np.arange(intervals.row.size) - np.repeat(start, size)
    where = np.repeat(np.arange(rows.size), size), place
    low, high = np.zeros((2, rows.size, int(size.max())))
    low[where], high[where] = intervals.low, intervals.high
    proven, loss = judge(rows, low, high)
    return proven[where], loss[where]


def free_runs(
    low: Float[Array, " B"], high: Float[Array, " B"], whole: float | None
) -> list[tuple[float, float]]:
    """Return from where to where targets ``[B]`` in ascending order, each with what is proven about
    it, are free without a break.

    Args:
        low: from where what is proven about each begins, at its target at most.
        high: where it ends.
        whole: of the circle that they lie on; None: on a line. A run round all of it is one whole.
    """
    count = len(low)
    joined = high[:-1] >= low[1:] - _SAME
    once = 0.0 if whole is None else whole
    around = whole is not None and bool(high[-1] >= low[0] + once - _SAME)
    if around and joined.all():
        return [(float(low[0]), float(low[0]) + once)]
    # On a circle a run may go over the end.
    begin = int(np.flatnonzero(~joined)[0]) + 1 if around else 0
    runs = list[tuple[float, float]]()
    for number in range(begin, begin + count):
        index, turn = number % count, (number // count) * once
        goes_on = number > begin and (joined[index - 1] if index else around)
        since = runs.pop()[0] if goes_on else float(low[index]) + turn
        runs.append((since, float(high[index]) + turn))
    return [(since, until) for since, until in runs if until - since > _SAME]
