"""Live ADS-B as reports: BaseStation lines, and the ``aircraft.json`` of readsb, tar1090 and
dump1090.

Nothing here imports ROS or connects. A receiver sees all that flies or taxies around it, also the
ownship. What is no traffic is left out and counted; of unusable messages name and place are kept.
"""

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from enum import IntEnum
from typing import Any, TypeVar

from agents.planner.request.request import Altitude
from commands.json_text import RepeatedKeyError, parse_json
from envs.traffic.track_units import FOOT, KNOT
from ros_bridge.core.categories import number_of
from ros_bridge.core.conversions import report
from ros_bridge.core.fields import (
    SECOND,
    FieldError,
    Sighting,
    attempt,
    callsign,
    number,
    place,
    readable,
)
from ros_bridge.core.ground import on_ground
from ros_bridge.core.reports import FASTEST, Report

__all__ = ["LATEST", "OWN_TRACES", "AircraftJson", "BaseStation", "Traffic"]

_T = TypeVar("_T")

LATEST = 30.0
"""Delay, s, beyond which a receiver's stream is given up: either that much is queued, or its clock
has jumped.
"""

_EARLY = 0.5  # s; a position may be so much newer than its document, whose times are rounded
OWN_TRACES = frozenset(
    {"own echo", "copy of the ownship", "repeated position", "repeated document"}
)
"""Reasons to leave out what is no other aircraft, or nothing new of one."""

_APART = 3.0  # s, between a position and the velocity that goes with it
_NEW = SECOND * 3 // 20
"""A position is a new one when it is this much later, ns: times are rounded to 0.1 s."""

_MOST_AGE = 1e6  # s
_NAMELESS = "without an address"  # under which its place is told
_MOST = 4096  # aircraft that are remembered

# Within these of the ownship, a track of TIS-B is a copy of it.
_COPY_DISTANCE = 600.0  # m
_COPY_VELOCITY = 15.0  # m/s
_COPY_HEIGHT = 500 * FOOT  # m

_CLIMBS = ("geom_rate", "baro_rate", "vert_rate")  # names of rates of climb, the best first
_ADDRESS = re.compile(r"~?[0-9a-f]{6}")
_TO_SIGMA = 2.448  # radius of 95 % of a circular normal distribution, in standard deviations
_OLDEST = 60.0  # s; receivers forget positions that are older
# Category 0 says that the accuracy is worse than that of 1, or unknown: it is no better than 1.
_EPU = (18_520, 18_520, 7_408, 3_704, 1_852, 926, 555.6, 185.2, 92.6, 30, 10, 3)  # m, by NACp
_EPV = (10, 10, 3, 1, 0.3)  # m/s, by NACv
_OBSTACLES = (19, 20, 21)  # emitter categories C3 to C5; tethered balloons are C3


class Traffic:
    """Decides which of the aircraft received are traffic, and makes their reports; the ownship's
    address may be "".
    """

    def __init__(self, own_id: str) -> None:
        self.own: Report | None = None  # the ownship, to be kept up to date
        self.counts: Counter[str] = Counter()  # of what was left out, by the reason
        self.doubted: Counter[str] = Counter()  # of what was taken although a field forbids it
        self._own_id = own_id.strip().lower()
        self._reported: dict[str, int] = {}

    def begin_anew(self) -> None:
        """Forget when aircraft were reported, because the clock has stepped back."""
        self._reported.clear()

    def report(
        self, address: str, time: int, row: Mapping[str, Any], *, aged: bool = True
    ) -> Report | None:
        """Return an aircraft's report, or raise :class:`FieldError`; None where it is no traffic,
        or repeated.

        Args:
            address: six hexadecimal digits, after ``~`` where it is no ICAO address.
            time: of its position, ns.
            row: its fields as readsb names them, values as they came, and ``velocity_age``, s
                before the position.
            aged: whether the age of its position is known; if not it cannot be planned with, and
                ``time`` is when it arrived.
        """
        reason = self._left_out(address, time, row)
        if reason:
            self.counts[reason] += 1
            return None
        try:
            found = self._read(address, time if aged else None, row)
        except FieldError as error:
            if not aged and error.sighting is not None:
                oldest = time - int(_OLDEST * SECOND)
                error.sighting = error.sighting._replace(time=oldest)
            raise
        by_radar = str(row.get("type")).startswith("tisb") or "lat" in str(row.get("tisb"))
        if by_radar and self._is_copy(found):
            self.counts["copy of the ownship"] += 1
            return None
        _remember(self._reported, address, time)
        return found

    def _left_out(self, address: str, time: int, row: Mapping[str, Any]) -> str:
        """Return why an aircraft is no traffic, as it is counted; "": it is."""
        if address in (self._own_id, "" if self.own is None else self.own.identifier):
            return "own echo"
        if "ground" in (row.get("alt_baro"), row.get("altitude")):
            if self._on_ground(row):
                return "on the ground"
            self.doubted["said to be on the ground, but flies"] += 1
        if _first_known(row, "lat") is None or _first_known(row, "lon") is None:
            return "without a position"
        if time < self._reported.get(address, 0) + _NEW:
            return "repeated position"
        return ""

    def _on_ground(self, row: Mapping[str, Any]) -> bool:
        """Return whether an aircraft is believed to be on the ground, as its row says; what cannot
        be read contradicts it.
        """
        if number_of(row.get("category")) in _OBSTACLES:
            return False
        old = isinstance(attempt(lambda: _velocity_age("", row)), FieldError)
        speed = None if old else _first_known(row, "gs", "speed")
        climb = None if old else _first_known(row, *_CLIMBS)
        try:
            altitude = self._altitude("", row)
            return on_ground(
                None if speed is None else number("", speed, 0.0, math.inf, "kt") * KNOT,
                None if climb is None else number("", climb, -math.inf, math.inf, "") * FOOT / 60,
                None if altitude is None else altitude.value,
                altitude,
                self.own,
            )
        except FieldError:
            return False

    def _read(self, address: str, time: int | None, row: Mapping[str, Any]) -> Report:
        """Return the report of a row; ``time`` is None where the age of its position is unknown."""
        name = f"adsb {address}"
        return report(
            address,
            lambda: _known_time(name, time),
            lambda: place(name, row["lat"], row["lon"]),
            lambda: _velocity(name, row),
            lambda: self._altitude(f"{name}.altitude", row),
            position_std=lambda: _sigma(_EPU, row.get("nac_p")),
            velocity_std=lambda: _sigma(_EPV, row.get("nac_v")),
            category=lambda: number_of(row.get("category")),
            callsign=lambda: callsign(row.get("flight")),
        )

    def _altitude(self, name: str, row: Mapping[str, Any]) -> Altitude | None:
        """Return the altitude that can be compared with the ownship's, or else what there is."""
        known = {
            "wgs84": _first_known(row, "alt_geom"),
            "pressure": _first_known(row, "alt_baro", "altitude"),
        }
        known = {reference: value for reference, value in known.items() if value != "ground"}
        own = None if self.own is None or self.own.altitude is None else self.own.altitude.reference
        climb = _first_known(row, *_CLIMBS)
        if climb is not None:
            climb = number(name, climb, -20_000, 20_000, "ft/min") * FOOT / 60
        for reference in sorted(known, key=lambda one: (one != own, one != "wgs84")):
            if known[reference] is not None:
                value = number(name, known[reference], -3_000, 98_000, "ft")
                return Altitude(value * FOOT, reference, climb)
        return None

    def _is_copy(self, found: Report) -> bool:
        """Return whether a report is about where the ownship is, as fast and known to be as
        high.
        """
        own = self.own
        if own is None or abs(found.time - own.time) > 2 * _APART * SECOND:
            return False
        a, b = own.altitude, found.altitude
        if a is None or b is None or a.reference != b.reference:
            return False
        return (
            own.off(found.place, found.time) <= _COPY_DISTANCE
            and math.hypot(found.east - own.east, found.north - own.north) <= _COPY_VELOCITY
            and abs(a.value - b.value) <= _COPY_HEIGHT
        )


class _Stream:
    """What both kinds of receivers have in common: the traffic, and how late a message is.

    A message is as late as it arrives later than the quickest one, whatever the receiver's clock or
    time zone shows.
    """

    def __init__(self, traffic: Traffic) -> None:
        self._traffic = traffic
        self.begin()

    def begin(self) -> None:
        """Forget the delays of an earlier connection."""
        self._least = math.inf

    def begin_anew(self) -> None:
        """Forget all that hangs on our clock, which has stepped back."""
        self.begin()
        self._traffic.begin_anew()

    def _time(self, sent: float, arrived: int) -> int:
        """Return when a message held, ns, that was sent at the receiver's time, s, and arrived at
        ours, ns.
        """
        self._least = min(self._least, arrived - sent * SECOND)
        late = arrived - sent * SECOND - self._least
        if late > LATEST * SECOND:
            raise TimeoutError(f"is {late / SECOND:.0f} s late, expected {LATEST:g} s at most")
        return arrived - int(late)

    def _reports(
        self, address: str, time: int, row: Mapping[str, Any], *, aged: bool
    ) -> Iterator[Report | FieldError]:
        found = attempt(lambda: self._traffic.report(address, time, row, aged=aged))
        if found is not None:
            yield found


class BaseStation(_Stream):
    """Reads the lines of BaseStation's output, as dump1090 and readsb send it on port 30003, and
    those of positions by multilateration, which begin with MLAT and have further fields.
    """

    def __init__(self, traffic: Traffic) -> None:
        super().__init__(traffic)
        self._heard: dict[str, dict[str, Any]] = {}

    def begin_anew(self) -> None:
        """Forget also what aircraft have sent."""
        super().begin_anew()
        self._heard.clear()

    def reports_of(self, text: str, arrived: int) -> Iterator[Report | FieldError]:
        """Yield the report that a line completes, or why it cannot be used, or raise TimeoutError
        (:data:`LATEST`).
        """
        parts = [part.strip() for part in text.split(",")]
        if not text.strip() or parts[0] in ("STA", "AIR", "ID", "SEL", "CLK"):
            return
        address = parts[_Column.ADDRESS].lower() if len(parts) >= len(_Column) else ""
        if parts[0] not in ("MSG", "MLAT") or not _ADDRESS.fullmatch(address):
            yield FieldError(
                "line", f"is {text!r:.60}, expected 22 fields such as MSG,3,... with an address"
            )
            return
        now, aged = self._time_of(parts, arrived)
        row = _remember(self._heard, address, self._heard.get(address, {}))
        radar = address.startswith("~") and parts[0] == "MSG"
        row["type"] = "tisb" if radar else parts[0].lower()
        _take_columns(row, parts, now)
        if parts[_Column.LATITUDE] and parts[_Column.LONGITUDE]:
            row["lat"], row["lon"] = parts[_Column.LATITUDE], parts[_Column.LONGITUDE]
            row["velocity_age"] = (now - row.get("velocity", now)) / SECOND
            yield from self._reports(address, now, row, aged=aged)

    def _time_of(self, parts: list[str], arrived: int) -> tuple[int, bool]:
        """Return when a line held, ns, and whether that is known; if not, when it arrived."""
        sent = f"{parts[_Column.DATE]} {parts[_Column.TIME]}"
        try:
            moment = datetime.strptime(sent, "%Y/%m/%d %H:%M:%S.%f")
            # The zone is the receiver's and not known.
            return self._time(moment.replace(tzinfo=UTC).timestamp(), arrived), True
        except ValueError:
            return arrived, False


class _Column(IntEnum):
    """Columns of a line of BaseStation's output."""

    MESSAGE = 0
    KIND = 1
    SESSION = 2
    AIRCRAFT = 3
    ADDRESS = 4
    FLIGHT = 5
    DATE = 6
    TIME = 7
    LOGGED_DATE = 8
    LOGGED_TIME = 9
    CALLSIGN = 10
    ALTITUDE = 11
    SPEED = 12
    TRACK = 13
    LATITUDE = 14
    LONGITUDE = 15
    VERTICAL_RATE = 16
    SQUAWK = 17
    ALERT = 18
    EMERGENCY = 19
    IDENT = 20
    ON_GROUND = 21


_SURFACE, _AIRBORNE = "2", "3"  # kinds of messages with a position


def _take_columns(row: dict[str, Any], parts: list[str], now: int) -> None:
    """Take a line of a time, ns, into what is known of its aircraft, but for its position."""
    kind, on_ground = parts[_Column.KIND], parts[_Column.ON_GROUND]
    if on_ground or kind in (_SURFACE, _AIRBORNE):
        row["altitude"] = "ground" if kind == _SURFACE or on_ground in ("1", "-1") else None
    before = None if row.get("altitude") == "ground" else row.get("alt_baro")
    row["alt_baro"] = parts[_Column.ALTITUDE] or before
    row["flight"] = parts[_Column.CALLSIGN] or row.get("flight")
    if parts[_Column.SPEED] and parts[_Column.TRACK]:
        row["gs"], row["track"] = parts[_Column.SPEED], parts[_Column.TRACK]
        row["vert_rate"], row["velocity"] = parts[_Column.VERTICAL_RATE], now


class AircraftJson(_Stream):
    """Reads the document ``aircraft.json`` that readsb, tar1090 and dump1090 write every second."""

    _now = math.nan

    def reports_of(self, text: str, arrived: int) -> Iterator[Report | FieldError]:
        """Yield the reports of a document and why aircraft cannot be used; raise TimeoutError as
        :data:`LATEST` says.

        The first document may have been left there long ago, so reports begin with one that is
        later.
        """
        try:
            document = parse_json(text)
            now = number("document.now", document["now"], 0.0, 1e12, "s")
            rows = list(document["aircraft"])
        except RepeatedKeyError as problem:
            yield FieldError("document", f"{problem}, expected every key once")
            return
        except (ValueError, KeyError, TypeError, RecursionError):
            yield FieldError(
                "document",
                f"is {text!r:.60}, expected an aircraft.json with now and aircraft",
            )
            return
        for row in rows:
            if not isinstance(row, dict) or "hex" not in row:
                yield _nameless("document", f"holds {row!r:.60}, expected its hex", row, arrived)
        before, self._now = self._now, now
        if not now > before:
            self._traffic.counts["repeated document"] += now == before
            return
        written = self._time(now, arrived)
        for row in rows:
            if isinstance(row, dict) and "hex" in row:
                yield from self._row_reports(row, written)

    def _row_reports(self, row: Mapping[str, Any], written: int) -> Iterator[Report | FieldError]:
        """Yield the report of a row of a document that was written at a time, ns. An address or an
        age that cannot be read leaves a place that is told.
        """
        address = str(row["hex"]).strip().lower()
        if not _ADDRESS.fullmatch(address):
            problem = f"is {address!r:.60}, expected six hexadecimal digits"
            yield _nameless("hex", problem, row, written)
            return
        age = _first_known(row, "seen_pos")
        name = f"adsb {address}.seen_pos"
        seconds = attempt(lambda: number(name, age, -_EARLY, _MOST_AGE, "s"))
        if not isinstance(seconds, FieldError):
            time = written - int(max(seconds, 0.0) * SECOND)
            yield from self._reports(address, time, row, aged=True)
            return
        for found in self._reports(address, written, row, aged=False):
            seconds.sighting = found.sighting
            yield found if age is None else seconds


def _nameless(field: str, problem: str, row: Any, time: int) -> FieldError:
    """Return why a row without an address cannot be used, with its place, if it has one, at a time,
    ns.
    """
    wrong = FieldError(field, problem)
    if isinstance(row, dict):
        where = readable(lambda: place("", row.get("lat"), row.get("lon")))
        wrong.sighting = None if where is None else Sighting(_NAMELESS, time, where)
    return wrong


def _first_known(row: Mapping[str, Any], *names: str) -> Any:
    """Return the first of some fields that is there; dump1090-mutability has other names than
    readsb for some.
    """
    return next((row[name] for name in names if row.get(name) not in (None, "")), None)


def _known_time(name: str, time: int | None) -> int:
    if time is None:
        raise FieldError(f"{name}.age", "is unknown, expected the age of the position")
    return time


def _velocity(name: str, row: Mapping[str, Any]) -> tuple[float, float]:
    speed, track = _first_known(row, "gs", "speed"), _first_known(row, "track")
    for what, value in (("speed", speed), ("track", track)):
        if value is None:
            raise FieldError(
                f"{name}.{what}", "has not been received, expected one beside the position"
            )
    _velocity_age(name, row)
    speed = number(f"{name}.speed", speed, 0.0, FASTEST / KNOT, "kt") * KNOT
    track = math.radians(number(f"{name}.track", track, -360.0, 360.0, "degrees"))
    return speed * math.sin(track), speed * math.cos(track)


def _velocity_age(name: str, row: Mapping[str, Any]) -> float:
    """Return how much older the velocity is than the position, s, or raise :class:`FieldError`
    where they do not go together.
    """
    return number(f"{name}.velocity_age", row.get("velocity_age", 0.0), -_APART, _APART, "s")


def _sigma(radii: tuple[float, ...], code: Any) -> float | None:
    """Return the standard deviation per axis that a category of accuracy means; None: unknown."""
    known = isinstance(code, int) and 0 <= code < len(radii)
    return radii[code] / _TO_SIGMA if known else None


def _remember(held: dict[str, _T], address: str, value: _T) -> _T:
    """Hold a value under an address, and return it; of too many those that were heard longest ago
    are dropped.
    """
    held.pop(address, None)
    held[address] = value
    if len(held) > _MOST:
        del held[next(iter(held))]
    return value
