"""Recorded tracks: what a track is, what can be wrong with one, and what it takes to repair it.

Nothing is repaired unless asked for, and what was repaired is counted.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from envs.angles import wrap
from envs.edge.command import InputError

__all__ = ["Repairs", "Rows", "Track", "TrackError", "TrackFile", "at_times", "ordered", "summed"]

_MOST_FILLED = 100_000

Rows: TypeAlias = list[tuple[int, dict[str, float]]]
"""Rows of one aircraft: number of the line, and values by our names, ``time`` among them."""


class TrackError(InputError):
    """Tracks that cannot be used; the message says file, line, field, and what was expected."""


class Track(NamedTuple):
    """The flight of one aircraft; arrays ``[T]`` in SI units, local frame x east, y north."""

    name: str
    time: np.ndarray
    """s, strictly increasing."""
    x: np.ndarray
    y: np.ndarray
    altitude: np.ndarray
    vx: np.ndarray
    """Over the ground."""
    vy: np.ndarray
    vertical_rate: np.ndarray
    extra: Mapping[str, np.ndarray]
    """Other columns of the file by name, in SI units and radians (angles as in the file: clockwise from north)."""


class Repairs(NamedTuple):
    """What had to be done to tracks; counts of rows."""

    not_finite: int = 0
    """Dropped because a number in them was none, or beyond belief."""
    out_of_order: int = 0
    """Dropped because their time was not after the one before."""
    filled: int = 0
    """Added on the straight line across gaps."""
    stale: int = 0
    """Dropped because they repeat the position before although the aircraft moves."""


class TrackFile(NamedTuple):
    """The tracks of a file, the ownship first."""

    tracks: tuple[Track, ...]
    repairs: Repairs


def summed(repairs: Sequence[Repairs]) -> Repairs:
    """Return the sum of the repairs of several tracks."""
    return Repairs(*(sum(counts) for counts in zip(*repairs, strict=True)))


def at_times(track: Track, times: np.ndarray) -> Track:
    """Return a track at other times ``[T']`` by straight lines between its rows.

    Raises:
        TrackError: a time lies outside the track.
    """
    times = np.asarray(times, np.float64)
    if not (np.isfinite(times).all() and times.min() >= track.time[0] and times.max() <= track.time[-1]):
        raise TrackError(
            f"track {track.name!r} covers {track.time[0]:g} to {track.time[-1]:g} s, expected the times asked for, "
            f"{times.min():g} to {times.max():g} s"
        )
    fields = {
        name: np.interp(times, track.time, getattr(track, name)) for name in Track._fields if name not in _NOT_BY_LINES
    }
    extra = {name: np.interp(times, track.time, _unwrapped(name, values)) for name, values in track.extra.items()}
    return Track(name=track.name, time=times, extra=extra, **fields)


_NOT_BY_LINES = ("name", "time", "extra")


def _unwrapped(name: str, values: np.ndarray) -> np.ndarray:
    return np.unwrap(values) if name == "heading" else values


def ordered(
    source: str, name: str, rows: Rows, repair: bool, max_gap: float, noun: str = "line"
) -> tuple[Rows, Repairs]:
    """Return an aircraft's rows, finite, in order and without gaps, and what it took.

    Args:
        source: name of the file for messages.
        name: of the aircraft.
        rows: as they stand in the file.
        repair: drop and fill instead of refusing.
        max_gap: longest time between two rows, s.
        noun: what the file counts.

    Raises:
        TrackError: something is wrong and must not be repaired, or nothing is left.
    """
    kept: Rows = []
    counts = {"not_finite": 0, "out_of_order": 0, "filled": 0}
    for number, values in rows:
        where = f"{source} {noun} {number}"
        bad = next((key for key, value in values.items() if not math.isfinite(value)), None)
        if bad is not None:
            if not repair:
                raise TrackError(f"{where}, field {bad}: {values[bad]}, expected a finite number")
            counts["not_finite"] += 1
            continue
        before = kept[-1][1] if kept else None
        if before is not None and values["time"] <= before["time"]:
            if not repair:
                raise TrackError(
                    f"{where}, field time: {values['time']:.15g} s of {name!r}, expected more than "
                    f"{before['time']:.15g} s as in {noun} {kept[-1][0]}"
                )
            counts["out_of_order"] += 1
            continue
        if before is not None and values["time"] - before["time"] > max_gap:
            if not repair:
                raise TrackError(
                    f"{where}, field time: a gap of {values['time'] - before['time']:g} s in the track of {name!r}, "
                    f"expected at most {max_gap:g} s"
                )
            filling = _between(before, values, max_gap, f"{where}, field time")
            counts["filled"] += len(filling)
            kept += [(number, row) for row in filling]
        kept.append((number, values))
    if not kept:
        raise TrackError(f"{source}: no row of {name!r} is left, expected at least one that is finite")
    return kept, Repairs(**counts)


def _between(before: dict[str, float], after: dict[str, float], max_gap: float, where: str) -> list[dict[str, float]]:
    """Return rows on the straight line across a gap."""
    parts = math.ceil((after["time"] - before["time"]) / max_gap)
    if parts > _MOST_FILLED:
        raise TrackError(f"{where}: a gap that takes {parts} rows to fill, expected at most {_MOST_FILLED}")
    shares = [part / parts for part in range(1, parts)]
    return [{key: _mixed(key, before[key], after[key], share) for key in before} for share in shares]


def _mixed(key: str, first: float, second: float, share: float) -> float:
    """Return the value at a share of the way; angles the short way round."""
    step = second - first
    if key in ("trk", "heading", "lon"):
        step = float(wrap(step, np))
    return first + share * step
