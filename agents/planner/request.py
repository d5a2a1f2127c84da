"""A request for a plan: states, intruders and route, checked and as arrays.

Messages of what is refused name the field, the value and what was expected.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from agents.planner.answer import Excluded, Field, RequestError, Subject
from agents.planner.fields import part_value, quote, real, sequence
from agents.planner.levels import ALWAYS, Altitude, window
from agents.planner.options import Options, speed_range
from agents.planner.out_of_the_way import find_excluded
from agents.planner.separation import same_flight
from agents.planner.traffic import Traffic, Window, advance_reports
from envs.arrays import Array
from envs.kinematics import FASTEST, VehicleState
from envs.trees import Shared
from envs.waypoints import RoutePoint
from envs.wind import Wind, narrow, through_air

if TYPE_CHECKING:
    from agents.planner.areas import Counted

_FARTHEST = 1e6  # coordinates beyond this, m, belong to no local frame, whatever the aircraft
_LEAST = 1.0  # m of a separation, and between points of a route
_STRONGEST = 150.0  # m/s of wind, beyond any on earth
# rad of a declared turn: so far the rounding of positions is bounded (proofs/Rounding.g)
_MOST_TURN = 32.0


@dataclass(frozen=True, slots=True)
class Intruder:
    """An intruder as it was reported.

    What stands here is believed: a standard deviation of 0 is an exact state. Where the accuracy is
    unknown, give the worst that is plausible.
    """

    state: VehicleState
    """At the time of the report."""
    age: float = 0.0
    """Of the report at the request, s; the planner advances the state over it, along the turn while
    that lasts.
    """
    turn_rate: float = 0.0
    """With which it is expected to go on turning, rad/s, positive to the left."""
    turn_time: float = 0.0
    """For how long after the report (not after the request) it turns, s; straight ahead after that.
    """
    position_std: float = 0.0
    """One sigma per axis at the time of the report, m (from ADS-B's NACp: half its 95 % radius)."""
    velocity_std: float = 0.0
    """One sigma per axis, m/s (from NACv likewise)."""
    altitude: Altitude | None = None
    """None: unknown, which counts as the same level."""
    separation: float | None = None
    """To be kept from it horizontally, m; None: ``Options.requirement``'s."""
    vertical_separation: float | None = None
    """Predicted vertical separation beyond which it does not count, m; None:
    ``Options.vertical_filter``.
    """

    def vertical(self, options: Options) -> float:
        """Return the vertical separation beyond which it does not count, m."""
        own = self.vertical_separation
        return options.vertical_filter if own is None else own


class Request(NamedTuple):
    """Requests as arrays; fields ``[N]``, of intruders ``[N, K]``, of routes ``[N, R]``.

    In a wind everything is in the air mass, which lies over the ground at the request: speeds are
    airspeeds, and the route's points drift.
    """

    own: VehicleState
    traffic: Traffic
    route_x: Array  # at the request, m
    route_y: Array
    points: Array  # how many points each route has
    # velocity of the route's points towards east and north, m/s, [N] each; None: they stand still
    drift: tuple[Array, Array] | None = None
    # what of the areas a plan may meet, the same for all N; None: nothing
    areas: Shared[tuple["Counted", ...]] | None = None
    # numbers of the points in the route that was asked for, [N, R], what is passed left out; -1: a
    # point round an area; None: they are all of the route
    of_route: Array | None = None


def check_request(
    own: VehicleState,
    intruders: Sequence[VehicleState | Intruder],
    route: Sequence[RoutePoint],
    options: Options,
    own_altitude: Altitude | None = None,
    wind: Wind | None = None,
) -> tuple[Request, tuple[Excluded, ...], list[int]]:
    """Check one request, whose options are (:func:`agents.planner.options.check`).

    States are over the ground.

    Returns:
        The request as arrays with N = 1, in the air mass, the intruders that are left out, and the
        numbers of those that count.

    Raises:
        RequestError: something is missing, not finite, out of range or inconsistent.
    """
    state = _check_own(own, options, wind)
    _check_altitude(Field(Subject.OWN_ALTITUDE), own_altitude)
    reports = _check_intruders(intruders, options, wind)
    x, y = _check_route(route)
    blows = 0.0 if wind is None else wind.speed
    end = float(options.latest_end(state.speed, x, y, wind=blows))
    excluded = find_excluded(state, reports, own_altitude, end, options)
    out = {one.number for one in excluded}
    counted = [number for number in range(len(reports)) if number not in out]
    request = Request(
        own=VehicleState(*(np.array([value]) for value in state)),
        traffic=_traffic_of(reports, counted, own_altitude, options),
        route_x=x[None],
        route_y=y[None],
        points=np.array([x.size]),
        drift=None if wind is None else (np.array([-wind.east]), np.array([-wind.north])),
    )
    return request, excluded, counted


def _traffic_of(
    reports: Sequence[Intruder],
    counted: Sequence[int],
    own_altitude: Altitude | None,
    options: Options,
) -> Traffic:
    """Return those of the intruders that count, as of the request, ``[1, K]``."""
    some = [reports[number] for number in counted]
    reported, age = arrays_of_reports(some)
    traffic = advance_reports(reported, age)
    # Plans are checked against the traffic as of the request: it must fly what the reports say, by
    # the validator's own arithmetic.
    if age.any():
        for number in np.flatnonzero(~same_flight(reported, age, traffic)[0]).tolist():
            raise RequestError(
                Field(Subject.INTRUDERS, number=counted[number]),
                "cannot be advanced from its report to the request",
            )
    return traffic._replace(window=windows(some, own_altitude, options))


def latest_end(request: Request, options: Options) -> Array:
    """Return a time that no plan of requests outlasts, s, ``[N]``."""
    wind = 0.0 if request.drift is None else np.hypot(*request.drift)
    return options.latest_end(
        request.own.speed, request.route_x, request.route_y, request.points, wind
    )


def in_wind(options: Options, wind: Any) -> Options:
    """Return the options for flight in the air mass of a wind: limits that hold the given ones in
    every wind within its uncertainty.

    Raises:
        RequestError: the wind is none, not finite, faster than the aircraft, or too uncertain.
    """
    if not isinstance(wind, Wind):
        raise RequestError(Field(Subject.WIND), f"is {type(wind).__name__}, expected a Wind")
    for name, low in (("east", -_STRONGEST), ("north", -_STRONGEST), ("std", 0.0)):
        real(Field(Subject.WIND, name), getattr(wind, name), low, _STRONGEST, "m/s")
    error = options.requirement.sigmas * float(wind.std)
    fastest = float(options.manoeuvre.speed_max)
    if wind.speed + error >= fastest:
        unsure = f", or {wind.speed + error:.1f} m/s with its uncertainty" if error > 0.0 else ""
        what = (
            f"is {wind.speed:.1f} m/s{unsure}, expected less than the {fastest:.1f} m/s that the "
            "aircraft makes against it"
        )
        raise RequestError(Field(Subject.WIND), what)
    limits, flown = narrow(options.limits, error), narrow(options.manoeuvre, error)
    for some in (limits, flown):
        least = min(some.speed_max - some.speed_min, some.acceleration_max, some.yaw_rate_max)
        if error > 0.0 and not (least > 0.0 and some.acceleration_min < 0.0):
            what = (
                f"is {wind.std:g} m/s: {options.requirement.sigmas:g} sigmas of that leave nothing "
                "of the aircraft's speeds, accelerations or turn rate; expected less"
            )
            raise RequestError(Field(Subject.WIND, "std"), what)
    return replace(options, limits=limits, manoeuvre=flown)


def report_in_air(report: Intruder, wind: Wind) -> Intruder:
    """Return a report over the ground as the air mass sees it, which lies there at the request.

    A turn is one through the air: its rate and its time stay. What the ground velocity becomes by
    a turn depends on the wind, whose error e moves it by up to ``2 e sin(turn / 2)``; for that the
    velocity's error of what turns grows.
    """
    turn = min(abs(report.turn_rate) * report.turn_time, 2.0)
    return replace(
        report,
        state=through_air(report.state, wind, -report.age),
        velocity_std=report.velocity_std + turn * float(wind.std),
    )


class _Report(NamedTuple):
    """Numbers of a report; floats, or arrays ``[1, K]``."""

    x: Array  # m
    y: Array
    heading: Array  # rad
    speed: Array  # m/s
    turn_rate: Array  # these and the others as of :class:`Intruder`
    turn_time: Array
    position_std: Array
    velocity_std: Array
    age: Array


def arrays_of_reports(reports: Sequence[Intruder]) -> tuple[Traffic, Array]:
    """Return checked reports as arrays as of their own times, and their ages, s, ``[1, K]``."""
    rows = [
        _Report(
            *one.state,
            one.turn_rate,
            one.turn_time,
            one.position_std,
            one.velocity_std,
            one.age,
        )
        for one in reports
    ]
    table = np.array(rows, dtype=float).reshape(len(rows), len(_Report._fields))
    each = _Report(*table.T[:, None, :])
    own = [math.nan if one.separation is None else one.separation for one in reports]
    traffic = Traffic(
        state=VehicleState(each.x, each.y, each.heading, each.speed),
        mask=np.ones((1, len(rows)), dtype=bool),
        turn_rate=each.turn_rate,
        turn_time=each.turn_time,
        position_std=each.position_std,
        velocity_std=each.velocity_std,
        age=0.0 * each.age,
        separation=None if all(map(math.isnan, own)) else np.array([own], dtype=float),
    )
    return traffic, each.age


def windows(
    reports: Sequence[Intruder], own_altitude: Altitude | None, options: Options
) -> Window | None:
    """Return when checked reports count, ``[1, K]``; None: all of them always."""
    if own_altitude is None:
        return None
    each = [
        window(own_altitude, one.altitude, one.age, one.vertical(options), options.unknown_climb)
        for one in reports
    ]
    # What is known to never count was left out; where rounding says otherwise it counts.
    each = [one if one[0] <= one[1] else ALWAYS for one in each]
    if all(begin <= 0.0 and end == math.inf for begin, end in each):
        return None
    begin, end = np.array(each, dtype=float).T[:, None, :]
    return Window(begin, end)


def check_finite(request: Request) -> None:
    """Refuse, by a RequestError, requests ``[N]`` with a number of what exists that is not
    finite.
    """
    for name, values in request.own._asdict().items():
        _check_numbers(f"own.{name}", values, True)
    traffic = request.traffic
    for name, values in traffic.state._asdict().items():
        _check_numbers(f"intruders.{name}", values, traffic.mask)
    for name in ("turn_rate", "turn_time", "position_std", "velocity_std", "age"):
        _check_numbers(f"intruders.{name}", getattr(traffic, name), traffic.mask)
    if traffic.separation is not None:  # nan: none of its own
        separation = np.nan_to_num(traffic.separation, posinf=np.inf)
        _check_numbers("intruders.separation", separation, traffic.mask)
    exists = np.arange(request.route_x.shape[1]) < request.points[:, None]
    _check_numbers("route_x", request.route_x, exists)
    _check_numbers("route_y", request.route_y, exists)


def _check_numbers(name: str, values: Array, counts: Array) -> None:
    """Refuse numbers that are not finite where they count."""
    for where in np.argwhere(~np.isfinite(values) & counts):
        what = f"is {values[tuple(where)]}, expected a finite number"
        raise RequestError(f"{name}{where.tolist()}", what)


def drift_points(
    points: tuple[Array, Array], drift: tuple[Array, Array] | None, time: Array
) -> tuple[Array, Array]:
    """Return where points of routes ``[N, ...]`` are some seconds after the request, m, as their
    drift ``[N]`` carries them.
    """
    if drift is None:
        return points
    x, y = points
    shape = (-1,) + (1,) * (np.ndim(x) - 1)
    east, north = (np.reshape(part, shape) for part in drift)
    return x + east * time, y + north * time


def _check_own(own: Any, options: Options, wind: Wind | None) -> VehicleState:
    """Return the state of the ownship in floats, in the air mass."""
    ground = _check_state(Field(Subject.OWN), own)
    state = ground if wind is None else through_air(ground, wind, 0.0)
    low, high = speed_range(options.aircraft.limits)
    if not low <= state.speed <= high:
        air = "" if wind is None else f", {state.speed:g} m/s through the air"
        what = f"is {ground.speed:g} m/s{air}, expected {low:g} to {high:g}"
        raise RequestError(Field(Subject.OWN, "speed"), what)
    return state


def _check_intruders(intruders: Any, options: Options, wind: Wind | None) -> list[Intruder]:
    """Return the reports of the intruders, in the air mass."""
    reports = [
        _check_report(
            Field(Subject.INTRUDERS, number=number),
            given if isinstance(given, Intruder) else Intruder(given),
            options,
        )
        for number, given in enumerate(sequence(Field(Subject.INTRUDERS), intruders))
    ]
    if wind is None:
        return reports
    reports = [report_in_air(report, wind) for report in reports]
    for number, report in enumerate(reports):
        name = Field(Subject.INTRUDERS, "state.speed through the air", number)
        real(name, report.state.speed, 0.0, FASTEST.speed_max, "m/s")
    return reports


def _check_state(name: Field, state: Any) -> VehicleState:
    """Return a state of plain floats, heading wrapped."""
    if not isinstance(state, VehicleState):
        raise RequestError(name, f"is {type(state).__name__}, expected a VehicleState")
    x = part_value(name, "x", state.x, -_FARTHEST, _FARTHEST, "m")
    y = part_value(name, "y", state.y, -_FARTHEST, _FARTHEST, "m")
    heading = part_value(name, "heading", state.heading, -2.0 * math.pi, 2.0 * math.pi, "rad")
    speed = part_value(name, "speed", state.speed, 0.0, FASTEST.speed_max, "m/s")
    return VehicleState(x, y, math.remainder(heading, 2.0 * math.pi), speed)


def _check_altitude(name: Field, altitude: Any) -> None:
    """Refuse what is neither an altitude nor None."""
    if altitude is None:
        return
    if not isinstance(altitude, Altitude):
        raise RequestError(name, f"is {type(altitude).__name__}, expected an Altitude or None")
    part_value(name, "value", altitude.value, -1_000.0, 30_000.0, "m")
    if altitude.vertical_speed is not None:
        part_value(name, "vertical_speed", altitude.vertical_speed, -100.0, 100.0, "m/s")
    part_value(name, "error", altitude.error, 0.0, 30_000.0, "m")
    part_value(name, "climb_error", altitude.climb_error, 0.0, 100.0, "m/s")
    if not isinstance(altitude.reference, str) or not altitude.reference:
        what = f"is {quote(altitude.reference)}, expected a name"
        raise RequestError(name.part("reference"), what)


def _check_report(name: Field, report: Intruder, options: Options) -> Intruder:
    """Return a report of plain floats, over the ground."""
    state = _check_state(name, report.state)
    if report.altitude is not None:
        _check_altitude(name.part("altitude"), report.altitude)
    age = part_value(name, "age", report.age, -0.5, math.inf, "s")
    if age > options.max_age:
        raise RequestError(
            name.part("age"),
            f"is {age:g} s: the report is stale, expected {options.max_age:g} s at most",
        )
    rate = part_value(name, "turn_rate", report.turn_rate, -0.5, 0.5, "rad/s")
    lasts = part_value(name, "turn_time", report.turn_time, 0.0, 1_000.0, "s")
    if abs(rate) * lasts > _MOST_TURN:
        what = (
            f"is {lasts:g} s: a turn of {abs(rate) * lasts:.0f} rad, expected {_MOST_TURN:g} "
            "rad at most"
        )
        raise RequestError(name.part("turn_time"), what)
    vertical = report.vertical_separation
    return Intruder(
        state=state,
        age=age,
        turn_rate=rate,
        turn_time=lasts,
        position_std=part_value(name, "position_std", report.position_std, 0.0, 10_000.0, "m"),
        velocity_std=part_value(name, "velocity_std", report.velocity_std, 0.0, 100.0, "m/s"),
        altitude=report.altitude,
        separation=_check_separation(name, "separation", report.separation),
        vertical_separation=_check_separation(name, "vertical_separation", vertical),
    )


def _check_separation(name: Field, kind: str, separation: Any) -> float | None:
    """Return a separation of an intruder's own, m; None: it has none."""
    if separation is None:
        return None
    return part_value(name, kind, separation, _LEAST, _FARTHEST, "m")


def _check_route(route: Any) -> tuple[Array, Array]:
    """Return the places of a route's points, m, ``[R]`` each."""
    points = sequence(Field(Subject.ROUTE), route)
    if len(points) < 2:
        raise RequestError(Field(Subject.ROUTE), f"has {len(points)} points, expected 2 or more")
    indices: set[int] = set()
    x, y = list[float](), list[float]()
    for number, point in enumerate(points):
        name = Field(Subject.ROUTE, number=number)
        if not isinstance(point, RoutePoint):
            raise RequestError(name, f"is {type(point).__name__}, expected a RoutePoint")
        _check_index(name.part("index"), point.index, indices)
        indices.add(point.index)
        x.append(part_value(name, "x", point.x, -_FARTHEST, _FARTHEST, "m"))
        y.append(part_value(name, "y", point.y, -_FARTHEST, _FARTHEST, "m"))
        if number and math.hypot(x[-1] - x[-2], y[-1] - y[-2]) < _LEAST:
            raise RequestError(
                name, "is closer than 1 m to the point before it, expected another place"
            )
    return np.array(x), np.array(y)


def _check_index(name: Field, index: Any, taken: set[int]) -> None:
    """Refuse what is no index, and one that is taken."""
    whole = isinstance(index, int) and not isinstance(index, bool)
    if not whole or not 0 <= index < 2**31:
        raise RequestError(name, f"is {quote(index)}, expected an integer from 0 to 2147483647")
    if index in taken:
        raise RequestError(name, f"is {quote(index)} again, expected one of its own")
