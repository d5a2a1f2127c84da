"""Rates of a table, risk ratios and their parts, with weights: encounters need not all weigh the
same.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eval.stats.intervals import clopper_pearson, number, percentiles, resampled_sums, share
from eval.stats.paired import pairs

_FEW_EVENTS = 10  # events without the resolver below which a ratio says little

_DOMINANT = 0.1  # share of the weighted events beyond which a single encounter decides the ratio
_GIVEN = "success_rate", "success_given_resolvable"
_BY_WEIGHT = {
    "violation_rate",
    "timeout_rate",
    "resolvable_rate",
    "baseline_violation_rate",
    *(before + name for before in ("", "policy_", "plan_") for name in _GIVEN),
}


@dataclass(frozen=True)
class Ratio:
    """P(event with the resolver) / P(event without it), weighted; nan where nothing can be said."""

    value: float
    low: float
    high: float
    # the part of encounters that have the event without the resolver and still have it with
    unresolved: float
    induced: float  # the part of encounters that have it only with the resolver
    events: int  # encounters with the event, with the resolver
    events_without: int
    total: int
    effective: float  # kish's effective sample size, (sum w)^2 / sum w^2
    warnings: tuple[str, ...]  # sentences on why the sample cannot carry the claim


def ratio(
    event: np.ndarray,
    event_without: np.ndarray,
    weights: np.ndarray | None = None,
    *,
    confidence: float = 0.95,
    resamples: int = 2_000,
    seed: int = 0,
    strata: np.ndarray | None = None,
) -> Ratio:
    """Return the risk ratio of events, bool ``[N]``, with and without a resolver: NMAC, loss of
    well clear, any event.

    The interval is a paired percentile bootstrap over encounters. With no event at all a resample
    cannot show one: the upper end is then the Clopper-Pearson end of the rate at the effective
    sample size, over the rate without. Where all resamples have one ratio, such as where every
    event stays one, its ends are quotients of the Clopper-Pearson ends of both rates. Importance
    weights ``[N]`` are finite, not negative and not all 0, else ``ValueError``; None: equal ones.
    Of encounters drawn by ``strata``, numbers ``[N]``, those without an event raise the upper end
    by :func:`unseen`.
    """
    cells = pairs(event, event_without)
    weight = _weights(weights, sum(cells))
    nothing = Ratio(
        value=math.nan,
        low=math.nan,
        high=math.nan,
        unresolved=math.nan,
        induced=math.nan,
        events=cells.both + cells.first_only,
        events_without=cells.both + cells.second_only,
        total=sum(cells),
        effective=_effective(weight),
        warnings=("there is no event without the resolver: the ratio is undefined",),
    )
    without = float(weight @ event_without)
    if without == 0.0:
        return nothing
    value = float(weight @ event) / without
    beyond = 0.0
    if strata is not None:
        beyond = unseen(event, strata, weight, confidence) / without
    if nothing.events == 0 and strata is not None:
        low, high = 0.0, beyond
    elif nothing.events == 0:
        rate = clopper_pearson(0, max(math.floor(nothing.effective), 1), confidence)[1]
        low, high = 0.0, rate * float(weight.sum()) / without
    else:
        parts = np.stack([weight * event, weight * event_without], axis=-1)
        low, high = _percentiles_of_ratio(resampled_sums(parts, resamples, seed), confidence)
        if low == high:  # no resample can differ
            low, high = _ends_of_ratio(weight, event, event_without, nothing.effective, confidence)
        high += beyond
    result = replace(
        nothing,
        value=value,
        low=low,
        high=high,
        unresolved=float(weight @ (event & event_without)) / without,
        induced=float(weight @ (event & ~event_without)) / without,
    )
    return replace(result, warnings=_warnings(result, weight, event, event_without))


def unseen(
    event: np.ndarray, strata: np.ndarray, weight: np.ndarray, confidence: float = 0.95
) -> float:
    """Return the greatest weight that events, bool ``[N]``, may have in strata, numbers ``[N]``, of
    which none is seen, in the units of the weights ``[N]``; of an interval's upper end.

    With W_k the weight of such a stratum and n_k its effective size, the chance of no event in any
    is at most that of none in n = min(n_k W / W_k) encounters at the mean rate, where W is the sum
    of W_k (Jensen's inequality); so that the Clopper-Pearson end of 0 in n bounds that rate.
    """
    empty = [stratum for stratum in np.unique(strata) if not event[strata == stratum].any()]
    parts = [weight[strata == stratum] for stratum in empty]
    parts = [part for part in parts if part.any()]
    if not parts:
        return 0.0
    sums = np.array([part.sum() for part in parts])
    sizes = np.array([_effective(part) for part in parts])
    size = max(math.floor(1e-9 + np.min(sizes * sums.sum() / sums)), 1)
    return float(sums.sum()) * clopper_pearson(0, size, confidence)[1]


def _ends_of_ratio(
    weight: np.ndarray,
    event: np.ndarray,
    event_without: np.ndarray,
    effective: float,
    confidence: float,
) -> tuple[float, float]:
    """Return quotients of the Clopper-Pearson ends of two rates at an effective sample size."""
    size = max(math.floor(effective), 1)
    counts = (
        round(float(weight @ events / weight.sum()) * size) for events in (event, event_without)
    )
    ours, bare = (clopper_pearson(count, size, confidence) for count in counts)
    return ours[0] / bare[1], ours[1] / bare[0] if bare[0] > 0.0 else math.inf


def _percentiles_of_ratio(sums: np.ndarray, confidence: float) -> tuple[float, float]:
    """Return the ends of the interval of the ratio of two resampled sums, ``[B, 2]``, where the
    second is above 0.
    """
    positive = sums[:, 1] > 0.0
    return percentiles(sums[positive, 0] / sums[positive, 1], confidence)


def _weights(weights: np.ndarray | None, count: int) -> np.ndarray:
    weight = np.ones(count) if weights is None else np.asarray(weights, np.float64)
    if weight.shape != (count,) or not (
        np.isfinite(weight).all() and (weight >= 0.0).all() and weight.sum() > 0.0
    ):
        raise ValueError(
            f"weights must be {count}, finite and not negative, at least one of them positive"
        )
    return weight


def _warnings(
    result: Ratio, weight: np.ndarray, event: np.ndarray, event_without: np.ndarray
) -> tuple[str, ...]:
    warnings = []
    if result.events_without < _FEW_EVENTS:
        warnings.append(
            f"only {result.events_without} events without the resolver, expected at least "
            f"{_FEW_EVENTS}"
        )
    if result.high - result.low > result.value:
        warnings.append(
            "the interval is wide: half of it exceeds half the ratio; use more encounters"
        )
    for events, name in ((event, "with"), (event_without, "without")):
        largest, total = float(np.max(weight * events)), float(weight @ events)
        if total > 0.0 and largest > _DOMINANT * total and events.sum() >= 1.0 / _DOMINANT:
            warnings.append(
                f"one encounter carries {largest / total:.0%} of the weight of the events {name} "
                "the resolver"
            )
    return tuple(warnings)


def to_json(result: Ratio) -> dict[str, Any]:
    """Return a ratio of violations as a summary has it, in JSON types."""
    return {
        "risk_ratio": number(result.value),
        "risk_ratio_interval": {"low": number(result.low), "high": number(result.high)},
        "risk_ratio_unresolved": number(result.unresolved),
        "risk_ratio_induced": number(result.induced),
    }


def rates_of(table: Mapping[str, np.ndarray]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return what each rate of a table counts, and of which encounters, bool ``[N]`` both, by the
    rate's name.
    """
    outcome, verdict = table["outcome"], table["verdict"]
    # The policy flies within the limits of decisions, plans within those of the vehicle.
    of_policy = table.get("policy_verdict", verdict) != "unresolvable"
    every, possible = np.ones(len(outcome), bool), verdict != "unresolvable"
    reached = outcome == "reached"
    rates = {
        "success_rate": (reached, every),
        "violation_rate": (outcome == "violation", every),
        "timeout_rate": (outcome == "timeout", every),
        "resolvable_rate": (possible, every),
        "success_given_resolvable": (reached, possible),
        "success_given_solved": (reached, verdict == "resolvable"),
        "undecided_rate": (verdict == "undecided", every),
        "unresolvable_rate": (~possible, every),
        "baseline_violation_rate": (table["baseline_outcome"] == "violation", every),
    }
    if "areas" in table:
        rates["breach_rate"] = (outcome == "breach", every)
    for name, can in (("policy", of_policy), ("plan", possible)):
        if f"{name}_outcome" in table:
            other = table[f"{name}_outcome"]
            rates[f"{name}_success_rate"] = (other == "reached", every)
            rates[f"{name}_success_given_resolvable"] = (other == "reached", can)
            rates[f"{name}_violation_rate"] = (other == "violation", every)
    if "backup_s" in table:
        rates["backup_used_rate"] = (table["backup_s"] > 0.0, every)
    if "climbs" in table:
        rates["climbed_rate"] = (table["climbs"] > 0, every)
    if "plan_status" in table:
        safe = table["plan_status"] == "safe"
        rates |= {"plan_safe_rate": (safe, every), "plan_safe_given_resolvable": (safe, possible)}
    # SAFE plans may stand in encounters that are lost in hindsight: an intruder turns later.
    return {name: (counted & of, of) for name, (counted, of) in rates.items()}


def summarise_weighted(
    table: Mapping[str, np.ndarray], confidence: float, resamples: int, seed: int
) -> dict[str, Any] | None:
    """Return rates of :func:`rates_of` by weight in JSON types; None where all weights are 1.

    A rate is the weight of the encounters that it counts over the weight of all. Its interval is a
    percentile bootstrap over encounters; where a rate is 0 or 1 no resample can differ, and the
    Clopper-Pearson ends at the effective sample size stand in. Encounters are taken to be
    independent and the sampler's; none are known beyond those of a file.
    """
    weight = table["weight"]
    if (weight == 1.0).all():
        return None
    weighted = {name: pair for name, pair in rates_of(table).items() if name in _BY_WEIGHT}
    parts = np.stack([weight * mask for pair in weighted.values() for mask in pair], axis=1)
    sums = resampled_sums(parts, resamples, seed)
    rates = {
        name: _rate(weight, *pair, part, confidence)
        for (name, pair), part in zip(
            weighted.items(), np.split(sums, len(weighted), axis=1), strict=True
        )
    }
    events = (table["outcome"] == "violation", table["baseline_outcome"] == "violation")
    result = ratio(*events, weight, confidence=confidence, resamples=resamples, seed=seed)
    return {
        "effective_sample_size": _effective(weight),
        "largest_share": float(weight.max() / weight.sum()),
        **rates,
        **to_json(result),
        "warnings": list(result.warnings),
    }


def weighted_rate(
    counted: np.ndarray,
    of: np.ndarray,
    weights: np.ndarray | None,
    confidence: float = 0.95,
    resamples: int = 2_000,
    seed: int = 0,
    strata: np.ndarray | None = None,
) -> dict[str, Any]:
    """Return the weight of what is counted, over that of the encounters that it is of, bool ``[N]``
    both, in JSON types with the interval of :func:`summarise_weighted`; of equal weights (None)
    that of Clopper and Pearson.

    Of encounters drawn by ``strata``, numbers ``[N]``, those in which nothing is counted raise the
    upper end by :func:`unseen`; a number below 0 says that nothing can be counted there.
    """
    counted = counted & of
    if weights is None:
        return share(np.count_nonzero(counted), np.count_nonzero(of), confidence)
    parts = np.stack([weights * counted, weights * of], axis=1)
    rate = _rate(weights, counted, of, resampled_sums(parts, resamples, seed), confidence)
    whole = float(weights @ of)
    if strata is None or rate["high"] is None or not whole:
        return rate
    open_ = of & (strata >= 0)
    beyond = unseen(counted[open_], strata[open_], weights[open_], confidence) / whole
    if not counted.any():
        return rate | {"high": beyond}
    return rate | {"high": min(rate["high"] + beyond, 1.0)}


def weighted_mean(
    values: np.ndarray,
    weights: np.ndarray | None,
    confidence: float = 0.95,
    resamples: int = 2_000,
    seed: int = 0,
) -> dict[str, float | None]:
    """Return the mean of the finite ones of values ``[N]`` by weight (None: equal ones) and its
    percentile bootstrap interval, in JSON types; None where there is no value.
    """
    finite = np.isfinite(values)
    weight = (np.ones(values.size) if weights is None else weights) * finite
    if not weight.any():
        return {"value": None, "low": None, "high": None}
    parts = np.stack([weight * np.where(finite, values, 0.0), weight], axis=1)
    low, high = _percentiles_of_ratio(resampled_sums(parts, resamples, seed), confidence)
    value = float(parts[:, 0].sum() / weight.sum())
    return {"value": value, "low": low, "high": high}


def _rate(
    weight: np.ndarray, counted: np.ndarray, of: np.ndarray, sums: np.ndarray, confidence: float
) -> dict[str, float | None]:
    chosen = weight * of
    if not chosen.any():
        return {"value": None, "low": 0.0, "high": 1.0}
    # Sums of another order may round beyond 1.
    value = min(float(weight @ counted / chosen.sum()), 1.0)
    effective = max(int(_effective(chosen[of])), 1)
    if not counted.any():
        return {"value": value, "low": 0.0, "high": clopper_pearson(0, effective, confidence)[1]}
    if (counted == of).all():
        return {
            "value": value,
            "low": clopper_pearson(effective, effective, confidence)[0],
            "high": 1.0,
        }
    low, high = _percentiles_of_ratio(sums, confidence)
    return {"value": value, "low": low, "high": high}


def _effective(weight: np.ndarray) -> float:
    return float(weight.sum() ** 2 / np.sum(weight**2))
