"""What the planner is asked: states, intruders and route as arrays, and how the answer shall be."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from agents.planner.answer import Excluded, RequestError
from agents.planner.traffic import Requirement, Traffic, advanced, required
from agents.planner.validator import same_flight
from envs.kinematics import C208_PUBLISHED, SURROGATE, Limits, VehicleState
from envs.waypoints import RoutePoint

__all__ = [
    "MARGIN",
    "SPEED_TOLERANCE",
    "Altitude",
    "Intruder",
    "Options",
    "Request",
    "bold",
    "checked",
    "gentle",
    "keeping",
    "reported",
]

MARGIN = 0.02
"""Largest distance of the follower from the curve that it flies on the true limits' kinematics, m, rounded up: the
default margin (measured: docs/explanation/planner.md)."""

SPEED_TOLERANCE = 1.0
"""By how much the ownship's speed may leave the envelope, m/s: a flown plan swings that far about its limits."""

_FARTHEST = 1e6
"""Coordinates beyond this, m, belong to no local frame."""

_FASTEST = 400.0  # of an intruder, m/s
_LONGEST_EXTENSION = 5_000.0  # of a route's last leg, m
_LONGEST_TEXT = 60  # of a value in a message
_RANGES = (
    ("requirement.separation", 1.0, 50_000.0, "m"),
    ("requirement.margin", 0.0, 50_000.0, "m"),
    ("requirement.sigmas", 0.0, 10.0, "sigmas"),
    *(
        (f"{name}.{limit}", low, high, unit)
        for name in ("limits", "manoeuvre")
        for limit, low, high, unit in (
            ("speed_min", 10.0, 101.0, "m/s"),
            ("speed_max", 49.0, 500.0, "m/s"),
            ("acceleration_min", -20.0, 0.0, "m/s^2"),
            ("acceleration_max", 1e-3, 20.0, "m/s^2"),
            ("yaw_rate_max", 1e-4, 0.5, "rad/s"),
        )
    ),
    ("goal_radius", 100.0, 50_000.0, "m"),
    ("rejoin_by", 20.0, 340.0, "s"),
    ("vertical_filter", 0.0, 50_000.0, "m"),
    ("max_age", 0.0, 60.0, "s"),
    ("doubtful", 0.0, math.inf, "m"),
)
"""What options may be."""


@dataclass(frozen=True, slots=True)
class Altitude:
    """A height, comparable only with others of the same reference."""

    value: float
    """m."""
    reference: str
    """Such as ``"wgs84"``, ``"msl"``, ``"pressure"``."""
    vertical_speed: float = 0.0
    """m/s, positive upwards."""


@dataclass(frozen=True, slots=True)
class Intruder:
    """An intruder as it was reported."""

    state: VehicleState
    """At the time of the report."""
    age: float = 0.0
    """Of the report at the request, s; the planner advances the state over it, along the turn while that lasts."""
    turn_rate: float = 0.0
    """With which it is expected to go on turning, rad/s, positive to the left."""
    turn_time: float = 0.0
    """For how long after the report (not after the request) it turns, s; straight ahead after that."""
    position_std: float = 0.0
    """One sigma per axis at the time of the report, m (from ADS-B's NACp: half its 95 % radius)."""
    velocity_std: float = 0.0
    """One sigma per axis, m/s (from NACv likewise)."""
    altitude: Altitude | None = None
    """None: unknown, which counts as the same level."""


def gentle(limits: Limits) -> Limits:
    """Return limits that leave the legs a reserve, because smoothing between waypoints takes more than was flown.

    The gentlest curve to the same end as an acceleration (or turn) that stops inside the leg begins with up to 4/3
    of it. For turns and deceleration the true vehicle has that much more than the surrogate; for acceleration not.
    """
    return limits._replace(speed_max=limits.speed_max - 0.4, acceleration_max=0.75 * limits.acceleration_max)


@dataclass(frozen=True)
class Options:
    """How plans shall be."""

    requirement: Requirement = field(default_factory=lambda: Requirement(margin=MARGIN))
    limits: Limits = C208_PUBLISHED
    """That every leg must obey: the true vehicle's."""
    manoeuvre: Limits = field(default_factory=lambda: gentle(SURROGATE))
    """That policy and fallback are flown with."""
    goal_radius: float = 500.0
    """Within which a point of the route counts as rejoined, m."""
    rejoin_by: float = 300.0
    """Latest time of that, s."""
    direct: bool = True
    """Whether policy and fallback hand over to the direct way to the goal as soon as that is clear."""
    goals: int = 3
    """Points of the route that are tried, the next one first."""
    extend_route: bool = False
    """Whether a route that ends before the plan may be extended in its last direction."""
    vertical_filter: float = 600.0
    """Predicted vertical separation beyond which an intruder is left out, m."""
    max_age: float = 5.0
    """Oldest report that is planned with, s."""
    doubtful: float = 1_500.0
    """Cost of a safe plan of the policy's, m, above which the fallback is searched too and the cheaper plan taken;
    0 offers it always, inf never."""
    thorough: bool = True
    """Whether the last, slow stages of the fallback are tried before giving up."""


class Request(NamedTuple):
    """Requests as arrays; fields ``[N]``, of intruders ``[N, K]``, of routes ``[N, R]``."""

    own: VehicleState
    traffic: Traffic
    route_x: Any
    """m."""
    route_y: Any
    points: Any
    """How many points each route has."""


def bold(options: Options) -> Limits:
    """Return limits for a last attempt: the legs' own, less what smoothing takes; no longer the surrogate's."""
    legs, reserve = options.limits, 0.75
    return options.manoeuvre._replace(
        acceleration_min=min(reserve * legs.acceleration_min, options.manoeuvre.acceleration_min),
        acceleration_max=max(legs.acceleration_max, options.manoeuvre.acceleration_max),
        yaw_rate_max=max(reserve * legs.yaw_rate_max, options.manoeuvre.yaw_rate_max),
    )


def checked(
    own: VehicleState,
    intruders: Sequence[VehicleState | Intruder],
    route: Sequence[RoutePoint],
    options: Options,
    own_altitude: Altitude | None = None,
) -> tuple[Request, tuple[Excluded, ...], list[int]]:
    """Check one request and return it as arrays with N = 1.

    Returns:
        The request, the intruders left out, and the numbers of those that are in.

    Raises:
        RequestError: something is missing, not finite, out of range or inconsistent.
    """
    _check(options)
    state = _state("own", own)
    low, high = SURROGATE.speed_min - SPEED_TOLERANCE, SURROGATE.speed_max + SPEED_TOLERANCE
    if not low <= state.speed <= high:
        raise RequestError("own.speed", f"is {state.speed:g} m/s, expected {low:g} to {high:g}")
    _altitude("own_altitude", own_altitude)
    reports = [
        _report(f"intruders[{number}]", given if isinstance(given, Intruder) else Intruder(given), options)
        for number, given in enumerate(_sequence("intruders", intruders))
    ]
    x, y = _route(route)
    end = _latest_end(x, y)
    excluded = [
        Excluded(number, why)
        for number, report in enumerate(reports)
        if (why := _apart(own_altitude, report, end, options)) is not None
    ]
    out = {one.number for one in excluded}
    kept = [number for number in range(len(reports)) if number not in out]
    seen, age = reported([reports[number] for number in kept])
    traffic = advanced(seen, age)
    # Plans are checked against the traffic as of the request: it must fly what the reports say, by the validator's own
    # arithmetic.
    for number in np.flatnonzero(~same_flight(seen, age, traffic)[0]) if age.any() else ():
        raise RequestError(f"intruders[{kept[number]}]", "cannot be advanced from its report to the request")
    one = VehicleState(*(np.array([value]) for value in state))
    return Request(one, traffic, x[None], y[None], np.array([x.size])), tuple(excluded), kept


def reported(reports: Sequence[Intruder]) -> tuple[Traffic, Any]:
    """Return checked reports as arrays as of their own times, and their ages, s, ``[1, K]``."""
    rows = [(*one.state, one.turn_rate, one.turn_time, one.position_std, one.velocity_std, one.age) for one in reports]
    each = np.array(rows, dtype=float).reshape(len(rows), 9).T[:, None, :]
    return Traffic(VehicleState(*each[:4]), np.ones((1, len(rows)), dtype=bool), *each[4:8]), each[8]


def keeping(request: Request, options: Options) -> Any:
    """Return the distance to keep from each intruder, m, ``[N, K]``; see :func:`agents.planner.traffic.required`."""
    own, other = request.own, request.traffic.state
    away = np.hypot(other.x - own.x[:, None], other.y - own.y[:, None])
    return required(request.traffic, away, options.requirement)


def _sequence(name: str, given: Any) -> Sequence[Any]:
    if isinstance(given, (str, bytes, VehicleState, Intruder)) or not isinstance(given, Sequence):
        raise RequestError(name, f"is {type(given).__name__}, expected a sequence")
    return given


def _shown(value: Any) -> str:
    """Return a value for a message, however long or odd it is."""
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) > 10**18:
        return "an integer of more than 18 digits"
    text = repr(value)
    return text if len(text) <= _LONGEST_TEXT else text[:_LONGEST_TEXT] + "..."


def _number(name: str, value: Any, low: float, high: float, unit: str) -> float:
    """Return a number as a plain float, or say what is wrong with it."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise RequestError(name, f"is {_shown(value)}, expected a number")
    try:
        number = float(value)
    except OverflowError:
        raise RequestError(name, f"is {_shown(value)}, expected {low:g} to {high:g} {unit}") from None
    # NaN fails every comparison.
    if not low <= number <= high:
        raise RequestError(name, f"is {number:g}, expected {low:g} to {high:g} {unit}")
    return number


def _state(name: str, state: Any) -> VehicleState:
    """Return a state of plain floats, heading wrapped."""
    if not isinstance(state, VehicleState):
        raise RequestError(name, f"is {type(state).__name__}, expected a VehicleState")
    x = _number(f"{name}.x", state.x, -_FARTHEST, _FARTHEST, "m")
    y = _number(f"{name}.y", state.y, -_FARTHEST, _FARTHEST, "m")
    heading = _number(f"{name}.heading", state.heading, -2.0 * math.pi, 2.0 * math.pi, "rad")
    speed = _number(f"{name}.speed", state.speed, 0.0, _FASTEST, "m/s")
    return VehicleState(x, y, math.remainder(heading, 2.0 * math.pi), speed)


def _altitude(name: str, altitude: Any) -> None:
    if altitude is None:
        return
    if not isinstance(altitude, Altitude):
        raise RequestError(name, f"is {type(altitude).__name__}, expected an Altitude or None")
    _number(f"{name}.value", altitude.value, -1_000.0, 30_000.0, "m")
    _number(f"{name}.vertical_speed", altitude.vertical_speed, -100.0, 100.0, "m/s")
    if not isinstance(altitude.reference, str) or not altitude.reference:
        raise RequestError(f"{name}.reference", f"is {_shown(altitude.reference)}, expected a name")


def _report(name: str, report: Intruder, options: Options) -> Intruder:
    state = _state(name, report.state)
    _altitude(f"{name}.altitude", report.altitude)
    age = _number(f"{name}.age", report.age, -0.5, math.inf, "s")
    if age > options.max_age:
        raise RequestError(f"{name}.age", f"is {age:g} s: the report is stale, expected {options.max_age:g} s at most")
    return Intruder(
        state,
        age,
        _number(f"{name}.turn_rate", report.turn_rate, -0.5, 0.5, "rad/s"),
        _number(f"{name}.turn_time", report.turn_time, 0.0, 1_000.0, "s"),
        _number(f"{name}.position_std", report.position_std, 0.0, 10_000.0, "m"),
        _number(f"{name}.velocity_std", report.velocity_std, 0.0, 100.0, "m/s"),
        report.altitude,
    )


def _latest_end(x: Any, y: Any) -> float:
    """Return a time that no plan along a route outlasts, s: its last leg is the route's longest at most."""
    longest = max(float(np.max(np.hypot(np.diff(x), np.diff(y)))), _LONGEST_EXTENSION)
    return 400.0 + longest / (SURROGATE.speed_min - SPEED_TOLERANCE)


def _apart(own: Altitude | None, report: Intruder, end: float, options: Options) -> str | None:
    """Return why an intruder is vertically out of the way until the plan's end, or None."""
    other = report.altitude
    if own is None or other is None or own.reference != other.reference:
        return None
    now = other.value + other.vertical_speed * report.age - own.value
    later = now + (other.vertical_speed - own.vertical_speed) * end
    least = 0.0 if now * later <= 0.0 else min(abs(now), abs(later))
    if least <= options.vertical_filter:
        return None
    return f"stays {least:.0f} m above or below ({own.reference}) for {end:.0f} s"


def _check(options: Options) -> None:
    """Refuse options that could make an unsafe plan look safe, or none possible."""
    if not isinstance(options, Options):
        raise RequestError("options", f"is {type(options).__name__}, expected Options")
    for name, kind in (("requirement", Requirement), ("limits", Limits), ("manoeuvre", Limits)):
        if not isinstance(getattr(options, name), kind):
            raise RequestError(f"options.{name}", f"is {_shown(getattr(options, name))}, expected {kind.__name__}")
    for name, low, high, unit in _RANGES:
        value = options
        for part in name.split("."):
            value = getattr(value, part)
        _number(f"options.{name}", value, low, high, unit)
    for name in ("limits", "manoeuvre"):
        limits = getattr(options, name)
        if limits.speed_min >= limits.speed_max:
            what = f"is {limits.speed_min:g} m/s, expected less than speed_max, {limits.speed_max:g} m/s"
            raise RequestError(f"options.{name}.speed_min", what)
    for name in ("direct", "extend_route", "thorough"):
        if not isinstance(getattr(options, name), bool):
            raise RequestError(f"options.{name}", f"is {_shown(getattr(options, name))}, expected True or False")
    if isinstance(options.goals, bool) or not isinstance(options.goals, int) or not 1 <= options.goals <= 100:
        raise RequestError("options.goals", f"is {_shown(options.goals)}, expected an integer from 1 to 100")


def _route(route: Any) -> tuple[Any, Any]:
    points = _sequence("route", route)
    if len(points) < 2:
        raise RequestError("route", f"has {len(points)} points, expected 2 or more")
    indices: set[int] = set()
    x, y = [], []
    for number, point in enumerate(points):
        name = f"route[{number}]"
        if not isinstance(point, RoutePoint):
            raise RequestError(name, f"is {type(point).__name__}, expected a RoutePoint")
        if isinstance(point.index, bool) or not isinstance(point.index, int) or not 0 <= point.index < 2**31:
            raise RequestError(f"{name}.index", f"is {_shown(point.index)}, expected an integer from 0 to 2147483647")
        if point.index in indices:
            raise RequestError(f"{name}.index", f"is {_shown(point.index)} again, expected one of its own")
        indices.add(point.index)
        x.append(_number(f"{name}.x", point.x, -_FARTHEST, _FARTHEST, "m"))
        y.append(_number(f"{name}.y", point.y, -_FARTHEST, _FARTHEST, "m"))
        if number and math.hypot(x[-1] - x[-2], y[-1] - y[-2]) < 1.0:
            raise RequestError(name, "is closer than 1 m to the point before it, expected another place")
    return np.array(x), np.array(y)
