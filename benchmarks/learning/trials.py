"""Which of its trials is a learner's best: by the score at their end, or by how soon they come to a score."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any

from benchmarks.learning.curves import Times, reached, score_at
from benchmarks.learning.training import Log

__all__ = ["Trial", "best", "described"]

_TAIL = 0.2
"""Share of a trial over which its score is taken."""


@dataclass(frozen=True)
class Trial:
    """A setting and its runs, one a seed."""

    setting: dict[str, float]
    logs: tuple[Log, ...]

    def score(self) -> float:
        """Return the mean over the seeds of the score of the last fifth of a trial's time, not of what came after it.

        The worst there is, where one diverged or ended no window in its time.
        """
        return fmean(map(_score, self.logs))

    def times(self, score: float) -> Times:
        """Return when the seeds came to a score, s of training; None and the whole time of one that never did."""
        found = [reached(log.curve, score, "wall_s") for log in self.logs]
        return Times(tuple(found), tuple(float(log.header["seconds"]) for log in self.logs))


def best(tried: Sequence[Trial], target: float | None) -> dict[str, float]:
    """Return the setting of the best trial, the first of equals.

    Args:
        tried: of one learner, one at least.
        target: the score that is to be reached soon: most seeds that reach it first, then the least geometric mean of
            the times; None: the score at the end.
    """
    if target is None:
        return max(tried, key=Trial.score).setting

    def late(trial: Trial) -> tuple[int, float]:
        times = trial.times(target)
        return sum(time is None for time in times.seeds), times.at_least()

    return min(tried, key=late).setting


def described(trial: Trial, target: float | None) -> dict[str, Any]:
    """Return a trial for JSON."""
    logs = trial.logs
    said: dict[str, Any] = {"steps": [log.curve[-1].steps if log.curve else 0 for log in logs]}
    said["ended"] = [log.ended for log in logs]
    if target is None:
        score = trial.score()
        said["score"] = score if math.isfinite(score) else None
    else:
        said[f"time_to_{target:g}_s"] = list(trial.times(target).seeds)
    return trial.setting | said


def _score(log: Log) -> float:
    score = score_at(log.curve, log.header["seconds"], "wall_s", _TAIL)
    return -math.inf if log.ended == "diverged" or math.isnan(score) else score
