"""The planner: a safe way round the intruders and back onto the route, as 20 waypoints, or why
there is none.

Manoeuvres are the policy, rolled ahead in the surrogate to the next point of the route, and where
its plan does not pass the validator a family that is searched; after that the same for the points
beyond. Each goes through one pipeline (:mod:`agents.planner.search.candidates`): completed to a
plan, validated, kept where it is the best so far.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from agents.kernel.levels import Altitude
from agents.planner.answer import Plan
from agents.planner.publish.certificate import Evidence
from agents.planner.publish.publish import publish
from agents.planner.request.advisories import (
    assumed_climbs,
    outside_domain,
    own_separations,
    skipped_points,
)
from agents.planner.request.options import Narrowed, Options, check
from agents.planner.request.reports import Intruder
from agents.planner.request.request import Request, check_finite, check_request, in_wind
from agents.planner.search import fallback
from agents.planner.search.airspace import add_areas
from agents.planner.search.budget import Budget
from agents.planner.search.candidates import Candidates, Plans, empty, evaluate, keep_best
from agents.planner.search.continuation import CROWD
from agents.planner.search.goals import next_goals, on_same_leg
from agents.planner.search.rollout import roll
from agents.policy.inference import Policy
from envs.areas import Area
from envs.arrays import Array
from envs.frames import Air, Ground
from envs.kinematics import VehicleState
from envs.trees import map_leaves, scatter, take
from envs.waypoints import RoutePoint
from envs.wind import NO_WIND, Wind, over_ground

_POLICY, _FALLBACK = 1, 2  # codes of sources


def plan(
    own: VehicleState[Ground],
    intruders: Sequence[VehicleState[Ground] | Intruder[Ground]],
    route: Sequence[RoutePoint],
    policy: Policy,
    options: Options | None = None,
    *,
    own_altitude: Altitude | None = None,
    wind: Wind | None = None,
    areas: Sequence[Area] = (),
) -> Plan:
    """Plan one request.

    States, route and waypoints are over the ground. In a wind the aircraft's limits hold in the air
    mass, in every wind within its uncertainty, and so do the speeds of the operating domain; the
    separation holds over the ground, where the plan is flown by place and time.

    Args:
        own: state of the ownship, its speed inside the envelope.
        intruders: any number of them. The policy looks at the most critical, as many as it was
            trained with; the plan is validated against all that can come near.
        route: what is left of it, two points at least; the next one first.
        options: how the plan is made; None: the policy's aircraft's.
        own_altitude: for the vertical filter; None: unknown, all intruders count. Vertical speeds
            that are unknown are taken as ``options.unknown_climb`` towards the other aircraft.
        wind: in which the aircraft fly; None: still air. A turning intruder turns through it.
        areas: that must not be entered, or not be left (:mod:`envs.areas`). Points of the route
            that lie in them are passed over; an advisory names each.

    Returns:
        A plan, SAFE or UNRESOLVED with the reasons and the trajectory of greatest separation that
        is known.

    Raises:
        RequestError: the request is incomplete, out of range or inconsistent; it names the field.
    """
    if options is not None:
        check(options)
    options = options or Options.for_aircraft(policy.aircraft)
    in_air = in_wind(options, wind)
    request, excluded, counted = check_request(own, intruders, route, in_air, own_altitude, wind)
    request, notes = add_areas(request, areas, own_altitude, in_air, wind)
    start: VehicleState[Air] = VehicleState(*(float(field[0]) for field in request.own))
    budget = Budget(options.deadline_s)
    goals = next_goals(request, in_air)
    plans = _plan_rows(request, goals, policy, in_air, budget, floats=True)
    goal, skipped = int(goals[0, 0]), tuple(budget.skipped)
    answer = publish(request, plans, goal, route, excluded, counted, in_air, skipped)
    assumed = *assumed_climbs(own_altitude, intruders, options), *notes
    best = plans.candidates
    passed_by = (
        skipped_points(request, best.plan_states, goal, int(best.last[0]), route, in_air)
        if answer.safe
        else []
    )
    evidence = Evidence(
        over_ground(start, NO_WIND, 0.0) if wind is None else VehicleState(*map(float, own)),
        tuple(intruders),
        answer.waypoints,
        excluded,
        own_altitude,
        options,
        wind,
        tuple(areas),
    )
    return replace(
        answer,
        advisories=(
            *answer.advisories,
            *outside_domain(start, request, goal, intruders, wind, policy, options),
            *dict.fromkeys(assumed),  # each once
            *own_separations(intruders, options),
            *passed_by,
        ),
        policy_sha256=policy.sha256,
        wind=wind,
        evidence=evidence if answer.safe else None,
    )


def plan_many(
    request: Request, policy: Policy, options: Options[Narrowed], *, floats: bool = False
) -> Plans:
    """Plan many requests ``[N]``, in range, each as if it were alone, and without a deadline.

    With ``floats`` the policy is rolled one request after the other in plain floats: ten times
    faster for one, and rounded differently. Raises a RequestError where a number is not finite.
    """
    check_finite(request)
    goals, mask = next_goals(request, options), request.traffic.mask
    few = np.count_nonzero(mask, axis=-1) <= CROWD
    if mask.shape[-1] <= CROWD or not few.any():
        return _plan_rows(request, goals, policy, options, Budget(), floats=floats)
    # Each as if it were alone: those with few intruders are not searched like a crowd's.
    plans = Plans(empty(few.size, options.waypoints), np.zeros(few.size, np.int8), np.array(few))
    for some, most in ((few, CROWD), (~few, mask.shape[-1])):
        rows = np.flatnonzero(some)
        if rows.size == 0:
            continue
        part, order = _compact(take(request, rows), most)
        planned = _plan_rows(part, goals[rows], policy, options, Budget(), floats=floats)
        number = planned.candidates.findings.intruder
        number[:] = np.where(number >= 0, order[np.arange(rows.size), number], -1)
        scatter(plans, rows, planned)
    return plans


def plan_among(
    request: Request,
    areas: Array,
    policy: Policy,
    options: Options[Narrowed],
    *,
    floats: bool = False,
) -> Plans:
    """Plan many requests ``[N]`` as :func:`plan_many` does, each among areas of its own.

    Args:
        request: without areas.
        areas: as they are at the request, seen from the air mass, object ``[N]``.
        policy: that is asked.
        options: of the flights.
        floats: as of :func:`plan_many`.
    """
    plans = []
    for n in range(request.points.size):
        single, _ = add_areas(take(request, slice(n, n + 1)), areas[n], None, options, None)
        plans.append(plan_many(single, policy, options, floats=floats))
    return map_leaves(lambda *rows: np.concatenate(rows), *plans)


def _compact(request: Request, most: int) -> tuple[Request, Array]:
    """Return requests with their intruders first and room for so many, and the intruders' numbers
    before, ``[N, most]``.
    """
    order = np.argsort(~request.traffic.mask, axis=-1, kind="stable")[:, :most]
    traffic = map_leaves(lambda field: np.take_along_axis(field, order, axis=-1), request.traffic)
    return request._replace(traffic=traffic), order


def _plan_rows(
    request: Request,
    goals: Array,
    policy: Policy,
    options: Options[Narrowed],
    budget: Budget,
    *,
    floats: bool,
) -> Plans:
    """Plan requests of which every number is finite, to points of the route ``[N, goals]``.

    Goals are tried one after the other where no plan is safe yet, or where others on the same leg
    are as welcome and it costs much: the policy, then the fallback where the policy's plan is not
    safe or costs much, at the end the refinement. Among areas the slow stages of the last two
    follow when all goals have been tried quickly.
    """
    count = request.points.size
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
        flown = roll(part, goal, policy, options, budget, floats=floats)
        plans = evaluate(part, flown, goal, options)
        wanting = ~plans.safe | (plans.cost > options.fallback_cost_threshold)
        if count == 1 and choice == 0 and not wanting[0]:
            # The usual case: there is nothing to compare with.
            return Plans(plans, np.full(1, _POLICY, dtype=np.int8), plans.safe)
        best.too_short[rows] |= plans.too_short
        source[keep_best(best, rows, plans)] = _POLICY
        if choice == 0:
            policy_safe[rows] = plans.safe
        if wanting.any():
            slow = request.areas is None and not best.safe[rows].all()
            stages = fallback.ALL if slow else fallback.QUICK
            searched = fallback.search(take(part, wanting), goal[wanting], options, budget, stages)
            source[keep_best(best, rows[wanting], searched)] = _FALLBACK
        if request.areas is None and options.exhaustive:
            _search_on(fallback.refine, best, source, request, goals[:, choice], options, budget)
    if request.areas is not None:
        # Points of a route round areas stand close together: the next one is tried long before
        # much is tried to reach one.
        ways = [partial(fallback.search, which=fallback.SLOW)]
        ways += [fallback.refine] if options.exhaustive else []
        for way, choice in itertools.product(ways, range(options.goals)):
            _search_on(way, best, source, request, goals[:, choice], options, budget)
    return Plans(best, source, policy_safe)


def _search_on(
    way: Callable[[Request, Array, Options[Narrowed], Budget], Candidates],
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
    left = np.flatnonzero(~best.safe & (goal >= 0) & ~best.too_short)
    if left.size:
        plans = way(take(request, left), goal[left], options, budget)
        source[keep_best(best, left, plans)] = _FALLBACK
