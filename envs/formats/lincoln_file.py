"""Two-aircraft encounters of MIT Lincoln Laboratory's airspace models: the JSON form, and their
flight.

A file is a list of objects: initial conditions in feet, feet per second and radians clockwise from
north, each a pair [ownship, intruder], and for each aircraft its events, rows of time (s), vertical
rate (ft/s), turn rate (rad/s, clockwise) and acceleration (ft/s^2), which hold until the next row.
``meta`` has what the models' own simulation found: horizontal and vertical miss distance (ft) at
the time of closest approach, counted in tenths of a second from 1.

The flight here is a plain kinematic one, without the vehicles' limits and lags.
"""

import math
import os
from typing import Any, NamedTuple

import numpy as np

from commands.text_file import json_of
from envs.traffic.track_units import DEGREES, FOOT, KNOT, Range
from envs.traffic.tracks import DISTANT, Repairs, Track, TrackError, sum_of_repairs
from envs.traffic.velocities import UNITS

_STEP = 0.1
_LONGEST = 36_000.0
_LONGEST_FILE = 2_000_000.0  # s, of all encounters together
_ANY = Range(-1e12, 1e12)
_FEWEST_PUBLISHED, _MOST_PUBLISHED = 5, 100  # encounters with which a file is judged
_OFF_PUBLISHED = 300.0
"""m; 8 m of the public encounters, whose vehicles are not ours; 700 m and more in another unit."""
_PLACE = Range(-DISTANT / FOOT, DISTANT / FOOT, FOOT)
_STATE = {
    "n_ft": _PLACE,
    "e_ft": _PLACE,
    "h_ft": Range(-5_000.0, 100_000.0, FOOT),
    "v_ftps": Range(0.0, 2_000.0 * KNOT / FOOT, FOOT),
    "heading_rad": Range(-2.0 * math.pi, 2.0 * math.pi, hint=DEGREES),
}

EVENTS = "events_time_s_vrate_fps_turn_radps_accel_ftpss"
_EVENT_FIELDS = {
    "time": Range(-_LONGEST, _LONGEST),
    "vertical rate": Range(-1_000.0, 1_000.0, FOOT),
    "turn rate": Range(-1.0, 1.0, hint=DEGREES),  # 3 is a standard turn in degrees a second
    "acceleration": Range(-500.0, 500.0, FOOT),
}


class LincolnEncounter(NamedTuple):
    """An encounter; pairs are [ownship, intruder], SI units, angles clockwise from north."""

    number: int
    north: np.ndarray  # m, [2]
    east: np.ndarray
    altitude: np.ndarray
    speed: np.ndarray  # m/s, along the flight path
    track: np.ndarray  # rad
    duration: float  # s
    events: tuple[np.ndarray, np.ndarray]
    """``[E, 4]`` each: time, s, vertical rate, m/s, turn rate, rad/s, acceleration, m/s^2."""
    miss: float  # published horizontal miss distance, m; nan if there is none
    time: float  # published time of closest approach, s; nan if there is none
    weight: float  # importance weight; 1 if there is none
    repairs: Repairs = Repairs()  # what was done to the events


def read_lincoln(path: str | os.PathLike[str], *, repair: bool = False) -> list[LincolnEncounter]:
    """Read a file of encounters.

    For ``repair`` events that are not finite or out of order are dropped; nothing can make up for
    initial conditions.

    Raises:
        TrackError: the file cannot be read or is not as documented; the message names file,
            encounter and field (the line, where the file is no JSON at all).
    """
    source = os.fspath(path)
    content = json_of(source, TrackError)
    if not isinstance(content, list) or not content:
        raise TrackError(f"{source}: expected a list of encounters that is not empty")
    encounters = [
        _encounter(entry, f"{source} encounter {i + 1}", repair) for i, entry in enumerate(content)
    ]
    total = sum(encounter.duration for encounter in encounters)
    if total > _LONGEST_FILE:
        raise TrackError(
            f"{source}: {total:.0f} s in all, expected at most {_LONGEST_FILE:.0f} s: divide the "
            "file"
        )
    numbers: set[int] = set()
    for i, encounter in enumerate(encounters):
        if encounter.number in numbers:
            raise TrackError(
                f"{source} encounter {i + 1}, field id: {encounter.number} stands twice, expected "
                "distinct ones"
            )
        numbers.add(encounter.number)
    _check_published(encounters, source)
    return encounters


def _check_published(encounters: list[LincolnEncounter], source: str) -> None:
    """Raise a TrackError where the encounters as flown are not those whose miss distances the file
    has: their speeds are in another unit, or their headings are others.
    """
    compared = [
        encounter
        for encounter in encounters
        if math.isfinite(encounter.miss) and math.isfinite(encounter.time)
    ]
    if len(compared) < _FEWEST_PUBLISHED:
        return
    compared = compared[:_MOST_PUBLISHED]
    off = _off_published(compared, 1.0)
    if off <= _OFF_PUBLISHED:
        return
    by_unit = {unit: _off_published(compared, value / FOOT) for unit, value in UNITS.items()}
    likely = min(by_unit, key=by_unit.__getitem__)
    fits = by_unit[likely] <= _OFF_PUBLISHED
    question = f": are they in {likely}?" if fits else ""
    raise TrackError(
        f"{source}, field v_ftps: with these speeds the flights of {len(compared)} encounters miss "
        f"each other by {off:.0f} m more or less than published, in the median, expected at most "
        f"{_OFF_PUBLISHED:g} m{question}"
    )


def _off_published(encounters: list[LincolnEncounter], factor: float) -> float:
    """Return the median error of the miss distances of flights whose first speeds are multiplied by
    a factor, m.
    """
    errors = []
    for encounter in encounters:
        own, intruder = tracks_of(encounter._replace(speed=factor * encounter.speed))
        row = min(max(round(encounter.time / _STEP), 0), len(own.time) - 1)
        miss_flown = math.hypot(intruder.x[row] - own.x[row], intruder.y[row] - own.y[row])
        errors.append(abs(miss_flown - encounter.miss))
    return float(np.median(errors))


def tracks_of(encounter: LincolnEncounter) -> tuple[Track, Track]:
    """Fly an encounter and return the tracks of the ownship and the intruder, a row each 0.1 s.

    The speed along the flight path grows by the acceleration, its horizontal part is what the
    vertical rate leaves of it, and the track turns at the turn rate; each event holds until the
    next one.
    """
    return _fly(encounter, 0, "ownship"), _fly(encounter, 1, "intruder")


def _fly(encounter: LincolnEncounter, i: int, name: str) -> Track:
    """Return the track of one of the two aircraft."""
    time = _STEP * np.arange(round(encounter.duration / _STEP) + 1)
    events = encounter.events[i]
    rows = np.searchsorted(events[:, 0], time[:-1] + 1e-9, side="right") - 1
    # Before the first event nothing is commanded.
    rate, turn, acceleration = np.where(rows[:, None] >= 0, events[np.maximum(rows, 0), 1:], 0.0).T
    speed = np.maximum(encounter.speed[i] + _running_sums(acceleration), 0.0)
    track = encounter.track[i] + _running_sums(turn)
    climb = np.concatenate([rate, rate[-1:]]) if len(rate) else np.zeros(1)
    middle_speed = 0.5 * (speed[1:] + speed[:-1])
    middle_track = track[:-1] + 0.5 * _STEP * turn
    level = np.sqrt(np.maximum(middle_speed**2 - rate**2, 0.0))
    east = encounter.east[i] + _running_sums(level * np.sin(middle_track))
    north = encounter.north[i] + _running_sums(level * np.cos(middle_track))
    altitude = encounter.altitude[i] + _running_sums(rate)
    ground = np.sqrt(np.maximum(speed**2 - climb**2, 0.0))
    return Track(
        name=name,
        time=time,
        x=east,
        y=north,
        altitude=altitude,
        vx=ground * np.sin(track),
        vy=ground * np.cos(track),
        vertical_rate=climb,
        extra={},
    )


def _running_sums(rates: np.ndarray) -> np.ndarray:
    """Return what rates ``[T]``, each of a step, add up to from 0 on, ``[T + 1]``."""
    return _STEP * np.concatenate([[0.0], np.cumsum(rates)])


def _encounter(entry: object, where: str, repair: bool) -> LincolnEncounter:
    if not isinstance(entry, dict):
        raise TrackError(f"{where}: expected an object")
    state = {key: _pair(entry, key, where) for key in _STATE}
    duration = _single(entry, "runTime_s", where)
    if not 0.0 < duration <= _LONGEST:
        raise TrackError(
            f"{where}, field runTime_s: {duration:g}, expected more than 0 and at most "
            f"{_LONGEST:g} s"
        )
    lists = entry.get(EVENTS)
    if not isinstance(lists, list) or len(lists) != 2:
        raise TrackError(
            f"{where}, field {EVENTS}: expected a list of events for each of two aircraft"
        )
    meta = _meta(entry.get("meta", {}), where)
    number = _single(entry, "id", where)
    if number != int(number):
        raise TrackError(f"{where}, field id: {number:g}, expected a whole number")
    if not meta.weight > 0.0:
        raise TrackError(f"{where}, field w: {meta.weight:g}, expected a positive weight")
    events, repairs = [], []
    for i, name in enumerate(("ownship", "intruder")):
        label = f"{where}, {name}'s events"
        rows, repaired = _events(lists[i], label, repair)
        altitude, speed = float(state["h_ft"][i]), float(state["v_ftps"][i])
        _check_flight(rows, duration, altitude, speed, label)
        events.append(rows)
        repairs.append(repaired)
    return LincolnEncounter(
        number=int(number),
        north=state["n_ft"],
        east=state["e_ft"],
        altitude=state["h_ft"],
        speed=state["v_ftps"],
        track=state["heading_rad"],
        duration=duration,
        events=(events[0], events[1]),
        miss=meta.miss * FOOT,
        time=(meta.time - 1.0) * _STEP,
        weight=meta.weight,
        repairs=sum_of_repairs(repairs),
    )


class _Meta(NamedTuple):
    """What the models' own simulation found, in the file's units."""

    miss: float
    time: float
    weight: float


def _meta(meta: object, where: str) -> _Meta:
    if not isinstance(meta, dict):
        raise TrackError(f"{where}, field meta: expected an object")
    return _Meta(
        miss=_single(meta, "hmd", where) if "hmd" in meta else math.nan,
        time=_single(meta, "tca", where) if "tca" in meta else math.nan,
        weight=_single(meta, "w", where) if "w" in meta else 1.0,
    )


def _events(rows: object, where: str, repair: bool) -> tuple[np.ndarray, Repairs]:
    """Return events ``[E, 4]`` in SI units, their times increasing, and what was repaired."""
    if not isinstance(rows, list):
        raise TrackError(f"{where}: expected a list of rows")
    not_finite, out_of_order = 0, 0
    ordered: list[list[float]] = []
    for i, row in enumerate(rows):
        if repair and isinstance(row, list) and any(map(_is_none, row)):
            not_finite += 1
            continue
        values = _row(row, f"{where}, row {i + 1}")
        if ordered and values[0] <= ordered[-1][0]:
            if not repair:
                raise TrackError(
                    f"{where}, row {i + 1}, time: {values[0]:g} s, expected more than "
                    f"{ordered[-1][0]:g} s"
                )
            out_of_order += 1
            continue
        ordered.append(values)
    # Without events nothing is ever commanded.
    events = np.array(ordered or [[0.0] * len(_EVENT_FIELDS)])
    return events, Repairs(not_finite=not_finite, out_of_order=out_of_order)


def _check_flight(
    events: np.ndarray, duration: float, altitude: float, speed: float, where: str
) -> None:
    """Raise a TrackError where events lead out of the altitudes and speeds that a file may begin
    with.
    """
    durations = np.diff(np.clip(np.append(events[:, 0], duration), 0.0, duration))
    for name, key, begin, rates in (
        ("altitude", "h_ft", altitude, events[:, 1]),
        ("speed", "v_ftps", speed, events[:, 3]),
    ):
        low, high, scale, _ = _STATE[key]
        values = (begin + np.cumsum(rates * durations)) / scale
        # A speed that would fall below 0 stays there.
        if values.max() > high or (key == "h_ft" and values.min() < low):
            row = int(np.argmax((values > high) | (values < low)))
            bounds = f"expected {low:g} to {high:.6g}, as of {key}"
            raise TrackError(
                f"{where}, row {row + 1}: leads to the {name} {values[row]:.6g}, {bounds}"
            )


def _is_none(value: object) -> bool:
    return value is None or (isinstance(value, float) and not math.isfinite(value))


def _row(row: object, where: str) -> list[float]:
    if not isinstance(row, list) or len(row) != len(_EVENT_FIELDS):
        raise TrackError(
            f"{where}: expected {len(_EVENT_FIELDS)} numbers: {', '.join(_EVENT_FIELDS)}"
        )
    return [
        _number(row[i], f"{where}, {name}", _EVENT_FIELDS[name])
        for i, name in enumerate(_EVENT_FIELDS)
    ]


def _pair(entry: dict[str, Any], key: str, where: str) -> np.ndarray:
    values = entry.get(key)
    if not isinstance(values, list) or len(values) != 2:
        raise TrackError(
            f"{where}, field {key}: expected a pair of numbers, the ownship's and the intruder's"
        )
    return np.array([_number(value, f"{where}, field {key}", _STATE[key]) for value in values])


def _single(entry: dict[str, Any], key: str, where: str) -> float:
    return _number(entry.get(key), f"{where}, field {key}", _ANY)


def _number(value: object, where: str, accepted: Range) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TrackError(f"{where}: {repr(value)[:40]}, expected a finite number")
    if not abs(value) <= _ANY.high:
        raise TrackError(f"{where}: {repr(value)[:40]}, expected a finite number")
    return accepted.si(value, where)
