"""A plan looked at again: by a receiver of its waypoints, and when it comes late."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from agents.kernel.levels import Altitude, lines, steady
from agents.planner.answer import (
    Field,
    Kind,
    Plan,
    Reason,
    RequestError,
    Source,
    Status,
    Subject,
)
from agents.planner.judge.profile import flyable_profile, speed_faults
from agents.planner.judge.validator import CHECKS
from agents.planner.request.climbs import check_climbs, in_plane
from agents.planner.request.options import Narrowed, Options, check
from agents.planner.request.pruning import unproven_exclusions
from agents.planner.request.reports import Intruder, check_altitude, reports_in_air
from agents.planner.request.request import check_request, in_wind
from agents.planner.search.airspace import add_areas, check_areas
from agents.planner.search.candidates import find_violations
from agents.planner.search.climbs import on_profile
from envs.areas import Area
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.profile import Profile
from envs.trees import take
from envs.waypoints import RoutePoint, Waypoint, legs, plan_states
from envs.wind import Wind

JOIN = 5
"""Least time to the waypoint at which a late plan is joined, time steps; a shorter leg turns hard
on any error.
"""


def reconstruct(waypoints: tuple[Waypoint, ...], wind: Wind | None = None) -> Plan:
    """Return a plan as a receiver of its waypoints and its wind has it: only SAFE ones have any."""
    return Plan(
        status=Status.SAFE if waypoints else Status.UNRESOLVED,
        source=Source.NONE,
        reasons=(),
        min_separation=np.nan,
        time_of_min_separation=np.nan,
        goal_index=None,
        rejoin_time=np.nan,
        excluded=(),
        waypoints=waypoints,
        wind=wind,
    )


def recheck(  # noqa: PLR0913 - a plan, and all of a request
    plan: Plan,
    late: float,
    own: VehicleState[Ground],
    intruders: Sequence[VehicleState[Ground] | Intruder[Ground]],
    route: Sequence[RoutePoint],
    options: Options,
    own_altitude: Altitude | None = None,
    wind: Wind | None = None,
    *,
    areas: Sequence[Area] = (),
) -> Plan:
    """Return a plan as checked some time after its request, by what is there then: SAFE only if it
    still is.

    Args:
        plan: as it was made.
        late: how long after its request it is found, s.
        own: these, the wind and the areas as of then, as :func:`agents.planner.planner.plan` takes
            them.
    """
    if not plan.safe or late <= 0.0:
        return plan
    least = JOIN * options.aircraft.dt
    remaining = [
        replace(point, time=point.time - late)
        for point in plan.waypoints
        if point.time - late >= least
    ]
    try:
        check(options)
        climbs = any(point.altitude is not None for point in remaining)
        check_altitude(Field(Subject.OWN_ALTITUDE), own_altitude)
        options, kept_height = in_plane(own_altitude, check_areas(areas), options)
        if climbs and kept_height:
            raise RequestError(kept_height[0].field, kept_height[0].text)
        in_air = in_wind(options, wind)
        # Who is above or below a plan that climbs depends on it.
        level_altitude = None if climbs else own_altitude
        request, excluded, level = check_request(
            own, intruders, route, in_air, level_altitude, wind
        )
        flight, profile = steady(own_altitude), None
        if climbs:
            altitude, _, in_air = check_climbs(own_altitude, route, areas, in_air)
            profile = _profile(remaining, altitude, in_air)
            flight = lines(profile, altitude, in_air.vertical_margin)
            reports = reports_in_air(intruders, wind)
            request, _ = on_profile(request, [reports[n] for n in level], flight, in_air)
        request, _ = add_areas(request, areas, flight, in_air, wind)
    except RequestError as error:
        return _void(plan, late, str(error))
    curve = take(plan_states(own, remaining, wind=wind), None)
    findings = find_violations(curve, request, in_air)
    nearer = unproven_exclusions(excluded, remaining[-1]) if remaining else []
    if nearer:
        return _void(plan, late, nearer[0].message, nearer[0].kind)
    wrong = [CHECKS[number] for number in np.flatnonzero(findings.wrong[0])]
    if wrong:
        why = f"from the states by then it fails the checks: {', '.join(wrong)}"
        return _void(plan, late, why, Kind(wrong[0]))
    # The leg from the states by then is another one than that planned.
    too_fast = speed_faults(profile, take(legs(curve), 0), in_air.limits) if profile else []
    if too_fast:
        return _void(plan, late, too_fast[0].message, too_fast[0].kind)
    return plan


def _profile(waypoints: Sequence[Waypoint], own: Altitude, options: Options[Narrowed]) -> Profile:
    """Return the profile of a plan that climbs, as it goes on from an altitude.

    Raises:
        RequestError: the aircraft cannot go on with it.
    """
    try:
        return flyable_profile(waypoints, own, options)
    except ValueError as problem:
        raise RequestError(Field(Subject.OWN_ALTITUDE), f"is off the plan's: {problem}") from None


def _void(plan: Plan, late: float, why: str, kind: Kind = Kind.SEPARATION) -> Plan:
    """Return a plan that is not SAFE any more, with the reason; where its request is refused by
    then no separation is proven.
    """
    message = f"plan was found {late:.1f} s after the request and is too late: {why}"
    reason = Reason(kind, "plan", message)
    return replace(plan, status=Status.UNRESOLVED, reasons=(reason,))
