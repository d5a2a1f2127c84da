"""The aircraft that a training flies: the configured one, and others that differ in
:class:`envs.aircraft.Ratios`.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from envs.encounters import Scenario
from envs.kinematics import Limits
from rlcas_jax.config import TrainConfig


class Fleet(NamedTuple):
    """The ownship of each environment; fields ``[N]``."""

    limits: Limits  # float32
    other: Any  # whether it is another one of the family, bool


def fleet(config: TrainConfig) -> Fleet:
    """Return the ownships of a training's environments, the same for every phase and run of
    a seed.
    """
    count, family = config.ppo.environments, config.family
    random, aircraft = np.random.default_rng((config.seed, 7)), config.aircraft.aircraft()
    share, slow, brake, power, radius, *_ = random.random((5, count))
    own, unit = aircraft.limits, aircraft.limits.speed_max**2 / aircraft.separation

    def between(bounds: tuple[float, float], draw: np.ndarray) -> np.ndarray:
        return bounds[0] + (bounds[1] - bounds[0]) * draw

    def rate(draw: np.ndarray) -> np.ndarray:
        """Return accelerations, as many between 1 and 2 as between 2 and 4."""
        return (
            np.exp(between((np.log(family.acceleration[0]), np.log(family.acceleration[1])), draw))
            * unit
        )

    drawn = Limits(
        between(family.speed_min, slow) * own.speed_max,
        np.full(count, own.speed_max),
        -rate(brake),
        rate(power),
        own.speed_max / (between(family.turn_radius, radius) * aircraft.separation),
    )
    other = share < family.share
    limits = Limits(
        *(
            np.where(other, mine, its).astype(np.float32)
            for mine, its in zip(drawn, own, strict=True)
        )
    )
    return Fleet(limits, other)


def of_fleet(
    scenarios: list[Scenario], flown: Fleet, config: TrainConfig, rows: int
) -> list[Scenario]:
    """Return scenarios whose draws ``[rows * N]`` begin at speeds that each environment's ownship
    flies.

    Intruders of other aircraft have the speeds of the family.
    """
    if not flown.other.any():
        return scenarios
    fastest = config.aircraft.aircraft().limits.speed_max
    other, slowest = np.tile(flown.other, rows), np.tile(flown.limits.speed_min, rows)
    own = slowest, np.full_like(slowest, fastest)
    traffic = [share * fastest for share in config.family.traffic_speed]

    def where(chosen: np.ndarray, mine: Any, usual: Any) -> Any:
        return tuple(np.where(chosen, each, end) for each, end in zip(mine, usual, strict=True))

    return [
        replace(
            each,
            own_speed=where(other, own, each.own_speed),
            intruder_speed=where(other[:, None], traffic, each.intruder_speed),
        )
        for each in scenarios
    ]
