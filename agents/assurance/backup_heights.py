"""The altitude of backups: they level off at once, or climb or descend at the greatest rate.

A backup that climbs does so until a leg ends from which on the ceiling would be too near, and is
level after that; so its corners are at its plan states, whose altitudes say all of it.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import accumulate

import numpy as np

from agents.assurance.backup import (
    Around,
    Sense,
    Surroundings,
    climb_of,
    durations,
    sample_times,
)
from agents.assurance.climbs import BackupMeets, Met
from agents.kernel.levels import Altitude, Gap, Line, gap_between, lines, steady
from agents.kernel.traffic import Traffic
from agents.planner.judge.profile import profile_faults
from agents.planner.request.options import L, Options
from agents.planner.request.reports import Intruder
from envs.arrays import Array, Float, Int
from envs.frames import F
from envs.profile import (
    Height,
    Profile,
    climbing,
    first_corner,
    largest_change,
    levelling,
    rise_to_level,
)
from envs.trees import take


def in_space(
    traffic: Traffic, find_met: Callable[[Sense, Int[Array, " M"]], BackupMeets]
) -> Around:
    """Return what is around ownships ``[N]`` among intruders ``[N, K]``, by what is met in a
    sense.
    """

    def find(sense: Sense, rows: Array) -> Surroundings:
        met, possible, share = find_met(sense, rows)
        shares = np.repeat(share, met.times, axis=1)
        return Surroundings(met.columns(take(traffic, rows)), met.areas, possible, shares)

    return Around(tuple(Sense), find)


def backup_profile(sense: Sense, own: Altitude | None, options: Options[L]) -> Profile | None:
    """Return the profile of a backup from an altitude; None: there is none, because altitude or
    vertical speed is unknown, or the climb cannot change within the first leg, or floor or ceiling
    is too near or of another reference.

    One that climbs or descends does so at the greatest rate to which the climb can change at once
    within the vertical margin, until it would come too near to ceiling or floor.
    """
    if own is None or own.vertical_speed is None:
        return None
    climb, acceleration = own.vertical_speed, options.vertical.acceleration
    if sense is Sense.LEVEL_OFF:
        return levelling(Height(own.value, climb), acceleration)
    limit = options.ceiling if sense is Sense.CLIMB else options.floor
    if limit is not None and limit.reference != own.reference:
        return None
    rate, ends = _rate(sense, climb, options), list(accumulate(durations(options)))
    corner = first_corner(rate - climb, acceleration)
    if corner > ends[0]:
        return None
    for end in reversed(ends):
        reached = own.value + climb * corner + rate * (end - corner)
        profile = climbing(
            own.value, climb, [end, end + 1.0], [reached, reached], acceleration=acceleration
        )
        if not profile_faults(profile, own, options):
            return profile
    return None


def _rate(sense: Sense, climb: float, options: Options[L]) -> float:
    """Return the vertical speed that a backup of a sense changes to from a climb, m/s: from the
    lines of its profile it is off by no more than the vertical margin, as a plan is.
    """
    most = largest_change(options.vertical_margin, options.vertical.acceleration)
    return min(max(climb_of(sense, options), climb - most), climb + most)


def backup_flight(sense: Sense, own: Altitude | None, options: Options[L]) -> tuple[Line, ...]:
    """Return the altitude of a backup from an altitude; none: it is unknown, or there is no such
    backup. Where the vertical speed is unknown, one that levels off keeps it.
    """
    profile = backup_profile(sense, own, options)
    if own is None or profile is None:
        return steady(own) if sense is Sense.LEVEL_OFF else ()
    acceleration, climb = options.vertical.acceleration, own.climb(0.0)[0]
    # Whose climb is off by some more takes as much more to change it.
    change = abs(_rate(sense, climb, options) - climb)
    farther = rise_to_level(change + own.climb_error, acceleration)
    farther -= rise_to_level(change, acceleration)
    return lines(profile, replace(own, error=own.error + farther), options.vertical_margin)


def shares_kept(
    reports: Sequence[Intruder[F]], flight: Sequence[Line], options: Options[L]
) -> Float[Array, "K S"]:
    """Return which share of the vertical separation is kept from intruders at the times of
    :func:`agents.assurance.backup.sample_times`; 0 where an altitude is unknown.
    """
    times, unknown = sample_times(options), options.unknown_climb
    shares = np.zeros((len(reports), times.size))
    for begin, end, own in flight:
        numbers, separations, gaps = list[int](), list[float](), list[Gap]()
        for number, report in enumerate(reports):
            other, separation = report.altitude, report.vertical(options)
            if other is not None and other.reference == own.reference:
                numbers.append(number)
                separations.append(separation)
                gaps.append(gap_between(own, other, report.age, separation, unknown))
        if not gaps:
            break
        vertical, gap = np.array(separations)[:, None], Gap(*np.array(gaps).T[..., None])
        climb, own_spread = own.climb(unknown)
        during = np.flatnonzero((times >= begin) & (times <= end))
        above = np.abs(gap.above + (gap.climb - climb) * times[during])
        errors = gap.near - vertical + (gap.widens + own_spread) * times[during]
        shares[np.array(numbers)[:, None], during] = np.maximum(above - errors, 0.0) / vertical
    return shares


def backups_met(
    sense: Sense,
    flights: Sequence[Sequence[Line]],
    reports: Sequence[Sequence[Intruder[F]]],
    met: Met,
    options: Options[L],
) -> BackupMeets:
    """Return what backups of a sense meet, ``[M]``, by their altitudes (:func:`backup_flight`), the
    intruders ``[K]`` about each, and when these count. One that climbs or descends is possible only
    where its altitude is known.
    """
    possible = [sense is Sense.LEVEL_OFF or bool(flight) for flight in flights]
    shares = [
        shares_kept(intruders, flight, options)
        for intruders, flight in zip(reports, flights, strict=True)
    ]
    return BackupMeets(met, np.array(possible, dtype=bool), np.stack(shares))
