"""Plans that may climb and descend: the cheapest of what is safe in the plane, on the route's
altitude, and of what is safe on the route, at others; both together where neither is.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from agents.kernel.levels import Altitude, Line, lines
from agents.planner.answer import Advisory, Kind, RequestError
from agents.planner.judge.profile import exceeds_speed
from agents.planner.judge.validator import CHECKS, Findings
from agents.planner.request.climbs import with_levels_of
from agents.planner.request.options import Maneuvers, Narrowed, Options
from agents.planner.request.reports import Intruder
from agents.planner.request.request import Request
from agents.planner.search.airspace import add_areas
from agents.planner.search.budget import Budget
from agents.planner.search.candidates import Candidates, Plans, empty, evaluate
from agents.planner.search.climbs import (
    Conflict,
    Start,
    climbed,
    conflicts,
    nominal,
    on_profile,
    profiles,
)
from agents.planner.search.goals import next_goals
from agents.planner.search.horizontal import plan_rows
from agents.planner.search.late_climbs import Ranking
from agents.planner.search.rollout import roll
from agents.policy.inference import Policy
from envs.areas import Area
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.profile import Profile
from envs.trees import map_leaves, take
from envs.waypoints import PlanStates, legs

VERTICAL = 3
"""Code of a plan that a climb or a descent along the route made."""

_ON_ROUTE = 12
"""Profiles that are tried along the route at most."""

_LOOKED_AT = 10
"""Profiles that are looked at until it is asked whether time is left."""

_TOGETHER = 4
"""Profiles on which plans in the plane are searched at most."""


class Case(NamedTuple):
    """A request on a profile."""

    profile: Profile
    request: Request  # each intruder once for every time in which it counts
    counted: list[int]  # numbers of the reports that they are
    notes: tuple[Advisory, ...]  # on its areas
    detour: float  # by how much longer its route is than the one asked for, round areas, m


class Answer(NamedTuple):
    """The best plan, and the case that it was made for."""

    case: Case
    plans: Plans  # [1]
    cost: float  # with its climbs, m; inf: it is not safe


class SpaceTask(NamedTuple):
    """One request ``[1]`` that may climb and descend."""

    request: Request  # with all intruders, each of which counts always; without areas
    reports: Sequence[Intruder[Air]]  # of its intruders
    start: Start  # of its profiles
    areas: Sequence[Area]  # in the air mass
    # adds the areas that count on a flight
    among: Callable[[Request, Sequence[Line]], tuple[Request, tuple[Advisory, ...]]]
    policy: Policy
    options: Options[Narrowed]
    budget: Budget


class Climber(NamedTuple):
    """Altitudes of one request."""

    own: Altitude  # its vertical speed is known
    target: float  # altitude of the route, m
    reports: Sequence[Intruder[Air]]  # of its K intruders, of which only the altitudes count
    areas: Sequence[Area] = ()  # in the air mass, as they are at the request


def plan_each_in_space(
    request: Request, climbers: Sequence[Climber], policy: Policy, options: Options[Narrowed]
) -> Plans:
    """Plan requests ``[N]``, without areas, that may climb and descend, each as if it were alone,
    among the areas of its climber, and without a deadline.
    """
    if not climbers:
        no = np.zeros(0, dtype=bool)
        return Plans(empty(0, options.waypoints, in_space=True), np.zeros(0, np.int8), no)
    plans = [
        _plan_alone(take(request, slice(n, n + 1)), climber, policy, options)
        for n, climber in enumerate(climbers)
    ]
    return map_leaves(lambda *rows: np.concatenate(rows), *plans)


def _plan_alone(
    request: Request, climber: Climber, policy: Policy, options: Options[Narrowed]
) -> Plans:
    """Return the best plan ``[1]`` of a request ``[1]``, with its profile."""
    exist = np.flatnonzero(request.traffic.mask[0])
    traffic = map_leaves(lambda field: field[:, exist], request.traffic._replace(window=None))
    times = [leg * options.interval for leg in range(1, options.waypoints)]
    areas, options = climber.areas, with_levels_of(climber.areas, climber.own.reference, options)
    task = SpaceTask(
        request._replace(traffic=traffic),
        [climber.reports[number] for number in exist.tolist()],
        Start(climber.own, climber.target, times),
        areas,
        lambda flown, flight: add_areas(flown, areas, flight, options),
        policy,
        options,
        Budget(),
    )
    none = empty(1, options.waypoints, in_space=True)
    try:
        case, plans, _ = plan_in_space(task)
    except RequestError:  # the route's altitude cannot be regained within a plan
        return Plans(none, np.zeros(1, np.int8), np.zeros(1, dtype=bool))
    best, profile = plans.candidates, none.profile
    if best.last[0] >= 0 and profile is not None:
        profile[0] = case.profile
    findings = best.findings
    intruder = np.array(findings.intruder)
    if intruder[0] >= 0:
        intruder[0] = exist[case.counted[int(intruder[0])]]
    findings = findings._replace(intruder=intruder)
    return plans._replace(candidates=best._replace(findings=findings, profile=profile))


def plan_in_space(task: SpaceTask) -> Answer:
    """Return the best plan: safe at the least cost, or else of the greatest clearance."""
    start, options, budget = task.start, task.options, task.budget
    base = _case(task, nominal(start, options))
    on_route = _on_route(task, base)
    if on_route.cost < math.inf and base.detour <= 0.0:
        return on_route
    in_plane = options.maneuvers is Maneuvers.BOTH
    quick, best = replace(options, exhaustive=False), on_route
    met, avoiding = _conflicts(task, on_route), list[Profile]()
    late = Ranking(met, start, options)
    until = max((conflict.end for conflict in met), default=0.0)
    for number, profile in enumerate(profiles(start, until, options)):
        dear = options.altitude_weight * climbed(profile) >= best.cost
        if dear or len(avoiding) == _ON_ROUTE:
            break
        avoids = late.avoids(profile)
        if (avoids or number % _LOOKED_AT == 0) and budget.ends("climbs"):
            break
        if not avoids:
            continue
        avoiding.append(profile)
        tried = _on_route(task, _case(task, profile))
        best = _better(best, tried)
        if tried.cost < math.inf:
            break
    if not in_plane:
        return best
    if not budget.ends("turns"):
        # To the next point alone at first: turns that find no way leave time for climbs.
        best = _better(best, _in_plane(task, base, replace(quick, goals=1)))
    if best.cost < math.inf:
        return best
    for profile in [*avoiding, *late.in_order()][:_TOGETHER]:
        if budget.ends("climbs with turns"):
            break
        best = _better(best, _in_plane(task, _case(task, profile), quick))
        if best.cost < math.inf:
            return best
    # The last, slow stages: where least was missing, and on the route's altitude.
    for case in [best.case, base] if best.case is not base else [base]:
        if best.cost == math.inf:
            best = _better(best, _in_plane(task, case, options))
    return best


def _case(task: SpaceTask, profile: Profile) -> Case:
    """Return the request on a profile."""
    start, options = task.start, task.options
    flight = lines(profile, start.own, options.vertical_margin)
    request, counted = on_profile(task.request, task.reports, flight, options)
    request, notes = task.among(request, flight)
    return Case(profile, request, counted, notes, _detour(request, task.request))


def _answer(task: SpaceTask, case: Case, plans: Plans) -> Answer:
    """Return a plan with its cost."""
    flown = plans.candidates
    if not flown.safe[0]:
        return Answer(case, plans, math.inf)
    curves = legs(take(flown.plan_states, 0))
    too_fast = np.flatnonzero(exceeds_speed(case.profile, curves, task.options.limits))
    cost = flown.cost + case.detour + task.options.altitude_weight * climbed(case.profile)
    findings = flown.findings
    if too_fast.size:
        findings = _fails_speed(findings, flown.plan_states, int(too_fast[0]))
    plans = plans._replace(candidates=flown._replace(cost=cost, findings=findings))
    return Answer(case, plans, math.inf if too_fast.size else float(cost[0]))


def _fails_speed(findings: Findings, plan_states: PlanStates[Air], leg: int) -> Findings:
    """Return the findings of a plan ``[1]`` that is too fast on a leg with its climb."""
    findings, check = map_leaves(np.array, findings), CHECKS.index(Kind.SPEED.value)
    findings.wrong[0, check], findings.leg[0, check] = True, leg
    findings.time[0, check], findings.x[0, check], findings.y[0, check] = (
        field[0, leg] for field in (plan_states.time, plan_states.x, plan_states.y)
    )
    return findings


def _better(first: Answer, second: Answer) -> Answer:
    """Return the cheaper of two plans; of two that are not safe the one of greater clearance."""
    if first.cost == second.cost == math.inf:
        clearance = (answer.plans.candidates.findings.clearance[0] for answer in (first, second))
        return first if next(clearance) >= next(clearance) else second
    return first if first.cost <= second.cost else second


def _detour(request: Request, original: Request) -> float:
    """Return by how much longer a route round areas is than the original one, m, between the
    ownship and the last of its points.
    """
    if request.of_route is None:
        return 0.0
    number = request.of_route[0]
    original_points = np.flatnonzero((number >= 0) & (number < original.points[0]))
    if original_points.size == 0:
        return 0.0
    round_areas = slice(0, int(original_points[-1]) + 1)
    straight = number[original_points]
    bent, direct = (
        _length(request.own, route.route_x[0, points], route.route_y[0, points])
        for route, points in ((request, round_areas), (original, straight))
    )
    return max(bent - direct, 0.0)


def _length(own: VehicleState[Air], x: Array, y: Array) -> float:
    """Return how long the way from the ownship ``[1]`` over points ``[R]`` is, m."""
    steps = np.diff(np.concatenate([own.x, x])), np.diff(np.concatenate([own.y, y]))
    return float(np.hypot(*steps).sum())


def _on_route(task: SpaceTask, case: Case) -> Answer:
    """Return the plan straight along the route on a profile, whoever comes near."""
    best = _way(task, case.request)
    return _answer(task, case, Plans(best, np.full(1, VERTICAL, np.int8), best.safe))


def _way(task: SpaceTask, request: Request) -> Candidates:
    """Return the plan ``[1]`` that goes along a route as if nobody were there, and what is wrong
    with it.
    """
    options = task.options
    without_traffic = request._replace(
        traffic=request.traffic._replace(mask=np.zeros_like(request.traffic.mask))
    )
    way = empty(1, options.waypoints)
    for goal in next_goals(request, options)[0].tolist():
        if goal < 0 or way.last[0] >= 0:
            break
        number = np.array([goal])
        flown = roll(without_traffic, number, task.policy, options, task.budget, floats=True)
        way = evaluate(request, flown, number, options)
    return way


def _in_plane(task: SpaceTask, case: Case, options: Options[Narrowed]) -> Answer:
    """Return the best plan in the plane on a profile."""
    goals = next_goals(case.request, options)
    plans = plan_rows(case.request, goals, task.policy, options, task.budget, floats=True)
    return _answer(task, case, plans)


def _conflicts(task: SpaceTask, on_route: Answer) -> list[Conflict]:
    """Return which conflicts the way along the route has, whoever is above or below; ``on_route``
    is the answer along it on the route's altitude.
    """
    way = _way(task, task.request) if task.areas else on_route.plans.candidates
    if way.last[0] < 0:
        return []
    return conflicts(way.plan_states, task.request, task.reports, task.areas, task.options)
