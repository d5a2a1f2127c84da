"""Statistics of encounters that do not all weigh the same: shares of the weight, with bootstrap intervals."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from eval.metrics.field import ratio
from eval.stats.intervals import clopper_pearson, number, percentiles, resampled_sums

__all__ = ["summarise_weighted"]


def summarise_weighted(
    table: Mapping[str, np.ndarray], confidence: float, resamples: int, seed: int
) -> dict[str, Any] | None:
    """Return the rates of an evaluation by weight in JSON types; None where all weights are 1.

    A rate is the weight of the encounters that it counts over the weight of all. Its interval is a percentile bootstrap
    over encounters; where a rate is 0 or 1 no resample can differ, and the Clopper-Pearson ends at the effective sample
    size stand in. Encounters are taken to be independent and the sampler's; none are known beyond those of a file.

    Args:
        table: columns ``[N]`` as :func:`eval.flights.chunks.columns` makes them, N >= 1.
        confidence: of all intervals.
        resamples: of the bootstraps.
        seed: of the bootstraps.
    """
    weight = table["weight"]
    if (weight == 1.0).all():
        return None
    every = np.ones(len(weight), bool)
    possible = table["verdict"] != "unresolvable"
    wanted: dict[str, tuple[np.ndarray, np.ndarray]] = {
        "success_rate": (table["outcome"] == "reached", every),
        "violation_rate": (table["outcome"] == "violation", every),
        "timeout_rate": (table["outcome"] == "timeout", every),
        "resolvable_rate": (possible, every),
        "success_given_resolvable": ((table["outcome"] == "reached") & possible, possible),
        "baseline_violation_rate": (table["baseline_outcome"] == "violation", every),
    }
    for name in ("policy", "plan"):
        if f"{name}_outcome" in table:
            reached = table[f"{name}_outcome"] == "reached"
            wanted[f"{name}_success_rate"] = (reached, every)
            wanted[f"{name}_success_given_resolvable"] = (reached & possible, possible)
    parts = np.stack([weight * mask for pair in wanted.values() for mask in pair], axis=1)
    sums = resampled_sums(parts, resamples, seed)
    rates = {
        name: _rate(weight, *pair, part, confidence)
        for (name, pair), part in zip(wanted.items(), np.split(sums, len(wanted), axis=1), strict=True)
    }
    events = (table["outcome"] == "violation", table["baseline_outcome"] == "violation")
    found = ratio(*events, weight, confidence=confidence, resamples=resamples, seed=seed)
    return {
        "effective_sample_size": _effective(weight),
        "largest_share": float(weight.max() / weight.sum()),
        **rates,
        "risk_ratio": number(found.value),
        "risk_ratio_interval": {"low": number(found.low), "high": number(found.high)},
        "risk_ratio_unresolved": number(found.unresolved),
        "risk_ratio_induced": number(found.induced),
        "warnings": list(found.warnings),
    }


def _rate(
    weight: np.ndarray, counted: np.ndarray, of: np.ndarray, sums: np.ndarray, confidence: float
) -> dict[str, float | None]:
    chosen = weight * of
    if not chosen.any():
        return {"value": None, "low": 0.0, "high": 1.0}
    value = min(float(weight @ counted / chosen.sum()), 1.0)  # sums of another order may round beyond
    effective = max(int(_effective(chosen[of])), 1)
    if not counted.any():
        return {"value": value, "low": 0.0, "high": clopper_pearson(0, effective, confidence)[1]}
    if (counted == of).all():
        return {"value": value, "low": clopper_pearson(effective, effective, confidence)[0], "high": 1.0}
    known = sums[:, 1] > 0.0
    low, high = percentiles(sums[known, 0] / sums[known, 1], confidence)
    return {"value": value, "low": low, "high": high}


def _effective(weight: np.ndarray) -> float:
    """Return Kish's effective sample size, (sum w)^2 / sum w^2."""
    return float(weight.sum() ** 2 / np.sum(weight**2))
