"""The tables of scenarios: the modifiers, and the scenarios that ship, each a geometry with the
modifiers that it always has.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from envs.aircraft import Aircraft
from envs.arrays import Array
from envs.encounters import Encounter, Modifier, Sampler
from envs.scenarios.geometry import conflict_point
from envs.scenarios.layered import layered
from envs.scenarios.own_separations import own_separations
from envs.scenarios.partly_seen import partly_seen
from envs.scenarios.reacting import giving_way, reacting, turning_into
from envs.scenarios.standing import standing


def _turn_rate(aircraft: Aircraft) -> Mapping[str, Any]:
    return {"turn_rate": aircraft.limits.yaw_rate_max}


def _latency(aircraft: Aircraft) -> Mapping[str, Any]:
    return {"latency": (aircraft.dt, 2.0 * aircraft.dt)}


def _noise_and_latency(aircraft: Aircraft) -> Mapping[str, Any]:
    errors = {
        "position_std": 0.03 * aircraft.separation,
        "velocity_std": 0.03 * aircraft.limits.speed_max,
    }
    return {**errors, **_latency(aircraft)}


def _turned(encounter: Encounter) -> Array:
    return encounter.intent.heading_change


def _inexact(encounter: Encounter) -> Array:
    return encounter.sensor.position_std


def _aged(encounter: Encounter) -> Array:
    return encounter.sensor.latency


_AGE = "how old reports are"

MODIFIERS: dict[str, Modifier] = {
    modifier.name: modifier
    for modifier in (
        Modifier("turns", ("how intruders turn",), numbers=_turn_rate, heeded=_turned),
        Modifier("noise", (_AGE,), numbers=_noise_and_latency, heeded=_inexact),
        Modifier("late", (_AGE,), numbers=_latency, heeded=_aged),
        standing,
        own_separations,
        partly_seen,
        giving_way,
        turning_into,
        reacting,
        layered,
    )
}
"""The modifiers, by name, in the order in which they change encounters: what moves intruders before
what asks where they are."""


class _Conflicts(NamedTuple):
    """Starts whose straight courses lose the separation, with courses that differ by about an
    angle.
    """

    middle_deg: float
    half_width_deg: float

    def __call__(self, aircraft: Aircraft) -> Mapping[str, Any]:
        low, high = self.middle_deg - self.half_width_deg, self.middle_deg + self.half_width_deg
        return {
            "course_difference": (math.radians(low), math.radians(high)),
            "conflicts_closer_than": aircraft.separation,
            "attempts": 48,
        }


class _Several(NamedTuple):
    """Several intruders, and the attempts that these need."""

    fewest: int
    most: int
    attempts: int

    def __call__(self, aircraft: Aircraft) -> Mapping[str, Any]:
        return {"intruders": (self.fewest, self.most), "attempts": self.attempts}


_CIRCLE = Sampler(conflict_point, shared=7, per_intruder=7)
_FEW = _CIRCLE._replace(numbers=_Several(1, 4, attempts=48), together=True)

SHIPPED: dict[str, Sampler] = {
    "circle": _CIRCLE,
    "crossing_left": _CIRCLE._replace(numbers=_Conflicts(90.0, 45.0)),
    "crossing_right": _CIRCLE._replace(numbers=_Conflicts(-90.0, 45.0)),
    "head_on": _CIRCLE._replace(numbers=_Conflicts(180.0, 20.0)),
    "same_course": _CIRCLE._replace(numbers=_Conflicts(0.0, 20.0)),
    "maneuvering": _CIRCLE._replace(modifiers=("turns",)),
    "noisy": _CIRCLE._replace(modifiers=("noise",)),
    "multi": _CIRCLE._replace(numbers=_Several(2, 8, attempts=24)),
    # Names that are older than modifiers, in the files of policies and runs.
    "envs.standing_traffic:standing": _FEW._replace(modifiers=("standing",)),
    "envs.own_separations:separations": _FEW._replace(
        numbers=_Several(2, 4, attempts=48), modifiers=("own_separations",)
    ),
    "envs.partly_seen:partly_seen": _CIRCLE._replace(modifiers=("partly_seen",), together=True),
    "envs.partly_seen:late": _CIRCLE._replace(
        modifiers=("turns", "late", "partly_seen"), together=True
    ),
    "envs.reacting_traffic:giving_way": _FEW._replace(modifiers=("giving_way",)),
    "envs.reacting_traffic:turning_into": _FEW._replace(modifiers=("turning_into",)),
    "envs.reacting_traffic:mixed": _FEW._replace(modifiers=("reacting",)),
}
"""The scenarios that ship, by name."""

SCENARIOS = tuple(name for name in SHIPPED if ":" not in name)
"""Those that are offered by name; the others are combinations of them and modifiers."""
