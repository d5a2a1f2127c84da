"""The settings that every learner tries, and which of its trials is the best: by score, or by the
time to a score.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from statistics import fmean
from typing import Any

import numpy as np
from pydantic import ValidationError

from agents.config.load import ConfigError
from benchmarks.learning.curves import WINDOW, Times, score_at, time_to_score
from benchmarks.learning.training import Log
from rlcas_jax.config import PpoConfig, TrainConfig

__all__ = ["PEERS_BEST", "SPACE", "Trial", "best", "describe", "settings", "with_setting"]

Setting = dict[str, float]
SPACE: dict[str, tuple[int, ...]] = {
    "environments": (128, 256, 512, 1024),
    "rollout": (16, 32, 64, 128),
    "minibatch": (512, 1024, 2048, 4096),
    "epochs": (1, 2, 3, 4),
}
"""Values of keys of the configuration and of its group ``ppo``, all alike often."""

LEARNING_RATE = (5e-4, 4e-3)
"""Ends of the learning rate, whose logarithm is spread evenly."""

PEERS_BEST: Setting = {"environments": 1024, "rollout": 16, "minibatch": 4096}
"""In which Stable-Baselines3 does most steps a second (:mod:`benchmarks.training`)."""

_TRIED = 10_000


def settings(config: TrainConfig, trials: int) -> list[Setting]:
    """Return what is tried: the configuration itself, the peer's best sizes, then points spread
    over the space.

    A point that the configuration refuses, or with more samples an update than a window of the
    curves has steps, is replaced by the next.

    Raises:
        ConfigError: so many different ones cannot be had.
    """
    own = {
        key: getattr(config.ppo if key in PpoConfig.model_fields else config, key)
        for key in ("learning_rate", *SPACE)
    }
    chosen: list[Setting] = []
    for number, setting in zip(range(_TRIED), _propose(own), strict=False):
        if len(chosen) == trials:
            break
        if setting not in chosen and (number == 0 or _valid(config, setting)):
            chosen.append(setting)
    if len(chosen) < trials:
        raise ConfigError(
            f"--trials is {trials}; expected at most {len(chosen)}, which is what this "
            "configuration takes"
        )
    return chosen


def with_setting(config: TrainConfig, setting: Setting, seed: int) -> TrainConfig:
    """Return a configuration in another setting, with another seed."""
    values = config.model_dump()
    of_ppo = {key: value for key, value in setting.items() if key in PpoConfig.model_fields}
    ppo = {"ppo": values["ppo"] | of_ppo}
    others = {key: value for key, value in setting.items() if key not in of_ppo}
    return TrainConfig.model_validate(values | others | ppo | {"seed": seed})


def _propose(own: Setting) -> Iterator[Setting]:
    yield own
    yield own | PEERS_BEST
    low, high = np.log(LEARNING_RATE)
    # Roberts' sequence, which spreads any first few points evenly; it begins in the middle of the
    # space.
    dimensions = 1 + len(SPACE)
    base = _root(dimensions)
    steps = base ** -np.arange(1.0, dimensions + 1.0)
    for number in count():
        share, *places = np.modf(0.5 + number * steps)[0]
        sizes = {
            key: values[int(place * len(values))]
            for (key, values), place in zip(SPACE.items(), places, strict=True)
        }
        yield {"learning_rate": float(f"{np.exp(low + share * (high - low)):.2g}")} | sizes


def _root(dimensions: int) -> float:
    """Return the positive root of x^(dimensions + 1) = x + 1; the golden ratio in one dimension."""
    root = 2.0
    for _ in range(64):
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    return root


def _valid(config: TrainConfig, setting: Setting) -> bool:
    try:
        return with_setting(config, setting, config.seed).samples <= WINDOW
    except ValidationError:
        return False


_TAIL = 0.2
"""Share of a trial over which its score is taken."""


@dataclass(frozen=True)
class Trial:
    """A setting and its runs, one a seed."""

    setting: dict[str, float]
    logs: tuple[Log, ...]

    def score(self) -> float:
        """Return the mean over the seeds of the score of the last fifth of a trial's time, not of
        what came after it.

        The worst there is, where one diverged or ended no window in its time.
        """
        return fmean(map(_score, self.logs))

    def times(self, score: float) -> Times:
        """Return when the seeds came to a score, s of training; None and the whole time of one that
        never did.
        """
        reached = [time_to_score(log.curve, score, "wall_s") for log in self.logs]
        return Times(tuple(reached), tuple(float(log.header["seconds"]) for log in self.logs))


def best(tried: Sequence[Trial], target: float | None) -> dict[str, float]:
    """Return the setting of the best trial, the first of equals.

    Args:
        tried: of one learner, one at least.
        target: the score that is to be reached soon: most seeds that reach it first, then the least
            geometric mean of the times; None: the score at the end.
    """
    if target is None:
        return max(tried, key=Trial.score).setting

    def late(trial: Trial) -> tuple[int, float]:
        times = trial.times(target)
        return sum(time is None for time in times.seeds), times.at_least()

    return min(tried, key=late).setting


def describe(trial: Trial, target: float | None) -> dict[str, Any]:
    """Return a trial for JSON."""
    logs = trial.logs
    figures: dict[str, Any] = {"steps": [log.curve[-1].steps if log.curve else 0 for log in logs]}
    figures["ended"] = [log.ended for log in logs]
    if target is None:
        score = trial.score()
        figures["score"] = score if math.isfinite(score) else None
    else:
        figures[f"time_to_{target:g}_s"] = list(trial.times(target).seeds)
    return trial.setting | figures


def _score(log: Log) -> float:
    score = score_at(log.curve, log.header["seconds"], "wall_s", _TAIL)
    return -math.inf if log.ended == "diverged" or math.isnan(score) else score
