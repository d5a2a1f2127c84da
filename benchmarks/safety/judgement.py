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
from envs.kinematics import Limits
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

    begin: Any
    """s after the request."""
    length: Any
    """s."""
    place: Any
    """Where each arc begins, m."""
    heading: Any
    speed: Any
    rate: Any
    acceleration: Any

    def at(self, row: Any, arc: Any, seconds: Any) -> Any:
        """Return positions some seconds into arcs, ``[...]`` all, complex m."""
        place, heading, speed, rate, acceleration = (field[row, arc] for field in self[2:])
        return place + _displacement(heading, speed, rate, acceleration, seconds)


def flights(certificates: list[dict[str, Any]]) -> Flight:
    """Return the plans of certificates with the same number of waypoints, ``[N, A]``."""
    points, given = (
        _points(certificates),
        np.array([data["controls"] for data in certificates], dtype=float),
    )
    rate, gain = given[..., :ARCS], given[..., ARCS:]
    step = (np.diff(points[..., 4], axis=1) / ARCS)[..., None]
    heading = points[:, :-1, 2, None] + _running_sums(rate * step)[..., :-1]
    speed = points[:, :-1, 3, None] + _running_sums(gain * step)[..., :-1]
    moves = _displacement(heading, speed, rate, gain, step)
    place = (points[:, :-1, 0] + 1j * points[:, :-1, 1])[..., None] + _running_sums(moves)[..., :-1]
    begin = points[:, :-1, 4, None] + step * np.arange(ARCS)
    fields = (begin, step + 0.0 * rate, place, heading, speed, rate, gain)
    return Flight(*(field.reshape(len(points), -1) for field in fields))


def controls(certificates: list[dict[str, Any]]) -> Any:
    """Return the controls of the legs between the waypoints, ``[N, L, 2 ARCS]``."""
    curves = waypoints.legs(waypoints.PlanStates(*np.moveaxis(_points(certificates), -1, 0)))
    return np.concatenate([curves.yaw_rate, curves.acceleration], axis=-1)


def wrong(certificates: list[dict[str, Any]]) -> list[str]:
    """Return what is wrong with each certificate, or nothing; all have the same number of
    waypoints.
    """
    found: list[list[str]] = [[] for _ in certificates]
    times = _points(certificates)[..., 4]
    for row, data in enumerate(certificates):
        sizes = [value for one in data["intruders"] for value in (one[3], *one[6:])]
        if min([*sizes, *data["requirement"].values()], default=0.0) < 0.0:
            found[row].append("negative")
        if not (np.diff(times[row]) > 0.0).all():
            found[row].append("times")
        if any(not _above_or_below(one, 0.0, times[row, -1]) for one in data["excluded"]):
            found[row].append("excluded")
        if any(not _above_or_below(one[3:], *one[1:3]) for one in data["apart"]):
            found[row].append("apart")
    rows = [row for row, names in enumerate(found) if not {"negative", "times"} & set(names)]
    sound = [certificates[row] for row in rows]
    if not sound:
        return [", ".join(names) for names in found]
    flight = flights(sound)
    checks = _legs(sound, flight) | {"distance": _too_close(sound, flight)}
    for name, bad in checks.items():
        for row in np.flatnonzero(bad):
            found[rows[row]].append(name)
    return [", ".join(names) for names in found]


def _points(certificates: list[dict[str, Any]]) -> Any:
    return np.array(
        [[[*data["own"], 0.0], *data["waypoints"]] for data in certificates], dtype=float
    )


def _legs(certificates: list[dict[str, Any]], flight: Flight) -> dict[str, Any]:
    """Return where curve, joints or limits are wrong, ``[N]`` each."""
    count = len(certificates)
    points = _points(certificates)
    given = np.array([data["controls"] for data in certificates], dtype=float)
    last = (slice(None), slice(ARCS - 1, None, ARCS))
    seconds = flight.length[last]
    row, arc = np.arange(count)[:, None], np.arange(flight.begin.shape[1])[last[1]]
    ends = flight.at(row, arc, seconds) - points[:, 1:, 0] - 1j * points[:, 1:, 1]
    courses = np.exp(1j * (flight.heading[last] + flight.rate[last] * seconds)) - np.exp(
        1j * points[:, 1:, 2]
    )
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
        "controls": np.abs(given - controls(certificates)).reshape(count, -1) > _CURVE,
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
    now, then = above + (rise - climb) * begin, above + (rise - climb) * end
    return now * then > 0.0 and min(abs(now), abs(then)) >= apart - _OUR_OWN


def _too_close(certificates: list[dict[str, Any]], flight: Flight) -> Any:
    """Return where an intruder is sampled closer than the statement or the certificate's bound
    allows, ``[N]``.
    """
    bad = np.zeros(len(certificates), dtype=bool)
    owner = np.array(
        [row for row, data in enumerate(certificates) for _ in data["intruders"]], dtype=int
    )
    if owner.size == 0:
        return bad
    traffic = np.array([one for data in certificates for one in data["intruders"]]).T
    claim = np.array([bound for data in certificates for bound in data["bounds"]])
    levels = _apart_times(certificates)
    needs = required_distances(certificates, flight, owner, traffic, claim, levels)
    quick = np.maximum(flight.speed, flight.speed + flight.acceleration * flight.length)

    def clearance(pair: Any, arc: Any, seconds: Any) -> Any:
        row = owner[pair]
        time = flight.begin[row, arc] + seconds
        away = apart(flight, traffic[:, pair], row, arc, seconds) - needs.at(pair, time)
        begin, end = np.moveaxis(levels[pair], -1, 0)
        above_or_below = (begin <= time[..., None]) & (time[..., None] <= end)
        return np.where(above_or_below.any(axis=-1), np.inf, away)

    # Legs apart, because the last can be far longer than the others.
    for leg in range(flight.begin.shape[1] // ARCS):
        arcs = np.arange(leg * ARCS, (leg + 1) * ARCS)[:, None]
        pieces = max(1, math.ceil(float(flight.length[:, arcs].max()) / COARSE))
        pair: Any = np.flatnonzero(~bad[owner])
        row = owner[pair, None, None]
        width: Any = flight.length[row, arcs] / pieces
        found = clearance(pair[:, None, None], arcs, width * np.arange(pieces + 1))
        bad[owner[pair][(found < -_OUR_OWN).any(axis=(1, 2))]] = True
        closing = 0.5 * width * (quick[row, arcs] + traffic[3, pair, None, None])
        which, place, piece = np.nonzero(np.minimum(found[..., 1:], found[..., :-1]) < closing)
        pair, arc = pair[which], arcs[place, 0]
        width = width[which, place, 0]
        begin: Any = piece * width
        for _ in range(ROUNDS):
            on = ~bad[owner[pair]]
            pair, arc, begin, width = pair[on], arc[on], begin[on], width[on]
            if pair.size == 0:
                break
            seconds = begin[:, None] + width[:, None] * np.linspace(0.0, 1.0, _PIECES + 1)
            seconds = np.minimum(seconds, flight.length[owner[pair], arc][:, None])
            found = clearance(pair[:, None], arc[:, None], seconds)
            bad[owner[pair][(found < -_OUR_OWN).any(axis=1)]] = True
            least = np.take_along_axis(seconds, np.argmin(found, axis=1)[:, None], 1)[:, 0]
            begin, width = np.maximum(begin, least - width / _PIECES), width * (2.0 / _PIECES)
    return bad


def _apart_times(certificates: list[dict[str, Any]]) -> Any:
    """Return in which times, two at most, each intruder is above or below, s, ``[P, 2, 2]``."""
    found = []
    for data in certificates:
        for number in range(len(data["intruders"])):
            times = [one[1:3] for one in data["apart"] if one[0] == number]
            found.append((times + [[np.inf, -np.inf]] * 2)[:2])
    return np.array(found)


class _Intruder(NamedTuple):
    """An intruder as a certificate lists it, or several of them; fields ``[...]``."""

    x: Any
    y: Any
    heading: Any
    speed: Any
    age: Any
    """Of the report at the request, s."""
    rate: Any
    """Of its turn, rad/s."""
    lasts: Any
    """How long it turns from the report on, s."""
    position_std: Any
    velocity_std: Any
    separation: Any


class _Needs(NamedTuple):
    """What pairs of a plan and an intruder must keep; fields ``[P]``."""

    base: Any
    """At the request, m."""
    sigmas: Any
    std: Any
    """One sigma of the position in the report, m."""
    velocity_std: Any
    age: Any
    """Of the report at the request, s."""
    separation: Any
    claim: Any
    """The certificate's own bound, m."""

    def at(self, pair: Any, time: Any) -> Any:
        """Return the distance below which a plan is wrong, m, ``[...]``."""
        here = _Needs(*(field[pair] for field in self))
        now = np.hypot(here.std, here.velocity_std * here.age)
        then = np.hypot(here.std, here.velocity_std * (here.age + time))
        need = here.base + here.sigmas * (then - now)
        return np.maximum(np.maximum(need - _MARGIN, here.separation - _BELOW), here.claim)


def required_distances(
    certificates: list[dict[str, Any]],
    flight: Flight,
    owner: Any,
    traffic: Any,
    claim: Any,
    levels: Any,
) -> _Needs:
    """Return what pairs must keep; ``owner``: row of each one's plan ``[P]``, ``traffic``: ``[10,
    P]``, ``levels``: times in which they are above or below, s, ``[P, 2, 2]``.
    """
    margin, sigmas = (
        np.array([data["requirement"][name] for data in certificates])[owner]
        for name in ("margin", "sigmas")
    )
    one = _Intruder(*traffic)
    separation, age = one.separation, np.abs(one.age)
    std = np.hypot(one.position_std, one.velocity_std * age)
    zero = np.zeros(len(owner), dtype=int)
    away = apart(flight, traffic, owner, zero, 0.0 * separation)
    later = ((levels[..., 0] <= 0.0) & (levels[..., 1] > 0.0)).any(axis=-1)
    away = np.where(later, np.inf, away)
    base = np.maximum(separation, np.minimum(separation + margin + sigmas * std, away))
    return _Needs(base, sigmas, one.position_std, one.velocity_std, age, separation, claim)


def apart(flight: Flight, traffic: Any, row: Any, arc: Any, seconds: Any) -> Any:
    """Return distances to intruders ``[10, ...]`` some seconds into arcs, m, ``[...]``."""
    return np.abs(offset(flight, traffic, row, arc, seconds))


def offset(flight: Flight, traffic: Any, row: Any, arc: Any, seconds: Any) -> Any:
    """Return where intruders ``[10, ...]`` are from a plan some seconds into arcs, complex m,
    ``[...]``.
    """
    one = _Intruder(*traffic)
    time = flight.begin[row, arc] + seconds + one.age
    rate = np.where(one.lasts > 0.0, one.rate, 0.0)
    there = one.x + 1j * one.y + displacement(one.heading, one.speed, rate, one.lasts, time)
    return there - flight.at(row, arc, seconds)


def _displacement(heading: Any, speed: Any, rate: Any, acceleration: Any, t: Any) -> Any:
    """Return how far one gets in some seconds: power series of the integral of (v + a t) exp(i w
    t), complex m.
    """
    turn = 1j * (rate * t)
    largest, term, n = float(np.max(np.abs(turn), initial=0.0)), 1.0, 0
    power: Any = np.ones(np.shape(turn), dtype=complex)
    steady, rising = np.zeros_like(power), np.zeros_like(power)
    while term > 1e-18:
        steady, rising = steady + power / (n + 1), rising + power / (n + 2)
        n, term = n + 1, term * largest / (n + 1)
        power = power * turn / n
    return np.exp(1j * heading) * t * (speed * steady + acceleration * t * rising)


def _running_sums(parts: Any) -> Any:
    """Return the sums of none, one, two, ... of the parts along the last axis."""
    return np.concatenate([np.zeros((*parts.shape[:-1], 1)), np.cumsum(parts, axis=-1)], axis=-1)
