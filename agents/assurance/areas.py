"""What areas leave of plans and backups: whether the rest of a plan keeps clear of them, and how
deep a backup would fly into them.

:mod:`agents.kernel.areas` judges the curves. Every row has areas of its own, as they are now.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agents.assurance.lookahead import Course
from agents.assurance.thresholds import Thresholds
from agents.kernel.areas import NEARER, Counted, judge, label, relevant
from agents.planner.request.options import L, Narrowed
from agents.planner.request.request import Altitude
from envs.area_geometry import signed_distance
from envs.areas import Area
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.trees import take
from envs.waypoints import ARCS, Legs, PlanStates, at

_KEPT = 0.5
"""Share of the margin planned with that must be left: frames of runner and monitor bend edges
differently, and the margin is for the follower, whose present error is taken off.
"""

_GRAZING = 1e-3  # depth at least of a backup that is in an area between its plan states, m


class Rest(NamedTuple):
    """What the rest of plans keeps of the distances required from areas; fields ``[N]``."""

    lost: Array  # whether less than required, bool
    deficit: Array  # by how much at most, m; 0 where nothing is lost
    loss: Array  # when it begins, s from now; inf where it does not
    area: Array  # what messages call the area of which it is lost first; "" where none is, object


class FromAreas(NamedTuple):
    """What backups keep of the distances required from areas; fields ``[M]``."""

    clearance: Array  # smallest distance less the required one, m; inf where there are no areas
    # how deep it is in areas on the average of its plan states, m; 0 where it stays out of all
    depth: Array
    area: Array  # what messages call the area that it enters first; "" where it enters none, object


def may_be_met(
    areas: Sequence[Area],
    own: VehicleState[Air],
    altitude: Altitude | None,
    ends: float,
    thresholds: Thresholds[L],
) -> tuple[Counted, ...]:
    """Return the areas that the rest of a plan, the next one or a backup may meet.

    Args:
        areas: as they are now.
        own: the ownship now, plain floats.
        altitude: of it, now; None: unknown.
        ends: when the plan that is flown ends, s from now; nan where there is none.
        thresholds: of the monitor.
    """
    return relevant(
        areas,
        own,
        altitude,
        fastest=thresholds.limits.speed_max,
        horizon=max(2.0 * thresholds.options.finished_by, ends),
        unknown_climb=thresholds.options.unknown_climb,
        margin=thresholds.requirement.margin,
    )


def rest(
    plan: Course, since: Array, areas: Array, off: Array, thresholds: Thresholds[Narrowed]
) -> Rest:
    """Return what the rest of plans ``[N]`` keeps.

    Args:
        plan: what is flown.
        since: time on its clock, s, ``[N]``.
        areas: that each may meet, as they are now, object ``[N]``.
        off: distance of the ownship from its plan, m, ``[N]``, which may last: half of the margin,
            or this, must be left beyond the clearance.
        thresholds: of the monitor.
    """
    count = len(since)
    found = Rest(
        np.zeros(count, dtype=bool), np.zeros(count), np.full(count, np.inf), nameless(count)
    )
    for n in range(count):
        if not areas[n]:
            continue
        row = slice(n, n + 1)
        plan_states, curves, now = take((plan.plan_states, plan.legs, since), row)
        margin = np.maximum(_KEPT * thresholds.requirement.margin, off[row])
        required = [_required_of_rest(one, curves, now, margin) for one in areas[n]]
        ahead = plan_states._replace(time=plan_states.time - now[:, None])
        curves = curves._replace(time=curves.time - now[:, None])
        judged = judge(ahead, curves, areas[n], required=required)
        if judged.wrong[0]:
            found.lost[n], found.deficit[n] = True, -judged.clearance[0]
            found.loss[n] = max(judged.time[0], 0.0)
            found.area[n] = _called(areas[n], judged.area[0])
    return found


def judge_backups(
    plan_states: PlanStates, curves: Legs, areas: Array, of: Array, thresholds: Thresholds[Narrowed]
) -> FromAreas:
    """Return what backups ``[M]`` from the present on keep.

    Args:
        plan_states: states, ``[M, B]``, the first the present one at time 0.
        curves: their legs.
        areas: of ownships, object ``[N]``.
        of: whose backups they are, ``[M]``.
        thresholds: of the monitor.
    """
    found = FromAreas(np.full(len(of), np.inf), np.zeros(len(of)), nameless(len(of)))
    for n in np.unique(of):
        if not areas[n]:
            continue
        rows = np.flatnonzero(of == n)
        states, lines = take((plan_states, curves), rows)
        judged = judge(states, lines, areas[n], thresholds.requirement.margin)
        found.clearance[rows] = np.where(
            judged.wrong, judged.clearance, np.maximum(judged.clearance, 0.0)
        )
        enters = judge(states, lines, areas[n], required=[np.zeros(rows.size)] * len(areas[n]))
        depth = np.maximum(_mean_depth(states, areas[n]), _GRAZING)
        found.depth[rows] = np.where(enters.wrong, depth, 0.0)
        for row in np.flatnonzero(enters.wrong):
            found.area[rows[row]] = _called(areas[n], enters.area[row])
    return found


def nameless(count: int) -> Array:
    """Return that no area is named, object ``[count]``."""
    return np.full(count, "", dtype=object)


def _called(areas: tuple[Counted, ...], number: Array) -> str:
    """Return what messages call the area of a number."""
    return next(label(one) for one in areas if one.number == number)


def _required_of_rest(one: Counted, curves: Legs, since: Array, margin: Array) -> Array:
    """Return the distance that the rest of a plan must keep, m, ``[1]``; one that is inside the
    clearance must not come nearer than it is.
    """
    required = one.area.clearance + margin
    if one.begin > 0.0:
        return required
    # The arc under way is judged as a whole: what has been flown of it may have been nearer.
    arc = curves.duration.max() / ARCS
    places = [at(curves, np.maximum(since - ago, 0.0)) for ago in (0.0, arc)]
    away = [
        signed_distance(one.area, place.x, place.y, -np.minimum(since, ago))
        for place, ago in zip(places, (0.0, arc), strict=True)
    ]
    return np.clip(np.minimum(*away) - NEARER, 0.0, required)


def _mean_depth(plan_states: PlanStates, areas: tuple[Counted, ...]) -> Array:
    """Return how deep plan states ``[M, B]`` are in areas on average, m, ``[M]``."""
    depth = np.zeros(plan_states.x.shape)
    for one in areas:
        counts = (plan_states.time >= one.begin) & (plan_states.time <= one.end)
        away = signed_distance(one.area, *plan_states[:2], plan_states.time)
        depth = np.maximum(depth, np.where(counts, -away, 0.0))
    return depth.mean(axis=1)
