"""Intervals of quasi-random evaluations: from the spread of the independent randomisations, not of the encounters.

Encounters of one randomisation depend on each other, so that no interval of independent encounters fits them. The
randomisations are independent: an estimate carries Student's t interval over theirs. A rate is a ratio of two sums
over randomisations, which is linearised where its denominator varies too (W. G. Cochran, Sampling Techniques, 1977).
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from eval.metrics.summary import summarise
from eval.stats.intervals import Interval, clopper_pearson, ends

__all__ = ["ratio_interval", "replicated"]

_RESAMPLES = 2  # the bootstrap intervals of one randomisation are not used


def ratio_interval(numerator: np.ndarray, denominator: np.ndarray, confidence: float) -> Interval:
    """Return sum(numerator) / sum(denominator) with its t interval over R >= 2 independent randomisations.

    Args:
        numerator: ``[R]``.
        denominator: ``[R]``, >= 0.
        confidence: in (0, 1).

    Returns:
        NaN throughout where the denominators are all 0.
    """
    replicates, whole = len(numerator), float(np.sum(denominator))
    if replicates < 2:
        raise ValueError(f"there are {replicates} randomisations; expected at least 2")
    if whole == 0.0:
        return Interval(math.nan, math.nan, math.nan)
    from scipy.special import stdtrit

    value = float(np.sum(numerator)) / whole
    left = (numerator - value * denominator) / (whole / replicates)
    error = math.sqrt(float(np.sum(left**2)) / (replicates * (replicates - 1)))
    half = float(stdtrit(replicates - 1, 0.5 + 0.5 * confidence)) * error
    return Interval(value, value - half, value + half)


def replicated(table: Mapping[str, np.ndarray], replicates: int, confidence: float) -> dict[str, Any]:
    """Return the entries of a summary whose intervals the randomisations give, in JSON types.

    A rate that is 0 or 1 in every randomisation has no spread to go by: it keeps its Clopper-Pearson interval, which is
    that of independent encounters and, for these, rather too wide.

    Args:
        table: columns ``[N]`` as :func:`eval.flights.chunks.columns` makes them; encounter i is of randomisation i mod
            R.
        replicates: R >= 2.
        confidence: of all intervals.
    """
    number = table["encounter"] % replicates
    columns = {name: table[name] for name in table}
    parts = [
        summarise({name: field[number == each] for name, field in columns.items()}, confidence, _RESAMPLES, 0)
        for each in range(replicates)
    ]
    found: dict[str, Any] = {
        key: _rate(
            np.array([part[key]["count"] for part in parts]), np.array([p[key]["total"] for p in parts]), confidence
        )
        for key, one in parts[0].items()
        if isinstance(one, dict) and "total" in one
    }
    of = {key: np.array([part["counts"][key] for part in parts]) for key in parts[0]["counts"]}
    sizes = np.array([np.count_nonzero(number == each) for each in range(replicates)])
    scores = np.array([part["score_mean"] for part in parts]) * sizes
    found["score_mean_interval"] = ends(ratio_interval(scores, sizes, confidence))
    excess = np.array([part["path_excess_mean"] or 0.0 for part in parts]) * of["success"]
    found["path_excess_mean_interval"] = ends(ratio_interval(excess, of["success"], confidence), 0.0)
    risk = ratio_interval(of["violation"], of["baseline_violation"], confidence)
    found["risk_ratio_interval"] = ends(risk, 0.0)
    if risk.value == 0.0:
        high = clopper_pearson(0, int(sizes.sum()), confidence)[1] * float(sizes.sum() / of["baseline_violation"].sum())
        found["risk_ratio_interval"] = {"low": 0.0, "high": high}
    return found


def _rate(count: np.ndarray, total: np.ndarray, confidence: float) -> dict[str, Any]:
    successes, trials = int(count.sum()), int(total.sum())
    low, high = clopper_pearson(successes, trials, confidence)
    value = None
    if trials:
        value, below, above = ratio_interval(count, total, confidence)
        if 0 < successes < trials:
            low, high = max(below, 0.0), min(above, 1.0)
    return {"value": value, "low": low, "high": high, "count": successes, "total": trials}
