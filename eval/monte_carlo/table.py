"""The result of an evaluation as a table for a person."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from eval.flights.aircraft import lines_about

__all__ = ["show"]

_RATES = (
    ("success of all", "success_rate"),
    ("success of the resolvable *", "success_given_resolvable"),
    ("success of what something solves ***", "success_given_solved"),
    ("violations", "violation_rate"),
    ("time-outs", "timeout_rate"),
    ("proven unresolvable", "unresolvable_rate"),
    ("undecided", "undecided_rate"),
    ("violations, no resolver", "baseline_violation_rate"),
    ("policy alone, of the resolvable *", "policy_success_given_resolvable"),
    ("plan flown once, of the resolvable *", "plan_success_given_resolvable"),
    ("plans called SAFE, of the resolvable *", "plan_safe_given_resolvable"),
)

_BY_WEIGHT = ("success of the resolvable, by weight *", "success_given_resolvable")


def show(summary: Mapping[str, Any], folder: Path, paths: Iterable[Path]) -> None:
    """Print a summary (as in ``summary.json``) and where the files of the run lie."""
    from rich.console import Console
    from rich.table import Table

    decider = summary["mode"] if summary["baseline"] == "none" else f"baseline {summary['baseline']}"
    title = f"{_n(summary['encounters'])} encounters, {decider}, scenario {summary['scenario']}, seed {summary['seed']}"
    table = Table(title=title, title_justify="left", caption_justify="left")
    table.add_column("")
    table.add_column("value", justify="right")
    table.add_column(f"{100.0 * summary['confidence']:g} % interval", justify="right")
    table.add_column("count", justify="right")
    for label, key in _RATES:
        rate = summary.get(key)
        if rate is None:
            continue
        low, high = f"{100.0 * rate['low']:.2f}", f"{100.0 * rate['high']:.2f} %"
        table.add_row(label, _percent(rate["value"]), f"{low} .. {high}", f"{_n(rate['count'])} of {_n(rate['total'])}")
    weighted = summary.get("weighted")
    if weighted is not None:
        for label, key in (("success of all, by weight", "success_rate"), _BY_WEIGHT):
            rate = weighted[key]
            ends = "-" if rate["low"] is None else f"{100.0 * rate['low']:.2f} .. {100.0 * rate['high']:.2f} %"
            table.add_row(label, _percent(rate["value"]), ends, f"{weighted['effective_sample_size']:.0f} effective")
    table.add_section()
    table.add_row("mean score", _plain(summary["score_mean"], "+.2f"), _ends(summary, "score_mean", "+.2f"))
    table.add_row("risk ratio **", _plain(summary["risk_ratio"], ".4f"), _ends(summary, "risk_ratio", ".4f"))
    table.add_row("mean path excess", _percent(summary["path_excess_mean"]), _ends(summary, "path_excess_mean", ".2%"))
    closest = summary["min_separation_m_quantiles"]
    table.add_row("smallest separation, m", _plain(closest["0"], ".0f"))
    table.add_row("its 1 % quantile, m", _plain(closest["0.01"], ".0f"))
    if "safe_plans_violated" in summary:
        table.add_row("SAFE plans violated as flown", _n(summary["safe_plans_violated"]))
        table.add_row("largest error of the follower, m", _plain(summary["follower_error_m_quantiles"]["1"], ".4f"))
    table.add_section()
    table.add_row("wall time, s", f"{summary['wall_s']:.1f}")
    if summary["encounters_per_s"] is not None:
        table.add_row("encounters / s", f"{summary['encounters_per_s']:.0f}")
    # A file or a pipe gets the whole table, not one cut to 80 columns.
    console = Console()
    console = console if console.is_terminal else Console(width=110)
    console.print(table)
    notes = [
        "* of all that are not proven unresolvable: the undecided count as resolvable",
        "** violations with the resolver / without it",
        "*** the policy, straight flight or the search; the success of all that can be resolved lies between * and ***",
    ]
    if _wide(summary):
        notes.append("the interval of the risk ratio is wide (half of it exceeds half the ratio): fly more encounters")
    if summary.get("draws") == "sobol":
        notes.append("intervals of rates: t over the randomisations of the Sobol points")
    notes += lines_about(summary)
    notes.append(f"files: {folder}: " + ", ".join(sorted(path.name for path in {*paths, *_tables(folder)})))
    for note in notes:
        console.print(note, markup=False, highlight=False, soft_wrap=True)


def _tables(folder: Path) -> list[Path]:
    return [folder / "encounters.parquet", folder / "config.yaml"]


def _wide(summary: Mapping[str, Any]) -> bool:
    ratio, ends = summary["risk_ratio"], summary["risk_ratio_interval"]
    return ratio is not None and ends["high"] - ends["low"] > ratio


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100.0 * value:.2f} %"


def _plain(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _ends(summary: Mapping[str, Any], key: str, form: str) -> str:
    ends = summary[f"{key}_interval"]
    if ends["low"] is None:
        return "-"
    low, high = format(ends["low"], form), format(ends["high"], form)
    return f"{low.removesuffix('%')} .. {high.replace('%', ' %')}"


def _n(value: int) -> str:
    return f"{value:,}".replace(",", " ")
