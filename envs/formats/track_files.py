"""Recorded tracks in the files of NASA's DAIDALUS.

A ``.daa`` or ``.xyz`` file is a text: comments begin with ``#``; a line of column names; a line of units in brackets,
which differ from file to file and are honoured; then a row an aircraft and time, the ownship's first. Cells are
separated by commas or blanks. A file without units, or with one that is unknown, is refused.
"""

import math
import os
import re

import numpy as np

from envs.formats.local_frame import local
from envs.traffic.text_file import lines_of
from envs.traffic.track_units import FAMILIES, si
from envs.traffic.tracks import Repairs, Rows, Track, TrackError, TrackFile, ordered, summed

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

_NEEDED = ("name", "alt", "vs", "time")
_CHOICES = ((("lat", "lon"), ("sx", "sy")), (("trk", "gs"), ("vx", "vy")))


def read_daidalus(path: str | os.PathLike[str], *, repair: bool = False, max_gap: float = 5.0) -> TrackFile:
    """Read a ``.daa`` or ``.xyz`` file.

    Geographic positions become local ones around the ownship's first.

    Args:
        path: of the file.
        repair: drop rows that are not finite or out of order, and fill gaps, instead of refusing the file.
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
            values[key] = _number(cell, f"{where}, field {key}") * scale
        if not name:
            raise TrackError(f"{where}, field name: empty, expected the name of an aircraft")
        rows.setdefault(name, []).append((number, values))
    reference = _reference(source, next(iter(rows.values())))
    made = [_track(source, name, each, reference, (repair, max_gap)) for name, each in rows.items()]
    return TrackFile(tuple(track for track, _ in made), summed([found for _, found in made]))


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


def _number(cell: str, where: str) -> float:
    """Return a number, which may be none of the finite ones: those are dealt with row by row."""
    try:
        if "_" in cell:
            raise ValueError
        return float(cell)
    except ValueError:
        raise TrackError(f"{where}: {cell!r}, expected a number") from None


def _reference(source: str, rows: Rows) -> tuple[float, float] | None:
    """Return the ownship's first geographic position, None where positions are local already."""
    if "lat" not in rows[0][1]:
        return None
    for number, values in rows:
        where = values["lat"], values["lon"]
        if all(map(math.isfinite, where)):
            if abs(where[0]) > 0.5 * math.pi or abs(where[1]) > 2.0 * math.pi:
                raise TrackError(
                    f"{source} line {number}, field lat or lon: {math.degrees(where[0]):g}, {math.degrees(where[1]):g} "
                    "degrees, expected a place on the Earth"
                )
            return where
    raise TrackError(f"{source}: the ownship has no finite position")


def _track(
    source: str, name: str, rows: Rows, reference: tuple[float, float] | None, how: tuple[bool, float]
) -> tuple[Track, Repairs]:
    """Return the track of an aircraft's rows."""
    rows, repairs = ordered(source, name, rows, *how)
    columns = {key: np.array([values[key] for _, values in rows]) for key in rows[0][1]}
    if reference is None:
        x, y = columns.pop("sx"), columns.pop("sy")
    else:
        x, y = local(columns.pop("lat"), columns.pop("lon"), reference)
    if "gs" in columns:
        track, speed = columns.pop("trk"), columns.pop("gs")
        vx, vy = speed * np.sin(track), speed * np.cos(track)
    else:
        vx, vy = columns.pop("vx"), columns.pop("vy")
    time, altitude, rate = (columns.pop(key) for key in ("time", "alt", "vs"))
    return Track(name, time, x, y, altitude, vx, vy, rate, columns), repairs
