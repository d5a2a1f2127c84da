"""Remote ID (ASTM F3411) as MAVLink carries it, ``OPEN_DRONE_ID_*``: drones that broadcast who and
where they are, received by a module beside the autopilot.

A drone sends its name (BASIC_ID) and its state (LOCATION) apart, one by one or in a pack of the
standard's own encoding; both belong to the address of its transmitter. The units and the values
that mean *unknown* are those of MAVLink's common.xml; the encoding of packs is the standard's, as
opendroneid-core-c has it.
"""

import math
import struct
from collections.abc import Iterator
from typing import Any, NamedTuple

from agents.planner.request.request import Altitude
from ros_bridge.core.conversions import altitude, report
from ros_bridge.core.feeds.accuracy import EPU, EPV, sigma
from ros_bridge.core.feeds.traffic import LATEST
from ros_bridge.core.fields import SECOND, FieldError, callsign, integer, number, place
from ros_bridge.core.ground import on_ground
from ros_bridge.core.reports import Report

__all__ = [
    "BasicId",
    "Drone",
    "Moment",
    "address_of",
    "basic_id",
    "is_placed",
    "location",
    "names_of",
    "unpack",
    "utc_offset",
]

_PREFIXES = {1: "rid", 2: "rid-caa", 3: "rid-utm", 4: "rid-session"}
"""What names begin with, by the type of the identification: they share no register."""

_TEXTS = (1, 2)  # types whose identifications are texts; others are bytes
_FIXED_TYPES = (9, 13, 14)  # captive balloon, tethered aircraft, ground obstacle
_OBSTACLE, _UNMANNED = 19, 14  # emitter categories

_GROUND, _FAILING = 1, 4  # MAV_ODID_STATUS
_UNKNOWN_DIRECTION = 36_100  # hundredths of a degree
_UNKNOWN_SPEED, _HIGHEST_SPEED = 25_500, 25_425  # cm/s; the highest means: or more
_UNKNOWN_CLIMB, _HIGHEST_CLIMB = 6_300, 6_200  # cm/s
_UNKNOWN_ALTITUDE = -1_000  # m
_HOUR = 3_600.0  # s
_EARLY = 1.0  # s by which a drone's clock may be ahead of the autopilot's

# By the codes of MAV_ODID_HOR_ACC, _SPEED_ACC, _VER_ACC and _TIME_ACC, of which 0 is unknown. The
# first two are NACp and NACv, and one that is finer.
_HORIZONTAL = (*EPU, 1.0)  # m
_VERTICAL = (150, 150, 45, 25, 10, 3, 1)  # m
_TIME_STEP = 0.1  # s
_WORST_TIME = 15  # the code of 1.5 s

# What the encoding rounds.
_DIRECTION_STEP = math.radians(1.0)
_SPEED_STEP, _FAST_STEP, _FAST = 0.25, 0.75, 63.75  # m/s; the wider step above the last

_SIZE, _MOST = 25, 9  # bytes of a message in a pack; messages
_BASIC_ID, _LOCATION = 0, 1


class BasicId(NamedTuple):
    """Who a drone is."""

    name: str  # under which it goes
    callsign: str  # "": it cannot be shown
    category: int


class Drone(NamedTuple):
    """What is known of a transmitter."""

    since: int  # when its state was heard first, on the autopilot's clock, ns
    ids: tuple[BasicId, ...] = ()  # the first is what it is called by

    @property
    def names(self) -> frozenset[str]:
        """All its names."""
        return frozenset(identity.name for identity in self.ids)

    @property
    def is_several(self) -> bool:
        """Whether it has two names of one register, as where a receiver tells no transmitters."""
        registers = [identity.name.partition(":")[0] for identity in self.ids]
        return len(set(registers)) < len(registers)


class Moment(NamedTuple):
    """When something arrived."""

    time: int  # on the autopilot's clock, ns
    offset: int | None  # of UTC since 1970 to that clock, ns; None: unknown


class _Fields(NamedTuple):
    """A BASIC_ID or a LOCATION out of a pack, with the fields and units of MAVLink's message."""

    id_or_mac: list[int]
    id_type: int = 0
    ua_type: int = 0
    uas_id: tuple[int, ...] = ()
    status: int = 0
    direction: int = _UNKNOWN_DIRECTION
    speed_horizontal: int = _UNKNOWN_SPEED
    speed_vertical: int = _UNKNOWN_CLIMB
    latitude: int = 0
    longitude: int = 0
    altitude_barometric: float = _UNKNOWN_ALTITUDE
    altitude_geodetic: float = _UNKNOWN_ALTITUDE
    horizontal_accuracy: int = 0
    vertical_accuracy: int = 0
    barometer_accuracy: int = 0
    speed_accuracy: int = 0
    timestamp: float = math.inf
    timestamp_accuracy: int = 0


def address_of(message: Any) -> str:
    """Return the address of the transmitter that a message is of, hexadecimal; "": it is of the
    own drone.
    """
    return bytes(message.id_or_mac).rstrip(b"\0").hex()


def basic_id(message: Any) -> BasicId | None:
    """Return who an OPEN_DRONE_ID_BASIC_ID says that a drone is; None: nobody."""
    prefix, content = _PREFIXES.get(message.id_type), bytes(message.uas_id).rstrip(b"\0")
    if prefix is None or not content:
        return None
    text = content.decode("ascii", "replace") if message.id_type in _TEXTS else ""
    identifier = text if text.isascii() and text.isprintable() and text.strip() else content.hex()
    category = _OBSTACLE if message.ua_type in _FIXED_TYPES else _UNMANNED
    return BasicId(f"{prefix}:{identifier.strip().lower()}", callsign(text), category)


def names_of(identification: str) -> frozenset[str]:
    """Return under which names a drone may go that has an identification, as people write it; of ""
    none.
    """
    plain = identification.strip().lower()
    return frozenset(f"{prefix}:{plain}" for prefix in _PREFIXES.values() if plain)


def utc_offset(message: Any) -> int | None:
    """Return what a SYSTEM_TIME says that UTC since 1970 is ahead of the autopilot's clock, ns;
    None: the autopilot does not know.
    """
    if message.time_unix_usec < 1_000_000 * SECOND // 1_000:  # before 2001
        return None
    return 1_000 * int(message.time_unix_usec) - int(message.time_boot_ms) * (SECOND // 1_000)


def unpack(message: Any) -> Iterator[tuple[str, _Fields]]:
    """Yield the messages of an OPEN_DRONE_ID_MESSAGE_PACK that are read, by the names of MAVLink's,
    or raise :class:`FieldError`.
    """
    size = integer("remote id.single_message_size", message.single_message_size, _SIZE, _SIZE)
    count = integer("remote id.msg_pack_size", message.msg_pack_size, 1, _MOST)
    pack, sender = bytes(message.messages), list(message.id_or_mac)
    for begin in range(0, size * count, size):
        content = pack[begin : begin + size]
        kind = content[0] >> 4
        if kind == _BASIC_ID:
            yield "OPEN_DRONE_ID_BASIC_ID", _unpack_basic_id(sender, content)
        elif kind == _LOCATION:
            yield "OPEN_DRONE_ID_LOCATION", _unpack_location(sender, content)


def _unpack_basic_id(sender: list[int], content: bytes) -> _Fields:
    kinds = content[1]
    return _Fields(sender, id_type=kinds >> 4, ua_type=kinds & 0xF, uas_id=tuple(content[2:22]))


def _unpack_location(sender: list[int], content: bytes) -> _Fields:
    bits, course, fast, climb, latitude, longitude, *heights = struct.unpack_from(
        "<BBBbiiHHH", content, 1
    )
    position_accuracies, speeds = content[19:21]
    tenths, time_accuracy = struct.unpack_from("<HB", content, 21)
    direction = course + 180 * (bits >> 1 & 1)
    speed = _FAST + _FAST_STEP * fast if bits & 1 else _SPEED_STEP * fast
    barometric, geodetic, _ = (0.5 * height + _UNKNOWN_ALTITUDE for height in heights)
    return _Fields(
        sender,
        status=bits >> 4,
        direction=100 * direction,
        speed_horizontal=round(100 * speed),
        speed_vertical=50 * climb,
        latitude=latitude,
        longitude=longitude,
        altitude_barometric=barometric,
        altitude_geodetic=geodetic,
        horizontal_accuracy=position_accuracies & 0xF,
        vertical_accuracy=position_accuracies >> 4,
        speed_accuracy=speeds & 0xF,
        barometer_accuracy=speeds >> 4,
        timestamp=math.inf if tenths == 0xFFFF else tenths / 10,
        timestamp_accuracy=time_accuracy & 0xF,
    )


def is_placed(message: Any) -> bool:
    """Return whether a LOCATION has a position: latitude and longitude are 0 where it has none."""
    return bool(message.latitude or message.longitude)


def location(
    message: Any, moment: Moment, identity: BasicId, own: Report | None = None
) -> Report | None:
    """Return the report of an OPEN_DRONE_ID_LOCATION; None: the drone is on the ground, and no
    traffic.

    Args:
        message: its fields.
        moment: when it arrived.
        identity: who the drone is.
        own: the ownship; None: unknown.

    Raises:
        FieldError: position or velocity are unknown, or a field is out of range; with a sighting.
    """
    fields = _LocationFields(message, moment, f"remote id {identity.name}")
    if message.status == _GROUND and identity.category != _OBSTACLE and fields.on_ground(own):
        return None
    return report(
        identity.name,
        fields.time,
        fields.place,
        fields.velocity,
        lambda: fields.altitude(own),
        position_std=lambda: sigma(_HORIZONTAL, message.horizontal_accuracy or None),
        velocity_std=fields.velocity_std,
        time_std=fields.time_std,
        category=lambda: identity.category,
        callsign=lambda: identity.callsign,
    )


class _LocationFields(NamedTuple):
    """The parts of a LOCATION, each checked when it is read."""

    message: Any
    moment: Moment
    name: str

    def time(self) -> int:
        """Return when the state held, on the autopilot's clock, ns.

        The message tells the seconds since the full hour of UTC; without them, or without UTC here,
        it is when it arrived.
        """
        age = self._age()
        if age is None:
            return self.moment.time
        if age > LATEST:
            problem = f"is {age:.1f} s old, expected {LATEST:g} s at most"
            raise FieldError(f"{self.name}.timestamp", problem)
        return self.moment.time - int(age * SECOND)

    def _age(self) -> float | None:
        """Return how old the state is, s; None: nobody knows."""
        seconds, offset = self.message.timestamp, self.moment.offset
        if offset is None or not 0.0 <= seconds <= _HOUR:  # NaN fails it too
            return None
        utc = (self.moment.time + offset) % (int(_HOUR) * SECOND) / SECOND
        age = (utc - seconds) % _HOUR
        return 0.0 if age > _HOUR - _EARLY else age

    def time_std(self) -> float:
        """Return one sigma of the time, s: of a bound either way."""
        code = self.message.timestamp_accuracy
        is_declared = self._age() is not None and 0 < code <= _WORST_TIME
        return (code if is_declared else _WORST_TIME) * _TIME_STEP / math.sqrt(3.0)

    def place(self) -> tuple[float, float]:
        """Return latitude and longitude, degrees."""
        return place(self.name, 1e-7 * self.message.latitude, 1e-7 * self.message.longitude)

    def speed(self) -> float | None:
        """Return the speed over the ground, m/s; None: unknown."""
        speed = self.message.speed_horizontal
        if speed == _UNKNOWN_SPEED:
            return None
        return number(f"{self.name}.speed", 0.01 * speed, 0.0, 0.01 * (_HIGHEST_SPEED - 1), "m/s")

    def velocity(self) -> tuple[float, float]:
        """Return true east and north, m/s; what stands still needs no direction."""
        if self.message.status == _FAILING:
            raise FieldError(f"{self.name}.status", "says that the system fails")
        speed, direction = self.speed(), self.message.direction
        if speed is None:
            raise FieldError(f"{self.name}.speed", "is unknown, expected one beside the position")
        if speed == 0.0:
            return 0.0, 0.0
        if direction == _UNKNOWN_DIRECTION:
            problem = "is unknown, expected one beside the position"
            raise FieldError(f"{self.name}.direction", problem)
        degrees = number(f"{self.name}.direction", 0.01 * direction, 0.0, 360.0, "degrees")
        track = math.radians(degrees)
        return speed * math.sin(track), speed * math.cos(track)

    def velocity_std(self) -> float | None:
        """Return one sigma of the velocity per axis, m/s, with what the encoding rounds."""
        declared_std, speed = sigma(EPV, self.message.speed_accuracy or None), self.speed()
        if declared_std is None or speed is None:
            return None
        step = _SPEED_STEP if speed <= _FAST else _FAST_STEP
        rounded = math.hypot(step, speed * _DIRECTION_STEP) / math.sqrt(12.0)
        return math.hypot(declared_std, rounded)

    def climb(self) -> float | None:
        """Return the vertical speed, m/s; None: unknown, or at the end of what can be told."""
        climb = self.message.speed_vertical
        return None if abs(climb) >= _HIGHEST_CLIMB else 0.01 * climb

    def altitude(self, own: Report | None) -> Altitude | None:
        """Return the altitude of the ownship's reference, or else above the ellipsoid, or else by
        pressure; None: unknown.
        """
        level = None if own is None else own.altitude
        reference = None if level is None else level.reference
        values = {
            "wgs84": (self.message.altitude_geodetic, self.message.vertical_accuracy),
            "pressure": (self.message.altitude_barometric, self.message.barometer_accuracy),
        }
        for above in sorted(values, key=lambda above: (above != reference, above != "wgs84")):
            value, code = values[above]
            if value > _UNKNOWN_ALTITUDE or math.isnan(value):
                height = altitude(f"{self.name}.altitude", value, above, self.climb())
                error = _VERTICAL[code] if 0 <= code < len(_VERTICAL) else _VERTICAL[0]
                return Altitude(height.value, above, height.vertical_speed, error)
        return None

    def on_ground(self, own: Report | None) -> bool:
        """Return whether nothing contradicts that it is on the ground; what cannot be read does."""
        try:
            height = self.altitude(own)
            value = None if height is None else height.value
            return on_ground(self.speed(), self.climb(), value, height, own)
        except FieldError:
            return False
