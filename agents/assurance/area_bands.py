"""What areas leave of bands and of the present course.

Every row has areas of its own, as they are now; a manoeuvre must keep what is required of plans
that begin there (:func:`agents.kernel.areas.required_distances`).
"""

import numpy as np

from agents.assurance.held import Kept
from agents.kernel.areas import Counted, area_clearance, in_reach
from agents.kernel.clearance import Clearance, clearance
from agents.kernel.trajectory import Steering, manoeuvres
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.trees import take


def judge_manoeuvres(
    own: VehicleState[Air], steering: Steering, areas: Array, margin: float, look_ahead: float
) -> tuple[Kept, Array]:
    """Return what manoeuvres ``[N, B]`` of ownships ``[N]`` keep of areas, and the number of the
    area of which it is lost first, -1: of none.

    Args:
        own: states now.
        steering: the manoeuvres.
        areas: that each ownship may meet, as they are now, object ``[N]``.
        margin: of the requirement, m; added to the clearance.
        look_ahead: for how long each manoeuvre is looked at, s.
    """
    shape = steering.reached.shape
    kept = Kept(np.full(shape, np.inf), np.full(shape, -np.inf), np.full(shape, np.inf))
    area = np.full(shape, -1)
    for n in range(shape[0]):
        near = _within_reach(areas[n], take(own, n), take(steering, n), look_ahead, margin)
        if not near:
            continue
        each = _keep(take(own, n), take(steering, n), near, margin, look_ahead)
        first = np.argmin(each.loss, axis=1)
        kept.loss[n] = np.take_along_axis(each.loss, first[:, None], 1)[:, 0]
        kept.until[n] = np.minimum(each.until.max(axis=1), look_ahead)
        kept.clearance[n] = each.margin.min(axis=1)
        numbers = np.array([active.number for active in near])
        area[n] = np.where(np.isfinite(kept.loss[n]), numbers[first], -1)
    return kept, area


def _keep(
    own: VehicleState[Air],
    steering: Steering,
    areas: list[Counted],
    margin: float,
    look_ahead: float,
) -> Clearance:
    """Return what manoeuvres ``[B]`` of one ownship keep of areas, ``[B, K]``."""
    flown = manoeuvres(own, steering, look_ahead)
    begin = flown.states.x[:, 0], flown.states.y[:, 0]
    return clearance(flown, area_clearance(areas, *begin, margin))


def _within_reach(
    areas: tuple[Counted, ...],
    own: VehicleState[Air],
    steering: Steering,
    look_ahead: float,
    margin: float,
) -> list[Counted]:
    """Return the areas that some manoeuvre may meet within the look-ahead."""
    if not areas:
        return []
    faster = np.maximum(steering.acceleration * steering.reached, 0.0).max(initial=0.0)
    far = (own.speed + faster) * look_ahead
    return [
        one
        for one in areas
        if one.begin <= look_ahead
        and in_reach(one.area, own.x, own.y, far, min(one.end, look_ahead), margin)
    ]
