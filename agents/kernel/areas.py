"""Whether plans keep the clearance from areas: every curve, while the area counts.

An area counts while it is valid and the ownship may be level with it. As with the separation
(:mod:`agents.kernel.separation`), a part of a leg of length h leaves its chord by at most a h^2 /
8, so what :mod:`envs.area_geometry` says of the chord bounds the signed distance of the whole part
(theorem ``area_part_safe`` of proofs/Safe.v). Parts that are not clear are cut into
:data:`~agents.kernel.separation.FINE`.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agents.kernel.levels import Altitude
from agents.kernel.separation import (
    CLOSE,
    FINE,
    ROUNDING,
    Arcs,
    along,
    arcs_of,
    position_error_bound,
)
from envs.area_geometry import (
    Parts,
    box_distance,
    chord_distances,
    gain,
    own_frame,
    signed_distance,
)
from envs.areas import Area, Keep, Level
from envs.arrays import Array
from envs.frames import F
from envs.kinematics import VehicleState
from envs.trees import first_of_each, map_leaves, take
from envs.waypoints import ARCS, Legs, PlanStates

NEARER = 0.01
"""By how much a plan that begins inside the clearance may come nearer than it is, m: the first part
of a curve is bounded to some millimetres only.
"""


class Counted(NamedTuple):
    """An area that a plan may meet."""

    number: int  # its place in the request
    area: Area
    begin: float  # from when it counts, s after the request
    end: float  # until when


class AreaFindings(NamedTuple):
    """What plans keep of the clearance from areas; fields ``[N]``."""

    wrong: Array  # whether the clearance from some area is lost, bool
    area: Array  # number of the area of which it is lost first; -1 where it is kept
    leg: Array  # number of the leg on which that is; -1
    time: Array  # when it begins to be lost, s; nan
    until: Array  # from when on it is kept again, good to the length of an arc, s; nan
    x: Array  # where that is, m
    y: Array
    # Smallest signed distance less the required one, m; inf where no area counts. Never too large,
    # and negative exactly where something is wrong; elsewhere it may be too small by as much as
    # arcs and the area's rectangle are long.
    clearance: Array
    nearest: Array  # number of the area of which that is; -1
    time_of_clearance: Array  # when its part begins, s; nan

    @classmethod
    def blank(cls, count: int) -> "AreaFindings":
        """Return that no area counts, ``[count]``."""
        none, nan = np.full(count, -1), np.full(count, np.nan)
        return cls(
            wrong=np.zeros(count, dtype=bool),
            area=none,
            leg=none.copy(),
            time=nan,
            until=nan.copy(),
            x=nan.copy(),
            y=nan.copy(),
            clearance=np.full(count, np.inf),
            nearest=none.copy(),
            time_of_clearance=nan.copy(),
        )


class _Chords(NamedTuple):
    """The arcs of plans in a row, or parts of them, as their chords; fields ``[N, A]``."""

    begin: Array  # s after the request
    end: Array
    x0: Array  # where they begin, m
    y0: Array
    x1: Array  # where they end, m
    y1: Array
    acceleration: Array  # the largest on each, m/s^2
    error: Array  # of the positions, m


def relevant(
    areas: Sequence[Area],
    own: VehicleState[F],
    altitude: Altitude | None,
    *,
    fastest: float,
    horizon: float,
    unknown_climb: float,
    margin: float,
) -> tuple[Counted, ...]:
    """Return the areas that count within a horizon, and when.

    An area to be kept out of is left out where the ownship cannot reach its clearance and the
    margin in time (theorem ``area_out_of_reach`` of proofs/Safe.v).

    Args:
        own: state of the ownship at the request.
        altitude: its altitude; None: unknown, which counts as level with every area.
        fastest: highest speed over the ground of any plan, m/s.
        horizon: time of the last waypoint of any plan, s.
        unknown_climb: vertical speed either way where it is unknown, m/s.
        margin: what the follower leaves of the plan, m; added to the clearance.
    """
    found = []
    for number, area in enumerate(areas):
        begin, end = window(area, altitude, unknown_climb)
        begin, end = max(begin, 0.0), min(end, horizon)
        if begin > end:
            continue
        if not in_reach(area, own.x, own.y, fastest * end, end, margin):
            continue
        found.append(Counted(number, area, begin, end))
    return tuple(found)


def in_reach(area: Area, x: Array, y: Array, far: float, end: float, margin: float) -> bool:
    """Return whether an aircraft that flies so far, m, by some time, s, may come nearer to an area
    than its clearance and the margin, m; to one that must be kept in: always.
    """
    if area.keep is Keep.IN:
        return True
    away = float(signed_distance(area, x, y)) - area.clearance - margin
    return not away > far + (math.hypot(*area.velocity) + max(area.growth, 0.0)) * end


def label(one: Counted) -> str:
    """Return what messages call an area, such as ``areas[2] (north field)``."""
    name = f" ({one.area.name})" if one.area.name else ""
    return f"areas[{one.number}]{name}"


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


def judge(
    plan_states: PlanStates,
    curves: Legs,
    areas: Sequence[Counted],
    margin: float = 0.0,
    required: Sequence[Array] | None = None,
) -> AreaFindings:
    """Return whether every curve of plans keeps the clearance from every area that counts.

    A plan that begins nearer to an area than its clearance must not come nearer than it is, but for
    :data:`NEARER`; one that begins inside of what is forbidden keeps nothing.

    Args:
        plan_states: state at the request and published waypoints, ``[N, W]``, finite, in order of
            time.
        curves: their legs.
        areas: what counts.
        margin: what the follower leaves of the plan, m; added to the clearance.
        required: signed distances to be kept instead, from each area, m, ``[N]``.
    """
    found = AreaFindings.blank(len(plan_states.time))
    if not areas:
        return found
    arcs = _chords(plan_states, curves)
    for number, one in enumerate(areas):
        if required is None:
            need = required_distances(one, arcs.x0[:, 0], arcs.y0[:, 0], margin)
        else:
            need = required[number]
        _judge_area(found, one, arcs, curves, need)
    return found


def required_distances(one: Counted, x: Array, y: Array, margin: float) -> Array:
    """Return the signed distance that plans which begin at places ``[N]`` must keep, m."""
    wanted = np.full(np.shape(x), one.area.clearance + margin)
    if one.begin > 0.0:
        return wanted
    return np.clip(signed_distance(one.area, x, y) - NEARER, 0.0, wanted)


def _chords(plan_states: PlanStates, curves: Legs) -> _Chords:
    """Return the chords of all arcs of plans, ``[N, A]``."""
    rows = len(plan_states.time)
    step = curves.duration[..., None] / ARCS
    arcs = rows, curves.time.shape[1] * ARCS
    begin = (curves.time[..., None] + np.arange(ARCS) * step).reshape(arcs)
    x, y = curves.x.reshape(arcs), curves.y.reshape(arcs)
    quickest = np.maximum(curves.speed, curves.speed + curves.acceleration * step)
    acceleration = np.hypot(curves.acceleration, quickest * curves.yaw_rate)
    return _Chords(
        begin=begin,
        # The curve ends where its last waypoint stands, but for less than CLOSED.
        end=np.concatenate([begin[:, 1:], plan_states.time[:, -1:]], axis=1),
        x0=x,
        y0=y,
        x1=np.concatenate([x[:, 1:], plan_states.x[:, -1:]], axis=1),
        y1=np.concatenate([y[:, 1:], plan_states.y[:, -1:]], axis=1),
        acceleration=acceleration.reshape(arcs),
        error=np.repeat(curves.miss + position_error_bound(curves), ARCS, axis=1),
    )


def _judge_area(
    found: AreaFindings, one: Counted, arcs: _Chords, curves: Legs, need: Array
) -> None:
    """Judge all plans against one area, from which they must keep distances, m, ``[N]``."""
    near = (arcs.end >= one.begin) & (arcs.begin <= one.end)
    if one.area.keep is Keep.OUT:
        near = _judge_far_arcs(found, one, arcs, near, need)
    n, a = np.nonzero(near)
    if n.size == 0:
        return
    near_arcs, needed = take(arcs, (n, a)), need[n]
    bound, attained = _bounds(one.area, near_arcs, needed)
    # An arc with an end that is too near loses the clearance. To cut it would only tell the time
    # better, which matters for the first of each plan alone. Where the area counts for a part of an
    # arc only, its ends decide nothing.
    whole = (near_arcs.begin >= one.begin) & (near_arcs.end <= one.end)
    lost = np.flatnonzero(~(attained >= _required_less_tolerance(needed)) & whole)
    fine = ~(bound >= needed)
    fine[lost] = False
    fine[lost[np.unique(n[lost], return_index=True)[1]]] = True
    coarse = np.flatnonzero(~fine)
    begin = near_arcs.begin[coarse]
    _note_least(found, one, n[coarse], (bound - needed)[coarse], begin)
    late = lost[~fine[lost]]
    _note_lost(found, one, n[late], a[late] // ARCS, take(near_arcs, late))
    if fine.any():
        _judge_finely(found, one, arcs, curves, need, n[fine], a[fine])


def _judge_far_arcs(
    found: AreaFindings, one: Counted, arcs: _Chords, counts: Array, need: Array
) -> Array:
    """Note the clearance of arcs that the rectangle about an area tells to be far enough; return
    which of those that count it does not, bool ``[N, A]``.
    """
    away = box_distance(one.area, _in_frame(one.area, arcs))
    # Within the rectangle it says nothing: signed distances there may be negative.
    away = np.where(away > 0.0, away, -np.inf)
    far = away + _least_gain(one.area, arcs) - _chord_error(arcs)
    near = counts & ~(far > need[:, None])
    clearance = np.where(counts & ~near, far - need[:, None], np.inf)
    rows, least = np.arange(len(need)), np.argmin(clearance, axis=1)
    _note_least(found, one, rows, clearance[rows, least], arcs.begin[rows, least])
    return near


def _judge_finely(
    found: AreaFindings,
    one: Counted,
    arcs: _Chords,
    curves: Legs,
    need: Array,
    n: Array,
    a: Array,
) -> None:
    """Judge the parts of the arcs ``a`` of plans ``n``, ``[m]`` each, that were not clear as a
    whole.
    """
    duration = (arcs.end - arcs.begin)[n, a, None]
    flown = (field.reshape(len(need), -1)[n, a][:, None] for field in arcs_of(curves))
    x, y = along(Arcs(*flown), duration / FINE)
    time = arcs.begin[n, a, None] + np.arange(FINE + 1) * (duration / FINE)
    every = _Chords(
        begin=time[:, :-1],
        end=time[:, 1:],
        x0=x[:, :-1],
        y0=y[:, :-1],
        x1=x[:, 1:],
        y1=y[:, 1:],
        acceleration=arcs.acceleration[n, a, None],
        error=arcs.error[n, a, None],
    )
    counts = (every.end >= one.begin) & (every.begin <= one.end)
    parts, rows, legs = map_leaves(
        lambda field: np.broadcast_to(field, counts.shape)[counts],
        (every, n[:, None], a[:, None] // ARCS),
    )
    needed = _required_less_tolerance(need[rows])
    bound, _ = _bounds(one.area, parts, needed)
    _note_least(found, one, rows, bound - needed, parts.begin)
    bad = np.flatnonzero(~(bound >= needed))
    _note_lost(found, one, rows[bad], legs[bad], take(parts, bad))


def _required_less_tolerance(need: Array) -> Array:
    """Return the required distance less the tolerance, which is for the clearance: the area itself
    is kept but for rounding.
    """
    return np.maximum(need - CLOSE, -ROUNDING)


def _bounds(area: Area, arcs: _Chords, need: Array) -> tuple[Array, Array]:
    """Return a lower bound of the signed distance on whole arcs ``[M]``, and the least of its
    values at their ends, m.
    """
    grown, lost, rate = _least_gain(area, arcs), _chord_error(arcs), gain(area)
    chord = chord_distances(area, _in_frame(area, arcs), need + lost - grown)
    ends = chord.begin + rate * arcs.begin, chord.end + rate * arcs.end
    return chord.bound + grown - lost, np.minimum(*ends)


def _in_frame(area: Area, arcs: _Chords) -> Parts:
    """Return chords where the area stands still."""
    return Parts(
        *own_frame(area, arcs.x0, arcs.y0, arcs.begin), *own_frame(area, arcs.x1, arcs.y1, arcs.end)
    )


def _least_gain(area: Area, arcs: _Chords) -> Array:
    """Return the least that the area's growth adds to signed distances within arcs, m."""
    return np.minimum(gain(area) * arcs.begin, gain(area) * arcs.end)


def _chord_error(arcs: _Chords) -> Array:
    """Return by how much the curve may be nearer than its chord as it is computed, m."""
    return 0.125 * arcs.acceleration * (arcs.end - arcs.begin) ** 2 + arcs.error


def _note_least(
    found: AreaFindings, one: Counted, rows: Array, clearance: Array, begin: Array
) -> None:
    """Note the smallest clearance of parts ``[M]`` of plans numbered ``rows``, m, and when it is,
    s.
    """
    row, best = first_of_each(rows, clearance)
    less = clearance[best] < found.clearance[row]
    row, best = row[less], best[less]
    found.clearance[row], found.nearest[row] = clearance[best], one.number
    found.time_of_clearance[row] = begin[best]


def _note_lost(found: AreaFindings, one: Counted, rows: Array, legs: Array, parts: _Chords) -> None:
    """Note the first and the last of parts ``[M]`` of plans numbered ``rows`` that lose the
    clearance.
    """
    row, last = first_of_each(rows, -parts.end)
    found.until[row] = np.fmax(found.until[row], parts.end[last])
    row, first = first_of_each(rows, parts.begin)
    earlier = ~(found.time[row] <= parts.begin[first])
    row, first = row[earlier], first[earlier]
    found.wrong[row], found.area[row], found.leg[row] = True, one.number, legs[first]
    found.time[row] = parts.begin[first]
    found.x[row], found.y[row] = parts.x0[first], parts.y0[first]
