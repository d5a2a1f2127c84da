"""The document ``aircraft.json`` of readsb, tar1090 and dump1090."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from commands.json_text import RepeatedKeyError, parse_json
from ros_bridge.core.feeds.rows import ADDRESS, RowTarget, first_known
from ros_bridge.core.feeds.traffic import Stream, nameless
from ros_bridge.core.fields import SECOND, FieldError, attempt, number, place
from ros_bridge.core.reports import Report

__all__ = ["AircraftJson"]

_EARLY = 0.5  # s; a position may be so much newer than its document, whose times are rounded
_MOST_AGE = 1e6  # s


class AircraftJson(Stream):
    """Reads the document ``aircraft.json`` that readsb, tar1090 and dump1090 write every second."""

    _written = math.nan  # when the last document was, s

    def reports_of(self, text: str, arrived: int) -> Iterator[Report | FieldError]:
        """Yield the reports of a document and why aircraft cannot be used; raise TimeoutError as
        :data:`LATEST` says.

        The first document may have been left there long ago, so reports begin with one that is
        later.
        """
        try:
            document = parse_json(text)
            written_s = number("document.now", document["now"], 0.0, 1e12, "s")
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
        previous_s, self._written = self._written, written_s
        if not written_s > previous_s:
            self._traffic.counts["repeated document"] += written_s == previous_s
            return
        written = self._time(written_s, arrived)
        for row in rows:
            if isinstance(row, dict) and "hex" in row:
                yield from self._row_reports(row, written)

    def _row_reports(self, row: Mapping[str, Any], written: int) -> Iterator[Report | FieldError]:
        """Yield the report of a row of a document that was written at a time, ns. An address or an
        age that cannot be read leaves a place that is told.
        """
        address = str(row["hex"]).strip().lower()
        if not ADDRESS.fullmatch(address):
            problem = f"is {address!r:.60}, expected six hexadecimal digits"
            yield _nameless("hex", problem, row, written)
            return
        age = first_known(row, "seen_pos")
        name = f"adsb {address}.seen_pos"
        seconds = attempt(lambda: number(name, age, -_EARLY, _MOST_AGE, "s"))
        if not isinstance(seconds, FieldError):
            time = written - int(max(seconds, 0.0) * SECOND)
            yield from self._reports(RowTarget(address, time, True, row))
            return
        for report in self._reports(RowTarget(address, written, False, row)):
            seconds.sighting = report.sighting
            yield report if age is None else seconds


def _nameless(field: str, problem: str, row: Any, time: int) -> FieldError:
    """Return why a row without an address cannot be used, with its place, if it has one, at a time,
    ns.
    """
    if not isinstance(row, dict):
        return FieldError(field, problem)
    return nameless(field, problem, time, lambda: place("", row.get("lat"), row.get("lon")))
