"""Messages of MAVLink as domain values; they are read by their fields, and nothing here connects.

Times are those of the autopilot's own clock, which begins at its start, ns
(:class:`ros_bridge.mavlink.link.Clock`).
"""

import math
from collections.abc import Mapping
from enum import IntEnum
from types import MappingProxyType, SimpleNamespace
from typing import TYPE_CHECKING, NamedTuple

from agents.planner.request.request import Altitude
from ros_bridge.core.adapters import adsb_vehicle
from ros_bridge.core.conversions import altitude, report, velocity
from ros_bridge.core.fields import SECOND, FieldError, number, place
from ros_bridge.core.reports import Report

if TYPE_CHECKING:
    from pymavlink.dialects.v20 import ardupilotmega as dialect

OWN = "ownship"
"""The name under which the ownship's reports go."""

_WIND = 100.0  # m/s
_ARMED = 128  # MAV_MODE_FLAG_SAFETY_ARMED
_CRITICAL = 5  # MAV_STATE_CRITICAL

# ESTIMATOR_STATUS_FLAGS, which EKF_STATUS_FLAGS share.
_VELOCITY_HORIZONTAL, _POSITION_ABSOLUTE, _CONSTANT_POSITION = 2, 16, 128
_WITHOUT_POSITION = 1024  # EKF_UNINITIALIZED; GPS_GLITCH in ESTIMATOR_STATUS


class Mode(IntEnum):
    """Of ArduPlane, as its heartbeat's ``custom_mode`` has them."""

    MANUAL = 0
    CIRCLE = 1
    STABILIZE = 2
    TRAINING = 3
    ACRO = 4
    FBWA = 5
    FBWB = 6
    CRUISE = 7
    AUTOTUNE = 8
    AUTO = 10
    RTL = 11
    LOITER = 12
    TAKEOFF = 13
    AVOID_ADSB = 14
    GUIDED = 15
    INITIALISING = 16
    QSTABILIZE = 17
    QHOVER = 18
    QLOITER = 19
    QLAND = 20
    QRTL = 21
    QAUTOTUNE = 22
    QACRO = 23
    THERMAL = 24
    LOITER_ALT_QLAND = 25
    AUTOLAND = 26


class Heartbeat(NamedTuple):
    """What the autopilot's heartbeat says."""

    mode: int
    armed: bool
    failsafe: bool = False  # whether one of the autopilot's failsafes holds

    @property
    def mode_name(self) -> str:
        """Name of the mode, or its number."""
        return mode_name(self.mode)


def mode_name(mode: int) -> str:
    """Return the name of a mode of ArduPlane, or its number where it has none that is known."""
    return Mode(mode).name if mode in set(Mode) else f"mode {mode}"


def heartbeat(message: "dialect.MAVLink_heartbeat_message") -> Heartbeat:
    """Return what a HEARTBEAT says."""
    armed, failsafe = bool(message.base_mode & _ARMED), message.system_status == _CRITICAL
    return Heartbeat(int(message.custom_mode), armed, failsafe)


def ownship(
    message: "dialect.MAVLink_global_position_int_message",
    wind: tuple[float, float] | None = None,
    airspeed: float | None = None,
) -> Report:
    """Return the ownship's report from a GLOBAL_POSITION_INT, or raise :class:`FieldError` with a
    sighting.

    Its altitude is above mean sea level, its time that of the autopilot's clock.

    Args:
        message: GLOBAL_POSITION_INT.
        wind: velocity of the air, true east and north, m/s; None: unknown.
        airspeed: m/s; None: unknown.
    """
    climb = -0.01 * message.vz
    return report(
        OWN,
        lambda: boot_time(message),
        lambda: place(OWN, 1e-7 * message.lat, 1e-7 * message.lon),
        lambda: velocity(OWN, 0.01 * message.vy, 0.01 * message.vx),
        lambda: altitude(f"{OWN}.altitude", 0.001 * message.alt, "msl", climb),
        position_std=lambda: 0.0,
        velocity_std=lambda: 0.0,
        wind=lambda: wind,
        true_airspeed=lambda: airspeed,
    )


def boot_time(
    message: "dialect.MAVLink_global_position_int_message | dialect.MAVLink_system_time_message",
) -> int:
    """Return the time of a message with ``time_boot_ms``, ns."""
    return int(message.time_boot_ms) * (SECOND // 1000)


def wind(message: "dialect.MAVLink_wind_message") -> tuple[float, float]:
    """Return the velocity of the air, true east and north, m/s, from a WIND, which has where it
    comes from.
    """
    speed = number("wind.speed", message.speed, 0.0, _WIND, "m/s")
    course = math.radians(number("wind.direction", message.direction, -360.0, 360.0, "degrees"))
    return -speed * math.sin(course), -speed * math.cos(course)


def airspeed(message: "dialect.MAVLink_vfr_hud_message") -> float:
    """Return the airspeed of a VFR_HUD, m/s."""
    return number("vfr_hud.airspeed", message.airspeed, 0.0, 400.0, "m/s")


def estimate_problem(
    message: "dialect.MAVLink_ekf_status_report_message | dialect.MAVLink_estimator_status_message",
) -> str:
    """Return why the autopilot's estimate of place and velocity is not to be planned with, from an
    EKF_STATUS_REPORT or ESTIMATOR_STATUS; "": it is.
    """
    flags = int(message.flags)
    kind = message.get_type()
    if kind == "EKF_STATUS_REPORT" and flags & _WITHOUT_POSITION:
        return f"{kind} says that the estimator has not begun"
    if flags & _CONSTANT_POSITION:
        return f"{kind} says that the position is held constant"
    if not flags & _POSITION_ABSOLUTE or not flags & _VELOCITY_HORIZONTAL:
        return f"{kind} has no absolute horizontal position and velocity"
    return ""


def fix_problem(message: "dialect.MAVLink_gps_raw_int_message") -> str:
    """Return why the satellite fix of a GPS_RAW_INT is not to be relied on; "": it is."""
    if message.fix_type < 3:
        return f"GPS_RAW_INT has fix {message.fix_type}, expected 3 (3D) or more"
    return ""


def traffic(
    message: "dialect.MAVLink_adsb_vehicle_message",
    arrived: int,
    references: Mapping[int, str] = MappingProxyType({}),
    own: Report | None = None,
) -> Report | None:
    """Return the report of an ADSB_VEHICLE; None: it is a surface vehicle on the ground, and no
    traffic.

    What its flags do not mark as valid is unknown, as in
    :func:`ros_bridge.core.adapters.adsb_vehicle`, which also says what the altitude's references
    are.

    Args:
        message: ADSB_VEHICLE.
        arrived: when, on the autopilot's clock, ns.
        references: what ``altitude_type`` 0 (barometric) and 1 (geometric) are measured from here.
        own: the ownship; None: unknown.

    Raises:
        FieldError: position or velocity are not marked as valid, or a field is out of range.
    """
    seconds, nanoseconds = divmod(arrived, SECOND)
    equal_fields = ("emitter_type", "flags", "altitude_type")
    return adsb_vehicle(
        SimpleNamespace(
            icao_address=message.ICAO_address,
            header=SimpleNamespace(stamp=SimpleNamespace(sec=seconds, nanosec=nanoseconds)),
            tslc=SimpleNamespace(sec=int(message.tslc), nanosec=0),
            latitude=1e-7 * message.lat,
            longitude=1e-7 * message.lon,
            callsign=message.callsign,
            altitude=0.001 * message.altitude,
            heading=0.01 * message.heading,
            hor_velocity=0.01 * message.hor_velocity,
            ver_velocity=0.01 * message.ver_velocity,
            **{name: int(getattr(message, name)) for name in equal_fields},
        ),
        references,
        own,
    )


def traffic_name(message: "dialect.MAVLink_adsb_vehicle_message") -> str:
    """Return under which name the aircraft of an ADSB_VEHICLE goes."""
    return f"{int(message.ICAO_address):06x}"


class Target(NamedTuple):
    """A place that the autopilot is sent to, of 1e-7 degrees and m above mean sea level."""

    latitude: int
    longitude: int
    altitude: float


def target(latitude: float, longitude: float, height: Altitude) -> Target:
    """Return a place in the units of commands."""
    if height.reference != "msl":
        raise FieldError("target.altitude", f"is above {height.reference}, expected msl")
    return Target(round(1e7 * latitude), round(1e7 * longitude), height.value)


def roll_quaternion(roll: float) -> tuple[float, float, float, float]:
    """Return the attitude of a roll alone, rad, positive to the right, as SET_ATTITUDE_TARGET
    takes it.
    """
    return math.cos(0.5 * roll), math.sin(0.5 * roll), 0.0, 0.0
