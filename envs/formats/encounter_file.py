"""Encounters as a CSV file: one row an intruder, rows with the same ``encounter`` belong together.

The columns stand in :data:`COLUMNS` (for users: docs/howto/own-encounters.md). Units are in their
names: SI and degrees. Positions are local ENU, x east and y north; headings counter-clockwise from
east, so that a track (clockwise from north) of T degrees is a heading of 90 - T.
"""

import csv
import io
import math
import os
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import NamedTuple

import numpy as np

from commands.files import write_whole
from commands.text_file import number_of, text_of
from envs.aircraft import Aircraft
from envs.angles import wrap
from envs.encounters import MOST_INTRUDERS, Encounter, EncounterError
from envs.frames import Air
from envs.intruder import Intent
from envs.kinematics import FASTEST, VehicleState
from envs.perception import Sensor
from envs.trees import take

_MOST_PLACES = 2_000_000  # encounters times the intruders of the fullest one
_FAR = 1_000_000.0
_DEGREES = math.radians(1.0)


class Column(NamedTuple):
    """A column of numbers."""

    name: str
    low: float
    high: float  # both ends belong to the range
    text: str  # what it holds
    shared: bool
    """Whether all rows of an encounter must agree, because it does not belong to one intruder."""
    default: float | None = None
    """Value where the column or the cell is missing; None: it is required."""
    scale: float = 1.0  # SI value of one unit


_TURN = 360.0  # degrees
_FASTEST = FASTEST.speed_max

COLUMNS = (
    Column("own_x_m", -_FAR, _FAR, "start of the ownship, east", shared=True),
    Column("own_y_m", -_FAR, _FAR, "start of the ownship, north", shared=True),
    Column(
        "own_heading_deg",
        -_TURN,
        _TURN,
        "its heading, counter-clockwise from east",
        shared=True,
        scale=_DEGREES,
    ),
    Column("own_speed_m_s", 0.0, _FASTEST, "its speed", shared=True),
    Column("goal_x_m", -_FAR, _FAR, "goal, east", shared=True),
    Column("goal_y_m", -_FAR, _FAR, "goal, north", shared=True),
    Column("intruder_x_m", -_FAR, _FAR, "start of the intruder, east", shared=False),
    Column("intruder_y_m", -_FAR, _FAR, "start of the intruder, north", shared=False),
    Column(
        "intruder_heading_deg",
        -_TURN,
        _TURN,
        "its heading, as the ownship's",
        shared=False,
        scale=_DEGREES,
    ),
    Column("intruder_speed_m_s", 0.0, _FASTEST, "its speed", shared=False),
    Column(
        "turn_onset_s", 0.0, 1e6, "when the intruder changes its course", shared=False, default=0.0
    ),
    Column(
        "turn_change_deg",
        -180.0,
        180.0,
        "by how much, positive to the left; 0: not at all",
        shared=False,
        default=0.0,
        scale=_DEGREES,
    ),
    Column(
        "turn_rate_deg_s",
        0.0,
        30.0,
        "its largest turn rate",
        shared=False,
        default=3.0,
        scale=_DEGREES,
    ),
    Column(
        "position_std_m",
        0.0,
        10_000.0,
        "noise of reported positions, one sigma per axis",
        shared=True,
        default=0.0,
    ),
    Column(
        "velocity_std_m_s",
        0.0,
        100.0,
        "noise of reported velocities, one sigma per axis",
        shared=True,
        default=0.0,
    ),
    Column("latency_s", 0.0, 2.0, "age of the reports", shared=True, default=0.0),
)
"""The columns beside ``encounter``, which holds any text that names an encounter."""


class Row(NamedTuple):
    """An intruder of an encounter, plain numbers; its numbers stand in the order of
    :data:`COLUMNS`.
    """

    own: VehicleState[Air]
    goal_x: float  # m
    goal_y: float
    intruder: VehicleState[Air]
    intent: Intent
    sensor: Sensor

    def numbers(self) -> list[float]:
        """Return the cells of the row, SI units."""
        goal = self.goal_x, self.goal_y
        return [*self.own, *goal, *self.intruder, *self.intent, *self.sensor]


_KEY = "encounter"
_ALL = (_KEY, *(column.name for column in COLUMNS))


def read(
    path: str | os.PathLike[str], aircraft: Aircraft | None = None
) -> tuple[Encounter, list[str]]:
    """Read a file of encounters.

    Args:
        path: CSV in UTF-8 with a header line; lines that are empty or begin with ``#`` are skipped.
        aircraft: whose encounters they are to be: speeds outside its own or its traffic's are
            refused; None: any.

    Returns:
        The encounters ``[N]`` in the order of their first rows, float64, and their names.

    Raises:
        EncounterError: the file cannot be read or something in it is not as documented; the message
            names file, line, column, value and what was expected.
    """
    source = os.fspath(path)
    lines = _lines(source)
    header_line, header = lines[0]
    _check_header(header, f"{source} line {header_line}")
    columns = COLUMNS if aircraft is None else _columns_of(aircraft)
    groups: dict[str, list[tuple[int, list[float]]]] = {}
    for number, cells in lines[1:]:
        where = f"{source} line {number}"
        if len(cells) != len(header):
            raise EncounterError(
                f"{where}: {len(cells)} cells, expected {len(header)} as in the header"
            )
        row = dict(zip(header, cells, strict=True))
        name = row[_KEY]
        if not name:
            raise EncounterError(
                f"{where}, column {_KEY}: empty, expected a text that names the encounter"
            )
        group = groups.setdefault(name, [])
        values = [_number(row.get(column.name, ""), column, where) for column in columns]
        if group:
            _check_shared(values, group[0], name, where)
        if len(group) == MOST_INTRUDERS:
            raise EncounterError(
                f"{where}: encounter {name!r} has more than {MOST_INTRUDERS} intruders"
            )
        group.append((number, values))
    _check_size([len(group) for group in groups.values()], source)
    encounters = _encounters([[values for _, values in group] for group in groups.values()])
    return encounters, list(groups)


def _check_size(intruders: list[int], source: str) -> None:
    """Refuse a file without encounters, or with more than fit together; given are the numbers of
    their intruders.
    """
    if not intruders:
        raise EncounterError(f"{source}: no encounter, expected at least one line below the header")
    most = max(intruders)
    if len(intruders) * most > _MOST_PLACES:
        raise EncounterError(
            f"{source}: {len(intruders)} encounters of up to {most} intruders, expected a product "
            f"of at most {_MOST_PLACES}: divide the file"
        )


def write(
    path: str | os.PathLike[str], encounters: Encounter, names: Sequence[str] | None = None
) -> None:
    """Write encounters ``[N]`` of any float type as :func:`write_rows` does; without names they are
    0, 1, 2, ...
    """
    groups = []
    for i, mask in enumerate(encounters.mask):
        encounter = take(encounters, i)
        groups.append(
            [
                Row(
                    encounter.own,
                    encounter.goal_x,
                    encounter.goal_y,
                    intruder=take(encounter.intruders, k),
                    intent=take(encounter.intent, k),
                    sensor=take(encounter.sensor, 0),
                )
                for k in np.flatnonzero(mask).tolist()
            ]
        )
    if names is None:
        names = [str(i) for i in range(len(groups))]
    write_rows(path, groups, names)


def write_rows(
    path: str | os.PathLike[str], groups: Sequence[Sequence[Row]], names: Sequence[str]
) -> None:
    """Write encounters atomically as a file that :func:`read` gives back (to rounding of the
    degrees).

    Args:
        groups: of each encounter a row an intruder.
        names: of the encounters, distinct.

    Raises:
        EncounterError: a name is empty or stands twice, an encounter has no intruder, a value is
            out of its column's range, or the file cannot be written.
    """
    target = Path(path)
    names = [str(name) for name in names]
    usable = all(name and name.strip() == name for name in names)
    if not usable or len(set(names)) != len(groups) or len(names) != len(groups):
        raise EncounterError(
            f"{target}: expected {len(groups)} distinct names without blanks around them"
        )
    if any(name.startswith("#") for name in names):
        raise EncounterError(f"{target}: a name that begins with # would read as a comment")
    lines: list[list[str]] = [list(_ALL)]
    for name, rows in zip(names, groups, strict=True):
        where = f"{target}: encounter {name!r}"
        if not 1 <= len(rows) <= MOST_INTRUDERS:
            amount = f"more than {MOST_INTRUDERS} intruders" if rows else "no intruder"
            raise EncounterError(f"{where} has {amount}")
        lines += [[name, *_texts(row, where)] for row in rows]
    try:
        with write_whole(target) as new, new.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows(lines)
    except OSError as problem:
        raise EncounterError(f"{target}: cannot be written: {problem.strerror}") from problem
    except UnicodeEncodeError as problem:
        raise EncounterError(
            f"{target}: {ascii(problem.object)[:40]}, expected names that UTF-8 can hold"
        ) from None


def _lines(source: str) -> list[tuple[int, list[str]]]:
    reader = csv.reader(io.StringIO(text_of(source, EncounterError), newline=""), strict=True)
    try:
        # A quoted cell may span lines: its row is named by its last one.
        lines = [(reader.line_num, [cell.strip() for cell in cells]) for cells in reader]
    except csv.Error as error:
        raise EncounterError(f"{source}: not a CSV file: {error}") from None
    lines = [
        (number, cells) for number, cells in lines if any(cells) and not cells[0].startswith("#")
    ]
    if not lines:
        raise EncounterError(
            f"{source}: the file is empty, expected a header line with {', '.join(_ALL)}"
        )
    return lines


def _check_header(header: list[str], where: str) -> None:
    for name in header:
        if name not in _ALL:
            close = get_close_matches(name, _ALL, n=1, cutoff=0.6)
            hint = f"did you mean {close[0]}?" if close else f"expected some of {', '.join(_ALL)}"
            raise EncounterError(f"{where}: column {name!r} is unknown; {hint}")
        if header.count(name) > 1:
            raise EncounterError(f"{where}: column {name} stands twice")
    required = [_KEY, *(column.name for column in COLUMNS if column.default is None)]
    missing = [name for name in required if name not in header]
    if missing:
        raise EncounterError(
            f"{where}: column {missing[0]} is missing; required are {', '.join(required)}"
        )


def _columns_of(aircraft: Aircraft) -> list[Column]:
    """Return the columns with the speeds that an aircraft and its traffic can have."""
    limits = aircraft.limits
    columns = {column.name: column for column in COLUMNS}
    columns["own_speed_m_s"] = columns["own_speed_m_s"]._replace(
        low=float(limits.speed_min), high=float(limits.speed_max)
    )
    columns["intruder_speed_m_s"] = columns["intruder_speed_m_s"]._replace(
        high=float(aircraft.traffic_speed_max)
    )
    return list(columns.values())


def _number(cell: str, column: Column, where: str) -> float:
    if not cell and column.default is not None:
        return column.default
    try:
        value = number_of(cell)
    except ValueError:
        value = math.nan
    if not column.low <= value <= column.high:
        expected = f"expected a number from {column.low:g} to {column.high:g}"
        raise EncounterError(
            f"{where}, column {column.name}: {repr(cell) if cell else 'empty'}, {expected}"
        )
    return value


def _check_shared(
    values: list[float], first: tuple[int, list[float]], name: str, where: str
) -> None:
    """Refuse a row that does not agree with the first one of its encounter."""
    for column, value, before in zip(COLUMNS, values, first[1], strict=True):
        if column.shared and value != before:
            expected = f"expected {before!r} as in line {first[0]}, the first of encounter {name!r}"
            raise EncounterError(f"{where}, column {column.name}: {value!r}, {expected}")


def _encounters(groups: list[list[list[float]]]) -> Encounter:
    """Return encounters ``[N]`` of the rows of each, cells in the order and units of
    :data:`COLUMNS`.
    """
    most = max(len(group) for group in groups)
    # An absent intruder repeats the first one, so that it is finite everywhere; its mask is False.
    table = np.array([group + [group[0]] * (most - len(group)) for group in groups])
    column = {c.name: table[:, :, i] * c.scale for i, c in enumerate(COLUMNS)}
    shared = {name: np.ascontiguousarray(values[:, 0]) for name, values in column.items()}

    def state(of: str, columns: dict[str, np.ndarray]) -> VehicleState[Air]:
        x, y, heading, speed = (
            columns[f"{of}_{name}"] for name in ("x_m", "y_m", "heading_deg", "speed_m_s")
        )
        return VehicleState(x, y, wrap(heading, np), speed)

    return Encounter(
        own=state("own", shared),
        goal_x=shared["goal_x_m"],
        goal_y=shared["goal_y_m"],
        intruders=state("intruder", column),
        mask=np.arange(most) < np.array([len(group) for group in groups])[:, None],
        intent=Intent(column["turn_onset_s"], column["turn_change_deg"], column["turn_rate_deg_s"]),
        sensor=Sensor(
            *(shared[name][:, None] for name in ("position_std_m", "velocity_std_m_s", "latency_s"))
        ),
    )


def _texts(row: Row, where: str) -> list[str]:
    """Return the cells of a row; the aircraft's speeds are the reader's to check."""
    texts = [
        repr(float(value) / column.scale)
        for value, column in zip(row.numbers(), COLUMNS, strict=True)
    ]
    for text, column in zip(texts, COLUMNS, strict=True):
        _number(text, column, where)
    return texts
