"""ADS-B reports as JSON, plain or gzipped: a list of objects, one a report.

``icao24`` (upper or lower case), ``timestamp`` (ms), ``latitude`` and ``longitude`` (deg),
``altitude`` (ft), ``groundspeed`` (kt), ``track`` (deg clockwise from north) and ``vertical_rate``
(ft/min); null where a receiver had no value. ``onground`` (or ``on_ground``) is optional; reports
on the ground are left out and counted, unless speed, climb or altitude contradict it. The units are
those of the form and stand nowhere in the file.
"""

import math
import os
from collections import Counter
from collections.abc import Iterator
from typing import Any

from commands.text_file import json_of, text_of
from envs.formats.track_rows import Reading, Rows, flights_of
from envs.traffic.ground import ROLL_MAX, flies
from envs.traffic.track_units import FOOT, KNOT, Range
from envs.traffic.tracks import Repairs, TrackError

_STANDING = 10.0
"""A position that stays the same while the aircraft flies further than this, m, is stale."""

_FIELDS = {
    "time": ("timestamp", Range(0.0, 1e14, 1e-3)),
    "lat": ("latitude", Range(-90.0, 90.0, math.radians(1.0))),
    "lon": ("longitude", Range(-180.0, 180.0, math.radians(1.0))),
    "alt": ("altitude", Range(-5_000.0, 100_000.0, FOOT)),
    "gs": ("groundspeed", Range(0.0, 2_000.0, KNOT)),
    "trk": ("track", Range(0.0, 360.0, math.radians(1.0))),
    "vs": ("vertical_rate", Range(-50_000.0, 50_000.0, FOOT / 60.0)),
}
"""Our names: the form's name, and what is accepted."""

_NAMES = {key: name for key, (name, _) in _FIELDS.items()}
_GROUND = frozenset(("onground", "on_ground", "onGround"))


def is_adsb(path: str | os.PathLike[str]) -> bool:
    """Return whether an ``icao24`` is in a JSON file's first 4096 characters; a TrackError if it
    cannot be read.
    """
    return '"icao24"' in text_of(os.fspath(path), TrackError)[:4096]


def order_flights(
    path: str | os.PathLike[str],
    apart: float,
    *,
    repair: bool = False,
    max_gap: float = 5.0,
    grounded: Counter[str] | None = None,
) -> Iterator[tuple[str, list[Rows], Repairs]]:
    """Yield for each aircraft its address, its flights as ordered reports, and what was repaired
    for it.

    Args:
        apart: reports of an aircraft with more time than this between them are of different
            flights, s.
        repair: drop rows that are incomplete, out of order or impossible, and accept gaps, instead
            of refusing the file.
        max_gap: longest time between two rows of a flight, s.
        grounded: counts the reports that are left out because they are on the ground, by address.

    Raises:
        TrackError: the file cannot be read, or a report is not as expected; the message names file,
            report (counted from 1) and field.
    """
    source = os.fspath(path)
    rows: dict[str, Rows] = {}
    grounded = Counter() if grounded is None else grounded
    for number, name, report in _reports(source):
        where = f"{source} report {number}"
        if _is_grounded(report, where):
            grounded[name] += 1
            continue
        rows.setdefault(name, []).append(
            (number, {key: _value(report, key, where, repair) for key in _FIELDS})
        )
    reading = Reading(source, repair, max_gap, "report", apart, _STANDING, _NAMES, KNOT)
    for name, reports in rows.items():
        yield name, *flights_of(name, reports, reading)


def _reports(source: str) -> Iterator[tuple[int, str, dict[str, Any]]]:
    """Yield the reports: number, address, and the report."""
    reports = json_of(source, TrackError)
    if not isinstance(reports, list):
        raise TrackError(f"{source}: expected a list of reports")
    for number, report in enumerate(reports, start=1):
        where = f"{source} report {number}"
        if not isinstance(report, dict):
            raise TrackError(f"{where}: expected an object")
        name = report.get("icao24")
        if not isinstance(name, str) or not name.strip():
            raise TrackError(f"{where}, field icao24: {repr(name)[:40]}, expected an address")
        yield number, name.strip().lower(), report


def _is_grounded(report: dict[str, Any], where: str) -> bool:
    """Return whether a report is on the ground, as it says and nothing contradicts."""
    if not any(_on_ground(report[key], where) for key in _GROUND & report.keys()):
        return False
    speed, climb, altitude = (
        None if report.get(name) is None else _value(report, key, where, True)
        for key, name in ((key, _NAMES[key]) for key in ("gs", "vs", "alt"))
    )
    return not flies(speed, climb, altitude, fastest=ROLL_MAX)


def _on_ground(value: object, where: str) -> bool:
    word = value.strip().lower() if isinstance(value, str) else value
    if word is None or word == "false":
        return False
    if word == "true" or (isinstance(word, (bool, int, float)) and word in (0, 1)):
        return bool(word)
    raise TrackError(f"{where}, field onground: {repr(value)[:40]}, expected true, false or null")


def _value(report: dict[str, Any], key: str, where: str, repair: bool) -> float:
    """Return a value in SI units; nan where the receiver had none, and for repair where it is out
    of range.
    """
    name, accepted = _FIELDS[key]
    if name not in report:
        raise TrackError(f"{where}, field {name}: missing")
    value = math.nan if report[name] is None else report[name]
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TrackError(f"{where}, field {name}: {repr(value)[:40]}, expected a number or null")
    return accepted.si(value, f"{where}, field {name}", repair=repair)
