"""Encounters in ADS-B reports: pairs of aircraft that came near each other, from a while before
their closest approach.

Reports on the ground are left out and counted. Reports of an aircraft more than :data:`APART`
seconds apart are of different flights. Distances are chords of the ellipsoid between points on
straight lines between the reports, at each whole second at which the altitudes differ little
enough.
"""

import itertools
import math
import os
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from envs.aircraft import Aircraft
from envs.formats.adsb_file import order_flights
from envs.formats.local_frame import geocentric
from envs.formats.track_rows import Rows, place_of, track_of
from envs.traffic.replay import horizon
from envs.traffic.tracks import Repairs, Track, TrackError, at_times, sum_of_repairs

APART = 60.0  # s
_SHORTEST = 30.0  # seconds before the closest approach that both must be known for


class Nearby(NamedTuple):
    """What counts as an encounter."""

    within: float  # smallest horizontal distance, m, at most
    vertical: float  # difference of the altitudes then, m, at most
    lead: float
    """Seconds before the closest approach at which the encounter begins; later where one is not
    known so long.
    """


class _Flight(NamedTuple):
    """A flight of an aircraft, at each whole second too."""

    name: str
    rows: Rows
    time: np.ndarray  # whole seconds, [T]
    place: np.ndarray
    """Cartesian about the Earth's centre, m, ``[T, 3]``: distances in it are the same for every
    reference."""
    altitude: np.ndarray  # m, [T]


class _Meeting(NamedTuple):
    """A closest approach of two flights."""

    time: float  # s
    first: _Flight
    second: _Flight


def adsb_pairs(
    path: str | os.PathLike[str],
    nearby: Nearby,
    aircraft: Aircraft,
    *,
    repair: bool = False,
    max_gap: float = 5.0,
    grounded: Counter[str] | None = None,
) -> tuple[list[tuple[str, Track, Sequence[Track]]], Repairs]:
    """Return the encounters in a file of reports: name, the ownship's track and the intruder's, by
    time.

    The ownship is the one that begins within the aircraft's speeds; of two, the one with the
    smaller address.

    Args:
        path, repair, max_gap, grounded: as of :func:`envs.formats.adsb_file.order_flights`.
        nearby: what counts as an encounter.
        aircraft: what the ownship is taken for.

    Raises:
        TrackError: the file cannot be read or a report is not as expected; the message names file,
            report and field.
    """
    source = os.fspath(path)
    flights, repairs = [], []
    for name, reports, repaired in order_flights(
        source, APART, repair=repair, max_gap=max_gap, grounded=grounded
    ):
        repairs.append(repaired)
        lasting = (
            rows
            for rows in reports
            if rows and rows[-1][1]["time"] - rows[0][1]["time"] >= _SHORTEST
        )
        flights += [_flight(name, rows) for rows in lasting]
    if not flights:
        raise TrackError(f"{source}: no flight of {_SHORTEST:g} s, expected at least two")
    meetings = sorted(
        _meetings(flights, nearby),
        key=lambda meeting: (meeting.time, meeting.first.name, meeting.second.name),
    )
    encounters = [_encounter(meeting, nearby.lead, aircraft) for meeting in meetings]
    return encounters, sum_of_repairs(repairs)


def _flight(name: str, rows: Rows) -> _Flight:
    """Return the flight of ordered rows."""
    time, latitude, longitude, altitude = (
        np.array([values[key] for _, values in rows]) for key in ("time", "lat", "lon", "alt")
    )
    seconds = np.arange(math.ceil(time[0]), math.floor(time[-1]) + 1, dtype=np.float64)
    place = np.stack(
        [np.interp(seconds, time, axis) for axis in geocentric(latitude, longitude).T], axis=-1
    )
    return _Flight(name, rows, seconds, place, np.interp(seconds, time, altitude))


def _meetings(flights: Sequence[_Flight], nearby: Nearby) -> Iterator[_Meeting]:
    """Yield the closest approach at one level of every pair that came near."""
    for first, second in itertools.combinations(flights, 2):
        begin, end = max(first.time[0], second.time[0]), min(first.time[-1], second.time[-1])
        if first.name == second.name or end - begin < _SHORTEST:
            continue
        mine, theirs = (
            slice(int(begin - flight.time[0]), int(end - flight.time[0]) + 1)
            for flight in (first, second)
        )
        apart = np.linalg.norm(first.place[mine] - second.place[theirs], axis=-1)
        level = abs(first.altitude[mine] - second.altitude[theirs]) <= nearby.vertical
        near = level & (apart <= nearby.within)
        while near.any():
            closest = int(np.argmin(np.where(near, apart, np.inf)))
            if closest >= _SHORTEST:
                yield _Meeting(begin + closest, first, second)
                break
            # Too early: what is left of this approach is no other one.
            after = np.flatnonzero(~near[closest:])
            near[: closest + after[0] if after.size else None] = False


def _encounter(
    meeting: _Meeting, lead: float, aircraft: Aircraft
) -> tuple[str, Track, Sequence[Track]]:
    """Return an encounter that begins so long before the closest approach, s, local to where its
    ownship begins.
    """
    time, first, second = meeting
    limits, begin = aircraft.limits, max(time - lead, first.time[0], second.time[0])
    pair = sorted((first, second), key=lambda flight: flight.name)
    fits = [limits.speed_min <= _speed(flight, begin) <= limits.speed_max for flight in pair]
    pair = pair[::-1] if fits[1] and not fits[0] else pair
    rows = [_during(flight.rows, begin, begin + horizon(aircraft)) for flight in pair]
    tracks = [
        track_of(flight.name, flight_rows, place_of(rows[0][0]))
        for flight, flight_rows in zip(pair, rows, strict=True)
    ]
    tracks = [
        at_times(track, np.concatenate([[begin], track.time[track.time > begin]]))
        for track in tracks
    ]
    x, y = tracks[0].x[0], tracks[0].y[0]
    mine, theirs = (track._replace(x=track.x - x, y=track.y - y) for track in tracks)
    return f"{mine.name}-{theirs.name}-{time:.0f}", mine, [theirs]


def _during(rows: Rows, begin: float, end: float) -> Rows:
    """Return the rows from the last one before a time to the first one after another."""
    times = [values["time"] for _, values in rows]
    return rows[max(bisect_right(times, begin) - 1, 0) : bisect_left(times, end) + 1]


def _speed(flight: _Flight, time: float) -> float:
    """Return the ground speed at a time, m/s."""
    times = [values["time"] for _, values in flight.rows]
    return float(np.interp(time, times, [values["gs"] for _, values in flight.rows]))
