"""A plan that took long to find: checked again from the states by the time that it is there."""

from agents.planner.answer import Plan
from agents.planner.publish import rechecked
from ros_bridge.core.fields import SECOND
from ros_bridge.core.situation import Task

__all__ = ["revalidated"]


def revalidated(plan: Plan, asked: Task, present: Task) -> Plan:
    """Return a plan as it is worth by now: SAFE only if it still is from the ownship's present state on.

    Args:
        plan: made for ``asked``.
        asked: of the request.
        present: the task as it would be asked now.
    """
    late = (present.time - asked.time) / SECOND
    states = present.own, present.intruders, present.points
    return rechecked(plan, late, *states, present.options, present.own_altitude)
