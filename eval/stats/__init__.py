"""Intervals and paired tests, independent of what is counted."""

from eval.stats.intervals import Interval, Rate, clopper_pearson, mean_interval, rate, risk_ratio
from eval.stats.paired import Pairs, mcnemar_exact, pairs, tango

__all__ = [
    "Interval",
    "Pairs",
    "Rate",
    "clopper_pearson",
    "mcnemar_exact",
    "mean_interval",
    "pairs",
    "rate",
    "risk_ratio",
    "tango",
]
