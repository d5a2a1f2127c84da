"""The first loss of what a plan would have to keep, where the mission is flown on."""

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from agents.kernel.areas import area_clearance, relevant
from agents.kernel.clearance import clearance
from agents.kernel.levels import steady
from agents.kernel.separation import separation
from agents.kernel.traffic import growth
from agents.kernel.trajectory import straight
from agents.planner.answer import RequestError
from agents.planner.request.request import Altitude, check_request, in_wind
from envs.area_geometry import signed_distance
from envs.arrays import Array, Float
from envs.trees import take
from ros_bridge.core.tasks import PlanTask, refusal_of

_SHORT = 1e-6  # m, or m/s: of two places that are one


class Conflict(NamedTuple):
    """The first loss of the distance from an intruder or an area that a plan would have to keep,
    where the mission is flown on.
    """

    name: str  # of the intruder or the area
    time: float  # until then, s
    required: float  # distance, m


def conflict(task: PlanTask, look_ahead: float) -> Conflict | None:
    """Return the first loss of what a plan would have to keep from an intruder or an area, within
    some seconds where the ownship flies its route at its speed over the ground; None: none.
    """
    course = _along_route(task, look_ahead)
    if task.options.climbs:
        altitude = _mission_altitude(task, course)
        task = replace(task, own_altitude=altitude)
    return earliest((_first_intruder(task, course), _first_area(task, course)))


def earliest(conflicts: Iterable[Conflict | None]) -> Conflict | None:
    """Return the first of some conflicts; None: none."""
    real_conflicts = (conflict for conflict in conflicts if conflict is not None)
    return min(real_conflicts, key=lambda conflict: conflict.time, default=None)


class _Course(NamedTuple):
    """Where the ownship is to be on its route, over the ground; in between it moves uniformly."""

    x: Float[Array, "1 W"]  # m
    y: Float[Array, "1 W"]
    time: Float[Array, "1 W"]  # s


def _along_route(task: PlanTask, look_ahead: float) -> _Course:
    """Return the course along the route at the present speed, straight on behind its end."""
    own, points = task.own, task.points
    x = np.array([own.x, *(point.x for point in points)])
    y = np.array([own.y, *(point.y for point in points)])
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    distance_ahead = float(own.speed) * look_ahead
    length = max(way[-1] - way[-2], _SHORT)
    overshoot = 1.0 + max(distance_ahead - way[-1], 0.0) / length
    end_x, end_y = (field[-2] + overshoot * (field[-1] - field[-2]) for field in (x, y))
    x, y = np.append(x[:-1], end_x), np.append(y[:-1], end_y)
    way = np.append(way[:-1], way[-2] + overshoot * length)
    # The corners that are reached, each once, and where the ownship is at the end.
    corners = np.flatnonzero(np.diff(way, prepend=-np.inf) > _SHORT)
    ways = np.append(way[corners][way[corners] < distance_ahead - _SHORT], distance_ahead)
    time = ways / max(float(own.speed), _SHORT)
    return _Course(
        *(field[None] for field in (np.interp(ways, way, x), np.interp(ways, way, y), time))
    )


def _mission_altitude(task: PlanTask, course: _Course) -> Altitude | None:
    """Return the altitudes that the ownship may have on its course: from its own to those of the
    points ahead of it, as far as the course goes, with the vertical margin; None: unknown.

    Where one of them is unknown, an intruder counts as where no plan may climb: within the vertical
    filter of the altitude that goes on changing as now.
    """
    own, options = task.own_altitude, task.options
    if own is None:
        return None
    x, y = course.x[0], course.y[0]
    length = float(np.hypot(np.diff(x), np.diff(y)).sum())
    way, heights = 0.0, [own.value]
    px, py = float(task.own.x), float(task.own.y)
    for point in task.points:
        if point.altitude is None:
            more = max(options.vertical_filter - options.vertical.separation, 0.0)
            return replace(own, error=own.error + more)
        heights.append(point.altitude)
        way += math.hypot(point.x - px, point.y - py)
        if way >= length:
            break
        px, py = point.x, point.y
    low, high = min(heights), max(heights)
    error = own.error + 0.5 * (high - low) + options.vertical_margin
    return Altitude(0.5 * (low + high), own.reference, 0.0, error)


def _first_intruder(task: PlanTask, course: _Course) -> Conflict | None:
    """Return the first loss of what a plan would have to keep from an intruder, in the air mass."""
    try:
        in_air = in_wind(task.options, task.wind)
        request, _, counted = check_request(
            task.own, task.intruders, task.points, in_air, task.own_altitude, task.wind
        )
    except RequestError as error:
        raise refusal_of(error, task) from error
    if not counted:
        return None
    (x, y, time), wind, keep = course, task.wind, task.options.requirement
    trajectory = straight(x - wind.east * time, y - wind.north * time, time)
    keeping = separation(request.traffic, request.own, keep)
    clearances = clearance(trajectory, keeping)
    first = int(np.argmin(clearances.loss[0]))
    loss = float(clearances.loss[0, first])
    if not math.isfinite(loss):
        return None
    grown = growth(take(request.traffic, (0, slice(first, first + 1))), np.array(loss), keep.sigmas)
    need = keeping.required[0, first] + np.max(grown)
    return Conflict(task.identifiers[counted[first]], loss, float(need))


def _first_area(task: PlanTask, course: _Course) -> Conflict | None:
    """Return the first loss of what a plan would have to keep from an area; one that the ownship is
    in already is none, since no plan is SAFE there.
    """
    margin, (x, y, time) = task.options.requirement.margin, course
    areas = relevant(
        task.areas,
        task.own,
        steady(task.own_altitude),
        fastest=float(task.own.speed),
        horizon=float(time[0, -1]),
        unknown_climb=task.options.unknown_climb,
        margin=margin,
    )
    outside = [
        area
        for area in areas
        if area.begin > 0.0 or signed_distance(area.area, task.own.x, task.own.y) >= 0.0
    ]
    if not outside:
        return None
    clearances = clearance(straight(x, y, time), area_clearance(outside, x[:, 0], y[:, 0], margin))
    first = int(np.argmin(clearances.loss[0]))
    loss = float(clearances.loss[0, first])
    if not math.isfinite(loss):
        return None
    area = outside[first]
    name = area.area.name or f"areas[{area.number}]"
    return Conflict(name, loss, area.area.clearance + margin)
