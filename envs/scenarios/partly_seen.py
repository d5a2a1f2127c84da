"""The modifier of reports that are missing: a sensor has a range and a field of view, and reports
drop out for seconds. What is not reported is not known.
"""

import math

from envs.arrays import Array, ArrayModule
from envs.encounters import Encounter, Modifier, Scenario, between
from envs.perception import Coverage

REACH = (4.0, 12.0)
"""Range of a sensor, D, the same for all intruders of an encounter."""

HALF_ANGLE = (math.radians(60.0), math.pi)
"""Greatest bearing to either side that it sees, rad, the same for all intruders."""

ONSET = 15.0
"""Reports of an intruder drop out once, until this long after the start, D / ``speed_max``."""

SILENCE = 3.0
"""For at most so long, D / ``speed_max`` (paper: 30 s)."""


def cover_in_part(
    scenario: Scenario, encounter: Encounter, draws: Array, xp: ArrayModule
) -> tuple[Encounter, Array]:
    """Return encounters ``[N]`` with the coverage of the reports, by draws ``[N, 2 + 2 K]``; all of
    them meet the conditions, ``[N]``.
    """
    most, aircraft = scenario.intruders[1], scenario.aircraft
    unit = aircraft.separation / aircraft.limits.speed_max
    of_all = xp.zeros_like(draws[:, 2 : 2 + most])
    coverage = Coverage(
        reach=of_all + aircraft.separation * between(REACH, draws[:, 0, None]),
        half_angle=of_all + between(HALF_ANGLE, draws[:, 1, None]),
        onset=ONSET * unit * draws[:, 2 : 2 + most],
        silence=SILENCE * unit * draws[:, 2 + most :],
    )
    return encounter._replace(coverage=coverage), xp.ones_like(draws[:, 0], dtype=bool)


partly_seen = Modifier("partly_seen", change=cover_in_part, shared=2, per_intruder=2)
"""Not all intruders are reported at all times."""
