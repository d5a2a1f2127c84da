"""Whether an aircraft whose newest report cannot be planned with can matter at all.

At the edge of a receiver's range many aircraft stop reporting. One that is so far away, or so high,
that it cannot come near while a plan lasts is left out by its last places: each of them, grown by
what the aircraft may have flown since, must lie beyond what both can fly until the end.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from agents.kernel.levels import Altitude, vertical_gap
from agents.planner.request.options import L, Options
from envs.formats.local_frame import distance
from ros_bridge.core.areas import above_ellipsoid
from ros_bridge.core.categories import Categories
from ros_bridge.core.fields import SECOND, Sighting
from ros_bridge.core.reports import FASTEST, Report
from ros_bridge.core.tracks import ReportCheck, Track

_CLIMB = 30.0
"""Vertical speed that may have been taken up since the last report, m/s."""


@dataclass(frozen=True, slots=True)
class Reach:
    """What matters to an ownship."""

    own: Report
    moment: int  # ns
    horizon: float  # for how long a plan lasts at most, s
    separation: float  # to be kept horizontally, m
    vertical: float  # vertical separation beyond which an aircraft is left out, m
    speed: float  # highest of the ownship, m/s
    traffic: float  # an aircraft may fly as fast as this whatever it last reported, m/s
    undulation: float | None = None  # height of the geoid above the ellipsoid, m; None: unknown
    unknown_climb: float = 10.0  # either way of aircraft whose vertical speed is unknown, m/s

    @classmethod
    def of_plans(
        cls,
        options: Options[L],
        own: Report,
        moment: int,
        horizon: float,
        wind: float,
        categories: Categories,
        undulation: float | None,
    ) -> "Reach":
        """Return what matters to plans with options, by the greatest separations of all; over the
        ground all are faster by the ``wind``, m/s, at most.
        """
        separation, vertical = categories.greatest(
            options.requirement.separation, options.vertical_separation
        )
        own, separation = with_climbs(own, options), separation + options.requirement.margin
        speed, traffic = options.limits.speed_max + wind, options.aircraft.traffic_speed_max + wind
        climb = options.unknown_climb
        return cls(own, moment, horizon, separation, vertical, speed, traffic, undulation, climb)


def level(
    altitude: Altitude | None, age: int, undulation: float | None, unknown_climb: float
) -> Altitude | None:
    """Return an altitude carried over an age (ns), above the ellipsoid where the undulation is
    known.

    Where the vertical speed is unknown the value stays, and its error grows by ``unknown_climb``,
    m/s.
    """
    if altitude is None:
        return None
    seconds = age / SECOND
    climb, spread = altitude.climb(unknown_climb)
    value, error = altitude.value + climb * seconds, altitude.error + spread * abs(seconds)
    reference = altitude.reference
    if reference == "msl" and undulation is not None:
        value, reference = value + undulation, "wgs84"
    # Not by replace, which takes four times as long: it is done for all aircraft at every step.
    return Altitude(value, reference, altitude.vertical_speed, error, altitude.climb_error)


def comparable(options: Options[L], undulation: float | None) -> Options[L]:
    """Return options whose floor and ceiling are above the ellipsoid where the undulation is known,
    as :func:`level` has altitudes.
    """
    if undulation is None or not options.climbs:
        return options
    floor, ceiling = (
        above_ellipsoid(limit, undulation) for limit in (options.floor, options.ceiling)
    )
    return replace(options, floor=floor, ceiling=ceiling)


def with_climbs(own: Report, options: Options[L]) -> Report:
    """Return the ownship's report with an altitude that any plan may make of it: it may climb and
    descend, and leave its plan by the vertical margin.
    """
    if own.altitude is None or not options.climbs:
        return own
    climb, spread = own.altitude.climb(options.unknown_climb)
    most = max(options.vertical.climb_max, options.vertical.descent_max, abs(climb) + spread)
    error = own.altitude.error + options.vertical_margin
    altitude = replace(own.altitude, vertical_speed=0.0, error=error, climb_error=most)
    return replace(own, altitude=altitude)


def vertically_apart(own: Report, altitude: Altitude | None, time: int, reach: Reach) -> float:
    """Return by how much an aircraft with an altitude at a time (ns) stays above the ownship until
    the horizon, m, negative where it stays below.

    It is 0 where altitudes are unknown or of different references, or they may pass each other.
    """
    mine = level(own.altitude, reach.moment - own.time, reach.undulation, reach.unknown_climb)
    theirs = level(altitude, reach.moment - time, reach.undulation, reach.unknown_climb)
    if mine is None or theirs is None:
        return 0.0
    return vertical_gap(mine, theirs, 0.0, reach.horizon, reach.unknown_climb)


def out_of_reach(track: Track, reach: Reach) -> str | None:
    """Return why an aircraft cannot come near by any of its last places, or None."""
    if track.last is None and any(sighted.sighting.place is None for sighted in track.sightings):
        return None  # a second aircraft without a place may bear the name
    reasons = [
        _reason_out_of_reach(place, speed, reach) for place, speed in _places(track, reach.traffic)
    ]
    return reasons[0] if reasons and all(reasons) else None


def _reach_of_both(speed: float, time: int, reach: Reach) -> float:
    """Return how far an aircraft, m/s, since a time (ns), and the ownship can come until the
    horizon, m.
    """
    age = max((reach.moment - time) / SECOND, 0.0)
    own_age = abs(reach.moment - reach.own.time) / SECOND
    return speed * (age + reach.horizon) + reach.speed * (own_age + reach.horizon)


def _places(track: Track, least: float) -> Iterator[tuple[Sighting, float]]:
    """Yield where and how fast the aircraft may have been: unusable messages, its last good report,
    a rival's.
    """
    for sighted in track.sightings:
        if sighted.sighting.place is not None:
            yield sighted.sighting._replace(time=sighted.time), FASTEST
    rival = None if track.rival is None else track.rival.newest
    # Its altitude goes on as is believed of it.
    last = track.last
    if last is not None and track.estimate is not None:
        last = replace(last, altitude=track.estimate.altitude)
    for report in (last, rival):
        if report is not None:
            # Where places and velocities contradict each other, neither is believed.
            doubtful = track.fault is not None and track.fault.check is ReportCheck.CONTRADICTION
            yield (
                report.sighting,
                FASTEST if doubtful else max(math.hypot(report.east, report.north), least),
            )


def _reason_out_of_reach(sighting: Sighting, speed: float, reach: Reach) -> str | None:
    """Return why an aircraft that was seen at a place cannot come near until the horizon,
    or None.
    """
    assert sighting.place is not None and sighting.time is not None
    own, age = reach.own, max((reach.moment - sighting.time) / SECOND, 0.0)
    metres = distance(*own.place, *sighting.place)
    ending = f"{age:.1f} s ago, and cannot come near within {reach.horizon:.0f} s"
    if metres - _reach_of_both(speed, sighting.time, reach) > reach.separation:
        return f"was {metres / 1e3:.0f} km away {ending}"
    gap = vertically_apart(own, sighting.altitude, sighting.time, reach)
    if abs(gap) - _CLIMB * age > reach.vertical:
        return f"was {abs(gap):.0f} m {'above' if gap > 0.0 else 'below'} {ending}"
    return None
