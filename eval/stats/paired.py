"""Statistics of pairs: two resolvers on the same encounters, compared by the encounters on which
they differ.

The difference of two success rates carries Tango's score interval, which stays inside [-1, 1],
needs no correction where a cell is empty, and is one with the test: 0 lies outside it where the
score test rejects. McNemar's exact p beside it asks whether the encounters on which they differ
fall to one side more often than a coin would.
"""

import math
from typing import NamedTuple

import numpy as np

from eval.stats.intervals import Interval

_BISECTIONS = 60  # halvings of [-1, 1]: the ends are then exact to rounding


class Pairs(NamedTuple):
    """How two resolvers fared on the same encounters; counts."""

    both: int
    first_only: int
    second_only: int
    neither: int


def pairs(first: np.ndarray, second: np.ndarray) -> Pairs:
    """Count the cells of two resolvers' successes on the same encounters, bool ``[N]`` both, else
    ``ValueError``.
    """
    first, second = np.asarray(first), np.asarray(second)
    if (
        first.ndim != 1
        or first.shape != second.shape
        or first.dtype != bool
        or second.dtype != bool
    ):
        shapes = " and ".join(f"{mask.dtype} {list(mask.shape)}" for mask in (first, second))
        raise ValueError(f"expected two bool arrays [N] of one length, got {shapes}")
    cells = np.bincount(2 * first.astype(int) + second.astype(int), minlength=4).tolist()
    return Pairs(both=cells[3], first_only=cells[2], second_only=cells[1], neither=cells[0])


def tango(counts: Pairs, confidence: float = 0.95) -> Interval:
    """Return the second's success rate minus the first's, with Tango's score interval.

    The interval holds every difference that the score test does not reject (T. Tango, Statistics in
    Medicine 17 (1998) 891). The statistic falls as the supposed difference rises, so that its ends
    are found by bisection. No pair, or a confidence out of its range, raises ``ValueError``.
    """
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence {confidence} is outside (0, 1)")
    if sum(counts) == 0:
        raise ValueError("there is no pair; expected at least one")
    from scipy.special import ndtri

    quantile = float(ndtri(0.5 + 0.5 * confidence))
    value = (counts.second_only - counts.first_only) / sum(counts)
    # A statistic of exactly the quantile at the end of the range (no success of one, no failure of
    # the other).
    low = -1.0 if counts.first_only == sum(counts) else _where(counts, quantile)
    high = 1.0 if counts.second_only == sum(counts) else _where(counts, -quantile)
    return Interval(value, min(low, value), max(high, value))


def mcnemar_exact(counts: Pairs) -> float:
    """Return McNemar's exact two-sided p: twice the smaller tail of a fair coin's count of the
    differing pairs.

    1 where no pair differs. (Q. McNemar, Psychometrika 12 (1947) 153, in its exact conditional
    form.)
    """
    differing = counts.first_only + counts.second_only
    from scipy.special import bdtr

    return min(1.0, 2.0 * float(bdtr(min(counts.first_only, counts.second_only), differing, 0.5)))


def _where(counts: Pairs, target: float) -> float:
    """Return the difference at which the statistic has fallen to a value."""
    low, high = -1.0, 1.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _score(counts, middle) > target else (low, middle)
    return 0.5 * (low + high)


def _score(counts: Pairs, difference: float) -> float:
    """Return the score statistic of a supposed difference: observed minus expected, by its standard
    error under it.

    The error takes the likeliest share q of pairs won by the first alone among those with that
    difference. With shares q and q + d the likelihood is stationary where 2 n q^2 + (d (2 n - s +
    f) - f - s) q - f d (1 - d) = 0, of which the larger root lies in the range (f, s: pairs won by
    the first, the second alone).
    """
    total, first, second = sum(counts), counts.first_only, counts.second_only
    linear = difference * (2 * total - second + first) - first - second
    constant = -first * difference * (1.0 - difference)
    root = math.sqrt(max(linear * linear - 8.0 * total * constant, 0.0))
    share = max((root - linear) / (4.0 * total), 0.0, -difference)
    variance = total * (2.0 * share + difference * (1.0 - difference))
    distance = second - first - total * difference
    if variance <= 0.0:
        return math.copysign(math.inf, distance) if distance else 0.0
    return distance / math.sqrt(variance)
