r"""The translator: messages of other packages as the runner's inputs.

    python -m ros_bridge.translator --ros-args -p own_source:=nav_sat_fix -p own_id:=4b1234 \
        -p traffic_source:=adsb \
        -r '~/input/fix:=/mavros/global_position/global' \
        -r '~/input/velocity:=/mavros/local_position/velocity_local' \
        -r '~/input/adsb:=/mavros/adsb/vehicle'

    in    ~/input/fix        sensor_msgs/NavSatFix, with one of
          ~/input/velocity   geometry_msgs/TwistStamped: ENU, over the ground
          ~/input/odometry   nav_msgs/Odometry: its twist in the body's frame, its pose in ENU
          ~/input/inspva     novatel_oem7_msgs/INSPVA or INSPVAX
          ~/input/adsb       mavros_msgs/ADSBVehicle
          adsb (parameter)   live receivers, such as tcp://HOST:30003, http://HOST/.../aircraft.json,
                             gdl90://0.0.0.0:4000 and flarm://HOST:2000
    out   rlcas_runner/input/ownship          rlcas_msgs/AircraftState
          rlcas_runner/input/traffic_array    rlcas_msgs/TrafficArray, up to 200 states in each,
                              every 0.05 s while there are some
          /diagnostics       what was passed on, what could not be translated, and why

A fix is the ownship's or, in a second translator, an intruder's (traffic_source nav_sat_fix, and
traffic_id). An ownship that cannot be translated is not passed on: it grows stale, and requests are
refused. Of an intruder that cannot be translated the name is passed on, and its place if that is
known: requests are refused unless it is out of reach. Surface vehicles (emitter types 17 and 18)
are left out and counted, unless they move as in flight or are as high as the ownship; so is what a
live receiver has on the ground. Parameters:
"""

import importlib
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Sequence
from functools import partial
from typing import Any, Literal, NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rlcas_msgs.msg import AircraftState, TrafficArray
from sensor_msgs.msg import NavSatFix

from ros_bridge.core import adapters
from ros_bridge.core.conversions import ALTITUDE_CODES, aircraft
from ros_bridge.core.fields import SECOND, FieldError, attempt, readable, stamp
from ros_bridge.core.reports import Report
from ros_bridge.transport import process, qos, topics, views
from ros_bridge.transport.clock import ClockGuard, call_in_any_time
from ros_bridge.transport.losses import Losses
from ros_bridge.transport.messages import aircraft_message
from ros_bridge.transport.receivers import LiveReports, check_sources
from ros_bridge.transport.settings import declare


class _Kind(NamedTuple):
    """A message of another package that is read where that is installed."""

    package: str
    name: str


_KINDS = {
    "inspva": _Kind("novatel_oem7_msgs", "INSPVA"),
    "inspvax": _Kind("novatel_oem7_msgs", "INSPVAX"),
    "adsb": _Kind("mavros_msgs", "ADSBVehicle"),
}
_INERTIAL: dict[str, Callable[[Any, str], Report]] = {
    "inspva": adapters.inspva,
    "inspvax": adapters.inspvax,
}
"""What reads a message of an inertial solution, by its source."""

_OWN_SOURCES = ("none", "nav_sat_fix", *_INERTIAL)
_TRAFFIC_SOURCES = ("none", "nav_sat_fix", "adsb")
_STEADY = Clock(clock_type=ClockType.STEADY_TIME)
_Role = Literal["own", "traffic"]
_DRAINED = 0.1  # s between two looks at what a receiver has sent

_PERIOD = 0.05  # s between two messages of traffic
_TOGETHER = 200  # states in one: 44 kB, a datagram
_MANY = 4_000  # states that may wait, for a second; more go out faster


def pair(
    fix: NavSatFix,
    twist: TwistStamped | Odometry | None,
    identity: str,
    reference: str,
    apart: float,
) -> Report:
    """Return the report of a fix and the velocity beside it, or raise :class:`FieldError` with a
    sighting.

    The velocity is the newest one (None: there has been none), at most ``apart`` s from the fix.
    """
    read_velocity = partial(_velocity_beside, fix, twist, apart)
    return adapters.nav_sat_fix(fix, read_velocity, identity, reference)


def _velocity_beside(fix: NavSatFix, twist: TwistStamped | Odometry | None, apart: float) -> Twist:
    """Return the velocity like a Twist in ENU, or raise :class:`FieldError`."""
    if twist is None:
        raise FieldError("velocity", "has not been received, expected one beside the fix")
    at_fix = stamp("fix.header.stamp", fix.header.stamp)
    off = abs(at_fix - stamp("velocity.header.stamp", twist.header.stamp)) / SECOND
    if off > apart:
        raise FieldError(
            "velocity.header.stamp", f"is {off:.2f} s from the fix's, expected {apart:g} s at most"
        )
    return adapters.odometry_velocity(twist) if isinstance(twist, Odometry) else twist.twist


class _Sources(NamedTuple):
    """Where ownship and traffic come from."""

    own: str  # of _OWN_SOURCES
    traffic: str  # of _TRAFFIC_SOURCES
    live: tuple[str, ...]  # URLs of receivers


class Translator(ClockGuard):
    """The node; what messages mean is :mod:`ros_bridge.core.adapters`."""

    _live: LiveReports | None = None

    def __init__(self, **more: Any) -> None:
        super().__init__("rlcas_translator", **more)
        declare(self, "translator")
        self._reference = self._choice("own_altitude_reference", ALTITUDE_CODES.values())
        self._references = {
            kind: self._choice(name, ALTITUDE_CODES.values())
            for kind, name in ((0, "adsb_barometric_reference"), (1, "adsb_geometric_reference"))
            if self._value(name)
        }
        sources = self._read_sources()
        self._twist: TwistStamped | Odometry | None = None
        self._ownship: Report | None = None
        self._counts: Counter[str] = Counter()
        self._wrong = ""
        self._waiting: deque[AircraftState] = deque()
        self._losses = Losses()
        self._own = self.create_publisher(*topics.OWNSHIP)
        self._traffic = self.create_publisher(*topics.TRAFFIC_ARRAY)
        self._health = self.create_publisher(*topics.DIAGNOSTICS)
        self._listen(sources)
        if sources.traffic != "none" or sources.live:
            # What a whole sky sends at once goes out in turns that subscribers have time for.
            self.create_timer(_PERIOD, self._send_traffic, clock=_STEADY)
        call_in_any_time(self, self._value("diagnostics_period"), self._on_timer)

    def destroy_node(self) -> None:
        """End the receiver's thread with the node."""
        if self._live is not None:
            self._live.stop()
        super().destroy_node()

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _choice(self, name: str, choices: Collection[str]) -> str:
        value = self._value(name)
        if value not in choices:
            raise ValueError(f"{name} is {value!r}, expected one of {', '.join(choices)}")
        return value

    def _read_sources(self) -> _Sources:
        """Return the sources of the parameters, or raise ValueError where they do not fit."""
        own = self._choice("own_source", _OWN_SOURCES)
        traffic = self._choice("traffic_source", _TRAFFIC_SOURCES)
        live = check_sources(self._value("adsb"))
        if live and traffic != "none":
            raise ValueError(
                f"adsb and traffic_source {traffic} are both given, expected one of them"
            )
        if own == traffic and not live:
            raise ValueError(
                f"own_source and traffic_source are both {own}, expected one fix at most, and "
                "something"
            )
        for name, needed in (("own_id", own != "none"), ("traffic_id", traffic == "nav_sat_fix")):
            if needed and not self._value(name):
                raise ValueError(
                    f"{name} is empty, expected the aircraft's name, such as its 24-bit address"
                )
        return _Sources(own, traffic, live)

    def _listen(self, sources: _Sources) -> None:
        if sources.own == "nav_sat_fix":
            self._listen_to_fixes("own", self._value("own_id"))
        elif sources.traffic == "nav_sat_fix":
            self._listen_to_fixes("traffic", self._value("traffic_id"))
        if sources.own in _INERTIAL:
            callback = partial(self._on_inertial, _INERTIAL[sources.own])
            self.create_subscription(
                _message_type(sources.own), "~/input/inspva", callback, qos.SENSOR
            )
        if sources.traffic == "adsb":
            callback = self._losses.counting("~/input/adsb", self._on_adsb, time.monotonic)
            self.create_subscription(_message_type("adsb"), "~/input/adsb", callback, qos.TRAFFIC)
            topics.OWNSHIP.subscribe(self, self._on_ownship)
        if sources.live:
            self._listen_live(sources.live)

    def _listen_to_fixes(self, role: _Role, name: str) -> None:
        """Pass on fixes, with the velocity beside each, as an aircraft of a name."""
        for kind, topic in ((TwistStamped, "~/input/velocity"), (Odometry, "~/input/odometry")):
            self.create_subscription(kind, topic, self._on_velocity, qos.SENSOR)
        callback = partial(self._on_fix, role, name)
        self.create_subscription(NavSatFix, "~/input/fix", callback, qos.SENSOR)

    def _listen_live(self, sources: Sequence[str]) -> None:
        """Pass on the traffic of receivers."""
        clock = self.get_clock()
        live = LiveReports(sources, self._value("own_id"), lambda: clock.now().nanoseconds)
        topics.OWNSHIP.subscribe(self, self._on_ownship)
        self.create_timer(_DRAINED, partial(self._on_live, live))
        live.start()
        self._live = live

    def _on_velocity(self, message: TwistStamped | Odometry) -> None:
        self._twist = message

    def _on_fix(self, role: _Role, name: str, message: NavSatFix) -> None:
        apart = self._value("velocity_apart")
        self._pass(role, attempt(lambda: pair(message, self._twist, name, self._reference, apart)))

    def _on_inertial(self, read: Callable[[Any, str], Report], message: Any) -> None:
        self._pass("own", attempt(lambda: read(message, self._value("own_id"))))

    def _on_adsb(self, message: Any) -> None:
        read = partial(adapters.adsb_vehicle, message, self._references, self._ownship)
        self._pass("traffic", attempt(read))

    def _on_ownship(self, message: AircraftState) -> None:
        # The runner says why it cannot be read.
        self._ownship = readable(lambda: aircraft(message, "ownship"))

    def _on_live(self, live: LiveReports) -> None:
        """Pass on what the receiver has sent since the last look."""
        live.note_own(self._ownship)
        for report, _ in live.take():
            self._pass("traffic", report)

    def _pass(self, role: _Role, report: Report | FieldError | None) -> None:
        """Pass on a report; of traffic that cannot be translated its name and, if known, its
        place.
        """
        name: str = role
        if report is None:
            name = "surface vehicle on the ground, left out"
        elif isinstance(report, Report):
            self._send(role, aircraft_message(report))
        else:
            self._wrong, name = str(report), f"{role} not translated"
            self.get_logger().error(f"not translated: {report}", throttle_duration_sec=5.0)
            if role == "traffic" and report.sighting is not None:
                self._send(role, aircraft_message(report.sighting))
        self._counts[name] += 1

    def _send(self, role: _Role, state: AircraftState) -> None:
        if role == "own":
            self._own.publish(state)
        else:
            self._waiting.append(state)

    def _send_traffic(self) -> None:
        """Publish what waits of the traffic, or the first part of it."""
        for _ in range(1 + len(self._waiting) // _MANY):
            count = min(len(self._waiting), _TOGETHER)
            if count:
                states = [self._waiting.popleft() for _ in range(count)]
                self._traffic.publish(TrafficArray(states=states))

    def _count_left_out(self) -> dict[str, int]:
        """Return what of a live receiver was left out; a receiver that cannot be read or is silent
        is noted.
        """
        if self._live is None:
            return {}
        problem = self._live.take_problem()
        if problem:
            self._wrong = problem
            self.get_logger().warning(problem, throttle_duration_sec=30.0)
        left_out, doubted = self._live.left_out, self._live.doubted
        counts = {f"{reason}, left out": count for reason, count in left_out.items() if count}
        return counts | {f"{reason}, taken as traffic": count for reason, count in doubted.items()}

    def _on_timer(self) -> None:
        counts = {**self._counts, **self._count_left_out()}
        values = {name: str(count) for name, count in sorted(counts.items())}
        level, message = DiagnosticStatus.OK, "ready"
        if self._wrong:
            level, message = DiagnosticStatus.WARN, self._wrong
        self._wrong = ""
        lost = self._losses.problem(time.monotonic())
        if lost:
            level, message = DiagnosticStatus.ERROR, lost
        self._health.publish(views.diagnostics(self, level, message, values))


def _message_type(source: str) -> Any:
    """Return the type of a source's messages, or raise ValueError where it is not installed."""
    kind = _KINDS[source]
    try:
        return getattr(importlib.import_module(f"{kind.package}.msg"), kind.name)
    except (ModuleNotFoundError, AttributeError) as error:
        raise ValueError(
            f"{source} needs the package {kind.package} with {kind.name}, which is not installed"
        ) from error


main = partial(process.main, Translator, "translator", __doc__)
