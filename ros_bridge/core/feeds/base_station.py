"""Lines of BaseStation's output, as dump1090 and readsb send them on port 30003."""

from collections.abc import Iterator
from datetime import UTC, datetime
from enum import IntEnum
from typing import Any

from ros_bridge.core.feeds.rows import ADDRESS, APART, RowTarget
from ros_bridge.core.feeds.traffic import Stream, Traffic, remember
from ros_bridge.core.fields import SECOND, FieldError
from ros_bridge.core.reports import Report

__all__ = ["BaseStation"]


class BaseStation(Stream):
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
        if parts[0] not in ("MSG", "MLAT") or not ADDRESS.fullmatch(address):
            yield FieldError(
                "line", f"is {text!r:.60}, expected 22 fields such as MSG,3,... with an address"
            )
            return
        time, aged = self._time_of(parts, arrived)
        row = remember(self._heard, address, self._heard.get(address, {}))
        radar = address.startswith("~") and parts[0] == "MSG"
        row["type"] = "tisb" if radar else parts[0].lower()
        _take_columns(row, parts, time)
        if parts[_Column.LATITUDE] and parts[_Column.LONGITUDE]:
            row["lat"], row["lon"] = parts[_Column.LATITUDE], parts[_Column.LONGITUDE]
            row["velocity_age"] = (time - row.get("velocity", time)) / SECOND
            yield from self._reports(RowTarget(address, time, aged, row))

    def _time_of(self, parts: list[str], arrived: int) -> tuple[int, bool]:
        """Return when a line held, ns, and whether that is known; if not, when it arrived."""
        text = f"{parts[_Column.DATE]} {parts[_Column.TIME]}"
        try:
            moment = datetime.strptime(text, "%Y/%m/%d %H:%M:%S.%f")
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


def _take_columns(row: dict[str, Any], parts: list[str], time: int) -> None:
    """Take a line of a time, ns, into what is known of its aircraft, but for its position."""
    kind, on_ground = parts[_Column.KIND], parts[_Column.ON_GROUND]
    if on_ground or kind in (_SURFACE, _AIRBORNE):
        row["altitude"] = "ground" if kind == _SURFACE or on_ground in ("1", "-1") else None
    is_old = abs(time - row.get("altitude_time", time)) > APART * SECOND
    if parts[_Column.ALTITUDE]:
        row["alt_baro"], row["altitude_time"] = parts[_Column.ALTITUDE], time
    elif is_old or row.get("altitude") == "ground":
        row["alt_baro"] = None
    row["flight"] = parts[_Column.CALLSIGN] or row.get("flight")
    if parts[_Column.SPEED] and parts[_Column.TRACK]:
        row["gs"], row["track"] = parts[_Column.SPEED], parts[_Column.TRACK]
        row["vert_rate"], row["velocity"] = parts[_Column.VERTICAL_RATE], time
