"""How close what is flown comes to what must be kept clear of: the one way to compute it.

Each constraint is a batch of one kind (:mod:`agents.kernel.separation`, :mod:`agents.kernel.areas`)
that bounds pieces of a trajectory from below. Legs are looked at first, the arcs of those that do
not decide next, and of those that still do not, :data:`~agents.kernel.trajectory.FINE` parts of an
arc. The bound alone decides; nothing here knows how a plan was made. The second implementation,
which shares nothing with this one, is :mod:`agents.check`.
"""

from typing import Any, NamedTuple, Protocol

import numpy as np

from agents.kernel.trajectory import (
    STRAIGHT,
    Pieces,
    Trajectory,
    cut,
    pieces,
    rest_of,
    whole_legs,
)
from envs.arrays import Array, Float, Int
from envs.trees import first_rows, take

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
        inf, nan = np.full((rows, count), np.inf), np.full((rows, count), np.nan)
        return cls(
            margin=inf,
            loss=inf.copy(),
            until=-inf,
            leg=np.full((rows, count), -1),
            x=nan,
            y=nan.copy(),
            distance=inf.copy(),
            distance_time=nan.copy(),
        )


class Near(NamedTuple):
    """Legs that must be judged piece by piece, each against an intruder or area; fields ``[M]``."""

    row: Array  # number of the trajectory
    leg: Array  # number of its leg
    number: Array  # of the intruder or area


class Bounds(NamedTuple):
    """What pieces keep, each row of one intruder or area; fields ``[M, P]``."""

    distance: Array  # a lower bound, m
    nearest: Array  # when it is the smallest, s; the beginning where that is not known better
    margin: Array  # a lower bound of the distance less the required one, m
    tolerant: Array  # the same of what is left of the required one by the tolerance
    attained: Array  # a distance that occurs, m; inf where it says nothing
    counts: Array  # whether it counts then, bool
    exact: Array  # whether parts would tell no more, bool
    surely_lost: Array  # whether an end has less than what is tolerated, bool
    lost_from: Array  # where less than what is tolerated is left: from when on, s
    lost_until: Array  # until when, s


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

    def fill(
        self,
        flown: Trajectory[Any],
        levels: Float[Array, "N K"],
        clearances: Clearance,
        *,
        closest: bool,
    ) -> bool:
        """Fill in what is kept by compiled code; return whether there is any that is ready.

        It gives what all other methods give together; levels of interest are in m, ``[N, K]``.
        """
        ...

    def near(
        self,
        flown: Trajectory[Any],
        levels: Float[Array, "N K"],
        clearances: Clearance,
        *,
        closest: bool,
    ) -> Near:
        """Return the legs that must be judged, and note bounds of the margins of all others, which
        are above the levels of interest, m, ``[N, K]``.
        """
        ...

    def bounds(self, pieces: Pieces, number: Int[Array, " M"]) -> Bounds:
        """Return what pieces keep of the ones of their numbers ``[M]``."""
        ...


def clearance(
    flown: Trajectory[Any],
    constraint: Constraint,
    level: Float[Array, "#N #K"] = 0.0,
    *,
    closest: bool = False,
) -> Clearance:
    """Return what trajectories keep from time 0 on.

    Args:
        flown: the trajectories.
        constraint: what must be kept clear of.
        level: margins above it are bounded coarsely, m, one for all or ``[N, K]``.
        closest: whether the smallest distance of each trajectory is to be exact, however far.
    """
    rows = len(flown.states.time)
    clearances = Clearance.blank(rows, constraint.size)
    if clearances.margin.size == 0:
        return clearances
    levels = np.broadcast_to(level, clearances.margin.shape)
    if constraint.fill(flown, levels, clearances, closest=closest):
        return clearances
    near = constraint.near(flown, levels, clearances, closest=closest)
    near = _judge_straight_legs(clearances, flown, constraint, near, levels, closest=closest)
    if near.row.size == 0:
        return clearances
    arcs = rest_of(pieces(flown, near.row, near.leg))
    bounds = constraint.bounds(arcs, near.number)
    unclear = bounds.counts & ~(bounds.margin >= levels[near.row, near.number][:, None])
    if closest:
        nearest = clearances.distance.min(axis=1)
        np.minimum.at(nearest, near.row, bounds.attained.min(axis=1))
        unclear |= bounds.counts & (bounds.distance <= nearest[near.row, None])
    unclear &= ~bounds.exact
    if constraint.cuts_once:
        unclear &= ~_lost_later(near, constraint.size, arcs, bounds)
    margin = np.where(bounds.exact, bounds.tolerant, bounds.margin)
    _note(clearances, arcs, near.number, margin, bounds._replace(counts=bounds.counts & ~unclear))
    m, p = np.nonzero(unclear)
    if m.size:
        parts, number = cut(arcs, m, p), near.number[m]
        bounds = constraint.bounds(parts, number)
        _note(clearances, parts, number, bounds.tolerant, bounds)
    return clearances


def _judge_straight_legs(
    clearances: Clearance,
    flown: Trajectory[Any],
    constraint: Constraint,
    near: Near,
    levels: Array,
    *,
    closest: bool,
) -> Near:
    """Note what legs of uniform motion keep where that decides; return the legs that are left."""
    straight = np.flatnonzero(flown.sagitta[near.row, near.leg] <= STRAIGHT)
    if straight.size == 0:
        return near
    legs = take(near, straight)
    whole = rest_of(whole_legs(flown, legs.row, legs.leg))
    bounds = constraint.bounds(whole, legs.number)
    decided = bounds.exact
    if not closest:
        decided = decided | (bounds.margin >= levels[legs.row, legs.number][:, None])
    margin = np.where(bounds.exact, bounds.tolerant, bounds.margin)
    _note(clearances, whole, legs.number, margin, bounds._replace(counts=bounds.counts & decided))
    remaining = np.ones(near.row.size, dtype=bool)
    remaining[straight] = (bounds.counts & ~decided)[:, 0]
    return take(near, remaining)


def _lost_later(near: Near, count: int, arcs: Pieces, bounds: Bounds) -> Array:
    """Return which arcs surely lose the required distance, but for the first of each row and
    intruder or area, bool ``[M, P]``.
    """
    lost = bounds.counts & bounds.surely_lost
    m, p = np.nonzero(lost)
    owner = near.row[m] * count + near.number[m]
    _, first = first_rows(owner, arcs.begin[m, p])
    lost[m[first], p[first]] = False
    return lost


def _note(
    clearances: Clearance, pieces: Pieces, number: Array, margin: Array, bounds: Bounds
) -> None:
    """Note what pieces ``[M, P]`` keep where it counts: the smallest margin and distance, m, and
    the first and the last loss, of each row and intruder or area.
    """
    owner = pieces.row * clearances.margin.shape[1] + number
    flat = Clearance(
        *(field.reshape(-1) for field in clearances)
    )  # views: its arrays are contiguous
    margin, distance = (
        np.where(bounds.counts, field, np.inf) for field in (margin, bounds.distance)
    )
    row, m, p = _least(owner, margin)
    flat.margin[row] = np.minimum(flat.margin[row], margin[m, p])
    row, m, p = _least(owner, distance)
    nearer = distance[m, p] < flat.distance[row]
    row, m, p = row[nearer], m[nearer], p[nearer]
    flat.distance[row], flat.distance_time[row] = distance[m, p], bounds.nearest[m, p]

    lost = ~(margin >= 0.0)
    m = np.flatnonzero(lost.any(axis=1))
    if m.size == 0:
        return
    p = np.argmax(lost[m], axis=1)
    # What is not a number is lost from the beginning of the piece.
    lost_from = np.where(np.isnan(bounds.lost_from), pieces.begin, bounds.lost_from)
    row, first = first_rows(owner[m], lost_from[m, p])
    m_first, p_first = m[first], p[first]
    earlier = lost_from[m_first, p_first] < flat.loss[row]
    row, piece = row[earlier], (m_first[earlier], p_first[earlier])
    flat.loss[row], flat.leg[row] = lost_from[piece], pieces.leg[piece[0]]
    begin, end = pieces.begin[piece], pieces.end[piece]
    share = (flat.loss[row] - begin) / np.maximum(end - begin, 1e-9)
    for place, (first_end, last_end) in zip(
        (flat.x, flat.y), ((pieces.x0, pieces.x1), (pieces.y0, pieces.y1)), strict=True
    ):
        place[row] = first_end[piece] + share * (last_end[piece] - first_end[piece])
    ends = np.where(lost[m], bounds.lost_until[m], -np.inf).max(axis=1)
    np.maximum.at(flat.until, owner[m], ends)


def _least(owner: Array, values: Array) -> tuple[Array, Array, Array]:
    """Return the owners of pieces ``[M, P]``, each once, and the numbers of the piece of each that
    has the least value, and of those the first.
    """
    part = np.argmin(values, axis=1)
    row, best = first_rows(owner, values[np.arange(part.size), part])
    return row, best, part[best]
