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
from typing import Any

from agents.planner.request import Altitude
from envs.edge.json_text import RepeatedKeyError, parse_json
from envs.traffic.track_units import FOOT, KNOT
from ros_bridge.core.categories import number_of
from ros_bridge.core.conversions import report
from ros_bridge.core.fields import SECOND, FieldError, attempt, number, place
from ros_bridge.core.reports import FASTEST, Report

__all__ = ["LATEST", "AircraftJson", "BaseStation", "Traffic"]

LATEST = 30.0
"""Delay, s, beyond which a receiver's stream is given up: either that much is queued, or its clock
has jumped.
"""

_APART = 3.0  # s, between a position and the velocity that goes with it
_NEW = SECOND * 3 // 20
"""A position is a new one when it is this much later, ns: times are rounded to 0.1 s."""

_MOST = 4096  # aircraft that are remembered

# Within these of the ownship, a track of TIS-B is a copy of it.
_COPY_DISTANCE = 600.0  # m
_COPY_VELOCITY = 15.0  # m/s
_COPY_HEIGHT = 500 * FOOT  # m

_ADDRESS = re.compile(r"~?[0-9a-f]{6}")
_TO_SIGMA = 2.448  # radius of 95 % of a circular normal distribution, in standard deviations
_OLDEST = 60.0  # s; receivers forget positions that are older
_EPU = (0, 18_520, 7_408, 3_704, 1_852, 926, 555.6, 185.2, 92.6, 30, 10, 3)  # m, by NACp
_EPV = (0, 10, 3, 1, 0.3)  # m/s, by NACv


class Traffic:
    """Decides which of the aircraft received are traffic, and makes their reports; the ownship's
    address may be "".
    """

    def __init__(self, own_id: str) -> None:
        self.own: Report | None = None  # the ownship, to be kept up to date
        self.counts: Counter[str] = Counter()  # of what was left out, by the reason
        self._own_id = own_id.strip().lower()
        self._reported: dict[str, int] = {}

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
        if len(self._reported) > _MOST:
            self._reported.clear()
        self._reported[address] = time
        return found

    def _left_out(self, address: str, time: int, row: Mapping[str, Any]) -> str:
        """Return why an aircraft is no traffic, as it is counted; "": it is."""
        if "ground" in (row.get("alt_baro"), row.get("altitude")):
            return "on the ground"
        if address in (self._own_id, "" if self.own is None else self.own.identifier):
            return "own echo"
        if _first_known(row, "lat") is None or _first_known(row, "lon") is None:
            return "without a position"
        if time < self._reported.get(address, 0) + _NEW:
            return "repeated position"
        return ""

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
        )

    def _altitude(self, name: str, row: Mapping[str, Any]) -> Altitude | None:
        """Return the altitude that can be compared with the ownship's, or else what there is."""
        known = {
            "wgs84": _first_known(row, "alt_geom"),
            "pressure": _first_known(row, "alt_baro", "altitude"),
        }
        own = None if self.own is None or self.own.altitude is None else self.own.altitude.reference
        climb = _first_known(row, "geom_rate", "baro_rate", "vert_rate")
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
    """Reads the lines of BaseStation's output, as dump1090 and readsb send it on port 30003."""

    def __init__(self, traffic: Traffic) -> None:
        super().__init__(traffic)
        self._heard: dict[str, dict[str, Any]] = {}

    def reports_of(self, text: str, arrived: int) -> Iterator[Report | FieldError]:
        """Yield the report that a line completes, or why it cannot be used, or raise TimeoutError
        (:data:`LATEST`).
        """
        parts = [part.strip() for part in text.split(",")]
        if not text.strip() or parts[0] in ("STA", "AIR", "ID", "SEL", "CLK"):
            return
        address = parts[_Column.ADDRESS].lower() if len(parts) >= len(_Column) else ""
        if parts[0] != "MSG" or not _ADDRESS.fullmatch(address):
            yield FieldError(
                "line", f"is {text!r:.60}, expected 22 fields such as MSG,3,... with an address"
            )
            return
        now, aged = self._time_of(parts, arrived)
        if len(self._heard) > _MOST:
            self._heard.clear()
        kind = "tisb" if address.startswith("~") else "adsb"
        row = self._heard.setdefault(address, {"type": kind})
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
    row["alt_baro"] = parts[_Column.ALTITUDE] or row.get("alt_baro")
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
            rows = [(str(row["hex"]).strip().lower(), row) for row in document["aircraft"]]
        except RepeatedKeyError as problem:
            yield FieldError("document", f"{problem}, expected every key once")
            return
        except (ValueError, KeyError, TypeError, RecursionError):
            yield FieldError(
                "document",
                f"is {text!r:.60}, expected an aircraft.json with now, aircraft and their hex",
            )
            return
        before, self._now = self._now, now
        self._traffic.counts["repeated document"] += now == before
        if not now > before:
            return
        written = self._time(now, arrived)
        for address, row in rows:
            try:
                if not _ADDRESS.fullmatch(address):
                    raise FieldError("hex", f"is {address!r:.60}, expected six hexadecimal digits")
                age = _first_known(row, "seen_pos")
                if age is not None:
                    age = number(f"adsb {address}.seen_pos", age, 0.0, 1e6, "s")
                time = written - int((age or 0.0) * SECOND)
                yield from self._reports(address, time, row, aged=age is not None)
            except FieldError as error:
                yield error


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
    number(f"{name}.velocity_age", row.get("velocity_age", 0.0), -_APART, _APART, "s")
    speed = number(f"{name}.speed", speed, 0.0, FASTEST / KNOT, "kt") * KNOT
    track = math.radians(number(f"{name}.track", track, -360.0, 360.0, "degrees"))
    return speed * math.sin(track), speed * math.cos(track)


def _sigma(radii: tuple[float, ...], code: Any) -> float | None:
    """Return the standard deviation per axis that a category of accuracy means; None: unknown,
    which category 0 says too.
    """
    known = isinstance(code, int) and 0 < code < len(radii)
    return radii[code] / _TO_SIGMA if known else None
