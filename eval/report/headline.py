"""The numbers at the head of a report: what each is called, its value, its interval and what it counts."""

from collections.abc import Mapping
from typing import Any, NamedTuple

__all__ = ["Line", "headline", "spaced"]

_RATES = (
    ("success, of all encounters", "success_rate"),
    ("success, of those not proven unresolvable", "success_given_resolvable"),
    ("violations of the required separation", "violation_rate"),
    ("time-outs", "timeout_rate"),
    ("proven unresolvable", "unresolvable_rate"),
    ("undecided (they count as resolvable)", "undecided_rate"),
    ("violations without a resolver", "baseline_violation_rate"),
    ("policy alone: success, of those not proven unresolvable", "policy_success_given_resolvable"),
    ("policy alone: violations", "policy_violation_rate"),
    ("plan flown once: success, of those not proven unresolvable", "plan_success_given_resolvable"),
    ("plan flown once: violations", "plan_violation_rate"),
    ("plans called SAFE, of those not proven unresolvable", "plan_safe_given_resolvable"),
    ("flights that used the backup", "backup_used_rate"),
)
_MEANS = (
    ("mean score (+100 goal, -100 violation, -10 time-out)", "score_mean", "+.2f", 1.0, ""),
    ("risk ratio: violations with the resolver / without it", "risk_ratio", ".4f", 1.0, ""),
    ("mean path excess of the successes", "path_excess_mean", ".2f", 100.0, " %"),
)
_QUANTILES = (
    ("smallest separation of all flights", "min_separation_m_quantiles", "0", " m"),
    ("its 1 % quantile", "min_separation_m_quantiles", "0.01", " m"),
    ("its median", "min_separation_m_quantiles", "0.5", " m"),
)


class Line(NamedTuple):
    """A line of the table; all in words."""

    key: str  # in summary.json
    label: str
    value: str
    interval: str
    counted: str


def headline(summary: Mapping[str, Any], unresolvable: Mapping[str, int]) -> list[Line]:
    """Return the lines for a summary (as in ``summary.json``); those that its mode does not have are left out.

    By a rate's key stands how many of those that it counts are proven unresolvable.
    """
    lines = []
    for label, key in _RATES:
        rate = summary.get(key)
        if isinstance(rate, dict):
            ends = f"{_percent(rate['low'])} to {_percent(rate['high'])}"
            part = f", {spaced(unresolvable[key])} of them proven unresolvable" if unresolvable.get(key) else ""
            lines.append(Line(key, label, _percent(rate["value"]), ends, _of(rate["count"], rate["total"]) + part))
    for label, key, form, factor, unit in _MEANS:
        low, high = (_plain(summary[f"{key}_interval"][end], form, factor, unit) for end in ("low", "high"))
        ends = "" if summary[f"{key}_interval"]["low"] is None else f"{low} to {high}"
        lines.append(Line(key, label, _plain(summary[key], form, factor, unit), ends, ""))
    for label, key, share, unit in _QUANTILES:
        value = summary[key].get(share)
        lines.append(Line(key, label, _plain(value, ".1f", 1.0, unit), "", ""))
    return lines


def spaced(value: int) -> str:
    """Return a whole number with thin spaces between its thousands."""
    return f"{value:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def _of(count: int, total: int) -> str:
    return f"{spaced(count)} of {spaced(total)}"


def _percent(value: float | None) -> str:
    return _plain(value, ".2f", 100.0, " %")


def _plain(value: float | None, form: str, factor: float, unit: str) -> str:
    return "-" if value is None else f"{format(factor * value, form)}{unit}"
