"""Live ADS-B as reports: BaseStation lines, and the ``aircraft.json`` of readsb, tar1090 and
dump1090.

Nothing here imports ROS or connects. A receiver sees all that flies or taxies around it, also the
ownship. What is no traffic is left out and counted; of unusable messages name and place are kept.
"""

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime
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
_NEW = (
    SECOND * 3 // 20
)  # a position is a new one when it is this much later: times are rounded to 0.1 s
_MOST = 4096  # aircraft that are remembered
_COPY = (
    600.0,
    15.0,
    500 * FOOT,
)  # m, m/s, m: within these of the ownship, a track of TIS-B is a copy of it
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
        reasons = {
            "on the ground": "ground" in (row.get("alt_baro"), row.get("altitude")),
            "own echo": address in (self._own_id, "" if self.own is None else self.own.identifier),
            "without a position": _first_known(row, "lat") is None
            or _first_known(row, "lon") is None,
            "repeated position": time < self._reported.get(address, 0) + _NEW,
        }
        if any(reasons.values()):
            self.counts[next(reason for reason, holds in reasons.items() if holds)] += 1
            return None
        name = f"adsb {address}"

        def when() -> int:
            if not aged:
                what = "is unknown, expected the age of the position"
                raise FieldError(f"{name}.age", what)
            return time

        try:
            found = self._read(address, name, when, row)
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

    def _read(
        self, address: str, name: str, when: Callable[[], int], row: Mapping[str, Any]
    ) -> Report:
        return report(
            address,
            when,
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
        apart = (
            own.off(found.place, found.time),
            math.hypot(found.east - own.east, found.north - own.north),
            abs(a.value - b.value),
        )
        return all(off <= most for off, most in zip(apart, _COPY, strict=True))


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
        address = parts[4].lower() if len(parts) >= 22 else ""
        if parts[0] != "MSG" or not _ADDRESS.fullmatch(address):
            yield FieldError(
                "line", f"is {text!r:.60}, expected 22 fields such as MSG,3,... with an address"
            )
            return
        aged = True
        try:  # the zone is the receiver's and not known
            sent = datetime.strptime(f"{parts[6]} {parts[7]}", "%Y/%m/%d %H:%M:%S.%f").replace(
                tzinfo=UTC
            )
            now = self._time(sent.timestamp(), arrived)
        except ValueError:
            now, aged = arrived, False
        if len(self._heard) > _MOST:
            self._heard.clear()
        row = self._heard.setdefault(
            address, {"type": "tisb" if address.startswith("~") else "adsb"}
        )
        if parts[21] or parts[1] in ("2", "3"):
            row["altitude"] = "ground" if parts[1] == "2" or parts[21] in ("1", "-1") else None
        row["alt_baro"] = parts[11] or row.get("alt_baro")
        if parts[12] and parts[13]:
            row |= {"gs": parts[12], "track": parts[13], "vert_rate": parts[16], "velocity": now}
        if parts[14] and parts[15]:
            age = (now - row.get("velocity", now)) / SECOND
            row |= {"lat": parts[14], "lon": parts[15], "velocity_age": age}
            yield from self._reports(address, now, row, aged=aged)


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
