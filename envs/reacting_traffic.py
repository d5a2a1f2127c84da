"""Scenarios in which the traffic answers the ownship: some gives way by the rules of the air, some
turns into its way.

They are named ``envs.reacting_traffic:giving_way``, ``:turning_into`` and ``:mixed``, as those of
the user's own (:mod:`envs.scenarios`), in trainings and by ``eval.monte_carlo`` in mode policy.
"""

import math
from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

from envs.aircraft import Aircraft
from envs.arrays import Array, ArrayModule
from envs.encounters import Encounter, Sampler, Scenario, between, columns, conflict_point, no_turn
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


def around_a_point(
    scenario: Scenario, draws: Array, xp: ArrayModule, *, shares: Shares
) -> tuple[Encounter, Array]:
    """Return encounters ``[N]`` of :func:`envs.encounters.conflict_point` with intruders that
    answer the ownship, from draws ``[N, 7 + 12 K]``, and which of them meet the conditions,
    ``[N]``.
    """
    most, aircraft = scenario.intruders[1], scenario.aircraft
    first = 7 + 7 * most
    encounter, accepted = conflict_point(scenario, draws[:, :first], xp)
    kind, ahead, within, change, rate = columns(draws, first, most, 5)
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
    return encounter._replace(intent=straight, reaction=reaction), accepted


def _numbers(aircraft: Aircraft) -> Mapping[str, Any]:
    return {"intruders": (1, 4), "attempts": 48}


def _sampler(shares: Shares) -> Sampler:
    return Sampler(partial(around_a_point, shares=shares), shared=7, each=12, numbers=_numbers)


giving_way = _sampler(Shares(gives_way=1.0, turns_into=0.0))
"""One to four intruders, up to 64 by ``intruders``; all give way by the rules."""

turning_into = _sampler(Shares(gives_way=0.0, turns_into=1.0))
"""As before; all turn into the ownship's way, also into its evasion."""

mixed = _sampler(Shares(gives_way=0.4, turns_into=0.3))
"""As before; the others take no notice."""
