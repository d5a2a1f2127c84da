"""GDL 90, as Stratux, SkyEcho and other receivers send it over UDP to port 4000.

By Garmin AT's *GDL 90 Data Interface Specification* 560-1058-00, revision A, whose sections are
named below. Its traffic reports have no time: they hold at the beginning of the second that the
heartbeat before them tells (3.5), and receivers pass a position on for two seconds before they call
it extrapolated.
"""

import binascii
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from agents.planner.request.request import Altitude
from envs.traffic.track_units import FOOT, KNOT
from ros_bridge.core.categories import LAST
from ros_bridge.core.feeds.accuracy import EPU, RECENT_STD, coarse_velocity_std, sigma
from ros_bridge.core.feeds.traffic import Stream, Target, Traffic, nameless, remember
from ros_bridge.core.fields import SECOND, FieldError, callsign, number, place
from ros_bridge.core.reports import FASTEST, Report

__all__ = ["Datagram", "Gdl90", "checksum"]

_FLAG, _ESCAPE = b"\x7e", b"\x7d"
_ESCAPED = ((_ESCAPE + b"\x5e", _FLAG), (_ESCAPE + b"\x5d", _ESCAPE))
_HEARTBEAT, _OWNSHIP, _TRAFFIC = 0, 10, 20
_PASSED_THROUGH = (30, 31)  # reports of UAT as they were received
_LENGTHS = {_HEARTBEAT: 7, _OWNSHIP: 28, _TRAFFIC: 28}  # bytes, without the checksum

_DAY = 86_400  # s
_SAME_SECOND = 1.5  # s after a heartbeat, in which reports belong to it
_HELD = 2.0 * RECENT_STD  # s; a position is passed on for two seconds
_REMEMBERED = 60.0  # s; for so long an aircraft that is extrapolated was received
_MOST_SENDERS = 8

# Address types (3.5.1.2).
_ICAO, _SELF_ASSIGNED, _TISB_ICAO, _TISB_TRACK, _VEHICLE, _BEACON = range(6)
_VEHICLE_CATEGORIES = (17, 18)
# What the direction is (3.5.1.5).
_DIRECTIONS = ("not valid", "a true track", "a magnetic heading", "a true heading")
_TRUE_TRACK = 1
_TURN = 360.0 / 256.0  # degrees of a step of the direction
_UNKNOWN = 0xFFF  # altitude, horizontal velocity
_UNKNOWN_CLIMB = -0x800


class Datagram(NamedTuple):
    """What arrived at once."""

    sender: str  # its address and port
    content: bytes


def checksum(message: bytes) -> int:
    """Return the frame check sequence of two bytes or more (2.2.3): CRC-CCITT, which takes each
    byte in 16 bits later than the usual form does.
    """
    return binascii.crc_hqx(message[:-2], 0) ^ int.from_bytes(message[-2:], "big")


class Gdl90(Stream):
    """Reads datagrams of whole messages.

    Each sender has its own clock and ownship; of too many senders those that were heard longest ago
    are forgotten.
    """

    def __init__(self, traffic: Traffic) -> None:
        super().__init__(traffic)
        self._senders: dict[str, _Sender] = {}

    def begin(self) -> None:
        """Forget the delays of an earlier connection."""
        super().begin()
        self._senders = {}

    def reports_of(self, datagram: Datagram, arrived: int) -> Iterator[Report | FieldError]:
        """Yield the reports of a datagram and why messages cannot be used, or raise TimeoutError
        (:data:`ros_bridge.core.feeds.traffic.LATEST`).
        """
        if _FLAG not in datagram.content:
            problem = f"is {datagram.content!r:.60}, expected messages of GDL 90"
            yield FieldError("datagram", problem)
            return
        name = datagram.sender
        sender = self._senders.get(name) or _Sender(self._traffic)
        remember(self._senders, name, sender, _MOST_SENDERS)
        for frame in filter(None, datagram.content.split(_FLAG)):
            yield from sender.reports_of(frame, arrived)


class _Sender(Stream):
    """One device: its clock, and what it has received itself."""

    def __init__(self, traffic: Traffic) -> None:
        super().__init__(traffic)
        self._second: tuple[int, int] | None = None  # when it began and was heard, ns
        self._days, self._clock = 0, -1
        self._received: dict[str, int] = {}  # when aircraft were not extrapolated, ns

    def reports_of(self, frame: bytes, arrived: int) -> Iterator[Report | FieldError]:
        """Yield the report of a message between two flags, or why it cannot be used."""
        for stuffed, plain in _ESCAPED:
            frame = frame.replace(stuffed, plain)
        message, declared = frame[:-2], int.from_bytes(frame[-2:], "little")
        if len(message) < 2 or checksum(message) != declared:
            yield FieldError("message", f"is {frame!r:.60}, expected another checksum")
            return
        kind = message[0]
        expected = _LENGTHS.get(kind, len(message))
        if len(message) != expected:
            problem = f"of GDL 90 is {len(message)} bytes long, expected {expected}"
            yield FieldError(f"message {kind}", problem)
        elif kind == _HEARTBEAT:
            self._hear_clock(message, arrived)
        elif kind in (_OWNSHIP, _TRAFFIC):
            yield from self._aircraft(kind, message, arrived)
        elif kind in _PASSED_THROUGH:
            self._traffic.counts["report of UAT as received (GDL 90 message 30 or 31)"] += 1

    def _hear_clock(self, message: bytes, arrived: int) -> None:
        """Take in a heartbeat (3.1): a time of day, where it is UTC's."""
        self._second = arrived, arrived
        if not message[2] & 1:
            return
        clock = (message[2] >> 7) << 16 | int.from_bytes(message[3:5], "little")
        self._days += clock < self._clock - _DAY // 2
        self._clock = clock
        self._second = self._time(self._days * _DAY + clock, arrived), arrived

    def _aircraft(self, kind: int, message: bytes, arrived: int) -> Iterator[Report | FieldError]:
        time = arrived
        if self._second is not None and arrived - self._second[1] <= _SAME_SECOND * SECOND:
            time = self._second[0]
        target = _target_of(message, time)
        if kind == _OWNSHIP:
            report = self._traffic.ownship(target)
            if report is not None:
                yield report
        elif target.type == _BEACON:
            self._traffic.counts["ground station"] += 1
        elif not target.address:
            problem = "is 000000, expected an address"
            yield nameless("gdl90.address", problem, time, target.place)
        elif self._carries_on(target):
            self._traffic.counts["position that the receiver has extrapolated"] += 1
        else:
            yield from self._reports(target)

    def _carries_on(self, target: "_Gdl90Target") -> bool:
        """Return whether a position is extrapolated from one that has been taken: what follows the
        aircraft extrapolates by itself, and knows how uncertain that is.
        """
        name = target.name
        if target.aged:
            remember(self._received, name, target.heard)
            return False
        before = self._received.get(name)
        return before is not None and 0 <= target.heard - before <= _REMEMBERED * SECOND


def _target_of(message: bytes, time: int) -> "_Gdl90Target":
    kind, address = message[1] & 0xF, int.from_bytes(message[2:5], "big")
    return _Gdl90Target(_name(kind, address), time, not message[12] & 4, message)


def _name(kind: int, address: int) -> str:
    """Return under which name the aircraft of an address goes (3.5.1.2): as readsb has ICAO's and
    other addresses, and under one of its own where readsb has none.
    """
    if kind in (_ICAO, _TISB_ICAO):
        return f"{address:06x}"
    if kind in (_SELF_ASSIGNED, _TISB_TRACK):
        return f"~{address:06x}"
    return f"gdl90-{kind}:{address:06x}"


@dataclass(frozen=True)
class _Gdl90Target(Target):
    """The parts of an ownship or traffic report (3.5.1), each checked when it is read; it is aged
    where it is not extrapolated.
    """

    message: bytes

    @property
    def type(self) -> int:
        """Address type."""
        return self.message[1] & 0xF

    @property
    def address(self) -> int:
        """Of the aircraft, 24 bits."""
        return int.from_bytes(self.message[2:5], "big")

    @property
    def field(self) -> str:
        """What its fields' names begin with in messages."""
        return f"gdl90 {self.name}"

    def is_grounded(self) -> bool:
        """Return whether it is not airborne, or a vehicle."""
        vehicle = self.type == _VEHICLE or self.message[18] in _VEHICLE_CATEGORIES
        return vehicle or not self.message[12] & 8

    def is_by_radar(self) -> bool:
        """Return whether it comes of TIS-B."""
        return self.type in (_TISB_ICAO, _TISB_TRACK)

    def has_place(self) -> bool:
        """Return whether it has a position: without one latitude, longitude and NIC are 0."""
        return any(self.message[5:11]) or self.message[13] >> 4 != 0

    def time(self) -> int:
        """Return when the position held, ns."""
        if not self.aged:
            problem = "is extrapolated by the receiver, expected a received one"
            raise FieldError(f"{self.field}.position", problem)
        return self.heard

    def place(self) -> tuple[float, float]:
        """Return latitude and longitude, degrees (3.5.1.3)."""
        angles = (int.from_bytes(self.message[n : n + 3], "big", signed=True) for n in (5, 8))
        latitude, longitude = (180.0 * angle / (1 << 23) for angle in angles)
        return place(self.field, latitude, longitude)

    def speed(self) -> float | None:
        """Return the speed over the ground, m/s (3.5.1.7)."""
        knots = self.message[14] << 4 | self.message[15] >> 4
        return None if knots == _UNKNOWN else knots * KNOT

    def velocity(self) -> tuple[float, float]:
        """Return true east and north, m/s. A heading is no track: in wind an aircraft flies
        elsewhere, and so its velocity is unknown.
        """
        speed = self.speed()
        if speed is None:
            raise FieldError(f"{self.field}.speed", "is unknown, expected one beside the position")
        number(f"{self.field}.speed", speed, 0.0, FASTEST, "m/s")
        direction = self.message[12] & 3
        if speed and direction != _TRUE_TRACK:
            problem = f"is {_DIRECTIONS[direction]}, expected {_DIRECTIONS[_TRUE_TRACK]}"
            raise FieldError(f"{self.field}.track", problem)
        track = math.radians(self.message[17] * _TURN)
        return speed * math.sin(track), speed * math.cos(track)

    def climb(self) -> float | None:
        """Return the vertical speed, m/s (3.5.1.8)."""
        steps = (self.message[15] & 0xF) << 8 | self.message[16]
        steps -= (steps & 0x800) << 1
        if steps == _UNKNOWN_CLIMB:
            return None
        climb = steps * 64 * FOOT / 60
        return number(f"{self.field}.vertical_speed", climb, -100.0, 100.0, "m/s")

    def altitude(self, reference: str | None) -> Altitude | None:
        """Return the altitude by pressure, whatever the reference (3.5.1.4)."""
        steps = self.message[11] << 4 | self.message[12] >> 4
        if steps == _UNKNOWN:
            return None
        feet = number(f"{self.field}.altitude", 25 * steps - 1_000, -3_000, 98_000, "ft")
        return Altitude(feet * FOOT, "pressure", self.climb())

    def position_std(self) -> float | None:
        """Return one sigma of the position per axis, m (3.5.1.6): an NACp of 0 is an unknown one,
        as receivers send it that have none.
        """
        return sigma(EPU, self.message[13] & 0xF or None)

    def velocity_std(self) -> float | None:
        """Return one sigma of the velocity per axis, m/s, which is unknown."""
        return coarse_velocity_std(self.speed() or 0.0, math.radians(_TURN))

    def time_std(self) -> float:
        """Return one sigma of the time, s."""
        return _HELD

    def category(self) -> int:
        """Return the emitter category; those beyond ADS-B's are none."""
        return self.message[18] if self.message[18] <= LAST else 0

    def callsign(self) -> str:
        """Return the callsign."""
        return callsign(self.message[19:27])
