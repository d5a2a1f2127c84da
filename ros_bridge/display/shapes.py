"""Plans, route and areas as they are drawn on the map."""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from envs.areas import Area, AreaError, Circle, Level
from envs.formats.local_frame import LocalFrame
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.waypoints import Waypoint, at, legs, plan_states, repeat
from ros_bridge.core.areas import to_local
from ros_bridge.core.conversions import PlanPoint, Published, Route
from ros_bridge.core.fields import SECOND, FieldError
from ros_bridge.core.replies import wind_of
from ros_bridge.display.aircraft import velocity_through_air
from ros_bridge.display.heights import Heights
from ros_bridge.display.picture import (
    Disc,
    DrawnArea,
    DrawnPlan,
    DrawnPoint,
    Outline,
    Point,
    Velocity,
    tenths,
)
from ros_bridge.display.scene import HeldAreas

_STEP = 4.0  # s between the points of a drawn plan
_POINTS = 400  # of a drawn plan at most
_NEAR = 100_000.0  # m from the ownship that areas are drawn


def draw_plan(
    published: Published,
    frame: LocalFrame,
    wind: tuple[float, float] | None,
    heights: Heights,
    moment: int,
) -> DrawnPlan:
    """Return a plan with the times that are left to its waypoints at a time, ns; the wind, m/s east
    and north, where it is known.
    """
    curve, profile = _curve(published, frame), _profile(published, heights)
    points = [
        DrawnPoint(
            number=point.index,
            x=place[0],
            y=place[1],
            remaining=tenths((point.time - moment) / SECOND),
            track_deg=tenths(point.track_deg),
            speed=tenths(point.speed),
            air=_through_air(point, wind),
            of_route=point.of_route,
            altitude=None if profile is None else profile[number][1],
        )
        for number, (point, place) in enumerate(
            zip(published.points, curve.points, strict=True), start=1
        )
    ]
    began = round(published.began / SECOND, 3)
    return DrawnPlan(published.revision, began, curve.line, points, profile)


def _profile(published: Published, heights: Heights) -> list[Point] | None:
    """Return the altitudes of start and waypoints over time; None where there are none that can be
    compared.
    """
    if not published.climbs:
        return None
    profile = list[Point]()
    for point in (published.start, *published.points):
        offset = None if point.altitude is None else heights.offset(point.altitude.reference)
        if point.altitude is None or offset is None:
            return None
        profile.append([round(point.time / SECOND, 2), tenths(point.altitude.value + offset)])
    return profile


def _through_air(point: PlanPoint, wind: tuple[float, float] | None) -> Velocity:
    """Return the velocity at a waypoint."""
    track = math.radians(point.track_deg)
    return velocity_through_air(point.speed * math.sin(track), point.speed * math.cos(track), wind)


class _Curve(NamedTuple):
    """What is flown between waypoints."""

    line: Sequence[Point]
    points: Sequence[Point]  # the waypoints


@lru_cache(maxsize=8)
def _curve(published: Published, frame: LocalFrame) -> _Curve:
    """Return the curve of a plan over its times, s of the source's clock."""
    plan_points = (published.start, *published.points)
    places = frame.place(
        [point.latitude for point in plan_points], [point.longitude for point in plan_points]
    )
    states = [
        _on_map(
            point, float(places.x[n]), float(places.y[n]), float(places.convergence[n]), published
        )
        for n, point in enumerate(plan_points)
    ]
    first = states[0]
    wind = wind_of(frame, published)
    start: VehicleState[Ground] = VehicleState(first.x, first.y, first.heading, first.speed)
    end, began = states[-1].time, published.began / SECOND
    times = np.linspace(0.0, end, 1 + min(math.ceil(end / _STEP), _POINTS))
    with np.errstate(all="ignore"):
        curve = legs(plan_states(start, states[1:], wind=wind))
        state = at(repeat(curve, times.size), times, wind)
    if not (np.isfinite(state.x).all() and np.isfinite(state.y).all()):
        # No aircraft flies it; what was said is drawn all the same.
        straight = [[*_place(s.x, s.y), round(began + s.time, 2)] for s in states]
        return _Curve(straight, [place[:2] for place in straight[1:]])
    line = [
        [*_place(x, y), round(began + float(time), 2)]
        for x, y, time in zip(state.x, state.y, times, strict=True)
    ]
    return _Curve(line, [_place(point.x, point.y) for point in states[1:]])


def _place(x: float, y: float) -> list[float]:
    return [tenths(x), tenths(y)]


def _on_map(point: PlanPoint, x: float, y: float, convergence: float, plan: Published) -> Waypoint:
    heading = 0.5 * math.pi - math.radians(point.track_deg) + convergence
    return Waypoint(point.index, x, y, heading, point.speed, (point.time - plan.began) / SECOND)


@lru_cache(maxsize=4)
def draw_route(route: Route | None, frame: LocalFrame) -> list[Point]:
    """Return the points of a filed route."""
    if not route:
        return []
    places = frame.place([point.latitude for point in route], [point.longitude for point in route])
    return [_place(x, y) for x, y in zip(places.x.tolist(), places.y.tolist(), strict=True)]


def draw_areas(areas: HeldAreas | None, frame: LocalFrame, moment: int) -> list[DrawnArea]:
    """Return areas as they are at a time, ns."""
    if areas is None:
        return []
    later = (moment - areas.report.time) / SECOND
    return [_area(area, later) for area in _local_areas(areas, frame)]


@lru_cache(maxsize=2)
def _local_areas(areas: HeldAreas, frame: LocalFrame) -> tuple[Area, ...]:
    """Return areas on a map as they are at their own time; none where the map cannot hold them."""
    try:
        return to_local(areas.report, frame, areas.report.time, _NEAR)
    except (FieldError, AreaError):
        return ()


def _area(area: Area, later: float) -> DrawnArea:
    """Return an area some seconds later. Only its place and size change here: checking its shape
    anew at every picture would take too long.
    """
    x, y = (later * speed for speed in area.velocity)
    grown = 0.0
    if isinstance(area.shape, Circle):
        circle = area.shape
        radius = max(circle.radius + later * area.growth, 0.0)
        shape = Disc(tenths(circle.x + x), tenths(circle.y + y), tenths(radius))
    else:
        grown = later * area.growth
        shape = Outline([[_place(px + x, py + y) for px, py in ring] for ring in area.shape.rings])
    return DrawnArea(
        name=area.name,
        keep=area.keep,
        valid=bool(area.valid_from <= later <= area.valid_until),
        clearance=tenths(area.clearance),
        shape=shape,
        growth=tenths(area.growth),
        grown=tenths(grown),
        floor=_limit(area.floor),
        ceiling=_limit(area.ceiling),
    )


def _limit(level: Level | None) -> tuple[float, str] | None:
    """Return a height, m, and what it is above."""
    return None if level is None else (tenths(level.value), level.reference)
