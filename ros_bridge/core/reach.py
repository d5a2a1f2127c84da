"""Whether an aircraft whose newest report cannot be planned with can matter at all.

At the edge of a receiver's range many aircraft stop reporting. One that is so far away, or so high, that it cannot come
near while a plan lasts is left out by its last places: each of them, grown by what the aircraft may have flown since,
must lie beyond what both can fly until the end.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from agents.planner.request import Altitude
from envs.formats.local_frame import distance
from ros_bridge.core.fields import SECOND
from ros_bridge.core.reports import FASTEST, Report
from ros_bridge.core.tracks import Track, Verdict

_CLIMB = 30.0
"""Vertical speed that may have been taken up since the last report, m/s."""


@dataclass(frozen=True, slots=True)
class Reach:
    """What matters to an ownship."""

    own: Report
    now: int
    """ns."""
    horizon: float
    """For how long a plan lasts at most, s."""
    separation: float
    """To be kept horizontally, m."""
    vertical: float
    """Vertical separation beyond which an aircraft is left out, m."""
    speed: float
    """Highest of the ownship, m/s."""
    traffic: float
    """An aircraft may fly as fast as this whatever it last reported, m/s."""
    undulation: float | None = None
    """Height of the geoid above the ellipsoid, m; None: unknown."""
    limit: float = math.inf
    """Distance from the ownship, m, beyond which aircraft with good reports are left out, too."""


@dataclass(frozen=True, slots=True)
class _Place:
    time: int
    latitude: float
    longitude: float
    speed: float
    altitude: Altitude | None


def level(altitude: Altitude | None, age: int, undulation: float | None) -> Altitude | None:
    """Return an altitude carried over an age (ns), above the ellipsoid where the undulation is known."""
    if altitude is None:
        return None
    value = altitude.value + altitude.vertical_speed * age / SECOND
    reference = altitude.reference
    if reference == "msl" and undulation is not None:
        value, reference = value + undulation, "wgs84"
    return Altitude(value, reference, altitude.vertical_speed)


def out_of_reach(track: Track, reach: Reach) -> str | None:
    """Return why an aircraft cannot come near by any of its last places, or None."""
    if track.last is None and any(one.sighting.place is None for one in track.sightings):
        return None  # a second aircraft without a place may bear the name
    reasons = [_beyond(place, reach) for place in _places(track, reach.traffic)]
    return reasons[0] if reasons and all(reasons) else None


def _places(track: Track, least: float) -> Iterator[_Place]:
    """Yield where the aircraft may have been: by unusable messages, by its last good report, and by a rival's."""
    fault = track.fault
    for one in track.sightings:
        if one.sighting.place is not None:
            yield _Place(one.time, *one.sighting.place, FASTEST, one.sighting.altitude)
    rival = () if track.rival is None else (track.rival.newest,)
    for report in (track.last, *rival):
        if report is not None:
            # Where places and velocities contradict each other, neither is believed.
            doubtful = fault is not None and fault.verdict is Verdict.CONTRADICTION
            speed = FASTEST if doubtful else max(math.hypot(report.east, report.north), least)
            yield _Place(report.time, report.latitude, report.longitude, speed, report.altitude)


def _beyond(place: _Place, reach: Reach) -> str | None:
    """Return why an aircraft that was at a place cannot come near until the horizon, or None."""
    own, age = reach.own, max((reach.now - place.time) / SECOND, 0.0)
    away = distance(own.latitude, own.longitude, place.latitude, place.longitude)
    since = f"{age:.1f} s ago, and cannot come near within {reach.horizon:.0f} s"
    both = place.speed * (age + reach.horizon) + reach.speed * (reach.horizon + abs(reach.now - own.time) / SECOND)
    if away - both > reach.separation or away - place.speed * age > reach.limit:
        return f"was {away / 1e3:.0f} km away {since}"
    mine = level(own.altitude, reach.now - own.time, reach.undulation)
    other = level(place.altitude, reach.now - place.time, reach.undulation)
    if mine is None or other is None or mine.reference != other.reference:
        return None
    gap = other.value - mine.value
    later = gap + (other.vertical_speed - mine.vertical_speed) * reach.horizon
    if gap * later > 0.0 and min(abs(gap), abs(later)) - _CLIMB * age > reach.vertical:
        return f"was {abs(gap):.0f} m {'above' if gap > 0.0 else 'below'} {since}"
    return None
