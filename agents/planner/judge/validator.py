"""The validator: whether a plan, as published, keeps the limits and the separation.

It knows the published waypoints, the intruders and the requirement; it shares with the modules that
make plans nothing but the contract of the leg's curve (:mod:`envs.waypoints`). Its separation is a
proven lower bound: where two aircraft move on curves, the relative motion leaves the chord between
two times h apart by at most a h^2 / 8, a being the largest relative acceleration; parts of a leg
whose bound is not clear are cut into :data:`FINE`.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from agents.kernel.separation import (
    CLOSE,
    FINE,
    LONGEST,
    ROUNDING,
    Arcs,
    along,
    arcs_of,
    chords,
    distances,
    growth,
    position_error_bound,
)
from agents.kernel.traffic import Requirement, Traffic, requirement_of, separations, within_window
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import Limits, VehicleState
from envs.trees import column, first_of_each, map_leaves, take
from envs.waypoints import ARCS, CLOSED, Legs, PlanStates, legs

TOLERANCE = Limits(1e-6, 1e-6, 1e-6, 1e-6, 1e-9)
"""By how much limits may be passed for rounding's sake (m/s, m/s^2, rad/s)."""

_FEW = 4  # intruders whom it costs more to leave out than to look at
_BOUND_ERROR = 0.01  # m by which the bounds that leave legs out may be off: tolerance and rounding

CHECKS = ("not_finite", "times", "leg", "speed", "acceleration", "turn_rate", "separation", "area")
"""What is checked, in the order of the findings' last axis; names of
:class:`agents.planner.answer.Kind`. Areas are judged in :mod:`agents.kernel.areas`.
"""

_SEPARATION = CHECKS.index("separation")
_OF_FLIGHT = _SEPARATION  # so many checks are of the flight alone


class Findings(NamedTuple):
    """What is wrong with plans; arrays over ``[N]`` plans and C = ``len(CHECKS)`` checks."""

    wrong: Array  # bool, [N, C]
    leg: Array  # number of the first leg at fault, [N, C]; -1 where nothing is wrong
    time: Array  # when it begins to be wrong, s, [N, C]; nan where nothing is
    x: Array  # where that is, m, [N, C]
    y: Array
    intruder: Array  # number of the intruder that is too close first, [N]; -1 where none is
    area: Array  # number of the area whose clearance is lost first, [N]; -1 where none is
    # Smallest distance to any intruder, m, [N]; inf without any, nan if not finite. Never too
    # large; too small by at most 5 mm on legs of 20 s, and by what longer turns in longer legs add.
    min_separation: Array
    time_of_min_separation: Array  # s, [N]; nan without one
    # smallest distance to an intruder or an area less the required one at the time, m, [N];
    # negative where one of these checks fails
    clearance: Array

    @property
    def safe(self) -> Array:
        """Whether nothing is wrong, ``[N]``."""
        return ~self.wrong.any(axis=-1)

    @property
    def legal(self) -> Array:
        """Whether nothing is wrong but the distances to intruders and areas, ``[N]``."""
        return ~self.wrong[:, :_OF_FLIGHT].any(axis=-1)

    @classmethod
    def blank(cls, count: int) -> "Findings":
        """Return that nothing is wrong and no intruder seen, ``[count]``."""
        places = count, len(CHECKS)
        none, nan, inf = np.full(count, -1), np.full(count, np.nan), np.full(count, np.inf)
        time, x, y = (np.full(places, np.nan) for _ in range(3))
        return cls(
            wrong=np.zeros(places, dtype=bool),
            leg=np.full(places, -1),
            time=time,
            x=x,
            y=y,
            intruder=none,
            area=none.copy(),
            min_separation=inf,
            time_of_min_separation=nan,
            clearance=inf.copy(),
        )

    @classmethod
    def empty(cls, count: int) -> "Findings":
        """Return the findings of plans that do not exist, ``[count]``: everything is wrong with
        them.
        """
        blank, nan = cls.blank(count), np.full(count, np.nan)
        return blank._replace(wrong=~blank.wrong, min_separation=nan, clearance=-blank.clearance)


def validate(
    plan_states: PlanStates,
    traffic: Traffic,
    requirement: Requirement,
    limits: Limits,
    curves: Legs | None = None,
) -> Findings:
    """Return what is wrong with plans; one whose states are not finite or not in order of time is
    not judged further.

    Args:
        plan_states: state at the request and published waypoints, ``[N, W]``.
        traffic: the intruders at the request, ``[N, K]``.
        curves: the legs of the plan states, if they are known already.
    """
    plan_states = PlanStates(*(np.asarray(field, dtype=float) for field in plan_states))
    count, points = plan_states.time.shape
    finite: Array = np.isfinite(np.stack(plan_states)).all(axis=0)
    ordered: Array = np.diff(plan_states.time, axis=-1) > 0.0
    sound = finite.all(axis=-1) & ordered.all(axis=-1)
    if curves is None or not sound.all():
        # A flight to the east at 1 m/s in the place of others makes the arrays whole; those are
        # judged by what is wrong with them only.
        second = np.arange(points) * 1.0
        east = PlanStates(x=second, y=0.0, heading=0.0, speed=1.0, time=second)
        curves = legs(map_leaves(partial(np.where, sound[:, None]), plan_states, east))
    found, both = Findings.blank(count), finite[:, 1:] & finite[:, :-1]
    in_order = (ordered & (plan_states.time[:, 1:] <= LONGEST)) | ~both
    of_legs = [field | ~sound[:, None] for field in _right_legs(curves, limits)]
    # In the order of CHECKS.
    for check, right in enumerate((both, in_order, *of_legs)):
        if not right.all():
            rows = np.flatnonzero(~right.all(axis=-1))
            leg = np.argmin(right[rows], axis=-1)
            time, x, y = (
                field[rows, leg] for field in (plan_states.time, plan_states.x, plan_states.y)
            )
            _note_wrong(found, check, rows, leg, time, x, y)
    _judge_separation(found, plan_states, curves, traffic, requirement, sound)
    return found


def _right_legs(curves: Legs, limits: Limits) -> tuple[Array, Array, Array, Array]:
    """Return which legs end at their waypoints, and keep the limits of speed, of acceleration and
    of turn rate, bool ``[N, L]`` each.
    """
    # Comparisons ask for what is right, so that not-a-number is wrong. A plan beyond a speed limit
    # may stay there, but not go further, nor come back to it: the bounds follow the most moderate
    # speed so far, not that of the arc before, or else the tolerance would add up from arc to arc.
    speed = curves.speed
    after = speed + curves.acceleration * (curves.duration[..., None] / ARCS)
    count, leg_count, arcs = speed.shape
    so_far = speed.reshape(count, leg_count * arcs)
    lowest = np.minimum(limits.speed_min, np.maximum.accumulate(so_far, axis=-1))
    highest = np.maximum(limits.speed_max, np.minimum.accumulate(so_far, axis=-1))
    lowest, highest = lowest.reshape(speed.shape), highest.reshape(speed.shape)
    steady = (after >= lowest - TOLERANCE.speed_min) & (after <= highest + TOLERANCE.speed_max)
    # The bound on the own acceleration is one for flight forwards.
    steady &= (speed >= TOLERANCE.speed_min) & (after >= TOLERANCE.speed_min)
    gentle = (curves.acceleration >= limits.acceleration_min - TOLERANCE.acceleration_min) & (
        curves.acceleration <= limits.acceleration_max + TOLERANCE.acceleration_max
    )
    turning = np.abs(curves.yaw_rate) <= limits.yaw_rate_max + TOLERANCE.yaw_rate_max
    closed = curves.miss <= CLOSED
    return closed, steady.all(-1), gentle.all(-1), turning.all(-1)


def _note_wrong(
    found: Findings, check: int, rows: Array, leg: Array, time: Array, x: Array, y: Array
) -> None:
    """Note where plans numbered ``rows`` first fail a check: the leg, the time (s) and the place
    (m), ``[m]`` each.
    """
    found.wrong[rows, check], found.leg[rows, check] = True, leg
    found.time[rows, check], found.x[rows, check], found.y[rows, check] = time, x, y


def _judge_separation(
    found: Findings,
    plan_states: PlanStates,
    curves: Legs,
    traffic: Traffic,
    requirement: Requirement,
    sound: Array,
) -> None:
    """Judge the separation from all intruders over the whole of those plans that are sound.

    First which legs come near which intruders, then their arcs by one chord each, then the parts of
    those arcs that are not clear.
    """
    rows = np.flatnonzero(sound)
    found.min_separation[~sound], found.clearance[~sound] = np.nan, -np.inf
    if rows.size == 0 or traffic.mask.shape[-1] == 0:
        return
    own, seen = (curves, traffic) if sound.all() else take((curves, traffic), rows)
    starts: VehicleState[Air] = VehicleState(*(field[rows, 0] for field in plan_states[:4]))
    wanted = requirement_of(seen, starts, requirement)
    last = plan_states.x[rows, -1:], plan_states.y[rows, -1:]
    near = _near_legs(own, last, seen, wanted, requirement)
    if near is None:
        return
    unclear = _judge_arcs(found, rows, near, requirement)
    pair, arc = np.nonzero(unclear)
    if pair.size:
        _judge_parts(found, rows, near, pair, arc, requirement)


class _Near(NamedTuple):
    """Legs that come near an intruder, ``[p]``; fields of their arcs ``[p, ARCS]``."""

    n: Array  # number of the plan among those that are judged, [p]
    leg: Array  # number of the leg, [p]
    k: Array  # number of the intruder, [p]
    flown: Legs
    end_x: Array  # where each arc ends, m
    end_y: Array
    other: Traffic  # the intruder, [p, 1]
    begin: Array  # of each arc, s
    length: Array  # of each arc, s
    relative_acceleration: Array  # a bound in each arc, m/s^2
    error: Array  # by which positions may be off, m, [p, 1]
    wanted: Array  # distance before uncertainty grows, m, [p, 1]


def _near_legs(
    own: Legs, last: tuple[Array, Array], seen: Traffic, wanted: Array, requirement: Requirement
) -> _Near | None:
    """Return the legs of plans ``[n, L]`` that must be set against an intruder; None: there is no
    such leg.

    Args:
        own: the legs.
        last: where each plan's last waypoint stands, m, ``[n, 1]`` each.
        seen: the intruders, ``[n, K]``.
        wanted: distance from each before uncertainty grows, m, ``[n, K]``.
        requirement: how that grows.
    """
    # The joints of the legs are up to their miss apart, and positions are known but for the rule's
    # error.
    position_error = own.miss + position_error_bound(own)
    own_acceleration = _own_acceleration(own)
    must = _must_be_judged(own, seen, wanted, requirement, position_error, own_acceleration)
    n, leg, k = np.nonzero(must & seen.mask[:, None])
    if n.size == 0:
        return None
    flown = take(own, (n, leg))
    step = flown.duration / ARCS
    begin = flown.time[:, None] + np.arange(ARCS) * step[:, None]
    # The curve ends where its last waypoint stands, but for less than CLOSED.
    leg_end_x, leg_end_y = (
        np.concatenate([start[:, 1:, 0], end], axis=1)
        for start, end in zip((own.x, own.y), last, strict=True)
    )
    return _Near(
        n=n,
        leg=leg,
        k=k,
        flown=flown,
        end_x=np.concatenate([flown.x[:, 1:], leg_end_x[n, leg, None]], axis=1),
        end_y=np.concatenate([flown.y[:, 1:], leg_end_y[n, leg, None]], axis=1),
        other=column(take(seen, (n, k))),
        begin=begin,
        length=np.broadcast_to(step[:, None], begin.shape),
        relative_acceleration=own_acceleration[n, leg] + _acceleration(seen)[n, k, None],
        error=position_error[n, leg, None],
        wanted=wanted[n, k, None],
    )


def _judge_arcs(found: Findings, rows: Array, near: _Near, requirement: Requirement) -> Array:
    """Note the clearance of arcs, judged by their chords, that are clear; return which are not,
    bool ``[p, ARCS]``.
    """
    after = near.begin + near.length
    bound, upper = chords(
        near.begin,
        near.length,
        (near.flown.x, near.flown.y),
        (near.end_x, near.end_y),
        near.other,
        near.relative_acceleration[..., None],
    )
    bound, upper = bound[..., 0] - near.error, upper[..., 0]
    need = near.wanted + growth(near.other, after, requirement)[..., 0]
    counts = _counts(near.other, near.begin, after)
    if near.other.window is not None:
        upper = np.where(_inside(near.other, near.begin, after), upper, np.inf)
    # What could be too close, or the closest of all, is looked at more closely.
    nearest = np.full(rows.size, np.inf)
    np.minimum.at(nearest, near.n, upper.min(axis=1))
    unclear = (~(bound >= need) | (bound <= nearest[near.n, None])) & counts
    clearance = np.where(unclear | ~counts, np.inf, bound - need)
    np.minimum.at(found.clearance, rows[near.n], clearance.min(axis=1))
    return unclear


def _judge_parts(
    found: Findings, rows: Array, near: _Near, pair: Array, arc: Array, requirement: Requirement
) -> None:
    """Judge the parts of some arcs of near legs, ``[q]``, each by its chord."""
    # In the order of time, so that of equals the first is told.
    order = np.lexsort((near.k[pair], arc, near.leg[pair], near.n[pair]))
    pair, arc = pair[order], arc[order]
    fine = near.length[pair, arc] / FINE
    began = near.begin[pair, arc, None] + np.arange(FINE) * fine[:, None]
    arcs = Arcs(*(field[pair, arc, None] for field in arcs_of(near.flown)))
    at_x, at_y = along(arcs, fine[:, None])
    one = take(near.other, pair)
    finer = np.broadcast_to(fine[:, None], began.shape)
    begins, ends = (at_x[:, :-1], at_y[:, :-1]), (at_x[:, 1:], at_y[:, 1:])
    relative_acceleration = near.relative_acceleration[pair, arc, None, None]
    close, _ = chords(began, finer, begins, ends, one, relative_acceleration)
    close = close[..., 0] - near.error[pair]
    close = np.where(_counts(one, began, began + finer), close, np.inf)
    required = near.wanted[pair] + growth(one, began + finer, requirement)[..., 0]
    # The tolerance is for the margin; the separation itself is kept but for rounding.
    separation = separations(one, requirement)
    required = np.maximum(required - CLOSE, separation - ROUNDING)
    parts = _Parts(near.n[pair], near.leg[pair], near.k[pair], began, *begins, close, required)
    _note_parts(found, rows, parts)


def _counts(one: Traffic, begin: Array, end: Array) -> Array:
    """Return in which parts ``[p, A]`` an intruder each, ``[p, 1]``, may count, bool."""
    return np.broadcast_to(within_window(one, begin, end), np.shape(begin))


def _inside(one: Traffic, begin: Array, end: Array) -> Array:
    """Return in which parts ``[p, A]`` an intruder each, ``[p, 1]``, counts all the time, bool."""
    assert one.window is not None
    return (begin >= one.window.begin) & (end <= one.window.end)


def _own_acceleration(own: Legs) -> Array:
    """Return a bound of the acceleration in each arc, m/s^2, ``[n, L, ARCS]``."""
    step = own.duration[..., None] / ARCS
    quickest = np.maximum(own.speed, own.speed + own.acceleration * step)
    return np.hypot(own.acceleration, quickest * own.yaw_rate)


def _acceleration(seen: Traffic) -> Array:
    """Return a bound of the accelerations of intruders, m/s^2, ``[n, K]``."""
    return np.where(seen.turn_time > 0.0, np.abs(seen.state.speed * seen.turn_rate), 0.0)


def _must_be_judged(
    own: Legs,
    seen: Traffic,
    wanted: Array,
    requirement: Requirement,
    position_error: Array,
    own_acceleration: Array,
) -> Array:
    """Return which intruders the arcs of a leg must be set against, bool, ``[n, L, K]``; arguments
    are as of :func:`_near_legs`.

    In a leg two aircraft come nearer by what both fly at most (theorem ``left_out_soundly`` of
    proofs/Safe.v, arc by arc). A leg is left out only where that leaves more than what is required
    and more than the smallest distance and clearance of the plan, so that no finding depends on it.
    """
    counts, told = True, True
    if seen.window is not None:
        wide, begin = map_leaves(lambda field: field[:, None], seen), own.time[..., None]
        counts = within_window(wide, begin, begin + own.duration[..., None])
        told = within_window(wide, begin, begin)
    if seen.mask.shape[-1] <= _FEW:
        every = np.ones((*own.time.shape, seen.mask.shape[-1]), dtype=bool)
        return every & counts
    away = distances(own.time, own.x[..., 0], own.y[..., 0], seen)
    away = np.where(seen.mask[:, None], away, np.inf)
    quickest = np.maximum(own.speed, own.speed + own.acceleration * own.duration[..., None] / ARCS)
    both = quickest.max(axis=-1)[..., None] + seen.state.speed[:, None]
    bend = own_acceleration.max(axis=-1)[..., None] + _acceleration(seen)[:, None]
    step = own.duration[..., None]
    left = (
        away
        - both * step
        - 0.125 * bend * (step / ARCS) ** 2
        - position_error[..., None]
        - _BOUND_ERROR
    )
    now = wanted[:, None] + growth(seen, own.time, requirement)
    later = wanted[:, None] + growth(seen, own.time + own.duration, requirement)
    # Where an intruder does not count at the beginning of a leg, its distance there is no finding.
    away = np.where(told, away, np.inf)
    least, clearance = (np.min(each, axis=(1, 2), keepdims=True) for each in (away, away - now))
    return (
        (left <= np.maximum(later, least)) | (left - later <= clearance + _BOUND_ERROR)
    ) & counts


class _Parts(NamedTuple):
    """Parts of arcs that were not clear, ``[m, FINE]``."""

    n: Array  # number of the plan among those that are judged, [m]
    leg: Array  # number of the leg, [m]
    k: Array  # number of the intruder, [m]
    began: Array  # s
    x: Array  # of the ownship then, m
    y: Array
    close: Array  # least distance in the part, m
    required: Array  # m


def _note_parts(found: Findings, rows: Array, parts: _Parts) -> None:
    """Note of each plan the smallest distance, the smallest clearance, and the first part in which
    that is negative.
    """
    n, clearance = parts.n, parts.close - parts.required
    least = np.argmin(parts.close, axis=1)
    np.minimum.at(found.clearance, rows[n], clearance.min(axis=1))
    value = np.take_along_axis(parts.close, least[:, None], 1)[:, 0]
    when = np.take_along_axis(parts.began, least[:, None], 1)[:, 0]
    owner, best = first_of_each(n, when, value)
    found.min_separation[rows[owner]] = value[best]
    found.time_of_min_separation[rows[owner]] = when[best]

    bad = np.flatnonzero(~(clearance >= 0.0).all(axis=1))
    if bad.size:
        part = np.argmax(~(clearance[bad] >= 0.0), axis=1)
        when, x, y = (field[bad, part] for field in (parts.began, parts.x, parts.y))
        owner, first = first_of_each(n[bad], when)
        row, leg = rows[owner], parts.leg[bad][first]
        _note_wrong(found, _SEPARATION, row, leg, when[first], x[first], y[first])
        found.intruder[row] = parts.k[bad][first]
