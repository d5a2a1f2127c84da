"""The bootstrap of every mean, ratio and weighted rate: sums over encounters that are drawn with replacement."""

import numpy as np

__all__ = ["percentiles", "resampled_sums"]

_TOGETHER = 2_000_000  # numbers drawn at a time
_ALIKE = 8  # encounters to a distinct row from which on rows are drawn as counts


def resampled_sums(columns: np.ndarray, resamples: int, seed: int) -> np.ndarray:
    """Return the sums of each resample, ``[B, C]``.

    Where few rows are distinct (scores, events) their counts are drawn instead of the encounters: the same
    distribution, and a million encounters take no longer than a thousand.

    Args:
        columns: of the encounters, ``[N, C]``, N >= 1.
        resamples: B.
        seed: of the draws.
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
    """Return the distinct rows, ``[D, C]``, and how often each stands there; ten times as fast as unique by axis."""
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
