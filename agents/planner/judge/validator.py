"""The validator: whether a plan, as published, keeps the limits, the separation and the clearance
from areas.

It knows the published waypoints, the intruders, the areas and the requirement. How close the plan
comes is asked of :mod:`agents.kernel.clearance`, and whether limits are kept, arc by arc, of
:mod:`agents.planner.judge.limits`.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from agents.kernel.areas import ActiveArea, area_clearance
from agents.kernel.clearance import LONGEST, Clearance, clearance
from agents.kernel.separation import separation
from agents.kernel.traffic import Requirement, Traffic
from agents.kernel.trajectory import trajectory
from agents.planner.judge.limits import right_legs
from envs.arrays import Array, Bool
from envs.frames import Air
from envs.kinematics import Limits, VehicleState
from envs.trees import map_leaves, take
from envs.waypoints import Legs, PlanStates, legs

CHECKS = ("not_finite", "times", "leg", "speed", "acceleration", "turn_rate", "separation", "area")
"""What is checked, in the order of the findings' last axis; names of
:class:`agents.planner.answer.Kind`.
"""

_SEPARATION, _AREA = CHECKS.index("separation"), CHECKS.index("area")
_OF_FLIGHT = _SEPARATION  # so many checks are of the flight alone


class Findings(NamedTuple):
    """What is wrong with plans; arrays over ``[N]`` plans and C = ``len(CHECKS)`` checks."""

    wrong: Array  # bool, [N, C]
    leg: Array  # number of the first leg at fault, [N, C]; -1 where nothing is wrong
    time: Array  # when it begins to be wrong, s, [N, C]; nan where nothing is
    x: Array  # where that is, m, [N, C]
    y: Array
    intruder: Array  # number of the intruder that is too close first, [N]; -1 where none is
    area: Array  # number of the area whose clearance is lost first, [N]; -1 where none is
    # Smallest distance to any intruder, m, [N]; inf without any, nan if not finite. Never too
    # large; too small by at most 5 mm on legs of 20 s, and by what longer turns in longer legs add.
    min_separation: Array
    time_of_min_separation: Array  # s, [N]; nan without one
    # smallest distance to an intruder or an area less the required one at the time, m, [N];
    # negative where one of these checks fails
    clearance: Array

    @property
    def safe(self) -> Bool[Array, " N"]:
        """Whether nothing is wrong."""
        return ~self.wrong.any(axis=-1)

    @property
    def legal(self) -> Bool[Array, " N"]:
        """Whether nothing is wrong but the distances to intruders and areas."""
        return ~self.wrong[:, :_OF_FLIGHT].any(axis=-1)

    @classmethod
    def blank(cls, count: int) -> "Findings":
        """Return that nothing is wrong and no intruder seen, ``[count]``."""
        places = count, len(CHECKS)
        none, nan, inf = np.full(count, -1), np.full(count, np.nan), np.full(count, np.inf)
        time, x, y = (np.full(places, np.nan) for _ in range(3))
        return cls(
            wrong=np.zeros(places, dtype=bool),
            leg=np.full(places, -1),
            time=time,
            x=x,
            y=y,
            intruder=none,
            area=none.copy(),
            min_separation=inf,
            time_of_min_separation=nan,
            clearance=inf.copy(),
        )

    @classmethod
    def empty(cls, count: int) -> "Findings":
        """Return the findings of plans that do not exist, ``[count]``: everything is wrong with
        them.
        """
        blank, nan = cls.blank(count), np.full(count, np.nan)
        return blank._replace(wrong=~blank.wrong, min_separation=nan, clearance=-blank.clearance)


def validate(
    plan_states: PlanStates[Air],
    traffic: Traffic,
    requirement: Requirement,
    limits: Limits,
    areas: Sequence[ActiveArea] = (),
    curves: Legs[Air] | None = None,
) -> Findings:
    """Return what is wrong with plans; one whose states are not finite or not in order of time is
    not judged further.

    Args:
        plan_states: state at the request and published waypoints, ``[N, W]``.
        traffic: the intruders at the request, ``[N, K]``.
        requirement: what is kept from them, and the margin that areas are kept, too.
        limits: of the flight.
        areas: that count.
        curves: the legs of the plan states, if they are known already.
    """
    plan_states = map_leaves(partial(np.asarray, dtype=float), plan_states)
    count = len(plan_states.time)
    finite: Array = np.isfinite(np.stack(plan_states)).all(axis=0)
    ordered: Array = np.diff(plan_states.time, axis=-1) > 0.0
    sound = finite.all(axis=-1) & ordered.all(axis=-1)
    if curves is None or not sound.all():
        curves = legs(_whole(plan_states, sound))
    findings, finite_ends = Findings.blank(count), finite[:, 1:] & finite[:, :-1]
    in_order = (ordered & (plan_states.time[:, 1:] <= LONGEST)) | ~finite_ends
    of_legs = [field | ~sound[:, None] for field in right_legs(curves, limits)]
    # In the order of CHECKS.
    for check, right in enumerate((finite_ends, in_order, *of_legs)):
        if not right.all():
            rows = np.flatnonzero(~right.all(axis=-1))
            leg = np.argmin(right[rows], axis=-1)
            time, x, y = (
                field[rows, leg] for field in (plan_states.time, plan_states.x, plan_states.y)
            )
            _note_wrong(findings, check, rows, leg, time, x, y)
    findings.min_separation[~sound], findings.clearance[~sound] = np.nan, -np.inf
    rows = np.flatnonzero(sound)
    if rows.size == 0:
        return findings
    states, intruders = plan_states, traffic
    if rows.size < count:
        states, curves, intruders = take((states, curves, intruders), rows)
    flown = trajectory(states, curves)
    own: VehicleState[Air] = VehicleState(*(field[:, 0] for field in states[:4]))
    clearances = clearance(flown, separation(intruders, own, requirement), closest=True)
    _note_separation(findings, rows, clearances)
    if areas:
        clearances = clearance(flown, area_clearance(areas, own.x, own.y, requirement.margin))
        _note_lost(
            findings, _AREA, rows, clearances, findings.area, [area.number for area in areas]
        )
    return findings


def _whole(plan_states: PlanStates[Air], sound: Array) -> PlanStates[Air]:
    """Return plans with a flight to the east at 1 m/s in the place of those that are not sound,
    ``[N]``, which are judged by what is wrong with them only.
    """
    if sound.all():
        return plan_states
    second = np.arange(plan_states.time.shape[1]) * 1.0
    east: PlanStates[Air] = PlanStates(x=second, y=0.0, heading=0.0, speed=1.0, time=second)
    return map_leaves(partial(np.where, sound[:, None]), plan_states, east)


def _note_wrong(
    findings: Findings, check: int, rows: Array, leg: Array, time: Array, x: Array, y: Array
) -> None:
    """Note where plans numbered ``rows`` first fail a check: the leg, the time (s) and the place
    (m), ``[m]`` each.
    """
    findings.wrong[rows, check], findings.leg[rows, check] = True, leg
    findings.time[rows, check], findings.x[rows, check], findings.y[rows, check] = time, x, y


def _note_separation(findings: Findings, rows: Array, clearances: Clearance) -> None:
    """Note of plans numbered ``rows`` what they keep from intruders."""
    count = clearances.distance.shape[1]
    if count == 0:
        return
    nearest = np.arange(rows.size), np.argmin(clearances.distance, axis=1)
    findings.min_separation[rows] = clearances.distance[nearest]
    findings.time_of_min_separation[rows] = clearances.distance_time[nearest]
    _note_lost(findings, _SEPARATION, rows, clearances, findings.intruder, range(count))


def _note_lost(
    findings: Findings,
    check: int,
    rows: Array,
    clearances: Clearance,
    names: Array,
    numbers: Sequence[int],
) -> None:
    """Note of plans numbered ``rows`` the smallest clearance, and where it is lost first; into
    ``names`` the number of the intruder or area of which that is.
    """
    findings.clearance[rows] = np.minimum(findings.clearance[rows], clearances.margin.min(axis=1))
    first = np.argmin(clearances.loss, axis=1)
    lost = np.flatnonzero(np.isfinite(clearances.loss[np.arange(rows.size), first]))
    if lost.size:
        places = lost, first[lost]
        leg, time, x, y = (
            field[places] for field in (clearances.leg, clearances.loss, clearances.x, clearances.y)
        )
        _note_wrong(findings, check, rows[lost], leg, time, x, y)
        names[rows[lost]] = np.asarray(numbers)[first[lost]]
