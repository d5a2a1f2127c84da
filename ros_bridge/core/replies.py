"""Plans of the local frame as points on the ellipsoid, and back."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from agents.planner.answer import Plan
from agents.planner.request.request import Altitude
from envs.angles import wrap
from envs.formats.local_frame import LocalFrame
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.waypoints import Waypoint
from envs.wind import NO_WIND, Wind
from ros_bridge.core.conversions import PlanPoint, Published
from ros_bridge.core.fields import SECOND
from ros_bridge.core.motion import wind_in
from ros_bridge.core.tasks import PlanTask


def plan_points(plan: Plan, task: PlanTask) -> tuple[PlanPoint, ...]:
    """Return the waypoints of a plan on the ellipsoid; of a plan in the plane those of the route
    keep the route's altitude.
    """
    filed = {point.index: point.altitude for point in task.route}
    return geodetic_points(task.frame, plan.waypoints, task.time, task.own_altitude, filed)


def start_point(
    frame: LocalFrame,
    own: VehicleState[Ground],
    time: int,
    altitude: Altitude | None,
    *,
    climbs: bool = False,
) -> PlanPoint:
    """Return where a plan starts, on the ellipsoid, with the ownship's climb if the plan climbs;
    its index means nothing.
    """
    start = Waypoint(0, own.x, own.y, own.heading, own.speed, 0.0)
    if climbs and altitude is not None:
        start = replace(start, altitude=altitude.value, climb=altitude.vertical_speed)
    return geodetic_points(frame, [start], time, altitude)[0]


def published(plan: Plan, task: PlanTask, revision: int, unique: bytes) -> Published:
    """Return a plan as it is published; ``unique`` are the 16 bytes of its id."""
    left_out = {exclusion.number for exclusion in plan.excluded}
    names = (name for number, name in enumerate(task.identifiers) if number not in left_out)
    climbs = any(point.altitude is not None for point in plan.waypoints)
    start = start_point(task.frame, task.own, task.time, task.own_altitude, climbs=climbs)
    wind = plan.wind or NO_WIND
    return Published(
        unique,
        revision,
        task.time,
        start,
        plan_points(plan, task),
        tuple(names),
        true_wind(task.frame, wind, start.latitude, start.longitude),
        float(wind.std),
    )


def wind_of(frame: LocalFrame, plan: Published) -> Wind | None:
    """Return the wind that a published plan is flown in, in a frame; None: still air."""
    return wind_in(frame, plan.start.latitude, plan.start.longitude, plan.wind, plan.wind_std)


def true_wind(
    frame: LocalFrame, wind: Wind, latitude: float, longitude: float
) -> tuple[float, float]:
    """Return a frame's wind by true east and north at a place, m/s; the inverse of
    :func:`ros_bridge.core.motion.wind_in`.
    """
    turn = float(frame.place(latitude, longitude).convergence)
    cosine, sine = math.cos(turn), math.sin(turn)
    east, north = float(wind.east), float(wind.north)
    return east * cosine + north * sine, north * cosine - east * sine


def to_frame(
    frame: LocalFrame, plan: Published
) -> tuple[VehicleState[Ground], tuple[Waypoint, ...]]:
    """Return a published plan in a frame, not only its writer's: the first state, and the
    waypoints, times in s.
    """
    points = [plan.start, *plan.points]
    places = frame.place(
        [point.latitude for point in points], [point.longitude for point in points]
    )
    track = np.radians([point.track_deg for point in points])
    heading = wrap(0.5 * math.pi - track + places.convergence, np)
    waypoints = [
        Waypoint(
            point.index,
            float(x),
            float(y),
            float(psi),
            point.speed,
            (point.time - plan.began) / SECOND,
            *_planned_altitude(plan, point),
        )
        for point, x, y, psi in zip(points, places.x, places.y, heading, strict=True)
    ]
    first = waypoints[0]
    return VehicleState(first.x, first.y, first.heading, first.speed), tuple(waypoints[1:])


def _planned_altitude(plan: Published, point: PlanPoint) -> tuple[float | None, float | None]:
    """Return altitude, m, and climb, m/s, of a waypoint; None, None where the plan is in the
    plane.
    """
    if not plan.climbs or point.altitude is None:
        return None, None
    return point.altitude.value, point.altitude.vertical_speed


def geodetic_points(
    frame: LocalFrame,
    waypoints: Sequence[Waypoint],
    time: int,
    altitude: Altitude | None,
    filed: Mapping[int, Altitude | None] = MappingProxyType({}),
) -> tuple[PlanPoint, ...]:
    """Return waypoints on the ellipsoid, times of arrival to the nanosecond.

    Args:
        frame: that they were made in.
        waypoints: with times from ``time``, ns.
        altitude: of the ownship. Waypoints that climb have their altitudes in its reference; of
            others all keep it but points of the route, whose altitudes are ``filed`` by index.
    """
    if not waypoints:
        return ()
    places = frame.geodetic([point.x for point in waypoints], [point.y for point in waypoints])
    track = np.degrees(
        0.5 * math.pi - np.array([point.heading for point in waypoints]) + places.convergence
    )
    track = np.remainder(track, 360.0)
    track = np.where(track >= 360.0, 0.0, track)

    def height(point: Waypoint) -> Altitude | None:
        if altitude is None:
            return filed.get(point.index)
        if point.altitude is not None:
            return Altitude(point.altitude, altitude.reference, point.climb)
        return filed.get(point.index) or Altitude(altitude.value, altitude.reference)

    return tuple(
        PlanPoint(
            point.index,
            point.index in filed,
            latitude,
            longitude,
            height(point),
            direction,
            float(point.speed),
            time + round(point.time * SECOND),
        )
        for point, latitude, longitude, direction in zip(
            waypoints,
            places.latitude.tolist(),
            places.longitude.tolist(),
            track.tolist(),
            strict=True,
        )
    )
