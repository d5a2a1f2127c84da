"""The fallback: a family of extremal manoeuvres, searched for the safe plan of least cost.

The manoeuvres of :mod:`agents.manoeuvres.escape_manoeuvre` are flown against the predicted
intruders. Those that stay clear on the way are ranked by cost, and the first few completed and
validated like any other plan. They stay within the surrogate's limits at first; where that yields
nothing, within those that the legs may have, and with more of them; at the end the nearest misses
are refined by random changes, each judged by the validator itself.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from agents.manoeuvres.escape_manoeuvre import Manoeuvre
from agents.manoeuvres.escape_search import COARSE, ELITES, STAGES, concatenate, offspring, scale
from agents.manoeuvres.simulator import Effort
from agents.planner.request.options import Narrowed, Options, aggressive_limits
from agents.planner.request.request import Request
from agents.planner.search.budget import Budget
from agents.planner.search.candidates import (
    REVERSAL_WEIGHT,
    TIME_WEIGHT,
    Candidates,
    empty,
    evaluate,
    keep_best,
)
from agents.planner.search.fallback_flight import fly_out
from envs.arrays import Array, Int
from envs.trees import take

_BLOCK = 16_384  # manoeuvres in the air at once
_CHEAPEST, _CLEAREST = 4, 2  # plans of a stage that are validated
_HOPELESS = -0.04  # separations of clearance below which no smoothing helps
_ROUNDS = 12
_WITHIN = 0.2  # separations of clearance that small changes can bring
_SOON = 150.0  # time steps by which the manoeuvres of the quick stages turn back
_ENOUGH = 12  # manoeuvres of a request that end well
_JUDGED = 16  # manoeuvres that are validated at once where there is a deadline
_PATIENCE = 3  # rounds of the refinement
_PROGRESS = 0.2  # the part of what is missing that they must bring
# Of metres: manoeuvres that are alike but for rounding stay in the order of their numbers, so that
# plans do not depend on how they are computed.
_DECIMALS = 6
_FIRST = concatenate(*STAGES[:2])
ALL, QUICK, SLOW = slice(None), slice(1), slice(1, None)
"""Stages of the family: all of them, the first one, the others."""

# Also manoeuvres that do not turn back before the intruder has passed.
_SEEDS = concatenate(COARSE, COARSE._replace(resume=COARSE.resume + 25.0))


def search(
    request: Request,
    goal: Int[Array, " N"],
    options: Options[Narrowed],
    budget: Budget,
    selected: slice = ALL,
) -> Candidates:
    """Return the best plan that the family's stages, or some of them, hold, ``[N]``; ``goal`` is
    the number of the point to rejoin at.
    """
    best, aircraft = empty(goal.size, options.waypoints), options.aircraft
    last = replace(options, manoeuvre=aggressive_limits(options))
    stages = [(_FIRST, options, _SOON), (_SEEDS, last, _SOON)]
    stages += [(STAGES[3], last, np.inf)] if options.exhaustive else []
    for stage, stage_options, longest in stages[selected]:
        effort = Effort(
            least=_HOPELESS * aircraft.separation,
            good=options.smoothing,
            enough=_ENOUGH,
            longest=longest * aircraft.dt,
            ends=partial(budget.ends, "fallback"),
        )
        for part in _parts(np.flatnonzero(~best.safe), stage.turn.size):
            if budget.ends("fallback"):
                return best
            _improve(best, part, request, goal, scale(stage, aircraft), stage_options, effort)
    return best


def refine(
    request: Request, goal: Int[Array, " N"], options: Options[Narrowed], budget: Budget
) -> Candidates:
    """Return the best plan of a random refinement of the nearest misses, ``[N]``."""
    options = replace(options, manoeuvre=aggressive_limits(options))
    best, aircraft = empty(goal.size, options.waypoints), options.aircraft
    seeds, within = np.stack(scale(_SEEDS, aircraft)), _WITHIN * aircraft.separation
    history = np.full((goal.size, _ROUNDS + 1), -np.inf)
    for part in _parts(np.arange(goal.size), _SEEDS.turn.size):
        remaining, pool, scores = (
            part,
            np.zeros((len(seeds), part.size, 0)),
            np.zeros((part.size, 0)),
        )
        coarse = np.broadcast_to(seeds[:, None], (len(seeds), part.size, seeds.shape[-1]))
        for index in range(_ROUNDS + 1):
            if budget.ends("refinement"):
                return best
            tried = offspring(pool, index - 1, aircraft) if index else coarse
            # What begins was validated by the stages before as far as it was promising.
            score = _try_out(best, remaining, request, goal, tried, options, budget, index > 0)
            pool = np.concatenate([pool, tried], axis=-1)
            scores = np.concatenate([scores, score], axis=-1)
            order = _elites(pool[0], scores)
            pool = np.take_along_axis(pool, order[None], axis=-1)
            scores = np.take_along_axis(scores, order, axis=-1)
            history[remaining, index] = scores.max(axis=-1)
            going_on = ~best.safe[remaining] & _promising(history[remaining], index, within)
            remaining, pool, scores = remaining[going_on], pool[:, going_on], scores[going_on]
            if remaining.size == 0:
                break
    return best


def _promising(history: Array, index: int, within: float) -> Array:
    """Return whether more changes may help requests, bool ``[n]``, by their best scores so far, m,
    ``[n, rounds]``: those are within reach of a safe plan, and the latest rounds brought them
    nearer.
    """
    latest = history[:, index]
    promising = latest >= -within
    if index >= _PATIENCE:
        before = history[:, index - _PATIENCE]
        promising &= latest - before >= _PROGRESS * -before
    return promising


def _elites(turn: Array, scores: Array) -> Array:
    """Return the numbers of the best manoeuvres ``[n, ELITES]``, half to each side, or all would
    soon turn to one.
    """
    half = ELITES // 2
    sides = (np.where(side, scores, scores - 1e9) for side in (turn >= 0.0, turn < 0.0))
    return np.concatenate(
        [np.argsort(-side, axis=-1, kind="stable")[:, :half] for side in sides], axis=-1
    )


def _try_out(
    best: Candidates,
    remaining: Array,
    request: Request,
    goal: Array,
    tried: Array,
    options: Options[Narrowed],
    budget: Budget,
    judge: bool,
) -> Array:
    """Fly manoeuvres ``[8, n, M]``, perhaps judge them as plans; return how near each is to a safe
    one, ``[n, M]``.
    """
    request, goal = take(request, remaining), goal[remaining]
    owner = np.repeat(np.arange(remaining.size), tried.shape[-1])
    family = Manoeuvre(*(np.ascontiguousarray(field).ravel() for field in tried))
    effort = Effort(
        -np.inf, options.smoothing, enough=tried.size, ends=partial(budget.ends, "fallback")
    )
    rollout, closest = fly_out(request, goal, owner, family, options, effort)
    score = np.round(np.minimum(closest, 1e4), _DECIMALS)
    score -= np.where(np.isfinite(rollout.time), 0.0, 1e6)
    # The most promising first: there may be no time for the others.
    order = np.argsort(-score, kind="stable") if judge else owner[:0]
    block = tried[0].size if budget.endless else _JUDGED
    for first in range(0, order.size, block):
        if budget.ends("refinement"):
            break
        rows = order[first : first + block]
        plans = evaluate(
            take(request, owner[rows]), take(rollout, rows), goal[owner[rows]], options
        )
        keep_best(best, remaining[owner[rows]], plans)
        # What misses the goal or a limit comes after all that do not.
        clearance, has_clearance = plans.findings.clearance, np.isfinite(plans.findings.clearance)
        fault = np.where(plans.findings.legal, 0.0, np.where(has_clearance, 1e5, 1e6))
        score[rows] = np.minimum(np.where(has_clearance, clearance, closest[rows]), 1e4) - fault
    return score.reshape(remaining.size, -1)


def _improve(
    best: Candidates,
    part: Array,
    request: Request,
    goal: Array,
    stage: Manoeuvre,
    options: Options[Narrowed],
    effort: Effort,
) -> None:
    """Fly a stage of the family for the requests numbered ``part``, and note the best plans that
    its most promising manoeuvres become.
    """
    count, reversal = stage.turn.size, REVERSAL_WEIGHT * options.aircraft.separation
    request, goal, owner = take(request, part), goal[part], np.repeat(np.arange(part.size), count)
    family = Manoeuvre(*(np.tile(field, part.size) for field in stage))
    rollout, clearance = fly_out(request, goal, owner, family, options, effort)
    arrived = np.isfinite(rollout.time) & (clearance >= effort.least)
    # The same cost as of plans, but for what is equal for all manoeuvres of a request.
    to_x, to_y = (field[owner, goal[owner]] for field in (request.route_x, request.route_y))
    to_goal = np.hypot(to_x - rollout.end.x, to_y - rollout.end.y)
    time = rollout.time + to_goal / rollout.end.speed
    cost = (
        rollout.path
        + to_goal
        + TIME_WEIGHT * time * request.own.speed[owner]
        + reversal * rollout.reversals
    )
    cost = np.where(arrived, cost + 20.0 * np.maximum(options.smoothing - clearance, 0.0), np.inf)
    picked = np.zeros((part.size, count), dtype=bool)
    for order, most in ((cost, _CHEAPEST), (np.where(arrived, -clearance, np.inf), _CLEAREST)):
        ranked = np.round(order.reshape(-1, count), _DECIMALS)
        first = np.argsort(ranked, axis=-1, kind="stable")[:, :most]
        np.put_along_axis(picked, first, True, axis=-1)
    rows = np.flatnonzero(picked.ravel() & arrived)
    if rows.size:
        owners = owner[rows]
        plans = evaluate(take(request, owners), take(rollout, rows), goal[owners], options)
        keep_best(best, part[owners], plans)


def _parts(rows: Array, count: int) -> list[Array]:
    """Return rows in parts of which so many manoeuvres each are in the air at once."""
    size = max(_BLOCK // count, 1)
    return [rows[first : first + size] for first in range(0, rows.size, size)]
