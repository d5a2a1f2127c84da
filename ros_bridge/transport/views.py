# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""For viewers: the plan as a path and as markers in the map's frame, and the state of health."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Vector3
from nav_msgs.msg import Path
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from agents.planner.answer import Plan
from agents.planner.request import reported
from agents.planner.traffic import advanced
from envs.waypoints import Legs, knots, legs
from envs.waypoints import at as at_time
from ros_bridge.core.fields import SECOND
from ros_bridge.core.situation import Task
from ros_bridge.transport.messages import header

__all__ = ["diagnostics", "markers", "path"]

_STEP = 2.0  # s between the points of the drawn line
_SAFE, _UNSAFE, _TRAFFIC = (0.1, 0.6, 0.3), (0.85, 0.2, 0.1), (0.9, 0.55, 0.1)


def path(plan: Plan, task: Task, frame: str) -> Path:
    """Return the start and the waypoints as poses, each stamped with its time of arrival."""
    every = [(task.own.x, task.own.y, task.own.heading, 0.0)]
    every += [(point.x, point.y, point.heading, point.time) for point in plan.waypoints]
    poses = [
        PoseStamped(
            header=header(task.time + round(time * SECOND), frame),
            pose=Pose(
                position=Point(x=float(x), y=float(y)),
                orientation=Quaternion(z=math.sin(0.5 * heading), w=math.cos(0.5 * heading)),
            ),
        )
        for x, y, heading, time in every
    ]
    return Path(header=header(task.time, frame), poses=poses)


def markers(plan: Plan, task: Task, frame: str) -> MarkerArray:
    """Return the line of flight, the waypoints with their indices, and the intruders with the distance to keep."""
    stamp = header(task.time, frame)
    result = [Marker(header=stamp, action=Marker.DELETEALL)]
    colour = _colour(_SAFE if plan.safe else _UNSAFE)
    if plan.waypoints:
        line = [Point(x=x, y=y) for x, y in _line(plan, task)]
        result.append(_marker(stamp, "plan", 0, Marker.LINE_STRIP, colour, 40.0, points=line))
        dots = [Point(x=float(point.x), y=float(point.y)) for point in plan.waypoints]
        result.append(_marker(stamp, "waypoints", 0, Marker.SPHERE_LIST, colour, 150.0, points=dots))
        for number, point in enumerate(plan.waypoints):
            where = Pose(position=Point(x=float(point.x), y=float(point.y), z=200.0))
            text = _marker(stamp, "indices", number, Marker.TEXT_VIEW_FACING, colour, 250.0, pose=where)
            text.text = str(point.index)
            result.append(text)
    keep = 2.0 * task.options.requirement.separation
    for number, (name, intruder) in enumerate(zip(task.identifiers, task.intruders, strict=True)):
        now = advanced(*reported([intruder])).state
        x, y = float(now.x[0, 0]), float(now.y[0, 0])
        disc = _marker(
            stamp,
            "traffic",
            number,
            Marker.CYLINDER,
            _colour(_TRAFFIC, 0.35),
            keep,
            pose=Pose(position=Point(x=x, y=y)),
        )
        disc.scale.z = 1.0
        text = _marker(
            stamp,
            "names",
            number,
            Marker.TEXT_VIEW_FACING,
            _colour(_TRAFFIC),
            300.0,
            pose=Pose(position=Point(x=x, y=y, z=300.0)),
        )
        text.text = name
        result += [disc, text]
    return MarkerArray(markers=result)


def diagnostics(time: int, name: str, level: bytes, message: str, values: Mapping[str, str]) -> DiagnosticArray:
    """Return one state of health."""
    status = DiagnosticStatus(
        level=level,
        name=name,
        message=message,
        hardware_id="rlcas",
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )
    return DiagnosticArray(header=header(time, ""), status=[status])


def _line(plan: Plan, task: Task) -> list[tuple[float, float]]:
    """Return points along the curves between the waypoints."""
    curve, end = legs(knots(task.own, plan.waypoints)), plan.waypoints[-1].time
    times = np.append(np.arange(0.0, end, _STEP), end)
    each = Legs(*(np.broadcast_to(field, (times.size, *np.shape(field))) for field in curve))
    state = at_time(each, times)
    return list(zip(state.x.tolist(), state.y.tolist(), strict=True))


def _colour(rgb: tuple[float, float, float], alpha: float = 1.0) -> ColorRGBA:
    return ColorRGBA(r=rgb[0], g=rgb[1], b=rgb[2], a=alpha)


def _marker(stamp: Header, name: str, number: int, kind: int, colour: ColorRGBA, size: float, **more: Any) -> Marker:
    scale = Vector3(x=size, y=size, z=size)
    return Marker(header=stamp, ns=name, id=number, type=kind, action=Marker.ADD, color=colour, scale=scale, **more)
