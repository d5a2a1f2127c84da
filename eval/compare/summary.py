"""From the table of a comparison to its numbers (docs/reference/evaluation-files.md), a table for
a person, and a figure.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from envs.aircraft import Aircraft
from envs.kinematics import Limits
from eval.compare.resolvers import REFERENCE, WITNESS, Entry, limits_of
from eval.flights.aircraft import format_limits
from eval.metrics.standards import Sample, standards
from eval.metrics.summary import print_table
from eval.metrics.volumes import VOLUMES
from eval.metrics.weighted import ratio
from eval.plots.style import BLUE, GREY, LOSS, ORANGE, SKY, VERMILION, scenario_title, tidy
from eval.stats.intervals import interval, mean_interval, number, percent, share
from eval.stats.paired import mcnemar_exact, pairs, tango

SCHEMA_VERSION = 2
_RATES = ("success_rate", "success_given_resolvable", "violation_rate", "timeout_rate")


_IN_SPACE = "flown: a volume is lost where both of its parts are, at the same time"
_IN_PLANE = "co-altitude is assumed: every loss is given that the altitudes do not separate"


class Statistics(NamedTuple):
    """The table of :func:`eval.compare.resolvers.columns`, N >= 1, and how its intervals are
    made.
    """

    table: Mapping[str, np.ndarray]
    weights: np.ndarray | None  # of the ratios, [N]; None for equal ones
    confidence: float
    resamples: int
    seed: int
    aircraft: Aircraft
    well_clear: str | None = None  # name of the volume of the figures of standards; None: none
    in_space: bool = False  # whether the encounters have altitudes
    stratified: bool = False  # whether they are drawn by strata of the closest approach

    def summary(self, entries: Sequence[Entry]) -> dict[str, Any]:
        """Return the statistics in JSON types; what cannot be said is None. The others are compared
        with the first.
        """
        first, total = entries[0], len(self.table["encounter"])
        witness = next((entry for entry in entries if entry.kind == WITNESS), None)
        rows = []
        for entry in entries:
            row = self._row(entry)
            row["difference"] = None if entry is first else self._difference(entry, first)
            if witness is not None:
                row["path_excess_over_witness_mean"] = (
                    None if entry is witness else self._longer(entry, witness)
                )
            rows.append(row)
        return {
            "encounters": total,
            "volumes": {name: volume._asdict() for name, volume in VOLUMES.items()},
            "altitude": _IN_SPACE if self.in_space else _IN_PLANE,
            "entries": rows,
            "well_clear": self.well_clear,
            "standards": self._standards(entries),
        }

    def _standards(self, entries: Sequence[Entry]) -> list[dict[str, Any]]:
        """Return the figures in the units of standards, by entry; none where none are asked for."""
        if self.well_clear is None:
            return []
        how = (self.weights, self.confidence, self.resamples, self.seed, self._strata())
        sample = Sample(self.well_clear, *how)
        columns = {entry.name: self._columns(entry.name) for entry in entries}
        bare = columns[REFERENCE]
        return [{"name": name, **standards(own, bare, sample)} for name, own in columns.items()]

    def _strata(self) -> np.ndarray | None:
        """Return how many of NMAC and well clear are lost without a resolver, ``[N]``; None where
        encounters are not drawn by strata.
        """
        if not self.stratified:
            return None
        names = ["nmac", *([] if self.well_clear is None else [self.well_clear])]
        return np.sum([self.table[f"{REFERENCE}.lost_{name}"] for name in names], axis=0)

    def _columns(self, name: str) -> dict[str, np.ndarray]:
        """Return the columns of an entry by their own names."""
        head = f"{name}."
        return {
            column.removeprefix(head): values
            for column, values in self.table.items()
            if column.startswith(head)
        }

    def _of(self, entry: Entry, column: str) -> np.ndarray:
        return self.table[f"{entry.name}.{column}"]

    def _success(self, entry: Entry) -> np.ndarray:
        return self._of(entry, "outcome") == "reached"

    def _row(self, entry: Entry) -> dict[str, Any]:
        severity, total = self._of(entry, "severity"), len(self.table["encounter"])
        possible = total - int(np.count_nonzero(self._of(entry, "unresolvable")))
        severe, reached = severity[severity > 0.0], self._success(entry)
        counts = {
            name: np.count_nonzero(self._of(entry, "outcome") == name)
            for name in ("violation", "timeout")
        }
        means = {"path_excess_mean": "path_excess", "time_excess_mean_s": "time_excess_s"}
        means |= {"cross_track_max_mean_m": "cross_track_m"}
        return {
            **{key: getattr(entry, key) for key in ("name", "kind", "sha256")},
            "limits": limits_of(entry.resolver, self.aircraft)._asdict(),
            "resolvable_rate": share(possible, total, self.confidence),
            "success_rate": share(np.count_nonzero(reached), total, self.confidence),
            "success_given_resolvable": share(np.count_nonzero(reached), possible, self.confidence),
            **{
                f"{name}_rate": share(count, total, self.confidence)
                for name, count in counts.items()
            },
            **{
                key: self._mean(_known(self._of(entry, name)[reached]))
                for key, name in means.items()
            },
            "heading_reversals_mean": float(np.mean(self._of(entry, "heading_reversals"))),
            "min_separation_m": number(float(np.fmin.reduce(self._of(entry, "min_separation_m")))),
            "severity_mean_of_losses": float(np.mean(severe)) if severe.size else None,
            "severity_max": float(np.max(severity)),
            "risk_ratio": self._ratio(entry, "outcome", "violation"),
            "ratios": {name: self._ratio(entry, f"lost_{name}") for name in VOLUMES},
        }

    def _mean(self, values: np.ndarray) -> dict[str, float | None]:
        return interval(mean_interval(values, self.confidence, self.resamples, self.seed))

    def _ratio(self, entry: Entry, column: str, event: Any = True) -> dict[str, Any]:
        ours, bare = self._of(entry, column) == event, self.table[f"{REFERENCE}.{column}"] == event
        how = {"confidence": self.confidence, "resamples": self.resamples, "seed": self.seed}
        how |= {"strata": self._strata()}
        figures = asdict(ratio(ours, bare, self.weights, **how))
        if entry.name == REFERENCE:  # without a resolver, by definition
            figures |= {"low": figures["value"], "high": figures["value"]}
        return {
            key: number(value) if isinstance(value, float) else value
            for key, value in figures.items()
        }

    def _difference(self, entry: Entry, first: Entry) -> dict[str, Any]:
        """Return the entry's success rate less the first's, and its path excess where both
        succeed.
        """
        counts = pairs(self._success(first), self._success(entry))
        return {
            **tango(counts, self.confidence)._asdict(),
            "mcnemar_exact_p": mcnemar_exact(counts),
            "pairs": counts._asdict(),
            "path_excess_mean": self._longer(entry, first),
        }

    def _longer(self, entry: Entry, other: Entry) -> dict[str, float | None]:
        """Return the entry's mean path excess less the other's, where both succeed, with its
        interval.
        """
        excess = self._of(entry, "path_excess") - self._of(other, "path_excess")
        return self._mean(_known(excess[self._success(entry) & self._success(other)]))


def _known(values: np.ndarray) -> np.ndarray:
    """Return the values that there are: an encounter that begins at the goal has no path excess."""
    return values[~np.isnan(values)]


def show(summary: Mapping[str, Any]) -> None:
    """Print a summary (as in ``summary.json``)."""
    title = (
        f"{summary['encounters']} encounters, scenario {summary['scenario']}, seed "
        f"{summary['seed']}"
    )
    witness = "path_excess_over_witness_mean" in summary["entries"][0]
    names = [
        "",
        "limits",
        "success",
        "resolved *",
        "loss of separation",
        "time-out",
        "risk ratio **",
        "extra track distance",
    ]
    names += ["over witness", "difference", "p"] if witness else ["difference", "p"]
    rows = [_cells(row, witness=witness) for row in summary["entries"]]
    print_table(title, names, rows, _notes(summary, witness=witness), 280)


def _cells(row: Mapping[str, Any], *, witness: bool) -> list[str]:
    """Return the cells of an entry; ``witness``: one takes part."""
    limits = format_limits(Limits(**row["limits"]))
    cells = [row["name"], limits, *(percent(row[key]) for key in _RATES)]
    cells.append(_format_rate(row["risk_ratio"], "{:.4f} [{:.4f}, {:.4f}]", 1.0))
    cells.append(_format_rate(row["path_excess_mean"], "{:.2f} %"))
    if witness:
        cells.append(_format_rate(row["path_excess_over_witness_mean"], "{:+.2f}"))
    cells.append(_format_rate(row["difference"], "{:+.2f} [{:+.2f}, {:+.2f}]"))
    p = row["difference"] and row["difference"]["mcnemar_exact_p"]
    return [*cells, "-" if p is None else f"{p:.2g}"]


def _notes(summary: Mapping[str, Any], *, witness: bool) -> list[str]:
    """Return what stands below the table."""
    level = f"{100.0 * summary['confidence']:g} %"
    notes = [
        f"in brackets: {level} intervals (Clopper-Pearson, of differences Tango's, of ratios a "
        "bootstrap)",
        "* success of all that are not proven unresolvable within the row's own limits",
        "** losses of separation with the resolver / without it",
        "difference: of success from the first row's; p: McNemar's exact",
    ]
    if witness:
        notes += [
            "witness: the shortest flight known to resolve each encounter, found knowing the "
            "intruders' future: no resolver, but a mark; where none is known it flies on as none "
            "does",
            "over witness: extra track distance less the witness's, in points, where both succeed",
        ]
    if summary["weighted"]:
        notes.append(
            "the ratios are weighted by the file's weights; rates count each encounter once"
        )
    warnings = ((row["name"], row["risk_ratio"]["warnings"]) for row in summary["entries"])
    return notes + sorted(f"{name}: {text}" for name, texts in warnings for text in texts)


def _format_rate(rate: Mapping[str, Any] | None, form: str, unit: float = 100.0) -> str:
    if rate is None or rate["value"] is None:
        return "-"
    return form.format(*(unit * rate[key] for key in ("value", "low", "high")))


def draw(summary: Mapping[str, Any]) -> Figure:
    """Return the figure of a summary (as in ``summary.json``): an entry a line, the first
    on top.
    """
    rows = summary["entries"]
    figure = Figure(figsize=(11.0, 1.7 + 0.42 * len(rows)), layout="constrained")
    ends, apart, cost = figure.subplots(1, 3, sharey=True, width_ratios=(1.5, 1.0, 0.8))
    _draw_outcomes(ends, rows)
    first = {"low": 0.0, "value": 0.0, "high": 0.0}  # does not differ from itself
    _draw_intervals(apart, rows, [row["difference"] or first for row in rows])
    apart.axvline(0.0, color="#999999", linewidth=0.8)
    apart.set_xlabel(f"success less that of\n{rows[0]['name']}, points")
    _draw_intervals(cost, rows, [row["path_excess_mean"] for row in rows])
    cost.set_xlabel("mean extra track\ndistance, %")
    # Room for the whole mark of one that is 0.
    cost.set_xlim(-0.04 * max(cost.get_xlim()[1], 1.0), None)
    for axes in (ends, apart, cost):
        tidy(axes, "x")
    title = (
        f"{summary['encounters']} encounters, scenario {scenario_title(summary['scenario'])}, "
        f"seed {summary['seed']}"
    )
    figure.suptitle(f"{title}; lines: {100.0 * summary['confidence']:g} % intervals", fontsize=11)
    return figure


def _draw_outcomes(axes: Axes, rows: Sequence[Mapping[str, Any]]) -> None:
    """Draw how the flights of each entry ended, a bar an entry, with their names."""
    places, left = range(len(rows)), np.zeros(len(rows))
    for key, label, colour in (
        ("success", "success", SKY),
        ("timeout", "time-out", ORANGE),
        ("violation", LOSS, VERMILION),
    ):
        part = 100.0 * np.array([row[f"{key}_rate"]["value"] for row in rows])
        axes.barh(places, part, left=left, color=colour, label=label, height=0.7)
        left += part
    # A mark, not a resolver: the figure alone must say so.
    names = [
        f"{row['name']} (knows the future)" if row["kind"] == WITNESS else row["name"]
        for row in rows
    ]
    axes.set_yticks(places, names)
    axes.invert_yaxis()
    axes.set(xlim=(0.0, 100.0), xlabel="share of encounters, %")
    axes.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)


def _draw_intervals(
    axes: Axes, rows: Sequence[Mapping[str, Any]], intervals: Sequence[Mapping[str, Any]]
) -> None:
    """Draw the interval of each entry that has one, in percent."""
    for place, (row, bounds) in enumerate(zip(rows, intervals, strict=True)):
        if bounds["value"] is not None:
            colour = GREY if row["kind"] == WITNESS else BLUE
            low, value, high = (100.0 * bounds[key] for key in ("low", "value", "high"))
            axes.plot([low, high], [place, place], color=colour, linewidth=2.0)
            axes.plot([value], [place], "o", color=colour)
