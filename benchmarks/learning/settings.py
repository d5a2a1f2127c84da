"""The settings that every learner of the comparison tries, the same ones for each."""

from collections.abc import Iterator
from itertools import count

import numpy as np
from pydantic import ValidationError

from agents.config.load import ConfigError
from benchmarks.learning.curves import WINDOW
from rlcas_jax.config import TrainConfig

__all__ = ["PEERS_BEST", "SPACE", "changed", "settings"]

Setting = dict[str, float]

SPACE: dict[str, tuple[int, ...]] = {
    "environments": (128, 256, 512, 1024),
    "rollout": (16, 32, 64, 128),
    "minibatch": (512, 1024, 2048, 4096),
    "epochs": (1, 2, 3, 4),
}
"""Values of keys of ``ppo``, all alike often."""
LEARNING_RATE = (5e-4, 4e-3)
"""Ends of the learning rate, whose logarithm is spread evenly."""

PEERS_BEST: Setting = {"environments": 1024, "rollout": 16, "minibatch": 4096}
"""In which Stable-Baselines3 does most steps a second (:mod:`benchmarks.training`)."""

_TRIED = 10_000


def settings(config: TrainConfig, trials: int) -> list[Setting]:
    """Return what is tried: the configuration itself, the peer's best sizes, then points spread over the space.

    A point that the configuration refuses, or with more samples an update than a window of the curves has steps, is
    replaced by the next.

    Raises:
        ConfigError: so many different ones cannot be had.
    """
    own = {key: getattr(config.ppo, key) for key in ("learning_rate", *SPACE)}
    found: list[Setting] = []
    for number, setting in zip(range(_TRIED), _proposed(own), strict=False):
        if len(found) == trials:
            break
        if setting not in found and (number == 0 or _valid(config, setting)):
            found.append(setting)
    if len(found) < trials:
        raise ConfigError(
            f"--trials is {trials}; expected at most {len(found)}, which is what this configuration takes"
        )
    return found


def changed(config: TrainConfig, setting: Setting, seed: int) -> TrainConfig:
    """Return a configuration in another setting, with another seed."""
    values = config.model_dump()
    return TrainConfig.model_validate(values | {"seed": seed, "ppo": values["ppo"] | setting})


def _proposed(own: Setting) -> Iterator[Setting]:
    yield own
    yield own | PEERS_BEST
    low, high = np.log(LEARNING_RATE)
    # Roberts' sequence, which spreads any first few points evenly; it begins in the middle of the space.
    dimensions = 1 + len(SPACE)
    base = _root(dimensions)
    steps = base ** -np.arange(1.0, dimensions + 1.0)
    for number in count():
        share, *places = np.modf(0.5 + number * steps)[0]
        chosen = {
            key: values[int(place * len(values))] for (key, values), place in zip(SPACE.items(), places, strict=True)
        }
        yield {"learning_rate": float(f"{np.exp(low + share * (high - low)):.2g}")} | chosen


def _root(dimensions: int) -> float:
    """Return the positive root of x^(dimensions + 1) = x + 1; the golden ratio in one dimension."""
    root = 2.0
    for _ in range(64):
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    return root


def _valid(config: TrainConfig, setting: Setting) -> bool:
    try:
        return changed(config, setting, config.seed).ppo.samples <= WINDOW
    except ValidationError:
        return False
