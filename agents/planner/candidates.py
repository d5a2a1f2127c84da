"""Proposals: manoeuvres completed to whole plans, judged by the validator, and compared."""

from typing import Any, NamedTuple

import numpy as np

from agents.manoeuvres.direct_to_goal import Task
from agents.planner.completion import complete
from agents.planner.request import Options, Request
from agents.planner.rollout import Rollout
from agents.planner.validator import validate
from envs.trees import mapped, take
from envs.waypoints import Knots

__all__ = [
    "REJOIN_RESERVE",
    "REVERSAL_WEIGHT",
    "TIME_WEIGHT",
    "Proposals",
    "better",
    "nothing",
    "propose",
    "put",
    "task_of",
]

REJOIN_RESERVE = 50.0
"""By how much deeper than ``goal_radius`` manoeuvres enter the goal's disc, m, so that the smoothed plan does too."""

_TURN_SHARE = 2.0 / 3.0  # of the turn rate, for turns along the route
TIME_WEIGHT = 0.25
"""Cost of a metre that the time beyond the straight line would have covered."""

REVERSAL_WEIGHT = 100.0
"""Cost of a change of the turn's side, m."""


class Proposals(NamedTuple):
    """Plans with what is known of them; fields ``[N]``."""

    knots: Knots
    """The request, 19 waypoints and a point of the route, ``[N, 21]``; nan where there is no whole plan."""
    goal: Any
    """Number of the route's point at which it is rejoined; -1 without a plan."""
    last: Any
    """Number of the route's point that ends the plan; -1 without one."""
    safe: Any
    """Whether the validator found nothing wrong, bool."""
    legal: Any
    """Whether it found nothing wrong but separation, bool."""
    too_short: Any
    """Whether the route ended too soon for this plan or one that it was chosen from, bool."""
    clearance: Any
    """Smallest distance less the required one, m; -inf without a plan."""
    min_separation: Any
    """m; nan without a plan."""
    time_of_min_separation: Any
    """s; nan without one."""
    rejoin_time: Any
    """s; nan without a plan."""
    path: Any
    """Length until the rejoining, m; nan without a plan."""
    cost: Any
    """m; inf without a plan. Length until the rejoining beyond the straight line, a quarter of what the time beyond
    the straight line at the present speed would cover, and 100 m for each change of the turn's side."""


def nothing(count: int) -> Proposals:
    """Return that there is no plan, ``[count]``."""
    nan, no, none = np.full(count, np.nan), np.zeros(count, dtype=bool), np.full(count, -1)
    knots = Knots(*(np.full((count, 21), np.nan) for _ in range(5)))
    return Proposals(
        knots,
        none,
        none.copy(),
        no,
        no.copy(),
        no.copy(),
        np.full(count, -np.inf),
        nan,
        nan.copy(),
        nan.copy(),
        nan.copy(),
        np.full(count, np.inf),
    )


def propose(request: Request, rollout: Rollout, goal: Any, options: Options) -> Proposals:
    """Complete manoeuvres to plans and judge them.

    Args:
        request: ``[M]``, of each manoeuvre.
        rollout: the manoeuvres, ``[M]``.
        goal: number of the route's point that each leads to, ``[M]``.
        options: how plans shall be.
    """
    count = goal.size
    route = (request.route_x, request.route_y)
    whole = complete(rollout, route, request.points, goal, task_of(options), extend=options.extend_route)
    rows = np.flatnonzero(whole.last >= 0)
    if rows.size == 0:
        return nothing(count)._replace(too_short=whole.too_short)
    knots = take(whole.knots, rows)
    found = validate(knots, take(request.traffic, rows), options.requirement, options.limits)
    goal_x, goal_y = request.route_x[rows, goal[rows]], request.route_y[rows, goal[rows]]
    straight = np.hypot(goal_x - request.own.x[rows], goal_y - request.own.y[rows]) - options.goal_radius
    time, path = whole.rejoin_time[rows], whole.path[rows]
    excess = np.maximum(path - np.maximum(straight, 0.0), 0.0)
    late = np.maximum(time * request.own.speed[rows] - np.maximum(straight, 0.0), 0.0)
    cost = excess + TIME_WEIGHT * late + REVERSAL_WEIGHT * whole.reversals[rows]
    legal = ~found.wrong[:-1].any(axis=0)
    values = (
        knots,
        goal[rows],
        whole.last[rows],
        found.safe,
        legal,
        whole.too_short[rows],
        found.clearance,
        found.min_separation,
        found.time_of_min_separation,
        time,
        path,
        cost,
    )
    if rows.size == count:
        return Proposals(*values)
    proposals = nothing(count)._replace(too_short=whole.too_short)
    put(proposals, rows, Proposals(*values))
    return proposals


def task_of(options: Options) -> Task:
    """Return what manoeuvres are flown for."""
    radius = options.goal_radius - REJOIN_RESERVE
    rate = _TURN_SHARE * options.manoeuvre.yaw_rate_max
    return Task(options.manoeuvre, radius, options.rejoin_by, rate, options.direct)


def better(a: Proposals, b: Proposals) -> Any:
    """Return where ``a`` is better than ``b``: safe and cheaper; if neither is safe, legal and clearer, ``[N]``."""
    unsafe = ~a.safe & ~b.safe
    cheaper = a.safe & (~b.safe | (a.cost < b.cost))
    clearer = (a.legal > b.legal) | ((a.legal == b.legal) & (a.clearance > b.clearance))
    return cheaper | (unsafe & clearer)


def put(into: Proposals, rows: Any, values: Proposals) -> None:
    """Write proposals into some rows of others."""

    def write(old: Any, new: Any) -> None:
        old[rows] = new

    mapped(write, into, values)
