"""Intervals of rates and means, and what is said of them in JSON types and in words.

A rate carries its Clopper-Pearson interval: exact, so that its coverage never falls below what it
states. A mean carries a percentile bootstrap interval, drawn from a generator of its own so that it
repeats: sums over encounters that are drawn with replacement.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple, SupportsInt

import numpy as np

_TOGETHER = 2_000_000  # numbers drawn at a time
_ALIKE = 8  # encounters to a distinct row from which on rows are drawn as counts


class Interval(NamedTuple):
    """An estimate and the ends of its interval; NaN where nothing can be said."""

    value: float
    low: float
    high: float


def clopper_pearson(count: int, total: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the exact two-sided interval of a binomial share (Clopper and Pearson, 1934); of no
    trials: [0, 1].

    An argument out of its range raises ``ValueError``.
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


def mean_interval(
    values: np.ndarray, confidence: float = 0.95, resamples: int = 2_000, seed: int = 0
) -> Interval:
    """Return the mean of ``values [N]`` and its percentile bootstrap interval."""
    total = len(values)
    if total == 0:
        return Interval(math.nan, math.nan, math.nan)
    sums = resampled_sums(np.asarray(values)[:, None], resamples, seed)
    return Interval(float(np.mean(values)), *percentiles(sums[:, 0] / total, confidence))


def resampled_sums(columns: np.ndarray, resamples: int, seed: int) -> np.ndarray:
    """Return the sums of columns ``[N, C]``, N >= 1, in each of B resamples, ``[B, C]``.

    Where few rows are distinct (scores, events) their counts are drawn instead of the encounters:
    the same distribution, and a million encounters take no longer than a thousand.
    """
    total, rng = len(columns), np.random.default_rng(seed)
    distinct, counts = _distinct(columns)
    alike = len(distinct) * _ALIKE <= total
    sums = []
    size = max(_TOGETHER // (len(distinct) if alike else total), 1)
    for first in range(0, resamples, size):
        batch = min(size, resamples - first)
        if alike:
            sums.append(rng.multinomial(total, counts / total, size=batch) @ distinct)
        else:
            sums.append(columns[rng.integers(0, total, (batch, total))].sum(axis=1))
    return np.concatenate(sums)


def _distinct(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the distinct rows, ``[D, C]``, and their counts; ten times as fast as numpy's unique
    by axis.
    """
    code = np.zeros(len(columns), np.int64)
    for column in columns.T:
        values, place = np.unique(column, return_inverse=True)
        code = np.unique(code * len(values) + place, return_inverse=True)[1]
    _, first, counts = np.unique(code, return_index=True, return_counts=True)
    return columns[first], counts


def percentiles(samples: np.ndarray, confidence: float) -> tuple[float, float]:
    """Return the ends of the percentile interval of samples ``[B]``."""
    tail = 0.5 * (1.0 - confidence)
    low, high = np.quantile(samples, [tail, 1.0 - tail])
    return float(low), float(high)


def number(value: float) -> float | None:
    """Return the value, None for what JSON has no word for."""
    return float(value) if math.isfinite(value) else None


def share(count: SupportsInt, total: SupportsInt, confidence: float = 0.95) -> dict[str, Any]:
    """Return value, Clopper-Pearson interval, count and total of a rate; the value of nothing is
    None.
    """
    count, total = int(count), int(total)
    low, high = clopper_pearson(count, total, confidence)
    return {
        "value": count / total if total else None,
        "low": low,
        "high": high,
        "count": count,
        "total": total,
    }


def interval(estimate: Interval) -> dict[str, float | None]:
    """Return value and ends of an interval."""
    return {key: number(value) for key, value in estimate._asdict().items()}


def ends(estimate: Interval, least: float = -math.inf) -> dict[str, float | None]:
    """Return the ends of an interval, the lower one at least ``least``."""
    if math.isnan(estimate.value):
        return {"low": None, "high": None}
    return {"low": max(estimate.low, least), "high": estimate.high}


def quantiles(values: np.ndarray, at: tuple[float, ...]) -> dict[str, float | None]:
    """Return quantiles of the finite ones of values ``[M]`` by their share, which is the key."""
    finite = values[np.isfinite(values)]
    return {f"{q:g}": float(np.quantile(finite, q)) if finite.size else None for q in at}


def percent(rate: Mapping[str, Any] | None, form: str = "{} % [{}, {}]", unknown: str = "-") -> str:
    """Return value and ends of a :func:`share` in percent, in words."""
    if rate is None or rate["value"] is None:
        return unknown
    return form.format(*(f"{100.0 * rate[key]:.2f}" for key in ("value", "low", "high")))
