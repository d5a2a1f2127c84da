"""The planner: a safe way round the intruders and back onto the route, as 20 waypoints, or why there is none.

The policy is rolled ahead in the surrogate to the next point of the route; where its plan does not pass the
validator, a family of manoeuvres is searched, and after that the same for the points beyond. Nothing is called safe
that the validator has not passed.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from agents.manoeuvres.direct_to_goal import SLACK
from agents.planner import fallback
from agents.planner.answer import Excluded, Kind, Plan, Reason, Source, Status
from agents.planner.audit import audit
from agents.planner.candidates import Proposals, better, nothing, propose, put, task_of
from agents.planner.request import Altitude, Intruder, Options, Request, checked, keeping
from agents.planner.rollout import roll, roll_one
from agents.planner.validator import CHECKS, Findings, validate
from agents.policy.inference import Policy
from envs.kinematics import VehicleState
from envs.trees import take
from envs.waypoints import RoutePoint, Waypoint

__all__ = ["Plans", "eligible", "plan", "plan_many"]

_SOURCES = (Source.NONE, Source.POLICY, Source.FALLBACK)


class Plans(NamedTuple):
    """Answers to many requests; fields ``[N]``."""

    proposals: Proposals
    source: Any
    """0 none, 1 policy, 2 fallback; int8."""
    policy_safe: Any
    """Whether the policy's own plan for the next point was safe, bool."""


def plan(
    own: VehicleState,
    intruders: Sequence[VehicleState | Intruder],
    route: Sequence[RoutePoint],
    policy: Policy,
    options: Options | None = None,
    *,
    own_altitude: Altitude | None = None,
) -> Plan:
    """Plan one request.

    Args:
        own: state of the ownship, speed 49..101 m/s.
        intruders: any number of them.
        route: what is left of it, two points at least; the next one first.
        policy: decides.
        options: how the plan shall be.
        own_altitude: for the vertical filter; None: unknown, all intruders count.

    Returns:
        A plan, SAFE or UNRESOLVED with the reasons and the trajectory of greatest separation that is known.

    Raises:
        RequestError: the request is incomplete, out of range or inconsistent; it names the field.
    """
    options = Options() if options is None else options
    request, excluded, kept = checked(own, intruders, route, options, own_altitude)
    plans = plan_many(request, policy, options, floats=True)
    return _answer(request, plans, route, excluded, kept, options)


def plan_many(request: Request, policy: Policy, options: Options, *, floats: bool = False) -> Plans:
    """Plan many requests, ``[N]``; each is planned as if it were alone.

    Args:
        request: ``[N]``; taken as it is: finite, in range, with two points of the route at least.
        policy: decides.
        options: how plans shall be.
        floats: roll a single request in plain floats: ten times faster, and rounded differently.
    """
    floats = floats and request.points.size == 1
    count = request.points.size
    goals = eligible(request, options)
    first = _by_policy(request, goals[:, 0], policy, options, True) if floats and goals[0, 0] >= 0 else None
    if first is not None and first.safe[0] and first.cost[0] <= options.doubtful:
        # The usual case: nothing to compare with and nothing to put together.
        return Plans(first, np.ones(1, dtype=np.int8), first.safe)
    best, source = nothing(count), np.zeros(count, dtype=np.int8)
    policy_safe = np.zeros(count, dtype=bool)

    def consider(rows: Any, plans: Proposals, code: int) -> None:
        best.too_short[rows] |= plans.too_short
        gain = better(plans, take(best, rows))
        put(best, rows[gain], take(plans, gain))
        source[rows[gain]] = code

    for choice in range(options.goals):
        rows = np.flatnonzero(~best.safe & (goals[:, choice] >= 0))
        if rows.size == 0:
            break
        part, goal = take(request, rows), goals[rows, choice]
        plans = first if first is not None and choice == 0 else _by_policy(part, goal, policy, options, floats)
        consider(rows, plans, 1)
        if choice == 0:
            policy_safe[rows] = plans.safe
        wanting = ~plans.safe | (plans.cost > options.doubtful)
        if wanting.any():
            consider(rows[wanting], fallback.search(take(part, wanting), goal[wanting], options), 2)
        if options.thorough:
            # Where the route is too short for one manoeuvre it is for all.
            left = ~best.safe[rows] & ~best.too_short[rows]
            if left.any():
                consider(rows[left], fallback.refine(take(part, left), goal[left], options), 2)
    return Plans(best, source, policy_safe)


def eligible(request: Request, options: Options) -> Any:
    """Return the numbers of the route's points that may be rejoined at, the next one first, ``[N, goals]``; -1: none.

    A point counts as passed when the ownship is within the goal radius of it, or beyond it in the direction in which
    the route goes on there. Points that cannot be reached in time at the greatest speed are left out.
    """
    x, y, points = request.route_x, request.route_y, request.points
    number = np.arange(x.shape[1])
    exists = number < points[:, None]
    onward = np.minimum(number + 1, points[:, None] - 1)
    from_number = np.where(onward > number, number, np.maximum(number - 1, 0))
    dx = np.take_along_axis(x, onward, 1) - np.take_along_axis(x, from_number, 1)
    dy = np.take_along_axis(y, onward, 1) - np.take_along_axis(y, from_number, 1)
    off_x, off_y = request.own.x[:, None] - x, request.own.y[:, None] - y
    far = np.hypot(off_x, off_y) - options.goal_radius
    passed = ((off_x * dx + off_y * dy > 0.0) | (far <= 0.0)) & exists
    first = np.argmin(np.concatenate([passed, np.zeros((points.size, 1), dtype=bool)], axis=1), axis=1)
    fastest = np.maximum(options.manoeuvre.speed_max, request.own.speed)[:, None]
    near = far <= fastest * options.rejoin_by
    chosen = first[:, None] + np.arange(options.goals)
    inside = chosen < points[:, None]
    chosen = np.where(inside, chosen, 0)
    return np.where(inside & np.take_along_axis(near & exists, chosen, 1), chosen, -1)


def _by_policy(request: Request, goal: Any, policy: Policy, options: Options, floats: bool) -> Proposals:
    """Return the policy's plans to points of the route, ``[N]``."""
    rows = np.arange(goal.size)
    to = (request.route_x[rows, goal], request.route_y[rows, goal])
    task, keep = task_of(options), keeping(request, options) + SLACK
    if floats:
        own = VehicleState(*(float(field[0]) for field in request.own))
        one = (float(to[0][0]), float(to[1][0]))
        rollout = roll_one(own, request.traffic, one, keep, policy, task)
    else:
        rollout = roll(request.own, request.traffic, to, keep, policy, task)
    return propose(request, rollout, goal, options)


def _answer(
    request: Request,
    plans: Plans,
    route: Sequence[RoutePoint],
    excluded: tuple[Excluded, ...],
    kept: list[int],
    options: Options,
) -> Plan:
    """Write the plan of one request."""
    best = take(plans.proposals, 0)
    waypoints = _waypoints(best, route)
    slips = audit(waypoints, route, extended=options.extend_route) if waypoints else []
    safe = bool(best.safe) and not slips
    reasons = tuple(slips) if best.safe else (*_reasons(request, plans, kept, options), *slips)
    advisory = None
    if safe and not plans.policy_safe[0]:
        advisory = "the policy's own plan to the next point of the route was not safe"
    return Plan(
        Status.SAFE if safe else Status.UNRESOLVED,
        _SOURCES[int(plans.source[0])] if waypoints else Source.NONE,
        reasons,
        float(best.min_separation),
        float(best.time_of_min_separation),
        route[int(best.goal)].index if waypoints else None,
        float(best.rejoin_time),
        excluded,
        waypoints,
        float(best.cost) if waypoints else float("nan"),
        advisory,
    )


def _waypoints(best: Proposals, route: Sequence[RoutePoint]) -> tuple[Waypoint, ...]:
    """Return the published waypoints of one plan; none if there is none."""
    if best.last < 0:
        return ()
    taken = {point.index for point in route}
    beyond = int(best.last) - len(route)
    free = (index for index in range(len(route) + 64) if index not in taken)
    fresh = [next(free) for _ in range(20)]
    rows = np.stack(best.knots, axis=-1)[1:].tolist()
    last = route[int(best.last)].index if beyond < 0 else fresh[19]
    indices = [*fresh[:19], last]
    return tuple(Waypoint(index, *row) for index, row in zip(indices, rows, strict=True))


def _reasons(request: Request, plans: Plans, kept: list[int], options: Options) -> list[Reason]:
    """Return everything that is wrong with one request's best plan."""
    reasons = []
    requirement = options.requirement
    own, traffic, best = request.own, request.traffic, plans.proposals
    apart = np.hypot(traffic.state.x - own.x[:, None], traffic.state.y - own.y[:, None])[0]
    for number, far in zip(kept, apart, strict=True):
        if far < requirement.separation:
            what = f"is {far:.1f} m away at the request, expected {requirement.separation:.1f} m or more"
            name = f"intruders[{number}]"
            reasons.append(
                Reason(Kind.START_IN_VIOLATION, name, f"{name} {what}", 0.0, float(own.x[0]), float(own.y[0]))
            )
    goals = eligible(request, options)[0]
    if goals[0] < 0:
        reasons.append(_no_goal(request))
        return reasons
    if best.last[0] < 0:
        if best.too_short[0]:
            what = "ends before the plan does and may not be extended"
            reasons.append(Reason(Kind.ROUTE_TOO_SHORT, "route", f"route {what}"))
        else:
            what = f"cannot be rejoined within {options.rejoin_by:g} s by any manoeuvre that was tried"
            reasons.append(Reason(Kind.NO_REJOIN, "route", f"route {what}"))
        return reasons
    found = validate(best.knots, traffic, requirement, options.limits)
    reasons += [
        _finding(found, check, kept, requirement.separation + requirement.margin)
        for check in range(len(CHECKS))
        if found.wrong[check, 0]
    ]
    return reasons


def _no_goal(request: Request) -> Reason:
    own, x, y = request.own, request.route_x[0], request.route_y[0]
    nearest = float(np.min(np.hypot(x - own.x[0], y - own.y[0])))
    ahead = eligible(request, Options(rejoin_by=1e9))[0, 0] >= 0
    if ahead:
        what = f"has no point that can be reached in time; the nearest is {nearest:.0f} m away"
        return Reason(Kind.GOAL_TOO_FAR, "route", f"route {what}")
    return Reason(Kind.GOAL_BEHIND, "route", "route lies behind: the ownship has passed all of its points")


def _finding(found: Findings, check: int, kept: list[int], wanted: float) -> Reason:
    """Return one finding of the validator as a reason."""
    kind = Kind(CHECKS[check])
    leg, time = int(found.leg[check, 0]), float(found.time[check, 0])
    x, y = float(found.x[check, 0]), float(found.y[check, 0])
    if kind is Kind.SEPARATION:
        name = f"intruders[{kept[int(found.intruder[0])]}]"
        least, when = float(found.min_separation[0]), float(found.time_of_min_separation[0])
        message = (
            f"{name} comes closer than required from {time:.1f} s on; the smallest distance to any intruder is "
            f"{least:.1f} m at {when:.1f} s, expected {wanted:.1f} m or more"
        )
        return Reason(kind, name, message, time, x, y)
    name = f"waypoints[{leg}]"
    return Reason(kind, name, f"the leg to {name} fails the check of {kind.value} from {time:.1f} s on", time, x, y)
