"""Recorded tracks: what a track is, its values at other times, and counts of what was repaired in
one.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from envs.encounters import EncounterError

DISTANT = 1_000_000.0
"""Further from its reference than this, m, a flat map holds neither distances nor directions."""


class TrackError(EncounterError):
    """Tracks, or a file, that cannot be used; the message says file, line, field, and what was
    expected.
    """


class Track(NamedTuple):
    """The flight of one aircraft; arrays ``[T]`` in SI units, local frame x east, y north."""

    name: str
    time: np.ndarray  # s, strictly increasing
    x: np.ndarray
    y: np.ndarray
    altitude: np.ndarray
    vx: np.ndarray  # over the ground
    vy: np.ndarray
    vertical_rate: np.ndarray
    extra: Mapping[str, np.ndarray]
    """Other columns of the file by name, in SI units and radians (angles as in the file: clockwise
    from north).
    """


class Repairs(NamedTuple):
    """What had to be done to tracks; counts of rows, but for the last."""

    not_finite: int = 0  # dropped because a number in them was missing, not finite or out of range
    out_of_order: int = 0  # dropped because their time was not after the one before
    filled: int = 0  # added on the straight line across gaps
    stale: int = 0  # dropped because they repeat the position before although the aircraft moves
    impossible: int = 0
    """Dropped because the aircraft could not have flown there from the other rows."""
    split: int = 0
    """Flights divided because one address was used by two aircraft or with two clocks."""


class TrackFile(NamedTuple):
    """The tracks of a file, the ownship first."""

    tracks: tuple[Track, ...]
    repairs: Repairs


def sum_of_repairs(repairs: Sequence[Repairs]) -> Repairs:
    """Return the sum of the repairs of several tracks."""
    return Repairs(*(sum(counts) for counts in zip(*repairs, strict=True)))


def at_times(track: Track, times: np.ndarray) -> Track:
    """Return a track at other times (s, ``[T']``) by straight lines between its rows.

    Raises:
        TrackError: a time is before its first row or after its last.
    """
    times = np.asarray(times, np.float64)
    if not (
        np.isfinite(times).all() and times.min() >= track.time[0] and times.max() <= track.time[-1]
    ):
        covered = f"covers {track.time[0]:g} to {track.time[-1]:g} s"
        raise TrackError(
            f"track {track.name!r} {covered}, expected {times.min():g} to {times.max():g} s"
        )
    extra = {
        name: np.unwrap(values) if name == "heading" else values
        for name, values in track.extra.items()
    }

    def between_rows(values: np.ndarray) -> np.ndarray:
        return np.interp(times, track.time, values)

    return Track(
        name=track.name,
        time=times,
        x=between_rows(track.x),
        y=between_rows(track.y),
        altitude=between_rows(track.altitude),
        vx=between_rows(track.vx),
        vy=between_rows(track.vy),
        vertical_rate=between_rows(track.vertical_rate),
        extra={name: between_rows(values) for name, values in extra.items()},
    )
