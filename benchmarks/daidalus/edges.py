"""Edges of bands on both sides, which of them agree, and why one does not."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agents.assurance.bands import Bands, stretches
from benchmarks.daidalus.program import Interval, track_of

NAMES = ("narrow", "grazing", "look-ahead", "opposite heading", "unexplained")
"""Why an edge of one side is not one of the other (docs/reference/beside-others.md)."""

_GRAZING = 5.0  # m of clearance, either way; of vertical ones likewise
_LATE = 2.0  # s before the end of the look-ahead


class Edge(NamedTuple):
    """Where free and closed bands meet."""

    place: float  # deg clockwise from north, m/s or m
    opens: bool  # whether what follows in ascending order is free


class Match(NamedTuple):
    """An edge and the nearest one of the same kind on the other side."""

    edge: Edge
    away: float  # deg, m/s or m; inf where there is none
    name: str  # of NAMES; empty where they agree


class Kind(NamedTuple):
    """Bands of one kind, as both sides look at them."""

    circle: bool  # whether they are headings
    within: float  # so much apart, edges agree, deg, m/s or m
    step: float  # of the program, above 0
    look_ahead: float  # s


def their_edges(intervals: Sequence[Interval], *, circle: bool) -> list[Edge]:
    """Return the edges of the program's intervals."""
    closed = [interval.region != "NONE" for interval in intervals]
    edges = [
        Edge(after.low, not after_closed)
        for after, before_closed, after_closed in zip(
            intervals[1:], closed[:-1], closed[1:], strict=True
        )
        if before_closed != after_closed
    ]
    if circle and intervals and closed[0] != closed[-1]:
        edges.insert(0, Edge(0.0, not closed[0]))
    return edges


def our_edges(bands: Bands, row: int, *, circle: bool) -> list[Edge]:
    """Return the edges of one row of our bands, headings in degrees clockwise from north."""
    parts = stretches(bands, row, circle=circle)
    if not circle:
        return [Edge(part.low, not part.closed) for part in parts[1:]]
    if len(parts) == 1:
        return []
    # Counter-clockwise a stretch ends where it begins clockwise.
    return [Edge(float(track_of(part.high)), not part.closed) for part in parts]


def match_edges(intervals: Sequence[Interval], bands: Bands, row: int, kind: Kind) -> list[Match]:
    """Return for the edges of both sides, of one row of our bands, whether the other has them."""
    circle = kind.circle
    theirs, mine = their_edges(intervals, circle=circle), our_edges(bands, row, circle=circle)
    return matches(mine, theirs, bands, row, kind) + matches(theirs, mine, bands, row, kind)


def matches(
    mine: Sequence[Edge],
    others: Sequence[Edge],
    bands: Bands,
    row: int,
    kind: Kind,
) -> list[Match]:
    """Return for each edge of one side whether the other has it.

    Args:
        mine: edges of the one side.
        others: of the other.
        bands: ours, of one of both sides.
        row: of the bands.
        kind: of the bands.
    """
    ours = _Row.of(bands, row, kind)
    matched = []
    for edge in mine:
        same = [
            _apart(edge.place, candidate.place, ours.circle)
            for candidate in others
            if candidate.opens == edge.opens
        ]
        away = abs(min(same, key=abs, default=np.inf))
        name = ""
        if away > kind.within:
            gap = _gap_to_next(edge, [*mine, *others], ours)
            name = "narrow" if gap <= 2.0 * kind.step else _name(edge, min(away, gap), ours)
        matched.append(Match(edge, away, name))
    return matched


class _Row(NamedTuple):
    """One row of our bands, fields ``[B]``."""

    circle: bool  # whether these are headings
    look_ahead: float  # s
    places: np.ndarray  # degrees clockwise from north, m/s or m
    closed: np.ndarray
    clearance: np.ndarray
    loss: np.ndarray
    reached: np.ndarray

    @classmethod
    def of(cls, bands: Bands, row: int, kind: Kind) -> "_Row":
        """Return a row of bands."""
        target = bands.target[row]
        return cls(
            kind.circle,
            kind.look_ahead,
            track_of(target) if kind.circle else target,
            bands.closed[row],
            bands.clearance[row],
            bands.loss[row],
            bands.reached[row],
        )


def _apart(place: float, other: float, circle: bool) -> float:
    """Return how far another place is from one, degrees or m/s."""
    return (other - place + 180.0) % 360.0 - 180.0 if circle else other - place


def _gap_to_next(edge: Edge, edges: Sequence[Edge], ours: _Row) -> float:
    """Return how far the next edge of any kind is, or the end of the range; inf: there is none."""
    gaps = [
        abs(_apart(edge.place, neighbour.place, ours.circle))
        for neighbour in edges
        if neighbour is not edge
    ]
    if not ours.circle:
        gaps += [abs(float(end) - edge.place) for end in ours.places[[0, -1]]]
        gaps = [gap or 1e-9 for gap in gaps]
    return min((gap for gap in gaps if gap), default=np.inf)


def _name(edge: Edge, reach: float, ours: _Row) -> str:
    """Return why an edge has no partner, by what lies within a reach of it, degrees or m/s."""
    if not np.isfinite(reach):
        return "unexplained"
    gaps = np.array([_apart(edge.place, float(place), ours.circle) for place in ours.places])
    near = np.abs(gaps) <= reach
    sides = [near & (gaps >= 0.0), near & (gaps <= 0.0)]
    for side in sides:
        if side.any() and (np.abs(ours.clearance[side]) <= _GRAZING).all():
            return "grazing"
    for side in sides:
        loss = ours.loss[side & ours.closed]
        if loss.size and (loss >= ours.look_ahead - _LATE).all():
            return "look-ahead"
    if ours.circle and float(np.max(ours.reached[near], initial=0.0)) >= 0.98 * float(
        ours.reached.max()
    ):
        return "opposite heading"
    return "unexplained"
