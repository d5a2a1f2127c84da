"""What one trajectory keeps of an intruder or an area, in plain floats and loops, for compiled
code: what :func:`agents.kernel.clearance.clearance` does for many by numpy.

Legs are looked at as wholes first, arcs next, and parts of an arc where that does not decide.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from agents.kernel.arcs import are_legs
from agents.kernel.clearance import Bounds, Clearance
from agents.kernel.scalar_pieces import PIECE, write_parts
from agents.kernel.trajectory import FINE, Trajectory
from envs.arrays import Array, Bool, Record, Shaped
from envs.compiled import scalar
from envs.waypoints import ARCS

CLEARANCE = np.dtype([(name, int if name == "leg" else float) for name in Clearance._fields])
"""What is kept from an intruder or an area."""


class Judged(NamedTuple):
    """An intruder or an area, and how pieces are judged against it."""

    of: Any
    # Where a place at a time (s, m, m) lies relative to it, m.
    place: Callable[[Any, float, float, float], tuple[float, float]]
    # What a piece keeps that leads from one such place to another; where it does not count, the
    # margin and what is lost mean nothing.
    bounds: Callable[[Any, Record, tuple[float, float], tuple[float, float]], Bounds]
    level: float  # margins above it are bounded coarsely, m
    cuts_once: bool  # as of agents.kernel.clearance.Constraint


class Parts(NamedTuple):
    """Where the parts of a trajectory's arcs begin and end."""

    ready: np.ndarray  # whether they are known, [L, ARCS]
    x: np.ndarray  # m, [L, ARCS, FINE + 1]
    y: np.ndarray
    # Room for one of them, PIECE [1]: in compiled code a record does not keep its array alive.
    room: np.ndarray


@scalar
def no_parts(legs: int) -> Parts:
    """Return room for the parts of so many legs."""
    shape = legs, ARCS, FINE + 1
    ready = np.zeros((legs, ARCS), np.bool_)
    return Parts(ready, np.empty(shape), np.empty(shape), np.empty(1, PIECE))


@scalar
def are_trajectories(flown: Trajectory, clearances: Clearance, pairs: tuple[int, int]) -> bool:
    """Return whether the arrays of trajectories have the shapes that they must have, and those of
    what they keep: compiled code would notice nothing.
    """
    rows, legs = flown.sagitta.shape
    right = are_legs(flown.legs, rows, legs) and pairs[0] == rows and clearances.leg.shape == pairs
    right = right and flown.bend.shape == (rows, legs, ARCS)
    for field in flown.states:
        right = right and field.shape == (rows, legs + 1)
    for field in flown[4:]:
        right = right and field.shape == (rows, legs)
    for field in clearances[:3] + clearances[4:]:
        right = right and field.shape == pairs
    return right


@scalar
def clear(clearance: Record) -> None:
    """Write that nothing counts."""
    clearance.margin = clearance.loss = clearance.distance = math.inf
    clearance.x = clearance.y = clearance.distance_time = math.nan
    clearance.until, clearance.leg = -math.inf, -1


@scalar
def write_clearance(clearance: Record, into: Clearance, row: int, k: int) -> None:
    """Write what a trajectory keeps of the intruder or area of a number."""
    into.margin[row, k], into.loss[row, k], into.until[row, k] = (
        clearance.margin,
        clearance.loss,
        clearance.until,
    )
    into.leg[row, k], into.x[row, k], into.y[row, k] = clearance.leg, clearance.x, clearance.y
    into.distance[row, k], into.distance_time[row, k] = clearance.distance, clearance.distance_time


@scalar
def judge_straight_legs(
    wholes: Shaped[Array, " L"],
    straight: Bool[np.ndarray, " L"],
    judged: Judged,
    closest: bool,
    near: Bool[np.ndarray, " L"],
    clearance: Record,
) -> None:
    """Note what legs of uniform motion keep where that decides, which are near no longer; ``[L]``
    each.
    """
    for leg in range(len(near)):
        if straight[leg]:
            bounds = _bounds(wholes[leg], judged)
            decides = bounds.exact or (not closest and bounds.margin >= judged.level)
            near[leg] = bounds.counts and not decides
            if bounds.counts and decides:
                _note(clearance, leg, wholes[leg], bounds, bounds.exact)


@scalar
def judge_arcs(
    arcs: Shaped[Array, "L ARCS"],
    judged: Judged,
    nearest: float,
    near: Bool[np.ndarray, " L"],
    parts: Parts,
    clearance: Record,
) -> None:
    """Note what the arcs of legs that are near keep, ``[L]``; in parts where that does not decide,
    or where they may be as near as the nearest, m.
    """
    unclear = np.zeros(arcs.shape, np.bool_)
    lost = False
    for leg in range(len(near)):
        if near[leg]:
            for number in range(ARCS):
                arc = arcs[leg, number]
                bounds = _bounds(arc, judged)
                clear = bounds.margin >= judged.level and not bounds.distance <= nearest
                decides = bounds.exact or clear
                if judged.cuts_once and bounds.counts and bounds.surely_lost:
                    decides, lost = decides or lost, True
                unclear[leg, number] = bounds.counts and not decides
                if bounds.counts and decides:
                    _note(clearance, leg, arc, bounds, bounds.exact)
    for leg in range(len(near)):
        for number in range(ARCS):
            if unclear[leg, number]:
                arc, x, y = arcs[leg, number], parts.x[leg, number], parts.y[leg, number]
                if not parts.ready[leg, number]:
                    write_parts(arc, x, y)
                    parts.ready[leg, number] = True
                _judge_parts(arc, x, y, parts.room, judged, leg, clearance)


@scalar
def _judge_parts(
    arc: Record,
    x: np.ndarray,
    y: np.ndarray,
    room: Array,
    judged: Judged,
    leg: int,
    clearance: Record,
) -> None:
    """Note what the parts of an arc keep, which begin and end at places, m, ``[FINE + 1]`` each."""
    lasts, part = (arc.end - arc.begin) / FINE, room[0]
    part.bend, part.error, part.error_begin, part.part = arc.bend, arc.error, arc.error, arc.part
    begin = judged.place(judged.of, arc.begin, x[0], y[0])
    for i in range(FINE):
        part.begin, part.end = arc.begin + i * lasts, arc.begin + (i + 1) * lasts
        part.x0, part.y0, part.x1, part.y1 = x[i], y[i], x[i + 1], y[i + 1]
        end = judged.place(judged.of, part.end, part.x1, part.y1)
        bounds = judged.bounds(judged.of, part, begin, end)
        begin = end
        if bounds.counts:
            _note(clearance, leg, part, bounds, True)


@scalar
def _bounds(piece: Record, judged: Judged) -> Bounds:
    """Return what a piece keeps."""
    begin = judged.place(judged.of, piece.begin, piece.x0, piece.y0)
    end = judged.place(judged.of, piece.end, piece.x1, piece.y1)
    return judged.bounds(judged.of, piece, begin, end)


@scalar
def _note(clearance: Record, leg: int, piece: Record, bounds: Bounds, tolerant: bool) -> None:
    """Note what a piece of a leg keeps: the smallest margin and distance, the first and the last
    loss.
    """
    margin = bounds.tolerant if tolerant else bounds.margin
    if margin < clearance.margin or math.isnan(margin):
        clearance.margin = margin
    if bounds.distance < clearance.distance:
        clearance.distance, clearance.distance_time = bounds.distance, bounds.nearest
    if margin >= 0.0:
        return
    clearance.until = max(clearance.until, bounds.lost_until)
    # What is not a number is lost from the beginning of the piece.
    lost_from = piece.begin if math.isnan(bounds.lost_from) else bounds.lost_from
    if lost_from < clearance.loss:
        share = (lost_from - piece.begin) / max(piece.end - piece.begin, 1e-9)
        clearance.loss, clearance.leg = lost_from, leg
        clearance.x = piece.x0 + share * (piece.x1 - piece.x0)
        clearance.y = piece.y0 + share * (piece.y1 - piece.y0)
