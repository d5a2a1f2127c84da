"""The aircraft that a training flies: the configured one, and samples of the family, which differ
in :class:`envs.aircraft.Ratios`.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from envs.aircraft import Aircraft
from envs.encounters import Scenario
from envs.kinematics import Limits
from rlcas_jax.config import FamilyConfig, TrainConfig


class Ownships(NamedTuple):
    """The ownship of each of N environments."""

    limits: Limits  # float32, fields [N]
    of_family: Bool[np.ndarray, " N"]  # whether it is a sample of the family


def ownships(config: TrainConfig) -> Ownships:
    """Return the ownships of a training's environments, the same for every phase and run of
    a seed.
    """
    family, aircraft = config.family, config.aircraft.aircraft()
    draws = np.random.default_rng((config.seed, 7)).random((5, config.environments))
    sampled, of_family = _family_sample(family, aircraft, draws[1:]), draws[0] < family.share
    chosen = (
        np.where(of_family, own, configured).astype(np.float32)
        for own, configured in zip(sampled, aircraft.limits, strict=True)
    )
    return Ownships(Limits(*chosen), of_family)


def _family_sample(family: FamilyConfig, aircraft: Aircraft, draws: np.ndarray) -> Limits:
    """Return limits ``[N]`` of a family around an aircraft by uniform draws ``[4, N]``."""
    slow, brake, power, radius = draws
    speed_max, separation = aircraft.limits.speed_max, aircraft.separation
    unit = speed_max**2 / separation
    return Limits(
        speed_min=_between(family.speed_min, slow) * speed_max,
        speed_max=np.full_like(slow, speed_max),
        acceleration_min=-_log_between(family.acceleration, brake) * unit,
        acceleration_max=_log_between(family.acceleration, power) * unit,
        yaw_rate_max=speed_max / (_between(family.turn_radius, radius) * separation),
    )


def _between(bounds: tuple[float, float], draw: np.ndarray) -> np.ndarray:
    """Return numbers between two bounds, by draws in [0, 1)."""
    low, high = bounds
    return low + (high - low) * draw


def _log_between(bounds: tuple[float, float], draw: np.ndarray) -> np.ndarray:
    """Return numbers between two bounds, as many between 1 and 2 as between 2 and 4."""
    low, high = bounds
    return np.exp(_between((np.log(low), np.log(high)), draw))


def scenarios_for(
    flying: Ownships, scenarios: list[Scenario], config: TrainConfig, rows: int
) -> list[Scenario]:
    """Return scenarios whose draws ``[rows * N]`` begin at speeds that each environment's ownship
    flies.

    Around a sample of the family, intruders have the family's speeds.
    """
    if not flying.of_family.any():
        return scenarios
    fastest = config.aircraft.aircraft().limits.speed_max
    low, high = config.family.traffic_speed
    of_family = np.tile(flying.of_family, rows)
    slowest = np.tile(flying.limits.speed_min, rows)
    own_speed = slowest, np.full_like(slowest, fastest)
    traffic_speed = low * fastest, high * fastest
    return [
        replace(
            scenario,
            own_speed=_ranges(of_family, own_speed, scenario.own_speed),
            intruder_speed=_ranges(of_family[:, None], traffic_speed, scenario.intruder_speed),
        )
        for scenario in scenarios
    ]


def _ranges(of_family: np.ndarray, sampled: tuple, configured: tuple) -> tuple:
    """Return the ends of a range, those of the family's samples where there is one."""
    return tuple(
        np.where(of_family, drawn, usual) for drawn, usual in zip(sampled, configured, strict=True)
    )
