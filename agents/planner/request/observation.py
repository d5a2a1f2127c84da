"""What the policy is shown of intruders that have a separation of their own, or count for a while.

A policy counts distances in the separation that it was trained with. From an intruder with another
one they count in its own (:mod:`agents.policy.scene`): twice as near where twice as much must be
kept. One that is above or below for a while is shown while it counts. Plans are validated against
the intruders as they are. Why so: docs/explanation/planner.md.
"""

from agents.kernel.traffic import Requirement, Traffic, Window, separations
from envs.arrays import Array, Bool, Float


def distance_scales(traffic: Traffic, requirement: Requirement) -> Float[Array, "... K"]:
    """Return at how much of its distance each intruder counts; None: all of it, for
    each.
    """
    if traffic.separation is None:
        return None
    return requirement.separation / separations(traffic, requirement)


def visible(window: Window | None, time: float) -> Bool[Array, "... K"]:
    """Return which intruders the policy is shown at a time, s; True: all."""
    return True if window is None else (window.begin <= time) & (window.end >= time)
