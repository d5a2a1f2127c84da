# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""Domain values as messages of ``rlcas_msgs``; the other direction is :mod:`ros_bridge.conversions`."""

import uuid
from collections.abc import Iterable

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Vector3
from rlcas_msgs.msg import AircraftState, Trajectory, Waypoint
from std_msgs.msg import Header
from unique_identifier_msgs.msg import UUID

from agents.plan import WAYPOINTS, Plan, Source
from agents.request import Altitude
from envs.waypoints import Waypoint as LocalWaypoint
from ros_bridge.answers import backup_points, plan_points, start_point
from ros_bridge.conversions import (
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
    trajectory,
)
from ros_bridge.fields import SECOND, FieldError
from ros_bridge.picture import Task
from ros_bridge.tracks import Report
from ros_bridge.watching import Published, Watching

__all__ = [
    "aircraft_message",
    "backup_message",
    "header",
    "identity",
    "plan_message",
    "point_message",
    "published_of",
    "time_message",
    "uuid_of",
]

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


def plan_message(plan: Plan, task: Task, frame: str, revision: int, unique: uuid.UUID) -> Trajectory:
    """Return a plan, safe or not, as a trajectory; one without waypoints has the status UNRESOLVED and none."""
    separated = bool(np.isfinite(plan.min_separation) and np.isfinite(plan.time_of_min_separation))
    return Trajectory(
        header=header(task.time, frame),
        id=identity(unique),
        revision=revision,
        status=Trajectory.STATUS_SAFE if plan.safe else Trajectory.STATUS_UNRESOLVED,
        source=_SOURCES[plan.source],
        intruder_ids=_kept(plan, task),
        min_separation=float(plan.min_separation) if separated else -1.0,
        time_of_min_separation=float(plan.time_of_min_separation) if separated else -1.0,
        rejoin_index=-1 if plan.goal_index is None else plan.goal_index,
        start=point_message(start_point(task.frame, task.own, task.time, task.own_altitude)),
        waypoints=[point_message(point) for point in plan_points(plan, task)],
    )


def aircraft_message(report: Report, frame: str = "") -> AircraftState:
    """Return a report as an AircraftState; the inverse of :func:`ros_bridge.conversions.aircraft`."""
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


def published_of(message: Trajectory, name: str = "trajectory") -> Published:
    """Return a SAFE plan as the monitor reads it.

    Raises:
        FieldError: it is not called SAFE, or a field is not finite, out of range or inconsistent.
    """
    if message.status != Trajectory.STATUS_SAFE:
        raise FieldError(f"{name}.status", f"is {message.status}, expected {Trajectory.STATUS_SAFE} (SAFE)")
    if len(message.waypoints) != WAYPOINTS:
        raise FieldError(f"{name}.waypoints", f"has {len(message.waypoints)} points, expected {WAYPOINTS}")
    began, start, points = trajectory(message, name)
    unique = uuid_of(message.id).bytes
    return Published(unique, message.revision, began, start, points, tuple(message.intruder_ids))


def backup_message(
    watching: Watching, altitude: Altitude | None, frame: str, revision: int, unique: uuid.UUID
) -> Trajectory:
    """Return the backup at hand as a trajectory of status BACKUP."""
    backup = watching.watch.monitor.backup
    began = watching.zero + round(float(backup.started[0]) * SECOND)
    rows = np.stack([values[0] for values in backup.knots], axis=-1).tolist()
    every = [LocalWaypoint(number, *row) for number, row in enumerate(rows)]
    local = watching.frame
    assert local is not None, "a backup has a frame"
    start, *points = backup_points(local, every, began, altitude)
    return Trajectory(
        header=header(began, frame),
        id=identity(unique),
        revision=revision,
        status=Trajectory.STATUS_BACKUP,
        min_separation=-1.0,
        time_of_min_separation=-1.0,
        rejoin_index=-1,
        start=point_message(start),
        waypoints=[point_message(point) for point in points],
    )


def _kept(plan: Plan, task: Task) -> Iterable[str]:
    out = {one.number for one in plan.excluded}
    return [name for number, name in enumerate(task.identifiers) if number not in out]
