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
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from envs.local_frame import local
from envs.track_units import FOOT, KNOT
from envs.tracks import Rows, Track, TrackError, TrackFile, ordered, summed

__all__ = ["read_adsb"]

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
        time = _value(report, "time", where)
        # A report without a time may belong to the window: it is for the check of the rows.
        if not math.isfinite(time) or window[0] <= time <= window[1]:
            rows[name].append((number, {key: _value(report, key, where) for key in _FIELDS}))
    for name, found in rows.items():
        if not found:
            raise TrackError(f"{source}: no report of {name!r} from {window[0]:.0f} to {window[1]:.0f} s")
    kept = {name: ordered(source, name, found, repair, max_gap, "report") for name, found in rows.items()}
    first = kept[aircraft[0]][0][0][1]
    reference = first["lat"], first["lon"]
    tracks = tuple(_track(name, found, reference) for name, (found, _) in kept.items())
    return TrackFile(tracks, summed([repairs for _, repairs in kept.values()]))


def _track(name: str, rows: Rows, reference: tuple[float, float]) -> Track:
    columns = {key: np.array([values[key] for _, values in rows]) for key in _FIELDS}
    x, y = local(columns["lat"], columns["lon"], reference)
    speed, track = columns["gs"], columns["trk"]
    vx, vy = speed * np.sin(track), speed * np.cos(track)
    return Track(name, columns["time"], x, y, columns["alt"], vx, vy, columns["vs"], {})


def _value(report: dict[str, Any], key: str, where: str) -> float:
    """Return a value in SI units; nan where the receiver had none."""
    name, scale, low, high = _FIELDS[key]
    if name not in report:
        raise TrackError(f"{where}, field {name}: missing")
    value = report[name]
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TrackError(f"{where}, field {name}: {value!r}, expected a number or null")
    if value == value and not low <= value <= high:  # noqa: PLR0124  nan is for the check of the rows
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
