"""How close what is flown comes to what must be kept clear of: the one way to compute it.

Each constraint is a batch of one kind (:mod:`agents.kernel.separation`, :mod:`agents.kernel.areas`)
that bounds pieces of a trajectory from below. Legs are looked at first, the arcs of those that do
not decide next, and of those that still do not, :data:`~agents.kernel.trajectory.FINE` parts of an
arc. The bound alone decides; nothing here knows how a plan was made. The second implementation,
which shares nothing with this one, is :mod:`agents.check`.
"""

from typing import NamedTuple, Protocol

import numpy as np

from agents.kernel.trajectory import Pieces, Trajectory, cut, pieces, rest_of
from envs.arrays import Array
from envs.trees import first_of_each

CLOSE = 1e-3
"""How much of the margin may be missing, m: a start inside it must keep its own distance exactly,
and the bound of a part that begins there may be smaller by the part's sagitta."""

ROUNDING = 1e-6
"""How much of the separation itself may be missing, m."""

LONGEST = 16_384.0
"""Time of a plan's last waypoint at most, s: so far the rounding of positions is bounded
(proofs/Rounding.g).
"""


class Clearance(NamedTuple):
    """What trajectories keep of a constraint; fields ``[N, K]`` over its K intruders or areas."""

    # smallest distance less the required one, m; inf where nothing counts. Never too large, and
    # negative exactly where something is lost
    margin: Array
    margin_time: Array  # when that is, s; nan where only a bound is known
    loss: Array  # when the required distance is lost first, s; inf where it is kept
    until: Array  # from when on it is kept again, s; -inf where it is never lost
    leg: Array  # number of the leg on which it is lost first; -1
    x: Array  # where that is, m; nan
    y: Array
    # smallest distance, m, where the closest is asked for: that of the row's nearest is exact to
    # 5 mm on legs of 20 s; inf where none is below it
    distance: Array
    distance_time: Array  # when that is, s; nan

    @classmethod
    def blank(cls, rows: int, count: int) -> "Clearance":
        """Return that nothing counts, ``[rows, count]``."""
        inf, nan = np.full((2, rows, count), [[[np.inf]], [[np.nan]]])
        return cls(
            margin=inf,
            margin_time=nan,
            loss=inf.copy(),
            until=-inf,
            leg=np.full((rows, count), -1),
            x=nan.copy(),
            y=nan.copy(),
            distance=inf.copy(),
            distance_time=nan.copy(),
        )


class Near(NamedTuple):
    """Legs that must be judged piece by piece, each against an intruder or area; fields ``[M]``."""

    row: Array  # number of the trajectory
    leg: Array  # number of its leg
    which: Array  # number of the intruder or area


class Bounds(NamedTuple):
    """What pieces ``[M, P]`` keep, each row of one intruder or area."""

    bound: Array  # the distance is nowhere smaller, m
    required: Array  # m
    tolerated: Array  # what is required of parts, m: less by the tolerance
    attained: Array  # a distance that occurs, m; inf where it says nothing
    counts: Array  # whether it counts then, bool


class Constraint(Protocol):
    """What must be kept clear of: K intruders or areas for each of N trajectories."""

    @property
    def size(self) -> int:
        """How many, K."""
        ...

    @property
    def cuts_once(self) -> bool:
        """Whether arcs that surely lose the required distance are cut only to tell when it is lost
        first.
        """
        ...

    def near(self, flown: Trajectory, level: Array, found: Clearance, *, closest: bool) -> Near:
        """Return the legs that must be judged, and note bounds of the margins of all others."""
        ...

    def bounds(self, given: Pieces, which: Array) -> Bounds:
        """Return what pieces keep of the one numbered ``which``, ``[M]``."""
        ...


def clearance(
    flown: Trajectory, constraint: Constraint, level: Array = 0.0, *, closest: bool = False
) -> Clearance:
    """Return what trajectories keep from time 0 on.

    Args:
        flown: the trajectories.
        constraint: what must be kept clear of.
        level: margins above it are bounded coarsely, m, one for all or ``[N, K]``.
        closest: whether the smallest distance of each trajectory is to be exact, however far.
    """
    rows = len(flown.states.time)
    found = Clearance.blank(rows, constraint.size)
    if found.margin.size == 0:
        return found
    near = constraint.near(flown, level, found, closest=closest)
    if near.row.size == 0:
        return found
    arcs, pair = rest_of(pieces(flown, near.row, near.leg)), (near.row, near.which)
    bounds = constraint.bounds(arcs, near.which)
    margin = bounds.bound - bounds.required
    unclear = bounds.counts & ~(margin >= np.broadcast_to(level, found.margin.shape)[pair][:, None])
    if closest:
        nearest = np.full(rows, np.inf)
        np.minimum.at(nearest, near.row, bounds.attained.min(axis=1))
        unclear |= bounds.counts & (bounds.bound <= nearest[near.row, None])
    if constraint.cuts_once:
        unclear &= ~_lost_later(near, constraint.size, arcs, bounds)
    decided = bounds.counts & ~unclear
    margin, distance = (np.where(decided, field, np.inf) for field in (margin, bounds.bound))
    _note(found, arcs, near.which, margin, distance)
    m, p = np.nonzero(unclear)
    if m.size:
        parts, which = cut(arcs, m, p), near.which[m]
        bounds = constraint.bounds(parts, which)
        both = bounds.bound - bounds.tolerated, bounds.bound
        margin, distance = (np.where(bounds.counts, field, np.inf) for field in both)
        _note(found, parts, which, margin, distance)
    return found


def _lost_later(near: Near, count: int, arcs: Pieces, bounds: Bounds) -> Array:
    """Return which arcs surely lose the required distance, but for the first of each row and
    intruder or area, bool ``[M, P]``.
    """
    lost = bounds.counts & ~(bounds.attained >= bounds.tolerated)
    m, p = np.nonzero(lost)
    owner = near.row[m] * count + near.which[m]
    _, first = first_of_each(owner, arcs.begin[m, p])
    lost[m[first], p[first]] = False
    return lost


def _note(found: Clearance, given: Pieces, which: Array, margin: Array, distance: Array) -> None:
    """Note what pieces ``[M, P]`` keep: the smallest margin and distance, m, and the first and the
    last loss, of each row and intruder or area; both are inf where nothing counts.
    """
    owner = given.row * found.margin.shape[1] + which
    flat = Clearance(*(field.reshape(-1) for field in found))  # views: its arrays are contiguous
    _note_least(flat.margin, flat.margin_time, owner, margin, given.begin)
    _note_least(flat.distance, flat.distance_time, owner, distance, given.begin)

    lost = ~(margin >= 0.0)
    m = np.flatnonzero(lost.any(axis=1))
    if m.size == 0:
        return
    p = np.argmax(lost[m], axis=1)
    row, first = first_of_each(owner[m], given.begin[m, p])
    m_first, p_first = m[first], p[first]
    earlier = given.begin[m_first, p_first] < flat.loss[row]
    row, m_first, p_first = row[earlier], m_first[earlier], p_first[earlier]
    flat.loss[row], flat.leg[row] = given.begin[m_first, p_first], given.leg[m_first]
    flat.x[row], flat.y[row] = given.x0[m_first, p_first], given.y0[m_first, p_first]
    ends = np.where(lost[m], given.end[m], -np.inf).max(axis=1)
    np.maximum.at(flat.until, owner[m], ends)


def _note_least(least: Array, when: Array, owner: Array, values: Array, begin: Array) -> None:
    """Note the least values of pieces ``[M, P]`` of some owners, and when they first are."""
    part = np.argmin(values, axis=1)[:, None]
    value, time = (np.take_along_axis(field, part, 1)[:, 0] for field in (values, begin))
    row, best = first_of_each(owner, time, value)
    less = value[best] < least[row]
    row, best = row[less], best[less]
    least[row], when[row] = value[best], time[best]
