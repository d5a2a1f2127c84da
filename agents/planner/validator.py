"""The validator: whether a plan, as published, keeps the limits and the separation.

It knows the published waypoints, the intruders and the requirement; it shares with the modules that
make plans nothing but the contract of the leg's curve (:mod:`envs.waypoints`). Its separation is a
proven lower bound: where two aircraft move on curves, the relative motion leaves the chord between
two times h apart by at most a h^2 / 8, a being the largest relative acceleration; parts of a leg
whose bound is not clear are cut into :data:`FINE`.
"""

from typing import Any, NamedTuple

import numpy as np

from agents.planner.separation import FINE, along, chords, growth, position_error_bound
from agents.planner.traffic import Requirement, Traffic, required
from envs.kinematics import Limits, VehicleState
from envs.trees import column, take
from envs.waypoints import ARCS, CLOSED, Knots, Legs, legs

TOLERANCE = Limits(1e-6, 1e-6, 1e-6, 1e-6, 1e-9)
"""By how much limits may be passed for rounding's sake (m/s, m/s^2, rad/s)."""

CLOSE = 1e-3
"""How much of the margin may be missing, m: a start inside it must keep its own distance exactly,
and the bound of a part that begins there may be smaller by the part's sagitta."""

ROUNDING = 1e-6
"""How much of the separation itself may be missing, m."""

LONGEST = 16_384.0
"""Time of a plan's last waypoint at most, s: so far the rounding of positions is bounded
(proofs/Rounding.g).
"""

CHECKS = ("not_finite", "times", "leg", "speed", "acceleration", "turn_rate", "separation")
"""What is checked, in the order of the findings' last axis; names of
:class:`agents.planner.answer.Kind`.
"""


class Findings(NamedTuple):
    """What is wrong with plans; arrays over ``[N]`` plans and C = ``len(CHECKS)`` checks."""

    wrong: Any  # bool, [N, C]
    leg: Any  # number of the first leg at fault, [N, C]; -1 where nothing is wrong
    time: Any  # when it begins to be wrong, s, [N, C]; nan where nothing is
    x: Any  # where that is, m, [N, C]
    y: Any
    intruder: Any  # number of the intruder that is too close first, [N]; -1 where none is
    # Smallest distance to any intruder, m, [N]; inf without any, nan if not finite. Never too
    # large; too small by at most 5 mm on legs of 20 s, and by what longer turns in longer legs add.
    min_separation: Any
    time_of_min_separation: Any  # s, [N]; nan without one
    # smallest distance less the required one at the time, m, [N]; negative where that check fails
    clearance: Any

    @property
    def safe(self) -> Any:
        """Whether nothing is wrong, ``[N]``."""
        return ~self.wrong.any(axis=-1)

    @property
    def legal(self) -> Any:
        """Whether nothing is wrong but the separation, ``[N]``."""
        return ~self.wrong[:, :-1].any(axis=-1)

    @classmethod
    def blank(cls, count: int) -> "Findings":
        """Return that nothing is wrong and no intruder seen, ``[count]``."""
        places = count, len(CHECKS)
        none, nan, inf = np.full(count, -1), np.full(count, np.nan), np.full(count, np.inf)
        time, x, y = (np.full(places, np.nan) for _ in range(3))
        return cls(
            np.zeros(places, dtype=bool),
            np.full(places, -1),
            time,
            x,
            y,
            none,
            inf,
            nan,
            inf.copy(),
        )

    @classmethod
    def empty(cls, count: int) -> "Findings":
        """Return the findings of plans that do not exist, ``[count]``: everything is wrong with
        them.
        """
        blank, nan = cls.blank(count), np.full(count, np.nan)
        return blank._replace(wrong=~blank.wrong, min_separation=nan, clearance=-blank.clearance)


def validate(
    knots: Knots,
    traffic: Traffic,
    requirement: Requirement,
    limits: Limits,
    curves: Legs | None = None,
) -> Findings:
    """Return what is wrong with plans; one whose knots are not finite or not in order is not judged
    further.

    Args:
        knots: state at the request and published waypoints, ``[N, W]``.
        traffic: the intruders at the request, ``[N, K]``.
        curves: the legs of the knots, if they are known already.
    """
    knots = Knots(*(np.asarray(field, dtype=float) for field in knots))
    count, points = knots.time.shape
    finite: Any = np.isfinite(np.stack(knots)).all(axis=0)
    ordered: Any = np.diff(knots.time, axis=-1) > 0.0
    sound = finite.all(axis=-1) & ordered.all(axis=-1)
    if curves is None or not sound.all():
        # Placeholders make the arrays whole; their rows are judged by what is wrong with them only.
        straight = np.arange(points) * 1.0
        filled = zip(knots, (straight, 0.0, 0.0, 1.0, straight), strict=True)
        curves = legs(Knots(*(np.where(sound[:, None], *pair) for pair in filled)))
    # Comparisons ask for what is right, so that not-a-number is wrong. A plan beyond a speed limit
    # may stay there, but not go further, nor come back to it: the bounds follow the most moderate
    # speed so far, not that of the arc before, or else the tolerance would add up from arc to arc.
    speed, after = (
        curves.speed,
        curves.speed + curves.acceleration * (curves.duration[..., None] / ARCS),
    )
    so_far = speed.reshape(count, (points - 1) * ARCS)
    lowest = np.minimum(limits.speed_min, np.maximum.accumulate(so_far, axis=-1)).reshape(
        speed.shape
    )
    highest = np.maximum(limits.speed_max, np.minimum.accumulate(so_far, axis=-1)).reshape(
        speed.shape
    )
    steady = (after >= lowest - TOLERANCE.speed_min) & (after <= highest + TOLERANCE.speed_max)
    # The bound on the own acceleration is one for flight forwards.
    steady &= (speed >= TOLERANCE.speed_min) & (after >= TOLERANCE.speed_min)
    gentle = (curves.acceleration >= limits.acceleration_min - TOLERANCE.acceleration_min) & (
        curves.acceleration <= limits.acceleration_max + TOLERANCE.acceleration_max
    )
    turning = np.abs(curves.yaw_rate) <= limits.yaw_rate_max + TOLERANCE.yaw_rate_max
    closed = curves.miss <= CLOSED
    found, both = Findings.blank(count), finite[:, 1:] & finite[:, :-1]
    kept = [
        field | ~sound[:, None]
        for field in (closed, steady.all(-1), gentle.all(-1), turning.all(-1))
    ]
    for check, right in enumerate(
        (both, (ordered & (knots.time[:, 1:] <= LONGEST)) | ~both, *kept)
    ):
        rows = np.flatnonzero(~right.all(axis=-1))
        if rows.size:
            first = np.argmin(right[rows], axis=-1)
            _place(
                found,
                check,
                rows,
                first,
                *(field[rows, first] for field in (knots.time, knots.x, knots.y)),
            )
    _separation(found, knots, curves, traffic, requirement, sound)
    return found


def _place(found: Findings, check: int, rows: Any, leg: Any, *place: Any) -> None:
    """Note where some plans first fail a check: the leg, the time (s) and the position (m), ``[m]``
    each.
    """
    found.wrong[rows, check], found.leg[rows, check] = True, leg
    found.time[rows, check], found.x[rows, check], found.y[rows, check] = place


def _separation(
    found: Findings,
    knots: Knots,
    curves: Legs,
    traffic: Traffic,
    requirement: Requirement,
    sound: Any,
) -> None:
    """Judge the separation from all intruders over the whole plan."""
    rows = np.flatnonzero(sound)
    found.min_separation[~sound], found.clearance[~sound] = np.nan, -np.inf
    if rows.size == 0 or traffic.mask.shape[-1] == 0:
        return
    own, seen = (curves, traffic) if sound.all() else take((curves, traffic), rows)
    base = required(seen, VehicleState(*(field[rows, 0] for field in knots[:4])), requirement)
    present = seen.mask

    # Arcs in one row: [n, A] with their ends, and against every intruder [n, A, K].
    step = own.duration[..., None] / ARCS
    begin = (own.time[..., None] + np.arange(ARCS) * step).reshape(rows.size, -1)
    length = np.broadcast_to(step, own.x.shape).reshape(rows.size, -1)
    x, y = own.x.reshape(rows.size, -1), own.y.reshape(rows.size, -1)
    # The curve ends where its last waypoint stands, but for less than CLOSED.
    end_x = np.concatenate([x[:, 1:], knots.x[rows, -1:]], axis=1)
    end_y = np.concatenate([y[:, 1:], knots.y[rows, -1:]], axis=1)
    quickest = np.maximum(own.speed, own.speed + own.acceleration * step)
    own_acceleration = np.hypot(own.acceleration, quickest * own.yaw_rate).reshape(rows.size, -1)
    other_acceleration = np.abs(seen.state.speed * seen.turn_rate)
    relative_acceleration = (
        own_acceleration[..., None]
        + np.where(seen.turn_time > 0.0, other_acceleration, 0.0)[:, None]
    )
    # The joints of the legs are up to their miss apart, and positions are known but for the rule's
    # error.
    position_error = np.repeat(own.miss + position_error_bound(own), ARCS, axis=1)[..., None]

    bound, upper = chords(begin, length, (x, y), (end_x, end_y), seen, relative_acceleration)
    bound = np.where(present[:, None], bound - position_error, np.inf)
    upper = np.where(present[:, None], upper, np.inf)
    need = base[:, None] + growth(seen, begin + length, requirement)
    # What could be too close, or the closest of all, is looked at more closely.
    nearest = np.min(upper, axis=(1, 2), keepdims=True)
    unclear = ~(bound >= need) | (bound <= nearest)
    clearance = np.where(unclear, np.inf, bound - need)
    found.clearance[rows] = np.minimum(found.clearance[rows], clearance.min(axis=(1, 2)))
    n, a, k = np.nonzero(unclear & present[:, None])
    if n.size == 0:
        return
    fine = length[n, a] / FINE
    began = begin[n, a, None] + np.arange(FINE) * fine[:, None]
    px, py, psi, v, omega, accel = (
        field.reshape(rows.size, -1)[n, a][:, None] for field in own[3:]
    )
    at_x, at_y = along(px, py, psi, v, omega, accel, fine[:, None])
    one = column(take(seen, (n, k)))
    finer = np.broadcast_to(fine[:, None], began.shape)
    begins, ends = (at_x[:, :-1], at_y[:, :-1]), (at_x[:, 1:], at_y[:, 1:])
    close, _ = chords(
        began, finer, begins, ends, one, relative_acceleration[n, a, k][:, None, None]
    )
    close = close[..., 0] - position_error[n, a]
    needed = base[n, k, None] + growth(one, began + finer, requirement)[..., 0]
    # The tolerance is for the margin; the separation itself is kept but for rounding.
    needed = np.maximum(needed - CLOSE, requirement.separation - ROUNDING)
    _note_fine(found, rows, (n, a, k), began, begins, close, needed)


def _note_fine(
    found: Findings, rows: Any, which: Any, began: Any, begins: Any, close: Any, needed: Any
) -> None:
    """Judge the parts ``[m, FINE]`` of what was not clear."""
    n, a, k = which
    clearance = close - needed
    # Per plan: the smallest distance, the smallest clearance, and the first part in which it is
    # negative.
    least = np.argmin(close, axis=1)
    np.minimum.at(found.clearance, rows[n], clearance.min(axis=1))
    value = np.take_along_axis(close, least[:, None], 1)[:, 0]
    when = np.take_along_axis(began, least[:, None], 1)[:, 0]
    owner, best = _leading(n, when, value)
    found.min_separation[rows[owner]], found.time_of_min_separation[rows[owner]] = (
        value[best],
        when[best],
    )

    bad = np.flatnonzero(~(clearance >= 0.0).all(axis=1))
    if bad.size:
        part = np.argmax(~(clearance[bad] >= 0.0), axis=1)
        when, x, y = (field[bad, part] for field in (began, *begins))
        owner, first = _leading(n[bad], when)
        _place(
            found,
            CHECKS.index("separation"),
            rows[owner],
            a[bad][first] // ARCS,
            when[first],
            x[first],
            y[first],
        )
        found.intruder[rows[owner]] = k[bad][first]


def _leading(owners: Any, *keys: Any) -> tuple[Any, Any]:
    """Return the owners that there are, and the place of the first of each by some keys, the last
    of them first.
    """
    order = np.lexsort((*keys, owners))
    owner, first = np.unique(owners[order], return_index=True)
    return owner, order[first]
