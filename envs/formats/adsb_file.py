"""ADS-B reports as JSON, plain or gzipped: a list of objects, one a report.

``icao24`` (upper or lower case), ``timestamp`` (ms), ``latitude`` and ``longitude`` (deg), ``altitude`` (ft),
``groundspeed`` (kt), ``track`` (deg clockwise from north) and ``vertical_rate`` (ft/min); null where a receiver had no
value. ``onground`` (or ``on_ground``) is optional; reports on the ground are left out. The units are those of the form
and stand nowhere in the file.
"""

import math
import os
from collections.abc import Iterator, Sequence
from typing import Any

from envs.formats.track_rows import Reading, Rows, flights_of, track_file
from envs.traffic.text_file import json_of, text_of
from envs.traffic.track_units import FOOT, KNOT, Range
from envs.traffic.tracks import Repairs, TrackError, TrackFile

_STANDING = 10.0  # m; a position that stays the same while the aircraft flies further than this is stale

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


def read_adsb(
    path: str | os.PathLike[str],
    aircraft: Sequence[str],
    window: tuple[float, float],
    *,
    repair: bool = False,
    max_gap: float = 5.0,
) -> TrackFile:
    """Read the tracks of some aircraft during some time, local to the first aircraft's first position.

    Args:
        aircraft: ICAO addresses; the first counts as the ownship.
        window: first and last time, s since 1970.
        repair: drop rows that are incomplete, out of order or impossible, and fill gaps, instead of refusing the file.
        max_gap: longest time between two rows of an aircraft, s.

    Raises:
        TrackError: the file cannot be read, an aircraft has no report in the window, or a report is not as expected;
            the message names file, report (counted from 1) and field.
    """
    source = os.fspath(path)
    if not (aircraft and window[0] < window[1] and max_gap > 0.0):
        raise TrackError(f"{source}: expected at least one aircraft, a window that ends after it begins, max_gap > 0")
    rows: dict[str, Rows] = {_address(name): [] for name in aircraft}
    for number, name, report in _airborne(source):
        if name in rows:
            time = _value(report, "time", f"{source} report {number}", repair)
            # A report without a time may belong to the window: it is for the check of the rows.
            if not math.isfinite(time) or window[0] <= time <= window[1]:
                rows[name].append(_row(source, number, report, repair))
    for name, found in rows.items():
        if not found:
            raise TrackError(f"{source}: no airborne report of {name!r} from {window[0]:.0f} to {window[1]:.0f} s")
    return track_file(rows, Reading(source, repair, max_gap, "report", standing=_STANDING, names=_NAMES))


def is_adsb(path: str | os.PathLike[str]) -> bool:
    """Return whether a JSON file begins like one of reports: an ``icao24`` stands in its first 4096 characters.

    Raises:
        TrackError: it cannot be read.
    """
    return '"icao24"' in text_of(os.fspath(path), TrackError)[:4096]


def ordered_flights(
    path: str | os.PathLike[str], apart: float, *, repair: bool = False, max_gap: float = 5.0
) -> Iterator[tuple[str, list[Rows], Repairs]]:
    """Yield for each aircraft its address, its flights as ordered reports, and what it took to order them.

    Args:
        path, repair, max_gap: as of :func:`read_adsb`.
        apart: reports of an aircraft with more time than this between them are of different flights, s.

    Raises:
        TrackError: as of :func:`read_adsb`.
    """
    source = os.fspath(path)
    rows: dict[str, Rows] = {}
    for number, name, report in _airborne(source):
        rows.setdefault(name, []).append(_row(source, number, report, repair))
    how = Reading(source, repair, max_gap, "report", apart, _STANDING, _NAMES)
    for name, found in rows.items():
        yield name, *flights_of(name, found, how)


def _airborne(source: str) -> Iterator[tuple[int, str, dict[str, Any]]]:
    """Yield the reports that are not on the ground: number, address, and the report."""
    found = json_of(source, TrackError)
    if not isinstance(found, list):
        raise TrackError(f"{source}: expected a list of reports")
    for number, report in enumerate(found, start=1):
        where = f"{source} report {number}"
        if not isinstance(report, dict):
            raise TrackError(f"{where}: expected an object")
        name = report.get("icao24")
        if not isinstance(name, str) or not name.strip():
            raise TrackError(f"{where}, field icao24: {repr(name)[:40]}, expected an address")
        if not any(_on_ground(report[key], where) for key in _GROUND & report.keys()):
            yield number, _address(name), report


def _address(name: str) -> str:
    return name.strip().lower()


def _on_ground(value: Any, where: str) -> bool:
    word = value.strip().lower() if isinstance(value, str) else value
    if word is None or word == "false":
        return False
    if word == "true" or (isinstance(word, (bool, int, float)) and word in (0, 1)):
        return bool(word)
    raise TrackError(f"{where}, field onground: {repr(value)[:40]}, expected true, false or null")


def _row(source: str, number: int, report: dict[str, Any], repair: bool) -> tuple[int, dict[str, float]]:
    where = f"{source} report {number}"
    return number, {key: _value(report, key, where, repair) for key in _FIELDS}


def _value(report: dict[str, Any], key: str, where: str, repair: bool) -> float:
    """Return a value in SI units; nan where the receiver had none, and for repair where it is out of range."""
    name, accepted = _FIELDS[key]
    if name not in report:
        raise TrackError(f"{where}, field {name}: missing")
    value = math.nan if report[name] is None else report[name]
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TrackError(f"{where}, field {name}: {repr(value)[:40]}, expected a number or null")
    return accepted.si(value, f"{where}, field {name}", repair=repair)
