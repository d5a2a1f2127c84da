"""Plans in the plane: the policy, then the fallback, point after point of the route.

Each goes through one pipeline (:mod:`agents.planner.search.candidates`): completed to a plan,
validated, kept where it is the best so far.
"""

import itertools
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from agents.planner.request.options import Narrowed, Options
from agents.planner.request.request import Request
from agents.planner.search import fallback
from agents.planner.search.budget import Budget
from agents.planner.search.candidates import Candidates, Plans, empty, evaluate, keep_best
from agents.planner.search.goals import on_same_leg
from agents.planner.search.rollout import much_about, policy_time_over, roll
from agents.policy.inference import Policy
from envs.arrays import Array, Int
from envs.trees import take

POLICY, FALLBACK = 1, 2
"""Codes of what made a plan (:class:`agents.planner.search.candidates.Plans`)."""


def plan_rows(
    request: Request,
    goals: Int[Array, "N goals"],
    policy: Policy,
    options: Options[Narrowed],
    budget: Budget,
    *,
    floats: bool,
) -> Plans:
    """Plan requests of which every number is finite, to points of the route ``[N, goals]``.

    Goals are tried one after the other where no plan is safe yet, or where others on the same leg
    are as welcome and it costs much: the policy, then the fallback where the policy's plan is not
    safe or costs much, at the end the refinement. Among areas and in a crowd the slow stages of the
    last two follow when all goals have been tried quickly: a point further on is often reached long
    before all is tried that may lead to the next one.
    """
    count, quick_first = request.points.size, much_about(request)
    slowly = _Way("fallback", partial(fallback.search, selected=fallback.SLOW))
    refining = _Way("refinement", fallback.refine)
    best = empty(count, options.waypoints)
    source, policy_safe = np.zeros(count, dtype=np.int8), np.zeros(count, dtype=bool)
    for choice in range(options.goals):
        tried = ~best.safe
        if options.rejoin_on_leg and choice:
            costly = best.cost > options.fallback_cost_threshold
            tried |= costly & on_same_leg(request, goals[:, 0], goals[:, choice])
        rows = np.flatnonzero(tried & (goals[:, choice] >= 0))
        if rows.size == 0 or budget.ends(f"goal {choice + 1}"):
            break
        part, goal = request if rows.size == count else take(request, rows), goals[rows, choice]
        if choice and policy_time_over(request, budget):
            plans = empty(rows.size, options.waypoints)
        else:
            flown = roll(part, goal, policy, options, budget, floats=floats)
            plans = evaluate(part, flown, goal, options)
        wanting = ~plans.safe | (plans.cost > options.fallback_cost_threshold)
        if count == 1 and choice == 0 and not wanting[0]:
            # The usual case: there is nothing to compare with.
            return Plans(plans, np.full(1, POLICY, dtype=np.int8), plans.safe)
        best.too_short[rows] |= plans.too_short
        source[keep_best(best, rows, plans)] = POLICY
        if choice == 0:
            policy_safe[rows] = plans.safe
        if wanting.any():
            slow = not quick_first and not best.safe[rows].all()
            stages = fallback.ALL if slow else fallback.QUICK
            searched = fallback.search(take(part, wanting), goal[wanting], options, budget, stages)
            source[keep_best(best, rows[wanting], searched)] = FALLBACK
        if options.exhaustive and not quick_first:
            _search_on(refining, best, source, request, goals[:, choice], options, budget)
    if quick_first:
        ways = [slowly, refining] if options.exhaustive else [slowly]
        for way, choice in itertools.product(ways, range(options.goals)):
            _search_on(way, best, source, request, goals[:, choice], options, budget)
    return Plans(best, source, policy_safe)


class _Way(NamedTuple):
    """A way to search on where there is no safe plan."""

    name: str  # as the budget notes it
    search: Callable[[Request, Array, Options[Narrowed], Budget], Candidates]


def _search_on(
    way: _Way,
    best: Candidates,
    source: Array,
    request: Request,
    goal: Array,
    options: Options[Narrowed],
    budget: Budget,
) -> None:
    """Search on in some way for plans to points ``[N]``, and keep the best, where there is none
    that is safe.
    """
    # Where the route is too short for one manoeuvre it is for all.
    remaining = np.flatnonzero(~best.safe & (goal >= 0) & ~best.too_short)
    if remaining.size and not budget.ends(way.name):
        plans = way.search(take(request, remaining), goal[remaining], options, budget)
        source[keep_best(best, remaining, plans)] = FALLBACK
