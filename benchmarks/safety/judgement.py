"""Whether certificates are wrong, decided by sampling: what the checker is held against.

A certificate is wrong where its plan contradicts the statement of docs/explanation/safe-theorem.md
at a time that was sampled. Nothing of checker or validator is used but the contract of a leg
(:func:`envs.waypoints.legs`). Every plan of a batch is sampled :data:`COARSE` s apart at most; only
where both aircraft together could come too near between two samples is that interval searched, from
a thirtieth to a thirtieth of it (:data:`ROUNDS`).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from benchmarks.safety.resimulation import displacement
from envs import waypoints
from envs.arrays import Array
from envs.kinematics import Limits
from envs.trees import take
from envs.waypoints import ARCS

__all__ = ["Flight", "apart", "controls", "flights", "offset", "required_distances", "wrong"]

COARSE = 0.5
ROUNDS = 3
_PIECES = 32
_OUR_OWN = 1e-6  # m, and as much in other units: of the arithmetic here

_BELOW, _MARGIN, _MISS = 3e-6, 1.003e-3, 1.001e-3  # m; of separation, margin and joints
_SPEED, _ACCELERATION, _RATE = 4e-6, 2e-6, 2e-9  # of limits: m/s, m/s^2, rad/s
_CURVE = 1e-6  # rad/s and m/s^2 that controls may differ from those of the leg's curve


class Flight(NamedTuple):
    """Plans of as many waypoints, as flown by their controls; fields ``[N, A]`` over their arcs,
    positions complex.
    """

    begin: Array
    """s after the request."""
    length: Array
    """s."""
    place: Array
    """Where each arc begins, m."""
    heading: Array
    speed: Array
    rate: Array
    acceleration: Array

    def at(self, row: Array, arc: Array, seconds: Array) -> Array:
        """Return positions some seconds into arcs, ``[...]`` all, complex m."""
        place, heading, speed, rate, acceleration = (field[row, arc] for field in self[2:])
        return place + _displacement(heading, speed, rate, acceleration, seconds)


def flights(certificates: list[dict[str, Any]]) -> Flight:
    """Return the plans of certificates with the same number of waypoints, ``[N, A]``."""
    points = _points(certificates)
    stated = np.array([data["controls"] for data in certificates], dtype=float)
    rate, gain = stated[..., :ARCS], stated[..., ARCS:]
    step = (np.diff(points[..., 4], axis=1) / ARCS)[..., None]
    heading = points[:, :-1, 2, None] + _running_sums(rate * step)[..., :-1]
    speed = points[:, :-1, 3, None] + _running_sums(gain * step)[..., :-1]
    moves = _displacement(heading, speed, rate, gain, step)
    place = (points[:, :-1, 0] + 1j * points[:, :-1, 1])[..., None] + _running_sums(moves)[..., :-1]
    begin = points[:, :-1, 4, None] + step * np.arange(ARCS)
    by_leg = Flight(begin, step + 0.0 * rate, place, heading, speed, rate, gain)
    return Flight(*(field.reshape(len(points), -1) for field in by_leg))


def controls(certificates: list[dict[str, Any]]) -> Array:
    """Return the controls of the legs between the waypoints, ``[N, L, 2 ARCS]``."""
    curves = waypoints.legs(waypoints.PlanStates(*np.moveaxis(_points(certificates), -1, 0)))
    return np.concatenate([curves.yaw_rate, curves.acceleration], axis=-1)


def wrong(certificates: list[dict[str, Any]]) -> list[str]:
    """Return what is wrong with each certificate, or nothing; all have the same number of
    waypoints.
    """
    faults = [_list_faults(data) for data in certificates]
    rows = [row for row, names in enumerate(faults) if not {"negative", "times"} & set(names)]
    sound = [certificates[row] for row in rows]
    if sound:
        flight = flights(sound)
        checks = _legs(sound, flight) | {"distance": _too_close(sound, flight)}
        for name, bad in checks.items():
            for row in np.flatnonzero(bad):
                faults[rows[row]].append(name)
    return [", ".join(names) for names in faults]


def _list_faults(data: dict[str, Any]) -> list[str]:
    """Return what is wrong with a certificate by its numbers alone, before anything is flown."""
    faults: list[str] = []
    times = np.array([0.0, *(point[4] for point in data["waypoints"])], dtype=float)
    sizes = [value for intruder in data["intruders"] for value in (intruder[3], *intruder[6:])]
    if min([*sizes, *data["requirement"].values()], default=0.0) < 0.0:
        faults.append("negative")
    if not (np.diff(times) > 0.0).all():
        faults.append("times")
    if any(not _above_or_below(row, 0.0, times[-1]) for row in data["excluded"]):
        faults.append("excluded")
    if any(not _above_or_below(row[3:], *row[1:3]) for row in data["apart"]):
        faults.append("apart")
    return faults


def _points(certificates: list[dict[str, Any]]) -> Array:
    """Return x, y, heading, speed and time at the request and the waypoints, ``[N, W + 1, 5]``."""
    return np.array(
        [[[*data["own"], 0.0], *data["waypoints"]] for data in certificates], dtype=float
    )


def _legs(certificates: list[dict[str, Any]], flight: Flight) -> dict[str, Array]:
    """Return where curve, joints or limits are wrong, ``[N]`` each."""
    count = len(certificates)
    points = _points(certificates)
    stated = np.array([data["controls"] for data in certificates], dtype=float)
    last = np.s_[:, ARCS - 1 :: ARCS]  # arcs of legs
    seconds = flight.length[last]
    row, arc = np.arange(count)[:, None], np.arange(flight.begin.shape[1])[ARCS - 1 :: ARCS]
    ends = flight.at(row, arc, seconds) - points[:, 1:, 0] - 1j * points[:, 1:, 1]
    course = flight.heading[last] + flight.rate[last] * seconds
    courses = np.exp(1j * course) - np.exp(1j * points[:, 1:, 2])
    after = flight.speed + flight.acceleration * flight.length
    speeds = after[last] - points[:, 1:, 3]
    limits = Limits(
        *(
            np.array([data["limits"][name] for data in certificates])[:, None]
            for name in Limits._fields
        )
    )
    begun = points[:, :1, 3]
    checks = {
        "controls": np.abs(stated - controls(certificates)).reshape(count, -1) > _CURVE,
        "joint": np.abs(ends) > _MISS + _OUR_OWN,
        "course": (np.abs(courses) > _SPEED) | (np.abs(speeds) > _SPEED),
        "speed": (after < np.minimum(limits.speed_min, begun) - _SPEED - _OUR_OWN)
        | (after > np.maximum(limits.speed_max, begun) + _SPEED + _OUR_OWN),
        "acceleration": (flight.acceleration < limits.acceleration_min - _ACCELERATION - _OUR_OWN)
        | (flight.acceleration > limits.acceleration_max + _ACCELERATION + _OUR_OWN),
        "turn rate": np.abs(flight.rate) > limits.yaw_rate_max + _RATE + 1e-12,
    }
    return {name: bad.any(axis=1) for name, bad in checks.items()}


def _above_or_below(row: list[float], begin: float, end: float) -> bool:
    own, climb, height, rise, age, apart = row
    above = height + rise * age - own
    at_begin, at_end = above + (rise - climb) * begin, above + (rise - climb) * end
    return at_begin * at_end > 0.0 and min(abs(at_begin), abs(at_end)) >= apart - _OUR_OWN


class _Pairs(NamedTuple):
    """P pairs of a plan and an intruder."""

    flight: Flight
    owner: Array
    """Row of each one's plan, ``[P]``."""
    traffic: Array
    """Rows of the certificates, ``[10, P]``."""
    needs: "_Needs"
    levels: Array
    """Times in which each is above or below, s, ``[P, 2, 2]``."""

    @classmethod
    def of(cls, certificates: list[dict[str, Any]], flight: Flight) -> "_Pairs | None":
        """Return the pairs of certificates; None where no plan has an intruder."""
        owner = [row for row, data in enumerate(certificates) for _ in data["intruders"]]
        if not owner:
            return None
        traffic = np.array([intruder for data in certificates for intruder in data["intruders"]]).T
        claim = np.array([bound for data in certificates for bound in data["bounds"]])
        levels = _apart_times(certificates)
        needs = required_distances(certificates, flight, np.array(owner), traffic, claim, levels)
        return cls(flight, np.array(owner), traffic, needs, levels)

    def clearance(self, pair: Array, arc: Array, seconds: Array) -> Array:
        """Return distances less what must be kept some seconds into arcs, m, ``[...]`` all; inf
        where the intruder is above or below.
        """
        row = self.owner[pair]
        time = self.flight.begin[row, arc] + seconds
        away = apart(self.flight, self.traffic[:, pair], row, arc, seconds)
        begin, end = np.moveaxis(self.levels[pair], -1, 0)
        above_or_below = (begin <= time[..., None]) & (time[..., None] <= end)
        return np.where(above_or_below.any(axis=-1), np.inf, away - self.needs.at(pair, time))


class _Intervals(NamedTuple):
    """Stretches of time in which pairs could come too near; fields ``[m]``."""

    pair: Array
    arc: Array
    begin: Array
    """s into the arc."""
    width: Array
    """s."""


def _too_close(certificates: list[dict[str, Any]], flight: Flight) -> Array:
    """Return where an intruder is sampled closer than the statement or the certificate's bound
    allows, ``[N]``.
    """
    bad = np.zeros(len(certificates), dtype=bool)
    pairs = _Pairs.of(certificates, flight)
    if pairs is not None:
        # Legs apart, because the last can be far longer than the others.
        for leg in range(flight.begin.shape[1] // ARCS):
            _search(pairs, _sample_leg(pairs, leg, bad), bad)
    return bad


def _sample_leg(pairs: _Pairs, leg: int, bad: Array) -> _Intervals:
    """Sample a leg :data:`COARSE` s apart at most; mark plans that are wrong there, and return
    where two samples leave it open.
    """
    flight, owner = pairs.flight, pairs.owner
    arcs = np.arange(leg * ARCS, (leg + 1) * ARCS)[:, None]
    pieces = max(1, math.ceil(float(flight.length[:, arcs].max()) / COARSE))
    pair = np.flatnonzero(~bad[owner])
    row = owner[pair, None, None]
    width = flight.length[row, arcs] / pieces
    clearance = pairs.clearance(pair[:, None, None], arcs, width * np.arange(pieces + 1))
    bad[owner[pair][(clearance < -_OUR_OWN).any(axis=(1, 2))]] = True
    # Nothing comes nearer between two samples than both fly in that time.
    after = flight.speed + flight.acceleration * flight.length
    quick = np.maximum(flight.speed, after)[row, arcs] + pairs.traffic[3, pair, None, None]
    closing = 0.5 * width * quick
    near, place, piece = np.nonzero(np.minimum(clearance[..., 1:], clearance[..., :-1]) < closing)
    width = width[near, place, 0]
    return _Intervals(pair[near], arcs[place, 0], piece * width, width)


def _search(pairs: _Pairs, places: _Intervals, bad: Array) -> None:
    """Search intervals where they come nearest, :data:`ROUNDS` times finer, and mark plans that
    are wrong.
    """
    owner = pairs.owner
    for _ in range(ROUNDS):
        places = take(places, ~bad[owner[places.pair]])
        pair, arc, begin, width = places
        if pair.size == 0:
            return
        seconds = begin[:, None] + width[:, None] * np.linspace(0.0, 1.0, _PIECES + 1)
        seconds = np.minimum(seconds, pairs.flight.length[owner[pair], arc][:, None])
        clearance = pairs.clearance(pair[:, None], arc[:, None], seconds)
        bad[owner[pair][(clearance < -_OUR_OWN).any(axis=1)]] = True
        least = np.take_along_axis(seconds, np.argmin(clearance, axis=1)[:, None], 1)[:, 0]
        begin = np.maximum(begin, least - width / _PIECES)
        places = places._replace(begin=begin, width=width * (2.0 / _PIECES))


def _apart_times(certificates: list[dict[str, Any]]) -> Array:
    """Return in which times, two at most, each intruder is above or below, s, ``[P, 2, 2]``."""
    by_intruder = []
    for data in certificates:
        for number in range(len(data["intruders"])):
            times = [row[1:3] for row in data["apart"] if row[0] == number]
            by_intruder.append((times + [[np.inf, -np.inf]] * 2)[:2])
    return np.array(by_intruder)


class _Intruder(NamedTuple):
    """An intruder as a certificate lists it, or several of them; fields ``[...]``."""

    x: Array
    y: Array
    heading: Array
    speed: Array
    age: Array
    """Of the report at the request, s."""
    rate: Array
    """Of its turn, rad/s."""
    lasts: Array
    """How long it turns from the report on, s."""
    position_std: Array
    velocity_std: Array
    separation: Array


class _Needs(NamedTuple):
    """What pairs of a plan and an intruder must keep; fields ``[P]``."""

    base: Array
    """At the request, m."""
    sigmas: Array
    std: Array
    """One sigma of the position in the report, m."""
    velocity_std: Array
    age: Array
    """Of the report at the request, s."""
    separation: Array
    claim: Array
    """The certificate's own bound, m."""

    def at(self, pair: Array, time: Array) -> Array:
        """Return the distance below which a plan is wrong, m, ``[...]``."""
        needs = _Needs(*(field[pair] for field in self))
        before = np.hypot(needs.std, needs.velocity_std * needs.age)
        after = np.hypot(needs.std, needs.velocity_std * (needs.age + time))
        need = needs.base + needs.sigmas * (after - before)
        return np.maximum(np.maximum(need - _MARGIN, needs.separation - _BELOW), needs.claim)


def required_distances(
    certificates: list[dict[str, Any]],
    flight: Flight,
    owner: Array,
    traffic: Array,
    claim: Array,
    levels: Array,
) -> _Needs:
    """Return what pairs must keep; ``owner``: row of each one's plan ``[P]``, ``traffic``: ``[10,
    P]``, ``levels``: times in which they are above or below, s, ``[P, 2, 2]``.
    """
    margin, sigmas = (
        np.array([data["requirement"][name] for data in certificates])[owner]
        for name in ("margin", "sigmas")
    )
    intruders = _Intruder(*traffic)
    separation, age = intruders.separation, np.abs(intruders.age)
    std = np.hypot(intruders.position_std, intruders.velocity_std * age)
    zero = np.zeros(len(owner), dtype=int)
    away = apart(flight, traffic, owner, zero, 0.0 * separation)
    later = ((levels[..., 0] <= 0.0) & (levels[..., 1] > 0.0)).any(axis=-1)
    away = np.where(later, np.inf, away)
    base = np.maximum(separation, np.minimum(separation + margin + sigmas * std, away))
    return _Needs(
        base, sigmas, intruders.position_std, intruders.velocity_std, age, separation, claim
    )


def apart(flight: Flight, traffic: Array, row: Array, arc: Array, seconds: Array) -> Array:
    """Return distances to intruders ``[10, ...]`` some seconds into arcs, m, ``[...]``."""
    return np.abs(offset(flight, traffic, row, arc, seconds))


def offset(flight: Flight, traffic: Array, row: Array, arc: Array, seconds: Array) -> Array:
    """Return where intruders ``[10, ...]`` are from a plan some seconds into arcs, complex m,
    ``[...]``.
    """
    intruders = _Intruder(*traffic)
    time = flight.begin[row, arc] + seconds + intruders.age
    rate = np.where(intruders.lasts > 0.0, intruders.rate, 0.0)
    there = (
        intruders.x
        + 1j * intruders.y
        + displacement(intruders.heading, intruders.speed, rate, intruders.lasts, time)
    )
    return there - flight.at(row, arc, seconds)


def _displacement(
    heading: Array, speed: Array, rate: Array, acceleration: Array, t: Array
) -> Array:
    """Return how far an aircraft gets in a time, complex m: the power series of the integral of
    (v + a t) exp(i w t).
    """
    turn = 1j * (rate * t)
    largest, term, n = float(np.max(np.abs(turn), initial=0.0)), 1.0, 0
    power = np.ones(np.shape(turn), dtype=complex)
    steady, rising = np.zeros_like(power), np.zeros_like(power)
    while term > 1e-18:
        steady, rising = steady + power / (n + 1), rising + power / (n + 2)
        n, term = n + 1, term * largest / (n + 1)
        power = power * turn / n
    return np.exp(1j * heading) * t * (speed * steady + acceleration * t * rising)


def _running_sums(parts: Array) -> Array:
    """Return the sums of none, one, two, ... of the parts along the last axis."""
    return np.concatenate([np.zeros((*parts.shape[:-1], 1)), np.cumsum(parts, axis=-1)], axis=-1)
