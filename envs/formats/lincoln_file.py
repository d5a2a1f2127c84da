"""Two-aircraft encounters of MIT Lincoln Laboratory's airspace models: the JSON form, and their flight.

A file is a list of objects: initial conditions in feet, feet per second and radians clockwise from north, each a pair
[ownship, intruder], and for each aircraft its events, rows of time (s), vertical rate (ft/s), turn rate (rad/s,
clockwise) and acceleration (ft/s^2), which hold until the next row. ``meta`` has what the models' own simulation found:
horizontal and vertical miss distance (ft) at the time of closest approach, counted in tenths of a second from 1.

The flight here is a plain kinematic one, without the vehicles' limits and lags.
"""

import math
import os
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from envs.traffic.text_file import json_of
from envs.traffic.track_units import FOOT, KNOT
from envs.traffic.tracks import DISTANT, Repairs, Track, TrackError, summed

__all__ = ["LincolnEncounter", "published_miss", "read_lincoln", "tracks_of"]

_STEP = 0.1
_LONGEST = 36_000.0
_LONGEST_FILE = 2_000_000.0
"""s, of all encounters together."""

_LARGEST = 1e12
_FASTEST = 2_000.0 * KNOT / FOOT
_STATE = {
    "n_ft": (FOOT, -DISTANT / FOOT, DISTANT / FOOT),
    "e_ft": (FOOT, -DISTANT / FOOT, DISTANT / FOOT),
    "h_ft": (FOOT, -5_000.0, 100_000.0),
    "v_ftps": (FOOT, 0.0, _FASTEST),
    "heading_rad": (1.0, -2.0 * math.pi, 2.0 * math.pi),
}
"""SI value of one unit, and the range that is accepted, in that unit."""

_EVENTS = "events_time_s_vrate_fps_turn_radps_accel_ftpss"
_EVENT_FIELDS = {
    "time": (-_LONGEST, _LONGEST),
    "vertical rate": (-1_000.0, 1_000.0),
    "turn rate": (-1.0, 1.0),  # 3 is a standard turn in degrees a second
    "acceleration": (-500.0, 500.0),
}


class LincolnEncounter(NamedTuple):
    """An encounter; pairs are [ownship, intruder], SI units, angles clockwise from north."""

    number: int
    north: np.ndarray
    """m, ``[2]``."""
    east: np.ndarray
    altitude: np.ndarray
    speed: np.ndarray
    """m/s, along the flight path."""
    track: np.ndarray
    """rad."""
    duration: float
    """s."""
    events: tuple[np.ndarray, np.ndarray]
    """``[E, 4]`` each: time s, vertical rate m/s, turn rate rad/s, acceleration m/s^2."""
    miss: float
    """Published horizontal miss distance, m; nan if there is none."""
    vertical_miss: float
    """Published, m; nan if there is none."""
    time: float
    """Published time of closest approach, s; nan if there is none."""
    weight: float
    """Importance weight; 1 if there is none."""
    repairs: Repairs = Repairs()
    """What was done to the events."""


def read_lincoln(path: str | os.PathLike[str], *, repair: bool = False) -> list[LincolnEncounter]:
    """Read a file of encounters.

    Args:
        path: of the file.
        repair: drop events that are not finite or out of order, instead of refusing the file. Nothing can make up for
            initial conditions.

    Raises:
        TrackError: the file cannot be read or is not as documented; the message names file, encounter and field (the
            line, where the file is no JSON at all).
    """
    source = os.fspath(path)
    found = json_of(source, TrackError)
    if not isinstance(found, list) or not found:
        raise TrackError(f"{source}: expected a list of encounters that is not empty")
    encounters = [_encounter(each, f"{source} encounter {i + 1}", repair) for i, each in enumerate(found)]
    total = sum(one.duration for one in encounters)
    if total > _LONGEST_FILE:
        raise TrackError(f"{source}: {total:.0f} s in all, expected at most {_LONGEST_FILE:.0f} s: divide the file")
    numbers: set[int] = set()
    for i, one in enumerate(encounters):
        if one.number in numbers:
            raise TrackError(f"{source} encounter {i + 1}, field id: {one.number} stands twice, expected distinct ones")
        numbers.add(one.number)
    return encounters


def tracks_of(encounter: LincolnEncounter) -> tuple[Track, Track]:
    """Fly an encounter and return the tracks of the ownship and the intruder, a row each 0.1 s.

    The speed along the flight path grows by the acceleration, its horizontal part is what the vertical rate leaves of
    it, and the track turns at the turn rate; each event holds until the next one.
    """
    own, intruder = (_flown(encounter, i, name) for i, name in enumerate(("ownship", "intruder")))
    return own, intruder


def published_miss(encounter: LincolnEncounter) -> float:
    """Return the horizontal distance of the flown tracks at the published time of closest approach, m."""
    own, intruder = tracks_of(encounter)
    row = min(round(encounter.time / _STEP), len(own.time) - 1)
    return float(math.hypot(intruder.x[row] - own.x[row], intruder.y[row] - own.y[row]))


def _flown(encounter: LincolnEncounter, i: int, name: str) -> Track:
    steps = round(encounter.duration / _STEP)
    time = _STEP * np.arange(steps + 1)
    rows = np.searchsorted(encounter.events[i][:, 0], time[:-1] + 1e-9, side="right") - 1
    # Before the first event nothing is commanded.
    held = np.where(rows[:, None] >= 0, encounter.events[i][np.maximum(rows, 0), 1:], 0.0)
    rate, turn, acceleration = held.T
    speed = np.maximum(encounter.speed[i] + _STEP * np.concatenate([[0.0], np.cumsum(acceleration)]), 0.0)
    track = encounter.track[i] + _STEP * np.concatenate([[0.0], np.cumsum(turn)])
    climb = np.concatenate([rate, rate[-1:]]) if steps else np.zeros(1)
    middle_speed, middle_track = 0.5 * (speed[1:] + speed[:-1]), track[:-1] + 0.5 * _STEP * turn
    level = np.sqrt(np.maximum(middle_speed**2 - rate**2, 0.0))
    east = _STEP * np.concatenate([[0.0], np.cumsum(level * np.sin(middle_track))])
    north = _STEP * np.concatenate([[0.0], np.cumsum(level * np.cos(middle_track))])
    up = _STEP * np.concatenate([[0.0], np.cumsum(rate)])
    ground = np.sqrt(np.maximum(speed**2 - climb**2, 0.0))
    return Track(
        name,
        time,
        encounter.east[i] + east,
        encounter.north[i] + north,
        encounter.altitude[i] + up,
        ground * np.sin(track),
        ground * np.cos(track),
        climb,
        {},
    )


def _encounter(each: Any, where: str, repair: bool) -> LincolnEncounter:
    if not isinstance(each, dict):
        raise TrackError(f"{where}: expected an object")
    state = [_pair(each, key, where, low, high) * scale for key, (scale, low, high) in _STATE.items()]
    duration = _one(each, "runTime_s", where)
    if not 0.0 < duration <= _LONGEST:
        raise TrackError(f"{where}, field runTime_s: {duration:g}, expected more than 0 and at most {_LONGEST:g} s")
    events = each.get(_EVENTS)
    if not isinstance(events, list) or len(events) != 2:
        raise TrackError(f"{where}, field {_EVENTS}: expected a list of events for each of two aircraft")
    meta = each.get("meta", {})
    if not isinstance(meta, dict):
        raise TrackError(f"{where}, field meta: expected an object")

    def published(key: str, missing: float) -> float:
        return _one(meta, key, where) if key in meta else missing

    number = _one(each, "id", where)
    if number != int(number):
        raise TrackError(f"{where}, field id: {number:g}, expected a whole number")
    weight = published("w", 1.0)
    if not weight > 0.0:
        raise TrackError(f"{where}, field w: {weight:g}, expected a positive weight")
    labels = [f"{where}, ownship's events", f"{where}, intruder's events"]
    (own, own_repairs), (other, other_repairs) = (
        _events(rows, label, repair) for rows, label in zip(events, labels, strict=True)
    )
    for i, (rows, label) in enumerate(zip((own, other), labels, strict=True)):
        _check_flight(rows, duration, float(state[2][i]), float(state[3][i]), label)
    return LincolnEncounter(
        int(number),
        *state,
        duration=duration,
        events=(own, other),
        miss=published("hmd", math.nan) * FOOT,
        vertical_miss=published("vmd", math.nan) * FOOT,
        time=(published("tca", math.nan) - 1.0) * _STEP,
        weight=weight,
        repairs=summed([own_repairs, other_repairs]),
    )


def _events(rows: Any, where: str, repair: bool) -> tuple[np.ndarray, Repairs]:
    """Return events ``[E, 4]`` in SI units, their times increasing, and what it took."""
    if not isinstance(rows, list):
        raise TrackError(f"{where}: expected a list of rows")
    bad, late = 0, 0
    kept: list[list[float]] = []
    for i, row in enumerate(rows):
        if repair and isinstance(row, list) and any(value is None or _is_none(value) for value in row):
            bad += 1
            continue
        values = _row(row, f"{where}, row {i + 1}")
        if kept and values[0] <= kept[-1][0]:
            if not repair:
                raise TrackError(
                    f"{where}, row {i + 1}, time: {values[0]:g} s does not increase, expected more than "
                    f"{kept[-1][0]:g} s as in the row before"
                )
            late += 1
            continue
        kept.append(values)
    table = np.array(kept, dtype=np.float64).reshape(-1, len(_EVENT_FIELDS))
    if not len(table):
        table = np.zeros((1, len(_EVENT_FIELDS)))  # nothing is ever commanded
    return table * (1.0, FOOT, 1.0, FOOT), Repairs(not_finite=bad, out_of_order=late)


def _check_flight(events: np.ndarray, duration: float, altitude: float, speed: float, where: str) -> None:
    """Raise where events lead out of the altitudes and speeds that a file may begin with."""
    held = np.diff(np.clip(np.append(events[:, 0], duration), 0.0, duration))
    for name, key, begin, rates in (
        ("altitude", "h_ft", altitude, events[:, 1]),
        ("speed", "v_ftps", speed, events[:, 3]),
    ):
        scale, low, high = _STATE[key]
        values = (begin + np.cumsum(rates * held)) / scale
        # A speed that would fall below 0 stays there.
        if values.max() > high or (key == "h_ft" and values.min() < low):
            row = int(np.argmax((values > high) | (values < low)))
            raise TrackError(
                f"{where}, row {row + 1}: leads to the {name} {values[row]:.6g}, expected at most {high:.6g} "
                f"and at least {low:g}, as of {key}"
            )


def _is_none(value: Any) -> bool:
    return isinstance(value, float) and not math.isfinite(value)


def _row(row: Any, where: str) -> list[float]:
    if not isinstance(row, list) or len(row) != len(_EVENT_FIELDS):
        raise TrackError(f"{where}: expected {len(_EVENT_FIELDS)} numbers: {', '.join(_EVENT_FIELDS)}")
    fields = zip(_EVENT_FIELDS.items(), row, strict=True)
    return [_finite(value, f"{where}, {name}", *ends) for (name, ends), value in fields]


def _pair(each: dict[str, Any], key: str, where: str, low: float, high: float) -> np.ndarray:
    values: Sequence[Any] = each.get(key, ())
    if not isinstance(values, list) or len(values) != 2:
        raise TrackError(f"{where}, field {key}: expected a pair of numbers, the ownship's and the intruder's")
    return np.array([_finite(value, f"{where}, field {key}", low, high) for value in values])


def _one(each: dict[str, Any], key: str, where: str) -> float:
    return _finite(each.get(key), f"{where}, field {key}", -_LARGEST, _LARGEST)


def _finite(value: Any, where: str, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= _LARGEST:
        raise TrackError(f"{where}: {repr(value)[:40]}, expected a finite number")
    if not low <= value <= high:
        hint = " (are these degrees?)" if where.endswith(("rad", "turn rate")) else ""
        raise TrackError(f"{where}: {value:g}, expected {low:.6g} to {high:.6g}{hint}")
    return float(value)
