"""Recorded tracks in the files of NASA's DAIDALUS.

A ``.daa`` or ``.xyz`` file is a text: comments begin with ``#``; a line of column names; a line of units in brackets,
which differ from file to file and are honoured; then a row an aircraft and time, the ownship's first. Cells are
separated by commas or blanks. A file without units, or with one that is unknown, is refused.
"""

import math
import os
import re

import numpy as np

from envs.formats.consistency import check_distances
from envs.formats.local_frame import local
from envs.formats.track_rows import Reading, Rows, track_rows
from envs.traffic.text_file import lines_of
from envs.traffic.track_units import FAMILIES, FOOT, KNOT, si
from envs.traffic.tracks import DISTANT, Track, TrackError, TrackFile, summed

__all__ = ["read_daidalus"]

_COLUMNS: dict[str, tuple[str, str]] = {
    **dict.fromkeys(("name", "aircraft", "id"), ("name", "none")),
    **dict.fromkeys(("lat", "latitude"), ("lat", "angle")),
    **dict.fromkeys(("lon", "long", "longitude"), ("lon", "angle")),
    **dict.fromkeys(("sx", "x"), ("sx", "length")),
    **dict.fromkeys(("sy", "y"), ("sy", "length")),
    **dict.fromkeys(("alt", "altitude", "sz", "z"), ("alt", "length")),
    **dict.fromkeys(("trk", "track"), ("trk", "angle")),
    **dict.fromkeys(("gs", "groundspeed", "gspeed"), ("gs", "speed")),
    **dict.fromkeys(("vs", "verticalspeed", "vz"), ("vs", "speed")),
    "vx": ("vx", "speed"),
    "vy": ("vy", "speed"),
    **dict.fromkeys(("time", "tm", "clock", "st"), ("time", "time")),
    "heading": ("heading", "angle"),
    "airspeed": ("airspeed", "speed"),
    "alerter": ("alerter", "none"),
    **{f"s_{axis}_std": (f"s_{axis}_std", "length") for axis in ("ew", "ns", "en")},
    "sz_std": ("sz_std", "length"),
    **{f"v_{axis}_std": (f"v_{axis}_std", "speed") for axis in ("ew", "ns", "en")},
    "vz_std": ("vz_std", "speed"),
}
"""Names of columns, in lower case, with the name that we use and what they measure."""

_RANGES: dict[str, tuple[float, float]] = {
    "lat": (-0.5 * math.pi, 0.5 * math.pi),
    "alt": (-5_000.0 * FOOT, 100_000.0 * FOOT),
    "gs": (0.0, 2_000.0 * KNOT),
    "airspeed": (0.0, 2_000.0 * KNOT),
    "vs": (-50_000.0 * FOOT / 60.0, 50_000.0 * FOOT / 60.0),
    "time": (-1e11, 1e11),
    **dict.fromkeys(("sx", "sy"), (-DISTANT, DISTANT)),
    **dict.fromkeys(("lon", "trk", "heading"), (-2.0 * math.pi, 2.0 * math.pi)),
    **dict.fromkeys(("vx", "vy"), (-2_000.0 * KNOT, 2_000.0 * KNOT)),
}
"""What is accepted, in SI units and radians; of other columns 0 to 1e6."""

_NEEDED = ("name", "alt", "vs", "time")
_CHOICES = ((("lat", "lon"), ("sx", "sy")), (("trk", "gs"), ("vx", "vy")))


def read_daidalus(path: str | os.PathLike[str], *, repair: bool = False, max_gap: float = 5.0) -> TrackFile:
    """Read a ``.daa`` or ``.xyz`` file.

    Geographic positions become local ones around the ownship's first.

    Args:
        path: of the file.
        repair: drop rows that are not finite, out of range, out of order or impossible, and fill gaps, instead of
            refusing the file.
        max_gap: longest time between two rows of an aircraft, s.

    Raises:
        TrackError: the file cannot be read, a unit is missing or unknown, or a row is not as expected; the message
            names file, line and field.
    """
    source = os.fspath(path)
    if not max_gap > 0.0:
        raise TrackError(f"{source}: max_gap is {max_gap:g} s, expected a positive number")
    lines = _lines(source)
    if len(lines) < 3:
        raise TrackError(f"{source}: {len(lines)} lines, expected column names, units and at least one row")
    fields = _header(source, lines[0], lines[1])
    rows: dict[str, Rows] = {}
    for number, cells in lines[2:]:
        where = f"{source} line {number}"
        if len(cells) != len(fields):
            raise TrackError(f"{where}: {len(cells)} fields, expected {len(fields)} as in the line of names")
        values, name = {}, ""
        for (key, scale), cell in zip(fields, cells, strict=True):
            if key == "name":
                name = cell
                continue
            values[key] = _number(cell, key, scale, f"{where}, field {key}", repair)
        if not name:
            raise TrackError(f"{where}, field name: empty, expected the name of an aircraft")
        rows.setdefault(name, []).append((number, values))
    if len({name.casefold() for name in rows}) < len(rows):
        raise TrackError(f"{source}, field name: {sorted(rows)[:8]}, expected no two that differ only in case")
    how = Reading(source, repair, max_gap)
    made = {name: track_rows(name, each, how) for name, each in rows.items()}
    first = next(iter(made.values()))[0][0][1]
    reference = (first["lat"], first["lon"]) if "lat" in first else None
    tracks = tuple(_track(name, each, reference) for name, (each, _) in made.items())
    check_distances(source, tracks)
    return TrackFile(tracks, summed([repairs for _, repairs in made.values()]))


def _lines(source: str) -> list[tuple[int, list[str]]]:
    """Return the lines that hold something, split into cells, with their numbers from 1."""
    lines = []
    for number, line in enumerate(lines_of(source, TrackError), start=1):
        line = line.split("#", 1)[0].strip()  # noqa: PLW2901
        if line:
            cells = line.split(",") if "," in line else re.split(r"\s+", line)
            lines.append((number, [cell.strip() for cell in cells]))
    return lines


def _header(source: str, names: tuple[int, list[str]], units: tuple[int, list[str]]) -> list[tuple[str, float]]:
    """Return our name and the SI value of one unit of each column."""
    where, fields = f"{source} line {names[0]}", []
    if len(units[1]) != len(names[1]):
        raise TrackError(
            f"{source} line {units[0]}: {len(units[1])} units, expected {len(names[1])}, one in brackets for each name"
        )
    for name, unit in zip(names[1], units[1], strict=True):
        known = _COLUMNS.get(name.lower())
        if known is None:
            raise TrackError(f"{where}: column {name!r} is unknown, expected some of {', '.join(_COLUMNS)}")
        key, family = known
        bare = unit[1:-1] if unit.startswith("[") and unit.endswith("]") else unit
        scale = si(bare, family)
        if scale is None or (bare == unit and bare.lower() != "unitless"):
            raise TrackError(
                f"{source} line {units[0]}, field {key}: unit {unit!r}, expected one in brackets of {_known(family)}"
            )
        fields.append((key, scale))
    keys = [key for key, _ in fields]
    for key in keys:
        if keys.count(key) > 1:
            raise TrackError(f"{where}: column {key} stands twice")
    for key in _NEEDED:
        if key not in keys:
            raise TrackError(f"{where}: column {key} is missing")
    for pairs in _CHOICES:
        if sum(all(key in keys for key in pair) for pair in pairs) != 1:
            wanted = " or ".join(" and ".join(pair) for pair in pairs)
            raise TrackError(f"{where}: expected the columns {wanted}, one pair of them")
    return fields


def _known(family: str) -> str:
    return ", ".join(FAMILIES[family])


def _number(cell: str, key: str, scale: float, where: str, repair: bool) -> float:
    """Return a number in SI units; it may be not finite: those are for the check of the rows."""
    try:
        if "_" in cell:
            raise ValueError
        value = float(cell)
    except ValueError:
        raise TrackError(f"{where}: {cell[:40]!r}, expected a number") from None
    low, high = _RANGES.get(key, (0.0, 1e6))
    if math.isfinite(value) and not low <= value * scale <= high:
        if repair:
            return math.nan
        hint = " (are these degrees?)" if _COLUMNS[key][1] == "angle" and scale == 1.0 else ""
        raise TrackError(f"{where}: {cell[:40]}, expected {low / scale:.6g} to {high / scale:.6g}{hint}")
    return value * scale


def _track(name: str, rows: Rows, reference: tuple[float, float] | None) -> Track:
    """Return the track of an aircraft's ordered rows, local to a latitude and longitude if they have such."""
    columns = {key: np.array([values[key] for _, values in rows]) for key in rows[0][1]}
    if "gs" in columns:
        track, speed = columns.pop("trk"), columns.pop("gs")
        vx, vy = speed * np.sin(track), speed * np.cos(track)
    else:
        vx, vy = columns.pop("vx"), columns.pop("vy")
    if reference is None:
        x, y = columns.pop("sx"), columns.pop("sy")
    else:
        place = local(columns.pop("lat"), columns.pop("lon"), reference)
        x, y = place.x, place.y
        vx, vy = place.velocity(vx, vy)
    time, altitude, rate = (columns.pop(key) for key in ("time", "alt", "vs"))
    return Track(name, time, x, y, altitude, vx, vy, rate, columns)
