"""For viewers: the plan as a path and as markers in the map's frame, and the state of health."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Vector3
from nav_msgs.msg import Odometry, Path
from rclpy.node import Node
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from agents.kernel.traffic import advance_reports
from agents.planner.answer import Plan
from agents.planner.request.reports import Intruder, arrays_of_reports, report_in_air
from envs.areas import Area, Circle, Keep, Polygon, Ring
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.profile import Profile, level, profile_of
from envs.waypoints import Waypoint, at, legs, plan_states, repeat
from ros_bridge.core.fields import SECOND
from ros_bridge.core.reports import Report
from ros_bridge.core.tasks import PlanTask
from ros_bridge.transport.messages import header

BODY = "base_link"
"""Frame of the ownship's body (REP 105)."""

_TEXT = Marker.TEXT_VIEW_FACING
_FLAT = level(0.0)  # heights of a plan in the plane
_STEP = 2.0  # s between the points of the drawn line
_CORNERS = 48  # of a drawn circle
_AREAS = {Keep.OUT: (0.75, 0.1, 0.4), Keep.IN: (0.2, 0.45, 0.8)}
_SAFE, _UNSAFE, _TRAFFIC = (0.1, 0.6, 0.3), (0.85, 0.2, 0.1), (0.9, 0.55, 0.1)


def odometry(own: VehicleState[Ground], report: Report, turn: float, frame: str) -> Odometry:
    """Return the ownship in the map's frame, as of its report; its twist is in the body's frame, x
    ahead along the track. What the report does not know has a variance of -1.
    """
    message = Odometry(header=header(report.time, frame), child_frame_id=BODY)
    message.pose.pose = _pose(own.x, own.y)
    message.pose.pose.orientation = _facing(own.heading)
    message.twist.twist.linear.x, message.twist.twist.angular.z = own.speed, turn
    for part, std in ((message.pose, report.position_std), (message.twist, report.velocity_std)):
        variance = -1.0 if std is None else std**2
        part.covariance[0], part.covariance[7] = variance, variance
    return message


def path(plan: Plan, task: PlanTask, frame: str) -> Path:
    """Return the start and the waypoints as poses, each stamped with its time of arrival; z is the
    height above the start, 0 where the plan is in the plane.
    """
    heights = _heights(plan, task)
    start = Waypoint(0, task.own.x, task.own.y, task.own.heading, task.own.speed, 0.0)
    poses = [
        PoseStamped(
            header=header(task.time + round(point.time * SECOND), frame),
            pose=Pose(
                position=_point(point, heights),
                orientation=_facing(float(point.heading)),
            ),
        )
        for point in (start, *plan.waypoints)
    ]
    return Path(header=header(task.time, frame), poses=poses)


def markers(plan: Plan, task: PlanTask, frame: str) -> MarkerArray:
    """Return the line of flight, the waypoints with their indices, the intruders with the distance
    to keep from each, and the edges of the areas, all as of the request; where the plan climbs, at
    their heights above the ownship.
    """
    drawing = _Drawing(header(task.time, frame))
    unit = 0.25 * task.options.aircraft.separation
    heights = _heights(plan, task)
    if plan.waypoints:
        _draw_plan(drawing, plan, task, heights, unit)
    _draw_traffic(drawing, task, unit, in_height=heights is not _FLAT)
    for area in task.areas:
        _draw_area(drawing, area, unit)
    return MarkerArray(markers=drawing.markers)


class _Drawing:
    """Markers that replace all before; they are numbered within their namespaces."""

    def __init__(self, stamp: Header) -> None:
        self._stamp = stamp
        self.markers = [Marker(header=stamp, action=Marker.DELETEALL)]

    def add(self, name: str, kind: int, colour: ColorRGBA, size: float, **more: Any) -> Marker:
        """Add a marker to a namespace and return it; its size is m in all directions."""
        number = sum(marker.ns == name for marker in self.markers)
        marker = Marker(
            header=self._stamp,
            ns=name,
            id=number,
            type=kind,
            color=colour,
            scale=Vector3(x=size, y=size, z=size),
            **more,
        )
        self.markers.append(marker)
        return marker


def _draw_plan(
    drawing: _Drawing, plan: Plan, task: PlanTask, heights: Profile, unit: float
) -> None:
    """Draw a plan's line, its waypoints and their indices."""
    colour = _colour(_SAFE if plan.safe else _UNSAFE)
    line = _line(plan, task, heights)
    drawing.add("plan", Marker.LINE_STRIP, colour, 0.16 * unit, points=line)
    dots = [_point(point, heights) for point in plan.waypoints]
    drawing.add("waypoints", Marker.SPHERE_LIST, colour, 0.6 * unit, points=dots)
    for point, dot in zip(plan.waypoints, dots, strict=True):
        pose = _pose(point.x, point.y, z=dot.z + unit)
        drawing.add("indices", _TEXT, colour, unit, text=str(point.index), pose=pose)


def _draw_traffic(drawing: _Drawing, task: PlanTask, unit: float, *, in_height: bool) -> None:
    """Draw a disc as wide as the distance to keep around each intruder, and its name."""
    colour, faint = _colour(_TRAFFIC), _colour(_TRAFFIC, 0.35)
    for name, intruder in zip(task.identifiers, task.intruders, strict=True):
        state = advance_reports(*arrays_of_reports([report_in_air(intruder, None)])).state
        x, y = float(state.x[0, 0]), float(state.y[0, 0])
        usual, own = task.options.requirement.separation, intruder.separation
        width = 2.0 * (usual if own is None else own)
        z = _above(intruder, task) if in_height else 0.0
        disc = drawing.add("traffic", Marker.CYLINDER, faint, width, pose=_pose(x, y, z))
        disc.scale.z = 1.0
        drawing.add("names", _TEXT, colour, unit, text=name, pose=_pose(x, y, z + unit))


def _draw_area(drawing: _Drawing, area: Area, unit: float) -> None:
    """Draw the edges of an area, and its name at the first of their points."""
    colour = _colour(_AREAS[area.keep])
    shape = area.shape
    rings = shape.rings if isinstance(shape, Polygon) else (_ring_about(shape),)
    for ring in rings:
        edge = [Point(x=x, y=y) for x, y in (*ring, ring[0])]
        drawing.add("areas", Marker.LINE_STRIP, colour, 0.16 * unit, points=edge)
    if area.name:
        pose = _pose(*rings[0][0], z=unit)
        drawing.add("area names", _TEXT, colour, unit, text=area.name, pose=pose)


def _ring_about(circle: Circle) -> Ring:
    """Return points of a circle, counter-clockwise from its easternmost."""
    angles = np.linspace(0.0, 2.0 * math.pi, _CORNERS, endpoint=False)
    x = circle.x + circle.radius * np.cos(angles)
    y = circle.y + circle.radius * np.sin(angles)
    return tuple(zip(x.tolist(), y.tolist(), strict=True))


def diagnostics(
    node: Node, level: bytes, message: str, values: Mapping[str, str]
) -> DiagnosticArray:
    """Return a node's state of health."""
    status = DiagnosticStatus(
        level=level, name=node.get_fully_qualified_name(), message=message, hardware_id="rlcas"
    )
    status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
    return DiagnosticArray(header=header(node.get_clock().now().nanoseconds, ""), status=[status])


def _line(plan: Plan, task: PlanTask, heights: Profile) -> list[Point]:
    """Return points of a plan's curve."""
    curve = legs(plan_states(task.own, plan.waypoints, wind=plan.wind))
    end = plan.waypoints[-1].time
    times = np.append(np.arange(0.0, end, _STEP), end)
    state = at(repeat(curve, times.size), times, plan.wind)
    places = zip(state.x.tolist(), state.y.tolist(), heights.at(times).tolist(), strict=True)
    return [Point(x=x, y=y, z=z) for x, y, z in places]


def _heights(plan: Plan, task: PlanTask) -> Profile:
    """Return a plan's heights above its start, m; :data:`_FLAT` where it is in the plane."""
    own = task.own_altitude
    climbs = any(point.altitude is not None for point in plan.waypoints)
    if not climbs or own is None or own.vertical_speed is None:
        return _FLAT
    acceleration = task.options.vertical.acceleration
    profile = profile_of(own.value, own.vertical_speed, plan.waypoints, acceleration)
    assert profile is not None, "the waypoints have altitudes"
    return profile._replace(altitude=profile.altitude - own.value)


def _point(point: Waypoint, heights: Profile) -> Point:
    return Point(x=float(point.x), y=float(point.y), z=float(heights.at(np.array(point.time))))


def _above(intruder: Intruder[Ground], task: PlanTask) -> float:
    """Return how far an intruder is above the ownship, m; 0 where that is unknown."""
    own, altitude = task.own_altitude, intruder.altitude
    if own is None or altitude is None or own.reference != altitude.reference:
        return 0.0
    return altitude.value + (altitude.vertical_speed or 0.0) * intruder.age - own.value


def _facing(heading: float) -> Quaternion:
    """Return a turn about z by a heading, rad."""
    return Quaternion(z=math.sin(0.5 * heading), w=math.cos(0.5 * heading))


def _colour(rgb: tuple[float, float, float], alpha: float = 1.0) -> ColorRGBA:
    return ColorRGBA(r=rgb[0], g=rgb[1], b=rgb[2], a=alpha)


def _pose(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(position=Point(x=float(x), y=float(y), z=z))
