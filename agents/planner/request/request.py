"""A request for a plan: states, intruders and route, checked and as arrays.

Messages of what is refused name the field, the value and what was expected.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple, cast

import numpy as np

from agents.kernel.areas import ActiveArea
from agents.kernel.levels import Altitude
from agents.kernel.traffic import Traffic, advance_reports, same_flight
from agents.planner.answer import Excluded, Field, RequestError, Subject
from agents.planner.request.fields import part_value, quote, real, sequence
from agents.planner.request.options import Narrowed, Options, speed_range
from agents.planner.request.pruning import find_excluded
from agents.planner.request.reports import (
    FARTHEST,
    Intruder,
    arrays_of_reports,
    check_altitude,
    check_report,
    check_state,
    report_in_air,
    windows,
)
from envs.arrays import Array, Float
from envs.frames import Air, Ground
from envs.kinematics import FASTEST, VehicleState
from envs.trees import Shared
from envs.waypoints import RoutePoint
from envs.wind import NO_WIND, Wind, narrow, through_air

BEYOND = 2**31 - 1
"""Number of a point beyond the end of the route that was asked for (:class:`Request`)."""

_LEAST_LEG = 1.0  # m between points of a route
_STRONGEST = 150.0  # m/s of wind, beyond any on earth


class Request(NamedTuple):
    """Requests as arrays; fields ``[N]``, of intruders ``[N, K]``, of routes ``[N, R]``.

    In a wind everything is in the air mass, which lies over the ground at the request: speeds are
    airspeeds, and the route's points drift.
    """

    own: VehicleState[Air]
    traffic: Traffic
    route_x: Array  # at the request, m
    route_y: Array
    points: Array  # how many points each route has
    # velocity of the route's points towards east and north, m/s, [N] each; None: they stand still
    drift: tuple[Array, Array] | None = None
    # what of the areas a plan may meet, the same for all N; None: nothing
    areas: Shared[tuple[ActiveArea, ...]] | None = None
    # numbers of the points in the route that was asked for, [N, R], what is passed left out; -1: a
    # point round an area; BEYOND: one beyond the route's end; None: they are all of the route
    of_route: Array | None = None


def check_request(
    own: VehicleState[Ground],
    intruders: Sequence[VehicleState[Ground] | Intruder[Ground]],
    route: Sequence[RoutePoint],
    options: Options[Narrowed],
    own_altitude: Altitude | None = None,
    wind: Wind | None = None,
) -> tuple[Request, tuple[Excluded, ...], list[int]]:
    """Check one request, whose options are (:func:`agents.planner.request.options.check`).

    Returns:
        The request as arrays with N = 1, the intruders that are left out, and the numbers of those
        that count.

    Raises:
        RequestError: something is missing, not finite, out of range or inconsistent.
    """
    state = _check_own(own, options, wind)
    check_altitude(Field(Subject.OWN_ALTITUDE), own_altitude)
    reports = _check_intruders(intruders, options, wind)
    x, y = _check_route(route)
    blows = 0.0 if wind is None else wind.speed
    end = float(options.latest_end(state.speed, x, y, wind=blows))
    excluded = find_excluded(state, reports, own_altitude, end, options)
    pruned = {intruder.number for intruder in excluded}
    counted = [number for number in range(len(reports)) if number not in pruned]
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
    reports: Sequence[Intruder[Air]],
    counted: Sequence[int],
    own_altitude: Altitude | None,
    options: Options[Narrowed],
) -> Traffic:
    """Return those of the intruders that count, as of the request, ``[1, K]``."""
    counted_reports = [reports[number] for number in counted]
    reported, age = arrays_of_reports(counted_reports)
    traffic = advance_reports(reported, age)
    # Plans are checked against the traffic as of the request: it must fly what the reports say, by
    # the kernel's arithmetic.
    if age.any():
        for number in np.flatnonzero(~same_flight(reported, age, traffic)[0]).tolist():
            raise RequestError(
                Field(Subject.INTRUDERS, number=counted[number]),
                "cannot be advanced from its report to the request",
            )
    return traffic._replace(window=windows(counted_reports, own_altitude, options))


def latest_end(request: Request, options: Options[Narrowed]) -> Float[Array, " N"]:
    """Return a time that no plan of requests outlasts, s."""
    wind = 0.0 if request.drift is None else np.hypot(*request.drift)
    return options.latest_end(
        request.own.speed, request.route_x, request.route_y, request.points, wind
    )


def in_wind(options: Options, wind: Any) -> Options[Narrowed]:
    """Return the options for flight in the air mass of a wind: limits that hold the given ones in
    every wind within its uncertainty; None: still air, which takes nothing off them.

    Raises:
        RequestError: the wind is none, not finite, faster than the aircraft, or too uncertain.
    """
    if wind is None:
        return cast("Options[Narrowed]", options)
    if not isinstance(wind, Wind):
        raise RequestError(Field(Subject.WIND), f"is {type(wind).__name__}, expected a Wind")
    for name, low in (("east", -_STRONGEST), ("north", -_STRONGEST), ("std", 0.0)):
        real(Field(Subject.WIND, name), getattr(wind, name), low, _STRONGEST, "m/s")
    error = options.requirement.sigmas * float(wind.std)
    fastest = float(options.manoeuvre.speed_max)
    if wind.speed + error >= fastest:
        unsure = f", or {wind.speed + error:.1f} m/s with its uncertainty" if error > 0.0 else ""
        problem = (
            f"is {wind.speed:.1f} m/s{unsure}, expected less than the {fastest:.1f} m/s that the "
            "aircraft makes against it"
        )
        raise RequestError(Field(Subject.WIND), problem)
    limits, flown = narrow(options.limits, error), narrow(options.manoeuvre, error)
    for left in (limits, flown):
        least = min(left.speed_max - left.speed_min, left.acceleration_max, left.yaw_rate_max)
        if error > 0.0 and not (least > 0.0 and left.acceleration_min < 0.0):
            problem = (
                f"is {wind.std:g} m/s: {options.requirement.sigmas:g} sigmas of that leave nothing "
                "of the aircraft's speeds, accelerations or turn rate; expected less"
            )
            raise RequestError(Field(Subject.WIND, "std"), problem)
    return cast("Options[Narrowed]", replace(options, limits=limits, manoeuvre=flown))


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
    if traffic.window is not None:  # an infinite time is one
        for name, values in traffic.window._asdict().items():
            times = np.where(np.isinf(values), 0.0, values)
            _check_numbers(f"intruders.window.{name}", times, traffic.mask)
    exists = np.arange(request.route_x.shape[1]) < request.points[:, None]
    _check_numbers("route_x", request.route_x, exists)
    _check_numbers("route_y", request.route_y, exists)


def _check_numbers(name: str, values: Array, counts: Array) -> None:
    """Refuse numbers that are not finite where they count."""
    for where in np.argwhere(~np.isfinite(values) & counts):
        problem = f"is {values[tuple(where)]}, expected a finite number"
        raise RequestError(f"{name}{where.tolist()}", problem)


def drift_points(
    points: tuple[Float[Array, "N ..."], Float[Array, "N ..."]],
    drift: tuple[Array, Array] | None,
    time: Float[Array, "..."],
) -> tuple[Float[Array, "N ..."], Float[Array, "N ..."]]:
    """Return where points of routes ``[N, ...]`` are some seconds after the request, m, as their
    drift ``[N]`` carries them.
    """
    if drift is None:
        return points
    x, y = points
    shape = (-1,) + (1,) * (np.ndim(x) - 1)
    east, north = (np.reshape(part, shape) for part in drift)
    return x + east * time, y + north * time


def _check_own(own: Any, options: Options[Narrowed], wind: Wind | None) -> VehicleState[Air]:
    """Return the state of the ownship in floats."""
    ground = check_state(Field(Subject.OWN), own)
    state = through_air(ground, wind or NO_WIND, 0.0)
    low, high = speed_range(options.aircraft.limits)
    if not low <= state.speed <= high:
        air = "" if wind is None else f", {state.speed:g} m/s through the air"
        problem = f"is {ground.speed:g} m/s{air}, expected {low:g} to {high:g}"
        raise RequestError(Field(Subject.OWN, "speed"), problem)
    return state


def _check_intruders(
    intruders: Any, options: Options[Narrowed], wind: Wind | None
) -> list[Intruder[Air]]:
    """Return the reports of the intruders."""
    reported = sequence(Field(Subject.INTRUDERS), intruders)
    names = [Field(Subject.INTRUDERS, number=number) for number in range(len(reported))]
    reports = [
        check_report(
            name, intruder if isinstance(intruder, Intruder) else Intruder(intruder), options
        )
        for name, intruder in zip(names, reported, strict=True)
    ]
    in_air = [report_in_air(report, wind) for report in reports]
    if wind is not None:
        part = "state.speed through the air"
        for name, report in zip(names, in_air, strict=True):
            part_value(name, part, report.state.speed, 0.0, FASTEST.speed_max, "m/s")
    return in_air


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
        _check_index(name, point.index, indices)
        indices.add(point.index)
        x.append(part_value(name, "x", point.x, -FARTHEST, FARTHEST, "m"))
        y.append(part_value(name, "y", point.y, -FARTHEST, FARTHEST, "m"))
        if number and math.hypot(x[-1] - x[-2], y[-1] - y[-2]) < _LEAST_LEG:
            raise RequestError(
                name, "is closer than 1 m to the point before it, expected another place"
            )
    return np.array(x), np.array(y)


def _check_index(point: Field, index: Any, used: set[int]) -> None:
    """Refuse what is no index of a point, and one that is taken."""
    whole = isinstance(index, int) and not isinstance(index, bool)
    if not whole or not 0 <= index < 2**31:
        problem = f"is {quote(index)}, expected an integer from 0 to 2147483647"
        raise RequestError(point.part("index"), problem)
    if index in used:
        raise RequestError(point.part("index"), f"is {quote(index)} again, expected one of its own")
