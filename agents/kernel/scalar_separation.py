"""The separation of one trajectory from its intruders in plain floats and loops: what is compiled
(:mod:`envs.compiled`) for what a planner judges, few plans at a time.

Without numba :mod:`agents.kernel.clearance` gives the same, by numpy; there and in
:mod:`agents.kernel.separation` stands why each bound holds.
"""

import math
from typing import NamedTuple

import numpy as np

from agents.kernel.chords import (
    BOUND_ERROR,
    SECANT,
    Chord,
    chord_of,
    largest_sagitta,
    least_margin,
    shares_lost,
)
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
from agents.kernel.traffic import STRAIGHT as STRAIGHT_TURN
from agents.kernel.traffic import WINDOW_EDGE, Traffic, Window, place_in_turn, scalar_growth
from agents.kernel.trajectory import STRAIGHT, Trajectory
from envs.arrays import Array, Record
from envs.backend import FLOATS
from envs.compiled import Arguments, Entry, scalar
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.relative import chord, distance
from envs.waypoints import ARCS, Legs, PlanStates


class Keeping(NamedTuple):
    """What is kept from intruders; fields ``[N, K]``, contiguous."""

    traffic: Traffic  # without separations and windows
    window: Window  # when each counts; empty, [0, 0]: all of them always
    required: np.ndarray  # before uncertainty grows, m
    least: np.ndarray  # never less than this, but for rounding, m; [0, 0]: no tolerance
    levels: np.ndarray  # margins above are bounded coarsely, m
    sigmas: float  # how many sigmas of the predicted position are added


_INTRUDER = np.dtype(
    [
        ("is_there", bool),
        ("x", float),  # at the time of the request, m
        ("y", float),
        ("heading", float),  # rad
        ("speed", float),  # m/s
        ("vx", float),  # m/s
        ("vy", float),
        ("turns", bool),
        ("turn_rate", float),  # rad/s
        ("turn_time", float),  # s
        ("turned_x", float),  # where it turns no longer, m
        ("turned_y", float),
        ("cos_after", float),  # of its heading from then on
        ("sin_after", float),
        ("position_std", float),  # m
        ("velocity_std", float),  # m/s
        ("age", float),  # s
        ("begin", float),  # when it counts, s
        ("end", float),
        ("required", float),  # before uncertainty grows, m
        ("tolerance", float),  # how much of that may be missing, m
        ("least", float),  # and never more than leaves this, m
        ("sigmas", float),  # how many sigmas of its position are added
        ("level", float),  # margins above it are bounded coarsely, m
    ]
)
"""An intruder, and what is kept from it."""


def fill_clearance(
    flown: Trajectory,
    first: int,
    end: int,
    keeping: Keeping,
    closest: bool,
    few: bool,
    clearances: Clearance,
) -> None:
    """Fill in what trajectories keep from intruders.

    Args:
        flown: the trajectories, contiguous.
        first: number of the first one that is looked at.
        end: number after that of the last.
        keeping: what is kept.
        closest: whether the smallest distance of each trajectory is to be exact.
        few: whether no leg is left out because its chord is far away.
        clearances: filled in.

    Raises:
        ValueError: arrays are of other shapes than the trajectories and the intruders.
    """
    _check_shapes(flown, keeping, clearances)
    count, legs = keeping.required.shape[1], flown.sagitta.shape[1]
    intruders, of_row = np.empty(count, _INTRUDER), np.empty(count, CLEARANCE)
    wholes, arcs = np.empty(legs, PIECE), np.empty((legs, ARCS), PIECE)
    near = np.empty((count, legs), np.bool_)
    parts = no_parts(legs)
    for row in range(first, end):
        for k in range(count):
            _write_intruder(keeping, row, k, intruders[k])
            clear(of_row[k])
        _leave_out(flown, row, intruders, closest, few, near, of_row)
        write_whole_legs(flown, row, wholes)
        for k in range(count):
            straight = near[k] & (flown.sagitta[row] <= STRAIGHT)
            judged = Judged(intruders[k], _relative_place, _bounds, keeping.levels[row, k], False)
            judge_straight_legs(wholes, straight, judged, closest, near[k], of_row[k])
        write_arcs(flown, row, arcs)
        nearest = _nearest_end(arcs, intruders, near, of_row) if closest else -math.inf
        parts.ready[:] = False
        for k in range(count):
            judged = Judged(intruders[k], _relative_place, _bounds, keeping.levels[row, k], False)
            judge_arcs(arcs, judged, nearest, near[k], parts, of_row[k])
            write_clearance(of_row[k], clearances, row, k)


@scalar
def _check_shapes(flown: Trajectory, keeping: Keeping, clearances: Clearance) -> None:
    """Raise ValueError where an array is not as large as it must be: nothing else would notice."""
    traffic, pairs = keeping.traffic, keeping.levels.shape
    right = are_trajectories(flown, clearances, pairs)
    right = right and traffic.mask.shape == pairs and keeping.required.shape == pairs
    right = right and (len(keeping.least) == 0 or keeping.least.shape == pairs)
    for field in traffic.state:
        right = right and field.shape == pairs
    for field in traffic[2:7]:
        right = right and field.shape == pairs
    for field in keeping.window:
        right = right and (len(field) == 0 or field.shape == pairs)
    if not right:
        raise ValueError("trajectories, intruders and what is kept are not of the same shape")


@scalar
def _write_intruder(keeping: Keeping, row: int, k: int, intruder: Record) -> None:
    traffic = keeping.traffic
    intruder.is_there = traffic.mask[row, k]
    intruder.x, intruder.y = traffic.state.x[row, k], traffic.state.y[row, k]
    heading, speed = traffic.state.heading[row, k], traffic.state.speed[row, k]
    intruder.heading, intruder.speed = heading, speed
    intruder.vx, intruder.vy = speed * math.cos(heading), speed * math.sin(heading)
    intruder.turn_rate, intruder.turn_time = traffic.turn_rate[row, k], traffic.turn_time[row, k]
    intruder.turns = abs(intruder.turn_rate) > STRAIGHT_TURN and intruder.turn_time > 0.0
    if intruder.turns:
        state = _state(intruder)
        intruder.turned_x, intruder.turned_y = place_in_turn(
            state, intruder.turn_rate, intruder.turn_time
        )
        after = heading + 2.0 * (0.5 * intruder.turn_rate * intruder.turn_time)
        intruder.cos_after, intruder.sin_after = math.cos(after), math.sin(after)
    intruder.position_std = traffic.position_std[row, k]
    intruder.velocity_std = traffic.velocity_std[row, k]
    intruder.age = traffic.age[row, k]
    intruder.begin, intruder.end = -math.inf, math.inf
    if len(keeping.window.begin) > 0:
        intruder.begin, intruder.end = keeping.window.begin[row, k], keeping.window.end[row, k]
    intruder.required = keeping.required[row, k]
    intruder.tolerance, intruder.least = 0.0, -math.inf
    if len(keeping.least) > 0:
        intruder.tolerance, intruder.least = CLOSE, keeping.least[row, k] - ROUNDING
    intruder.sigmas, intruder.level = keeping.sigmas, keeping.levels[row, k]


@scalar
def _state(intruder: Record) -> VehicleState[Air]:
    return VehicleState(intruder.x, intruder.y, intruder.heading, intruder.speed)


@scalar
def _relative_place(intruder: Record, time: float, x: float, y: float) -> tuple[float, float]:
    """Return where an intruder is at a time, s, seen from a place, m."""
    if not intruder.turns:
        there_x, there_y = intruder.x + intruder.vx * time, intruder.y + intruder.vy * time
    elif time < intruder.turn_time:
        there_x, there_y = place_in_turn(_state(intruder), intruder.turn_rate, time)
    else:
        straight = intruder.speed * (time - intruder.turn_time)
        there_x = intruder.turned_x + straight * intruder.cos_after
        there_y = intruder.turned_y + straight * intruder.sin_after
    return there_x - x, there_y - y


@scalar
def _ends(piece: Record, intruder: Record) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return where an intruder is, seen from both ends of a piece, m."""
    begin = _relative_place(intruder, piece.begin, piece.x0, piece.y0)
    return begin, _relative_place(intruder, piece.end, piece.x1, piece.y1)


@scalar
def _turning(intruder: Record, time: float) -> float:
    """Return the acceleration across of an intruder from a time on, s, at most, m/s^2."""
    return abs(intruder.speed * intruder.turn_rate) if time < intruder.turn_time else 0.0


@scalar
def _may_count(intruder: Record, begin: float, end: float) -> bool:
    """Return whether an intruder may count from one time to another, s."""
    return end >= intruder.begin - WINDOW_EDGE and begin <= intruder.end + WINDOW_EDGE


@scalar
def _inside(intruder: Record, piece: Record) -> bool:
    """Return whether an intruder counts during all of a piece."""
    return piece.begin >= intruder.begin and piece.end <= intruder.end


@scalar
def _required(intruder: Record, time: float) -> float:
    """Return the distance that is required at a time, s, m."""
    return intruder.required + scalar_growth(
        intruder.position_std, intruder.velocity_std, intruder.age, time, intruder.sigmas
    )


@scalar
def _tolerated(intruder: Record, required: float) -> float:
    """Return what is left of a required distance by the tolerance, m."""
    return max(required - intruder.tolerance, intruder.least)


@scalar
def _leave_out(
    flown: Trajectory,
    row: int,
    intruders: Array,
    closest: bool,
    few: bool,
    near: np.ndarray,
    clearances: Array,
) -> None:
    """Write which legs must be judged against which intruders, ``[K, L]``, and note bounds of the
    margins of all others, as :meth:`agents.kernel.separation.Separation.near` does.
    """
    time, x, y = flown.states.time[row], flown.states.x[row], flown.states.y[row]
    stray = flown.sagitta[row] + flown.error[row]
    bound, margin = np.empty(near.shape), np.empty(near.shape)
    attained = least = math.inf
    for k in range(len(near)):
        near[k] = False
        intruder = intruders[k]
        if not intruder.is_there:
            continue
        x0, y0 = _relative_place(intruder, time[0], x[0], y[0])
        for leg in range(near.shape[1]):
            begin, end = time[leg], time[leg + 1]
            near[k, leg] = end > 0.0 and _may_count(intruder, begin, end)
            x1, y1 = _relative_place(intruder, end, x[leg + 1], y[leg + 1])
            turned = 0.125 * _turning(intruder, begin) * (end - begin) ** 2
            bound[k, leg] = chord(x0, y0, x1, y1, FLOATS) - (stray[leg] + turned + BOUND_ERROR)
            margin[k, leg] = bound[k, leg] - _required(intruder, end)
            if begin >= 0.0 and _may_count(intruder, begin, begin):
                away = distance(x0, y0, FLOATS)
                attained = min(attained, away)
                least = min(least, away - _required(intruder, begin))
            x0, y0 = x1, y1
    if few:
        return
    for k in range(len(near)):
        for leg in range(near.shape[1]):
            if near[k, leg]:
                near[k, leg] = not margin[k, leg] >= intruders[k].level or (
                    closest and (bound[k, leg] <= attained or margin[k, leg] <= least)
                )
                if not near[k, leg]:
                    clearances[k].margin = min(clearances[k].margin, margin[k, leg])


@scalar
def _nearest_end(arcs: Array, intruders: Array, near: np.ndarray, clearances: Array) -> float:
    """Return the smallest distance that is known to occur, at the ends of arcs that are near, or on
    legs that are judged, m.
    """
    nearest = math.inf
    for k in range(len(near)):
        nearest, intruder = min(nearest, clearances[k].distance), intruders[k]
        for leg in range(near.shape[1]):
            if near[k, leg]:
                for number in range(ARCS):
                    arc = arcs[leg, number]
                    if _inside(intruder, arc):
                        (x0, y0), (x1, y1) = _ends(arc, intruder)
                        nearest = min(nearest, distance(x0, y0, FLOATS), distance(x1, y1, FLOATS))
    return nearest


@scalar
def _bounds(
    intruder: Record,
    piece: Record,
    begin: tuple[float, float],
    end: tuple[float, float],
) -> Bounds:
    """Return what a piece keeps of the separation from an intruder, in plain numbers, as
    :meth:`agents.kernel.separation.Separation.bounds` does; where it does not count, the margin
    and what is lost mean nothing. The piece leads from one place of the intruder relative to it to
    another, m.
    """
    lasts = piece.end - piece.begin
    sagitta = largest_sagitta(piece.bend + _turning(intruder, 0.0), lasts, FLOATS)
    line = chord_of(begin[0], begin[1], end[0], end[1], sagitta, piece.error, FLOATS)
    counts = piece.end > 0.0 and _may_count(intruder, piece.begin, piece.end)
    inside = _inside(intruder, piece)
    attained = line.attained if inside else math.inf
    required = _required(intruder, piece.end)
    tolerated = _tolerated(intruder, required)
    margin, tolerant, exact = line.distance - required, line.distance - tolerated, False
    nearest, enters, leaves = piece.begin, piece.begin, piece.end
    if counts and inside and sagitta <= STRAIGHT:
        (tolerant, exact, most), shares = _straight_margin(line, piece, intruder)
        margin = tolerant - max(required - tolerated, most)
        nearest = piece.begin + line.share * lasts
        enters, leaves = piece.begin + shares[0] * lasts, piece.begin + shares[1] * lasts
    return Bounds(
        line.distance,
        nearest,
        margin,
        tolerant,
        attained,
        counts,
        exact,
        attained < tolerated,
        enters,
        leaves,
    )


@scalar
def _straight_margin(
    line: Chord, piece: Record, intruder: Record
) -> tuple[tuple[float, bool, float], tuple[float, float]]:
    """Return the margin of straight motion less the tolerance, m, whether parts would tell no more,
    and the tolerance, m; and from which share of it to which less than is tolerated is left.
    """
    # A part later each, since of parts the end counts.
    first = _required(intruder, piece.begin + piece.part)
    middle = _required(intruder, 0.5 * (piece.begin + piece.end) + piece.part)
    last = _required(intruder, piece.end + piece.part)
    at_first, at_last = _tolerated(intruder, first), _tolerated(intruder, last)
    at_middle = _tolerated(intruder, middle)
    begin = at_first + piece.error_begin + line.sagitta
    end = at_last + piece.error + line.sagitta
    most = max(first - at_first, middle - at_middle, last - at_last)
    exact = 0.5 * (at_first + at_last) - at_middle <= SECANT
    of_margin = least_margin(line, begin, end, FLOATS), exact, most
    return of_margin, shares_lost(line, begin, end, FLOATS)


def _examples() -> list[Arguments]:
    """Return arguments of the one signature."""
    points, arcs, pairs = np.zeros((1, 2)), np.zeros((1, 1, ARCS)), np.zeros((1, 1))
    flown = Trajectory(
        PlanStates(*(points,) * 5),
        Legs(*(pairs,) * 3, *(arcs,) * 6),
        arcs,
        *(pairs,) * 3,
    )
    traffic = Traffic.straight(VehicleState(*(pairs,) * 4))
    keeping = Keeping(traffic, Window(pairs, pairs), pairs, pairs, pairs, sigmas=2.0)
    return [(flown, 0, 1, keeping, True, True, Clearance.blank(1, 1))]


FILL_CLEARANCE = Entry(fill_clearance, _examples)
