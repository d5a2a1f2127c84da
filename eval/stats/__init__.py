"""Intervals and paired tests, independent of what is counted."""

from eval.stats.intervals import Interval, clopper_pearson, mean_interval
from eval.stats.paired import Pairs, mcnemar_exact, pairs, tango
from eval.stats.plain import share

__all__ = ["Interval", "Pairs", "clopper_pearson", "mcnemar_exact", "mean_interval", "pairs", "share", "tango"]
