# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
r"""The translator: messages of other packages as the runner's inputs.

    python -m ros_bridge.translator --ros-args -p own_source:=nav_sat_fix -p own_id:=4b1234 -p traffic_source:=adsb \
        -r '~/input/fix:=/mavros/global_position/global' -r '~/input/velocity:=/mavros/local_position/velocity_local' \
        -r '~/input/adsb:=/mavros/adsb/vehicle'

    in    ~/input/fix        sensor_msgs/NavSatFix, with one of
          ~/input/velocity   geometry_msgs/TwistStamped: ENU, over the ground
          ~/input/odometry   nav_msgs/Odometry: its twist in the body's frame, its pose in ENU
          ~/input/inspva     novatel_oem7_msgs/INSPVA or INSPVAX
          ~/input/adsb       mavros_msgs/ADSBVehicle
    out   rlcas_runner/input/ownship, rlcas_runner/input/traffic   rlcas_msgs/AircraftState
          /diagnostics       what was passed on, what could not be translated, and why

A fix is the ownship's or, in a second translator, an intruder's (traffic_source nav_sat_fix, and traffic_id).
An ownship that cannot be translated is not passed on: it grows stale, and requests are refused. Of an intruder that
cannot be translated the name is passed on, and its place if that is known: requests are refused unless it is out of
reach. ADS-B vehicles on the ground and obstacles (emitter types 17 to 19) are left out and counted. Parameters:
"""

import importlib
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rlcas_msgs.msg import AircraftState
from sensor_msgs.msg import NavSatFix

from ros_bridge.core import adapters
from ros_bridge.core.conversions import ALTITUDE_CODES
from ros_bridge.core.fields import SECOND, FieldError, stamp
from ros_bridge.core.reports import Report
from ros_bridge.transport import process, qos, views
from ros_bridge.transport.messages import aircraft_message, sighting_message
from ros_bridge.transport.settings import declare

__all__ = ["Translator", "main", "paired"]

_RUNNER = "rlcas_runner"
_OWN = {
    "none": None,
    "nav_sat_fix": None,
    "inspva": ("novatel_oem7_msgs", "INSPVA"),
    "inspvax": ("novatel_oem7_msgs", "INSPVAX"),
}
_TRAFFIC = {"none": None, "nav_sat_fix": None, "adsb": ("mavros_msgs", "ADSBVehicle")}


def paired(fix: Any, twist: Any, identity: str, reference: str, apart: float) -> Report:
    """Return the report of a fix and the velocity beside it.

    Args:
        fix: sensor_msgs/NavSatFix.
        twist: geometry_msgs/TwistStamped or nav_msgs/Odometry, the newest; None: there has been none.
        identity: of the aircraft.
        reference: of the fix's altitude.
        apart: largest time between the two, s.

    Raises:
        FieldError: there is no velocity of about the same time, or a field cannot be used; with a sighting.
    """
    try:
        if twist is None:
            raise FieldError("velocity", "has not been received, expected one beside the fix")
        times = stamp("fix.header.stamp", fix.header.stamp), stamp("velocity.header.stamp", twist.header.stamp)
        off = abs(times[0] - times[1]) / SECOND
        if off > apart:
            raise FieldError("velocity.header.stamp", f"is {off:.2f} s from the fix's, expected {apart:g} s at most")
        velocity = adapters.odometry_velocity(twist) if hasattr(twist, "pose") else twist.twist
        return adapters.nav_sat_fix(fix, velocity, identity, reference)
    except FieldError as error:
        error.sighting = adapters.fix_sighting(fix, identity)
        raise


class Translator(Node):
    """The node; what messages mean is :mod:`ros_bridge.core.adapters`."""

    def __init__(self, **more: Any) -> None:
        super().__init__("rlcas_translator", **more)
        declare(self, "translator")
        own, traffic = self._choice("own_source", _OWN), self._choice("traffic_source", _TRAFFIC)
        self._reference = self._choice("own_altitude_reference", dict.fromkeys(ALTITUDE_CODES.values()))
        self._references = {
            kind: self._choice(name, dict.fromkeys(ALTITUDE_CODES.values()))
            for kind, name in ((0, "adsb_barometric_reference"), (1, "adsb_geometric_reference"))
            if self._value(name)
        }
        if own == traffic:
            raise ValueError(f"own_source and traffic_source are both {own}, expected one fix at most, and something")
        for name, needed in (("own_id", own != "none"), ("traffic_id", traffic == "nav_sat_fix")):
            if needed and not self._value(name):
                raise ValueError(f"{name} is empty, expected the aircraft's name, such as its 24-bit address")
        self._twist: Any = None
        self._counts: dict[str, int] = {}
        self._wrong = ""
        self._own = self.create_publisher(AircraftState, f"{_RUNNER}/input/ownship", qos.SENSOR)
        self._traffic = self.create_publisher(AircraftState, f"{_RUNNER}/input/traffic", qos.TRAFFIC)
        self._health = self.create_publisher(DiagnosticArray, "/diagnostics", qos.EVENTS)
        if "nav_sat_fix" in (own, traffic):
            into = self._own if own == "nav_sat_fix" else self._traffic
            name = self._value("own_id" if own == "nav_sat_fix" else "traffic_id")
            self.create_subscription(TwistStamped, "~/input/velocity", self._on_velocity, qos.SENSOR)
            self.create_subscription(Odometry, "~/input/odometry", self._on_velocity, qos.SENSOR)
            self.create_subscription(NavSatFix, "~/input/fix", partial(self._on_fix, into, name), qos.SENSOR)
        if own in ("inspva", "inspvax"):
            self.create_subscription(_kind(own, _OWN), "~/input/inspva", self._on_inspva, qos.SENSOR)
        if traffic == "adsb":
            self.create_subscription(_kind(traffic, _TRAFFIC), "~/input/adsb", self._on_adsb, qos.TRAFFIC)
        self.create_timer(self._value("diagnostics_period"), self._on_timer)

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _choice(self, name: str, known: dict[str, Any]) -> str:
        value = self._value(name)
        if value not in known:
            raise ValueError(f"{name} is {value!r}, expected one of {', '.join(known)}")
        return value

    def _on_velocity(self, message: Any) -> None:
        self._twist = message

    def _on_fix(self, into: Any, name: str, message: NavSatFix) -> None:
        apart = self._value("velocity_apart")
        self._pass(into, lambda: paired(message, self._twist, name, self._reference, apart))

    def _on_inspva(self, message: Any) -> None:
        self._pass(self._own, lambda: adapters.inspva(message, self._value("own_id")))

    def _on_adsb(self, message: Any) -> None:
        self._pass(self._traffic, lambda: adapters.adsb_vehicle(message, self._references))

    def _pass(self, publisher: Any, read: Callable[[], Report | None]) -> None:
        """Publish a report; of traffic that cannot be translated its name and, if known, its place."""
        name = "own" if publisher is self._own else "traffic"
        try:
            report = read()
            if report is None:
                name = "on the ground, left out"
            else:
                publisher.publish(aircraft_message(report))
        except FieldError as error:
            self._wrong, name = str(error), f"{name} not translated"
            self.get_logger().error(f"not translated: {error}", throttle_duration_sec=5.0)
            if publisher is self._traffic and error.sighting is not None:
                publisher.publish(sighting_message(error.sighting))
        self._counts[name] = self._counts.get(name, 0) + 1

    def _on_timer(self) -> None:
        level, message = (DiagnosticStatus.WARN, self._wrong) if self._wrong else (DiagnosticStatus.OK, "ready")
        self._wrong = ""
        values = {name: str(count) for name, count in sorted(self._counts.items())}
        now = self.get_clock().now().nanoseconds
        self._health.publish(views.diagnostics(now, self.get_fully_qualified_name(), level, message, values))


def _kind(source: str, known: dict[str, Any]) -> Any:
    """Return the type of a source's messages."""
    package, name = known[source]
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (ModuleNotFoundError, AttributeError) as error:
        raise ValueError(f"{source} needs the package {package} with {name}, which is not installed") from error


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return process.main(Translator, "translator", __doc__, arguments)
