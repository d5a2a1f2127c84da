"""From the table of a comparison to its numbers, a table for a person, and a figure.

docs/howto/compare.md defines every key.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from eval.compare.deciders import REFERENCE, WITNESS, Entry
from eval.flights.aircraft import lines_about
from eval.metrics.summary import print_table
from eval.metrics.volumes import VOLUMES
from eval.metrics.weighted import ratio
from eval.plots.style import BLUE, GREY, ORANGE, SKY, VERMILION, tidy
from eval.stats.intervals import interval, mean_interval, number, percent, share
from eval.stats.paired import mcnemar_exact, pairs, tango

__all__ = ["SCHEMA_VERSION", "draw", "show", "summarise"]

SCHEMA_VERSION = 1
_RATES = ("success_rate", "success_given_resolvable", "violation_rate", "timeout_rate")


def summarise(
    table: Mapping[str, np.ndarray],
    entries: Sequence[Entry],
    weights: np.ndarray | None,
    confidence: float,
    resamples: int,
    seed: int,
) -> dict[str, Any]:
    """Return the statistics of a comparison in JSON types; what cannot be said is None.

    The table is that of :func:`eval.compare.deciders.columns`, N >= 1; the first entry is the one that the others are
    compared with; weights ``[N]`` are for the ratios, None for equal ones.
    """
    total = len(table["encounter"])
    possible = total - int(np.count_nonzero(table["unresolvable"]))
    how = (confidence, resamples, seed)
    rows = []
    witness = next((entry for entry in entries if entry.kind == WITNESS), None)
    for entry in entries:
        row = _row(table, entry, possible, how) | _ratios(table, entry, weights, how)
        row["difference"] = None if entry is entries[0] else _difference(table, entry, entries[0], how)
        if witness is not None:
            row["path_excess_over_witness_mean"] = None if entry is witness else _longer(table, entry, witness, how)
        rows.append(row)
    return {
        "encounters": total,
        "resolvable_rate": share(possible, total, confidence),
        "volumes": {name: volume._asdict() for name, volume in VOLUMES.items()},
        "altitude": "co-altitude is assumed: every loss is given that the altitudes do not separate",
        "entries": rows,
    }


def _row(table: Mapping[str, np.ndarray], entry: Entry, possible: int, how: tuple[float, int, int]) -> dict[str, Any]:

    def of(name: str) -> np.ndarray:
        return table[f"{entry.name}.{name}"]

    def rate(name: str, total: int = len(table["encounter"])) -> dict[str, Any]:
        return share(np.count_nonzero(of("outcome") == name), total, how[0])

    def mean(name: str) -> dict[str, float | None]:
        return interval(mean_interval(of(name)[of("outcome") == "reached"], *how))

    severe = of("severity")[of("severity") > 0.0]
    return {
        "name": entry.name,
        "kind": entry.kind,
        "sha256": entry.sha256,
        "success_rate": rate("reached"),
        "success_given_resolvable": rate("reached", possible),
        "violation_rate": rate("violation"),
        "timeout_rate": rate("timeout"),
        "path_excess_mean": mean("path_excess"),
        "time_excess_mean_s": mean("time_excess_s"),
        "cross_track_max_mean_m": mean("cross_track_m"),
        "heading_reversals_mean": float(np.mean(of("heading_reversals"))),
        "min_separation_m": number(float(np.fmin.reduce(of("min_separation_m")))),
        "severity_mean_of_losses": float(np.mean(severe)) if severe.size else None,
        "severity_max": float(np.max(of("severity"))),
    }


def _ratios(
    table: Mapping[str, np.ndarray], entry: Entry, weights: np.ndarray | None, how: tuple[float, int, int]
) -> dict[str, Any]:

    def of(column: str, event: Any = True) -> dict[str, Any]:
        ours, bare = (table[f"{name}.{column}"] == event for name in (entry.name, REFERENCE))
        found = ratio(ours, bare, weights, confidence=how[0], resamples=how[1], seed=how[2])
        said = asdict(found) | {"warnings": list(found.warnings)}
        return {key: number(value) if isinstance(value, float) else value for key, value in said.items()}

    return {"risk_ratio": of("outcome", "violation"), "ratios": {name: of(f"lost_{name}") for name in VOLUMES}}


def _difference(
    table: Mapping[str, np.ndarray], entry: Entry, first: Entry, how: tuple[float, int, int]
) -> dict[str, Any]:
    """Return the entry's success rate less the first's, and its path excess where both succeed."""
    ours, theirs = (table[f"{name}.outcome"] == "reached" for name in (entry.name, first.name))
    counts = pairs(theirs, ours)
    return {
        **tango(counts, how[0])._asdict(),
        "mcnemar_exact_p": mcnemar_exact(counts),
        "pairs": counts._asdict(),
        "path_excess_mean": _longer(table, entry, first, how),
    }


def _longer(
    table: Mapping[str, np.ndarray], entry: Entry, other: Entry, how: tuple[float, int, int]
) -> dict[str, float | None]:
    """Return the entry's mean path excess less the other's, where both succeed, with its interval."""
    both = np.logical_and(*(table[f"{name}.outcome"] == "reached" for name in (entry.name, other.name)))
    excess = table[f"{entry.name}.path_excess"] - table[f"{other.name}.path_excess"]
    return interval(mean_interval(excess[both], *how))


def show(summary: Mapping[str, Any], folder: Path) -> None:
    """Print a summary (as in ``summary.json``) and where the files of the run lie."""
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
            *_shown_difference(row["difference"]),
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


def _shown_difference(difference: Mapping[str, Any] | None) -> tuple[str, str]:
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
        for axes, found in ((apart, row["difference"] or zero), (cost, row["path_excess_mean"])):
            if found["value"] is not None:
                low, value, high = (100.0 * found[key] for key in ("low", "value", "high"))
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
