"""Scenarios in which not all of the traffic is reported: a sensor has a range and a field of view,
and reports drop out for seconds, or also come late of traffic that turns. What is not reported is
not known.

They are named ``envs.partly_seen:partly_seen`` and ``:late``, as those of the user's own
(:mod:`envs.scenarios`), in trainings and by ``eval.monte_carlo`` in mode policy.
"""

import math
from collections.abc import Mapping
from typing import Any

from envs.aircraft import Aircraft
from envs.arrays import Array, ArrayModule
from envs.encounters import Encounter, Sampler, Scenario, between, conflict_point
from envs.perception import Coverage

REACH = (4.0, 12.0)
"""Range of a sensor, D, one for each encounter."""

HALF_ANGLE = (math.radians(60.0), math.pi)
"""Greatest bearing to either side that it sees, rad, one for each encounter."""

ONSET = 15.0
"""Reports of an intruder drop out once, until this long after the start, D / ``speed_max``."""

SILENCE = 3.0
"""For at most so long, D / ``speed_max`` (paper: 30 s)."""


def around_a_point(scenario: Scenario, draws: Array, xp: ArrayModule) -> tuple[Encounter, Array]:
    """Return encounters ``[N]`` of :func:`envs.encounters.conflict_point` with the coverage of the
    reports, from draws ``[N, 9 + 9 K]``, and which of them meet the conditions, ``[N]``.
    """
    most, aircraft = scenario.intruders[1], scenario.aircraft
    first = 7 + 7 * most
    encounter, accepted = conflict_point(scenario, draws[:, :first], xp)
    unit = aircraft.separation / aircraft.limits.speed_max
    of_all = xp.zeros_like(draws[:, first + 2 : first + 2 + most])
    coverage = Coverage(
        reach=of_all + aircraft.separation * between(REACH, draws[:, first, None]),
        half_angle=of_all + between(HALF_ANGLE, draws[:, first + 1, None]),
        onset=ONSET * unit * draws[:, first + 2 : first + 2 + most],
        silence=SILENCE * unit * draws[:, first + 2 + most :],
    )
    return encounter._replace(coverage=coverage), accepted


partly_seen = Sampler(around_a_point, shared=9, each=9)
"""One intruder; up to 64 by ``intruders``."""


def _late(aircraft: Aircraft) -> Mapping[str, Any]:
    return {
        "latency": (aircraft.dt, 2.0 * aircraft.dt),
        "turn_rate": aircraft.limits.yaw_rate_max,
    }


late = Sampler(around_a_point, shared=9, each=9, numbers=_late)
"""As before, of traffic that turns once, with reports that are one to two time steps old when they
are used."""
