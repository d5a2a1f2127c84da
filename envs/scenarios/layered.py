"""The modifier of traffic at other levels, half of which climbs or descends: who passes above or
below, and who comes down through the ownship's level.
"""

from collections.abc import Mapping
from typing import Any

from envs.aircraft import Aircraft
from envs.altitudes import LEVEL, Altitudes, steady
from envs.arrays import Array, ArrayModule
from envs.encounters import Encounter, Modifier, Scenario, between, columns
from envs.kinematics import VehicleState
from envs.relative import straight_cpa

MISS = 2.0
"""Greatest vertical distance at the closest approach, vertical separations."""

CLIMBING = 0.5
"""Share of the intruders that climb or descend, half of them each; the others are level."""

RATE = (2.54, 7.62)
"""Of those, m/s: the 500 to 1500 ft/min with which the FAA's Aeronautical Information Manual
(4-4-10) asks aircraft to come to a level that they are cleared to."""


def put_at_levels(
    scenario: Scenario, encounter: Encounter, draws: Array, xp: ArrayModule
) -> tuple[Encounter, Array]:
    """Return encounters ``[N]`` in space, by draws ``[N, 2 K]``; all of them meet the conditions,
    ``[N]``.

    An intruder's height above the ownship is uniform at the moment of the closest approach on
    straight courses; there it is as often above as below, and climbs as often as it descends.
    """
    miss, move = columns(draws, 0, scenario.intruders[1], 2)
    # From -1 to 1: who is in the middle flies level, who is outside climbs or descends.
    sign = 2.0 * move - 1.0
    share = (abs(sign) - (1.0 - CLIMBING)) / CLIMBING
    rate = between(scenario.vertical_rate, share)
    climb = xp.where(share > 0.0, xp.copysign(rate, sign), 0.0)
    above = between((-scenario.vertical_miss, scenario.vertical_miss), miss)
    level = xp.full_like(encounter.goal_x, LEVEL)
    altitude = begin_height(encounter, LEVEL, above, climb, xp)
    altitudes = Altitudes(level, steady(altitude, climb, scenario.aircraft.dt, xp))
    return encounter._replace(altitudes=altitudes), xp.ones_like(level, dtype=bool)


def begin_height(
    encounter: Encounter, level: float, above: Array, climb: Array, xp: ArrayModule
) -> Array:
    """Return the altitudes at which intruders ``[N, K]`` begin that climb evenly, m/s, and are so
    far above the level of the ownship, m, at the closest approach on straight courses.
    """
    own: VehicleState[Any] = VehicleState(*(field[:, None] for field in encounter.own))
    return level + above - climb * straight_cpa(own, encounter.intruders, xp).time


def _numbers(aircraft: Aircraft) -> Mapping[str, Any]:
    if aircraft.vertical is None:
        return {}
    return {"vertical_miss": MISS * aircraft.vertical.separation, "vertical_rate": RATE}


layered = Modifier("layered", change=put_at_levels, per_intruder=2, numbers=_numbers)
"""Intruders are at other levels, or come through that of the ownship."""
