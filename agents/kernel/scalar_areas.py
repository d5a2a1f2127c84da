"""The clearance of one trajectory from areas in plain floats and loops: what is compiled
(:mod:`envs.compiled`) for what a planner judges, few plans at a time.

Without numba :mod:`agents.kernel.clearance` gives the same, by numpy; there and in
:mod:`agents.kernel.areas` stands why each bound holds.
"""

import math
from typing import NamedTuple

import numpy as np

from agents.kernel.clearance import CLOSE, ROUNDING, Bounds, Clearance
from agents.kernel.scalar_clearance import (
    CLEARANCE,
    Judged,
    are_trajectories,
    clear,
    judge_arcs,
    judge_straight_legs,
    no_parts,
    write_clearance,
)
from agents.kernel.scalar_pieces import PIECE, write_arcs, write_whole_legs
from agents.kernel.trajectory import STRAIGHT, Trajectory
from envs.arrays import Array, Record
from envs.compiled import Arguments, Entry, scalar
from envs.flat_areas import SIDE, FlatArea, box_distance_of_chord, flat, scalar_chord_distances
from envs.waypoints import ARCS, Legs, PlanStates


class AreaKeeping(NamedTuple):
    """What is kept from areas, contiguous."""

    areas: Array  # records [K] of envs.flat_areas.FlatArea; what is required is not read
    lines: Array  # records of their edges, [E]
    required: np.ndarray  # signed distance, m, [N, K]
    levels: np.ndarray  # margins above are bounded coarsely, m, [N, K]


class _Keep(NamedTuple):
    """An area, and what one trajectory keeps from it."""

    area: FlatArea
    lines: Array  # records of edges, [E]
    required: float  # signed distance, m
    side: Array  # a record of envs.flat_areas.SIDE, [1]


def fill_area_clearance(
    flown: Trajectory,
    rows: tuple[int, int],
    numbers: tuple[int, int],
    keeping: AreaKeeping,
    clearances: Clearance,
) -> None:
    """Fill in what trajectories keep from areas.

    Args:
        flown: the trajectories, contiguous.
        rows: number of the first one that is looked at, and the number after that of the last.
        numbers: the same of the areas.
        keeping: what is kept.
        clearances: filled in.

    Raises:
        ValueError: arrays are of other shapes than the trajectories and the areas.
    """
    pairs = flown.sagitta.shape[0], len(keeping.areas)
    right = are_trajectories(flown, clearances, pairs) and keeping.required.shape == pairs
    if not (right and keeping.levels.shape == pairs):
        raise ValueError("trajectories, areas and what is kept are not of the same shape")
    legs = flown.sagitta.shape[1]
    wholes, arcs = np.empty(legs, PIECE), np.empty((legs, ARCS), PIECE)
    near, of_row = np.empty(legs, np.bool_), np.empty(len(keeping.areas), CLEARANCE)
    parts, side = no_parts(legs), np.empty(1, SIDE)
    for row in range(rows[0], rows[1]):
        write_whole_legs(flown, row, wholes)
        write_arcs(flown, row, arcs)
        parts.ready[:] = False
        for k in range(numbers[0], numbers[1]):
            side[0].x = math.nan
            area = _Keep(keeping.areas[k], keeping.lines, keeping.required[row, k], side)
            judged = Judged(area, _place, _bounds, keeping.levels[row, k], True)
            clear(of_row[k])
            _leave_out(arcs, judged, near, of_row[k])
            straight = near & (flown.sagitta[row] <= STRAIGHT)
            judge_straight_legs(wholes, straight, judged, False, near, of_row[k])
            judge_arcs(arcs, judged, -math.inf, near, parts, of_row[k])
            write_clearance(of_row[k], clearances, row, k)


@scalar
def _leave_out(arcs: Array, judged: Judged, near: np.ndarray, clearance: Record) -> None:
    """Write which legs come near an area, ``[L]``, and note bounds of the margins of all others, as
    :meth:`agents.kernel.areas.AreaClearance.near` does.
    """
    area, required = judged.of.area, judged.of.required
    for leg in range(len(near)):
        near[leg], margin = False, math.inf
        for number in range(ARCS):
            arc = arcs[leg, number]
            if _counts(area, arc):
                begin = _place(judged.of, arc.begin, arc.x0, arc.y0)
                end = _place(judged.of, arc.end, arc.x1, arc.y1)
                far = _far_bound(area, arc, begin, end) - required
                near[leg] = near[leg] or not far > judged.level
                margin = min(margin, far)
        if not near[leg]:
            clearance.margin = min(clearance.margin, margin)


@scalar
def _place(keep: _Keep, time: float, x: float, y: float) -> tuple[float, float]:
    """Return a place at a time, s, where the area stands still, m."""
    return x - keep.area.vx * time, y - keep.area.vy * time


@scalar
def _counts(area: FlatArea, piece: Record) -> bool:
    """Return whether an area counts in a piece."""
    return piece.end > 0.0 and piece.end >= area.begin and piece.begin <= area.end


@scalar
def _least_gain(area: FlatArea, piece: Record) -> float:
    """Return the least that the area's growth adds to signed distances within a piece, m."""
    return min(area.gain * piece.begin, area.gain * piece.end)


@scalar
def _chord_error(piece: Record) -> float:
    """Return by how much the curve may be nearer than its chord as it is computed, m."""
    return 0.125 * piece.bend * (piece.end - piece.begin) ** 2 + piece.error


@scalar
def _far_bound(
    area: FlatArea, piece: Record, begin: tuple[float, float], end: tuple[float, float]
) -> float:
    """Return a lower bound of the signed distance in a piece by the rectangle about an area, m;
    -inf where they may meet, and of an area to be kept in.
    """
    away = box_distance_of_chord(area, begin[0], begin[1], end[0], end[1])
    if not (area.sign > 0.0 and away > 0.0):
        return -math.inf
    return away + _least_gain(area, piece) - _chord_error(piece)


@scalar
def _bounds(
    keep: _Keep, piece: Record, begin: tuple[float, float], end: tuple[float, float]
) -> Bounds:
    """Return what a piece keeps from an area, in plain numbers, as
    :meth:`agents.kernel.areas.AreaClearance.bounds` does. In the area's frame it leads from one
    place to another, m.
    """
    area, required = keep.area, keep.required
    tolerated = max(required - CLOSE, -ROUNDING)
    counts, bound, attained = _counts(area, piece), math.inf, math.inf
    if counts:
        bound = _far_bound(area, piece, begin, end)
        if not bound > required:
            bound, attained = _chord_bounds(keep, piece, begin, end)
    return Bounds(
        bound,
        piece.begin,
        bound - required,
        bound - tolerated,
        attained,
        counts,
        False,
        attained < tolerated,
        piece.begin,
        piece.end,
    )


@scalar
def _chord_bounds(
    keep: _Keep, piece: Record, begin: tuple[float, float], end: tuple[float, float]
) -> tuple[float, float]:
    """Return a lower bound of the signed distance in a piece by its chord, and the least value that
    is known to occur, m.
    """
    area, lost = keep.area, _chord_error(piece) - _least_gain(keep.area, piece)
    bound, first, last = scalar_chord_distances(
        area, keep.lines, *begin, *end, keep.required + lost, keep.side[0]
    )
    # Where the area counts for a part of a piece only, its ends decide nothing.
    if not (piece.begin >= area.begin and piece.end <= area.end):
        return bound - lost, math.inf
    return bound - lost, min(first + area.gain * piece.begin, last + area.gain * piece.end)


def _examples() -> list[Arguments]:
    """Return arguments of the one signature."""
    points, arcs, pairs = np.zeros((1, 2)), np.zeros((1, 1, ARCS)), np.zeros((1, 1))
    flown = Trajectory(
        PlanStates(*(points,) * 5),
        Legs(*(pairs,) * 3, *(arcs,) * 6),
        arcs,
        *(pairs,) * 3,
    )
    nothing = np.zeros(0)
    areas, lines = flat((), nothing, nothing, nothing)
    keeping = AreaKeeping(areas, lines, pairs, pairs)
    return [(flown, (0, 1), (0, 1), keeping, Clearance.blank(1, 1))]


FILL_AREA_CLEARANCE = Entry(fill_area_clearance, _examples)
