"""Recorded tracks in the files of NASA's DAIDALUS.

A ``.daa`` or ``.xyz`` file is a text: comments begin with ``#``; a line of column names; a line of
units in brackets, which differ from file to file and are honoured; then a row an aircraft and time,
the ownship's first. Cells are separated by commas or blanks. A file without units, or with one that
is unknown, is refused.
"""

import math
import os
import re
from typing import NamedTuple

from commands.text_file import lines_of, number_of
from envs.formats.track_rows import Reading, Rows, track_file
from envs.traffic.track_units import DEGREES, FAMILIES, FOOT, KNOT, Range, si
from envs.traffic.tracks import DISTANT, TrackError, TrackFile


class _Column(NamedTuple):
    """What we call a column and what it measures; the range that is accepted is in SI units and
    radians.
    """

    key: str
    family: str
    low: float = 0.0
    high: float = 1e6


_TURN, _FAST, _CLIMB = 2.0 * math.pi, 2_000.0 * KNOT, 50_000.0 * FOOT / 60.0
_COLUMNS = {
    name: column
    for names, column in (
        ("name aircraft id", _Column("name", "none")),
        ("lat latitude", _Column("lat", "angle", -0.5 * math.pi, 0.5 * math.pi)),
        ("lon long longitude", _Column("lon", "angle", -_TURN, _TURN)),
        ("sx x", _Column("sx", "length", -DISTANT, DISTANT)),
        ("sy y", _Column("sy", "length", -DISTANT, DISTANT)),
        ("alt altitude sz z", _Column("alt", "length", -5_000.0 * FOOT, 100_000.0 * FOOT)),
        ("trk track", _Column("trk", "angle", -_TURN, _TURN)),
        ("gs groundspeed gspeed", _Column("gs", "speed", 0.0, _FAST)),
        ("vs verticalspeed vz", _Column("vs", "speed", -_CLIMB, _CLIMB)),
        ("vx", _Column("vx", "speed", -_FAST, _FAST)),
        ("vy", _Column("vy", "speed", -_FAST, _FAST)),
        ("time tm clock st", _Column("time", "time", -1e11, 1e11)),
        ("heading", _Column("heading", "angle", -_TURN, _TURN)),
        ("airspeed", _Column("airspeed", "speed", 0.0, _FAST)),
        ("alerter", _Column("alerter", "none")),
    )
    for name in names.split()
}
"""By the names of the files, in lower case."""
for _letter, _family in (("s", "length"), ("v", "speed")):
    for _axis in ("_ew", "_ns", "_en", "z"):
        _COLUMNS[f"{_letter}{_axis}_std"] = _Column(f"{_letter}{_axis}_std", _family)

_NEEDED = ("name", "alt", "vs", "time")
_CHOICES = ((("lat", "lon"), ("sx", "sy")), (("trk", "gs"), ("vx", "vy")))


def read_daidalus(
    path: str | os.PathLike[str], *, repair: bool = False, max_gap: float = 5.0
) -> TrackFile:
    """Read a ``.daa`` or ``.xyz`` file.

    Geographic positions become local ones around the ownship's first.

    Args:
        repair: drop rows that are not finite, out of range, out of order or impossible, and accept
            gaps, instead of refusing the file.
        max_gap: longest time between two rows of an aircraft, s.

    Raises:
        TrackError: the file cannot be read, a unit is missing or unknown, or a row is not as
            expected; the message names file, line and field.
    """
    source = os.fspath(path)
    if not max_gap > 0.0:
        raise TrackError(f"{source}: max_gap is {max_gap:g} s, expected a positive number")
    lines = _lines(source)
    if len(lines) < 3:
        raise TrackError(
            f"{source}: {len(lines)} lines, expected column names, units and at least one row"
        )
    fields = _header(source, lines[0], lines[1])
    rows: dict[str, Rows] = {}
    for number, cells in lines[2:]:
        where = f"{source} line {number}"
        if len(cells) != len(fields):
            raise TrackError(
                f"{where}: {len(cells)} fields, expected {len(fields)} as in the line of names"
            )
        row = dict(zip(fields, cells, strict=True))
        name = row.pop("name")
        values = {
            key: _number(cell, fields[key], f"{where}, field {key}", repair)
            for key, cell in row.items()
        }
        if not name:
            raise TrackError(f"{where}, field name: empty, expected the name of an aircraft")
        rows.setdefault(name, []).append((number, values))
    if len({name.casefold() for name in rows}) < len(rows):
        raise TrackError(
            f"{source}, field name: {sorted(rows)[:8]}, expected no two that differ only in case"
        )
    speed = fields["gs" if "gs" in fields else "vx"].scale
    return track_file(rows, Reading(source, repair, max_gap, speed_unit=speed))


def _lines(source: str) -> list[tuple[int, list[str]]]:
    lines = []
    for number, line in enumerate(lines_of(source, TrackError), start=1):
        line = line.split("#", 1)[0].strip()  # noqa: PLW2901
        if line:
            cells = line.split(",") if "," in line else re.split(r"\s+", line)
            lines.append((number, [cell.strip() for cell in cells]))
    return lines


def _header(
    source: str, names: tuple[int, list[str]], units: tuple[int, list[str]]
) -> dict[str, Range]:
    """Return the columns in the order of the file: our names, and what is accepted of each."""
    where, where_units = f"{source} line {names[0]}", f"{source} line {units[0]}"
    if len(units[1]) != len(names[1]):
        raise TrackError(
            f"{where_units}: {len(units[1])} units, expected {len(names[1])}, one in brackets a "
            "name"
        )
    fields: dict[str, Range] = {}
    for name, unit in zip(names[1], units[1], strict=True):
        if name.lower() not in _COLUMNS:
            raise TrackError(
                f"{where}: column {name!r} is unknown, expected some of {', '.join(_COLUMNS)}"
            )
        key, family, low, high = _COLUMNS[name.lower()]
        unit_name = unit[1:-1] if unit.startswith("[") and unit.endswith("]") else unit
        scale = si(unit_name, family)
        if scale is None or (unit_name == unit and unit_name.lower() != "unitless"):
            listed = ", ".join(FAMILIES[family])
            raise TrackError(
                f"{where_units}, field {key}: unit {unit!r}, expected one in brackets of {listed}"
            )
        if key in fields:
            raise TrackError(f"{where}: column {key} stands twice")
        hint = DEGREES if family == "angle" and scale == 1.0 else ""
        fields[key] = Range(low / scale, high / scale, scale, hint)
    for key in _NEEDED:
        if key not in fields:
            raise TrackError(f"{where}: column {key} is missing")
    for pairs in _CHOICES:
        if sum(all(key in fields for key in pair) for pair in pairs) != 1:
            expected = " or ".join(" and ".join(pair) for pair in pairs)
            raise TrackError(f"{where}: expected the columns {expected}, one pair of them")
    return fields


def _number(cell: str, accepted: Range, where: str, repair: bool) -> float:
    """Return a number in SI units; it may be not finite: those are for the check of the rows."""
    try:
        value = number_of(cell)
    except ValueError:
        raise TrackError(f"{where}: {cell[:40]!r}, expected a number") from None
    return accepted.si(value, where, repair=repair) if math.isfinite(value) else value
