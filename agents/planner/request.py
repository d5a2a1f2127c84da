"""A request for a plan: states, intruders and route, checked and as arrays."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from agents.planner.answer import (
    Advisory,
    AdvisoryCode,
    Apart,
    Excluded,
    Field,
    RequestError,
    Subject,
)
from agents.planner.fields import part_value, quote, real, sequence
from agents.planner.levels import ALWAYS, Altitude, vertical_gap, window
from agents.planner.options import Options, speed_range
from agents.planner.separation import same_flight
from agents.planner.traffic import Traffic, Window, advance_reports
from envs.arrays import Array
from envs.kinematics import FASTEST, VehicleState
from envs.trees import Shared
from envs.waypoints import RoutePoint
from envs.wind import Wind, narrow, through_air

if TYPE_CHECKING:
    from agents.planner.areas import Counted

SPEED_TOLERANCE = 1e-3
"""m/s; far more than a leg may pass its limit by."""

_FARTHEST = 1e6  # coordinates beyond this, m, belong to no local frame, whatever the aircraft
_LEAST = 1.0  # m of a separation
_EARTH = 6.3e6  # m; less than every radius of curvature of the earth
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
        The request as arrays with N = 1, in the air mass, the intruders left out, and the numbers
        of those that are in.

    Raises:
        RequestError: something is missing, not finite, out of range or inconsistent.
    """
    ground = _state(Field(Subject.OWN), own)
    state = ground if wind is None else through_air(ground, wind, 0.0)
    low, high = speed_range(options.aircraft.limits)
    if not low <= state.speed <= high:
        what = Field(Subject.OWN, "speed")
        air = "" if wind is None else f", {state.speed:g} m/s through the air"
        raise RequestError(what, f"is {ground.speed:g} m/s{air}, expected {low:g} to {high:g}")
    _altitude(Field(Subject.OWN_ALTITUDE), own_altitude)
    reports = [
        _report(
            Field(Subject.INTRUDERS, number=number),
            given if isinstance(given, Intruder) else Intruder(given),
            options,
        )
        for number, given in enumerate(sequence(Field(Subject.INTRUDERS), intruders))
    ]
    if wind is not None:
        reports = [report_in_air(report, wind) for report in reports]
        for number, report in enumerate(reports):
            name = Field(Subject.INTRUDERS, "state.speed through the air", number)
            real(name, report.state.speed, 0.0, FASTEST.speed_max, "m/s")
    x, y = _route(route)
    blows = 0.0 if wind is None else wind.speed
    end = float(options.latest_end(state.speed, x, y, wind=blows))
    excluded = _out_of_the_way(state, reports, own_altitude, end, options)
    out = {one.number for one in excluded}
    kept = [number for number in range(len(reports)) if number not in out]
    seen, age = arrays_of_reports([reports[number] for number in kept])
    traffic = advance_reports(seen, age)
    # Plans are checked against the traffic as of the request: it must fly what the reports say, by
    # the validator's own arithmetic.
    for number in np.flatnonzero(~same_flight(seen, age, traffic)[0]) if age.any() else ():
        raise RequestError(
            Field(Subject.INTRUDERS, number=kept[number]),
            "cannot be advanced from its report to the request",
        )
    count = windows([reports[number] for number in kept], own_altitude, options)
    traffic = traffic._replace(window=count)
    one = VehicleState(*(np.array([value]) for value in state))
    drift = None if wind is None else (np.array([-wind.east]), np.array([-wind.north]))
    request = Request(one, traffic, x[None], y[None], np.array([x.size]), drift)
    return request, excluded, kept


def _out_of_the_way(
    own: VehicleState,
    reports: Sequence[Intruder],
    own_altitude: Altitude | None,
    end: float,
    options: Options,
) -> tuple[Excluded, ...]:
    """Return the intruders that cannot come near until the plan's end, s, and why."""
    excluded = list[Excluded]()
    for number, report in enumerate(reports):
        above = _vertically_apart(own_altitude, report, end, options)
        if above is not None:
            excluded.append(Excluded(number, above, end))
            continue
        far = _out_of_reach(own, report, end, options)
        if far is not None:
            excluded.append(Excluded(number, far, end, Apart.FAR))
    return tuple(excluded)


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


def arrays_of_reports(reports: Sequence[Intruder]) -> tuple[Traffic, Array]:
    """Return checked reports as arrays as of their own times, and their ages, s, ``[1, K]``."""
    rows = [
        (*one.state, one.turn_rate, one.turn_time, one.position_std, one.velocity_std, one.age)
        for one in reports
    ]
    each = np.array(rows, dtype=float).reshape(len(rows), 9).T[:, None, :]
    x, y, heading, speed, *more, age = each
    rate, lasts, position, drift = more
    mask = np.ones((1, len(rows)), dtype=bool)
    own = [math.nan if one.separation is None else one.separation for one in reports]
    separation = None if all(map(math.isnan, own)) else np.array([own], dtype=float)
    return Traffic(
        VehicleState(x, y, heading, speed),
        mask,
        rate,
        lasts,
        position,
        drift,
        0.0 * age,
        separation,
    ), age


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


def finite(request: Request) -> None:
    """Refuse, by a RequestError, requests ``[N]`` with a number of what exists that is not
    finite.
    """
    traffic, exists = request.traffic, np.arange(request.route_x.shape[1]) < request.points[:, None]
    fields = {f"own.{name}": (values, True) for name, values in request.own._asdict().items()}
    seen = traffic.state._asdict() | traffic._asdict()
    del seen["state"], seen["mask"], seen["separation"], seen["window"]
    if traffic.separation is not None:
        seen["separation"] = np.nan_to_num(traffic.separation, posinf=np.inf)
    fields |= {f"intruders.{name}": (values, traffic.mask) for name, values in seen.items()}
    fields |= {"route_x": (request.route_x, exists), "route_y": (request.route_y, exists)}
    for name, (values, counts) in fields.items():
        for where in np.argwhere(~np.isfinite(values) & counts):
            raise RequestError(
                f"{name}{where.tolist()}", f"is {values[tuple(where)]}, expected a finite number"
            )


def eligible(request: Request, options: Options) -> Array:
    """Return the numbers of the route's points that may be rejoined at, the next one first, ``[N,
    goals]``; -1: none.

    A point counts as passed when the ownship is within the goal radius of it, or beyond it in the
    direction in which the route goes on there. Points that cannot be reached in time at the
    greatest speed are left out. Of points round areas only the next one is rejoined at.
    """
    x, y, points = request.route_x, request.route_y, request.points
    number = np.arange(x.shape[1])
    exists = number < points[:, None]
    rows, leg = np.arange(points.size)[:, None], np.minimum(number, points[:, None] - 2)
    dx, dy = (field[rows, leg + 1] - field[rows, leg] for field in (x, y))
    off_x, off_y = request.own.x[:, None] - x, request.own.y[:, None] - y
    far = np.hypot(off_x, off_y) - options.aircraft.goal_radius
    passed = ((off_x * dx + off_y * dy > 0.0) | (far <= 0.0)) & exists
    first = np.argmin(
        np.concatenate([passed, np.zeros((points.size, 1), dtype=bool)], axis=1), axis=1
    )
    fastest = np.maximum(options.manoeuvre.speed_max, request.own.speed)[:, None]
    near = far <= fastest * options.rejoin_by
    if request.drift is not None:  # who can meet what drifts more slowly once, can later too
        later_x, later_y = drift_points((x, y), request.drift, options.rejoin_by)
        later = np.hypot(request.own.x[:, None] - later_x, request.own.y[:, None] - later_y)
        near = later - options.aircraft.goal_radius <= fastest * options.rejoin_by
    if request.of_route is None:
        chosen = first[:, None] + np.arange(options.goals)
    else:  # of one request
        ahead = np.flatnonzero((request.of_route[0] >= 0) | (number == 0))
        chosen = np.append(ahead, np.full(options.goals, x.shape[1]))[None, : options.goals]
    inside = chosen < points[:, None]
    chosen = np.where(inside, chosen, 0)
    return np.where(inside & (near & exists)[rows, chosen], chosen, -1)


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


def assumptions(
    own: Altitude | None, intruders: Sequence[VehicleState | Intruder], options: Options
) -> list[Advisory]:
    """Return which vertical speeds are unknown and assumed, of those that the vertical filter
    uses.
    """
    if own is None:
        return []
    compared = [
        (number, one.altitude)
        for number, one in enumerate(intruders)
        if isinstance(one, Intruder)
        and one.altitude is not None
        and one.altitude.reference == own.reference
    ]
    fields = [
        Field(Subject.INTRUDERS, "altitude.vertical_speed", number)
        for number, altitude in compared
        if altitude.vertical_speed is None
    ]
    if compared and own.vertical_speed is None:
        fields.insert(0, Field(Subject.OWN_ALTITUDE, "vertical_speed"))
    return [unknown_climb_of(field, options) for field in fields]


def own_separations(
    intruders: Sequence[VehicleState | Intruder], options: Options
) -> list[Advisory]:
    """Return which intruders are kept other separations from than the others, and which."""
    usual = {
        "separation": options.requirement.separation,
        "vertical_separation": options.vertical_filter,
    }
    found = []
    for number, one in enumerate(intruders):
        for name, others in usual.items():
            metres = getattr(one, name, None)
            if metres is not None and metres != others:
                what = f"is {metres:g} m, of the others {others:g} m"
                field = Field(Subject.INTRUDERS, name, number)
                found.append(Advisory(AdvisoryCode.OWN_SEPARATION, field, what))
    return found


def unknown_climb_of(field: Field, options: Options) -> Advisory:
    """Return that a vertical speed is unknown, and what is assumed."""
    what = f"is unknown and taken as up to {options.unknown_climb:g} m/s either way"
    return Advisory(AdvisoryCode.ASSUMED, field, what)


def _state(name: Field, state: Any) -> VehicleState:
    """Return a state of plain floats, heading wrapped."""
    if not isinstance(state, VehicleState):
        raise RequestError(name, f"is {type(state).__name__}, expected a VehicleState")
    x = part_value(name, "x", state.x, -_FARTHEST, _FARTHEST, "m")
    y = part_value(name, "y", state.y, -_FARTHEST, _FARTHEST, "m")
    heading = part_value(name, "heading", state.heading, -2.0 * math.pi, 2.0 * math.pi, "rad")
    speed = part_value(name, "speed", state.speed, 0.0, FASTEST.speed_max, "m/s")
    return VehicleState(x, y, math.remainder(heading, 2.0 * math.pi), speed)


def _altitude(name: Field, altitude: Any) -> None:
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


def _report(name: Field, report: Intruder, options: Options) -> Intruder:
    state = _state(name, report.state)
    if report.altitude is not None:
        _altitude(name.part("altitude"), report.altitude)
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
    return Intruder(
        state,
        age,
        rate,
        lasts,
        part_value(name, "position_std", report.position_std, 0.0, 10_000.0, "m"),
        part_value(name, "velocity_std", report.velocity_std, 0.0, 100.0, "m/s"),
        report.altitude,
        _own(name, "separation", report.separation),
        _own(name, "vertical_separation", report.vertical_separation),
    )


def _own(name: Field, kind: str, separation: Any) -> float | None:
    """Return a separation of an intruder's own, m."""
    if separation is None:
        return None
    return part_value(name, kind, separation, _LEAST, _FARTHEST, "m")


def _vertically_apart(
    own: Altitude | None, report: Intruder, end: float, options: Options
) -> str | None:
    """Return why an intruder is vertically out of the way until the plan's end, or None."""
    if own is None or report.altitude is None:
        return None
    least = abs(vertical_gap(own, report.altitude, report.age, end, options.unknown_climb))
    if least <= report.vertical(options):
        return None
    return f"stays {least:.0f} m above or below ({own.reference}) for {end:.0f} s"


def _out_of_reach(own: VehicleState, report: Intruder, end: float, options: Options) -> str | None:
    """Return why an intruder cannot come near until the plan's end, or None.

    However both turn, neither flies farther than its speed times the time. The intruder may be as
    fast as traffic is, whatever its report says, and its uncertainty grows until the end.
    """
    away = least_distance(own, report.state)
    time = abs(report.age) + end
    speed = max(report.state.speed, options.aircraft.traffic_speed_max)
    fastest = max(own.speed, options.limits.speed_max) + SPEED_TOLERANCE
    spread = math.hypot(report.position_std, report.velocity_std * time)
    wanted = options.requirement
    separation = wanted.separation if report.separation is None else report.separation
    required = separation + wanted.margin + wanted.sigmas * spread
    if away - speed * time - fastest * end <= required:
        return None
    return f"is {away / 1e3:.0f} km away, out of reach within {end:.0f} s"


def least_distance(own: VehicleState, other: VehicleState) -> float:
    """Return a distance on the earth that two places in a local frame are at least apart, m.

    The frame is true from its origin outwards and stretches what lies across: by d^2 / (6 R^2) at a
    distance d (azimuthal equidistant projection; 0.04 % at 300 km).
    """
    farthest = max(math.hypot(own.x, own.y), math.hypot(other.x, other.y))
    stretch = 1.0 + (farthest / _EARTH) ** 2 / 5.0
    return math.hypot(other.x - own.x, other.y - own.y) / stretch


def _route(route: Any) -> tuple[Array, Array]:
    points = sequence(Field(Subject.ROUTE), route)
    if len(points) < 2:
        raise RequestError(Field(Subject.ROUTE), f"has {len(points)} points, expected 2 or more")
    indices: set[int] = set()
    x, y = [], []
    for number, point in enumerate(points):
        name = Field(Subject.ROUTE, number=number)
        if not isinstance(point, RoutePoint):
            raise RequestError(name, f"is {type(point).__name__}, expected a RoutePoint")
        if (
            isinstance(point.index, bool)
            or not isinstance(point.index, int)
            or not 0 <= point.index < 2**31
        ):
            raise RequestError(
                name.part("index"),
                f"is {quote(point.index)}, expected an integer from 0 to 2147483647",
            )
        if point.index in indices:
            raise RequestError(
                name.part("index"), f"is {quote(point.index)} again, expected one of its own"
            )
        indices.add(point.index)
        x.append(part_value(name, "x", point.x, -_FARTHEST, _FARTHEST, "m"))
        y.append(part_value(name, "y", point.y, -_FARTHEST, _FARTHEST, "m"))
        if number and math.hypot(x[-1] - x[-2], y[-1] - y[-2]) < 1.0:
            raise RequestError(
                name, "is closer than 1 m to the point before it, expected another place"
            )
    return np.array(x), np.array(y)
