"""From the table of encounters to the numbers that matter; docs/reference/evaluation-files.md defines every key."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from eval.metrics.weighted import ratio
from eval.stats.intervals import Interval, ends, mean_interval, number, quantiles, share

__all__ = ["SCHEMA_VERSION", "summarise"]

SCHEMA_VERSION = 1


def summarise(table: Mapping[str, np.ndarray], confidence: float, resamples: int, seed: int) -> dict[str, Any]:
    """Return the statistics of an evaluation in JSON types; what cannot be said is None.

    Args:
        table: columns ``[N]`` as :func:`eval.flights.chunks.columns` makes them, N >= 1.
        confidence: of all intervals.
        resamples: bootstrap resamples behind the intervals of means.
        seed: of the bootstrap.
    """
    total = len(table["encounter"])
    success, violation, timeout = (table["outcome"] == name for name in ("reached", "violation", "timeout"))
    bare_violation = table["baseline_outcome"] == "violation"
    resolvable, undecided, unresolvable = (
        table["verdict"] == name for name in ("resolvable", "undecided", "unresolvable")
    )
    counts = {
        "success": success,
        "violation": violation,
        "timeout": timeout,
        "resolvable": resolvable,
        "undecided": undecided,
        "unresolvable": unresolvable,
        "baseline_success": table["baseline_outcome"] == "reached",
        "baseline_violation": bare_violation,
        "baseline_timeout": table["baseline_outcome"] == "timeout",
    }
    counted = {name: int(np.count_nonzero(mask)) for name, mask in counts.items()}

    def rate(count: int, of: int = total) -> dict[str, Any]:
        return share(count, of, confidence)

    possible = total - counted["unresolvable"]
    score = mean_interval(table["score"], confidence, resamples, seed)
    excess = table["path_excess"][success]
    path = mean_interval(excess, confidence, resamples, seed)
    risk = ratio(violation, bare_violation, confidence=confidence, resamples=resamples, seed=seed)
    return {
        "success_rate": rate(counted["success"]),
        "violation_rate": rate(counted["violation"]),
        "timeout_rate": rate(counted["timeout"]),
        "resolvable_rate": rate(possible),
        "success_given_resolvable": rate(counted["success"], possible),
        "success_given_solved": rate(counted["success"], counted["resolvable"]),
        "undecided_rate": rate(counted["undecided"]),
        "unresolvable_rate": rate(counted["unresolvable"]),
        "counts": counted,
        "score_mean": number(score.value),
        "score_mean_interval": ends(score),
        "risk_ratio": number(risk.value),
        "risk_ratio_interval": ends(Interval(risk.value, risk.low, risk.high)),
        "risk_ratio_unresolved": number(risk.unresolved),
        "risk_ratio_induced": number(risk.induced),
        "baseline_violation_rate": rate(counted["baseline_violation"]),
        "path_excess_mean": number(path.value),
        "path_excess_mean_interval": ends(path),
        "path_excess_quantiles": quantiles(excess, (0.5, 0.95, 1.0)),
        "min_separation_m_quantiles": quantiles(table["min_separation_m"], (0.0, 0.01, 0.05, 0.5)),
        **_of_others(table, rate, possible),
        **_of_plans(table, rate, possible),
        "duration_mean_s": float(np.mean(table["duration_s"])),
        "heading_reversals_mean": float(np.mean(table["heading_reversals"])),
    }


def _of_others(table: Mapping[str, np.ndarray], rate: Any, possible: int) -> dict[str, Any]:
    """Return how the weaker modes fared that are flown beside: the policy alone, the plan flown once."""
    rates = {}
    for name in ("policy", "plan"):
        if f"{name}_outcome" in table:
            success = int(np.count_nonzero(table[f"{name}_outcome"] == "reached"))
            rates[f"{name}_success_rate"] = rate(success)
            rates[f"{name}_success_given_resolvable"] = rate(success, possible)
            lost = int(np.count_nonzero(table[f"{name}_outcome"] == "violation"))
            rates[f"{name}_violation_rate"] = rate(lost)
    if "replans" in table:
        rates["replans_mean"] = float(np.mean(table["replans"]))
        rates["backup_used_rate"] = rate(int(np.count_nonzero(table["backup_s"])))
    return rates


def _of_plans(table: Mapping[str, np.ndarray], rate: Any, possible: int) -> dict[str, Any]:
    """Return how often plans were safe, their sources, and the outcomes of the safe ones."""
    if "plan_status" not in table:
        return {}
    # The true vehicle's limits let it save some that are lost within the surrogate's.
    safe, lost_cause = table["plan_status"] == "safe", table["verdict"] == "unresolvable"
    lost = safe & (table["plan_outcome" if "plan_outcome" in table else "outcome"] == "violation")
    named = {name: int(np.count_nonzero(safe & (table["plan_source"] == name))) for name in ("policy", "fallback")}
    error = table["follower_error_m"][safe]
    return {
        "plan_safe_rate": rate(int(np.count_nonzero(safe))),
        "plan_safe_given_resolvable": rate(int(np.count_nonzero(safe & ~lost_cause)), possible),
        "safe_plans_violated": int(np.count_nonzero(lost)),
        "safe_plans_by_source": named,
        "follower_error_m_quantiles": quantiles(error, (0.5, 0.99, 1.0)),
        "whole_min_separation_m": number(float(np.min(table["whole_min_separation_m"][safe]))) if safe.any() else None,
    }
