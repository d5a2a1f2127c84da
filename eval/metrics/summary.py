"""From the table of encounters to its statistics, and their table on the screen.

docs/reference/evaluation-files.md defines every key.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from commands.progress import group_digits
from eval.metrics.weighted import rates_of, ratio, summarise_weighted, to_json
from eval.stats.intervals import ends, mean_interval, number, quantiles, share

_RATES = (
    ("success of all encounters", "success_rate"),
    ("success of those not proven unresolvable", "success_given_resolvable"),
    ("losses of separation", "violation_rate"),
    ("time-outs", "timeout_rate"),
    ("geofence violations", "breach_rate"),
    ("proven unresolvable", "unresolvable_rate"),
    ("undecided (they count as resolvable)", "undecided_rate"),
    ("losses of separation without a resolver", "baseline_violation_rate"),
    ("policy alone: success of those not proven unresolvable", "policy_success_given_resolvable"),
    ("policy alone: losses of separation", "policy_violation_rate"),
    ("plan flown once: success of those not proven unresolvable", "plan_success_given_resolvable"),
    ("plan flown once: losses of separation", "plan_violation_rate"),
    ("plans called SAFE, of those not proven unresolvable", "plan_safe_given_resolvable"),
    ("flights that used the backup", "backup_used_rate"),
    ("flights that climbed or descended", "climbed_rate"),
)
_AREA = "min_area_clearance_m_quantiles"
_DEVIATION = "altitude_deviation_m_quantiles"


class _Form(NamedTuple):
    """How a number is written."""

    digits: str  # a format
    factor: float = 1.0
    unit: str = ""

    def text(self, value: float | None) -> str:
        """Return a number in words."""
        return "-" if value is None else f"{format(self.factor * value, self.digits)}{self.unit}"

    def interval(self, ends: Mapping[str, float | None]) -> str:
        """Return an interval in words; nothing of none."""
        if ends["low"] is None:
            return ""
        return f"{self.text(ends['low'])} to {self.text(ends['high'])}"


_PERCENT = _Form(".2f", 100.0, " %")
_MEANS = (
    ("mean score (+100 goal, -100 loss of separation, -10 time-out)", "score_mean", _Form("+.2f")),
    ("risk ratio: losses of separation with the resolver / without it", "risk_ratio", _Form(".4f")),
    ("mean extra track distance of the successes", "path_excess_mean", _PERCENT),
)
_QUANTILES = (
    ("smallest separation of all flights", "min_separation_m_quantiles", "0", ".1f"),
    ("its 1 % quantile", "min_separation_m_quantiles", "0.01", ".1f"),
    ("its median", "min_separation_m_quantiles", "0.5", ".1f"),
    ("smallest distance beyond the clearance of an area", _AREA, "0", ".1f"),
    ("largest deviation from the altitude at the start", _DEVIATION, "1", ".1f"),
    ("its 95 % quantile", _DEVIATION, "0.95", ".1f"),
    ("largest error of the follower of SAFE plans", "follower_error_m_quantiles", "1", ".4f"),
)
BROKEN = "SAFE plans that broke their promise (must be 0)"
NOT_PROMISED = (
    "losses of separation to intruders that left their reported motion, not promised by SAFE"
)
"""What the two parts of the losses of SAFE plans are called, before their sum."""
_SAFE_PLANS = (
    (BROKEN, "safe_plans_broken"),
    (NOT_PROMISED, "safe_plans_not_promised"),
    ("SAFE plans that lost the separation, for either reason", "safe_plans_violated"),
    ("SAFE plans that violated a geofence, flown once", "safe_plans_in_areas"),
)


def summarise(
    table: Mapping[str, np.ndarray], confidence: float, resamples: int, seed: int
) -> dict[str, Any]:
    """Return the statistics of a table of :func:`eval.flights.chunks.columns`, N >= 1, in JSON
    types; None: not known.

    The confidence is that of all intervals; those of means are bootstraps of so many resamples and
    of this seed.
    """
    how = (confidence, resamples, seed)
    words = {"success": "reached", "violation": "violation", "timeout": "timeout"}
    counts = {name: table["outcome"] == word for name, word in words.items()}
    if "areas" in table:
        counts["breach"] = table["outcome"] == "breach"
    counts |= {
        name: table["verdict"] == name for name in ("resolvable", "undecided", "unresolvable")
    }
    counts |= {
        f"baseline_{name}": table["baseline_outcome"] == word for name, word in words.items()
    }
    excess = table["path_excess"][counts["success"]]
    excess = excess[~np.isnan(excess)]  # of what begins at the goal there is none
    score, path = mean_interval(table["score"], *how), mean_interval(excess, *how)
    violations = counts["violation"], counts["baseline_violation"]
    summary = {
        name: share(np.count_nonzero(counted), np.count_nonzero(of), confidence)
        for name, (counted, of) in rates_of(table).items()
    }
    summary |= {
        "counts": {name: int(np.count_nonzero(mask)) for name, mask in counts.items()},
        "score_mean": number(score.value),
        "score_mean_interval": ends(score),
        **to_json(ratio(*violations, confidence=confidence, resamples=resamples, seed=seed)),
        "path_excess_mean": number(path.value),
        "path_excess_left_out": int(counts["success"].sum()) - excess.size,
        "path_excess_mean_interval": ends(path),
        "path_excess_quantiles": quantiles(excess, (0.5, 0.95, 1.0)),
        "min_separation_m_quantiles": quantiles(table["min_separation_m"], (0.0, 0.01, 0.05, 0.5)),
        "duration_mean_s": float(np.mean(table["duration_s"])),
        "heading_reversals_mean": float(np.mean(table["heading_reversals"])),
        "weighted": summarise_weighted(table, *how),
    }
    if "replans" in table:
        summary["replans_mean"] = float(np.mean(table["replans"]))
    if "areas" in table:
        summary |= _among_areas(table)
    if "climbs" in table:
        summary["climbs_mean"] = float(np.mean(table["climbs"]))
        summary[_DEVIATION] = quantiles(table["altitude_deviation_m"], (0.5, 0.95, 1.0))
    if "plan_status" in table:
        summary |= _safe_plans(table)
    return summary


def _safe_plans(table: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Return what became of the plans called SAFE, flown once."""
    safe = table["plan_status"] == "safe"
    once = table["plan_outcome" if "plan_outcome" in table else "outcome"]
    names = ("policy", "fallback", "vertical") if "climbs" in table else ("policy", "fallback")
    sources = {name: safe & (table["plan_source"] == name) for name in names}
    whole = table["whole_min_separation_m"][safe]
    counts = {
        "safe_plans_violated": int(np.count_nonzero(safe & (once == "violation"))),
        "safe_plans_broken": int(np.count_nonzero(table["plan_loss"] == "broken")),
        "safe_plans_not_promised": int(np.count_nonzero(table["plan_loss"] == "not_promised")),
        "safe_plans_by_source": {
            name: int(np.count_nonzero(mask)) for name, mask in sources.items()
        },
        "follower_error_m_quantiles": quantiles(table["follower_error_m"][safe], (0.5, 0.99, 1.0)),
        "whole_min_separation_m": number(float(np.min(whole))) if whole.size else None,
    }
    if "areas" in table:
        counts["safe_plans_in_areas"] = int(np.count_nonzero(safe & (once == "breach")))
    return counts


def _among_areas(table: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Return what areas add, of whatever decides."""
    met = table["min_area_clearance_m"]
    return {
        "areas_mean": float(np.mean(table["areas"])),
        _AREA: quantiles(met[np.isfinite(met)], (0.0, 0.01, 0.05, 0.5)),
    }


class Line(NamedTuple):
    """A line of the table; all in words."""

    key: str  # in summary.json
    label: str
    value: str
    interval: str
    counted: str


def headline(summary: Mapping[str, Any], unresolvable: Mapping[str, int]) -> list[Line]:
    """Return the lines for a summary (as in ``summary.json``); those that its mode does not have
    are left out.

    By a rate's key stands how many of those that it counts are proven unresolvable. Mode
    ``policy`` refuses more intruders than the policy was trained with, plans take them all: where
    it flies beside them, its rates say how many encounters have more.
    """
    lines = []
    for label, key in _RATES:
        rate = summary.get(key)
        if rate is not None:
            counted = f"{group_digits(rate['count'])} of {group_digits(rate['total'])}"
            if unresolvable.get(key):
                counted += f", {group_digits(unresolvable[key])} of them proven unresolvable"
            crowded = summary.get("outside_domain", {}).get("intruders")
            if key.startswith("policy_") and crowded:
                counted += f"; {group_digits(crowded)} encounters have more intruders than it knows"
            lines.append(_rate_line(key, label, rate, counted))
    weighted = summary["weighted"]
    for label, key in _RATES[:3] if weighted else ():
        counted = f"{weighted['effective_sample_size']:.0f} effective"
        name = f"{label}, by weight"
        lines.append(_rate_line(f"weighted.{key}", name, weighted[key], counted))
    for label, key, form in _MEANS:
        interval = form.interval(summary[f"{key}_interval"])
        without = summary.get(f"{key.removesuffix('_mean')}_left_out")
        remark = f"without {group_digits(without)} that begin at the goal" if without else ""
        lines.append(Line(key, label, form.text(summary[key]), interval, remark))
    for label, key, at, digits in _QUANTILES:
        if key in summary:
            value = _Form(digits, unit=" m").text(summary[key].get(at))
            lines.append(Line(key, label, value, "", ""))
    for label, key in _SAFE_PLANS:
        if key in summary:
            lines.append(Line(key, label, group_digits(summary[key]), "", ""))
    return lines


def _rate_line(key: str, label: str, rate: Mapping[str, Any], counted: str) -> Line:
    value, interval = _PERCENT.text(rate["value"]), _PERCENT.interval(rate)
    return Line(key, label, value, interval, counted)


def print_table(
    title: str,
    names: Sequence[str],
    rows: Sequence[Sequence[str]],
    notes: Sequence[str],
    width: int = 120,
) -> None:
    """Print a table, the first column to the left, and notes below it."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    for name in names:
        table.add_column(name, justify="right" if name else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)
    # A file or a pipe gets the whole table, not one cut to 80 columns.
    console = Console()
    console = console if console.is_terminal else Console(width=width)
    console.print(table)
    for note in notes:
        console.print(note, markup=False, highlight=False, soft_wrap=True)
