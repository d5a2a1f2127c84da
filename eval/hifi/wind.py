"""Plans from the middle of a flight in a wind, and whether the vehicle can fly them."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from agents.kernel.levels import Altitude
from agents.kernel.traffic import Traffic
from agents.planner.answer import RequestError
from agents.planner.planner import Plans, RequestFields, plan_among, plan_many, search_in_space
from agents.planner.request.options import Narrowed, Options, speed_range
from agents.planner.request.reports import Intruder
from agents.planner.request.request import Request, in_wind
from agents.planner.search.budget import Budget
from agents.planner.search.candidates import empty
from agents.planner.search.in_space import Climber, plan_each_in_space
from agents.policy.inference import Policy
from envs.altitudes import REFERENCE
from envs.areas import Area
from envs.frames import Air, Ground
from envs.kinematics import VehicleState
from envs.profile import Profile
from envs.waypoints import Legs, RoutePoint
from envs.wind import NO_WIND, Wind
from eval.flights.among_areas import as_row, in_air_mass


class Route(NamedTuple):
    """Points on a straight line over the ground, the first at the start; ``[R]`` each."""

    x: np.ndarray
    y: np.ndarray


class PlanResult(NamedTuple):
    """A plan for a wind."""

    plans: Plans  # [1], in the air mass
    request: Request | None  # that it answers, [1]; None where none could be made
    problem: str | None  # why the planner was not asked; None: it was
    profile: Profile | None = None  # of its altitudes; None: a plan in the plane


def options_in(wind: Wind, options: Options) -> Options[Narrowed]:
    """Return the options of plans that keep the limits in every wind within the uncertainty of one
    that is known; raises a RequestError where it leaves nothing of them.
    """
    return in_wind(options, None if wind.std == 0.0 else wind)


def plan_for(  # noqa: PLR0913 - a request, and all that it stands in
    own: VehicleState[Air],
    traffic: Traffic,
    route: Route,
    clock: float,
    wind: Wind,
    policy: Policy,
    options: Options[Any],
    areas: tuple[Area, ...] = (),
    *,
    climber: Climber | None = None,
) -> PlanResult:
    """Plan a request ``clock`` s after the start, in an air mass, in which own state and traffic
    ``[1, K]`` are; areas as they are over the ground at the start. Where the plan may climb and
    descend a climber says the altitudes.
    """
    low, high = speed_range(options.aircraft.limits)
    if not low <= own.speed <= high:
        text = f"own air speed is {own.speed:.1f} m/s, expected {low:g} to {high:g} m/s"
        return PlanResult(_none(options), None, text)
    try:
        in_air = options_in(wind, options)
    except RequestError as problem:
        return PlanResult(_none(options), None, str(problem))
    own_row: VehicleState[Air] = VehicleState(*(np.array([float(field)]) for field in own))
    drift = None if wind == NO_WIND else (np.array([-wind.east]), np.array([-wind.north]))
    x, y = route.x - wind.east * clock, route.y - wind.north * clock
    request = Request(own_row, traffic, x[None], y[None], np.array([x.size]), drift)
    areas_in_air = in_air_mass(areas, wind, clock)
    if climber is not None:
        among = climber._replace(areas=areas_in_air)
        return PlanResult(plan_each_in_space(request, [among], policy, in_air), request, None)
    if not areas:
        return PlanResult(plan_many(request, policy, in_air, floats=True), request, None)
    around = as_row(areas_in_air)
    return PlanResult(plan_among(request, around, policy, in_air, floats=True), request, None)


def plan_in_space(
    own: VehicleState[Ground],
    intruders: Sequence[Intruder[Ground]],
    route: Route,
    altitude: float,
    wind: Wind,
    policy: Policy,
    options: Options[Any],
    areas: tuple[Area, ...] = (),
) -> PlanResult:
    """Plan a request at the start that may climb and descend; everything is over the ground.

    The ownship flies level at an altitude, m above the sea, which is that of the route.
    """
    points = zip(route.x.tolist(), route.y.tolist(), strict=True)
    fields = RequestFields(
        own,
        intruders,
        [RoutePoint(number, x, y) for number, (x, y) in enumerate(points)],
        Altitude(altitude, REFERENCE, 0.0),
        wind,
        areas,
    )
    try:
        posed, plans = search_in_space(fields, policy, options_in(wind, options), Budget())
    except RequestError as problem:
        return PlanResult(_none(options), None, str(problem))
    return PlanResult(plans, posed.request, None, posed.profile)


def _none(options: Options[Any]) -> Plans:
    """Return that there is no plan, ``[1]``."""
    return Plans(empty(1, options.waypoints), np.zeros(1, dtype=np.int8), np.zeros(1, dtype=bool))


def unflyable(legs: Legs[Air], reach: tuple[float, float]) -> str | None:
    """Return why a vehicle with a slowest and a fastest air speed, m/s, cannot fly legs ``[L]``;
    None where it can.
    """
    speed = np.stack(
        [legs.speed, legs.speed + legs.acceleration * legs.duration[:, None] / legs.x.shape[-1]]
    )
    (slow, fast), (low, high) = (speed.min(), speed.max()), reach
    if low <= slow and fast <= high:
        return None
    return (
        f"the plan asks for air speeds of {slow:.1f} to {fast:.1f} m/s, the vehicle has "
        f"{low:.1f} to {high:.1f} m/s"
    )
