"""The validator: whether a plan, as published, keeps the limits and the separation. It trusts nobody.

It knows the published waypoints, the intruders and the requirement; it shares with those who make plans nothing
but the contract of the leg's curve (:mod:`envs.waypoints`). Its separation is a proven lower bound: where two
aircraft move on curves, the relative motion leaves the chord between two times h apart by at most a h^2 / 8, a being
the largest relative acceleration; parts of a leg whose bound is not clear are cut into :data:`FINE`.
"""

from typing import Any, NamedTuple

import numpy as np

from agents.planner.traffic import Requirement, Traffic, required
from envs.kinematics import Limits
from envs.trees import mapped, take
from envs.waypoints import ARCS, CLOSED, Knots, Legs, legs

__all__ = ["CHECKS", "CLOSE", "FINE", "ROUNDING", "TOLERANCE", "Findings", "same_flight", "validate"]

FINE = 32
"""Parts into which an arc of a leg is cut where it matters: 0.06 s of a leg of 20 s, 4 mm of uncertainty."""

TOLERANCE = Limits(1e-6, 1e-6, 1e-6, 1e-6, 1e-9)
"""By how much limits may be passed for rounding's sake (m/s, m/s^2, rad/s)."""

CLOSE = 1e-3
"""How much of the margin may be missing, m: a start inside it owes its own distance exactly, and the bound of a part
that begins there may be smaller by the part's bow."""

ROUNDING = 1e-6
"""How much of the separation itself may be missing, m."""

_SAME_PLACE = 0.01  # m by which an intruder may leave its report's flight for rounding's sake

CHECKS = ("not_finite", "times", "leg", "speed", "acceleration", "turn_rate", "separation")
"""What is checked, in the order of the findings' first axis; names of :class:`agents.planner.answer.Kind`."""

_NODES = list(zip(*(part.tolist() for part in np.polynomial.legendre.leggauss(4)), strict=True))


class Findings(NamedTuple):
    """What is wrong with plans; arrays over ``[N]`` plans and C = ``len(CHECKS)`` checks."""

    wrong: Any
    """bool, ``[C, N]``."""
    leg: Any
    """Number of the first leg at fault, ``[C, N]``; -1 where nothing is wrong."""
    time: Any
    """When it begins to be wrong, s, ``[C, N]``; nan where nothing is."""
    x: Any
    """Where that is, m, ``[C, N]``."""
    y: Any
    intruder: Any
    """Number of the intruder that is too close first, ``[N]``; -1 where none is."""
    min_separation: Any
    """Smallest distance to any intruder, m, ``[N]``; inf without any, nan if not finite. Never too large; too small by
    at most 5 mm on legs of 20 s, and by what longer turns in longer legs add."""
    time_of_min_separation: Any
    """s, ``[N]``; nan without one."""
    clearance: Any
    """Smallest distance less the required one at the time, m, ``[N]``; negative exactly where that check fails."""

    @property
    def safe(self) -> Any:
        """Whether nothing is wrong, ``[N]``."""
        return ~self.wrong.any(axis=0)


def validate(
    knots: Knots, traffic: Traffic, requirement: Requirement, limits: Limits, curves: Legs | None = None
) -> Findings:
    """Check plans.

    Args:
        knots: state at the request and published waypoints, ``[N, W]``.
        traffic: the intruders at the request, ``[N, K]``.
        requirement: what distance to keep.
        limits: that every leg must obey.
        curves: the legs of the knots, if they are known already.

    Returns:
        What is wrong; a plan whose knots are not finite or not in order is not judged further.
    """
    knots = Knots(*(np.asarray(field, dtype=float) for field in knots))
    count, points = knots.time.shape
    finite: Any = np.isfinite(np.stack(knots)).all(axis=0)
    ordered: Any = np.diff(knots.time, axis=-1) > 0.0
    sound = finite.all(axis=-1) & ordered.all(axis=-1)
    if curves is None or not sound.all():
        # Placeholders keep the arrays whole; their rows are judged by what is wrong with them only.
        straight = np.arange(points) * 1.0
        usable = Knots(
            *(
                np.where(sound[:, None], field, filler)
                for field, filler in zip(knots, (straight, 0.0, 0.0, 1.0, straight), strict=True)
            )
        )
        curves = legs(usable)
    found = _Collector(count, points - 1, knots, curves)
    found.note(0, ~(finite[:, 1:] & finite[:, :-1]))
    found.note(1, ~ordered & finite[:, 1:] & finite[:, :-1])
    ok = sound[:, None]
    found.note(2, ~(curves.miss <= CLOSED) & ok)
    # Comparisons ask for what is right, so that not-a-number is wrong. Who is beyond a speed limit may stay there, but
    # not go further, nor come back to it: the bounds follow the most moderate speed so far, not that of the arc before,
    # or else the tolerance would add up from arc to arc.
    speed, after = curves.speed, curves.speed + _gain(curves)
    so_far = speed.reshape(count, (points - 1) * ARCS)
    lowest = np.minimum(limits.speed_min, np.maximum.accumulate(so_far, axis=-1)).reshape(speed.shape)
    highest = np.maximum(limits.speed_max, np.minimum.accumulate(so_far, axis=-1)).reshape(speed.shape)
    steady = (after >= lowest - TOLERANCE.speed_min) & (after <= highest + TOLERANCE.speed_max)
    found.note(3, ~steady.all(axis=-1) & ok)
    gentle = (curves.acceleration >= limits.acceleration_min - TOLERANCE.acceleration_min) & (
        curves.acceleration <= limits.acceleration_max + TOLERANCE.acceleration_max
    )
    found.note(4, ~gentle.all(axis=-1) & ok)
    turning = np.abs(curves.yaw_rate) <= limits.yaw_rate_max + TOLERANCE.yaw_rate_max
    found.note(5, ~turning.all(axis=-1) & ok)
    _separation(found, knots, curves, traffic, requirement, sound)
    return found.findings()


def same_flight(reports: Traffic, age: Any, traffic: Traffic) -> Any:
    """Return whether intruders as of the request fly on as their reports say, ``[N, K]``.

    They are looked at where they stand, half-way through the turn, at its end and long after it: two arcs of one rate
    through the same points are the same, two straight lines too.

    Args:
        reports: as of the reports' own times, ``[N, K]``.
        age: of the reports at the request, s, ``[N, K]``.
        traffic: what plans are made and checked with, as of the request, ``[N, K]``.
    """
    said, used = (mapped(np.ravel, given) for given in (reports, traffic))
    turn = used.turn_time[:, None]
    times = np.concatenate([turn * np.array([0.0, 0.5, 1.0]), turn + 500.0], axis=1)
    there, here = _flown(said, times + np.ravel(age)[:, None]), _flown(used, times)
    near = np.hypot(there[0] - here[0], there[1] - here[1]).max(axis=1) <= _SAME_PLACE
    alike = (used.turn_time == 0.0) | (said.turn_rate == used.turn_rate)
    return (near & alike & (said.mask == used.mask)).reshape(np.shape(age))


def _gain(curves: Legs) -> Any:
    return curves.acceleration * (curves.duration[..., None] / ARCS)


class _Collector:
    """Gathers what is wrong, the first time and place of each."""

    def __init__(self, count: int, legs: int, knots: Knots, curves: Legs) -> None:
        shape = (len(CHECKS), count)
        self.knots, self.curves = knots, curves
        self.wrong = np.zeros(shape, dtype=bool)
        self.leg = np.full(shape, -1)
        self.time, self.x, self.y = (np.full(shape, np.nan) for _ in range(3))
        self.intruder = np.full(count, -1)
        self.min_separation = np.full(count, np.inf)
        self.time_of_min = np.full(count, np.nan)
        self.clearance = np.full(count, np.inf)

    def note(self, check: int, wrong: Any) -> None:
        """Note the first leg ``[N, L]`` of each plan that fails a check."""
        rows = np.flatnonzero(wrong.any(axis=-1))
        if rows.size:
            first = np.argmax(wrong[rows], axis=-1)
            at = (field[rows, first] for field in (self.knots.time, self.knots.x, self.knots.y))
            self.place(check, rows, first, *at)

    def place(self, check: int, rows: Any, leg: Any, time: Any, x: Any, y: Any) -> None:
        self.wrong[check, rows], self.leg[check, rows] = True, leg
        self.time[check, rows], self.x[check, rows], self.y[check, rows] = time, x, y

    def findings(self) -> Findings:
        return Findings(
            self.wrong,
            self.leg,
            self.time,
            self.x,
            self.y,
            self.intruder,
            self.min_separation,
            self.time_of_min,
            self.clearance,
        )


def _separation(
    found: _Collector, knots: Knots, curves: Legs, traffic: Traffic, requirement: Requirement, sound: Any
) -> None:
    """Judge the separation from all intruders over the whole plan."""
    rows = np.flatnonzero(sound)
    found.min_separation[~sound] = np.nan
    found.clearance[~sound] = -np.inf
    if rows.size == 0 or traffic.mask.shape[-1] == 0:
        return
    own, seen = (curves, traffic) if sound.all() else take((curves, traffic), rows)
    start_x, start_y = knots.x[rows, 0, None], knots.y[rows, 0, None]
    now = np.hypot(seen.state.x - start_x, seen.state.y - start_y)
    base = required(seen, now, requirement)
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
    swerve = np.hypot(own.acceleration, quickest * own.yaw_rate).reshape(rows.size, -1)
    other_swerve = np.abs(seen.state.speed * seen.turn_rate)
    pull = swerve[..., None] + np.where(seen.turn_time > 0.0, other_swerve, 0.0)[:, None]
    # The joints of the legs are up to their miss apart.
    slip = np.repeat(own.miss, ARCS, axis=1)[..., None]

    bound, upper = _chords(begin, length, (x, y), (end_x, end_y), seen, pull)
    bound = np.where(present[:, None], bound - slip, np.inf)
    upper = np.where(present[:, None], upper, np.inf)
    need = base[:, None] + _growth(seen, begin + length, requirement)
    # What could be too close, or the closest of all, is looked at more closely.
    nearest = np.min(upper, axis=(1, 2), keepdims=True)
    unclear = ~(bound >= need) | (bound <= nearest)
    _note_clear(found, rows, bound, need, unclear)
    n, a, k = np.nonzero(unclear & present[:, None])
    if n.size == 0:
        return
    fine = length[n, a] / FINE
    began = begin[n, a, None] + np.arange(FINE) * fine[:, None]
    px, py, psi, v, omega, accel = (field.reshape(rows.size, -1)[n, a][:, None] for field in own[3:])
    at_x, at_y = _along(px, py, psi, v, omega, accel, fine[:, None])
    one = mapped(lambda field: field[n, k][:, None], seen)
    finer = np.broadcast_to(fine[:, None], began.shape)
    begins, ends = (at_x[:, :-1], at_y[:, :-1]), (at_x[:, 1:], at_y[:, 1:])
    close, _ = _chords(began, finer, begins, ends, one, pull[n, a, k][:, None, None])
    close = close[..., 0] - slip[n, a]
    owed = base[n, k, None] + _growth(one, began + finer, requirement)[..., 0]
    # The tolerance is for the margin; the separation itself is kept but for rounding.
    owed = np.maximum(owed - CLOSE, requirement.separation - ROUNDING)
    _note_fine(found, rows, (n, a, k), began, begins, close, owed)


def _note_clear(found: _Collector, rows: Any, bound: Any, need: Any, unclear: Any) -> None:
    """Take the clearance of what is clear from its bound."""
    spare = np.where(unclear, np.inf, bound - need)
    found.clearance[rows] = np.minimum(found.clearance[rows], spare.min(axis=(1, 2)))


def _note_fine(found: _Collector, rows: Any, which: Any, began: Any, begins: Any, close: Any, owed: Any) -> None:
    """Judge the parts ``[m, FINE]`` of what was not clear."""
    n, a, k = which
    spare = close - owed
    # Per plan: the smallest distance, the smallest clearance, and the first part in which it is negative.
    least = np.argmin(close, axis=1)
    np.minimum.at(found.clearance, rows[n], spare.min(axis=1))
    value = np.take_along_axis(close, least[:, None], 1)[:, 0]
    when = np.take_along_axis(began, least[:, None], 1)[:, 0]
    order = np.lexsort((when, value, n))
    owner, first = np.unique(n[order], return_index=True)
    best = order[first]
    found.min_separation[rows[owner]], found.time_of_min[rows[owner]] = value[best], when[best]

    bad = np.flatnonzero(~(spare >= 0.0).all(axis=1))
    if bad.size:
        part = np.argmax(~(spare[bad] >= 0.0), axis=1)
        when, x, y = (field[bad, part] for field in (began, *begins))
        order = np.lexsort((when, n[bad]))
        owner, first = np.unique(n[bad][order], return_index=True)
        first = order[first]
        found.place(CHECKS.index("separation"), rows[owner], a[bad][first] // ARCS, when[first], x[first], y[first])
        found.intruder[rows[owner]] = k[bad][first]


def _chords(
    begin: Any, length: Any, start: tuple[Any, Any], end: tuple[Any, Any], traffic: Traffic, pull: Any
) -> tuple[Any, Any]:
    """Return a lower bound and an attained value of the distance in each part, m, ``[n, A, K]``.

    Args:
        begin, length: of the parts, s, ``[n, A]``.
        start, end: own positions there, m, ``[n, A]`` each.
        traffic: ``[n, K]``.
        pull: largest relative acceleration, m/s^2, broadcasts against ``[n, A, K]``.
    """
    x0, y0 = _relative(start, begin, traffic)
    x1, y1 = _relative(end, begin + length, traffic)
    dx, dy = x1 - x0, y1 - y0
    s = np.clip(-(x0 * dx + y0 * dy) / np.maximum(dx * dx + dy * dy, 1e-12), 0.0, 1.0)
    near, first, last = (np.sqrt(x * x + y * y) for x, y in ((x0 + s * dx, y0 + s * dy), (x0, y0), (x1, y1)))
    # A share s of the part from its beginning, the motion leaves the chord by 4 bow s (1 - s) at most. Where the chord
    # is nearest at an end, from which the range opens by at least g s, the distance is smaller than there by at most
    # (4 bow - g)^2 / (16 bow).
    bow = np.maximum(pull * (0.125 * length[..., None] ** 2), 1e-12)
    opening = np.where(s <= 0.0, (x0 * dx + y0 * dy) / np.maximum(first, 1e-9), 0.0)
    opening = np.where(s >= 1.0, -(x1 * dx + y1 * dy) / np.maximum(last, 1e-9), opening)
    loss = np.maximum(4.0 * bow - np.maximum(opening, 0.0), 0.0) ** 2 / (16.0 * bow)
    return near - loss, np.minimum(first, last)


def _relative(own: tuple[Any, Any], time: Any, traffic: Traffic) -> tuple[Any, Any]:
    """Return the intruders' positions less the own ones, m, ``[n, A, K]``.

    Written anew and not taken from the planner's prediction: an intruder turns about its centre, then flies on.
    """
    heading, speed = traffic.state.heading[:, None], traffic.state.speed[:, None]
    t = time[..., None]
    x = traffic.state.x[:, None] + speed * np.cos(heading) * t
    y = traffic.state.y[:, None] + speed * np.sin(heading) * t
    # Only who turns is treated apart, so that nobody's rounding depends on who else is there.
    n, k = np.nonzero((np.abs(traffic.turn_rate) > 1e-9) & (traffic.turn_time > 0.0))
    if n.size:
        x[n, :, k], y[n, :, k] = _turning(take(traffic, (n, k)), time[n])
    return x - own[0][..., None], y - own[1][..., None]


def _flown(traffic: Traffic, time: Any) -> tuple[Any, Any]:
    """Return the positions of intruders ``[m]`` at times ``[m, A]``, m."""
    state = mapped(lambda field: field[:, None], traffic.state)
    x, y = (start + state.speed * part(state.heading) * time for start, part in ((state.x, np.cos), (state.y, np.sin)))
    turns = np.flatnonzero((np.abs(traffic.turn_rate) > 1e-9) & (traffic.turn_time > 0.0))
    x[turns], y[turns] = _turning(take(traffic, turns), time[turns])
    return x, y


def _turning(traffic: Traffic, time: Any) -> tuple[Any, Any]:
    """Return the positions of intruders ``[m]`` that turn about a centre and then fly on, at times ``[m, A]``."""
    one = mapped(lambda field: field[:, None], traffic)
    turning = np.minimum(time, one.turn_time)
    radius = one.state.speed / one.turn_rate
    before, after = one.state.heading, one.state.heading + one.turn_rate * turning
    straight = one.state.speed * (time - turning)
    x = one.state.x + radius * (np.sin(after) - np.sin(before)) + straight * np.cos(after)
    y = one.state.y + radius * (np.cos(before) - np.cos(after)) + straight * np.sin(after)
    return x, y


def _growth(traffic: Traffic, time: Any, requirement: Requirement) -> Any:
    """Return what uncertainty adds to the required distance by a time since the request, m, ``[n, A, K]``."""
    if not traffic.velocity_std.any():
        return np.zeros((1, 1, 1))
    first = traffic.position_std[:, None]
    spread = np.hypot(first, traffic.velocity_std[:, None] * time[..., None])
    return requirement.sigmas * (spread - first)


def _along(x: Any, y: Any, heading: Any, speed: Any, yaw_rate: Any, acceleration: Any, part: Any) -> tuple[Any, Any]:
    """Return positions on arcs ``[m, 1]`` after 0 to :data:`FINE` parts of some seconds: Gauss-Legendre's rule."""
    time = np.arange(FINE + 1) * part
    # Velocities as complex numbers: the course at a node of the rule turns by the same from part to part, and turning
    # it takes less than half the time of another sine and cosine. The error grows to some 1e-14.
    start = np.cos(heading) + 1j * np.sin(heading)
    moved: Any = np.zeros(time.shape, dtype=complex)
    for node, weight in _NODES:
        share = 0.5 * (1.0 + node)
        turn = yaw_rate * (share * part)
        turns = np.broadcast_to(np.cos(turn) + 1j * np.sin(turn), (len(time), FINE))
        courses = np.multiply.accumulate(np.concatenate([start, turns], axis=1), axis=1)
        moved += (speed + acceleration * (share * time)) * (0.5 * weight) * courses
    return x + moved.real * time, y + moved.imag * time
