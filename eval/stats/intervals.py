"""Rates and means with their intervals, for independent and equally weighted encounters.

A rate carries its Clopper-Pearson interval: exact, so that its coverage never falls below what it states. Means
and ratios carry a percentile bootstrap interval, drawn from a generator of its own so that it repeats.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from eval.stats.bootstrap import percentiles, resampled_sums

__all__ = ["Interval", "Rate", "clopper_pearson", "mean_interval", "rate", "risk_ratio"]


class Interval(NamedTuple):
    """An estimate and the ends of its interval; NaN where nothing can be said."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Rate:
    """A share ``count / total`` with its Clopper-Pearson interval; ``value`` is NaN of nothing."""

    value: float
    low: float
    high: float
    count: int
    total: int


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


def rate(count: int, total: int, confidence: float = 0.95) -> Rate:
    """Return the share ``count / total`` with its interval; arguments as :func:`clopper_pearson`."""
    low, high = clopper_pearson(count, total, confidence)
    return Rate(count / total if total else math.nan, low, high, count, total)


def mean_interval(values: np.ndarray, confidence: float = 0.95, resamples: int = 2_000, seed: int = 0) -> Interval:
    """Return the mean of ``values [N]`` and its percentile bootstrap interval."""
    total = len(values)
    if total == 0:
        return Interval(math.nan, math.nan, math.nan)
    sums = resampled_sums(np.asarray(values)[:, None], resamples, seed)
    low, high = percentiles(sums[:, 0] / total, confidence)
    return Interval(float(np.mean(values)), low, high)


def risk_ratio(
    violated: np.ndarray,
    violated_without: np.ndarray,
    confidence: float = 0.95,
    resamples: int = 2_000,
    seed: int = 0,
) -> Interval:
    """Return violations with the resolver / violations without it, over the same encounters.

    The interval is a paired percentile bootstrap. Without a single violation a resample cannot show one: the upper
    end is then the Clopper-Pearson upper end of the violation rate, divided by the rate without the resolver.

    Args:
        violated: with the resolver, bool ``[N]``.
        violated_without: of the same encounters without it, bool ``[N]``.
        confidence: of the interval.
        resamples: bootstrap resamples.
        seed: of the bootstrap.

    Returns:
        NaN throughout where there is no violation without the resolver.
    """
    total = len(violated)
    bare = int(np.count_nonzero(violated_without))
    if bare == 0:
        return Interval(math.nan, math.nan, math.nan)
    count = int(np.count_nonzero(violated))
    if count == 0:
        return Interval(0.0, 0.0, clopper_pearson(0, total, confidence)[1] * total / bare)
    sums = resampled_sums(np.stack([violated, violated_without], axis=-1).astype(float), resamples, seed)
    known = sums[:, 1] > 0.0
    low, high = percentiles(sums[known, 0] / sums[known, 1], confidence)
    return Interval(count / bare, low, high)
