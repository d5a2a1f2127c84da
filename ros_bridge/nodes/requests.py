# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""Requests for a plan: what is refused before anything is planned, and the planner and policy that
answer the rest.
"""

import math
from dataclasses import replace

from rlcas_msgs.srv import GenerateTrajectory

from agents.planner.answer import Plan
from agents.planner.planner import plan
from agents.planner.request import Options
from agents.policy.inference import Policy
from envs.kinematics import VehicleState
from envs.waypoints import RoutePoint
from ros_bridge.core.fields import SECOND, FieldError, stamp
from ros_bridge.core.situation import Code, Refusal, Settings, Task, check_age

NO_PLAN = bytes(16)
"""In a request: no plan in particular."""


def check(
    request: GenerateTrajectory.Request, now: int, settings: Settings, holding: bytes
) -> None:
    """Raise :class:`Refusal` for a request of an unknown reason, time or plan; ``now`` is in ns."""
    known = (request.REASON_ALERT, request.REASON_REPLAN, request.REASON_MANUAL)
    if request.reason not in known:
        raise Refusal(
            Code.INVALID_REQUEST,
            "request.reason",
            f"is {request.reason}, expected one of {list(known)}",
        )
    field, sent = "request.header.stamp", request.header.stamp
    if now > 0 and (sent.sec or sent.nanosec):
        try:
            age = (now - stamp(field, sent)) / SECOND
        except FieldError as error:
            raise Refusal(Code.INVALID_REQUEST, error.field, error.problem) from error
        check_age("REQUEST", field, age, settings.request_max_age, settings.future_tolerance)
    previous = bytes(request.previous_id.uuid)
    if previous not in (NO_PLAN, holding):
        what = (
            f"is {previous.hex()}, but the plan that holds is "
            f"{'none' if holding == NO_PLAN else holding.hex()}"
        )
        raise Refusal(Code.SUPERSEDED, "request.previous_id", what)


def planned(wanted: Task, policy: Policy, *, exhaustive: bool) -> Plan:
    """Return the plan for a task; an exhaustive search has no deadline."""
    deadline = math.inf if exhaustive else wanted.options.deadline_s
    options = replace(wanted.options, exhaustive=exhaustive, deadline_s=deadline)
    return plan(
        wanted.own,
        wanted.intruders,
        wanted.points,
        policy,
        options,
        own_altitude=wanted.own_altitude,
        wind=wanted.wind,
        areas=wanted.areas,
    )


def rehearsed(policy: Policy, options: Options) -> None:
    """Plan once for traffic ahead, so that the first request is answered as fast as the others."""
    far, speed = options.aircraft.separation, 0.75 * options.aircraft.limits.speed_max
    route = [RoutePoint(index, 5.0 * far * (index + 1), 0.0) for index in range(10)]
    own, other = VehicleState(0.0, 0.0, 0.0, speed), VehicleState(9.0 * far, 0.0, 3.1, speed)
    plan(own, [other], route, policy, replace(options, extend_route=True, deadline_s=math.inf))
