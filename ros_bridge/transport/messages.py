# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""Domain values as messages of ``rlcas_msgs``; the other direction is :mod:`ros_bridge.core.conversions`."""

import uuid
from array import array
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Vector3
from rlcas_msgs.msg import AircraftState, Trajectory, Waypoint
from std_msgs.msg import Header
from unique_identifier_msgs.msg import UUID

from agents.planner.answer import Plan, Source
from ros_bridge.core.conversions import (
    ALTITUDE,
    ALTITUDE_CODES,
    POINT_ALTITUDE,
    POINT_SPEED,
    POINT_TIME,
    POINT_TRACK,
    POSITION,
    POSITION_STD,
    TRUE_AIRSPEED,
    VELOCITY,
    VELOCITY_STD,
    VERTICAL_SPEED,
    WIND,
    PlanPoint,
)
from ros_bridge.core.fields import SECOND
from ros_bridge.core.replies import plan_points, start_point
from ros_bridge.core.reports import Report, Sighting
from ros_bridge.core.situation import Task

_CODES = {name: code for code, name in ALTITUDE_CODES.items()}
_SOURCES = {
    Source.NONE: Trajectory.SOURCE_NONE,
    Source.POLICY: Trajectory.SOURCE_POLICY,
    Source.FALLBACK: Trajectory.SOURCE_FALLBACK,
}


def time_message(time: int) -> Time:
    """Return nanoseconds as a time of ROS."""
    return Time(sec=time // SECOND, nanosec=time % SECOND)


def header(time: int, frame: str) -> Header:
    """Return a header; ``time`` in ns."""
    return Header(stamp=time_message(time), frame_id=frame)


def identity(value: uuid.UUID) -> UUID:
    """Return a UUID as a message."""
    return UUID(uuid=np.frombuffer(value.bytes, dtype=np.uint8))


def uuid_of(message: UUID) -> uuid.UUID:
    """Return the UUID that a message holds."""
    return uuid.UUID(bytes=bytes(bytearray(message.uuid)))


def point_message(point: PlanPoint) -> Waypoint:
    """Return a waypoint of a plan."""
    message = Waypoint(
        index=point.index,
        origin=Waypoint.ORIGIN_ROUTE if point.of_route else Waypoint.ORIGIN_POLICY,
        valid=POINT_TRACK | POINT_SPEED | POINT_TIME,
        latitude=point.latitude,
        longitude=point.longitude,
        track_deg=point.track_deg,
        ground_speed=point.speed,
        time_of_arrival=time_message(point.time),
    )
    if point.altitude is not None:
        message.valid |= POINT_ALTITUDE
        message.altitude = point.altitude.value
        message.altitude_reference = _CODES[point.altitude.reference]
    return message


def trajectory_message(status: int, time: int, frame: str, revision: int, **more: Any) -> Trajectory:
    """Return a trajectory with an id of its own; what is not given there is none of.

    Args:
        status: of Trajectory.
        time: of its start, ns.
    """
    none = {"min_separation": -1.0, "time_of_min_separation": -1.0, "rejoin_index": -1}
    given = {"id": identity(uuid.uuid4())} | none | more
    return Trajectory(header=header(time, frame), status=status, revision=revision, **given)


def plan_message(plan: Plan, task: Task, frame: str, revision: int, *, certified: bool = False) -> Trajectory:
    """Return a plan, safe or not, as a trajectory; one without waypoints has the status UNRESOLVED and none.

    Args:
        certified: whether a SAFE plan carries its certificate.
    """
    out = {one.number for one in plan.excluded}
    more: dict[str, Any] = {}
    if np.isfinite(plan.min_separation) and np.isfinite(plan.time_of_min_separation):
        more = {
            "min_separation": float(plan.min_separation),
            "time_of_min_separation": float(plan.time_of_min_separation),
        }
    if plan.goal_index is not None:
        more["rejoin_index"] = plan.goal_index
    return trajectory_message(
        Trajectory.STATUS_SAFE if plan.safe else Trajectory.STATUS_UNRESOLVED,
        task.time,
        frame,
        revision,
        source=_SOURCES[plan.source],
        intruder_ids=[name for number, name in enumerate(task.identifiers) if number not in out],
        start=point_message(start_point(task.frame, task.own, task.time, task.own_altitude)),
        waypoints=[point_message(point) for point in plan_points(plan, task)],
        # An array of bytes is taken as it is; other sequences are looked at byte by byte.
        certificate=array("B", (plan.certificate if certified else None) or b""),
        **more,
    )


def aircraft_message(report: Report, frame: str = "") -> AircraftState:
    """Return a report as an AircraftState; the inverse of :func:`ros_bridge.core.conversions.aircraft`."""
    message = AircraftState(
        header=header(report.time, frame),
        id=report.identifier,
        valid=POSITION | VELOCITY,
        latitude=report.latitude,
        longitude=report.longitude,
        velocity=Vector3(x=report.east, y=report.north),
    )
    if report.altitude is not None:
        message.valid |= ALTITUDE | VERTICAL_SPEED
        message.altitude = report.altitude.value
        message.altitude_reference = _CODES[report.altitude.reference]
        message.velocity.z = report.altitude.vertical_speed
    if report.position_std > 0.0:
        message.valid |= POSITION_STD
        message.position_std = report.position_std
    if report.velocity_std > 0.0:
        message.valid |= VELOCITY_STD
        message.velocity_std = report.velocity_std
    if report.true_airspeed is not None:
        message.valid |= TRUE_AIRSPEED
        message.true_airspeed = report.true_airspeed
    if report.wind is not None:
        message.valid |= WIND
        message.wind = Vector3(x=report.wind[0], y=report.wind[1])
    return message


def sighting_message(sighting: Sighting, frame: str = "") -> AircraftState:
    """Return an AircraftState that names an aircraft, and its place if that is known, without the bit of a velocity.

    No plan can be made with it; but the aircraft counts until a good state of it follows.
    """
    message = AircraftState(header=header(sighting.time or 0, frame), id=sighting.identifier)
    if sighting.place is not None:
        message.valid |= POSITION
        message.latitude, message.longitude = sighting.place
    if sighting.altitude is not None:
        message.valid |= ALTITUDE
        message.altitude, message.altitude_reference = sighting.altitude.value, _CODES[sighting.altitude.reference]
    return message
