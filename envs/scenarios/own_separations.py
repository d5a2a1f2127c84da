"""The modifier that gives each intruder a separation of its own: a heavy, a balloon and a drone
need different ones.
"""

import math
from collections.abc import Mapping
from typing import Any

from envs.aircraft import Aircraft
from envs.arrays import Array, ArrayModule
from envs.encounters import Encounter, Modifier, Scenario
from envs.relative import distance

LEAST, GREATEST = 0.3, 3.0
"""Between these, D, as many separations from 0.5 to 1 as from 1 to 2."""


def draw_separations(
    scenario: Scenario, encounter: Encounter, draws: Array, xp: ArrayModule
) -> tuple[Encounter, Array]:
    """Return encounters ``[N]`` with a separation of each intruder, by draws ``[N, K]``, and in
    which of them no intruder starts nearer than that, ``[N]``.
    """
    range_of_logarithms = math.log(GREATEST / LEAST)
    unit = LEAST * scenario.aircraft.separation
    separation = unit * xp.exp(range_of_logarithms * draws)
    own, intruders = encounter.own, encounter.intruders
    apart = distance(intruders.x - own.x[:, None], intruders.y - own.y[:, None], xp)
    free = (apart >= separation) | xp.logical_not(encounter.mask)
    return encounter._replace(separation=separation), xp.all(free, axis=-1)


def _numbers(aircraft: Aircraft) -> Mapping[str, Any]:
    return {"min_initial_separation": 0.0}  # that of each takes its place


own_separations = Modifier(
    "own_separations", change=draw_separations, per_intruder=1, numbers=_numbers, rounds=6
)
"""Each intruder has a separation of its own."""
