"""The planner: a safe way round the intruders and back onto the route, as 20 waypoints, or why
there is none.

Manoeuvres are the policy, rolled ahead in the surrogate to the next point of the route, and where
its plan does not pass the validator a family that is searched; after that the same for the points
beyond. Each goes through one pipeline (:mod:`agents.planner.search.candidates`): completed to a
plan, validated, kept where it is the best so far.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from agents.kernel.levels import Altitude, steady
from agents.planner.answer import Apart, Excluded, Field, Plan, Subject
from agents.planner.publish.certificate import Evidence
from agents.planner.publish.publish import Posed, publish
from agents.planner.request.advisories import (
    assumed_climbs,
    outside_domain,
    own_separations,
    skipped_points,
)
from agents.planner.request.climbs import check_climbs, in_plane
from agents.planner.request.options import Narrowed, Options, check
from agents.planner.request.reports import Intruder, check_altitude, reports_in_air
from agents.planner.request.request import Request, check_finite, check_request, in_wind
from agents.planner.search.airspace import add_areas, check_areas
from agents.planner.search.budget import Budget
from agents.planner.search.candidates import Plans, empty
from agents.planner.search.climbs import Start
from agents.planner.search.continuation import CROWD
from agents.planner.search.goals import next_goals
from agents.planner.search.horizontal import plan_rows
from agents.planner.search.in_space import SpaceTask, plan_in_space
from agents.policy.inference import Policy
from envs.areas import Area
from envs.areas import in_air as area_in_air
from envs.arrays import Array, Shaped
from envs.frames import Air, Ground
from envs.kinematics import VehicleState
from envs.trees import map_leaves, scatter, take
from envs.waypoints import RoutePoint
from envs.wind import NO_WIND, Wind, over_ground


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
            that lie in them are passed over; an advisory names each. Where the floor or ceiling of
            one not to be left has another reference than the own altitude, the plan keeps the
            height, and an advisory says so.

    Returns:
        A plan, SAFE or UNRESOLVED with the reasons and the trajectory of greatest separation that
        is known.

    Raises:
        RequestError: the request is incomplete, out of range or inconsistent; it names the field.
    """
    if options is not None:
        check(options)
    options = options or Options.for_aircraft(policy.aircraft)
    budget = Budget(options.deadline_s)
    fields = RequestFields(own, intruders, route, own_altitude, wind, check_areas(areas))
    check_altitude(Field(Subject.OWN_ALTITUDE), own_altitude)
    options, kept_height = in_plane(own_altitude, fields.areas, options)
    search = search_in_space if options.climbs else _search_in_plane
    posed, plans = search(fields, policy, in_wind(options, wind), budget)
    request, excluded, in_air = posed.request, posed.excluded, posed.options
    start: VehicleState[Air] = VehicleState(*(float(field[0]) for field in request.own))
    goal, skipped = int(next_goals(request, in_air)[0, 0]), tuple(budget.skipped)
    answer = publish(posed, plans, goal, route, own_altitude, skipped)
    assumed = *assumed_climbs(own_altitude, intruders, options), *kept_height, *posed.notes
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


class RequestFields(NamedTuple):
    """A request as it was given."""

    own: VehicleState[Ground]
    intruders: Sequence[VehicleState[Ground] | Intruder[Ground]]
    route: Sequence[RoutePoint]
    own_altitude: Altitude | None
    wind: Wind | None
    areas: Sequence[Area]


def _search_in_plane(
    fields: RequestFields, policy: Policy, options: Options[Narrowed], budget: Budget
) -> tuple[Posed, Plans]:
    """Return a request as it is searched, and the best plan in the plane."""
    own, intruders, route, own_altitude, wind, areas = fields
    request, excluded, counted = check_request(own, intruders, route, options, own_altitude, wind)
    request, notes = add_areas(request, areas, steady(own_altitude), options, wind)
    goals = next_goals(request, options)
    plans = plan_rows(request, goals, policy, options, budget, floats=True)
    return Posed(request, excluded, counted, options, notes), plans


def search_in_space(
    fields: RequestFields, policy: Policy, options: Options[Narrowed], budget: Budget
) -> tuple[Posed, Plans]:
    """Return a request as it is searched, with the profile, and the best plan ``[1]`` that may
    climb and descend.

    Raises:
        RequestError: as :func:`plan` does.
    """
    own, intruders, route, own_altitude, wind, areas = fields
    # Who is above or below depends on the plan.
    request, excluded, level = check_request(own, intruders, route, options, None, wind)
    altitude, target, options = check_climbs(own_altitude, route, areas, options)
    times = [leg * options.interval for leg in range(1, options.waypoints)]
    reports = reports_in_air(intruders, wind)
    case, plans, _ = plan_in_space(
        SpaceTask(
            request,
            [reports[number] for number in level],
            Start(altitude, target, times),
            areas if wind is None else [area_in_air(area, wind) for area in areas],
            lambda request, flight: add_areas(request, areas, flight, options, wind),
            policy,
            options,
            budget,
        )
    )
    counted = [level[number] for number in case.counted]
    text = "stays above or below on the plan's altitudes"
    excluded += tuple(
        Excluded(number, text, math.inf, Apart.VERTICALLY)
        for number in level
        if number not in counted
    )
    return Posed(case.request, excluded, counted, options, case.notes, case.profile), plans


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
        return plan_rows(request, goals, policy, options, Budget(), floats=floats)
    # Each as if it were alone: those with few intruders are not searched like a crowd's.
    plans = Plans(empty(few.size, options.waypoints), np.zeros(few.size, np.int8), np.array(few))
    for chosen, most in ((few, CROWD), (~few, mask.shape[-1])):
        rows = np.flatnonzero(chosen)
        if rows.size == 0:
            continue
        part, order = _compact(take(request, rows), most)
        planned = plan_rows(part, goals[rows], policy, options, Budget(), floats=floats)
        number = planned.candidates.findings.intruder
        number[:] = np.where(number >= 0, order[np.arange(rows.size), number], -1)
        scatter(plans, rows, planned)
    return plans


def plan_among(
    request: Request,
    areas: Shaped[Array, " N"],
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
        single, _ = add_areas(take(request, slice(n, n + 1)), areas[n], (), options)
        plans.append(plan_many(single, policy, options, floats=floats))
    return map_leaves(lambda *rows: np.concatenate(rows), *plans)


def _compact(request: Request, most: int) -> tuple[Request, Array]:
    """Return requests with their intruders first and room for so many, and the intruders' numbers
    before, ``[N, most]``.
    """
    order = np.argsort(~request.traffic.mask, axis=-1, kind="stable")[:, :most]
    traffic = map_leaves(lambda field: np.take_along_axis(field, order, axis=-1), request.traffic)
    return request._replace(traffic=traffic), order
