"""A second opinion on plans: their published legs integrated anew, and every intruder's distance
sampled.

Nothing of validator, rollout or tail is used, nor their kinematics: the contract of a leg
(:func:`envs.waypoints.legs`: constant yaw rate and acceleration on each of its arcs) is taken at
its word, integrated from its waypoint by Simpson's rule on steps of :data:`COARSE` s and 0.05 rad
at most, and must end at the next one. Where the distance to an intruder could be too small, by the
speeds of both alone, it is sampled every :data:`CLOSE` s at most.
"""

import math
from typing import NamedTuple

import numpy as np

from agents.kernel.traffic import Requirement, Traffic
from agents.planner.request.options import Options
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import Limits, VehicleState
from envs.trees import take
from envs.waypoints import ARCS, Legs, PlanStates, legs

__all__ = [
    "CHECKS",
    "CLOSE",
    "COARSE",
    "TOLERANCE",
    "Flown",
    "Intruders",
    "Resimulation",
    "Route",
    "displacement",
    "fly",
    "required_distances",
    "resimulate",
    "separations",
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
    "heading",
)
"""``required``: closer than asked for; ``separation``: closer than the required separation;
``heading``: of a waypoint, outside -pi to pi.
"""

_EXACT = 1e-6  # tolerance of headings (rad), speeds (m/s) and controls
_ROWS = 128  # plans at a time


class Route(NamedTuple):
    """What the last waypoint is held against; fields ``[N]``, of points ``[N, R]``."""

    x: Array
    y: Array
    points: Array
    last: Array
    """Number of the point that ends the plan."""


class Flown(NamedTuple):
    """A plan in the air mass at sampled times; fields ``[S]``."""

    time: Array
    """s after the request."""
    place: Array
    """Complex, m."""
    heading: Array
    """rad."""
    speed: Array
    """m/s."""
    acceleration: Array
    """Along the path from then on, m/s^2."""
    turn_rate: Array
    """From then on, rad/s."""


class Resimulation(NamedTuple):
    """What was found."""

    wrong: Array
    """bool, ``[C, N]`` over :data:`CHECKS`."""
    min_separation: Array
    """Smallest sampled distance to any intruder, m, ``[N]``; inf without any."""
    clearance: Array
    """Smallest sampled distance less the separation of the intruder, m, ``[N]``."""

    @classmethod
    def blank(cls, count: int) -> "Resimulation":
        """Return the result of so many plans before anything is found, to be written into."""
        wrong = np.zeros((len(CHECKS), count), dtype=bool)
        return cls(wrong, np.full(count, np.inf), np.full(count, np.inf))

    def note(self, check: str, where: Array) -> None:
        """Note that a check fails, bool ``[N, ...]``."""
        self.wrong[CHECKS.index(check)] |= where.any(axis=tuple(range(1, where.ndim)))


def fly(plan_states: PlanStates[Air]) -> Flown:
    """Return a plan ``[W + 1]`` as it is flown, sampled every :data:`CLOSE` s at most."""
    curves = legs(take(plan_states, None))
    parts = []
    for leg in range(curves.duration.shape[1]):
        curve = take(curves, (slice(None), slice(leg, leg + 1)))
        begin = take(plan_states, (None, slice(leg, leg + 1)))
        steps = math.ceil(float(curve.duration.max()) / ARCS / CLOSE)
        samples = _integrate(begin, curve, steps)
        # What is flown from a sample on; the last one has that before it.
        controls = (
            np.append(field[0, 0], field[0, 0, -1])
            for field in (samples.acceleration, samples.turn_rate)
        )
        states = (
            field[0, 0] for field in (samples.time, samples.place, samples.heading, samples.speed)
        )
        parts.append(Flown(*states, *controls))
    return Flown(*map(np.concatenate, zip(*parts, strict=True)))


def displacement(heading: Array, speed: Array, rate: Array, lasts: Array, time: Array) -> Array:
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


def required_distances(own: Array, traffic: Traffic, requirement: Requirement) -> Array:
    """Return the distance to keep at the request, m, ``[N, K]``; ``own``: complex positions
    ``[N]``.
    """
    away = np.abs(traffic.state.x + 1j * traffic.state.y - own[:, None])
    std = np.hypot(traffic.position_std, traffic.velocity_std * traffic.age)
    least = separations(traffic, requirement)
    required = least + requirement.margin + requirement.sigmas * std
    counts = np.array(True) if traffic.window is None else traffic.window.begin <= 0.0
    return np.where((away < required) & counts, np.maximum(away, least), required)


def separations(traffic: Traffic, requirement: Requirement) -> Array:
    """Return the separation from each intruder, m, ``[..., K]``."""
    least = np.full(np.shape(traffic.mask), float(requirement.separation))
    if traffic.separation is not None:
        has_own = np.isfinite(traffic.separation)
        least[has_own] = traffic.separation[has_own]
    return least


def resimulate(
    plan_states: PlanStates[Air],
    own: VehicleState[Air],
    traffic: Traffic,
    route: Route,
    options: Options,
    limits: Limits,
) -> Resimulation:
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
    result = Resimulation.blank(count)
    for first in range(0, count, _ROWS):
        rows = np.arange(first, min(first + _ROWS, count))
        finite = _is_finite(take(plan_states, rows))
        result.wrong[CHECKS.index("not finite"), rows[~finite]] = True
        rows = rows[finite]
        plans, own_, traffic_, route_ = take((plan_states, own, traffic, route), rows)
        part = _judge(plans, own_, traffic_, options, limits)
        part.note("last", _off_route(plans, route_, options.extend_route))
        result.wrong[:, rows] |= part.wrong
        result.min_separation[rows] = part.min_separation
        result.clearance[rows] = part.clearance
    return result


def _is_finite(plan_states: PlanStates[Air]) -> Array:
    """Return which plans ``[n, W + 1]`` have finite states and increasing times, ``[n]``."""
    finite = np.isfinite(np.stack(plan_states)).all(axis=(0, 2))
    return finite & (np.diff(plan_states.time, axis=1) > 0.0).all(axis=1)


def _off_route(plan_states: PlanStates[Air], route: Route, extend: bool) -> Array:
    """Return where the last waypoint is none of the route's, ``[n]``; ``extend``: beyond its end
    is right too.
    """
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
    plan_states: PlanStates[Air],
    own: VehicleState[Air],
    traffic: Traffic,
    options: Options,
    limits: Limits,
) -> Resimulation:
    """Judge finite plans with increasing times, but for the route."""
    result = Resimulation.blank(len(plan_states.time))
    if len(plan_states.time) == 0:
        return result
    _judge_waypoints(result, plan_states, own, options)
    curves = legs(plan_states)
    _judge_controls(result, curves, limits)
    begin, end = take(plan_states, np.s_[:, :-1]), take(plan_states, np.s_[:, 1:])
    place = plan_states.x[:, 0] + 1j * plan_states.y[:, 0]
    required = required_distances(place, traffic, options.requirement)
    # The last leg, which can take minutes, apart from the others.
    last = options.waypoints - 1
    for part in (slice(0, last), slice(last, None)):
        begin_, end_, curves_ = take((begin, end, curves), np.s_[:, part])
        samples = _integrate(begin_, curves_, _steps_of_arc(curves_))
        _judge_flight(result, samples, end_, limits)
        _judge_distances(result, samples, traffic, required, options.requirement)
    return result


def _judge_waypoints(
    result: Resimulation, plan_states: PlanStates[Air], own: VehicleState[Air], options: Options
) -> None:
    """Judge where plans begin, the times of their waypoints, and the range of headings."""
    begin, end = take(plan_states, np.s_[:, 0]), take(plan_states, np.s_[:, -1])
    result.note("start", np.abs(begin.x - own.x) > TOLERANCE)
    result.note("start", np.abs(begin.y - own.y) > TOLERANCE)
    turn = np.abs(np.exp(1j * begin.heading) - np.exp(1j * own.heading))
    result.note("start", turn > _EXACT)
    result.note("start", np.abs(begin.speed - own.speed) > _EXACT)
    last = options.waypoints - 1
    late = plan_states.time[:, :-1] - options.interval * np.arange(last + 1)
    result.note("times", np.abs(late) > _EXACT)
    result.note("times", end.time <= options.interval * last)
    result.note("heading", np.abs(plan_states.heading[:, 1:]) > math.pi + _EXACT)


def _judge_controls(result: Resimulation, curves: Legs[Air], limits: Limits) -> None:
    """Judge turn rates and accelerations of the legs."""
    result.note("turn rate", np.abs(curves.yaw_rate) > limits.yaw_rate_max + _EXACT)
    result.note("acceleration", curves.acceleration > limits.acceleration_max + _EXACT)
    result.note("acceleration", curves.acceleration < limits.acceleration_min - _EXACT)


class _Samples(NamedTuple):
    """Legs as they are flown, sampled in time.

    States ``[n, L, S + 1]``; of what is flown between two of them ``[n, L, S]``.
    """

    time: Array
    """s after the request."""
    place: Array
    """Complex, m."""
    heading: Array
    speed: Array
    turn_rate: Array
    acceleration: Array
    seconds: Array
    """From one to the next."""


def _steps_of_arc(curves: Legs[Air]) -> int:
    """Return in how many steps an arc is integrated, so that none is too long or turns too far."""
    steps = np.maximum(1.0 / COARSE, np.abs(curves.yaw_rate) / _TURN)  # a second
    return math.ceil(np.max(curves.duration[..., None] * steps) / ARCS)


def _integrate(begin: PlanStates[Air], curves: Legs[Air], steps: int) -> _Samples:
    """Fly legs ``[n, L]`` from where they begin, each of their arcs in so many steps."""
    seconds = (curves.duration / (ARCS * steps))[..., None]
    rate, gain = (
        np.repeat(field, steps, axis=-1) for field in (curves.yaw_rate, curves.acceleration)
    )
    heading = begin.heading[..., None] + _running_sums(rate * seconds)
    speed = begin.speed[..., None] + _running_sums(gain * seconds)
    moves = _displacement(heading[..., :-1], speed[..., :-1], rate, gain, seconds)
    return _Samples(
        time=begin.time[..., None] + seconds * np.arange(ARCS * steps + 1),
        place=(begin.x + 1j * begin.y)[..., None] + _running_sums(moves),
        heading=heading,
        speed=speed,
        turn_rate=rate,
        acceleration=gain,
        seconds=np.broadcast_to(seconds, rate.shape),
    )


def _judge_flight(
    result: Resimulation, samples: _Samples, end: PlanStates[Air], limits: Limits
) -> None:
    """Judge whether legs end at their waypoints ``[n, L]``, and the speeds on them."""
    final = _Samples(*(field[..., -1] for field in samples))
    result.note("leg", np.abs(final.place - end.x - 1j * end.y) > TOLERANCE)
    turn = np.abs(np.exp(1j * final.heading) - np.exp(1j * end.heading))
    result.note("leg", turn > _EXACT)
    result.note("leg", np.abs(final.speed - end.speed) > _EXACT)
    result.note("leg", np.abs(final.time - end.time) > _EXACT)
    result.note("speed", samples.speed < limits.speed_min - _EXACT)
    result.note("speed", samples.speed > limits.speed_max + _EXACT)


def _displacement(heading: Array, speed: Array, rate: Array, gain: Array, seconds: Array) -> Array:
    """Return the displacement over a short time: Simpson's rule on the velocity, complex m."""
    first = speed * np.exp(1j * heading)
    middle = (speed + 0.5 * gain * seconds) * np.exp(1j * (heading + 0.5 * rate * seconds))
    last = (speed + gain * seconds) * np.exp(1j * (heading + rate * seconds))
    return seconds / 6.0 * (first + 4.0 * middle + last)


def _running_sums(parts: Array) -> Array:
    """Return the sums of none, one, two, ... of the parts along the last axis."""
    return np.concatenate([np.zeros((*parts.shape[:-1], 1)), np.cumsum(parts, axis=-1)], axis=-1)


class Intruders(NamedTuple):
    """Intruders whose fields broadcast against times."""

    x: Array
    y: Array
    heading: Array
    speed: Array
    turn_rate: Array
    turn_time: Array
    """How long they turn, s."""
    position_std: Array
    velocity_std: Array
    age: Array
    """Of the reports at the request, s."""

    @classmethod
    def of(cls, traffic: Traffic) -> "Intruders":
        """Return the intruders of some traffic, fields ``[..., K]``."""
        return cls(
            *traffic.state,
            traffic.turn_rate,
            traffic.turn_time,
            traffic.position_std,
            traffic.velocity_std,
            traffic.age,
        )

    def place(self, time: Array) -> Array:
        """Return complex positions, m."""
        return (
            self.x
            + 1j * self.y
            + displacement(self.heading, self.speed, self.turn_rate, self.turn_time, time)
        )

    def uncertainty_at(self, time: Array, sigmas: float) -> Array:
        """Return what the uncertainty adds to the distance to keep, m."""
        at_request, later = (
            np.hypot(self.position_std, self.velocity_std * (self.age + t)) for t in (0.0, time)
        )
        return sigmas * (later - at_request)


class _Pairs(NamedTuple):
    """Some plans and one intruder of each; fields ``[n]``, of the intruder ``[n, 1, 1]``."""

    samples: _Samples
    intruder: Intruders
    begin: Array
    """From when the intruder counts, s, ``[n, 1, 1]``."""
    end: Array
    """Until when, s, ``[n, 1, 1]``."""
    required: Array
    """Distance to keep at the request, m."""
    separation: Array
    """Required all the time, m."""


class _Nearest(NamedTuple):
    """How near pairs come, m; fields ``[n]``."""

    distance: Array
    beyond_required: Array
    """The smallest of distance less the one to keep."""
    beyond_separation: Array
    """The smallest of distance less the separation."""


def _judge_distances(
    result: Resimulation,
    samples: _Samples,
    traffic: Traffic,
    required: Array,
    requirement: Requirement,
) -> None:
    """Judge the distances to the intruders, required at the request ``[n, K]``."""
    least = separations(traffic, requirement)
    others = Intruders.of(traffic)
    longest = float(np.max(samples.seconds))
    for k in range(required.shape[1]):
        rows = np.flatnonzero(traffic.mask[:, k])
        if rows.size == 0:
            continue
        begin, end = _window(traffic, rows, k)
        pairs = _Pairs(
            samples=take(samples, rows),
            intruder=Intruders(*(field[rows, k][:, None, None] for field in others)),
            begin=begin,
            end=end,
            required=required[rows, k],
            separation=least[rows, k],
        )
        near = _nearest(pairs, requirement.sigmas, longest)
        result.min_separation[rows] = np.minimum(result.min_separation[rows], near.distance)
        result.clearance[rows] = np.minimum(result.clearance[rows], near.beyond_separation)
        checks = CHECKS.index("required"), CHECKS.index("separation")
        beyond = near.beyond_required, near.beyond_separation
        for check, distance in zip(checks, beyond, strict=True):
            result.wrong[check, rows] |= distance < -TOLERANCE


def _window(traffic: Traffic, rows: Array, k: int) -> tuple[Array, Array]:
    """Return from when and until when one intruder of some plans counts, s, ``[n, 1, 1]`` each."""
    if traffic.window is None:
        zero = np.zeros((len(rows), 1, 1))
        return zero - np.inf, zero + np.inf
    begin, end = (field[rows, k][:, None, None] for field in traffic.window)
    return begin, end


def _nearest(pairs: _Pairs, sigmas: float, longest: float) -> _Nearest:
    """Return how near pairs come: at the samples, and in between wherever that could be nearer.

    Args:
        pairs: plans and intruders.
        sigmas: of their positions that are kept.
        longest: time between two samples, s, of any plan.
    """
    samples, intruder = pairs.samples, pairs.intruder
    away = np.abs(intruder.place(samples.time) - samples.place)
    counts = (samples.time >= pairs.begin) & (samples.time <= pairs.end)
    apart = np.where(counts, away, np.inf)
    later = pairs.required[:, None, None] + intruder.uncertainty_at(samples.time, sigmas)
    closest = apart.min(axis=(1, 2), keepdims=True)
    near = _Nearest(
        closest[:, 0, 0],
        (apart - later).min(axis=(1, 2)),
        closest[:, 0, 0] - pairs.separation,
    )
    # Nothing comes nearer between two samples than both fly in that time.
    fast = np.maximum(samples.speed[..., 1:], samples.speed[..., :-1]) + intruder.speed
    floor = 0.5 * (away[..., 1:] + away[..., :-1] - fast * samples.seconds)
    places = np.nonzero((floor < later[..., 1:]) | (floor < closest))
    if places[0].size:
        _look_between(near, pairs, places, sigmas, math.ceil(longest / CLOSE))
    return near


def _look_between(
    near: _Nearest, pairs: _Pairs, places: tuple[Array, ...], sigmas: float, pieces: int
) -> None:
    """Sample what is flown between some samples, and lower how near the pairs come.

    Args:
        near: what is known of the pairs so far.
        pairs: plans and intruders.
        places: pair, leg and number of the sample before, ``[m]`` each.
        sigmas: of the intruders' positions that are kept.
        pieces: into which each is cut.
    """
    pair = places[0]
    samples = _Samples(*(field[places][:, None] for field in pairs.samples))
    intruder = Intruders(*(field[pair, 0] for field in pairs.intruder))
    seconds = samples.seconds * np.linspace(0.0, 1.0, pieces + 1)
    moves = _displacement(
        samples.heading, samples.speed, samples.turn_rate, samples.acceleration, seconds
    )
    time = samples.time + seconds
    # Straight from sample to sample: at 20 m/s^2 that leaves the curve by 1 mm.
    close = _chord_distances(intruder.place(time) - (samples.place + moves))
    begin, end = pairs.begin[pair, 0], pairs.end[pair, 0]
    close = np.where((time[:, :-1] >= begin) & (time[:, 1:] <= end), close, np.inf)
    uncertainty = intruder.uncertainty_at(time[:, :-1], sigmas)
    beyond = close - pairs.required[pair, None] - uncertainty
    np.minimum.at(near.distance, pair, close.min(axis=1))
    np.minimum.at(near.beyond_required, pair, beyond.min(axis=1))
    np.minimum.at(near.beyond_separation, pair, close.min(axis=1) - pairs.separation[pair])


def _chord_distances(away: Array) -> Array:
    """Return the distances of the origin from the chords of curves ``[m, T]``, complex m,
    ``[m, T - 1]``.
    """
    chord = np.diff(away, axis=1)
    square = np.maximum(np.abs(chord) ** 2, 1e-12)
    share = np.clip(-(away[:, :-1] * np.conj(chord)).real / square, 0.0, 1.0)
    return np.abs(away[:, :-1] + share * chord)
