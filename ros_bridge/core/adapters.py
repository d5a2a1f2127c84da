"""Messages of other packages as reports: NavSatFix, NovAtel's INSPVA and ADS-B, read by their
fields.

None of their packages is imported. What such a message lacks is the caller's: a NavSatFix has no
velocity, and whether its altitude is above the ellipsoid, as the definition has it, or above mean
sea level, as several drivers do, is a setting.
"""

import math
from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType, SimpleNamespace
from typing import Any, NamedTuple

from agents.planner.request.request import Altitude
from ros_bridge.core.categories import LAST
from ros_bridge.core.conversions import altitude, report, velocity
from ros_bridge.core.feeds.accuracy import RECENT_STD
from ros_bridge.core.fields import (
    SECOND,
    FieldError,
    attempt,
    callsign,
    identifier,
    integer,
    number,
    place,
    stamp,
)
from ros_bridge.core.ground import on_ground
from ros_bridge.core.reports import FASTEST, Report

# MAVLink message 246: ADSB_FLAGS, and of ADSB_EMITTER_TYPE what moves on the ground.
_COORDINATES, _ALTITUDE, _HEADING, _VELOCITY = 1, 2, 4, 8
_CALLSIGN, _VERTICAL_VELOCITY = 16, 128
_VEHICLES = (17, 18)  # emergency and service vehicle; 19, point obstacle, is a tethered balloon too
_SILENCE = 255  # s; the largest value that time since last communication can have
_INS_GOOD = 3  # INS_SOLUTION_GOOD (NovAtel OEM7, inertial solution status)


def nav_sat_fix(
    message: Any, read_velocity: Callable[[], Any], identity: str, reference: str
) -> Report:
    """Return a report from a NavSatFix and the velocity beside it.

    By the definition an altitude of NaN means that there is none; a covariance that is not finite
    is as good as one of unknown type: the position's standard deviation is unknown.

    Args:
        message: sensor_msgs/NavSatFix.
        read_velocity: returns a geometry_msgs/Twist with the velocity in ENU over the ground, m/s.
        reference: of the altitude that the driver really publishes.

    Raises:
        FieldError: there is no fix or no velocity, or a field is not finite or out of range; with a
            sighting.
    """
    fields = _FixFields(message, read_velocity, reference)
    return report(
        identifier("fix.id", identity),
        fields.time,
        fields.place,
        fields.velocity,
        fields.altitude,
        position_std=fields.position_std,
    )


class _FixFields(NamedTuple):
    """The parts of a NavSatFix and the velocity beside it, each checked when it is read."""

    message: Any
    read_velocity: Callable[[], Any]
    reference: str

    def time(self) -> int:
        """Return when the fix held, ns."""
        return stamp("fix.header.stamp", self.message.header.stamp)

    def place(self) -> tuple[float, float]:
        """Return latitude and longitude, degrees."""
        status = integer("fix.status.status", self.message.status.status, -128, 127)
        if status < 0:
            raise FieldError(
                "fix.status.status", f"is {status}, expected 0 or more: there is no fix"
            )
        return place("fix", self.message.latitude, self.message.longitude)

    def velocity(self) -> tuple[float, float]:
        """Return true east and north, m/s."""
        twist = self.read_velocity()
        return velocity("fix", twist.linear.x, twist.linear.y)

    def altitude(self) -> Altitude | None:
        """Return the altitude with its rate; None: there is none."""
        if math.isnan(self.message.altitude):
            return None
        climb = number("fix.twist.linear.z", self.read_velocity().linear.z, -100.0, 100.0, "m/s")
        return altitude("fix.altitude", self.message.altitude, self.reference, climb)

    def position_std(self) -> float | None:
        """Return the greater of the standard deviations east and north, m; None: unknown."""
        east_north = {n: float(self.message.position_covariance[n]) for n in (0, 4)}
        finite = all(map(math.isfinite, east_north.values()))
        if self.message.position_covariance_type == 0 or not finite:
            return None
        variances = (
            number(f"fix.position_covariance[{n}]", variance, 0.0, 1e8, "m^2")
            for n, variance in east_north.items()
        )
        return math.sqrt(max(variances))


def odometry_velocity(message: Any) -> Any:
    """Return the velocity of a nav_msgs/Odometry in ENU like a Twist, or raise :class:`FieldError`.

    Its twist is given in the frame of the body (REP 105's child frame), whose attitude in ENU is
    the pose's.
    """
    twist, attitude = message.twist.twist.linear, message.pose.pose.orientation
    x, y, z, w = (
        number(f"odometry.orientation.{axis}", getattr(attitude, axis), -1.01, 1.01, "")
        for axis in "xyzw"
    )
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if abs(length - 1.0) > 0.01:
        raise FieldError("odometry.orientation", f"has length {length:g}, expected 1")
    x, y, z, w = x / length, y / length, z / length, w / length
    forward, leftward, up = (
        number(f"odometry.twist.linear.{a}", getattr(twist, a), -400.0, 400.0, "m/s") for a in "xyz"
    )
    east = (
        (1 - 2 * (y * y + z * z)) * forward
        + 2 * (x * y - w * z) * leftward
        + 2 * (x * z + w * y) * up
    )
    north = (
        2 * (x * y + w * z) * forward
        + (1 - 2 * (x * x + z * z)) * leftward
        + 2 * (y * z - w * x) * up
    )
    climb = (
        2 * (x * z - w * y) * forward
        + 2 * (y * z + w * x) * leftward
        + (1 - 2 * (x * x + y * y)) * up
    )
    return SimpleNamespace(linear=SimpleNamespace(x=east, y=north, z=climb))


def inspva(message: Any, identity: str) -> Report:
    """Return a report from NovAtel's INSPVA, whose height is above the ellipsoid.

    Raises:
        FieldError: there is no good solution, or a field is not finite or out of range; with a
            sighting.
    """
    return _InertialFields(message, "status", 0.0).report(identity)


def inspvax(message: Any, identity: str) -> Report:
    """Return a report from NovAtel's INSPVAX, whose height is above mean sea level, with the
    geoid's undulation beside it; errors as :func:`inspva` has them.
    """
    return _InertialFields(message, "ins_status", message.undulation).report(identity)


class _InertialFields(NamedTuple):
    """The parts of an inertial solution, each checked when it is read; velocities are north, east,
    up.
    """

    message: Any
    status: str  # name of the field that holds the status
    undulation: Any  # of what its height is above, over the ellipsoid, m

    def report(self, identity: str) -> Report:
        """Return the report."""
        name = identifier("inspva.id", identity)
        return report(name, self.time, self.place, self.velocity, self.altitude)

    def time(self) -> int:
        """Return when the solution held, ns."""
        return stamp("inspva.header.stamp", self.message.header.stamp)

    def place(self) -> tuple[float, float]:
        """Return latitude and longitude, degrees."""
        field = f"inspva.{self.status}.status"
        status = integer(field, getattr(self.message, self.status).status, 0, 2**32 - 1)
        if status != _INS_GOOD:
            raise FieldError(field, f"is {status}, expected {_INS_GOOD} (INS_SOLUTION_GOOD)")
        return place("inspva", self.message.latitude, self.message.longitude)

    def velocity(self) -> tuple[float, float]:
        """Return true east and north, m/s."""
        return velocity("inspva", self.message.east_velocity, self.message.north_velocity)

    def altitude(self) -> Altitude:
        """Return the altitude above the ellipsoid, with its rate."""
        climb = number("inspva.up_velocity", self.message.up_velocity, -100.0, 100.0, "m/s")
        undulation = number("inspva.undulation", self.undulation, -120.0, 100.0, "m")
        height = altitude("inspva.height", self.message.height, "wgs84", climb)
        return Altitude(height.value + undulation, "wgs84", climb)


def adsb_vehicle(
    message: Any,
    references: Mapping[int, str] = MappingProxyType({}),
    own: Report | None = None,
) -> Report | None:
    """Return a report from an ADS-B vehicle as MAVLink and mavros have it; None: it is a surface
    vehicle on the ground, and no traffic.

    One that moves as in flight, or is as high as the ownship, is traffic whatever its type
    (:func:`ros_bridge.core.ground.on_ground`). Obstacles, tethered balloons among them, are traffic
    that stands still.

    The message is stamped when it was received; the state held ``tslc`` (time since last
    communication, whole seconds) before that. What is cut off lies between 0 and 1 s: its root mean
    square is the time's standard deviation; those of position and velocity are unknown. What
    ``altitude`` is measured from depends on the receiver (field names mention QNH and geometry, the
    documentation mean sea level), so it counts as unknown unless the caller knows it.

    Args:
        message: mavros_msgs/ADSBVehicle: SI units, heading in degrees clockwise from north,
            ``tslc`` a duration.
        references: what ``altitude_type`` 0 (barometric) and 1 (geometric) mean here, such as ``{0:
            "pressure"}``.
        own: the ownship; None: unknown.

    Raises:
        FieldError: position or velocity are not marked as valid, or a field is not finite or out of
            range; with a sighting.
    """
    fields = _AdsbFields(message)
    if fields.emitter_type() in _VEHICLES and fields.on_ground(references, own):
        return None
    return report(
        f"{message.icao_address:06x}",
        fields.time,
        fields.place,
        fields.velocity,
        partial(fields.altitude, references),
        time_std=lambda: RECENT_STD,
        category=fields.category,
        callsign=fields.callsign,
    )


class _AdsbFields(NamedTuple):
    """The parts of an ADS-B vehicle, each checked when it is read."""

    message: Any

    def time(self) -> int:
        """Return when the state held, ns."""
        silent = integer("adsb.tslc.sec", self.message.tslc.sec, 0, _SILENCE - 1)
        return stamp("adsb.header.stamp", self.message.header.stamp) - silent * SECOND

    def place(self) -> tuple[float, float]:
        """Return latitude and longitude, degrees."""
        self._demand(_COORDINATES, "coordinates")
        return place("adsb", self.message.latitude, self.message.longitude)

    def velocity(self) -> tuple[float, float]:
        """Return true east and north, m/s."""
        self._demand(_HEADING, "heading")
        integer("adsb.icao_address", self.message.icao_address, 1, 2**24 - 1)
        heading = math.radians(number("adsb.heading", self.message.heading, 0.0, 360.0, "degrees"))
        self._demand(_VELOCITY, "velocity")
        speed = number("adsb.hor_velocity", self.message.hor_velocity, 0.0, FASTEST, "m/s")
        return speed * math.sin(heading), speed * math.cos(heading)

    def altitude(self, references: Mapping[int, str]) -> Altitude | None:
        """Return the altitude; None: it is not told, or nobody knows what it is measured from."""
        climb = None
        if self._has(_VERTICAL_VELOCITY):
            climb = number("adsb.ver_velocity", self.message.ver_velocity, -100.0, 100.0, "m/s")
        if not self._has(_ALTITUDE):
            return None
        kind = integer("adsb.altitude_type", self.message.altitude_type, 0, 1)
        if kind not in references:
            return None
        return altitude("adsb.altitude", self.message.altitude, references[kind], climb)

    def on_ground(self, references: Mapping[int, str], own: Report | None) -> bool:
        """Return whether nothing that is marked as valid contradicts that it is on the ground; what
        cannot be read does.
        """
        speed, climb, height = (
            getattr(self.message, name) if self._has(bit) else None
            for name, bit in (
                ("hor_velocity", _VELOCITY),
                ("ver_velocity", _VERTICAL_VELOCITY),
                ("altitude", _ALTITUDE),
            )
        )
        comparable = attempt(lambda: self.altitude(references))
        if isinstance(comparable, FieldError):
            return False
        return on_ground(speed, climb, height, comparable, own)

    def emitter_type(self) -> int:
        """Return MAVLink's code of it."""
        return integer("adsb.emitter_type", self.message.emitter_type, 0, 255)

    def category(self) -> int:
        """Return the emitter category; MAVLink's codes are its numbers, those beyond are none."""
        code = self.emitter_type()
        return code if code <= LAST else 0

    def callsign(self) -> str:
        """Return the callsign; "": unknown."""
        return callsign(self.message.callsign) if self._has(_CALLSIGN) else ""

    def _has(self, bit: int) -> bool:
        return bool(integer("adsb.flags", self.message.flags, 0, 2**16 - 1) & bit)

    def _demand(self, bit: int, part: str) -> None:
        if not self._has(bit):
            raise FieldError(
                "adsb.flags", f"is {self.message.flags:#x}, expected the bit of valid {part}"
            )
