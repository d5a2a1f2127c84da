# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""What the monitor alone reads and publishes, as messages of ``rlcas_msgs``; the runner starts sooner without it."""

import uuid

import numpy as np
from rlcas_msgs.msg import Trajectory

from agents.planner.answer import WAYPOINTS
from agents.planner.request import Altitude
from envs.waypoints import Waypoint as LocalWaypoint
from ros_bridge.core.assurance import Published, Supervision
from ros_bridge.core.conversions import trajectory
from ros_bridge.core.fields import SECOND, FieldError
from ros_bridge.core.replies import backup_points
from ros_bridge.transport.messages import header, identity, point_message, uuid_of

__all__ = ["backup_message", "published_of"]


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
    supervision: Supervision, altitude: Altitude | None, frame: str, revision: int, unique: uuid.UUID
) -> Trajectory:
    """Return the backup at hand as a trajectory of status BACKUP."""
    backup = supervision.watch.monitor.backup
    began = supervision.zero + round(float(backup.started[0]) * SECOND)
    rows = np.stack([values[0] for values in backup.knots], axis=-1).tolist()
    every = [LocalWaypoint(number, *row) for number, row in enumerate(rows)]
    local = supervision.frame
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
