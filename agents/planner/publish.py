"""What leaves the planner: the best plan of a request as waypoints, SAFE or with the reasons why
not.

SAFE is decided here and nowhere else: by the validator for the plan's states, by the audit for what
is published.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from agents.planner.airspace import amid
from agents.planner.answer import (
    Advisory,
    AdvisoryCode,
    Counts,
    Excluded,
    Kind,
    Plan,
    Reason,
    RequestError,
    Source,
    Status,
)
from agents.planner.areas import Counted, label
from agents.planner.audit import audit
from agents.planner.candidates import Proposals, find_faults
from agents.planner.options import Options, check
from agents.planner.request import Altitude, Intruder, Request, check_request, eligible, in_wind
from agents.planner.traffic import separations, within_window
from agents.planner.validator import CHECKS, Findings
from envs.area_geometry import signed_distance
from envs.areas import Area, Keep
from envs.arrays import Array
from envs.kinematics import VehicleState
from envs.trees import take
from envs.waypoints import PlanStates, RoutePoint, Waypoint, on_ground
from envs.waypoints import plan_states as plan_states_of
from envs.wind import Wind

JOIN = 5
"""Least time to the waypoint at which a late plan is joined, time steps; a shorter leg turns hard
on any error.
"""

_SOURCES = (Source.NONE, Source.POLICY, Source.FALLBACK)


class Plans(NamedTuple):
    """Answers to many requests; fields ``[N]``."""

    proposals: Proposals
    source: Array  # 0 none, 1 policy, 2 fallback; int8
    policy_safe: Array  # whether the policy's own plan for the next point was safe, bool


def publish(
    request: Request,
    plans: Plans,
    next_goal: int,
    route: Sequence[RoutePoint],
    excluded: tuple[Excluded, ...],
    kept: list[int],
    options: Options,
    skipped: tuple[str, ...] = (),
) -> Plan:
    """Write the plan of one request ``[1]`` over the ground.

    Args:
        next_goal: number of the first point of the route that may be rejoined at; -1: there is
            none.
        kept: numbers of the intruders that were not left out.
    """
    best = take(plans.proposals, 0)
    if request.drift is not None:
        east, north = (-float(part[0]) for part in request.drift)
        best = _on_ground(best, Wind(east, north))
    best = _number_points(best, request)
    waypoints = _waypoints(best, route)
    faults = (
        audit(waypoints, route, count=options.waypoints, extended=options.extend_route)
        if waypoints
        else []
    )
    faults += [
        _outlasting(one, waypoints[-1])
        for one in excluded
        if waypoints and not waypoints[-1].time <= one.until
    ]
    valid = bool(best.findings.safe)
    safe = valid and not faults
    reasons = (
        tuple(faults) if valid else (*_reasons(request, best, next_goal, kept, options), *faults)
    )
    if skipped and not safe:
        what = (
            f"options.deadline_s of {options.deadline_s:g} s was reached before: "
            f"{', '.join(skipped)}"
        )
        reasons = (*reasons, Reason(Kind.DEADLINE, "options.deadline_s", what))
    advisory: tuple[Advisory, ...] = ()
    if safe and not plans.policy_safe[0]:
        what = "to the next point of the route was not safe"
        advisory = (Advisory(AdvisoryCode.POLICY_UNSAFE, "the policy's own plan", what),)
    return Plan(
        Status.SAFE if safe else Status.UNRESOLVED,
        _SOURCES[int(plans.source[0])] if waypoints else Source.NONE,
        reasons,
        float(best.min_separation),
        float(best.findings.time_of_min_separation),
        # A point of an extended route has no index.
        route[int(best.goal)].index if waypoints and best.goal < len(route) else None,
        float(best.rejoin_time),
        excluded,
        waypoints,
        float(best.cost) if waypoints else np.nan,
        advisory,
        skipped,
        windows=_windows(request, kept),
    )


def _number_points(best: Proposals, request: Request) -> Proposals:
    """Return a plan ``[]`` with its points numbered as in the route that was asked for."""
    if request.of_route is None or best.last < 0:
        return best
    number = request.of_route[0]
    # Round an area it goes on to the next point of the route. The last point may be beyond it.
    goal = number[int(best.goal) :]
    last = np.append(number, 2**31)[min(int(best.last), number.size)]
    return best._replace(goal=goal[goal >= 0][0], last=last)


def _on_ground(best: Proposals, wind: Wind) -> Proposals:
    """Return a plan ``[]`` with its states, and the places of its findings, over the ground."""
    found = best.findings
    x, y = found.x + wind.east * found.time, found.y + wind.north * found.time
    return best._replace(
        plan_states=on_ground(best.plan_states, wind), findings=found._replace(x=x, y=y)
    )


def _windows(request: Request, kept: list[int]) -> tuple[Counts, ...]:
    """Return which intruders of one request ``[1]`` count for a while only."""
    window = request.traffic.window
    if window is None:
        return ()
    each = zip(kept, window.begin[0].tolist(), window.end[0].tolist(), strict=True)
    return tuple(
        Counts(number, max(begin, 0.0), end)
        for number, begin, end in each
        if begin > 0.0 or end < math.inf
    )


def _outlasting(one: Excluded, end: Waypoint) -> Reason:
    """Return that a plan goes on longer than an intruder is known to stay out of the way."""
    what = (
        f"was left out until {one.until:.0f} s, expected until the plan's end at {end.time:.0f} s"
    )
    return Reason.of(Kind.SEPARATION, f"intruders[{one.number}]", what, end.time, end.x, end.y)


def reconstruct(waypoints: tuple[Waypoint, ...], wind: Wind | None = None) -> Plan:
    """Return a plan as a receiver of its waypoints and its wind has it: only SAFE ones have any."""
    status = Status.SAFE if waypoints else Status.UNRESOLVED
    return Plan(status, Source.NONE, (), np.nan, np.nan, None, np.nan, (), waypoints, wind=wind)


def recheck(  # noqa: PLR0913 - a plan, and all of a request
    plan: Plan,
    late: float,
    own: VehicleState,
    intruders: Sequence[VehicleState | Intruder],
    route: Sequence[RoutePoint],
    options: Options,
    own_altitude: Altitude | None = None,
    wind: Wind | None = None,
    *,
    areas: Sequence[Area] = (),
) -> Plan:
    """Return a plan as checked ``late`` seconds after its request, by what is there then, areas
    as of then: SAFE only if it still is.
    """
    if not plan.safe or late <= 0.0:
        return plan
    least = JOIN * options.aircraft.dt
    left = [
        replace(point, time=point.time - late)
        for point in plan.waypoints
        if point.time - late >= least
    ]
    try:
        check(options)
        options = options if wind is None else in_wind(options, wind)
        request, excluded, _ = check_request(own, intruders, route, options, own_altitude, wind)
        request, _ = amid(request, areas, own_altitude, options, wind)
    except RequestError as error:
        return _void(plan, late, str(error))
    curve = PlanStates(*(field[None] for field in plan_states_of(own, left, wind=wind)))
    found = find_faults(curve, request, options)
    outlasted = [
        _outlasting(one, left[-1]).message
        for one in excluded
        if left and not left[-1].time <= one.until
    ]
    if outlasted:
        return _void(plan, late, outlasted[0])
    if bool(found.safe[0]):
        return plan
    wrong = ", ".join(CHECKS[number] for number in np.flatnonzero(found.wrong[0]))
    return _void(plan, late, f"from the states by then it fails the checks: {wrong}")


def _void(plan: Plan, late: float, why: str) -> Plan:
    message = f"plan was found {late:.1f} s after the request and is too late: {why}"
    return replace(
        plan, status=Status.UNRESOLVED, reasons=(Reason(Kind.SEPARATION, "plan", message),)
    )


def _waypoints(best: Proposals, route: Sequence[RoutePoint]) -> tuple[Waypoint, ...]:
    if best.last < 0:
        return ()
    taken = {point.index for point in route}
    rows = np.stack(best.plan_states, axis=-1)[1:].tolist()
    free = (index for index in range(len(route) + len(rows)) if index not in taken)
    indices = [next(free) for _ in rows]
    if best.last < len(route):
        indices[-1] = route[int(best.last)].index
    return tuple(Waypoint(index, *row) for index, row in zip(indices, rows, strict=True))


def _reasons(
    request: Request, best: Proposals, next_goal: int, kept: list[int], options: Options
) -> list[Reason]:
    """Return everything that is wrong with one request ``[1]`` and its best plan ``[]``."""
    reasons = []
    requirement = options.requirement
    own, traffic = request.own, request.traffic
    apart = np.hypot(traffic.state.x - own.x[:, None], traffic.state.y - own.y[:, None])[0]
    least = np.broadcast_to(separations(traffic, requirement), (1, apart.size))[0]
    counts = np.broadcast_to(within_window(traffic, 0.0, 0.0), (1, apart.size))[0]
    for number, far, wanted, now in zip(kept, apart, least, counts, strict=True):
        if now and far < wanted:
            what = f"is {far:.1f} m away at the request, expected {wanted:.1f} m or more"
            place = 0.0, float(own.x[0]), float(own.y[0])
            reasons.append(Reason.of(Kind.START_IN_VIOLATION, f"intruders[{number}]", what, *place))
    reasons += _begins_inside(request)
    if next_goal < 0:
        return [*reasons, _no_goal(request, options)]
    if best.last < 0 and best.too_short:
        what = "ends before the plan does and may not be extended"
        return [*reasons, Reason.of(Kind.ROUTE_TOO_SHORT, "route", what)]
    if best.last < 0:
        what = f"cannot be rejoined within {options.rejoin_by:g} s by any manoeuvre that was tried"
        return [*reasons, Reason.of(Kind.NO_REJOIN, "route", what)]
    close, wrong = int(best.findings.intruder), np.flatnonzero(best.findings.wrong)
    wanted = float(least[close]) + requirement.margin if close >= 0 else np.nan
    if request.areas is not None and best.findings.area >= 0:
        reasons.append(_area_finding(best.findings, request.areas.value, requirement.margin))
    return reasons + [
        _finding(best.findings, number, kept, wanted)
        for number in wrong.tolist()
        if CHECKS[number] != Kind.AREA.value
    ]


def _begins_inside(request: Request) -> list[Reason]:
    """Return the areas that forbid the place of the ownship at the request."""
    reasons, x, y = [], float(request.own.x[0]), float(request.own.y[0])
    for one in () if request.areas is None else request.areas.value:
        if one.begin > 0.0 or float(signed_distance(one.area, x, y)) >= 0.0:
            continue
        what = "is left by" if one.area.keep is Keep.IN else "holds"
        what = f"{what} the ownship at the request, expected it {_side(one)}"
        reasons.append(_of_area(Kind.START_IN_VIOLATION, one, what, 0.0, x, y))
    return reasons


def _area_finding(found: Findings, areas: Sequence[Counted], margin: float) -> Reason:
    """Return where the clearance from an area is lost first."""
    number = CHECKS.index(Kind.AREA.value)
    time, x, y = (float(field[number]) for field in (found.time, found.x, found.y))
    one = next(one for one in areas if one.number == found.area)
    what = (
        f"is not kept clear of from {time:.1f} s on, at {x:.0f} m east and {y:.0f} m north; "
        f"expected the ownship {_side(one)} and {one.area.clearance + margin:.1f} m or more from it"
    )
    return _of_area(Kind.AREA, one, what, time, x, y)


def _side(one: Counted) -> str:
    return "inside" if one.area.keep is Keep.IN else "outside"


def _of_area(kind: Kind, one: Counted, what: str, *place: float) -> Reason:
    """Return a reason that tells an area by its number and its name."""
    return Reason(kind, f"areas[{one.number}]", f"{label(one)} {what}", *place)


def _no_goal(request: Request, options: Options) -> Reason:
    own, x, y = request.own, request.route_x[0], request.route_y[0]
    nearest = float(np.min(np.hypot(x - own.x[0], y - own.y[0])))
    ahead = eligible(request, replace(options, rejoin_by=1e9))[0, 0] >= 0
    if ahead:
        what = f"has no point that can be reached in time; the nearest is {nearest:.0f} m away"
        return Reason.of(Kind.GOAL_TOO_FAR, "route", what)
    return Reason.of(
        Kind.GOAL_BEHIND, "route", "lies behind: the ownship has passed all of its points"
    )


def _finding(found: Findings, check: int, kept: list[int], wanted: float) -> Reason:
    """Return one finding of the validator as a reason."""
    kind = Kind(CHECKS[check])
    time, x, y = (float(field[check]) for field in (found.time, found.x, found.y))
    if kind is Kind.SEPARATION:
        what = (
            f"comes closer than required from {time:.1f} s on, expected {wanted:.1f} m or more; "
            f"the smallest distance to any intruder is {found.min_separation:.1f} m at "
            f"{found.time_of_min_separation:.1f} s"
        )
        return Reason.of(kind, f"intruders[{kept[int(found.intruder)]}]", what, time, x, y)
    name = f"waypoints[{found.leg[check]}]"
    return Reason(
        kind,
        name,
        f"the leg to {name} fails the check of {kind.value} from {time:.1f} s on",
        time,
        x,
        y,
    )
