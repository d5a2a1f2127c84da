"""What leaves the planner: the best plan of a request as waypoints, SAFE or with the reasons why
not.

SAFE is decided here: by the validator for the plan's states, by the audit for the waypoints, by how
long the intruders that were left out stay out of the way, and where the plan climbs by its
altitudes and its speeds on the climbs. A plan that comes late is judged again
(:mod:`agents.planner.recheck`).
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from agents.kernel.areas import ActiveArea, label
from agents.kernel.levels import Altitude
from agents.kernel.traffic import separations, within_window
from agents.planner.answer import (
    Advisory,
    AdvisoryCode,
    Counts,
    Excluded,
    Kind,
    Plan,
    Reason,
    Source,
    Status,
)
from agents.planner.judge.audit import audit
from agents.planner.judge.profile import profile_faults, speed_faults
from agents.planner.judge.validator import CHECKS, Findings
from agents.planner.request.options import Narrowed, Options
from agents.planner.request.pruning import unproven_exclusions
from agents.planner.request.request import BEYOND, Request
from agents.planner.search.candidates import Candidates, Plans
from agents.planner.search.goals import next_goals
from envs.area_geometry import signed_distance
from envs.areas import Keep
from envs.arrays import Array
from envs.frames import Air
from envs.profile import Profile, on_profile, profile_of
from envs.trees import take
from envs.waypoints import PlanStates, RoutePoint, Waypoint, legs, on_ground
from envs.wind import Wind

_SAME = 1e-6
"""By how much published altitudes may differ from those judged, m: so much more than the vertical
separation is kept (:mod:`agents.kernel.levels`)."""

_SOURCES = (Source.NONE, Source.POLICY, Source.FALLBACK, Source.VERTICAL)


class Posed(NamedTuple):
    """One request ``[1]`` as it was searched."""

    request: Request
    excluded: tuple[Excluded, ...]  # the intruders that were left out
    # numbers of the others, as they stand in the request: once for every time in which they count
    counted: list[int]
    options: Options[Narrowed]  # with the floor and the ceiling of its areas
    notes: tuple[Advisory, ...] = ()  # on its areas
    profile: Profile | None = None  # that its plan climbs and descends on; None: one in the plane


def publish(
    posed: Posed,
    plans: Plans,
    next_goal: int,
    route: Sequence[RoutePoint],
    own_altitude: Altitude | None,
    skipped: tuple[str, ...] = (),
) -> Plan:
    """Write the plan of one request ``[1]`` over the ground.

    Args:
        posed: the request.
        plans: the best plan of it, ``[1]``.
        next_goal: number of the first point of the route that may be rejoined at; -1: there is
            none.
        route: that was asked for.
        own_altitude: of the ownship at the request.
        skipped: what the deadline left out of the search.
    """
    request, excluded, counted, options = posed[:4]
    best = _number_points(_best_on_ground(request, plans), request)
    waypoints = _waypoints(best, route, posed.profile)
    faults = _faults(waypoints, route, excluded, options)
    if posed.profile is not None and own_altitude is not None and waypoints:
        air_states = take(plans.candidates.plan_states, 0)
        faults += _climb_faults(waypoints, air_states, posed.profile, own_altitude, options)
    judged_safe = bool(best.findings.safe)
    safe = judged_safe and not faults
    reasons = [] if judged_safe else _reasons(request, best, next_goal, counted, options)
    reasons += faults
    if skipped and not safe:
        reasons.append(_out_of_time(skipped, options))
    exists = bool(waypoints)
    return Plan(
        status=Status.SAFE if safe else Status.UNRESOLVED,
        source=_SOURCES[int(plans.source[0])] if exists else Source.NONE,
        reasons=tuple(reasons),
        min_separation=float(best.min_separation),
        time_of_min_separation=float(best.findings.time_of_min_separation),
        goal_index=route[int(best.goal)].index if exists else None,
        rejoin_time=float(best.rejoin_time),
        excluded=excluded,
        waypoints=waypoints,
        cost=float(best.cost) if exists else np.nan,
        advisories=_policy_unsafe() if safe and not plans.policy_safe[0] else (),
        unsearched=skipped,
        windows=_windows(request, counted),
    )


def _faults(
    waypoints: Sequence[Waypoint],
    route: Sequence[RoutePoint],
    excluded: Sequence[Excluded],
    options: Options[Narrowed],
) -> list[Reason]:
    """Return what is wrong with what is published, whatever the validator says of its states."""
    if not waypoints:
        return []
    reasons = audit(waypoints, route, count=options.waypoints, extended=options.extend_route)
    return reasons + unproven_exclusions(excluded, waypoints[-1])


def _climb_faults(
    waypoints: Sequence[Waypoint],
    air_states: PlanStates[Air],
    judged: Profile,
    own: Altitude,
    options: Options[Narrowed],
) -> list[Reason]:
    """Return what is wrong with the altitudes that are published, and with the speeds on their
    climbs, for the aircraft that flies them; they are those of the profile that was judged.
    """
    try:
        profile = profile_of(own.value, own.climb(0.0)[0], waypoints, options.vertical.acceleration)
    except ValueError as problem:
        return [Reason.of(Kind.CLIMB, "altitudes", f"cannot be flown: {problem}")]
    if profile is None:
        return [Reason.of(Kind.CLIMB, "altitudes", "are missing, expected one at each waypoint")]
    faults = profile_faults(profile, own, options)
    off = float(np.abs(profile.at(judged.time) - judged.altitude).max())
    if not off <= _SAME:
        faults.append(Reason.of(Kind.CLIMB, "altitudes", f"are {off:.3f} m off those judged"))
    return faults + speed_faults(profile, legs(air_states), options.limits)


def _out_of_time(skipped: Sequence[str], options: Options[Narrowed]) -> Reason:
    """Return that the deadline left something out of the search."""
    text = f"options.deadline_s of {options.deadline_s:g} s was reached before: "
    return Reason(Kind.DEADLINE, "options.deadline_s", text + ", ".join(skipped))


def _policy_unsafe() -> tuple[Advisory, ...]:
    """Return the advisory that the policy's own plan was not safe, and another is given."""
    text = "to the next point of the route was not safe"
    return (Advisory(AdvisoryCode.POLICY_UNSAFE, "the policy's own plan", text),)


def _best_on_ground(request: Request, plans: Plans) -> Candidates:
    """Return the best plan ``[]`` with its states, and the places of its findings, over the
    ground.
    """
    best = take(plans.candidates, 0)
    if request.drift is None:
        return best
    east, north = (-float(part[0]) for part in request.drift)
    findings = best.findings
    x, y = findings.x + east * findings.time, findings.y + north * findings.time
    return best._replace(
        plan_states=on_ground(best.plan_states, Wind(east, north)),
        findings=findings._replace(x=x, y=y),
    )


def _number_points(best: Candidates, request: Request) -> Candidates:
    """Return a plan ``[]`` with its points numbered as in the route that was asked for."""
    if request.of_route is None or best.last < 0:
        return best
    number = request.of_route[0]
    # Round an area it goes on to the next point of the route. The last point may be beyond it.
    goal = number[int(best.goal) :]
    last = np.append(number, BEYOND)[min(int(best.last), number.size)]
    return best._replace(goal=goal[goal >= 0][0], last=last)


def _windows(request: Request, counted: Sequence[int]) -> tuple[Counts, ...]:
    """Return which intruders of one request ``[1]`` count for a while only."""
    window = request.traffic.window
    if window is None:
        return ()
    windows = zip(counted, window.begin[0].tolist(), window.end[0].tolist(), strict=True)
    return tuple(
        Counts(number, max(begin, 0.0), end)
        for number, begin, end in windows
        if begin > 0.0 or end < math.inf
    )


def _waypoints(
    best: Candidates, route: Sequence[RoutePoint], profile: Profile | None
) -> tuple[Waypoint, ...]:
    """Return the plan states after the request under indices that the route does not have, the
    last one under the route's where it is a point of it, with the altitudes of a profile; none
    without a plan.
    """
    if best.last < 0:
        return ()
    used = {point.index for point in route}
    rows = np.stack(best.plan_states, axis=-1)[1:].tolist()
    free = (index for index in range(len(route) + len(rows)) if index not in used)
    indices = [next(free) for _ in rows]
    if best.last < len(route):
        indices[-1] = route[int(best.last)].index
    points = tuple(Waypoint(index, *row) for index, row in zip(indices, rows, strict=True))
    return points if profile is None else on_profile(points, profile)


def _reasons(
    request: Request,
    best: Candidates,
    next_goal: int,
    counted: Sequence[int],
    options: Options[Narrowed],
) -> list[Reason]:
    """Return everything that the validator finds wrong with one request ``[1]`` and its best plan
    ``[]``, or why there is none.
    """
    separation = _separations_now(request, options)
    reasons = _begins_too_close(request, separation, counted) + _begins_inside(request)
    if next_goal < 0:
        return [*reasons, _no_goal(request, options)]
    if best.last < 0:
        return [*reasons, _no_plan(best, options)]
    findings, margin = best.findings, options.requirement.margin
    if request.areas is not None and findings.area >= 0:
        reasons.append(_area_finding(findings, request.areas.value, margin))
    close = int(findings.intruder)
    required = float(separation[close]) + margin if close >= 0 else np.nan
    return reasons + [
        _finding(findings, number, counted, required)
        for number in np.flatnonzero(findings.wrong).tolist()
        if CHECKS[number] != Kind.AREA.value
    ]


def _separations_now(request: Request, options: Options[Narrowed]) -> Array:
    """Return the separation that is to be kept from each intruder of one request, m, ``[K]``."""
    traffic = request.traffic
    separation = separations(traffic, options.requirement)
    return np.broadcast_to(separation, traffic.mask.shape)[0]


def _begins_too_close(request: Request, separation: Array, counted: Sequence[int]) -> list[Reason]:
    """Return the intruders that are closer than the separation at the request already."""
    own, traffic = request.own, request.traffic
    away = np.hypot(traffic.state.x - own.x[:, None], traffic.state.y - own.y[:, None])[0]
    counts = np.broadcast_to(within_window(traffic, 0.0, 0.0), traffic.mask.shape)[0]
    place = 0.0, float(own.x[0]), float(own.y[0])
    reasons = []
    for number, far, least, counting in zip(counted, away, separation, counts, strict=True):
        if counting and far < least:
            text = f"is {far:.1f} m away at the request, expected {least:.1f} m or more"
            reasons.append(Reason.of(Kind.START_IN_VIOLATION, f"intruders[{number}]", text, *place))
    return reasons


def _no_plan(best: Candidates, options: Options[Narrowed]) -> Reason:
    """Return why no manoeuvre was completed to a plan."""
    if best.too_short:
        text = "ends before the plan does and may not be extended"
        return Reason.of(Kind.ROUTE_TOO_SHORT, "route", text)
    text = f"cannot be rejoined within {options.rejoin_by:g} s by any manoeuvre that was tried"
    return Reason.of(Kind.NO_REJOIN, "route", text)


def _begins_inside(request: Request) -> list[Reason]:
    """Return the areas that forbid the place of the ownship at the request."""
    reasons, x, y = [], float(request.own.x[0]), float(request.own.y[0])
    for active in () if request.areas is None else request.areas.value:
        if active.begin > 0.0 or float(signed_distance(active.area, x, y)) >= 0.0:
            continue
        text = "is left by" if active.area.keep is Keep.IN else "holds"
        text = f"{text} the ownship at the request, expected it {_side(active)}"
        reasons.append(_of_area(Kind.START_IN_VIOLATION, active, text, 0.0, x, y))
    return reasons


def _area_finding(findings: Findings, areas: Sequence[ActiveArea], margin: float) -> Reason:
    """Return where the clearance from an area is lost first."""
    number = CHECKS.index(Kind.AREA.value)
    time, x, y = (float(field[number]) for field in (findings.time, findings.x, findings.y))
    lost = next(lost for lost in areas if lost.number == findings.area)
    text = (
        f"is not kept clear of from {time:.1f} s on, at {x:.0f} m east and {y:.0f} m north; "
        f"expected the ownship {_side(lost)} and {lost.area.clearance + margin:.1f} m or more "
        "from it"
    )
    return _of_area(Kind.AREA, lost, text, time, x, y)


def _side(active: ActiveArea) -> str:
    """Return on which side of an area flight is allowed."""
    return "inside" if active.area.keep is Keep.IN else "outside"


def _of_area(kind: Kind, active: ActiveArea, text: str, *place: float) -> Reason:
    """Return a reason that tells an area by its number and its name."""
    return Reason(kind, f"areas[{active.number}]", f"{label(active)} {text}", *place)


def _no_goal(request: Request, options: Options[Narrowed]) -> Reason:
    """Return why no point of the route can be rejoined at."""
    own, x, y = request.own, request.route_x[0], request.route_y[0]
    nearest = float(np.min(np.hypot(x - own.x[0], y - own.y[0])))
    ahead = next_goals(request, replace(options, rejoin_by=1e9))[0, 0] >= 0
    if ahead:
        text = f"has no point that can be reached in time; the nearest is {nearest:.0f} m away"
        return Reason.of(Kind.GOAL_TOO_FAR, "route", text)
    return Reason.of(
        Kind.GOAL_BEHIND, "route", "lies behind: the ownship has passed all of its points"
    )


def _finding(findings: Findings, check: int, counted: Sequence[int], required: float) -> Reason:
    """Return one finding of the validator as a reason; ``required`` is the distance from the
    intruder that is too close first, m.
    """
    kind = Kind(CHECKS[check])
    time, x, y = (float(field[check]) for field in (findings.time, findings.x, findings.y))
    if kind is Kind.SEPARATION:
        text = (
            f"comes closer than required from {time:.1f} s on, expected {required:.1f} m or more; "
            f"the smallest distance to any intruder is {findings.min_separation:.1f} m at "
            f"{findings.time_of_min_separation:.1f} s"
        )
        return Reason.of(kind, f"intruders[{counted[int(findings.intruder)]}]", text, time, x, y)
    name = f"waypoints[{findings.leg[check]}]"
    text = f"the leg to {name} fails the check of {kind.value} from {time:.1f} s on"
    return Reason(kind, name, text, time, x, y)
