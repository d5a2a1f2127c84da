"""Estimates of what a search keeps from areas: on strides of manoeuvres, and on the direct route.

:mod:`agents.kernel.areas` judges the plans.
"""

from collections.abc import Sequence

import numpy as np

from agents.kernel.areas import ActiveArea
from agents.manoeuvres.direct_to_goal import DirectTask, arc_end, direct
from envs.area_geometry import Parts, chord_distances, gain, own_frame
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import VehicleState

_PARTS = 4  # of the turn onto the goal


def clearance(
    areas: Sequence[ActiveArea],
    required: Sequence[Array],
    flown: VehicleState[Air],
    times: Array,
    of: Array,
) -> Array:
    """Return the least distance from all areas less the required one on each stride, m, ``[S, M]``.

    Args:
        areas: that may be met.
        required: distance from each area, m, ``[N]``.
        flown: states at the strides' ends, ``[S + 1, M]``.
        times: of them, s, ``[S + 1]``.
        of: whose manoeuvres they are, ``[M]``.
    """
    when = np.broadcast_to(times[:, None], flown.x.shape)
    return _least(areas, required, (flown.x.T, flown.y.T, when.T), of).T


def way_clear(
    areas: Sequence[ActiveArea],
    required: Sequence[Array],
    own: VehicleState[Air],
    goal: tuple[Array, Array],
    time: Array,
    of: Array,
    task: DirectTask,
) -> Array:
    """Return whether the direct route to goals, m, from states at some times, s, keeps clear of all
    areas, ``[R]``.
    """
    way = direct(own, goal, time, task, np)
    share = np.arange(_PARTS + 1) * (1.0 / _PARTS)
    turn, lasts = (way.side * way.turn)[:, None] * share, way.turning[:, None] * share
    state: VehicleState[Air] = VehicleState(*(np.asarray(field)[:, None] for field in own))
    x, y = arc_end(state, turn, state.speed * lasts)
    pace = 0.5 * (own.speed + way.speed)
    arrival = time + way.turning + (way.straight + task.radius) / pace
    x, y, when = (
        np.concatenate([part, last[:, None]], axis=1)
        for part, last in ((x, goal[0]), (y, goal[1]), (np.reshape(time, (-1, 1)) + lasts, arrival))
    )
    sag = 0.125 * own.speed * task.turn_rate * (way.turning / _PARTS) ** 2
    return (_least(areas, required, (x, y, when), of) >= sag[:, None]).all(axis=1)


def _least(
    areas: Sequence[ActiveArea],
    required: Sequence[Array],
    places: tuple[Array, Array, Array],
    of: Array,
) -> Array:
    """Return the least distance less the required one on straight flights between places (m, m, s),
    ``[M, P]``, of requests ``of``: m, ``[M, P - 1]``.
    """
    x, y, when = places
    found = np.full((x.shape[0], x.shape[1] - 1), np.inf)
    first, last = when[:, :-1].ravel(), when[:, 1:].ravel()
    for one, distance in zip(areas, required, strict=True):
        if not np.any((first <= one.end) & (last >= one.begin)):
            continue
        at_x, at_y = own_frame(one.area, x, y, when)
        parts = Parts(
            *(field.ravel() for field in (at_x[:, :-1], at_y[:, :-1], at_x[:, 1:], at_y[:, 1:]))
        )
        need = distance[of].repeat(x.shape[1] - 1)
        grown = np.minimum(gain(one.area) * first, gain(one.area) * last)
        away = chord_distances(one.area, parts, need - grown).bound + grown - need
        away = np.where((first <= one.end) & (last >= one.begin), away, np.inf)
        np.minimum(found, away.reshape(found.shape), out=found)
    return found
