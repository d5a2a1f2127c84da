"""A scenario in which each intruder has a separation of its own: a heavy, a balloon and a drone
need different ones.

It is named ``envs.own_separations:separations``, as one of the user's own (:mod:`envs.scenarios`),
in trainings and by ``eval.monte_carlo``.
"""

import math
from collections.abc import Mapping
from typing import Any

from envs.aircraft import Aircraft
from envs.arrays import Array, ArrayModule
from envs.encounters import Encounter, Sampler, Scenario, conflict_point
from envs.relative import distance

LEAST, GREATEST = 0.3, 3.0
"""Between these, D, as many separations from 0.5 to 1 as from 1 to 2."""


def around_a_point(scenario: Scenario, draws: Array, xp: ArrayModule) -> tuple[Encounter, Array]:
    """Return encounters ``[N]`` of :func:`envs.encounters.conflict_point` with a separation of each
    intruder, from draws ``[N, 7 + 8 K]``, and which of them meet the conditions, ``[N]``.

    No intruder starts nearer than its separation.
    """
    most = scenario.intruders[1]
    first = draws.shape[1] - most
    encounter, accepted = conflict_point(scenario, draws[:, :first], xp)
    range_of_logarithms = math.log(GREATEST / LEAST)
    unit = LEAST * scenario.aircraft.separation
    separation = unit * xp.exp(range_of_logarithms * draws[:, first:])
    own, others = encounter.own, encounter.intruders
    apart = distance(others.x - own.x[:, None], others.y - own.y[:, None], xp)
    free = (apart >= separation) | xp.logical_not(encounter.mask)
    return encounter._replace(separation=separation), accepted & xp.all(free, axis=-1)


def _numbers(aircraft: Aircraft) -> Mapping[str, Any]:
    return {"intruders": (2, 4), "attempts": 48, "min_initial_separation": 0.0}


separations = Sampler(around_a_point, shared=7, each=8, numbers=_numbers)
"""Two to four intruders; up to 64 by ``intruders``."""
