"""A second opinion on plans: their published legs integrated anew, and every intruder's distance
sampled.

Nothing of validator, rollout or tail is used, nor their kinematics: the contract of a leg
(:func:`envs.waypoints.legs`: constant yaw rate and acceleration on each of its arcs) is taken at
its word, integrated from its waypoint by Simpson's rule on steps of :data:`COARSE` s and 0.05 rad
at most, and must end at the next one. Where the distance to an intruder could be too small, by the
speeds of both alone, it is sampled every :data:`CLOSE` s at most.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from agents.planner.options import Options
from agents.planner.traffic import Requirement, Traffic
from envs.kinematics import Limits
from envs.trees import take
from envs.waypoints import ARCS, Legs, PlanStates, legs

__all__ = [
    "CHECKS",
    "CLOSE",
    "COARSE",
    "TOLERANCE",
    "Flown",
    "Route",
    "Verdict",
    "displacement",
    "fly",
    "growth",
    "required_distances",
    "resimulate",
]

COARSE = 0.5
CLOSE = 0.02
_TURN = 0.05  # rad in a step at most: there Simpson's rule is good to 3e-9 of the way

TOLERANCE = 1e-3
"""Of positions and distances, m."""

CHECKS = (
    "start",
    "not finite",
    "times",
    "last",
    "leg",
    "speed",
    "acceleration",
    "turn rate",
    "required",
    "separation",
)
"""``required``: closer than asked for; ``separation``: closer than the required separation."""

_EXACT = 1e-6  # tolerance of headings (rad), speeds (m/s) and controls
_ROWS = 128  # plans at a time


class Route(NamedTuple):
    """What the last waypoint is held against; fields ``[N]``, of points ``[N, R]``."""

    x: Any
    y: Any
    points: Any
    last: Any
    """Number of the point that ends the plan."""


class Flown(NamedTuple):
    """A plan in the air mass at sampled times; fields ``[S]``."""

    time: Any
    """s after the request."""
    place: Any
    """Complex, m."""
    heading: Any
    """rad."""
    speed: Any
    """m/s."""
    acceleration: Any
    """Along the path from then on, m/s^2."""
    turn_rate: Any
    """From then on, rad/s."""


class Verdict(NamedTuple):
    """What was found."""

    wrong: Any
    """bool, ``[C, N]`` over :data:`CHECKS`."""
    min_separation: Any
    """Smallest sampled distance to any intruder, m, ``[N]``; inf without any."""
    clearance: Any
    """Smallest sampled distance less the separation of the intruder, m, ``[N]``."""


def fly(plan_states: PlanStates) -> Flown:
    """Return a plan ``[W + 1]`` as it is flown, sampled every :data:`CLOSE` s at most."""
    curves = legs(PlanStates(*(field[None] for field in plan_states)))
    parts = []
    for leg in range(curves.duration.shape[1]):
        one = Legs(*(field[:, leg : leg + 1] for field in curves))
        begin = PlanStates(*(field[None, leg : leg + 1] for field in plan_states))
        step = math.ceil(float(one.duration.max()) / ARCS / CLOSE)
        flight = (field[0, 0] for field in _integrate(begin, one, step))
        controls = (np.repeat(field[0, 0], step) for field in (one.acceleration, one.yaw_rate))
        parts.append((*flight, *(np.append(field, field[-1]) for field in controls)))
    return Flown(*map(np.concatenate, zip(*parts, strict=True)))


def displacement(heading: Any, speed: Any, rate: Any, lasts: Any, time: Any) -> Any:
    """Return how far an aircraft gets that turns for a while and then flies straight on, complex m,
    ``[...]``.

    Args:
        heading: at the beginning, rad.
        speed: m/s.
        rate: of the turn, rad/s, positive to the left.
        lasts: how long it turns, s.
        time: s.
    """
    turning = np.minimum(time, lasts)
    angle = 1j * rate * turning
    small = np.abs(angle) < 1e-9
    # (e^z - 1) / z is the mean of the unit vector over the turn.
    mean = np.where(small, 1.0, np.expm1(np.where(small, 1.0, angle)) / np.where(small, 1.0, angle))
    return speed * np.exp(1j * heading) * (mean * turning + np.exp(angle) * (time - turning))


def growth(traffic: Traffic, time: Any, sigmas: float) -> Any:
    """Return what a growing uncertainty adds to the distance to keep, m; ``time`` broadcasts
    against ``[..., K]``.
    """
    first, later = (
        np.sqrt(traffic.position_std**2 + (traffic.velocity_std * t) ** 2)
        for t in (traffic.age, traffic.age + time)
    )
    return sigmas * (later - first)


def required_distances(own: Any, traffic: Traffic, requirement: Requirement) -> Any:
    """Return the distance to keep at the request, m, ``[N, K]``; ``own``: complex positions
    ``[N]``.
    """
    away = np.abs(traffic.state.x + 1j * traffic.state.y - own[:, None])
    std = np.hypot(traffic.position_std, traffic.velocity_std * traffic.age)
    least = least_of(traffic, requirement)
    wanted = least + requirement.margin + requirement.sigmas * std
    now: Any = True if traffic.window is None else traffic.window.begin <= 0.0
    return np.where((away < wanted) & now, np.maximum(away, least), wanted)


def least_of(traffic: Traffic, requirement: Requirement) -> Any:
    """Return the separation from each intruder, m, ``[..., K]``."""
    least = np.full(np.shape(traffic.mask), float(requirement.separation))
    if traffic.separation is not None:
        given = np.isfinite(traffic.separation)
        least[given] = traffic.separation[given]
    return least


def resimulate(
    plan_states: PlanStates,
    own: Any,
    traffic: Traffic,
    route: Route,
    options: Options,
    limits: Limits,
) -> Verdict:
    """Judge plans as published.

    Args:
        plan_states: the request and its waypoints, ``[N, W + 1]``.
        own: state at the request, fields ``[N]``.
        traffic: ``[N, K]``.
        route: what the last waypoint is held against.
        options: how plans had to be.
        limits: of the vehicle.
    """
    count = len(plan_states.time)
    far = np.full(count, np.inf)
    verdict = Verdict(np.zeros((len(CHECKS), count), dtype=bool), far, far.copy())
    for first in range(0, count, _ROWS):
        rows = np.arange(first, min(first + _ROWS, count))
        part = take((plan_states, own, traffic, route), rows)
        finite = np.isfinite(np.stack(part[0])).all(axis=(0, 2)) & (
            np.diff(part[0].time, axis=1) > 0.0
        ).all(axis=1)
        verdict.wrong[CHECKS.index("not finite"), rows[~finite]] = True
        rows, (plan_states_, own_, traffic_, route_) = rows[finite], take(part, finite)
        wrong, nearest, clearance = _judge(plan_states_, own_, traffic_, options, limits)
        wrong[CHECKS.index("last")] = _off_route(plan_states_, route_, options.extend_route)
        verdict.wrong[:, rows], verdict.min_separation[rows] = wrong, nearest
        verdict.clearance[rows] = clearance
    return verdict


def _off_route(plan_states: PlanStates, route: Route, extend: bool) -> Any:
    """Return where the last waypoint is none of the route's, ``[n]``."""
    number = np.arange(len(route.last))
    inside = (route.last >= 0) & (route.last < route.points)
    place = route.x + 1j * route.y
    last = plan_states.x[:, -1] + 1j * plan_states.y[:, -1]
    there = np.abs(place[number, np.where(inside, route.last, 0)] - last) <= TOLERANCE
    end, before = place[number, route.points - 1], place[number, route.points - 2]
    relative = (last - end) * np.conj((end - before) / np.abs(end - before))
    beyond = (
        (route.last >= route.points)
        & (relative.real > 0.0)
        & (np.abs(relative.imag) <= 0.01)
        & extend
    )
    return ~((inside & there) | beyond)


def _judge(
    plan_states: PlanStates, own: Any, traffic: Traffic, options: Options, limits: Limits
) -> tuple[Any, Any, Any]:
    """Return what is wrong, ``[C, n]``, the smallest distances, and the smallest distances less the
    separations, ``[n]``, of plans with increasing times.
    """
    count, requirement, fixed = len(plan_states.time), options.requirement, options.waypoints - 1
    wrong, nearest = np.zeros((len(CHECKS), count), dtype=bool), np.full(count, np.inf)
    clearance = nearest.copy()
    if count == 0:
        return wrong, nearest, clearance

    def note_wrong(name: str, where: Any) -> None:
        wrong[CHECKS.index(name)] |= where.reshape(count, -1).any(axis=1)

    for mine, given in zip(plan_states[:2], own[:2], strict=True):
        note_wrong("start", np.abs(mine[:, 0] - given) > TOLERANCE)
    note_wrong(
        "start", np.abs(np.exp(1j * plan_states.heading[:, 0]) - np.exp(1j * own[2])) > _EXACT
    )
    note_wrong("start", np.abs(plan_states.speed[:, 0] - own[3]) > _EXACT)
    note_wrong(
        "times", np.abs(plan_states.time[:, :-1] - options.interval * np.arange(fixed + 1)) > _EXACT
    )
    note_wrong("times", plan_states.time[:, -1:] <= options.interval * fixed)
    note_wrong("last", np.abs(plan_states.heading) > math.pi + _EXACT)
    curves = legs(plan_states)
    note_wrong("turn rate", np.abs(curves.yaw_rate) > limits.yaw_rate_max + _EXACT)
    note_wrong("acceleration", curves.acceleration > limits.acceleration_max + _EXACT)
    note_wrong("acceleration", curves.acceleration < limits.acceleration_min - _EXACT)
    need = required_distances(plan_states.x[:, 0] + 1j * plan_states.y[:, 0], traffic, requirement)
    # The last leg, which can take minutes, apart from the others.
    for part in (slice(0, fixed), slice(fixed, None)):
        one = Legs(*(field[:, part] for field in curves))
        begin = PlanStates(*(field[:, :-1][:, part] for field in plan_states))
        end = PlanStates(*(field[:, 1:][:, part] for field in plan_states))
        parts = one.duration[..., None] * np.maximum(1.0 / COARSE, np.abs(one.yaw_rate) / _TURN)
        step = math.ceil(np.max(parts) / ARCS)
        flight = _integrate(begin, one, step)
        final = tuple(field[:, :, -1] for field in flight)
        note_wrong("leg", np.abs(final[1] - end.x - 1j * end.y) > TOLERANCE)
        note_wrong("leg", np.abs(np.exp(1j * final[2]) - np.exp(1j * end.heading)) > _EXACT)
        note_wrong("leg", np.abs(final[3] - end.speed) > _EXACT)
        note_wrong("leg", np.abs(final[0] - end.time) > _EXACT)
        note_wrong(
            "speed",
            (flight[3] < limits.speed_min - _EXACT) | (flight[3] > limits.speed_max + _EXACT),
        )
        closest, short, spare = _distances(flight, one, step, traffic, need, requirement)
        nearest, clearance = np.minimum(nearest, closest), np.minimum(clearance, spare)
        note_wrong("required", short < -TOLERANCE)
        note_wrong("separation", spare < -TOLERANCE)
    return wrong, nearest, clearance


def _integrate(begin: PlanStates, curves: Legs, step: int) -> tuple[Any, Any, Any, Any]:
    """Return times, complex positions, headings and speeds along legs, ``[n, L, ARCS * step + 1]``
    each.
    """
    h = (curves.duration / (ARCS * step))[..., None]
    rate, gain = (
        np.repeat(field, step, axis=-1) for field in (curves.yaw_rate, curves.acceleration)
    )
    heading = begin.heading[..., None] + _running_sums(rate * h)
    speed = begin.speed[..., None] + _running_sums(gain * h)
    place = (begin.x + 1j * begin.y)[..., None] + _running_sums(
        _displacement(heading[..., :-1], speed[..., :-1], rate, gain, h)
    )
    time = begin.time[..., None] + h * np.arange(ARCS * step + 1)
    return time, place, heading, speed


def _displacement(heading: Any, speed: Any, rate: Any, gain: Any, h: Any) -> Any:
    """Return the displacement over a short time: Simpson's rule on the velocity, complex m."""
    first = speed * np.exp(1j * heading)
    middle = (speed + 0.5 * gain * h) * np.exp(1j * (heading + 0.5 * rate * h))
    last = (speed + gain * h) * np.exp(1j * (heading + rate * h))
    return h / 6.0 * (first + 4.0 * middle + last)


def _running_sums(parts: Any) -> Any:
    """Return the sums of none, one, two, ... of the parts along the last axis."""
    return np.concatenate([np.zeros((*parts.shape[:-1], 1)), np.cumsum(parts, axis=-1)], axis=-1)


def _distances(
    flight: Any, curves: Legs, step: int, traffic: Traffic, need: Any, requirement: Requirement
) -> tuple[Any, Any, Any]:
    """Return the smallest distance, m, the smallest of distance less the one to keep, and of
    distance less the separation, ``[n]`` each.
    """
    (count, crowd), sigmas = need.shape, requirement.sigmas
    nearest, short, spare = np.full((3, count), np.inf)
    state, least = traffic.state, least_of(traffic, requirement)
    time, place, heading, speed = flight
    rate, gain = (
        np.repeat(field, step, axis=-1) for field in (curves.yaw_rate, curves.acceleration)
    )
    h = np.broadcast_to((curves.duration / (ARCS * step))[..., None], rate.shape)
    for k in range(crowd):
        rows = np.flatnonzero(traffic.mask[:, k])
        if rows.size == 0:
            continue
        other = VehicleColumns(
            *(field[rows, k][:, None, None] for field in (*state, *traffic[2:7]))
        )
        first, last = ends_of(traffic, rows, k)
        level = (time[rows] >= first) & (time[rows] <= last)
        apart = np.where(level, np.abs(other.place(time[rows]) - place[rows]), np.inf)
        fast = np.maximum(speed[rows, :, 1:], speed[rows, :, :-1]) + other.speed
        # Nobody comes nearer between two samples than both fly in that time.
        there = np.abs(other.place(time[rows]) - place[rows])
        floor = 0.5 * (there[..., 1:] + there[..., :-1] - fast * h[rows])
        required_range = need[rows, k][:, None, None]
        later = required_range + other.uncertainty_at(time[rows], sigmas)
        nearest[rows] = np.minimum(nearest[rows], apart.min(axis=(1, 2)))
        short[rows] = np.minimum(short[rows], (apart - later).min(axis=(1, 2)))
        closest = apart.min(axis=(1, 2), keepdims=True)
        spare[rows] = np.minimum(spare[rows], closest[:, 0, 0] - least[rows, k])
        n, leg, part = np.nonzero((floor < later[..., 1:]) | (floor < closest))
        if n.size == 0:
            continue
        row = rows[n]
        pieces = math.ceil(float(np.max(h)) / CLOSE)
        seconds = h[row, leg, part][:, None] * np.linspace(0.0, 1.0, pieces + 1)
        one = VehicleColumns(*(field[n, 0] for field in other))
        here = row, leg, part
        psi, v, omega, accel = (field[here][:, None] for field in (heading, speed, rate, gain))
        between = place[here][:, None] + _displacement(psi, v, omega, accel, seconds)
        when = time[here][:, None] + seconds
        away = one.place(when) - between
        # Straight from sample to sample: at 20 m/s^2 that leaves the curve by 1 mm.
        chord = np.diff(away, axis=1)
        length = np.maximum(np.abs(chord) ** 2, 1e-12)
        share = np.clip(-(away[:, :-1] * np.conj(chord)).real / length, 0.0, 1.0)
        close = np.abs(away[:, :-1] + share * chord)
        first, last = (when_[n, 0] for when_ in ends_of(traffic, rows, k))
        close = np.where((when[:, :-1] >= first) & (when[:, 1:] <= last), close, np.inf)
        clearance = close - need[row, k][:, None] - one.uncertainty_at(when[:, :-1], sigmas)
        np.minimum.at(nearest, row, close.min(axis=1))
        np.minimum.at(short, row, clearance.min(axis=1))
        np.minimum.at(spare, row, close.min(axis=1) - least[row, k])
    return nearest, short, spare


def ends_of(traffic: Traffic, rows: Any, k: int) -> tuple[Any, Any]:
    """Return from when and until when one intruder of some plans counts, s, ``[n, 1, 1]`` each."""
    zero = np.zeros((len(rows), 1, 1))
    if traffic.window is None:
        return zero - np.inf, zero + np.inf
    begin, end = (field[rows, k][:, None, None] for field in traffic.window)
    return begin, end


class VehicleColumns(NamedTuple):
    """One intruder of each of several plans, ready to broadcast against times."""

    x: Any
    y: Any
    heading: Any
    speed: Any
    rate: Any
    lasts: Any
    position_std: Any
    velocity_std: Any
    age: Any

    def place(self, time: Any) -> Any:
        """Return complex positions, m."""
        return (
            self.x
            + 1j * self.y
            + displacement(self.heading, self.speed, self.rate, self.lasts, time)
        )

    def uncertainty_at(self, time: Any, sigmas: float) -> Any:
        """Return what the uncertainty adds to the distance to keep, m."""
        now, later = (
            np.hypot(self.position_std, self.velocity_std * (self.age + t)) for t in (0.0, time)
        )
        return sigmas * (later - now)
