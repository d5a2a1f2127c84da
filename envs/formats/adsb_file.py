"""ADS-B reports as JSON, plain or gzipped: a list of objects, one a report.

``icao24``, ``timestamp`` (ms), ``latitude`` and ``longitude`` (deg), ``altitude`` (ft), ``groundspeed`` (kt), ``track``
(deg clockwise from north) and ``vertical_rate`` (ft/min); null where a receiver had no value. The units are those of
the form and stand nowhere in the file.
"""

import gzip
import json
import math
import os
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from envs.formats.local_frame import local
from envs.traffic.track_units import FOOT, KNOT
from envs.traffic.tracks import Repairs, Rows, Track, TrackError, TrackFile, ordered, summed

__all__ = ["is_adsb", "ordered_flights", "read_adsb", "track_of"]

_STANDING = 10.0
"""m; a position that has not changed over more than this is stale."""

_FIELDS: dict[str, tuple[str, float, float, float]] = {
    "time": ("timestamp", 1e-3, 0.0, 1e14),
    "lat": ("latitude", math.radians(1.0), -90.0, 90.0),
    "lon": ("longitude", math.radians(1.0), -180.0, 180.0),
    "alt": ("altitude", FOOT, -5_000.0, 100_000.0),
    "gs": ("groundspeed", KNOT, 0.0, 2_000.0),
    "trk": ("track", math.radians(1.0), 0.0, 360.0),
    "vs": ("vertical_rate", FOOT / 60.0, -50_000.0, 50_000.0),
}
"""Our names: the form's name, SI value of one unit, and the range that is believed, in that unit."""


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
        aircraft: ICAO addresses, as the file writes them; the first counts as the ownship.
        window: first and last time, s since 1970.
        repair: drop rows without a value or out of order, and fill gaps, instead of refusing the file.
        max_gap: longest time between two rows of an aircraft, s.

    Raises:
        TrackError: the file cannot be read, an aircraft has no report in the window, or a report is not as expected;
            the message names file, report (counted from 1) and field.
    """
    source = os.fspath(path)
    if not (aircraft and window[0] < window[1] and max_gap > 0.0):
        raise TrackError(f"{source}: expected at least one aircraft, a window that ends after it begins, max_gap > 0")
    rows: dict[str, Rows] = {name: [] for name in aircraft}
    for number, report in enumerate(_reports(source), start=1):
        if not isinstance(report, dict):
            raise TrackError(f"{source} report {number}: expected an object")
        name = report.get("icao24")
        if name not in rows:
            continue
        where = f"{source} report {number}"
        time = _value(report, "time", where, repair)
        # A report without a time may belong to the window: it is for the check of the rows.
        if not math.isfinite(time) or window[0] <= time <= window[1]:
            rows[name].append((number, {key: _value(report, key, where, repair) for key in _FIELDS}))
    for name, found in rows.items():
        if not found:
            raise TrackError(f"{source}: no report of {name!r} from {window[0]:.0f} to {window[1]:.0f} s")
    kept = {name: ordered(source, name, found, repair, max_gap, "report") for name, found in rows.items()}
    first = kept[aircraft[0]][0][0][1]
    reference = first["lat"], first["lon"]
    tracks = tuple(track_of(name, found, reference) for name, (found, _) in kept.items())
    return TrackFile(tracks, summed([repairs for _, repairs in kept.values()]))


def is_adsb(path: str | os.PathLike[str]) -> bool:
    """Return whether a JSON file begins like one of reports: its first object has an ``icao24``.

    Raises:
        TrackError: it cannot be read.
    """
    found = _reports(os.fspath(path))
    return bool(found) and isinstance(found[0], dict) and "icao24" in found[0]


def ordered_flights(
    path: str | os.PathLike[str], apart: float, *, repair: bool = False, max_gap: float = 5.0
) -> Iterator[tuple[str, Rows, Repairs]]:
    """Yield the flights of all aircraft: address, ordered reports, and what it took to order them.

    Args:
        path: of the file.
        apart: one report of an aircraft and the next in the file with more time than this between them, to either side,
            are of different flights, s.
        repair: drop reports without a value or out of order, and fill gaps, instead of refusing the file.
        max_gap: longest time between two reports of a flight, s.

    Raises:
        TrackError: as of :func:`read_adsb`.
    """
    source = os.fspath(path)
    flights: dict[str, list[Rows]] = {}
    for number, report in enumerate(_reports(source), start=1):
        where = f"{source} report {number}"
        if not isinstance(report, dict):
            raise TrackError(f"{where}: expected an object")
        name = report.get("icao24")
        if not isinstance(name, str) or not name:
            raise TrackError(f"{where}, field icao24: {name!r}, expected an address")
        if report.get("onground") is True:
            continue
        values = {key: _value(report, key, where, repair) for key in _FIELDS}
        parts = flights.setdefault(name, [[]])
        if parts[-1] and abs(values["time"] - parts[-1][-1][1]["time"]) > apart:
            parts.append([])
        parts[-1].append((number, values))
    for name, parts in flights.items():
        for rows in parts:
            # A flight of reports without a value is no flight; without repairs it is refused.
            if repair and not any(_whole(values) for _, values in rows):
                yield name, [], Repairs(not_finite=len(rows))
                continue
            fresh = _fresh(source, rows, repair)
            kept, repairs = ordered(source, name, fresh, repair, max_gap, "report")
            yield name, kept, repairs._replace(stale=len(rows) - len(fresh))


def _whole(values: dict[str, float]) -> bool:
    return all(map(math.isfinite, values.values()))


def _fresh(source: str, rows: Rows, repair: bool) -> Rows:
    """Return the reports without those that only repeat a position, as receivers do when they have heard no other."""
    kept: Rows = []
    for number, values in rows:
        if kept:
            before = kept[-1][1]
            moved = values["gs"] * (values["time"] - before["time"])
            if (values["lat"], values["lon"]) == (before["lat"], before["lon"]) and moved > _STANDING:
                if not repair:
                    raise TrackError(
                        f"{source} report {number}, field latitude: the position of {values['time']:.15g} s is that of "
                        f"{before['time']:.15g} s at {values['gs']:.0f} m/s, expected another"
                    )
                continue
        kept.append((number, values))
    return kept


def track_of(name: str, rows: Rows, reference: tuple[float, float]) -> Track:
    """Return the track of ordered reports, local to a latitude and longitude, rad."""
    columns = {key: np.array([values[key] for _, values in rows]) for key in _FIELDS}
    x, y = local(columns["lat"], columns["lon"], reference)
    speed, track = columns["gs"], columns["trk"]
    vx, vy = speed * np.sin(track), speed * np.cos(track)
    return Track(name, columns["time"], x, y, columns["alt"], vx, vy, columns["vs"], {})


def _value(report: dict[str, Any], key: str, where: str, repair: bool) -> float:
    """Return a value in SI units; nan where the receiver had none, and for repair where it is beyond belief."""
    name, scale, low, high = _FIELDS[key]
    if name not in report:
        raise TrackError(f"{where}, field {name}: missing")
    value = report[name]
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TrackError(f"{where}, field {name}: {value!r}, expected a number or null")
    if value == value and not low <= value <= high:  # noqa: PLR0124  nan is for the check of the rows
        if repair:
            return math.nan
        raise TrackError(f"{where}, field {name}: {repr(value)[:40]}, expected {low:g} to {high:g}")
    return float(value) * scale


def _reports(source: str) -> list[Any]:
    try:
        data = Path(source).read_bytes()
        text = gzip.decompress(data) if data[:2] == b"\x1f\x8b" else data
        found = json.loads(text)
    except FileNotFoundError:
        raise TrackError(f"{source}: there is no such file") from None
    except (EOFError, zlib.error, OSError) as problem:
        raise TrackError(f"{source}: cannot be read, or cut off: {problem}") from None
    except UnicodeDecodeError as problem:
        raise TrackError(f"{source}: not a text in UTF-8 (byte {problem.start})") from None
    except json.JSONDecodeError as problem:
        raise TrackError(f"{source} line {problem.lineno}: not JSON, or cut off: {problem.msg}") from None
    except (ValueError, RecursionError) as problem:
        raise TrackError(f"{source}: not usable as JSON: {problem}") from None
    if not isinstance(found, list):
        raise TrackError(f"{source}: expected a list of reports")
    return found
