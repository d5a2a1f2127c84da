"""How far a flight is from its plan: across it, along it, and in time."""

from typing import Any, NamedTuple

import numpy as np

from envs.angles import wrap
from envs.kinematics import VehicleState
from envs.waypoints import Legs, at

__all__ = ["Deviation", "deviation", "offset"]

_STEPS = 3  # of the search for the nearest point; each one squares what is left of the error


class Deviation(NamedTuple):
    """Errors of a state against a plan; fields ``[...]``."""

    cross_track: Any
    """Distance from the path, m, positive to its left."""
    along_track: Any
    """Distance ahead of where the plan is now, along the path, m; negative when behind."""
    time: Any
    """How much later than planned the aircraft is at its place, s; negative when early."""
    heading: Any
    """Against the path's heading there, rad, positive to the left."""
    speed: Any
    """Against the plan's speed there, m/s."""


def offset(state: VehicleState, reference: VehicleState) -> tuple[Any, Any]:
    """Return where a state is in the frame of a reference: ahead and to the left, m, ``[...]`` each."""
    sine, cosine = np.sin(reference.heading), np.cos(reference.heading)
    x, y = state.x - reference.x, state.y - reference.y
    return x * cosine + y * sine, y * cosine - x * sine


def deviation(legs: Legs, state: VehicleState, time: Any) -> Deviation:
    """Compare a state with the plan.

    The point of the path abeam of the aircraft is found from where the plan is now, by its speed; the errors of path
    and time are so kept apart on curves too.

    Args:
        legs: of the plan, ``[..., L]``.
        state: of the aircraft, ``[...]``.
        time: on the plan's clock, s, ``[...]`` or a scalar.
    """
    abeam = time + np.zeros(np.shape(state.x))
    for _ in range(_STEPS):
        reference = at(legs, abeam)
        ahead, _left = offset(state, reference)
        abeam = abeam + ahead / np.maximum(reference.speed, 1.0)
    reference = at(legs, abeam)
    _ahead, left = offset(state, reference)
    late = time - abeam
    now = at(legs, time)
    # Mean speed between both points: exact for constant acceleration.
    along = -late * 0.5 * (reference.speed + now.speed)
    return Deviation(left, along, late, wrap(state.heading - reference.heading, np), state.speed - reference.speed)
