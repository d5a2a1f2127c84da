"""Estimates of what a search keeps from areas: on strides of manoeuvres, and on the direct route.

:mod:`agents.kernel.areas` judges the plans.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agents.kernel.areas import ActiveArea, flat_areas
from agents.manoeuvres.direct_to_goal import (
    DirectRoute,
    DirectTask,
    arc_end,
    direct,
    scalar_arc_end,
)
from envs.area_geometry import Parts, chord_distances, gain, own_frame
from envs.arrays import Array, Bool, Float, Int
from envs.compiled import scalar
from envs.flat_areas import chord_bound, scalar_box_distance
from envs.frames import Air
from envs.kinematics import VehicleState

_PARTS = 4  # of the turn onto the goal


def clearance(
    areas: Sequence[ActiveArea],
    required: Sequence[Float[Array, " N"]],
    flown: VehicleState[Air],
    times: Float[Array, " S+1"],
    of: Int[Array, " M"],
) -> Float[Array, "S M"]:
    """Return the least distance from all areas less the required one on each stride, m.

    Args:
        areas: that may be met.
        required: distance from each area, m, ``[N]``.
        flown: states at the strides' ends, ``[S + 1, M]``.
        times: of them, s.
        of: whose manoeuvres they are.
    """
    when = np.broadcast_to(times[:, None], flown.x.shape)
    return _least(areas, required, (flown.x.T, flown.y.T, when.T), of).T


def way_clear(
    areas: Sequence[ActiveArea],
    required: Sequence[Float[Array, " N"]],
    own: VehicleState[Air],
    goal: tuple[Float[Array, " R"], Float[Array, " R"]],
    time: Float[Array, " R"],
    of: Int[Array, " R"],
    task: DirectTask,
) -> Bool[Array, " R"]:
    """Return whether the direct route to goals, m, from states at some times, s, keeps clear of all
    areas.
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
    least = np.full((x.shape[0], x.shape[1] - 1), np.inf)
    first, last = when[:, :-1].ravel(), when[:, 1:].ravel()
    for active, distance in zip(areas, required, strict=True):
        if not np.any((first <= active.end) & (last >= active.begin)):
            continue
        at_x, at_y = own_frame(active.area, x, y, when)
        parts = Parts(
            *(field.ravel() for field in (at_x[:, :-1], at_y[:, :-1], at_x[:, 1:], at_y[:, 1:]))
        )
        need = distance[of].repeat(x.shape[1] - 1)
        grown = np.minimum(gain(active.area) * first, gain(active.area) * last)
        away = chord_distances(active.area, parts, need - grown).bound + grown - need
        away = np.where((first <= active.end) & (last >= active.begin), away, np.inf)
        np.minimum(least, away.reshape(least.shape), out=least)
    return least


class AreaRecords(NamedTuple):
    """What one request keeps from areas, as compiled code takes it."""

    areas: Array  # records [A], as of :func:`envs.flat_areas.flat`
    lines: Array  # records of edges, [E]


def area_records(areas: Sequence[ActiveArea], required: Sequence[Float[Array, "1"]]) -> AreaRecords:
    """Return areas from which one request must keep distances, m, ``[1]`` each."""
    kept, lines = flat_areas(tuple(areas))
    kept = kept.copy()
    kept["required"] = [float(distance[0]) for distance in required]
    return AreaRecords(kept, lines)


@scalar
def scalar_clearance(
    around: AreaRecords,
    begin: tuple[float, float, float],
    end: tuple[float, float, float],
    most: float,
) -> float:
    """Return the least distance less the required one on a straight flight between places (m, m,
    s), or ``most`` where it is more, m.
    """
    least = most
    for a in range(len(around.areas)):
        area = around.areas[a]
        if not (begin[2] <= area.end and end[2] >= area.begin):
            continue
        x0, y0 = begin[0] - area.vx * begin[2], begin[1] - area.vy * begin[2]
        x1, y1 = end[0] - area.vx * end[2], end[1] - area.vy * end[2]
        required = area.required - min(area.gain * begin[2], area.gain * end[2])
        if area.sign > 0.0:
            dx, dy = x1 - x0, y1 - y0
            far = scalar_box_distance(area, x0, y0) + scalar_box_distance(area, x1, y1)
            if 0.5 * (far - math.sqrt(dx * dx + dy * dy)) > max(least + required, 0.0):
                continue
        bound = chord_bound(area, around.lines, x0, y0, x1, y1, required)
        least = min(least, bound - required)
    return least


@scalar
def scalar_way_clear(
    around: AreaRecords,
    own: VehicleState[Air],
    goal: tuple[float, float],
    way: DirectRoute,
    time: float,
    task: DirectTask,
) -> bool:
    """Return :func:`way_clear` of one state, whose direct route is known, in plain floats."""
    part = way.turning / _PARTS
    sag = 0.125 * own.speed * task.turn_rate * part * part
    place = own.x, own.y, time
    for number in range(1, _PARTS + 1):
        turned, lasts = way.side * way.turn * number / _PARTS, way.turning * number / _PARTS
        x, y = scalar_arc_end(own, turned, own.speed * lasts)
        after = x, y, time + lasts
        if not scalar_clearance(around, place, after, sag) >= sag:
            return False
        place = after
    pace = 0.5 * (own.speed + way.speed)
    arrival = time + way.turning + (way.straight + task.radius) / pace
    return scalar_clearance(around, place, (goal[0], goal[1], arrival), sag) >= sag
