"""What has been received: one pure function that takes in a message of any kind."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from envs.formats.local_frame import LocalFrame
from ros_bridge.core.conversions import Origin
from ros_bridge.core.feeds.traffic import WITHOUT_POSITION
from ros_bridge.core.fields import SECOND, FieldError, attempt
from ros_bridge.core.freshness import USUAL_FRESHNESS
from ros_bridge.core.nearest import MOST, keep_nearest
from ros_bridge.core.reports import Report
from ros_bridge.core.situation import Held, Situation
from ros_bridge.core.tracks import (
    Rules,
    follow,
    forget_silent,
    sharing,
    take_outcome,
)
from ros_bridge.core.updates import may_be_own
from ros_bridge.mavlink import messages, remote_id
from ros_bridge.mavlink.messages import Heartbeat, Mode
from ros_bridge.mavlink.remote_id import BasicId, Drone, Moment

if TYPE_CHECKING:
    from pymavlink.dialects.v20 import ardupilotmega as dialect

_FAR = 50_000.0  # m from the frame's origin, beyond which it moves
_RULES = Rules()
_MOST_DRONES = 256  # transmitters of Remote ID that are remembered
_MOST_IDS = 4  # names of one
_NAMED_WITHIN = 5.0  # s after its first state; names are sent every three seconds
_NAMELESS = "drone of Remote ID that has not said its name yet"
_OWN_ECHO = "own echo"
_NO_ADDRESS = "drone of Remote ID without an address, which flies as the ownship does"
_OWN_VELOCITY = 15.0  # m/s, by which reports of the ownship may differ
UNREADABLE = "without a name, unreadable"
"""Why a report is left out that names no aircraft."""


@dataclass(frozen=True)
class Received:
    """Everything that is known of autopilot and traffic; never changed in place."""

    situation: Situation = field(default_factory=Situation)
    heartbeat: Heartbeat | None = None
    heartbeat_at: int = 0  # when the autopilot's heartbeat came last, ns
    wind: tuple[float, float] | None = None
    wind_at: int = 0
    airspeed: float | None = None
    airspeed_at: int = 0
    estimate: str = ""  # why the estimate of the own state cannot be used
    fix: str = ""  # why the satellite fix cannot be relied on
    current: int = 0  # item of the mission that is flown to
    target: tuple[int, int] | None = None  # latitude and longitude that are flown to, 1e-7 degrees
    target_altitude: float | None = None  # m above mean sea level
    parameters: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    left_out: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    """How many reports, or aircraft, were not taken as traffic, by the reason."""
    utc: int | None = None  # of UTC since 1970 to the autopilot's clock, ns; None: unknown
    drones: Mapping[str, Drone] = field(default_factory=lambda: MappingProxyType({}))
    """Of Remote ID, by the address of their transmitters."""

    @property
    def mode(self) -> int:
        """Of the autopilot, by its last heartbeat; -1: unknown."""
        return -1 if self.heartbeat is None else self.heartbeat.mode

    @property
    def altitude_offset(self) -> float:
        """What the autopilot adds to every altitude that it is told, m."""
        return self.parameters.get("ALT_OFFSET", 0.0)

    @property
    def problem(self) -> str:
        """Why the own state is not to be planned with; "": it is."""
        return self.estimate or self.fix


@dataclass(frozen=True, slots=True)
class Reading:
    """How messages are read."""

    references: Mapping[int, str]  # of altitudes of ADS-B, by their type
    rules: Rules = _RULES
    own_drone: frozenset[str] = frozenset()  # names of the own Remote ID


def take(
    received: Received, message: "dialect.MAVLink_message", time: int, reading: Reading
) -> Received:
    """Return what is known after a message of the autopilot or through it; ``time`` is its clock,
    ns. Kinds that play no part are passed over.
    """
    read = _KINDS.get(message.get_type())
    return received if read is None else read(received, message, time, reading)


def forget(received: Received, time: int, patience: float) -> Received:
    """Return what is known without aircraft that have been silent for so many seconds."""
    traffic, silent = forget_silent(received.situation.traffic, time, patience)
    if not silent:
        return received
    return replace(received, situation=replace(received.situation, traffic=traffic))


def failsafe_acted(before: Received, after: Received, patience: float) -> bool:
    """Return whether a heartbeat has AUTO that nobody has set but the autopilot's failsafe.

    Its status says so where it is still on; the silence before the heartbeat does, where it has
    lasted for longer than ``patience``, s, and the link, which is back, has ended the failsafe.
    """
    previous, current = before.heartbeat, after.heartbeat
    if (
        previous is None
        or current is None
        or previous.mode == Mode.AUTO
        or current.mode != Mode.AUTO
    ):
        return False
    declared = math.isfinite(patience) and current.failsafe and not previous.failsafe
    return declared or (after.heartbeat_at - before.heartbeat_at) / SECOND > patience


def take_traffic(
    received: Received, name: str, outcome: Report | FieldError, time: int, reading: Reading
) -> Received:
    """Return what is known after a report of traffic, whoever brought it; of too many aircraft the
    nearest stay.
    """
    situation = received.situation
    own = situation.own.last
    traffic = follow(situation.traffic, name, outcome, time, reading.rules)
    nearest, dropped = keep_nearest(traffic, None if own is None else own.place)
    if dropped:
        received = leave_out(received, f"beyond the nearest {MOST} aircraft", dropped)
    return replace(received, situation=replace(situation, traffic=nearest))


def leave_out(received: Received, reason: str, count: int = 1) -> Received:
    """Return what is known with so many left out more for a reason."""
    counts = {**received.left_out, reason: received.left_out.get(reason, 0) + count}
    return replace(received, left_out=MappingProxyType(counts))


def _heartbeat(
    received: Received, message: "dialect.MAVLink_heartbeat_message", time: int, _: Reading
) -> Received:
    return replace(received, heartbeat=messages.heartbeat(message), heartbeat_at=time)


def _position(
    received: Received,
    message: "dialect.MAVLink_global_position_int_message",
    time: int,
    reading: Reading,
) -> Received:
    counts = USUAL_FRESHNESS.wind * SECOND
    wind = received.wind if time - received.wind_at <= counts else None
    fast = received.airspeed if time - received.airspeed_at <= counts else None
    situation = received.situation
    outcome = attempt(lambda: messages.ownship(message, wind, fast))
    if received.problem:
        outcome = FieldError(f"{messages.OWN}.position", f"is not to be used: {received.problem}")
    own = take_outcome(situation.own, outcome, messages.OWN, time, reading.rules)
    origin = situation.origin
    if isinstance(outcome, Report) and own.last is not None and _needs_origin(origin, outcome):
        origin = Held(Origin(LocalFrame(outcome.latitude, outcome.longitude), None))
    return replace(received, situation=replace(situation, own=own, origin=origin))


def _needs_origin(origin: Held[Origin], report: Report) -> bool:
    if origin.value is None:
        return True
    at = origin.value.frame.place(report.latitude, report.longitude)
    return max(abs(float(at.x)), abs(float(at.y))) > _FAR


def _hud(
    received: Received, message: "dialect.MAVLink_vfr_hud_message", time: int, _: Reading
) -> Received:
    fast = attempt(lambda: messages.airspeed(message))
    if isinstance(fast, FieldError):
        return received
    return replace(received, airspeed=fast, airspeed_at=time)


def _wind(
    received: Received, message: "dialect.MAVLink_wind_message", time: int, _: Reading
) -> Received:
    wind = attempt(lambda: messages.wind(message))
    if isinstance(wind, FieldError):
        return replace(received, wind=None)
    return replace(received, wind=wind, wind_at=time)


def _estimate(
    received: Received,
    message: "dialect.MAVLink_ekf_status_report_message | dialect.MAVLink_estimator_status_message",
    _: int,
    __: Reading,
) -> Received:
    return replace(received, estimate=messages.estimate_problem(message))


def _fix(
    received: Received, message: "dialect.MAVLink_gps_raw_int_message", _: int, __: Reading
) -> Received:
    return replace(received, fix=messages.fix_problem(message))


def _traffic(
    received: Received, message: "dialect.MAVLink_adsb_vehicle_message", time: int, reading: Reading
) -> Received:
    name = messages.traffic_name(message)
    own = received.situation.own.last
    outcome = attempt(lambda: messages.traffic(message, time, reading.references, own))
    if outcome is None:
        return leave_out(received, "surface vehicle on the ground")
    return take_traffic(received, name, outcome, time, reading)


def _clock(
    received: Received, message: "dialect.MAVLink_system_time_message", _: int, __: Reading
) -> Received:
    return replace(received, utc=remote_id.utc_offset(message))


def _drone_name(received: Received, message: Any, time: int, _: Reading) -> Received:
    """Take in a BASIC_ID; with its first name a drone goes by that, not by its transmitter's
    address.
    """
    identity, address = remote_id.basic_id(message), remote_id.address_of(message)
    if identity is None:
        return received
    drone = received.drones.get(address, Drone(time))
    if identity.name in drone.names or len(drone.ids) == _MOST_IDS:
        return received
    if not drone.ids:
        received = _without(received, _unnamed(address).name)
    return _remember_drone(received, address, drone._replace(ids=(*drone.ids, identity)))


def _drone_state(received: Received, message: Any, time: int, reading: Reading) -> Received:
    """Take in a LOCATION, which may be an echo of the own one."""
    address = remote_id.address_of(message)
    drone = received.drones.get(address, Drone(time))
    received = _remember_drone(received, address, drone)
    # Among so many strangers nobody waits for a name: they may hide those that have one.
    has_room = len(received.drones) < _MOST_DRONES
    if has_room and address and not drone.ids and time - drone.since < _NAMED_WITHIN * SECOND:
        return leave_out(received, _NAMELESS)
    if not remote_id.is_placed(message):
        return leave_out(received, WITHOUT_POSITION)
    identity = drone.ids[0] if drone.ids else _unnamed(address)
    moment, own = Moment(time, received.utc), received.situation.own.last
    outcome = attempt(lambda: remote_id.location(message, moment, identity, own))
    if outcome is None:
        return leave_out(received, "on the ground")
    reason = _own_reason(received, drone, address, reading)
    if reason and _may_be_own_drone(own, outcome, reading.rules):
        return leave_out(_without(received, identity.name), reason)
    return take_traffic(received, identity.name, outcome, time, reading)


def _own_reason(received: Received, drone: Drone, address: str, reading: Reading) -> str:
    """Return why a drone that flies as the own one does is left out; "": it is another.

    The own one has no address of a transmitter. A receiver that tells none of others breaks the
    protocol: with two names of one register they are others', and with less it is told about.
    """
    own_drone = received.drones.get("")
    alone = own_drone is not None and not own_drone.is_several
    names = reading.own_drone | (
        own_drone.names if own_drone is not None and alone else frozenset()
    )
    if address or drone.names & reading.own_drone:
        return _OWN_ECHO if drone.names & names else ""
    return _NO_ADDRESS if alone else ""


def _may_be_own_drone(own: Report | None, outcome: Report | FieldError, rules: Rules) -> bool:
    """Return whether a drone may be the ownship: about where it is, and as fast."""
    if own is None:
        return True
    if isinstance(outcome, Report):
        apart = math.hypot(outcome.east - own.east, outcome.north - own.north)
        if apart > _OWN_VELOCITY:
            return False
    return may_be_own(own, outcome.sighting, rules)


def _drone_pack(received: Received, message: Any, time: int, reading: Reading) -> Received:
    """Take in the messages of a pack."""
    parts = attempt(lambda: list(remote_id.unpack(message)))
    if isinstance(parts, FieldError):
        return leave_out(received, UNREADABLE)
    for kind, part in parts:
        received = _KINDS[kind](received, part, time, reading)
    return received


def _unnamed(address: str) -> BasicId:
    """Return what a drone is called that does not say who it is."""
    return BasicId(f"rid-mac:{address or 'unknown'}", "", 0)


def _remember_drone(received: Received, address: str, drone: Drone) -> Received:
    """Return what is known with a drone; of too many those that were heard longest ago are
    forgotten.
    """
    drones = {name: other_drone for name, other_drone in received.drones.items() if name != address}
    drones[address] = drone
    for oldest in list(drones)[: max(len(drones) - _MOST_DRONES, 0)]:
        del drones[oldest]
    return replace(received, drones=MappingProxyType(drones))


def _without(received: Received, name: str) -> Received:
    """Return what is known without an aircraft of the traffic."""
    situation = received.situation
    dropped = sharing(situation.traffic, name)
    if not dropped:
        return received
    traffic = {key: track for key, track in situation.traffic.items() if key not in dropped}
    return replace(received, situation=replace(situation, traffic=traffic))


def _current(
    received: Received, message: "dialect.MAVLink_mission_current_message", _: int, __: Reading
) -> Received:
    return replace(received, current=int(message.seq))


def _target(
    received: Received,
    message: "dialect.MAVLink_position_target_global_int_message",
    _: int,
    __: Reading,
) -> Received:
    place = int(message.lat_int), int(message.lon_int)
    return replace(received, target=place, target_altitude=float(message.alt))


def _parameter(
    received: Received, message: "dialect.MAVLink_param_value_message", _: int, __: Reading
) -> Received:
    value = float(message.param_value)
    if not math.isfinite(value):  # the last one stays
        return received
    parameters = {**received.parameters, message.param_id: value}
    return replace(received, parameters=MappingProxyType(parameters))


_KINDS: dict[str, Callable[[Received, Any, int, Reading], Received]] = {
    "HEARTBEAT": _heartbeat,
    "GLOBAL_POSITION_INT": _position,
    "VFR_HUD": _hud,
    "WIND": _wind,
    "EKF_STATUS_REPORT": _estimate,
    "ESTIMATOR_STATUS": _estimate,
    "GPS_RAW_INT": _fix,
    "ADSB_VEHICLE": _traffic,
    "MISSION_CURRENT": _current,
    "POSITION_TARGET_GLOBAL_INT": _target,
    "PARAM_VALUE": _parameter,
    "SYSTEM_TIME": _clock,
    "OPEN_DRONE_ID_BASIC_ID": _drone_name,
    "OPEN_DRONE_ID_LOCATION": _drone_state,
    "OPEN_DRONE_ID_MESSAGE_PACK": _drone_pack,
}
"""Where each kind of message goes."""
