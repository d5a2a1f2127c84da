"""Modifiers of traffic that answers the ownship: some gives way by the rules of the air, some turns
into its way.
"""

import math
from functools import partial
from typing import NamedTuple

from envs.arrays import Array, ArrayModule
from envs.encounters import Encounter, Modifier, Scenario, between, columns, no_turn
from envs.reaction import GIVES_WAY, TAKES_NO_NOTICE, TURNS_INTO, Reaction

AHEAD = (3.0, 9.0)
"""How long before the closest approach an intruder answers, D / ``speed_max`` (paper: 30 to
90 s)."""

WITHIN = (1.0, 2.0)
"""How near it must be, D."""

HEADING_CHANGE = (math.radians(15.0), math.radians(60.0))
"""Greatest turn off its course."""

TURN_RATE = (0.25, 1.0)
"""Of who gives way, in the ownship's turn rate; who turns into its way has half as much."""


class Shares(NamedTuple):
    """How many of the intruders have each manner; the others take no notice."""

    gives_way: float
    turns_into: float


def answer(
    scenario: Scenario, encounter: Encounter, draws: Array, xp: ArrayModule, *, shares: Shares
) -> tuple[Encounter, Array]:
    """Return encounters ``[N]`` with intruders that answer the ownship, by draws ``[N, 5 K]``, and
    fly straight on otherwise; all of them meet the conditions, ``[N]``.
    """
    aircraft = scenario.aircraft
    kind, ahead, within, change, rate = columns(draws, 0, scenario.intruders[1], 5)
    gives_way = kind < shares.gives_way
    turns_into = (kind >= shares.gives_way) & (kind < shares.gives_way + shares.turns_into)
    unit = aircraft.separation / aircraft.limits.speed_max
    able = xp.where(turns_into, 0.5, 1.0) * aircraft.limits.yaw_rate_max
    reaction = Reaction(
        manner=xp.where(gives_way, GIVES_WAY, xp.where(turns_into, TURNS_INTO, TAKES_NO_NOTICE)),
        ahead=unit * between(AHEAD, ahead),
        within=aircraft.separation * between(WITHIN, within),
        heading_change=between(HEADING_CHANGE, change),
        turn_rate=able * between(TURN_RATE, rate),
    )
    straight = no_turn(scenario, encounter.intruders, xp)
    answering = encounter._replace(intent=straight, reaction=reaction)
    return answering, xp.ones_like(draws[:, 0], dtype=bool)


def _modifier(name: str, shares: Shares) -> Modifier:
    decides = "how intruders answer the ownship", "how intruders turn"
    return Modifier(name, decides, partial(answer, shares=shares), per_intruder=5)


giving_way = _modifier("giving_way", Shares(gives_way=1.0, turns_into=0.0))
"""All give way by the rules."""

turning_into = _modifier("turning_into", Shares(gives_way=0.0, turns_into=1.0))
"""All turn into the ownship's way, also into its evasion."""

reacting = _modifier("reacting", Shares(gives_way=0.4, turns_into=0.3))
"""Some of each; the others take no notice."""
