"""Intervals and paired tests, independent of what is counted."""

from eval.stats.intervals import Interval, clopper_pearson, mean_interval, share
from eval.stats.paired import Pairs, mcnemar_exact, pairs, tango

__all__ = [
    "Interval",
    "Pairs",
    "clopper_pearson",
    "mcnemar_exact",
    "mean_interval",
    "pairs",
    "share",
    "tango",
]
