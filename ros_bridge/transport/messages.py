"""Domain values as messages of ``rlcas_msgs``, of their fields
(:mod:`ros_bridge.core.message_fields`); the other direction is :mod:`ros_bridge.core.conversions`.
"""

import uuid
from array import array
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from builtin_interfaces.msg import Time
from rlcas_msgs.msg import Advisory as AdvisoryMessage
from rlcas_msgs.msg import AircraftState, Areas, Ring, Trajectory, Waypoint
from rlcas_msgs.msg import Area as AreaMessage
from std_msgs.msg import Header

from agents.planner.answer import Advisory, Plan
from envs.areas import Area
from envs.formats.local_frame import LocalFrame
from ros_bridge.core import message_fields
from ros_bridge.core.areas import to_geodetic
from ros_bridge.core.conversions import STATUS_SAFE, STATUS_UNRESOLVED
from ros_bridge.core.fields import SECOND, Sighting
from ros_bridge.core.replies import published
from ros_bridge.core.reports import Report
from ros_bridge.core.tasks import PlanTask

_M = TypeVar("_M")
_PARTS: dict[str, type] = {"waypoints": Waypoint, "areas": AreaMessage, "rings": Ring}


def time_message(time: int) -> Time:
    """Return nanoseconds as a time of ROS."""
    return Time(sec=time // SECOND, nanosec=time % SECOND)


def header(time: int, frame: str) -> Header:
    """Return a header; ``time`` in ns."""
    return Header(stamp=time_message(time), frame_id=frame)


def filled(kind: type[_M], fields: Mapping[str, Any], frame: str = "") -> _M:
    """Return a message of a kind, with fields filled in; ``frame`` is that of its header."""
    message: Any = _fill(kind(), fields)
    if frame:
        message.header.frame_id = frame
    return message


def _fill(message: Any, fields: Mapping[str, Any]) -> Any:
    for name, value in fields.items():
        if isinstance(value, Mapping):
            _fill(getattr(message, name), value)
        elif name in _PARTS:
            setattr(message, name, [_fill(_PARTS[name](), part) for part in value])
        else:
            setattr(message, name, value)
    return message


def plan_message(
    plan: Plan, task: PlanTask, frame: str, revision: int, *, certified: bool = False
) -> Trajectory:
    """Return a plan as a trajectory with an id of its own, UNRESOLVED unless it is safe;
    ``certified`` with the certificate of a SAFE one.
    """
    proof = None
    if certified:
        proof = plan.certificate_with(task.time, (task.frame.latitude, task.frame.longitude))
    status = STATUS_SAFE if plan.safe else STATUS_UNRESOLVED
    written = published(plan, task, revision, uuid.uuid4().bytes)
    trajectory = filled(Trajectory, message_fields.plan(written, status), frame)
    trajectory.source = getattr(Trajectory, f"SOURCE_{plan.source.name}")
    # An array of bytes is taken as it is; other sequences are looked at byte by byte.
    trajectory.certificate = array("B", proof or b"")
    closest = float(plan.min_separation), float(plan.time_of_min_separation)
    if all(map(np.isfinite, closest)):
        trajectory.min_separation, trajectory.time_of_min_separation = closest
    if plan.goal_index is not None:
        trajectory.rejoin_index = plan.goal_index
    return trajectory


def advisory_message(advisory: Advisory) -> AdvisoryMessage:
    """Return an advisory whose field has a name."""
    return AdvisoryMessage(code=int(advisory.code), field=str(advisory.field), text=advisory.text)


def aircraft_message(report: Report | Sighting) -> AircraftState:
    """Return a report as an AircraftState, the inverse of
    :func:`ros_bridge.core.conversions.aircraft`.

    Of a sighting it has no bit of a velocity: no plan can be made with it; but the aircraft counts
    until a good state of it follows.
    """
    return filled(AircraftState, message_fields.aircraft(report))


def areas_message(areas: Sequence[Area], time: int, frame: LocalFrame, frame_id: str) -> Areas:
    """Return areas of a local frame as they are at a time, ns."""
    geodetic = tuple(to_geodetic(area, frame) for area in areas)
    return filled(Areas, message_fields.areas(geodetic, time), frame_id)
