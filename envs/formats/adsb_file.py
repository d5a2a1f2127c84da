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

import numpy as np

from envs.formats.consistency import check_distances
from envs.formats.local_frame import local
from envs.formats.track_rows import Reading, Rows, flights_of, track_rows
from envs.traffic.text_file import json_of, text_of
from envs.traffic.track_units import FOOT, KNOT
from envs.traffic.tracks import Repairs, Track, TrackError, TrackFile, summed

__all__ = ["is_adsb", "ordered_flights", "read_adsb", "track_of"]

_STANDING = 10.0
"""m; a position that stays the same while the aircraft flies further than this is stale."""

_FIELDS: dict[str, tuple[str, float, float, float]] = {
    "time": ("timestamp", 1e-3, 0.0, 1e14),
    "lat": ("latitude", math.radians(1.0), -90.0, 90.0),
    "lon": ("longitude", math.radians(1.0), -180.0, 180.0),
    "alt": ("altitude", FOOT, -5_000.0, 100_000.0),
    "gs": ("groundspeed", KNOT, 0.0, 2_000.0),
    "trk": ("track", math.radians(1.0), 0.0, 360.0),
    "vs": ("vertical_rate", FOOT / 60.0, -50_000.0, 50_000.0),
}
"""Our names: the form's name, SI value of one unit, and the range that is accepted, in that unit."""

_GROUND = frozenset(("onground", "on_ground", "onGround"))

_NAMES = {key: name for key, (name, *_) in _FIELDS.items()}


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
        path: of the file.
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
        if name not in rows:
            continue
        where = f"{source} report {number}"
        time = _value(report, "time", where, repair)
        # A report without a time may belong to the window: it is for the check of the rows.
        if not math.isfinite(time) or window[0] <= time <= window[1]:
            rows[name].append((number, {key: _value(report, key, where, repair) for key in _FIELDS}))
    for name, found in rows.items():
        if not found:
            raise TrackError(f"{source}: no airborne report of {name!r} from {window[0]:.0f} to {window[1]:.0f} s")
    how = Reading(source, repair, max_gap, "report", standing=_STANDING, names=_NAMES)
    kept = {name: track_rows(name, found, how) for name, found in rows.items()}
    first = next(iter(kept.values()))[0][0][1]
    reference = first["lat"], first["lon"]
    tracks = tuple(track_of(name, found, reference) for name, (found, _) in kept.items())
    check_distances(source, tracks)
    return TrackFile(tracks, summed([repairs for _, repairs in kept.values()]))


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
        path: of the file.
        apart: reports of an aircraft with more time than this between them are of different flights, s.
        repair: drop reports that are incomplete, out of order or impossible, and fill gaps, instead of refusing the
            file.
        max_gap: longest time between two reports of a flight, s.

    Raises:
        TrackError: as of :func:`read_adsb`.
    """
    source = os.fspath(path)
    rows: dict[str, Rows] = {}
    for number, name, report in _airborne(source):
        where = f"{source} report {number}"
        rows.setdefault(name, []).append((number, {key: _value(report, key, where, repair) for key in _FIELDS}))
    how = Reading(source, repair, max_gap, "report", apart, _STANDING, _NAMES)
    for name, found in rows.items():
        yield name, *flights_of(name, found, how)


def track_of(name: str, rows: Rows, reference: tuple[float, float]) -> Track:
    """Return the track of ordered reports, local to a latitude and longitude, rad."""
    columns = {key: np.array([values[key] for _, values in rows]) for key in _FIELDS}
    place = local(columns["lat"], columns["lon"], reference)
    speed, track = columns["gs"], columns["trk"]
    vx, vy = place.velocity(speed * np.sin(track), speed * np.cos(track))
    return Track(name, columns["time"], place.x, place.y, columns["alt"], vx, vy, columns["vs"], {})


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


def _value(report: dict[str, Any], key: str, where: str, repair: bool) -> float:
    """Return a value in SI units; nan where the receiver had none, and for repair where it is out of range."""
    name, scale, low, high = _FIELDS[key]
    if name not in report:
        raise TrackError(f"{where}, field {name}: missing")
    value = report[name]
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TrackError(f"{where}, field {name}: {repr(value)[:40]}, expected a number or null")
    if value == value and not low <= value <= high:  # noqa: PLR0124  nan is for the check of the rows
        if repair:
            return math.nan
        raise TrackError(f"{where}, field {name}: {repr(value)[:40]}, expected {low:g} to {high:g}")
    return float(value) * scale
