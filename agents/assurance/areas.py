"""What areas leave of plans and backups: whether the rest of a plan keeps clear of them, and how
deep a backup would fly into them.

:mod:`agents.kernel.areas` judges the curves. Every row has areas of its own, as they are now.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agents.assurance.thresholds import Thresholds
from agents.kernel.areas import ActiveArea, AreaClearance, area_clearance, label, relevant
from agents.kernel.clearance import Clearance, clearance
from agents.kernel.levels import Line
from agents.kernel.trajectory import Trajectory, trajectory
from agents.planner.request.options import L, Narrowed
from envs.area_geometry import signed_distance
from envs.areas import Area
from envs.arrays import Array, Float, Int, Shaped
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.trees import take
from envs.waypoints import Legs, PlanStates, at

_KEPT = 0.5
"""Share of the margin planned with that must be left: frames of runner and monitor bend edges
differently, and the margin is for the follower, whose present error is taken off.
"""

_GRAZING = 1e-3  # depth at least of a backup that is in an area between its plan states, m


class RemainingPlanKeeps(NamedTuple):
    """What the remaining plans keep of the distances required from areas; fields ``[N]``."""

    lost: Array  # whether less than required, bool
    deficit: Array  # by how much at most, m; 0 where nothing is lost
    loss: Array  # when it begins, s from now; inf where it does not
    area: Array  # what messages call the area of which it is lost first; "" where none is, object


class BackupsKeep(NamedTuple):
    """What backups keep of the distances required from areas; fields ``[M]``."""

    clearance: Array  # smallest distance less the required one, m; inf where there are no areas
    # how deep it is in areas on the average of its plan states, m; 0 where it stays out of all
    depth: Array
    area: Array  # what messages call the area that it enters first; "" where it enters none, object


def may_be_met(
    areas: Sequence[Area],
    own: VehicleState[Air],
    flight: Sequence[Line],
    ends: float,
    thresholds: Thresholds[L],
) -> tuple[ActiveArea, ...]:
    """Return the areas that the rest of a plan, the next one or a backup may meet.

    Args:
        areas: as they are now.
        own: the ownship now, plain floats.
        flight: its altitude from now on; none: unknown.
        ends: when the plan that is flown ends, s from now; nan where there is none.
        thresholds: of the monitor.
    """
    return relevant(
        areas,
        own,
        flight,
        fastest=thresholds.limits.speed_max,
        horizon=max(2.0 * thresholds.options.finished_by, ends),
        unknown_climb=thresholds.options.unknown_climb,
        margin=thresholds.requirement.margin,
    )


def judge_remaining_plans(
    plan: Trajectory[Air],
    since: Float[Array, " N"],
    areas: Shaped[Array, " N"],
    off: Float[Array, " N"],
    thresholds: Thresholds[Narrowed],
) -> RemainingPlanKeeps:
    """Return what plans ``[N]`` keep from areas from now on.

    Args:
        plan: what is flown.
        since: time on its clock, s.
        areas: that each may meet, as they are now, object ``[N]``.
        off: distance of the ownship from its plan, m, which may last: half of the margin,
            or this, must be left beyond the clearance.
        thresholds: of the monitor.
    """
    count = len(since)
    result = RemainingPlanKeeps(
        np.zeros(count, dtype=bool), np.zeros(count), np.full(count, np.inf), nameless(count)
    )
    for n in range(count):
        if not areas[n]:
            continue
        row = slice(n, n + 1)
        flown, time = take((plan, since), row)
        margin = max(_KEPT * thresholds.requirement.margin, float(off[n]))
        own = at(flown.legs, time)
        clearances = clearance(flown.since(time), area_clearance(areas[n], own.x, own.y, margin))
        if np.isfinite(clearances.loss).any():
            result.lost[n], result.deficit[n] = True, -clearances.margin.min()
            result.loss[n] = clearances.loss.min()
            result.area[n] = _first_lost(areas[n], clearances)[0]
    return result


def judge_backups(
    plan_states: PlanStates[Air],
    curves: Legs[Air],
    areas: Shaped[Array, " N"],
    of: Int[Array, " M"],
    thresholds: Thresholds[Narrowed],
) -> BackupsKeep:
    """Return what backups ``[M]`` from the present on keep.

    Args:
        plan_states: states, ``[M, B]``, the first the present one at time 0.
        curves: their legs.
        areas: of ownships, object ``[N]``.
        of: whose backups they are.
        thresholds: of the monitor.
    """
    backups = BackupsKeep(np.full(len(of), np.inf), np.zeros(len(of)), nameless(len(of)))
    for n in np.unique(of):
        if not areas[n]:
            continue
        rows = np.flatnonzero(of == n)
        states, lines = take((plan_states, curves), rows)
        flown, margin = trajectory(states, lines), thresholds.requirement.margin
        keeping = area_clearance(areas[n], states.x[:, 0], states.y[:, 0], margin)
        backups.clearance[rows] = clearance(flown, keeping).margin.min(axis=1)
        inside = clearance(flown, AreaClearance(areas[n], np.zeros((rows.size, len(areas[n])))))
        enters = np.flatnonzero(np.isfinite(inside.loss).any(axis=1))
        depth = np.maximum(_mean_depth(states, areas[n]), _GRAZING)
        backups.depth[rows[enters]] = depth[enters]
        backups.area[rows[enters]] = _first_lost(areas[n], take(inside, enters))
    return backups


def nameless(count: int) -> Shaped[Array, " count"]:
    """Return that no area is named, object ``[count]``."""
    return np.full(count, "", dtype=object)


def _first_lost(areas: tuple[ActiveArea, ...], clearances: Clearance) -> list[str]:
    """Return what messages call the area that each of some rows loses first."""
    return [label(areas[k]) for k in np.argmin(clearances.loss, axis=1)]


def _mean_depth(plan_states: PlanStates[Air], areas: tuple[ActiveArea, ...]) -> Array:
    """Return how deep plan states ``[M, B]`` are in areas on average, m, ``[M]``."""
    depth = np.zeros(plan_states.x.shape)
    for active in areas:
        counts = (plan_states.time >= active.begin) & (plan_states.time <= active.end)
        away = signed_distance(active.area, *plan_states[:2], plan_states.time)
        depth = np.maximum(depth, np.where(counts, -away, 0.0))
    return depth.mean(axis=1)
