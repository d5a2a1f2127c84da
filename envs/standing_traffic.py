"""A scenario in which some of the traffic stands still or drifts: hovering drones, balloons, small
areas.

It is named ``envs.standing_traffic:standing``, as one of the user's own (:mod:`envs.scenarios`), in
trainings and in every evaluation.
"""

import math
from collections.abc import Mapping
from typing import Any

from envs.aircraft import Aircraft
from envs.arrays import Array, ArrayModule
from envs.encounters import (
    Encounter,
    Sampler,
    Scenario,
    between,
    columns,
    conflict_point,
    meets_conditions,
)
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.relative import distance

STANDING = 0.5
"""Share of the intruders that stand or drift, half of them each; the others fly as in ``circle``.
"""

DRIFT = 0.1
"""Fastest drift, in shares of the ownship's highest speed."""

ASIDE = 2.0
"""Farthest place from the line between the ownship's start and its goal, D."""

FREE_GOAL = 1.5
"""Nearest place to the goal, D: the whole of its radius can be reached at first."""


def around_the_way(scenario: Scenario, draws: Array, xp: ArrayModule) -> tuple[Encounter, Array]:
    """Return encounters ``[N]`` of :func:`envs.encounters.conflict_point` in which some intruders
    stand or drift beside the ownship's way, from draws ``[N, 7 + 12 K]``, and which of them meet
    the conditions, ``[N]``.
    """
    most, aircraft = scenario.intruders[1], scenario.aircraft
    first = draws.shape[1] - 5 * most
    encounter, _ = conflict_point(scenario, draws[:, :first], xp)
    kind, along, aside, course, pace = columns(draws, first, most, 5)
    own, flying = encounter.own, encounter.intruders
    goal_x, goal_y = encounter.goal_x[:, None], encounter.goal_y[:, None]
    way_x, way_y = goal_x - own.x[:, None], goal_y - own.y[:, None]
    farthest = ASIDE * aircraft.separation
    shift = between((-farthest, farthest), aside) / distance(way_x, way_y, xp)
    standing = VehicleState(
        own.x[:, None] + along * way_x - shift * way_y,
        own.y[:, None] + along * way_y + shift * way_x,
        between((-math.pi, math.pi), course),
        DRIFT * aircraft.limits.speed_max * xp.maximum(2.0 * pace - 1.0, 0.0),
    )
    stands = kind < STANDING
    others: VehicleState[Air] = VehicleState(
        *(xp.where(stands, one, other) for one, other in zip(standing, flying, strict=True))
    )
    from_goal = distance(others.x - goal_x, others.y - goal_y, xp)
    blocks = stands & encounter.mask & (from_goal < FREE_GOAL * aircraft.separation)
    accepted = meets_conditions(scenario, own, others, encounter.mask, xp)
    return encounter._replace(intruders=others), accepted & ~xp.any(blocks, axis=-1)


def _numbers(aircraft: Aircraft) -> Mapping[str, Any]:
    return {"intruders": (1, 4), "attempts": 48}


standing = Sampler(around_the_way, shared=7, each=12, numbers=_numbers)
"""One to four intruders, of which each stands, drifts or flies; up to 64 by ``intruders``."""
