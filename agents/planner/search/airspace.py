"""The areas of a request: which of them a plan may meet, and what they leave of the route."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from agents.kernel.areas import ActiveArea, label, relevant
from agents.kernel.levels import Line
from agents.planner.answer import Advisory, AdvisoryCode, Field, RequestError, Subject
from agents.planner.request.advisories import assumed_climb
from agents.planner.request.fields import sequence
from agents.planner.request.options import Maneuvers, Narrowed, Options
from agents.planner.request.pruning import SPEED_TOLERANCE
from agents.planner.request.request import BEYOND, Request, drift_points, latest_end
from agents.planner.search.detours import Place, airspace
from agents.planner.search.goals import next_goals
from envs.area_geometry import signed_distance
from envs.areas import Area, Keep, in_air
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.trees import Shared
from envs.wind import Wind

MOST = 1_000
"""Areas of a request at most."""

_PAD = 0.06
"""By how much farther than required ways go round areas, separations: what turns take of it."""

_LATER = 100.0  # s after the last free waypoint until which ways round areas are looked for


def add_areas(
    request: Request,
    areas: Sequence[Area],
    flight: Sequence[Line],
    options: Options[Narrowed],
    wind: Wind | None = None,
) -> tuple[Request, tuple[Advisory, ...]]:
    """Return one request ``[1]`` with the areas that a plan of it may meet, and what is assumed of
    the altitudes and which points of the route are passed over.

    Points that lie in an area when they would be reached are left out; where an area lies across
    the route, points round it are put in, unless plans may only climb and descend.

    Args:
        request: without areas.
        areas: over the ground.
        flight: the ownship's altitude; none: unknown, which counts as level with every area.
        options: of the flight.
        wind: which the air mass moves with.

    Raises:
        RequestError: something is no area, or there are too many.
    """
    checked = check_areas(areas)
    if not checked:
        return request, ()
    air_areas = checked if wind is None else [in_air(area, wind) for area in checked]
    own: VehicleState[Air] = VehicleState(*(float(field[0]) for field in request.own))
    near = _reachable_areas(air_areas, request, own, flight, options)
    adapted, notes = request, list[Advisory]()
    if near:
        adapted, notes = _without_points_in(near, request, own, options)
        if options.maneuvers is not Maneuvers.VERTICAL:
            adapted = _with_points_round(near, adapted, own, options)
    if adapted is not request:  # its legs may be longer, and plans of it last longer
        near = _reachable_areas(air_areas, adapted, own, flight, options)
    if near:
        adapted = adapted._replace(areas=Shared(near))
    return adapted, (*_assumed_climb(checked, flight, options), *notes)


def check_areas(areas: Any) -> Sequence[Area]:
    """Return areas; raise a RequestError where something is no area, or there are too many."""
    checked = sequence(Field(Subject.AREAS), areas)
    for number, area in enumerate(checked):
        if not isinstance(area, Area):
            problem = f"is {type(area).__name__}, expected an Area"
            raise RequestError(Field(Subject.AREAS, number=number), problem)
    if len(checked) > MOST:
        raise RequestError(Field(Subject.AREAS), f"are {len(checked)}, expected {MOST} at most")
    return checked


def _assumed_climb(
    areas: Sequence[Area], flight: Sequence[Line], options: Options[Narrowed]
) -> list[Advisory]:
    """Return that the ownship's vertical speed is unknown, where heights of areas ask for it."""
    unknown = {line.altitude.reference for line in flight if line.altitude.vertical_speed is None}
    levels = [level for area in areas for level in (area.floor, area.ceiling) if level is not None]
    if all(level.reference not in unknown for level in levels):
        return []
    return [assumed_climb(Field(Subject.OWN_ALTITUDE, "vertical_speed"), options)]


def _reachable_areas(
    areas: Sequence[Area],
    request: Request,
    own: VehicleState[Air],
    flight: Sequence[Line],
    options: Options[Narrowed],
) -> tuple[ActiveArea, ...]:
    """Return the areas that some plan of a request may meet."""
    end = float(np.max(latest_end(request, options)))
    fastest = max(own.speed, options.limits.speed_max) + SPEED_TOLERANCE
    return relevant(
        areas,
        own,
        flight,
        fastest=fastest,
        horizon=end,
        unknown_climb=options.unknown_climb,
        margin=options.requirement.margin,
    )


def _without_points_in(
    areas: Sequence[ActiveArea],
    request: Request,
    own: VehicleState[Air],
    options: Options[Narrowed],
) -> tuple[Request, list[Advisory]]:
    """Return a request without the points of its route that lie in areas."""
    x, y = request.route_x[0], request.route_y[0]
    time = _reach(request, own)
    places = drift_points((x[None], y[None]), request.drift, time)
    holder = _holders(areas, places[0][0], places[1][0], time, options.requirement.margin)
    inside = np.flatnonzero(holder >= 0)
    if inside.size == 0:
        return request, []
    by_number = {active.number: active for active in areas}
    notes = [
        Advisory(
            AdvisoryCode.PASSED_OVER,
            Field(Subject.ROUTE, number=int(number)),
            f"{_where_forbidden(by_number[int(holder[number])])} and is passed over",
        )
        for number in inside
    ]
    free = np.flatnonzero(holder < 0)
    if free.size < 2:
        problem = (
            f"has {inside.size} of its {x.size} points where areas or their clearances forbid "
            "flight, expected 2 or more elsewhere"
        )
        raise RequestError(Field(Subject.ROUTE), problem)
    reduced = request._replace(
        route_x=x[None, free],
        route_y=y[None, free],
        points=np.array([free.size]),
        of_route=free[None],
    )
    return reduced, notes


def _where_forbidden(active: ActiveArea) -> str:
    """Return where a point lies that an area forbids."""
    if active.area.keep is Keep.IN:
        return f"lies outside of {label(active)} or in its clearance"
    return f"lies in {label(active)} or its clearance"


def _with_points_round(
    areas: tuple[ActiveArea, ...],
    request: Request,
    own: VehicleState[Air],
    options: Options[Narrowed],
) -> Request:
    """Return a request with points round areas in its route where those lie in its way.

    Points that are passed are left out, and a route that may be extended is, as far as a plan goes.
    """
    first = int(next_goals(request, replace(options, rejoin_by=1e9))[0, 0])
    if first < 0:
        return request
    x, y, number = _ahead(request, first, options)
    east, north = (0.0, 0.0) if request.drift is None else request.drift
    drift = float(np.sum(east)), float(np.sum(north))
    unit, latest = options.aircraft.separation, options.finished_by + _LATER
    sky = airspace(areas, own, options.requirement.margin, _PAD * unit, latest)
    place, points, bent = Place(own.x, own.y, 0.0), list[tuple[float, float, int]](), False
    for to_x, to_y, of in zip(x.tolist(), y.tolist(), number.tolist(), strict=True):
        way = sky.way(place, to_x, to_y, drift) if place.time < latest else []
        bent |= len(way) > 1
        points += [(at.x - drift[0] * at.time, at.y - drift[1] * at.time, -1) for at in way[:-1]]
        points.append((to_x, to_y, of))
        place = way[-1] if way else sky.straight(place, to_x, to_y, drift)
    if not bent:
        return request
    route_x, route_y, of_route = (np.array([column]) for column in zip(*points, strict=True))
    return request._replace(
        route_x=route_x, route_y=route_y, points=np.array([len(points)]), of_route=of_route
    )


def _ahead(request: Request, first: int, options: Options[Narrowed]) -> tuple[Array, Array, Array]:
    """Return the points of a route that are ahead, m, and their numbers in the one asked for."""
    x, y = request.route_x[0], request.route_y[0]
    number = np.arange(x.size) if request.of_route is None else request.of_route[0]
    if options.extend_route:
        wind = 0.0 if request.drift is None else float(np.hypot(*request.drift)[0])
        dx, dy = x[-1] - x[-2], y[-1] - y[-2]
        step = np.arange(1, options.points_beyond(wind) + 1) * options.extension
        step = step / max(float(np.hypot(dx, dy)), 1e-9)
        x, y = np.append(x, x[-1] + step * dx), np.append(y, y[-1] + step * dy)
        number = np.append(number, np.full(step.size, BEYOND))
    return x[first:], y[first:], number[first:]


def _reach(request: Request, own: VehicleState[Air]) -> Array:
    """Return when the points of a route would be reached at the present airspeed, s, ``[R]``."""
    x, y = (
        np.concatenate([[begin], field[0]])
        for begin, field in ((own.x, request.route_x), (own.y, request.route_y))
    )
    speed = max(own.speed, 1.0)
    if request.drift is None:
        return np.cumsum(np.hypot(np.diff(x), np.diff(y))) / speed
    # Against the drift of its points a route is as much longer as they get away.
    times, at = [], 0.0
    east, north = (float(part[0]) for part in request.drift)
    for dx, dy in zip(np.diff(x), np.diff(y), strict=True):
        length = max(float(np.hypot(dx, dy)), 1e-9)
        along, across = (dx * east + dy * north) / length, (dx * north - dy * east) / length
        pace = np.sqrt(max(speed * speed - across * across, 0.0)) - along
        at += length / max(pace, 1.0)
        times.append(at)
    return np.array(times)


def _holders(areas: Sequence[ActiveArea], x: Array, y: Array, time: Array, margin: float) -> Array:
    """Return the number of the first area in which places lie at some times, s, or nearer to it
    than its clearance; -1: none; ``[M]``.
    """
    holder = np.full(np.shape(x), -1)
    for active in reversed(areas):
        away = signed_distance(active.area, x, y, time)
        inside = (
            (away < active.area.clearance + margin) & (active.begin <= time) & (time <= active.end)
        )
        holder[inside] = active.number
    return holder
