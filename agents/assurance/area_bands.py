"""What areas leave of bands and of the present course: manoeuvres as legs, judged as plans are.

:mod:`agents.kernel.areas` judges the curves. Every row has areas of its own, as they are now; a
manoeuvre must keep what is required of plans that begin there
(:func:`agents.kernel.areas.required_distances`).
"""

import math
from typing import NamedTuple

import numpy as np

from agents.kernel.areas import Counted, area_clearance, in_reach
from agents.kernel.clearance import clearance
from agents.kernel.trajectory import Trajectory, trajectory
from agents.manoeuvres.direct_to_goal import arc_end
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.trees import column, take
from envs.waypoints import ARCS, Legs, PlanStates

HOLDS = 3
"""Legs of what is held after the target is reached."""


class Steering(NamedTuple):
    """Manoeuvres of constant controls until a target is reached; fields ``[N, B]``."""

    yaw_rate: Array  # rad/s
    acceleration: Array  # m/s^2
    reached: Array  # when, s, within the look-ahead


class FromAreas(NamedTuple):
    """What manoeuvres keep of the distances required from areas; fields ``[N, B]``."""

    loss: Array  # when it is lost first, s from now; inf where it is kept
    until: Array  # from when on it is kept again, s; -inf where it is never lost
    area: Array  # number of the area of which it is lost first; -1 where it is kept
    # smallest distance less the required one, m; a lower bound; inf: no area is met
    clearance: Array


def judge_manoeuvres(
    own: VehicleState[Air], steering: Steering, areas: Array, margin: float, look_ahead: float
) -> FromAreas:
    """Return what manoeuvres ``[N, B]`` of ownships ``[N]`` keep of areas.

    Args:
        own: states now.
        steering: the manoeuvres.
        areas: that each ownship may meet, as they are now, object ``[N]``.
        margin: of the requirement, m; added to the clearance.
        look_ahead: for how long each manoeuvre is looked at, s.
    """
    shape = steering.reached.shape
    found = FromAreas(
        np.full(shape, np.inf), np.full(shape, -np.inf), np.full(shape, -1), np.full(shape, np.inf)
    )
    for n in range(shape[0]):
        near = _within_reach(areas[n], take(own, n), take(steering, n), look_ahead, margin)
        if not near:
            continue
        flown = _manoeuvres(take(own, n), take(steering, n), look_ahead)
        begin = flown.states.x[:, 0], flown.states.y[:, 0]
        kept = clearance(flown, area_clearance(near, *begin, margin))
        first = np.argmin(kept.loss, axis=1)
        found.loss[n] = np.take_along_axis(kept.loss, first[:, None], 1)[:, 0]
        found.until[n] = np.minimum(kept.until.max(axis=1), look_ahead)
        numbers = np.array([one.number for one in near])
        found.area[n] = np.where(np.isfinite(found.loss[n]), numbers[first], -1)
        found.clearance[n] = kept.margin.min(axis=1)
    return found


def area_losses(
    own: VehicleState[Air], areas: tuple[Counted, ...], margin: float, look_ahead: float
) -> list[float]:
    """Return when an ownship ``[1]`` that flies straight on loses what it must keep of each area, s
    from now; inf: not within the look-ahead.
    """
    still = Steering(*np.zeros((3, 1)))
    near = _within_reach(areas, take(own, 0), still, look_ahead, margin)
    flown = _manoeuvres(take(own, 0), still, look_ahead)
    kept = clearance(flown, area_clearance(near, own.x, own.y, margin))
    losses = {area.number: float(loss) for area, loss in zip(near, kept.loss[0], strict=True)}
    return [losses.get(area.number, math.inf) for area in areas]


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


def _manoeuvres(own: VehicleState[Air], steering: Steering, look_ahead: float) -> Trajectory:
    """Return the manoeuvres of one ownship, ``[B]``, as ``HOLDS + 1`` legs each."""
    share = np.linspace(0.0, 1.0, HOLDS + 1)
    held = steering.reached[:, None] * (1.0 - share) + look_ahead * share
    time = np.concatenate([np.zeros((len(held), 1)), held], axis=1)
    duration = np.diff(time, axis=1)
    arcs = time[:, :-1, None] + duration[..., None] * (np.arange(ARCS) / ARCS)
    state = _states(own, steering, arcs.reshape(len(held), (HOLDS + 1) * ARCS))
    x, y, heading, speed = (field.reshape(arcs.shape) for field in state)
    controls = (
        np.concatenate(
            [np.broadcast_to(each[:, None, None], (len(held), 1, ARCS)), 0.0 * arcs[:, 1:]], axis=1
        )
        for each in (steering.yaw_rate, steering.acceleration)
    )
    curves = Legs(time[:, :-1], duration, 0.0 * duration, x, y, heading, speed, *controls)
    return trajectory(PlanStates(*_states(own, steering, time), time), curves)


def _states(own: VehicleState[Air], steering: Steering, time: Array) -> VehicleState[Air]:
    """Return one ownship on its manoeuvres at times ``[B, T]``, s, the heading not wrapped."""
    yaw_rate, acceleration, reached = column(steering)
    steered = np.minimum(time, reached)
    turn, speed = yaw_rate * steered, own.speed + acceleration * steered
    x, y = arc_end(own, turn, 0.5 * (own.speed + speed) * steered)
    heading, straight = own.heading + turn, speed * (time - steered)
    return VehicleState(
        x + straight * np.cos(heading), y + straight * np.sin(heading), heading, speed
    )
