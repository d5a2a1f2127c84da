"""The result of a comparison as a table for a person."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from eval.stats.plain import percent

__all__ = ["show"]

_RATES = ("success_rate", "success_given_resolvable", "violation_rate", "timeout_rate")


def show(summary: Mapping[str, Any], folder: Path) -> None:
    """Print a summary (as in ``summary.json``) and where the files of the run lie."""
    from rich.console import Console
    from rich.table import Table

    from eval.flights.aircraft import lines_about

    table = Table(
        title=f"{summary['encounters']} encounters, scenario {summary['scenario']}, seed {summary['seed']}",
        title_justify="left",
    )
    table.add_column("", overflow="fold")
    witness = "path_excess_over_witness_mean" in summary["entries"][0]
    names = ["success", "resolvable *", "violation", "time-out", "risk ratio **", "path excess"]
    names += ["over witness", "difference", "p"] if witness else ["difference", "p"]
    for name in names:
        table.add_column(name, justify="right")
    for row in summary["entries"]:
        table.add_row(
            row["name"],
            *(percent(row[key]) for key in _RATES),
            _ratio(row["risk_ratio"]),
            _percent(row["path_excess_mean"]["value"]),
            *([_points(row["path_excess_over_witness_mean"])] if witness else []),
            *_difference(row["difference"]),
        )
    # A file or a pipe gets the whole table, not one cut to 80 columns.
    console = Console()
    console = console if console.is_terminal else Console(width=240)
    console.print(table)
    level = f"{100.0 * summary['confidence']:g} %"
    notes = [
        f"in brackets: {level} intervals (Clopper-Pearson, of differences Tango's, of ratios a bootstrap)",
        "* success of all that are not proven unresolvable",
        "** violations with the resolver / without it",
        "difference: of success from the first row's; p: McNemar's exact",
    ]
    if witness:
        notes += [
            "witness: the shortest flight known to resolve each encounter, found knowing the intruders' future: no "
            "resolver, but a mark; where none is known it flies on as none does",
            "over witness: path excess less the witness's, in points, where both succeed",
        ]
    if summary["weighted"]:
        notes.append("the ratios are weighted by the file's weights; rates count each encounter once")
    notes += [
        *lines_about(summary),
        f"{summary['late_at_first_speed']} of the routes are too long for their time without going faster",
    ]
    # A warning of every entry is one of the sample: once is enough.
    notes += sorted(
        {f"{row['name']}: {warning}" for row in summary["entries"] for warning in row["risk_ratio"]["warnings"]}
    )
    notes.append(f"files: {folder}: compare.png, compare.svg, encounters.parquet, summary.json")
    for note in notes:
        console.print(note, markup=False, highlight=False, soft_wrap=True)


def _ratio(ratio: Mapping[str, Any]) -> str:
    if ratio["value"] is None:
        return "-"
    return f"{ratio['value']:.4f} [{ratio['low']:.4f}, {ratio['high']:.4f}]"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100.0 * value:.2f} %"


def _points(mean: Mapping[str, Any] | None) -> str:
    return "-" if mean is None or mean["value"] is None else f"{100.0 * mean['value']:+.2f}"


def _difference(difference: Mapping[str, Any] | None) -> tuple[str, str]:
    if difference is None:
        return "-", "-"
    value, low, high = (100.0 * difference[key] for key in ("value", "low", "high"))
    return f"{value:+.2f} [{low:+.2f}, {high:+.2f}]", f"{difference['mcnemar_exact_p']:.2g}"
