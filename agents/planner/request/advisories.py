"""Advisories of a plan for the operator: what the policy was not trained for, what is unknown and
assumed, which intruders are kept other separations from than the others, and which points of the
route are skipped.
"""

from collections.abc import Sequence

import numpy as np

from agents.kernel.levels import Altitude
from agents.planner.answer import Advisory, AdvisoryCode, Field, Subject
from agents.planner.request.observation import distance_scales
from agents.planner.request.options import L, Narrowed, Options
from agents.planner.request.reports import Intruder
from agents.planner.request.request import BEYOND, Request, drift_points
from agents.policy.domain import departures
from agents.policy.inference import Policy
from envs.frames import Air, Ground
from envs.kinematics import VehicleState
from envs.relative import chord
from envs.trees import take
from envs.waypoints import ARCS, PlanStates, RoutePoint, legs
from envs.wind import Wind, through_air


def outside_domain(
    own: VehicleState[Air],
    request: Request,
    goal: int,
    intruders: Sequence[VehicleState[Ground] | Intruder[Ground]],
    wind: Wind | None,
    policy: Policy,
    options: Options,
) -> list[Advisory]:
    """Return what of one request ``[1]`` the policy was not trained for.

    Args:
        own: state of the ownship in floats.
        request: whose traffic and route the policy looks at.
        goal: number of the route's point that comes next; -1: none lies ahead, and the policy
            decides nothing.
        intruders: as they were reported.
        wind: in which they fly.
        policy: that is asked.
        options: of the plan.
    """
    outside = departures(policy.domain, _traffic_quantities(intruders, wind))
    if goal >= 0:
        traffic = take(request.traffic, 0)
        rows = zip(*(field.tolist() for field in traffic.state), strict=True)
        others: list[VehicleState[Air]] = [VehicleState(*row) for row in rows]
        distance_scale = distance_scales(traffic, options.requirement)
        to_x, to_y = float(request.route_x[0, goal]), float(request.route_y[0, goal])
        outside += policy.departures(own, others, to_x, to_y, distance_scale)
    return [Advisory(AdvisoryCode.OUTSIDE_DOMAIN, *departure) for departure in outside]


def _traffic_quantities(
    intruders: Sequence[VehicleState[Ground] | Intruder[Ground]], wind: Wind | None
) -> dict[str, list[float]]:
    """Return the quantities of the operating domain (:mod:`agents.policy.domain`) that the traffic
    has, SI; distances are left out, because far intruders do not matter.
    """
    reported = [intruder for intruder in intruders if isinstance(intruder, Intruder)]
    return {
        "intruders": [len(intruders)],
        "intruder_speed": [_airspeed(intruder, wind) for intruder in intruders],
        "intruder_turn_rate": [abs(report.turn_rate) for report in reported],
        "intruder_separation": [
            report.separation for report in reported if report.separation is not None
        ],
        "position_std": [report.position_std for report in reported],
        "velocity_std": [report.velocity_std for report in reported],
        "latency": [report.age for report in reported],
    }


def _airspeed(intruder: VehicleState[Ground] | Intruder[Ground], wind: Wind | None) -> float:
    state = intruder.state if isinstance(intruder, Intruder) else intruder
    return state.speed if wind is None else through_air(state, wind, 0.0).speed


def assumed_climbs(
    own: Altitude | None,
    intruders: Sequence[VehicleState[Ground] | Intruder[Ground]],
    options: Options,
) -> list[Advisory]:
    """Return which vertical speeds are unknown and assumed, of those that the vertical filter
    uses.
    """
    if own is None:
        return []
    compared = [
        (number, intruder.altitude)
        for number, intruder in enumerate(intruders)
        if isinstance(intruder, Intruder)
        and intruder.altitude is not None
        and intruder.altitude.reference == own.reference
    ]
    fields = [
        Field(Subject.INTRUDERS, "altitude.vertical_speed", number)
        for number, altitude in compared
        if altitude.vertical_speed is None
    ]
    if compared and own.vertical_speed is None:
        fields.insert(0, Field(Subject.OWN_ALTITUDE, "vertical_speed"))
    return [assumed_climb(field, options) for field in fields]


def assumed_climb(field: Field, options: Options[L]) -> Advisory:
    """Return that a vertical speed is unknown, and what is assumed."""
    text = f"is unknown and taken as up to {options.unknown_climb:g} m/s either way"
    return Advisory(AdvisoryCode.ASSUMED, field, text)


def own_separations(
    intruders: Sequence[VehicleState[Ground] | Intruder[Ground]], options: Options
) -> list[Advisory]:
    """Return which intruders are kept other separations from than the others, and which."""
    usual = {
        "separation": options.requirement.separation,
        "vertical_separation": options.vertical_filter,
    }
    advisories = []
    for number, intruder in enumerate(intruders):
        for name, others in usual.items():
            metres = getattr(intruder, name, None)
            if metres is not None and metres != others:
                text = f"is {metres:g} m, of the others {others:g} m"
                field = Field(Subject.INTRUDERS, name, number)
                advisories.append(Advisory(AdvisoryCode.OWN_SEPARATION, field, text))
    return advisories


def skipped_points(
    request: Request,
    plan_states: PlanStates[Air],
    first: int,
    last: int,
    route: Sequence[RoutePoint],
    options: Options[Narrowed],
) -> list[Advisory]:
    """Return which points of the route a plan of one request ``[1]`` does not fly over: it stays
    farther from them than a point is passed at, the goal's radius.

    Args:
        request: among whose points the route's may be numbered anew.
        plan_states: of the plan there, ``[1, W]``.
        first: number of the point that comes next.
        last: of the point that ends the plan.
        route: that was asked for.
        options: of the plan.
    """
    passed = range(first, min(last, int(request.points[0])))
    if not passed:
        return []
    curves = legs(plan_states)
    # The places at the ends of all arcs, which are a few metres beside their chords at most.
    step = curves.duration[..., None] / ARCS
    time = np.append(
        (curves.time[..., None] + np.arange(ARCS) * step).ravel(), plan_states.time[0, -1]
    )
    own_x = np.append(curves.x.ravel(), plan_states.x[0, -1])
    own_y = np.append(curves.y.ravel(), plan_states.y[0, -1])
    advisories = []
    for point in passed:
        number = point if request.of_route is None else int(request.of_route[0, point])
        if not 0 <= number < BEYOND:
            continue
        place = request.route_x[:, point], request.route_y[:, point]
        there_x, there_y = drift_points(place, request.drift, time)
        x, y = own_x - there_x, own_y - there_y
        away = float(chord(x[:-1], y[:-1], x[1:], y[1:]).min())
        if away > options.aircraft.goal_radius:
            text = (
                f"(waypoint {route[number].index}) is skipped: the plan comes no nearer to it than "
                f"{away:.0f} m"
            )
            advisories.append(
                Advisory(AdvisoryCode.SKIPPED, Field(Subject.ROUTE, number=number), text)
            )
    return advisories
