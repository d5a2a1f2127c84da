"""Reports of other people's messages: NavSatFix, NovAtel's INSPVA and ADS-B, read by their fields.

None of their packages is imported. What such a message does not say is the caller's: a NavSatFix has no velocity, and
whether its altitude is above the ellipsoid, as the definition has it, or above mean sea level, as several drivers do,
is a setting.
"""

import math
from collections.abc import Mapping
from types import MappingProxyType, SimpleNamespace
from typing import Any

from agents.planner.request import Altitude
from ros_bridge.core.conversions import report
from ros_bridge.core.fields import SECOND, FieldError, identifier, integer, number, stamp
from ros_bridge.core.tracks import Report

__all__ = ["adsb_vehicle", "inspva", "nav_sat_fix", "odometry_velocity"]

# MAVLink message 246, ADSB_FLAGS.
_COORDINATES, _ALTITUDE, _HEADING, _VELOCITY = 1, 2, 4, 8
_VERTICAL_VELOCITY = 128
_SILENCE = 255  # s; the largest value that time since last communication can have
_INS_GOOD = 3  # INS_SOLUTION_GOOD (NovAtel OEM7, inertial solution status)


def nav_sat_fix(message: Any, twist: Any, identity: str, reference: str = "wgs84", name: str = "fix") -> Report:
    """Return a report from a NavSatFix and the velocity beside it.

    Args:
        message: sensor_msgs/NavSatFix.
        twist: geometry_msgs/Twist with the velocity in ENU over the ground, m/s.
        identity: of the aircraft.
        reference: of the altitude that the driver really publishes.
        name: in messages.

    Raises:
        FieldError: there is no fix, or a field is not finite or out of range.
    """
    status = integer(f"{name}.status.status", message.status.status, -128, 127)
    if status < 0:
        raise FieldError(f"{name}.status.status", f"is {status}, expected 0 or more: there is no fix")
    spread = 0.0
    if message.position_covariance_type != 0:
        east, north = (
            number(f"{name}.position_covariance[{n}]", message.position_covariance[n], 0.0, 1e8, "m^2") for n in (0, 4)
        )
        spread = math.sqrt(max(east, north))
    climb = number(f"{name}.twist.linear.z", twist.linear.z, -100.0, 100.0, "m/s")
    return report(
        name,
        identifier(f"{name}.id", identity),
        stamp(f"{name}.header.stamp", message.header.stamp),
        (message.latitude, message.longitude),
        (twist.linear.x, twist.linear.y),
        altitude=_altitude(f"{name}.altitude", message.altitude, reference, climb),
        position_std=spread,
    )


def odometry_velocity(message: Any, name: str = "odometry") -> Any:
    """Return the velocity of a nav_msgs/Odometry in ENU as something with the fields of a Twist.

    Its twist is given in the frame of the body (REP 105's child frame), whose attitude in ENU is the pose's.

    Raises:
        FieldError: the attitude is no rotation, or a field is not finite.
    """
    twist, attitude = message.twist.twist.linear, message.pose.pose.orientation
    x, y, z, w = (number(f"{name}.orientation.{axis}", getattr(attitude, axis), -1.01, 1.01, "") for axis in "xyzw")
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if abs(length - 1.0) > 0.01:
        raise FieldError(f"{name}.orientation", f"has length {length:g}, expected 1")
    x, y, z, w = x / length, y / length, z / length, w / length
    ahead, left, up = (number(f"{name}.twist.linear.{a}", getattr(twist, a), -400.0, 400.0, "m/s") for a in "xyz")
    east = (1 - 2 * (y * y + z * z)) * ahead + 2 * (x * y - w * z) * left + 2 * (x * z + w * y) * up
    north = 2 * (x * y + w * z) * ahead + (1 - 2 * (x * x + z * z)) * left + 2 * (y * z - w * x) * up
    climb = 2 * (x * z - w * y) * ahead + 2 * (y * z + w * x) * left + (1 - 2 * (x * x + y * y)) * up
    return SimpleNamespace(linear=SimpleNamespace(x=east, y=north, z=climb))


def inspva(message: Any, identity: str, name: str = "inspva") -> Report:
    """Return a report from NovAtel's INSPVA or INSPVAX: height above the ellipsoid, velocities north, east, up.

    Raises:
        FieldError: the inertial solution is not good, or a field is not finite or out of range.
    """
    field = "status" if hasattr(message, "status") else "ins_status"
    status = integer(f"{name}.{field}.status", getattr(message, field).status, 0, 2**32 - 1)
    if status != _INS_GOOD:
        raise FieldError(f"{name}.{field}.status", f"is {status}, expected {_INS_GOOD} (INS_SOLUTION_GOOD)")
    climb = number(f"{name}.up_velocity", message.up_velocity, -100.0, 100.0, "m/s")
    return report(
        name,
        identifier(f"{name}.id", identity),
        stamp(f"{name}.header.stamp", message.header.stamp),
        (message.latitude, message.longitude),
        (message.east_velocity, message.north_velocity),
        altitude=_altitude(f"{name}.height", message.height, "wgs84", climb),
    )


def adsb_vehicle(message: Any, references: Mapping[int, str] = MappingProxyType({}), name: str = "adsb") -> Report:
    """Return a report from an ADS-B vehicle as MAVLink and mavros have it.

    The message is stamped when it was received; the state held ``tslc`` (time since last communication, whole
    seconds) before that. What is cut off lies between 0 and 1 s: its root mean square at the reported speed is the
    position's standard deviation. What ``altitude`` is measured from depends on the receiver (field names speak of
    QNH and of geometry, documentation of mean sea level), so it counts as unknown unless the caller knows it.

    Args:
        message: fields of mavros_msgs/ADSBVehicle: SI units, heading in radians clockwise from north, ``tslc`` a
            duration.
        references: what ``altitude_type`` 0 (barometric) and 1 (geometric) mean here, such as ``{0: "pressure"}``.
        name: in messages.

    Raises:
        FieldError: position or velocity are not marked as valid, or a field is not finite or out of range.
    """
    flags = integer(f"{name}.flags", message.flags, 0, 2**16 - 1)
    for bit, what in ((_COORDINATES, "coordinates"), (_HEADING, "heading"), (_VELOCITY, "velocity")):
        if not flags & bit:
            raise FieldError(f"{name}.flags", f"is {flags:#x}, expected the bit of valid {what}")
    address = integer(f"{name}.icao_address", message.icao_address, 1, 2**24 - 1)
    silent = integer(f"{name}.tslc.sec", message.tslc.sec, 0, _SILENCE - 1)
    speed = number(f"{name}.hor_velocity", message.hor_velocity, 0.0, 400.0, "m/s")
    heading = number(f"{name}.heading", message.heading, -2.0 * math.pi, 2.0 * math.pi, "rad")
    climb = 0.0
    if flags & _VERTICAL_VELOCITY:
        climb = number(f"{name}.ver_velocity", message.ver_velocity, -100.0, 100.0, "m/s")
    height = None
    if flags & _ALTITUDE:
        kind = integer(f"{name}.altitude_type", message.altitude_type, 0, 1)
        if kind in references:
            height = _altitude(f"{name}.altitude", message.altitude, references[kind], climb)
    return report(
        name,
        f"{address:06x}",
        stamp(f"{name}.header.stamp", message.header.stamp) - silent * SECOND,
        (message.latitude, message.longitude),
        (speed * math.sin(heading), speed * math.cos(heading)),
        altitude=height,
        position_std=speed / math.sqrt(3.0),
    )


def _altitude(name: str, value: Any, reference: str, climb: float) -> Altitude:
    if reference not in ("wgs84", "msl", "pressure"):
        raise FieldError(f"{name}_reference", f"is {reference!r}, expected wgs84, msl or pressure")
    return Altitude(number(name, value, -1_000.0, 30_000.0, "m"), reference, climb)
