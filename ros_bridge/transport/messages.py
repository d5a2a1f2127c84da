"""Domain values as messages of ``rlcas_msgs``; the other direction is
:mod:`ros_bridge.core.conversions`.
"""

import uuid
from array import array
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rlcas_msgs.msg import Advisory as AdvisoryMessage
from rlcas_msgs.msg import AircraftState, Trajectory, Waypoint
from std_msgs.msg import Header
from unique_identifier_msgs.msg import UUID

from agents.planner.answer import Advisory, Plan
from agents.planner.request.request import Altitude
from ros_bridge.core.conversions import ALTITUDE_NUMBERS, PlanPoint
from ros_bridge.core.fields import SECOND, Sighting
from ros_bridge.core.replies import plan_points, start_point, true_wind
from ros_bridge.core.reports import Report
from ros_bridge.core.tasks import PlanTask


def time_message(time: int) -> Time:
    """Return nanoseconds as a time of ROS."""
    return Time(sec=time // SECOND, nanosec=time % SECOND)


def header(time: int, frame: str) -> Header:
    """Return a header; ``time`` in ns."""
    return Header(stamp=time_message(time), frame_id=frame)


def identity(value: uuid.UUID) -> UUID:
    """Return a UUID as a message."""
    return UUID(uuid=np.frombuffer(value.bytes, dtype=np.uint8))


def point_message(point: PlanPoint) -> Waypoint:
    """Return a waypoint of a plan."""
    message = Waypoint(
        index=point.index,
        origin=Waypoint.ORIGIN_ROUTE if point.of_route else Waypoint.ORIGIN_POLICY,
        valid=Waypoint.VALID_TRACK | Waypoint.VALID_GROUND_SPEED | Waypoint.VALID_TIME_OF_ARRIVAL,
        latitude=point.latitude,
        longitude=point.longitude,
        track_deg=point.track_deg,
        ground_speed=point.speed,
        time_of_arrival=time_message(point.time),
    )
    _set_altitude(message, point.altitude)
    if point.altitude is not None and point.altitude.vertical_speed is not None:
        message.valid |= Waypoint.VALID_CLIMB
        message.climb = point.altitude.vertical_speed
    return message


def trajectory_message(
    status: int, time: int, frame: str, revision: int, **more: Any
) -> Trajectory:
    """Return a trajectory that starts at a time, ns, with an id of its own; what is not given there
    is none of.
    """
    none = {"min_separation": -1.0, "time_of_min_separation": -1.0, "rejoin_index": -1}
    fields: dict[str, Any] = {"id": identity(uuid.uuid4())} | none | more
    return Trajectory(header=header(time, frame), status=status, revision=revision, **fields)


def plan_message(
    plan: Plan, task: PlanTask, frame: str, revision: int, *, certified: bool = False
) -> Trajectory:
    """Return a plan as a trajectory, UNRESOLVED unless it is safe; ``certified`` with the
    certificate of a SAFE one.
    """
    excluded = {exclusion.number for exclusion in plan.excluded}
    proof = None
    if certified:
        proof = plan.certificate_with(task.time, (task.frame.latitude, task.frame.longitude))
    climbs = any(point.altitude is not None for point in plan.waypoints)
    start = start_point(task.frame, task.own, task.time, task.own_altitude, climbs=climbs)
    message = trajectory_message(
        Trajectory.STATUS_SAFE if plan.safe else Trajectory.STATUS_UNRESOLVED,
        task.time,
        frame,
        revision,
        source=getattr(Trajectory, f"SOURCE_{plan.source.name}"),
        intruder_ids=[
            name for number, name in enumerate(task.identifiers) if number not in excluded
        ],
        start=point_message(start),
        waypoints=[point_message(point) for point in plan_points(plan, task)],
        # An array of bytes is taken as it is; other sequences are looked at byte by byte.
        certificate=array("B", proof or b""),
    )
    if plan.wind is not None:
        at = message.start.latitude, message.start.longitude
        message.wind.x, message.wind.y = true_wind(task.frame, plan.wind, *at)
        message.wind_std = float(plan.wind.std)
    closest = float(plan.min_separation), float(plan.time_of_min_separation)
    if all(map(np.isfinite, closest)):
        message.min_separation, message.time_of_min_separation = closest
    if plan.goal_index is not None:
        message.rejoin_index = plan.goal_index
    return message


def advisory_message(advisory: Advisory) -> AdvisoryMessage:
    """Return an advisory whose field has a name."""
    return AdvisoryMessage(code=int(advisory.code), field=str(advisory.field), text=advisory.text)


def aircraft_message(report: Report, frame: str = "") -> AircraftState:
    """Return a report as an AircraftState; the inverse of
    :func:`ros_bridge.core.conversions.aircraft`.
    """
    message = sighting_message(report.sighting, frame)
    message.valid |= AircraftState.VALID_VELOCITY
    message.velocity.x, message.velocity.y = report.east, report.north
    if report.position_std is not None:
        message.valid |= AircraftState.VALID_POSITION_STD
        message.position_std = report.position_std
    if report.velocity_std is not None:
        message.valid |= AircraftState.VALID_VELOCITY_STD
        message.velocity_std = report.velocity_std
    if report.time_std > 0.0:
        message.valid |= AircraftState.VALID_TIME_STD
        message.time_std = report.time_std
    if report.true_airspeed is not None:
        message.valid |= AircraftState.VALID_TRUE_AIRSPEED
        message.true_airspeed = report.true_airspeed
    if report.wind is not None:
        message.valid |= AircraftState.VALID_WIND
        message.wind.x, message.wind.y = report.wind
    message.category, message.callsign = report.category, report.callsign
    return message


def sighting_message(sighting: Sighting, frame: str = "") -> AircraftState:
    """Return an AircraftState that names an aircraft, and its place if that is known, without the
    bit of a velocity.

    No plan can be made with it; but the aircraft counts until a good state of it follows.
    """
    message = AircraftState(header=header(sighting.time or 0, frame), id=sighting.identifier)
    if sighting.place is not None:
        message.valid |= AircraftState.VALID_POSITION
        message.latitude, message.longitude = sighting.place
    _set_altitude(message, sighting.altitude)
    if sighting.altitude is not None and sighting.altitude.vertical_speed is not None:
        message.valid |= AircraftState.VALID_VERTICAL_SPEED
        message.velocity.z = sighting.altitude.vertical_speed
    return message


def _set_altitude(message: AircraftState | Waypoint, altitude: Altitude | None) -> None:
    if altitude is not None:
        message.valid |= message.VALID_ALTITUDE
        message.altitude, message.altitude_reference = (
            altitude.value,
            ALTITUDE_NUMBERS[altitude.reference],
        )
