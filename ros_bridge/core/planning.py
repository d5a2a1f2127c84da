"""The planner and the policy that answer a task."""

import math
from dataclasses import replace

from agents.planner.answer import Plan
from agents.planner.planner import plan
from agents.planner.request.options import Options
from agents.planner.request.request import Altitude
from agents.policy.inference import Policy
from envs import compiled
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.waypoints import RoutePoint
from ros_bridge.core.tasks import PlanTask


def plan_task(task: PlanTask, policy: Policy, *, exhaustive: bool) -> Plan:
    """Return the plan for a task; an exhaustive search has no deadline."""
    deadline = math.inf if exhaustive else task.options.deadline_s
    options = replace(task.options, exhaustive=exhaustive, deadline_s=deadline)
    return plan(
        task.own,
        task.intruders,
        task.points,
        policy,
        options,
        own_altitude=task.own_altitude,
        wind=task.wind,
        areas=task.areas,
    )


def prepare(policy: Policy | None = None) -> str:
    """Compile what is computed in flight, or load it, and return a sentence about it; ``policy``:
    that is flown. It takes about a minute the first time after an installation.
    """
    if not compiled.may_compile():
        return "computes interpreted, some times slower: numba (extra fast) is missing or forbidden"
    compiled.prepare()
    if policy is not None and policy.decider is None:
        return "computes compiled but for the policy, which has inputs of its own or is of schema 1"
    return "computes compiled"


def rehearse(policy: Policy, options: Options) -> None:
    """Plan once for traffic ahead, so that the first request is answered as fast as the others."""
    spacing, speed = options.aircraft.separation, 0.75 * options.aircraft.limits.speed_max
    route = [RoutePoint(index, 5.0 * spacing * (index + 1), 0.0) for index in range(10)]
    own: VehicleState[Ground] = VehicleState(0.0, 0.0, 0.0, speed)
    intruder: VehicleState[Ground] = VehicleState(9.0 * spacing, 0.0, 3.1, speed)
    level = Altitude(0.0, "wgs84", vertical_speed=0.0)
    options = replace(options, extend_route=True, deadline_s=math.inf, floor=None, ceiling=None)
    plan(own, [intruder], route, policy, options, own_altitude=level)
