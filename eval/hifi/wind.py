"""Plans made for a wind: the planner works in the air mass, through which the route drifts.

A route's point p that is reached after T seconds lies at p - w (t + T) in the frame that moves with
the wind w, t being the time of the request. When each point will be reached is known only from the
plan: the plan is made again until times and plan agree, to within the metres by which manoeuvres
enter the goal's disc deeper than they must.
"""

import math
from typing import NamedTuple

import numpy as np

from agents.planner.candidates import empty
from agents.planner.options import speed_range
from agents.planner.planner import Plans, plan_many
from agents.planner.request import Options, Request
from agents.planner.traffic import Traffic
from agents.policy.inference import Policy
from envs.c208.air_mass import NO_WIND, Wind
from envs.kinematics import VehicleState
from envs.waypoints import Legs

_ROUNDS, _STRAIGHT = 10, 2
_SLOWEST = 5.0  # over the ground along the route, m/s


class Route(NamedTuple):
    """Points on a straight line over the ground, the first at the start; ``[R]`` each."""

    x: np.ndarray
    y: np.ndarray


class Made(NamedTuple):
    """A plan for a wind."""

    plans: Plans  # [1], in the air mass
    request: Request | None  # that it answers, [1]; None where none could be made
    problem: (
        str | None
    )  # why the planner was not asked, or its answer does not count; None: it does


def made_good(airspeed: float, course: float, wind: Wind) -> float:
    """Return the ground speed along a course (rad) at an airspeed, m/s; nan where the wind across
    it is too strong.
    """
    along = wind[0] * math.cos(course) + wind[1] * math.sin(course)
    across = wind[1] * math.cos(course) - wind[0] * math.sin(course)
    if abs(across) >= airspeed:
        return math.nan
    return along + math.sqrt(airspeed * airspeed - across * across)


def plan_for(
    own: VehicleState,
    traffic: Traffic,
    route: Route,
    clock: float,
    wind: Wind,
    policy: Policy,
    options: Options,
) -> Made:
    """Plan a request ``clock`` s after the start, in an air mass, in which own state and traffic
    ``[1, K]`` are.
    """
    low, high = speed_range(options.aircraft.limits)
    none = Plans(empty(1, options.waypoints), np.zeros(1, dtype=np.int8), np.zeros(1, dtype=bool))
    if not low <= own.speed <= high:
        return Made(
            none, None, f"own air speed is {own.speed:.1f} m/s, expected {low:g} to {high:g} m/s"
        )
    course = math.atan2(route.y[-1] - route.y[0], route.x[-1] - route.x[0])
    if not made_good(own.speed, course, wind) >= _SLOWEST:
        return Made(
            none,
            None,
            f"the wind of {math.hypot(*wind):.1f} m/s cannot be made good along the route",
        )
    # How far each point lies ahead along the route, m.
    x, y = own.x + wind[0] * clock, own.y + wind[1] * clock
    ahead = (route.x - x) * math.cos(course) + (route.y - y) * math.sin(course)
    times = np.maximum(ahead, 0.0) / made_good(own.speed, course, wind)
    one = VehicleState(*(np.array([float(field)]) for field in own))
    points = np.array([route.x.size])
    strength = math.hypot(*wind)
    plans, request = none, None
    for attempt in range(_ROUNDS):
        x, y = (field - part * (clock + times) for field, part in zip(route, wind, strict=True))
        request = Request(one, traffic, x[None], y[None], points)
        plans = plan_many(request, policy, options, floats=True)
        made, goal = plans.proposals, int(plans.proposals.goal[0])
        if wind == NO_WIND or goal < 0:
            return Made(plans, request, None)
        rejoin = float(made.rejoin_time[0])
        if strength * abs(rejoin - float(times[goal])) <= options.rejoin_reserve:
            return Made(plans, request, None)
        # The points beyond follow at the ground speed that the plan's end makes along the route.
        pace = made_good(float(made.knots.speed[0, -1]), course, wind)
        if not pace >= _SLOWEST:
            return Made(
                plans,
                request,
                f"the wind of {strength:.1f} m/s cannot be made good at the plan's end",
            )
        beyond = rejoin + (ahead - ahead[goal]) / pace
        share = np.maximum(ahead, 0.0) / max(float(ahead[goal]), 1.0)
        found = np.where(ahead >= ahead[goal], beyond, rejoin * share)
        # Two plans that ask for each other's route would alternate for ever.
        times = found if attempt < _STRAIGHT else 0.5 * (times + found)
    return Made(
        plans, request, f"no plan meets the route that drifts in {strength:.1f} m/s of wind"
    )


def unflyable(legs: Legs, reach: tuple[float, float]) -> str | None:
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
