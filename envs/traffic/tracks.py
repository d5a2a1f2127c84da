"""Recorded tracks: what a track is, its values at other times, and counts of what was repaired in
one.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from envs.encounters import EncounterError
from envs.kinematics import FASTEST

DISTANT = 1_000_000.0
"""Further from its reference than this, m, a flat map holds neither distances nor directions."""

_FIRMEST = FASTEST.acceleration_max
"""m/s^2; nothing in this world accelerates more."""


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
    """What had to be done to tracks; counts of rows, but for ``split``."""

    not_finite: int = 0  # dropped because a number in them was missing, not finite or out of range
    out_of_order: int = 0  # dropped because their time was not after the one before
    filled: int = 0  # missing in gaps that are flown along a curve (:func:`at_times`)
    stale: int = 0  # dropped because they repeat the position before although the aircraft moves
    impossible: int = 0
    """Dropped because the aircraft could not have flown there from the other rows."""
    split: int = 0
    """Flights divided because one address was used by two aircraft or with two clocks."""
    velocity: int = 0
    """Whose velocity was taken from the positions, because those of the whole flight make another
    way (:mod:`envs.traffic.velocities`)."""


class TrackFile(NamedTuple):
    """The tracks of a file, the ownship first."""

    tracks: tuple[Track, ...]
    repairs: Repairs


def sum_of_repairs(repairs: Sequence[Repairs]) -> Repairs:
    """Return the sum of the repairs of several tracks."""
    return Repairs(*(sum(counts) for counts in zip(*repairs, strict=True)))


def at_times(track: Track, times: np.ndarray) -> Track:
    """Return a track at other times (s, ``[T']``): between its rows along the cubic curve that
    meets both positions and velocities, so that one is the change of the other; all else along
    straight lines.

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

    place, velocity = _fly_between(track, times)
    return Track(
        name=track.name,
        time=times,
        x=np.real(place),
        y=np.imag(place),
        altitude=between_rows(track.altitude),
        vx=np.real(velocity),
        vy=np.imag(velocity),
        vertical_rate=between_rows(track.vertical_rate),
        extra={name: between_rows(values) for name, values in extra.items()},
    )


def _fly_between(track: Track, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions, m, and velocities, m/s, at times within a track, complex ``[T']``.

    Where no aircraft could fly the cubic curve, because the rows are near each other and their
    positions less exact than their velocities, or because it has flown something else, both change
    along straight lines.
    """
    places, velocities = track.x + 1j * track.y, track.vx + 1j * track.vy
    rows = track.time
    before = np.searchsorted(rows, times, side="right") - 1
    after = np.minimum(before + 1, len(rows) - 1)
    gap = np.where(after > before, rows[after] - rows[before], 1.0)
    share = (times - rows[before]) / gap
    begins, ends = velocities[before], velocities[after]
    mean = (places[after] - places[before]) / gap
    # The velocity is begins + bend share + twist share^2.
    bend, twist = 6.0 * mean - 4.0 * begins - 2.0 * ends, 3.0 * (begins + ends) - 6.0 * mean
    firmest = np.maximum(np.abs(bend), np.abs(bend + 2.0 * twist)) / gap
    curve = (share > 0.0) & (firmest <= _FIRMEST)  # rows stay as they are
    way = gap * share * (begins + share * (0.5 * bend + share * twist / 3.0))
    return (
        np.where(curve, places[before] + way, np.interp(times, rows, places)),
        np.where(
            curve,
            begins + share * (bend + share * twist),
            np.interp(times, rows, velocities),
        ),
    )
