"""Encounters in ADS-B reports: pairs of aircraft that came near each other, from a while before their closest approach.

Reports on the ground are left out. Reports of an aircraft more than :data:`APART` seconds apart are of different
flights. Distances are those of straight lines between the reports, at each whole second.
"""

import itertools
import math
import os
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from envs.formats.adsb_file import ordered_flights, track_of
from envs.formats.local_frame import local
from envs.kinematics import SURROGATE, Limits
from envs.traffic.tracks import Repairs, Rows, Track, TrackError, summed

__all__ = ["APART", "Nearby", "adsb_pairs"]

APART = 60.0
"""s."""

_SHORTEST = 30.0
"""Seconds before the closest approach that both must be known for."""


class Nearby(NamedTuple):
    """What counts as an encounter."""

    within: float = 5_000.0
    """Smallest horizontal distance, m, at most."""
    vertical: float = 300.0
    """Difference of the altitudes then, m, at most."""
    lead: float = 120.0
    """Seconds before the closest approach at which the encounter begins; later where one is not known so long."""


class _Flight(NamedTuple):
    name: str
    rows: Rows
    time: np.ndarray
    """Whole seconds, ``[T]``."""
    x: np.ndarray
    y: np.ndarray
    altitude: np.ndarray


def adsb_pairs(
    path: str | os.PathLike[str],
    nearby: Nearby = Nearby(),  # noqa: B008  immutable
    *,
    limits: Limits = SURROGATE,
    repair: bool = False,
    max_gap: float = 5.0,
) -> tuple[list[tuple[str, Track, Sequence[Track]]], Repairs]:
    """Return the encounters in a file of reports: name, the ownship's track and the intruder's, by time.

    The ownship is the aircraft that begins within the limits' speeds; of two, the one with the smaller address.

    Args:
        path: of the file, as :func:`envs.formats.adsb_file.read_adsb` reads it.
        nearby: what counts as an encounter.
        limits: of the ownship.
        repair: drop rows without a value or out of order, and fill gaps, instead of refusing the file.
        max_gap: longest time between two reports of a flight, s.

    Raises:
        TrackError: the file cannot be read or a report is not as expected; the message names file, report and field.
    """
    source = os.fspath(path)
    flights, repairs = [], []
    for name, rows, found in ordered_flights(source, APART, repair=repair, max_gap=max_gap):
        repairs.append(found)
        if rows and rows[-1][1]["time"] - rows[0][1]["time"] >= _SHORTEST:
            flights.append((name, rows))
    if not flights:
        raise TrackError(f"{source}: no flight of {_SHORTEST:g} s, expected at least two")
    reference = flights[0][1][0][1]["lat"], flights[0][1][0][1]["lon"]
    known = [_flight(name, rows, reference) for name, rows in flights]
    met = sorted(_met(known, nearby), key=lambda one: (one[0], one[1].name, one[2].name))
    return [_encounter(*one, nearby.lead, limits) for one in met], summed(repairs)


def _flight(name: str, rows: Rows, reference: tuple[float, float]) -> _Flight:
    time = np.array([values["time"] for _, values in rows])
    whole = np.arange(math.ceil(time[0]), math.floor(time[-1]) + 1, dtype=np.float64)
    latitude, longitude, altitude = (np.array([values[key] for _, values in rows]) for key in ("lat", "lon", "alt"))
    x, y = local(latitude, longitude, reference)
    return _Flight(name, rows, whole, *(np.interp(whole, time, field) for field in (x, y, altitude)))


def _met(flights: Sequence[_Flight], nearby: Nearby) -> Iterator[tuple[float, _Flight, _Flight]]:
    """Yield the time of the closest approach of every pair that came near."""
    for one, other in itertools.combinations(flights, 2):
        begin, end = max(one.time[0], other.time[0]), min(one.time[-1], other.time[-1])
        if one.name == other.name or end - begin < _SHORTEST:
            continue
        mine, theirs = (slice(int(begin - each.time[0]), int(end - each.time[0]) + 1) for each in (one, other))
        apart = np.hypot(one.x[mine] - other.x[theirs], one.y[mine] - other.y[theirs])
        closest = int(np.argmin(apart))
        level = abs(one.altitude[mine][closest] - other.altitude[theirs][closest]) <= nearby.vertical
        if level and apart[closest] <= nearby.within and closest >= _SHORTEST:
            yield begin + closest, one, other


def _encounter(
    time: float, one: _Flight, other: _Flight, lead: float, limits: Limits
) -> tuple[str, Track, Sequence[Track]]:
    """Return an encounter, local to where its ownship begins."""
    begin = max(time - lead, one.time[0], other.time[0])
    pair = sorted((one, other), key=lambda flight: flight.name)
    fits = [limits.speed_min <= _speed(flight, begin) <= limits.speed_max for flight in pair]
    own, intruder = pair[::-1] if fits[1] and not fits[0] else pair
    reference = tuple(_at(own, begin, key) for key in ("lat", "lon"))
    tracks = [
        _cut(track_of(flight.name, flight.rows, (reference[0], reference[1])), begin) for flight in (own, intruder)
    ]
    return f"{own.name}-{intruder.name}-{time:.0f}", tracks[0], [tracks[1]]


def _at(flight: _Flight, time: float, key: str) -> float:
    times = [values["time"] for _, values in flight.rows]
    return float(np.interp(time, times, [values[key] for _, values in flight.rows]))


def _speed(flight: _Flight, time: float) -> float:
    return _at(flight, time, "gs")


def _cut(track: Track, begin: float) -> Track:
    """Return a track from a time on, which it covers."""
    fields = ("x", "y", "altitude", "vx", "vy", "vertical_rate")
    after = track.time > begin
    first = {name: np.interp(begin, track.time, getattr(track, name)) for name in fields}
    cut = {name: np.concatenate([[first[name]], getattr(track, name)[after]]) for name in fields}
    return Track(name=track.name, time=np.concatenate([[begin], track.time[after]]), extra={}, **cut)
