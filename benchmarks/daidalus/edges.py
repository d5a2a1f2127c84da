"""Edges of bands on both sides, which of them agree, and why one does not."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agents.assurance.bands import Bands, stretches
from benchmarks.daidalus.program import Interval

NAMES = ("narrow", "grazing", "look-ahead", "opposite heading", "unexplained")
"""Why an edge of one side is not one of the other; docs/explanation/alerts.md says what each is."""

_GRAZING = 5.0  # m of clearance, either way
_LATE = 2.0  # s before the end of the look-ahead


class Edge(NamedTuple):
    """Where free and closed bands meet."""

    place: float  # deg clockwise from north, or m/s
    opens: bool  # whether what follows in ascending order is free


class Match(NamedTuple):
    """An edge and the nearest one of the same kind on the other side."""

    edge: Edge
    away: float  # deg or m/s; inf where there is none
    name: str  # of NAMES; empty where they agree


def their_edges(intervals: Sequence[Interval], *, circle: bool) -> list[Edge]:
    """Return the edges of the program's intervals."""
    closed = [interval.region != "NONE" for interval in intervals]
    found = [
        Edge(after.low, not after_closed)
        for after, before_closed, after_closed in zip(
            intervals[1:], closed[:-1], closed[1:], strict=True
        )
        if before_closed != after_closed
    ]
    if circle and intervals and closed[0] != closed[-1]:
        found.insert(0, Edge(0.0, not closed[0]))
    return found


def our_edges(bands: Bands, row: int, *, circle: bool) -> list[Edge]:
    """Return the edges of one row of our bands, headings in degrees clockwise from north."""
    parts = stretches(bands, row, circle=circle)
    if not circle:
        return [Edge(part.low, not part.closed) for part in parts[1:]]
    if len(parts) == 1:
        return []
    # Counter-clockwise a stretch ends where it begins clockwise.
    return [Edge(float(90.0 - np.degrees(part.high)) % 360.0, not part.closed) for part in parts]


def matches(
    mine: list[Edge], others: list[Edge], bands: Bands, row: int, within: float, step: float
) -> list[Match]:
    """Return for each edge of one side whether the other has it ``within`` so much.

    Args:
        step: of the program, degrees or m/s; 0 < step.
    """
    circle = bool(np.max(np.abs(bands.target[row])) <= np.pi + 1e-9)
    found = []
    for edge in mine:
        same = [
            _apart(edge.place, other.place, circle) for other in others if other.opens == edge.opens
        ]
        away = min(same, key=abs, default=np.inf)
        agrees = abs(away) <= within
        name = "" if agrees else _name(edge, away, mine, others, bands, row, circle, step)
        found.append(Match(edge, abs(away), name))
    return found


def _apart(place: float, other: float, circle: bool) -> float:
    return (other - place + 180.0) % 360.0 - 180.0 if circle else other - place


def _name(
    edge: Edge,
    away: float,
    mine: list[Edge],
    others: list[Edge],
    bands: Bands,
    row: int,
    circle: bool,
    step: float,
) -> str:
    """Return why an edge has no partner, by what lies between it and the next edge of any kind."""
    next_ones = [
        _apart(edge.place, other.place, circle) for other in (*mine, *others) if other is not edge
    ]
    if not circle:  # the range ends
        next_ones += [float(end) - edge.place for end in bands.target[row, [0, -1]]]
        next_ones = [gap if gap else 1e-9 for gap in next_ones]
    wide = min((abs(gap) for gap in next_ones if gap), default=np.inf)
    if wide <= 2.0 * step:
        return "narrow"
    target = bands.target[row]
    places = (90.0 - np.degrees(target)) % 360.0 if circle else target
    reach = min(abs(away), wide)
    if not np.isfinite(reach):
        return "unexplained"
    gaps = np.array([_apart(edge.place, float(place), circle) for place in places])
    near = np.abs(gaps) <= reach
    sides = [near & (gaps >= 0.0), near & (gaps <= 0.0)]
    for side in sides:
        if side.any() and (np.abs(bands.clearance[row, side]) <= _GRAZING).all():
            return "grazing"
    look_ahead = float(bands.reached[row].max())
    for side in sides:
        loss = bands.loss[row, side & bands.closed[row]]
        if loss.size and (loss >= max(look_ahead, 1.0) - _LATE).all():
            return "look-ahead"
    if circle and float(np.max(bands.reached[row, near], initial=0.0)) >= 0.98 * look_ahead:
        return "opposite heading"
    return "unexplained"
