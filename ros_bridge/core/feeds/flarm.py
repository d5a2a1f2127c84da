"""Sentences of a FLARM's data port, which many devices serve by TCP on port 2000: ``PFLAA``, and
``RMC`` and ``GGA`` for the own place from which it tells where others are.

By FLARM Technology's *Data Port Interface Control Document* FTD-012. A sentence has no time: it
holds for the second of the own fix before it.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from agents.planner.request.request import Altitude
from envs.formats.local_frame import fly_straight
from envs.traffic.track_units import KNOT
from ros_bridge.core.conversions import altitude
from ros_bridge.core.feeds.accuracy import RECENT_STD, coarse_velocity_std
from ros_bridge.core.feeds.traffic import WITHOUT_POSITION, Stream, Target, Traffic, nameless
from ros_bridge.core.fields import SECOND, FieldError, attempt, callsign, number, place
from ros_bridge.core.reports import FASTEST, Report

__all__ = ["Flarm"]

_SENTENCE = re.compile(r"\$([^*$]*)\*([0-9A-Fa-f]{2})")
_ID = re.compile(r"([0-9A-Fa-f]{6})(?:!(.*))?")
_CLOCK = re.compile(r"(\d\d)(\d\d)(\d\d(?:\.\d+)?)", re.ASCII)
_ANGLE = re.compile(r"(\d{2,3})([0-5]\d(?:\.\d+)?)", re.ASCII)
_OWN = "flarm-own"
"""What the own aircraft is called where nobody tells its address."""

_DAY = 86_400.0  # s
_OWN_AGE = 2.0  # s; an own fix that is older places nobody
_FARTHEST = 20_000_000.0  # m
_VERTICAL_SHARE = 0.1
"""By which part of it a difference of height may be off: receivers take that of pressure altitudes
for other transmitters than FLARM, and no air is so warm or cold that more is added.
"""

_ICAO = "1"
_NAMES = {_ICAO: "", "2": "flarm:"}
"""What is put before an identification, by its type; others change in flight (random ones)."""

_TISB = "4"  # of the sources: 0 FLARM, 1 ADS-B, 3 ADS-R, 4 TIS-B, 6 Mode S

_STATIC = "F"
_CATEGORIES = {
    "1": 9,  # glider
    "2": 1,  # tow plane: light
    "3": 7,  # rotorcraft
    "4": 11,  # parachutist
    "6": 12,  # hang glider
    "7": 12,  # paraglider
    "8": 1,  # with pistons: light
    "B": 10,  # balloon: lighter than air
    "C": 10,  # airship
    "D": 14,  # unmanned
    _STATIC: 19,  # a point obstacle
}
"""Emitter categories by the type of aircraft; the others may be of any."""

_NEED_SPEED = frozenset("12589")
"""Types that do not stand still in flight."""


class _Fix(NamedTuple):
    """The own aircraft by a sentence of the receiver for satellites."""

    arrived: int  # ns
    time: int  # when it held, ns
    place: tuple[float, float]  # degrees
    speed: float | None = None  # m/s
    track: float | None = None  # degrees


class _Height(NamedTuple):
    """The own height by such a sentence."""

    arrived: int  # ns
    value: float  # m above mean sea level


class Flarm(Stream):
    """Reads sentences; of other kinds than its own nothing is taken."""

    def __init__(self, traffic: Traffic) -> None:
        super().__init__(traffic)
        self._forget_fix()

    def begin(self) -> None:
        """Forget the delays and the fix of an earlier connection."""
        super().begin()
        self._forget_fix()

    def _forget_fix(self) -> None:
        self._fix: _Fix | None = None
        self._height: _Height | None = None
        self._days, self._clock = 0, -1.0

    def reports_of(self, text: str, arrived: int) -> Iterator[Report | FieldError]:
        """Yield the report of a sentence, or why it cannot be used, or raise TimeoutError
        (:data:`ros_bridge.core.feeds.traffic.LATEST`).
        """
        text = text.strip()
        if not text:
            return
        sentence = _SENTENCE.fullmatch(text)
        if sentence is None:
            yield FieldError("sentence", f"is {text!r:.60}, expected one such as $PFLAA,...*5C")
            return
        own_sum = 0
        for character in sentence[1].encode("utf-8", "replace"):
            own_sum ^= character
        if own_sum != int(sentence[2], 16):
            yield FieldError("sentence", f"is {text!r:.90}, expected the checksum {own_sum:02X}")
            return
        kind, *fields = sentence[1].split(",")
        fields += [""] * (_MOST_FIELDS - len(fields))
        if kind == "PFLAA":
            yield from self._aircraft(fields, arrived)
        elif kind == "PFLAU":
            self._status(fields)
        elif kind[2:] == "RMC":
            yield from self._take_fix(fields, arrived)
        elif kind[2:] == "GGA":
            self._take_height(fields, arrived)

    def _status(self, fields: list[str]) -> None:
        """Take in what the device says of itself; its alarms are counted, and decide nothing."""
        if fields[_Status.GPS] == "0":
            self._fix = None
        if fields[_Status.ALARM] not in ("", "0"):
            self._traffic.counts["FLARM's own alarm, which decides nothing"] += 1

    def _take_fix(self, fields: list[str], arrived: int) -> Iterator[Report | FieldError]:
        """Take in RMC: the own place and velocity."""
        self._fix = None
        if fields[_Rmc.STATUS] != "A":
            return
        time = self._hear_clock(fields[_Rmc.TIME], arrived)
        location = attempt(lambda: _place(fields[_Rmc.LATITUDE : _Rmc.LATITUDE + 4]))
        if isinstance(location, FieldError):
            yield location
            return
        speed = attempt(lambda: _own_speed(fields[_Rmc.SPEED]))
        track = attempt(lambda: number("rmc.track", fields[_Rmc.TRACK], 0.0, 360.0, "degrees"))
        self._fix = _Fix(
            arrived,
            time,
            location,
            None if isinstance(speed, FieldError) else speed,
            None if isinstance(track, FieldError) else track,
        )
        own = self._traffic.ownship(self._own_target(self._fix))
        if own is not None:
            yield own

    def _take_height(self, fields: list[str], arrived: int) -> None:
        """Take in GGA: the own height."""
        self._height = None
        above = attempt(lambda: number("gga.altitude", fields[_Gga.ALTITUDE], -1e3, 3e4, "m"))
        if fields[_Gga.QUALITY] not in ("", "0") and not isinstance(above, FieldError):
            self._height = _Height(arrived, above)

    def _hear_clock(self, text: str, arrived: int) -> int:
        """Return when a sentence with a time of day held, ns."""
        match = _CLOCK.fullmatch(text)
        if match is None:
            return arrived
        clock = 3600.0 * int(match[1]) + 60.0 * int(match[2]) + float(match[3])
        self._days += clock < self._clock - _DAY / 2
        self._clock = clock
        return self._time(self._days * _DAY + clock, arrived)

    def _own_height(self, arrived: int) -> float | None:
        """Return the own height for what arrives at a time, ns, m; None: nobody knows."""
        latest = self._height
        return latest.value if latest is not None and _is_recent(latest, arrived) else None

    def _own_target(self, fix: _Fix) -> "_OwnTarget":
        name = self._traffic.own_id or _OWN
        return _OwnTarget(name, fix.time, True, fix, self._own_height(fix.arrived))

    def _aircraft(self, fields: list[str], arrived: int) -> Iterator[Report | FieldError]:
        """Yield the report of PFLAA."""
        if fields[_Aircraft.EAST] == "":
            self._traffic.counts[WITHOUT_POSITION] += 1  # of a distance alone
            return
        fix = self._fix
        if fix is not None and not _is_recent(fix, arrived):
            fix = None
        time = arrived if fix is None else fix.time
        identity = _ID.fullmatch(fields[_Aircraft.ID])
        name = "" if identity is None else _name(fields[_Aircraft.ID_TYPE], identity[1])
        target = _FlarmTarget(name, time, True, fields, fix, self._own_height(arrived))
        if identity is None:
            problem = f"is {fields[_Aircraft.ID]!r:.20}, expected six hexadecimal digits"
            yield nameless("flarm.id", problem, time, target.place)
        else:
            yield from self._reports(target)


class _Status:
    """Fields of PFLAU, from 0."""

    GPS = 2
    ALARM = 4


class _Rmc:
    """Fields of RMC."""

    TIME = 0
    STATUS = 1
    LATITUDE = 2  # and three more: its half, the longitude and its half
    SPEED = 6
    TRACK = 7


class _Gga:
    """Fields of GGA."""

    QUALITY = 5
    ALTITUDE = 8


class _Aircraft:
    """Fields of PFLAA."""

    NORTH = 1
    EAST = 2
    VERTICAL = 3
    ID_TYPE = 4
    ID = 5
    TRACK = 6
    SPEED = 8
    CLIMB = 9
    TYPE = 10
    SOURCE = 12


_MOST_FIELDS = 15


def _is_recent(own: _Fix | _Height, arrived: int) -> bool:
    """Return whether something own goes with what arrives at a time, ns."""
    return 0 <= arrived - own.arrived <= _OWN_AGE * SECOND


def _name(kind: str, identity: str) -> str:
    return f"{_NAMES.get(kind, 'flarm-random:')}{identity.lower()}"


def _own_speed(text: str) -> float:
    """Return a speed in knots, m/s."""
    return number("rmc.speed", text, 0.0, FASTEST / KNOT, "kt") * KNOT


def _place(fields: list[str]) -> tuple[float, float]:
    """Return latitude and longitude, degrees, of two angles and the halves of the Earth."""
    angles = []
    for text, half, halves in ((*fields[:2], "NS"), (*fields[2:], "EW")):
        match = _ANGLE.fullmatch(text)
        if match is None or half not in tuple(halves):
            problem = f"is {text!r:.20},{half!r:.5}, expected degrees and minutes such as 4708.21,N"
            raise FieldError("rmc.place", problem)
        angle = int(match[1]) + float(match[2]) / 60.0
        angles.append(angle if half == halves[0] else -angle)
    return place("rmc", *angles)


@dataclass(frozen=True)
class _OwnTarget(Target):
    """The own aircraft."""

    fix: _Fix
    height: float | None  # m above mean sea level

    @property
    def field(self) -> str:
        """What its fields' names begin with in messages."""
        return "flarm own"

    def place(self) -> tuple[float, float]:
        """Return latitude and longitude, degrees."""
        return self.fix.place

    def speed(self) -> float | None:
        """Return the speed over the ground, m/s."""
        return self.fix.speed

    def velocity(self) -> tuple[float, float]:
        """Return true east and north, m/s."""
        return _velocity(self.field, self.fix.speed, self.fix.track)

    def climb(self) -> float | None:
        """Return the vertical speed, which is unknown."""
        return None

    def altitude(self, reference: str | None) -> Altitude | None:
        """Return the altitude above mean sea level, whatever the reference."""
        return None if self.height is None else Altitude(self.height, "msl")


@dataclass(frozen=True)
class _FlarmTarget(Target):
    """The parts of PFLAA, each checked when it is read."""

    fields: list[str]
    own: _Fix | None  # None: unknown, or too old
    own_height: float | None  # m above mean sea level

    @property
    def field(self) -> str:
        """What its fields' names begin with in messages."""
        return self.name if self.name.startswith("flarm") else f"flarm {self.name}"

    def is_grounded(self) -> bool:
        """Return whether it stands still and is of a type that needs a speed to fly."""
        needs = self.fields[_Aircraft.TYPE].upper() in _NEED_SPEED
        return needs and attempt(self.speed) == 0.0

    def is_by_radar(self) -> bool:
        """Return whether it comes of TIS-B, which versions since 9 tell."""
        return self.fields[_Aircraft.SOURCE] == _TISB

    def place(self) -> tuple[float, float]:
        """Return latitude and longitude, degrees."""
        if self.own is None:
            problem = f"is unknown or older than {_OWN_AGE:g} s, expected RMC with a fix"
            raise FieldError(f"{self.field}: the own place", problem)
        north, east = (
            number(f"{self.field}.relative_{axis}", self.fields[at], -_FARTHEST, _FARTHEST, "m")
            for axis, at in (("north", _Aircraft.NORTH), ("east", _Aircraft.EAST))
        )
        return place(self.field, *fly_straight(*self.own.place, east, north, 1.0))

    def speed(self) -> float | None:
        """Return the speed over the ground, m/s."""
        text = self.fields[_Aircraft.SPEED]
        return number(f"{self.field}.speed", text, 0.0, FASTEST, "m/s") if text else None

    def velocity(self) -> tuple[float, float]:
        """Return true east and north, m/s."""
        if self.fields[_Aircraft.TYPE].upper() == _STATIC:
            return 0.0, 0.0
        text = self.fields[_Aircraft.TRACK]
        track = number(f"{self.field}.track", text, 0.0, 360.0, "degrees") if text else None
        return _velocity(self.field, self.speed(), track)

    def climb(self) -> float | None:
        """Return the vertical speed, m/s."""
        text = self.fields[_Aircraft.CLIMB]
        return number(f"{self.field}.climb", text, -100.0, 100.0, "m/s") if text else None

    def altitude(self, reference: str | None) -> Altitude | None:
        """Return the altitude above mean sea level, whatever the reference."""
        text = self.fields[_Aircraft.VERTICAL]
        if self.own_height is None or not text:
            return None
        above = number(f"{self.field}.relative_vertical", text, -3e4, 3e4, "m")
        reading = altitude(f"{self.field}.altitude", self.own_height + above, "msl", self.climb())
        error = _VERTICAL_SHARE * abs(above)
        return Altitude(reading.value, reading.reference, reading.vertical_speed, error)

    def velocity_std(self) -> float | None:
        """Return one sigma of the velocity per axis, m/s, which is unknown."""
        return coarse_velocity_std(self.speed() or 0.0, math.radians(1.0))

    def time_std(self) -> float:
        """Return one sigma of the time, s."""
        return RECENT_STD

    def category(self) -> int:
        """Return the emitter category."""
        return _CATEGORIES.get(self.fields[_Aircraft.TYPE].upper(), 0)

    def callsign(self) -> str:
        """Return the callsign, which some devices add to the identification."""
        match = _ID.fullmatch(self.fields[_Aircraft.ID])
        return callsign(match[2]) if match is not None else ""


def _velocity(name: str, speed: float | None, track: float | None) -> tuple[float, float]:
    """Return true east and north, m/s; what stands still needs no track."""
    if speed == 0.0:
        return 0.0, 0.0
    for component, value in (("speed", speed), ("track", track)):
        if value is None:
            raise FieldError(f"{name}.{component}", "is unknown, expected one beside the position")
    assert speed is not None and track is not None
    course = math.radians(track)
    return speed * math.sin(course), speed * math.cos(course)
