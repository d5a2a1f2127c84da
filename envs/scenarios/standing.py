"""The modifier of traffic that stands still or drifts: hovering drones, balloons, small areas."""

import math

from envs.arrays import Array, ArrayModule
from envs.encounters import Encounter, Modifier, Scenario, between, columns, meets_conditions
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.relative import distance

STANDING = 0.5
"""Share of the intruders that stand or drift, half of them each; the others fly as before."""

DRIFT = 0.1
"""Fastest drift, in shares of the ownship's highest speed."""

ASIDE = 2.0
"""Farthest place from the line between the ownship's start and its goal, D."""

FREE_GOAL = 1.5
"""Nearest place to the goal, D: the whole of its radius can be reached at first."""


def stand_beside_the_way(
    scenario: Scenario, encounter: Encounter, draws: Array, xp: ArrayModule
) -> tuple[Encounter, Array]:
    """Return encounters ``[N]`` in which some intruders stand or drift beside the ownship's way, by
    draws ``[N, 5 K]``, and which of them meet the scenario's conditions and leave the goal free,
    ``[N]``.
    """
    aircraft = scenario.aircraft
    kind, along, aside, course, pace = columns(draws, 0, scenario.intruders[1], 5)
    own, flying = encounter.own, encounter.intruders
    goal_x, goal_y = encounter.goal_x[:, None], encounter.goal_y[:, None]
    way_x, way_y = goal_x - own.x[:, None], goal_y - own.y[:, None]
    farthest = ASIDE * aircraft.separation
    shift = between((-farthest, farthest), aside) / distance(way_x, way_y, xp)
    static = VehicleState(
        own.x[:, None] + along * way_x - shift * way_y,
        own.y[:, None] + along * way_y + shift * way_x,
        between((-math.pi, math.pi), course),
        DRIFT * aircraft.limits.speed_max * xp.maximum(2.0 * pace - 1.0, 0.0),
    )
    stands = kind < STANDING
    intruders: VehicleState[Air] = VehicleState(
        *(
            xp.where(stands, static_field, moving)
            for static_field, moving in zip(static, flying, strict=True)
        )
    )
    from_goal = distance(intruders.x - goal_x, intruders.y - goal_y, xp)
    blocks = stands & encounter.mask & (from_goal < FREE_GOAL * aircraft.separation)
    accepted = meets_conditions(scenario, own, intruders, encounter.mask, xp)
    return encounter._replace(intruders=intruders), accepted & ~xp.any(blocks, axis=-1)


standing = Modifier("standing", change=stand_beside_the_way, per_intruder=5, moves=True, rounds=6)
"""Each intruder stands, drifts or flies."""
