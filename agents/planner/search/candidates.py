"""From manoeuvres to plans: each is completed, validated, and kept where it is the best of its
request so far.
"""

from typing import NamedTuple

import numpy as np

from agents.planner.judge.validator import Findings, validate
from agents.planner.request.options import Narrowed, Options, task_of
from agents.planner.request.request import Request
from agents.planner.search.completion import complete
from agents.planner.search.rollout import Rollout
from envs.angles import wrap
from envs.arrays import Array, Bool, Float, Int
from envs.frames import Air
from envs.trees import first_rows, scatter, take
from envs.waypoints import PlanStates
from envs.wind import aim_point

TIME_WEIGHT = 0.25
"""Cost of a metre that the time beyond the straight line would have covered."""

REVERSAL_WEIGHT = 0.1
"""Cost of a change of the turn's side, separations."""


class Candidates(NamedTuple):
    """Plans with findings, cost and clearance; fields ``[N]``."""

    # the request and the waypoints, [N, W + 1]; nan where there is no whole plan
    plan_states: PlanStates[Air]
    goal: Array  # number of the route's point at which it is rejoined; -1 without a plan
    # number of the route's point that ends the plan; -1 without one; beyond the route's own if
    # extended
    last: Array
    findings: Findings  # of the validator; everything is wrong with what is no plan, clearance -inf
    # whether the route ended too soon for this plan or one that it was chosen from, bool
    too_short: Array
    rejoin_time: Array  # s; nan without a plan
    path: Array  # length until the rejoining, m; nan without a plan
    cost: Array  # m; inf without a plan: path beyond the straight line, and the two weights above
    rejoining: Array  # m, cost of rejoining there and not elsewhere on the leg; 0: no choice
    # of altitude, envs.profile.Profile, object [N], None without a plan; None: plans in the plane
    profile: Array | None = None

    @property
    def safe(self) -> Bool[Array, " N"]:
        """Whether the validator found nothing wrong, bool."""
        return self.findings.safe

    @property
    def min_separation(self) -> Float[Array, " N"]:
        """Smallest distance, m; nan without a plan."""
        return self.findings.min_separation


class Plans(NamedTuple):
    """Answers to many requests; fields ``[N]``."""

    candidates: Candidates
    source: Array  # 0 none, 1 policy, 2 fallback; int8
    policy_safe: Array  # whether the policy's own plan for the next point was safe, bool


def empty(count: int, waypoints: int, *, in_space: bool = False) -> Candidates:
    """Return that there is no plan of so many waypoints, ``[count]``, in space or in the plane."""
    nan, none = np.full(count, np.nan), np.full(count, -1)
    states = (np.full((count, waypoints + 1), np.nan) for _ in PlanStates._fields)
    no, never = np.zeros(count, dtype=bool), np.full(count, np.inf)
    return Candidates(
        plan_states=PlanStates(*states),
        goal=none,
        last=none.copy(),
        findings=Findings.empty(count),
        too_short=no,
        rejoin_time=nan,
        path=nan.copy(),
        cost=never,
        rejoining=np.zeros(count),
        profile=np.full(count, None, dtype=object) if in_space else None,
    )


def find_violations(
    plan_states: PlanStates[Air], request: Request, options: Options[Narrowed]
) -> Findings:
    """Return what is wrong with plans ``[N]`` of requests."""
    areas = () if request.areas is None else request.areas.value
    return validate(plan_states, request.traffic, options.requirement, options.limits, areas)


def evaluate(
    request: Request, rollout: Rollout, goal: Int[Array, " M"], options: Options[Narrowed]
) -> Candidates:
    """Complete the manoeuvres ``[M]`` of requests to plans for the goals numbered ``[M]``, and
    validate them.
    """
    whole = complete(request, rollout, goal, options)
    rows = np.flatnonzero(whole.last >= 0)
    if rows.size == 0:
        return empty(goal.size, options.waypoints)._replace(too_short=whole.too_short)
    plan_states, part = whole.plan_states, request
    if rows.size < goal.size:
        plan_states, part = take((plan_states, request), rows)
    findings = find_violations(plan_states, part, options)
    time, path = whole.rejoin_time[rows], whole.path[rows]
    to = request.route_x[rows, goal[rows]], request.route_y[rows, goal[rows]]
    evaluated = Candidates(
        plan_states=plan_states,
        goal=goal[rows],
        last=whole.last[rows],
        findings=findings,
        too_short=whole.too_short[rows],
        rejoin_time=time,
        path=path,
        cost=_cost(part, to, time, path, whole.reversals[rows], options),
        rejoining=_rejoining(part, plan_states, time, options),
    )
    if rows.size == goal.size:
        return evaluated
    candidates = empty(goal.size, options.waypoints)._replace(too_short=whole.too_short)
    scatter(candidates, rows, evaluated)
    return candidates


def _cost(
    request: Request,
    to: tuple[Array, Array],
    time: Array,
    path: Array,
    reversals: Array,
    options: Options[Narrowed],
) -> Array:
    """Return the cost of plans ``[M]``, m.

    Args:
        request: of each plan.
        to: place of its goal at the request, m.
        time: of its rejoining, s.
        path: its length until then, m.
        reversals: how often its turn changes side until then.
        options: of the plans.
    """
    goal_x, goal_y = aim_point(request.own, to, request.drift, options.rejoin_by, np)
    away = np.hypot(goal_x - request.own.x, goal_y - request.own.y)
    straight = np.maximum(away - options.aircraft.goal_radius, 0.0)
    excess = np.maximum(path - straight, 0.0)
    late = np.maximum(time * request.own.speed - straight, 0.0)
    turning = REVERSAL_WEIGHT * options.aircraft.separation * reversals
    return excess + TIME_WEIGHT * late + turning


def _rejoining(
    request: Request, plan_states: PlanStates[Air], time: Array, options: Options[Narrowed]
) -> Array:
    """Return what plans ``[M]`` that rejoin at some times, s, cost by the time beside the route and
    the turns, that onto the next leg too, m; 0 where the next point is preferred to all others.
    """
    if not options.rejoin_on_leg:
        return np.zeros(time.size)
    turns = np.abs(wrap(np.diff(plan_states.heading, axis=-1), np))
    counts = plan_states.time[:, :-1] <= time[:, None] + options.interval
    turns = np.where(counts, turns, 0.0).sum(axis=-1)
    return TIME_WEIGHT * request.own.speed * (time + turns / task_of(options).turn_rate)


def keep_best(best: Candidates, rows: Int[Array, " M"], plans: Candidates) -> Int[Array, "..."]:
    """Write the best of plans ``[M]`` of requests numbered ``rows`` into the best so far ``[N]``,
    where it is better.

    Returns:
        The numbers of the requests that have a better plan now.
    """
    row, first = first_rows(rows, *_merits(plans))
    chosen, gain = take(plans, first), False
    for new, old in zip(_merits(chosen), _merits(take(best, row)), strict=True):
        gain = (new < old) | ((new == old) & gain)
    scatter(best, row[gain], take(chosen, gain))
    return row[gain]


def _merits(plans: Candidates) -> tuple[Array, Array, Array]:
    """Return what plans are compared by, less is better: cost of safe ones, else clearance;
    legality; safety.
    """
    safe, findings = plans.safe, plans.findings
    return np.where(safe, plans.cost + plans.rejoining, -findings.clearance), ~findings.legal, ~safe
