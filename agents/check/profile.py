"""The profile of a plan that climbs and descends: whether it can be flown, and what it keeps.

Altitude is linear between two waypoints. From the request on the ownship keeps its climb until the
first corner, from which on it is on a line to the first waypoint's altitude (theorem
``first_leg``).
"""

from itertools import pairwise
from typing import NamedTuple

from .balls import EIGHT, TWO, ZERO, Ball, J, ball
from .certificate import ARCS, Area, Certificate, Levels, Profile
from .leg import Flight
from .limits import air_limits
from .refusal import demand
from .tolerances import FINE, LEVEL

_STEADY = 1e-9
"""A change of climb that is none but for rounding, m/s."""


class Piece(NamedTuple):
    """A part of a profile between two corners."""

    begin: Ball  # s after the request
    end: Ball
    altitude: Ball  # at its beginning, m
    climb: Ball  # m/s


def pieces_of(certificate: Certificate, profile: Profile, levels: Levels) -> list[Piece]:
    """Return the pieces of a profile from the request to the last waypoint."""
    times = [ball(state.time) for state in certificate.plan_states]
    altitudes = [ball(altitude) for altitude in profile.altitudes]
    start, climb = (ball(levels.low) + ball(levels.high)) / TWO, ball(profile.climb)
    change = first_change(altitudes[0] - start, climb, times[1], ball(profile.acceleration))
    corner = lead(change, profile)
    pieces = [
        Piece(ZERO, corner, start, climb),
        Piece(corner, times[1], start + climb * corner, climb + change),
    ]
    for (begin, end), (first, last) in zip(pairwise(times[1:]), pairwise(altitudes), strict=True):
        pieces.append(Piece(begin, end, first, (last - first) / (end - begin)))
    return pieces


def first_change(rise: Ball, climb: Ball, time: Ball, acceleration: Ball) -> Ball:
    """Return by how much the climb changes at the first corner, m/s, so that the ownship has risen
    by so much, m, at a time, s.

    The change is 2 D / (T + sqrt(T^2 - 2 |D| / a)), with D the rise less climb T: the same as in
    the theorem ``first_leg``, without a difference of what is nearly the same.
    """
    more = rise - climb * time
    discriminant = time * time - TWO * more.magnitude() / acceleration
    demand(discriminant.lo >= 0, "the altitude of waypoint 0 cannot be reached in its time")
    return TWO * more / (time + discriminant.root())


def lead(change: Ball, profile: Profile) -> Ball:
    """Return how long before its corner a change of climb begins, and how long after it it ends,
    s.
    """
    return change.magnitude() / (TWO * ball(profile.acceleration))


def spread_of(profile: Profile, levels: Levels) -> Ball:
    """Return by how much the ownship is beside its profile at most: margin and error, m."""
    return ball(profile.margin) + (ball(levels.high) - ball(levels.low)) / TWO


def check_profile(certificate: Certificate, flight: Flight) -> None:
    """Check that a profile, if there is one, can be flown, and keeps floor, ceiling and the speed
    limit.
    """
    profile, levels = certificate.profile, certificate.levels
    if profile is None or levels is None:
        return
    pieces = pieces_of(certificate, profile, levels)
    check_climbs(profile, pieces)
    check_corners(profile, pieces)
    heights = [*(piece.altitude for piece in pieces), ball(profile.altitudes[-1])]
    check_levels(profile, heights, spread_of(profile, levels))
    check_levels_of_areas(profile, certificate.areas)
    check_speeds(certificate, pieces, flight)


def check_climbs(profile: Profile, pieces: list[Piece]) -> None:
    """Check that climbs and descents keep their limits; the climb at the request, which changes
    from then on, is what it is.
    """
    fine = ball(FINE).lo
    most, least = ball(profile.climb_max).lo + fine, -ball(profile.descent_max).lo - fine
    for piece in pieces[1:]:
        inside = least <= piece.climb.lo and piece.climb.hi <= most
        demand(inside, "profile climbs or descends faster than its limits")


def check_corners(profile: Profile, pieces: list[Piece]) -> None:
    """Check that the change of climb at a corner begins when that at the one before has ended, and
    leaves the profile by no more than the margin (theorem ``flown_near_linear``).
    """
    changed, fine = 0, ball(LEVEL).lo
    margin = ball(profile.margin).lo + fine
    for before, piece in pairwise(pieces):
        change = piece.climb - before.climb
        if change.magnitude().hi <= ball(_STEADY).lo:
            continue
        half = lead(change, profile)
        apart = (piece.begin - half).lo >= changed - fine
        demand(apart, "the corners of profile are too near to each other")
        rounding = change * change / (EIGHT * ball(profile.acceleration))
        demand(rounding.hi <= margin, "a corner of profile leaves it by more than its margin")
        changed = (piece.begin + half).hi


def check_levels(profile: Profile, heights: list[Ball], spread: Ball) -> None:
    """Check that floor and ceiling are kept with a spread, m, at the request and all corners; what
    begins nearer must not go farther (theorem ``keeps_level``).
    """
    for name, level, side in (
        ("floor", profile.floor, ball(1.0)),
        ("ceiling", profile.ceiling, ball(-1.0)),
    ):
        if level is None:
            continue
        room = [side * (height - ball(level)) for height in heights]
        least = min(spread.hi, room[0].lo) - ball(LEVEL).lo
        demand(min(place.lo for place in room) >= least, f"profile does not keep its {name}")


def check_levels_of_areas(profile: Profile, areas: list[Area]) -> None:
    """Check that floor and ceiling of a profile are within those of the areas to be kept in."""
    for number, area in enumerate(areas):
        if area.keep == "out":
            continue
        floor, ceiling = area.heights
        above = floor is None or (profile.floor is not None and profile.floor >= floor)
        below = ceiling is None or (profile.ceiling is not None and profile.ceiling <= ceiling)
        demand(above and below, f"area {number} is to be kept in, between other levels")


def check_speeds(certificate: Certificate, pieces: list[Piece], flight: Flight) -> None:
    """Check that the speed along the profile keeps the limit; what begins faster may stay so."""
    begins = speed_along(flight.arcs[0].speed, pieces[0].climb)
    most = max(air_limits(certificate).speed_max.lo, begins.lo) + ball(FINE).lo
    for number, arc in enumerate(flight.arcs):
        leg = number // ARCS
        # The first leg has two pieces, all others have one.
        for piece in pieces[:2] if leg == 0 else pieces[leg + 1 : leg + 2]:
            slow_enough = speed_along(arc.top_speed, piece.climb).hi <= most
            demand(slow_enough, "the speed along profile leaves its limit")


def speed_along(over_horizon: Ball, climb: Ball) -> Ball:
    """Return the speed of an aircraft that climbs, m/s."""
    return (over_horizon + J * climb).magnitude()
