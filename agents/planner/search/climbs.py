"""Climbs and descents: profiles of altitude that pass above or below what lies on the route.

A profile does not depend on what is flown over the ground: on it an intruder counts only while it
may be level, and the plan in the plane is made with those that count. So first the way straight
along the route is asked which intruders come near, and when; a profile that is above or below them
by then is flown along that way. Where none is found, plans in the plane are made on the profiles
that leave the fewest intruders.
"""

import itertools
import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from agents.kernel.areas import ActiveArea, area_clearance
from agents.kernel.clearance import clearance
from agents.kernel.levels import Altitude, Line
from agents.kernel.separation import separation
from agents.kernel.traffic import Traffic
from agents.kernel.trajectory import trajectory
from agents.planner.answer import Field, RequestError, Subject
from agents.planner.judge.profile import profile_faults
from agents.planner.request.options import L, Options
from agents.planner.request.reports import Intruder, level_columns
from agents.planner.request.request import Request
from envs.aircraft import Vertical
from envs.areas import Area
from envs.frames import Air
from envs.profile import Profile, climbing, first_corner, rise_to_level
from envs.trees import map_leaves
from envs.waypoints import PlanStates

RATES = (1.0, 0.5)
"""Of the greatest climb and descent, with which profiles leave and regain the route's altitude."""

CLIMB_LEGS = 4
"""Legs at most in which a profile leaves the route's altitude."""

WAITS = (0, 2, 5)
"""Legs that a profile waits longer than the intruders on the way ask for."""


class Conflict(NamedTuple):
    """When an intruder or an area comes too near on the way along the route, were it level."""

    other: Intruder[Air] | Area
    begin: float  # s after the request
    end: float


class Start(NamedTuple):
    """Where profiles begin, and what they are made for."""

    own: Altitude  # of the ownship at the request; its vertical speed is known
    target: float  # altitude of the route, m
    times: Sequence[float]  # of the waypoints but the last, s

    @property
    def climb(self) -> float:
        """Vertical speed at the request, m/s."""
        return self.own.climb(0.0)[0]


def on_profile(
    request: Request, reports: Sequence[Intruder[Air]], flight: Sequence[Line], options: Options[L]
) -> tuple[Request, list[int]]:
    """Return one request ``[1]`` with each intruder once for every time in which it counts, and
    the numbers of the reports that they are.

    Args:
        request: with all intruders, each of which counts always.
        reports: of its intruders.
        flight: altitude of the ownship.
        options: of the flight.
    """
    numbers, window = level_columns(reports, flight, options)
    traffic: Traffic = map_leaves(lambda field: field[:, numbers], request.traffic)
    return request._replace(traffic=traffic._replace(window=window)), numbers


def conflicts(
    plan_states: PlanStates[Air],
    request: Request,
    reports: Sequence[Intruder[Air]],
    areas: Sequence[Area],
    options: Options[L],
) -> list[Conflict]:
    """Return when intruders and areas come too near to a plan ``[1, W]`` of one request ``[1]``,
    were they level all the time.

    Args:
        plan_states: of the plan.
        request: with all intruders, each of which counts always.
        reports: of its intruders.
        areas: in the air mass.
        options: of the flight.
    """
    own, flown = request.own, trajectory(plan_states)
    active = [
        ActiveArea(number, area, max(area.valid_from, 0.0), area.valid_until)
        for number, area in enumerate(areas)
    ]
    met = list[Conflict]()
    for others, constraint in (
        (reports, separation(request.traffic, own, options.requirement)),
        (areas, area_clearance(active, own.x, own.y, options.requirement.margin)),
    ):
        lost = clearance(flown, constraint)
        times = zip(others, lost.loss[0].tolist(), lost.until[0].tolist(), strict=True)
        met += [Conflict(*time) for time in times if time[1] < math.inf]
    return met


def nominal(start: Start, options: Options[L]) -> Profile:
    """Return the profile that regains the route's altitude as soon as may be, and keeps it; from a
    climb that cannot change so far at once it levels off first.

    Raises:
        RequestError: no plan lasts long enough for that.
    """
    why, acceleration = "", options.vertical.acceleration
    level = start.own.value + rise_to_level(start.climb, acceleration)
    for times, altitudes in (([], []), ([start.times[0]], [level])):
        profile = _back(start, times, altitudes, options.vertical, 1.0)
        if profile is None:
            continue
        faults = profile_faults(profile, start.own, options)
        if not faults:
            return profile
        why = why or f": {faults[0].message}"
    problem = (
        f"is {start.own.value:g} m, {start.target - start.own.value:+.0f} m from the route's, "
        f"expected one that can be regained within a plan{why}"
    )
    raise RequestError(Field(Subject.OWN_ALTITUDE, "value"), problem)


def profiles(start: Start, until: float, options: Options[L]) -> Iterator[Profile]:
    """Yield profiles that leave the route's altitude and regain it after a time, s: with full and
    half rate, up and down; the cheapest first.
    """
    for profile in sorted(_climbs(start, until, options.vertical), key=climbed):
        if not profile_faults(profile, start.own, options):
            yield profile


def climbed(profile: Profile) -> float:
    """Return how many metres a profile climbs and descends."""
    return float(np.abs(np.diff(profile.altitude)).sum())


def _climbs(start: Start, until: float, vertical: Vertical) -> Iterator[Profile]:
    """Yield profiles that leave the route's altitude, and regain it after a time, s."""
    times = start.times
    over = next((leg for leg, time in enumerate(times) if time >= until), len(times))
    for up, rate, leg in itertools.product((True, False), RATES, range(CLIMB_LEGS)):
        climb = rate * (vertical.climb_max if up else -vertical.descent_max)
        corner = first_corner(climb - start.climb, vertical.acceleration)
        rise = start.climb * corner + climb * (times[leg] - corner)
        reached = start.own.value + rise
        back_in = abs(reached - start.target) / (
            rate * (vertical.climb_max if reached < start.target else vertical.descent_max)
        )
        # Who stays near until the end is left at last when the altitude can just be regained.
        latest = bisect_right(times, times[-2] - back_in) - 1
        for leave in sorted({min(max(over + wait, leg + 1), latest) for wait in WAITS}):
            if leave > leg:
                altitudes = [reached, reached]
                regained = _back(start, [times[leg], times[leave]], altitudes, vertical, rate)
                if regained is not None:
                    yield regained


def _back(
    start: Start,
    times: Sequence[float],
    altitudes: Sequence[float],
    vertical: Vertical,
    rate: float,
) -> Profile | None:
    """Return the profile through altitudes, m, at times, s, and then as soon as may be to the
    route's altitude, with a rate of the greatest climb or descent at most; None: not in time.
    """
    last = start.times[-1]
    for reached in start.times[:-1]:
        if times and reached <= times[-1]:
            continue
        try:
            profile = climbing(
                start.own.value,
                start.climb,
                [*times, reached, last],
                [*altitudes, start.target, start.target],
                acceleration=vertical.acceleration,
            )
        except ValueError:
            continue
        climb = float(profile.climbs[-2])
        if -rate * vertical.descent_max <= climb <= rate * vertical.climb_max:
            return profile
    return None
