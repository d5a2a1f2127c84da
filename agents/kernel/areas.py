"""The clearance from areas as a constraint: every curve, while the area counts.

An area counts while it is valid and the ownship may be level with it. As with the separation
(:mod:`agents.kernel.separation`), a piece of a trajectory of length h leaves its chord by at most
a h^2 / 8, so what :mod:`envs.area_geometry` says of the chord bounds the signed distance of the
whole piece (theorem ``area_part_safe`` of proofs/Safe.v).
"""

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from agents.kernel.clearance import CLOSE, ROUNDING, Bounds, Clearance, Near
from agents.kernel.levels import Altitude, Line, union
from agents.kernel.scalar_areas import FILL_AREA_CLEARANCE, AreaKeeping
from agents.kernel.trajectory import Pieces, Trajectory, pieces, rest_of
from envs.area_geometry import (
    Parts,
    box_distance,
    chord_distances,
    gain,
    own_frame,
    signed_distance,
)
from envs.areas import Area, Keep, Level
from envs.arrays import Array, Float, Int
from envs.flat_areas import flat
from envs.frames import F
from envs.kinematics import VehicleState
from envs.trees import contiguous, take

NEARER = 0.01
"""By how much a plan that begins inside the clearance may come nearer than it is, m: the first part
of a curve is bounded to some millimetres only.
"""

# Legs set against edges in a call of compiled code, which lasts 0.3 ms then, rarely 1 ms. What one
# trajectory keeps of one area is not divided: close to 1000 edges that takes up to 11 ms.
_EDGES = 2_000

Span = tuple[int, int]
"""The number of the first thing, and the number after that of the last."""


class ActiveArea(NamedTuple):
    """An area that a plan may meet."""

    number: int  # its place in the request
    area: Area
    begin: float  # from when it counts, s after the request
    end: float  # until when


class AreaClearance(NamedTuple):
    """What is kept from areas."""

    areas: Sequence[ActiveArea]  # K of them
    required: Array  # signed distance, m, [N, K]

    @property
    def size(self) -> int:
        """How many areas there are, K."""
        return len(self.areas)

    @property
    def cuts_once(self) -> bool:
        """Whether arcs that surely lose the clearance are cut only to tell when it is lost first:
        an area may have thousands of edges.
        """
        return True

    def fill(
        self,
        flown: Trajectory[Any],
        levels: Float[Array, "N K"],
        clearances: Clearance,
        *,
        closest: bool,
    ) -> bool:
        """Fill in what is kept by compiled code; return whether there is any. For the closest there
        is none.
        """
        if closest or not FILL_AREA_CLEARANCE.ready:
            return False
        areas, lines = flat_areas(tuple(self.areas))
        keeping = AreaKeeping(areas, lines, *contiguous((self.required, levels)))
        flown = contiguous(flown)
        for rows, numbers in _calls(flown, areas):
            FILL_AREA_CLEARANCE(flown, rows, numbers, keeping, clearances)
        return True

    def near(
        self,
        flown: Trajectory[Any],
        levels: Float[Array, "N K"],
        clearances: Clearance,
        *,
        closest: bool,
    ) -> Near:
        """Return the legs that come near an area, and note the bounds of all others: what the
        rectangle about the area tells.
        """
        rows, legs = flown.legs.time.shape
        row, leg = np.divmod(np.arange(rows * legs), legs)
        arcs = rest_of(pieces(flown, row, leg))
        near = np.zeros((rows * legs, self.size), dtype=bool)
        for k, active in enumerate(self.areas):
            counts = _counts(active, arcs)
            if active.area.keep is Keep.IN:
                near[:, k] = counts.any(axis=1)
                continue
            margin = _far_bound(active.area, arcs) - self.required[row, k, None]
            clear = margin > levels[row, k, None]
            near[:, k] = (counts & ~clear).any(axis=1)
            far = np.where(counts & ~near[:, k, None], margin, np.inf).reshape(rows, -1)
            np.minimum(clearances.margin[:, k], far.min(axis=1), out=clearances.margin[:, k])
        m, number = np.nonzero(near)
        return Near(row[m], leg[m], number)

    def bounds(self, pieces: Pieces, number: Int[Array, " M"]) -> Bounds:
        """Return what pieces keep of an area each, by their numbers ``[M]``."""
        shape = pieces.begin.shape
        bound, attained = np.full((2, *shape), np.inf)
        counts = np.zeros(shape, dtype=bool)
        required = np.broadcast_to(self.required[pieces.row, number][:, None], shape)
        for k in np.unique(number):
            rows = np.flatnonzero(number == k)
            bound[rows], attained[rows], counts[rows] = _bound_area(
                self.areas[k], take(pieces, rows), required[rows]
            )
        tolerated = _less_tolerance(required)
        return Bounds(
            distance=bound,
            nearest=pieces.begin,
            margin=bound - required,
            tolerant=bound - tolerated,
            attained=attained,
            counts=counts,
            exact=np.zeros(shape, dtype=bool),
            surely_lost=attained < tolerated,
            lost_from=pieces.begin,
            lost_until=pieces.end,
        )


def area_clearance(
    areas: Sequence[ActiveArea], x: Float[Array, " N"], y: Float[Array, " N"], margin: float
) -> AreaClearance:
    """Return what trajectories that begin at places ``[N]``, m, keep from areas; the margin, m, is
    added to their clearances.
    """
    required = [required_distances(active, x, y, margin) for active in areas]
    return AreaClearance(areas, np.stack(required, axis=-1) if areas else np.zeros((len(x), 0)))


def relevant(
    areas: Sequence[Area],
    own: VehicleState[F],
    flight: Sequence[Line],
    *,
    fastest: float,
    horizon: float,
    unknown_climb: float,
    margin: float,
) -> tuple[ActiveArea, ...]:
    """Return the areas that count within a horizon, each once for every time in which it does.

    An area to be kept out of is left out where the ownship cannot reach its clearance and the
    margin in time (theorem ``area_out_of_reach`` of proofs/Safe.v).

    Args:
        own: state of the ownship at the request.
        flight: its altitude; none: unknown, which counts as level with every area.
        fastest: highest speed over the ground of any plan, m/s.
        horizon: time of the last waypoint of any plan, s.
        unknown_climb: vertical speed either way where it is unknown, m/s.
        margin: what the follower leaves of the plan, m; added to the clearance.
    """
    active = []
    for number, area in enumerate(areas):
        for first, last in level_times(area, flight, unknown_climb):
            begin, end = max(first, 0.0), min(last, horizon)
            if begin > end:
                continue
            if not in_reach(area, own.x, own.y, fastest * end, end, margin):
                continue
            active.append(ActiveArea(number, area, begin, end))
    return tuple(active)


def in_reach(
    area: Area, x: Float[Array, ""], y: Float[Array, ""], far: float, end: float, margin: float
) -> bool:
    """Return whether an aircraft that flies so far, m, by some time, s, may come nearer to an area
    than its clearance and the margin, m; to one that must be kept in: always.
    """
    if area.keep is Keep.IN:
        return True
    away = float(signed_distance(area, x, y)) - area.clearance - margin
    return not away > far + (math.hypot(*area.velocity) + max(area.growth, 0.0)) * end


def label(active: ActiveArea) -> str:
    """Return what messages call an area, such as ``areas[2] (north field)``."""
    name = f" ({active.area.name})" if active.area.name else ""
    return f"areas[{active.number}]{name}"


def level_times(
    area: Area, flight: Sequence[Line], unknown_climb: float
) -> list[tuple[float, float]]:
    """Return the times in which an area counts, s after the request, in order."""
    if not flight:
        return [(area.valid_from, area.valid_until)]
    return union(
        (max(begin, line.begin), min(end, line.end))
        for line in flight
        for begin, end in (window(area, line.altitude, unknown_climb),)
    )


def window(area: Area, altitude: Altitude | None, unknown_climb: float) -> tuple[float, float]:
    """Return from when and until when an area counts, s after the request; the first is greater
    where it never does.
    """
    begin, end = area.valid_from, area.valid_until
    if altitude is None or area.keep is Keep.IN:
        return begin, end
    for level, side in ((area.floor, 1.0), (area.ceiling, -1.0)):
        if level is not None and level.reference == altitude.reference:
            first, last = _beyond(level, altitude, side, unknown_climb)
            begin, end = max(begin, first), min(end, last)
    return begin, end


def _beyond(
    level: Level, altitude: Altitude, side: float, unknown_climb: float
) -> tuple[float, float]:
    """Return when an aircraft may be above a level (side 1) or below it (side -1), s."""
    gap = side * (altitude.value - level.value) + altitude.error
    climb, spread = altitude.climb(unknown_climb)
    rate = side * climb + spread
    if rate == 0.0:
        return (-math.inf, math.inf) if gap >= 0.0 else (math.inf, -math.inf)
    if rate > 0.0:  # time before the request does not matter
        return (-math.inf if gap >= 0.0 else -gap / rate), math.inf
    return (-math.inf, gap / -rate) if gap >= 0.0 else (math.inf, -math.inf)


def required_distances(
    active: ActiveArea, x: Float[Array, " N"], y: Float[Array, " N"], margin: float
) -> Float[Array, " N"]:
    """Return the signed distance that plans which begin at places ``[N]`` must keep, m."""
    usual = active.area.clearance + margin
    if active.begin > 0.0:
        return np.full(np.shape(x), usual)
    at_x, at_y = np.ravel(x), np.ravel(y)
    if at_x.size and (at_x == at_x[0]).all() and (at_y == at_y[0]).all():
        # The manoeuvres of one request begin at the same place, and it is asked for many times.
        away = np.full(np.shape(x), _distance_at(active.area, float(at_x[0]), float(at_y[0])))[()]
    else:
        away = signed_distance(active.area, x, y)
    return np.clip(away - NEARER, 0.0, usual)


@lru_cache(maxsize=256)
def _distance_at(area: Area, x: float, y: float) -> float:
    """Return the signed distance of one place, m."""
    return float(signed_distance(area, x, y))


@lru_cache(maxsize=64)
def flat_areas(areas: tuple[ActiveArea, ...]) -> tuple[Array, Array]:
    """Return areas and their edges as compiled code takes them, without what is required, which
    differs between trajectories; neither is to be written to.
    """
    begin, end = ([getattr(active, name) for active in areas] for name in ("begin", "end"))
    return flat([active.area for active in areas], begin, end, np.zeros(len(areas)))


def _calls(flown: Trajectory[Any], areas: Array) -> Iterator[tuple[Span, Span]]:
    """Give the trajectories and the areas of each call of compiled code."""
    rows, legs = flown.sagitta.shape
    edges = np.maximum(areas["end_edge"] - areas["first_edge"], 1.0) * legs
    count = len(areas)
    together = edges.sum() <= _EDGES
    for numbers in [(0, count)] if together else [(k, k + 1) for k in range(count)]:
        step = max(int(_EDGES / edges[slice(*numbers)].sum()), 1)
        for first in range(0, rows, step):
            yield (first, min(first + step, rows)), numbers


def _counts(active: ActiveArea, pieces: Pieces) -> Array:
    """Return in which pieces an area counts, bool ``[M, P]``."""
    return (pieces.end > 0.0) & (pieces.end >= active.begin) & (pieces.begin <= active.end)


def _bound_area(active: ActiveArea, pieces: Pieces, required: Array) -> tuple[Array, Array, Array]:
    """Return a lower bound of the signed distance of pieces from an area, m, the least value that
    is known to occur, m, and where the area counts, ``[M, P]`` each; only pieces that the rectangle
    about the area does not tell to be far are set against its edges.
    """
    counts = near = _counts(active, pieces)
    bound, attained = np.full((2, *counts.shape), np.inf)
    if active.area.keep is Keep.OUT:
        bound = far = _far_bound(active.area, pieces)
        near = counts & ~(far > required)
    m, p = np.nonzero(near)
    chord = Chords(
        *(np.broadcast_to(field, near.shape)[m, p] for field in pieces[2:8]),
        *(np.broadcast_to(field, near.shape)[m, p] for field in (pieces.bend, pieces.error)),
    )
    bound[m, p], ends = bounds_of_chords(active.area, chord, required[m, p])
    # Where the area counts for a part of a piece only, its ends decide nothing.
    whole = (chord.begin >= active.begin) & (chord.end <= active.end)
    attained[m, p] = np.where(whole, ends, np.inf)
    return bound, attained, counts


class Chords(NamedTuple):
    """Pieces of trajectories as their chords; fields ``[M]``."""

    begin: Array  # s
    end: Array
    x0: Array  # where they begin, m
    y0: Array
    x1: Array  # where they end, m
    y1: Array
    bend: Array  # a bound of the acceleration, m/s^2
    error: Array  # of the positions, m


def bounds_of_chords(
    area: Area, chords: Chords, enough: Float[Array, " M"]
) -> tuple[Float[Array, " M"], Float[Array, " M"]]:
    """Return a lower bound of the signed distance on whole pieces ``[M]``, and the least of its
    values at their ends, m; bounds that are ``enough``, m, need not be better.
    """
    grown, lost, rate = _least_gain(area, chords), _chord_error(chords), gain(area)
    chord = chord_distances(area, _in_frame(area, chords), enough + lost - grown)
    ends = chord.begin + rate * chords.begin, chord.end + rate * chords.end
    return chord.bound + grown - lost, np.minimum(*ends)


def _less_tolerance(required: Array) -> Array:
    """Return the required distance less the tolerance, which is for the clearance: the area itself
    is kept but for rounding.
    """
    return np.maximum(required - CLOSE, -ROUNDING)


def _far_bound(area: Area, pieces: Pieces | Chords) -> Array:
    """Return a lower bound of the signed distance in pieces by the rectangle about an area to be
    kept out of, m; -inf where they may meet it: signed distances within it may be negative.
    """
    away = box_distance(area, _in_frame(area, pieces))
    away = np.where(away > 0.0, away, -np.inf)
    return away + _least_gain(area, pieces) - _chord_error(pieces)


def _in_frame(area: Area, pieces: Pieces | Chords) -> Parts:
    """Return chords where the area stands still."""
    return Parts(
        *own_frame(area, pieces.x0, pieces.y0, pieces.begin),
        *own_frame(area, pieces.x1, pieces.y1, pieces.end),
    )


def _least_gain(area: Area, pieces: Pieces | Chords) -> Array:
    """Return the least that the area's growth adds to signed distances within pieces, m."""
    return np.minimum(gain(area) * pieces.begin, gain(area) * pieces.end)


def _chord_error(pieces: Pieces | Chords) -> Array:
    """Return by how much the curve may be nearer than its chord as it is computed, m."""
    return 0.125 * pieces.bend * (pieces.end - pieces.begin) ** 2 + pieces.error
