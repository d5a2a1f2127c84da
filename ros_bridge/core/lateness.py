"""A plan that took long to find: checked again from where everybody is by the time that it is there."""

from dataclasses import replace

import numpy as np

from agents.planner.answer import Kind, Plan, Reason, RequestError, Status
from agents.planner.request import checked
from agents.planner.validator import CHECKS, validate
from envs.waypoints import Knots, knots
from ros_bridge.core.fields import SECOND
from ros_bridge.core.situation import Task

__all__ = ["by_then"]

_JOIN = 5.0
"""Least time to the waypoint that is joined, s: a shorter leg turns every difference into a hard turn."""


def by_then(plan: Plan, asked: Task, present: Task) -> Plan:
    """Return a plan as it is worth by now: SAFE only if it still is from the ownship's present state on.

    Args:
        plan: made for ``asked``.
        asked: of the request.
        present: the task as it would be asked now.
    """
    late = (present.time - asked.time) / SECOND
    if not plan.safe or late <= 0.0:
        return plan
    left = [replace(point, time=point.time - late) for point in plan.waypoints if point.time - late >= _JOIN]
    try:
        request, _, _ = checked(present.own, present.intruders, present.points, present.options, present.own_altitude)
    except RequestError as error:
        return _void(plan, late, str(error))
    curve = Knots(*(field[None] for field in knots(present.own, left)))
    found = validate(curve, request.traffic, present.options.requirement, present.options.limits)
    if bool(found.safe[0]):
        return plan
    wrong = ", ".join(CHECKS[number] for number in np.flatnonzero(found.wrong[:, 0]))
    return _void(plan, late, f"from where everybody is by then it fails the checks: {wrong}")


def _void(plan: Plan, late: float, why: str) -> Plan:
    message = f"plan was found {late:.1f} s after the request and is too late: {why}"
    return replace(plan, status=Status.UNRESOLVED, reasons=(Reason(Kind.SEPARATION, "plan", message),))
