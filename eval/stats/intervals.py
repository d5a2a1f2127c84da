"""Intervals of rates and means, for independent and equally weighted encounters.

A rate carries its Clopper-Pearson interval: exact, so that its coverage never falls below what it states. A mean
carries a percentile bootstrap interval, drawn from a generator of its own so that it repeats.
"""

import math
from typing import NamedTuple

import numpy as np

from eval.stats.bootstrap import percentiles, resampled_sums

__all__ = ["Interval", "clopper_pearson", "mean_interval"]


class Interval(NamedTuple):
    """An estimate and the ends of its interval; NaN where nothing can be said."""

    value: float
    low: float
    high: float


def clopper_pearson(count: int, total: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the exact two-sided interval of a binomial share (Clopper and Pearson, 1934).

    Args:
        count: successes, 0 .. total.
        total: independent trials, >= 0; of none nothing is known and the interval is [0, 1].
        confidence: in (0, 1).

    Raises:
        ValueError: an argument is out of its range.
    """
    if not 0 <= count <= total:
        raise ValueError(f"count {count} is outside 0..{total}")
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence {confidence} is outside (0, 1)")
    # The quantile of a beta distribution; scipy.stats has it too, but takes a second to import.
    from scipy.special import betaincinv

    tail = 0.5 * (1.0 - confidence)
    low = float(betaincinv(count, total - count + 1, tail)) if count > 0 else 0.0
    high = float(betaincinv(count + 1, total - count, 1.0 - tail)) if count < total else 1.0
    return low, high


def mean_interval(values: np.ndarray, confidence: float = 0.95, resamples: int = 2_000, seed: int = 0) -> Interval:
    """Return the mean of ``values [N]`` and its percentile bootstrap interval."""
    total = len(values)
    if total == 0:
        return Interval(math.nan, math.nan, math.nan)
    sums = resampled_sums(np.asarray(values)[:, None], resamples, seed)
    return Interval(float(np.mean(values)), *percentiles(sums[:, 0] / total, confidence))
