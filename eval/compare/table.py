"""The result of a comparison for a person: a table, and the figure of how flights ended and what they cost."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from eval.compare.deciders import WITNESS
from eval.metrics.headline import print_table
from eval.plots.style import BLUE, GREY, ORANGE, SKY, VERMILION, tidy
from eval.stats.intervals import percent

__all__ = ["draw", "show"]

_RATES = ("success_rate", "success_given_resolvable", "violation_rate", "timeout_rate")


def show(summary: Mapping[str, Any], folder: Path) -> None:
    """Print a summary (as in ``summary.json``) and where the files of the run lie."""
    from eval.flights.aircraft import lines_about

    title = f"{summary['encounters']} encounters, scenario {summary['scenario']}, seed {summary['seed']}"
    witness = "path_excess_over_witness_mean" in summary["entries"][0]
    names = ["", "success", "resolvable *", "violation", "time-out", "risk ratio **", "path excess"]
    names += ["over witness", "difference", "p"] if witness else ["difference", "p"]
    rows = [
        (
            row["name"],
            *(percent(row[key]) for key in _RATES),
            _ratio(row["risk_ratio"]),
            _percent(row["path_excess_mean"]["value"]),
            *([_points(row["path_excess_over_witness_mean"])] if witness else []),
            *_difference(row["difference"]),
        )
        for row in summary["entries"]
    ]
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
    notes += lines_about(summary)
    # A warning of every entry is one of the sample: once is enough.
    notes += sorted(
        {f"{row['name']}: {warning}" for row in summary["entries"] for warning in row["risk_ratio"]["warnings"]}
    )
    notes.append(f"files: {folder}: compare.png, compare.svg, encounters.parquet, summary.json")
    print_table(title, names, rows, notes, 240)


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


def draw(summary: Mapping[str, Any]) -> Figure:
    """Return the figure of a summary (as in ``summary.json``): an entry a line, the first on top."""
    rows = summary["entries"]
    # A mark, not a resolver: the figure alone must say so.
    names = [f"{row['name']} (knows the future)" if row["kind"] == WITNESS else row["name"] for row in rows]
    colours = [GREY if row["kind"] == WITNESS else BLUE for row in rows]
    places = list(range(len(rows)))
    figure = Figure(figsize=(11.0, 1.7 + 0.42 * len(rows)), layout="constrained")
    ends, apart, cost = figure.subplots(1, 3, sharey=True, width_ratios=(1.5, 1.0, 0.8))
    left = [0.0] * len(rows)
    for key, label, colour in (
        ("success_rate", "success", SKY),
        ("timeout_rate", "time-out", ORANGE),
        ("violation_rate", "violation", VERMILION),
    ):
        share = [100.0 * row[key]["value"] for row in rows]
        ends.barh(places, share, left=left, color=colour, label=label, height=0.7)
        left = [a + b for a, b in zip(left, share, strict=True)]
    ends.set_yticks(places, names)
    ends.invert_yaxis()
    ends.set_xlim(0.0, 100.0)
    ends.set_xlabel("share of encounters, %")
    ends.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)

    zero = {"low": 0.0, "value": 0.0, "high": 0.0}
    for place, row, colour in zip(places, rows, colours, strict=True):
        for axes, interval in ((apart, row["difference"] or zero), (cost, row["path_excess_mean"])):
            if interval["value"] is not None:
                low, value, high = (100.0 * interval[key] for key in ("low", "value", "high"))
                axes.plot([low, high], [place, place], color=colour, linewidth=2.0)
                axes.plot([value], [place], "o", color=colour)
    apart.axvline(0.0, color="#999999", linewidth=0.8)
    apart.set_xlabel(f"success less that of {rows[0]['name']}, points")
    cost.set_xlim(left=0.0)
    cost.set_xlabel("mean path excess, %")
    for axes in (ends, apart, cost):
        tidy(axes, "x")
    title = f"{summary['encounters']} encounters, scenario {summary['scenario']}, seed {summary['seed']}"
    figure.suptitle(f"{title}; bars: {100.0 * summary['confidence']:g} % intervals", fontsize=11)
    return figure
