"""From the table of flights to its statistics; docs/reference/evaluation-files.md defines every
key.
"""

import math
import re
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from commands.progress import group_digits
from eval.hifi.rows import ERRORS, HIFI_OUTCOMES
from eval.metrics.summary import BROKEN, NOT_PROMISED
from eval.stats.intervals import quantiles, share

_SHARES = (0.5, 0.95, 0.99, 1.0)
_COVERED = 0.99  # share of the flights that a margin covers
_ROUNDING = 5.0  # m, to which a margin is rounded up
_RATES = {
    "success_rate": "goal reached, separation kept",
    "violation_rate": "losses of separation",
    "breach_rate": "geofence violations",
    "timeout_rate": "time-outs",
    "failed_rate": "aircraft lost",
    "refused_rate": "plans that were not flown, with a reason",
    "plan_safe_rate": "plans called SAFE",
    "safe_of_resolvable": "plans called SAFE and flown, of those that can be resolved",
    "success_of_safe": "success of SAFE plans",
    "breach_of_safe": "geofence violations by SAFE plans",
    "violation_of_safe": "SAFE plans that lost the separation, for either reason",
    "plan_climbs_rate": "SAFE plans that climb or descend",
    "backup_used_rate": "flights that used the backup",
    "climbing_backup_used_rate": "flights that used a backup that climbs or descends",
}
"""What the rates are called in the table."""
_LOSSES = {"safe_plans_broken": "broken", "safe_plans_not_promised": "not_promised"}
_SAFE_PLANS = {"safe_plans_broken": BROKEN, "safe_plans_not_promised": NOT_PROMISED}
"""What the parts of the losses of SAFE plans are called in the table, above their rate."""
_LARGEST = {
    "cross_track_rms_m": ("cross-track, root mean square", "m"),
    "cross_track_max_m": ("cross-track", "m"),
    "along_track_max_m": ("along-track", "m"),
    "late_max_s": ("arrival", "s"),
    "position_error_max_m": ("position, flight-technical", "m"),
    "position_error_to_goal_m": ("position, until the goal", "m"),
    "path_definition_max_m": ("path definition", "m"),
    "total_error_max_m": ("total", "m"),
    "altitude_error_max_m": ("altitude", "m"),
    "separation_loss_m": ("separation less than planned by", "m"),
}
"""What the errors are called in the table, and their units."""
_ERRORS = (*(name for name in ERRORS if name != "accumulated_m_s"), "separation_loss_m")


def summarise(table: Mapping[str, np.ndarray], confidence: float) -> dict[str, Any]:
    """Return the statistics of a table of :func:`eval.hifi.rows.columns` in JSON types; what cannot
    be said is None.
    """
    safe = table["plan_status"] == "safe"
    whole = table["whole_min_separation_m"][safe]
    # Without their numbers, so that equal ones are counted together.
    reasons = Counter(re.sub(r"-?\d+(\.\d+)?", "#", text) for text in table["reason"] if text)
    summary: dict[str, Any] = {
        **_rates(table, confidence),
        "min_separation_m_quantiles": quantiles(table["min_separation_m"], (0.0, 0.01, 0.05, 0.5)),
        "whole_min_separation_m_of_safe": quantiles(whole, (0.0, 0.01, 0.5)),
        "errors": {name: quantiles(table[name][safe], _SHARES) for name in _ERRORS},
        "margin": margin(table, confidence),
        "reasons": dict(reasons.most_common()),
    }
    if "altitude_deviation_m" in table:
        summary["vertical_margin"] = margin(table, confidence, "altitude_error_max_m")
        deviation = table["altitude_deviation_m"][safe]
        summary["altitude_deviation_m_of_safe"] = quantiles(deviation, _SHARES)
        climbing = np.count_nonzero(safe & (table["plan_climbed_m"] > 0.0))
        summary["plan_climbs_rate"] = share(climbing, np.count_nonzero(safe), confidence)
    if "plan_loss" in table:
        for key, kind in _LOSSES.items():
            summary[key] = int(np.count_nonzero(table["plan_loss"] == kind))
    if "replans" in table:
        summary["replans_mean"] = float(np.mean(table["replans"]))
        used = np.count_nonzero(table["backup_s"] > 0)
        summary["backup_used_rate"] = share(used, len(table["outcome"]), confidence)
    if "climbing_backup_s" in table:
        climbing = np.count_nonzero(table["climbing_backup_s"] > 0)
        summary["climbing_backup_used_rate"] = share(climbing, len(table["outcome"]), confidence)
        name = "backup_altitude_error_max_m"
        summary[f"{name}_quantiles"] = quantiles(table[name], _SHARES)
    return summary


def _rates(table: Mapping[str, np.ndarray], confidence: float) -> dict[str, Any]:
    """Return the rates of how flights end, of all and of SAFE plans."""
    outcome, safe = table["outcome"], table["plan_status"] == "safe"
    every = np.ones(len(outcome), bool)
    possible = ~np.isin(table["verdict"], ("unresolvable", "outside"))
    # Refusing is no success: a plan that was not flown for the wind resolves nothing.
    flyable = safe & (outcome != "refused")
    among_areas = ("breach",) if "areas" in table else ()
    counted = {"success_rate": (outcome == "reached", every)}
    for name in (*HIFI_OUTCOMES[1:], *among_areas):
        counted[f"{name}_rate"] = (outcome == name, every)
    counted |= {
        "plan_safe_rate": (safe, every),
        "safe_of_resolvable": (flyable, possible),
        "success_of_safe": (outcome == "reached", safe),
        "violation_of_safe": (outcome == "violation", safe),
    }
    for name in among_areas:
        counted[f"{name}_of_safe"] = (outcome == name, safe)
    return {
        name: share(np.count_nonzero(events & of), np.count_nonzero(of), confidence)
        for name, (events, of) in counted.items()
    }


def rate_rows(summary: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Return the rates of a summary in words: what, value, interval, count."""
    rows = []
    for key, label in _RATES.items():
        rate = summary.get(key)
        if rate is None or rate["value"] is None:
            continue
        if key == "violation_of_safe":
            parts = [part for part in _SAFE_PLANS if part in summary]
            rows += [(_SAFE_PLANS[part], group_digits(summary[part]), "", "") for part in parts]
        low, high = (f"{100.0 * rate[end]:.2f} %" for end in ("low", "high"))
        count = f"{group_digits(rate['count'])} of {group_digits(rate['total'])}"
        rows.append((label, f"{100.0 * rate['value']:.2f} %", f"{low} to {high}", count))
    closest = summary["min_separation_m_quantiles"]
    for label, at in (("smallest separation of all flights", "0"), ("its median", "0.5")):
        rows.append((label, _metres(closest[at]), "", ""))
    return rows


def error_rows(summary: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Return the largest errors of the flights of SAFE plans in words: what, median, 95 %, largest
    of all flights; none where no such plan was flown.
    """
    rows = []
    for key, (label, unit) in _LARGEST.items():
        quantiles = summary["errors"][key]
        if quantiles["1"] is not None:
            median, high, most = (
                f"{quantiles[share]:.4g} {unit}" for share in ("0.5", "0.95", "1")
            )
            rows.append((label, median, high, most))
    return rows


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f} m"


def margin(
    table: Mapping[str, np.ndarray], confidence: float, distance: str = "position_error_max_m"
) -> dict[str, Any]:
    """Return a bound of the distance from their SAFE plans that 99 % of flights keep, and the
    margin that covers it; the distance is a column of the table, over the ground or up and down.

    The distance between two aircraft differs from the planned one by no more than the own distance
    from the plan at that time, so that such a margin keeps what was planned, whatever the geometry.
    The bound is an order statistic: nothing is assumed of the distribution. An aircraft that was
    lost counts as infinitely far away.
    """
    safe, off = table["plan_status"] == "safe", table[distance]
    lost = safe & (table["outcome"] == "failed")
    bound = upper_bound(
        np.where(lost, np.inf, off)[lost | (safe & np.isfinite(off))], _COVERED, confidence
    )
    finite_bound = bound if bound is not None and math.isfinite(bound) else None
    return {
        "bound_m": finite_bound,
        "margin_m": None
        if finite_bound is None
        else _ROUNDING * math.ceil(finite_bound / _ROUNDING),
        "flights_needed": math.ceil(math.log(1.0 - confidence) / math.log(_COVERED)),
    }


def upper_bound(values: np.ndarray, share: float, confidence: float) -> float | None:
    """Return a bound that a quantile of values ``[M]``, inf allowed, does not exceed with some
    confidence.

    The k-th smallest of n independent values exceeds the quantile of share q with probability P(B <
    k), B binomial in n and q; the bound is the smallest value for which that reaches the
    confidence, None where there are too few values.
    """
    from scipy.special import bdtr

    reached = np.flatnonzero(bdtr(np.arange(values.size), values.size, share) >= confidence)
    return float(np.sort(values)[reached[0]]) if reached.size else None
