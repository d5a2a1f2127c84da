"""The figure of a comparison: how flights ended, and what the successful ones cost."""

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from eval.compare.deciders import WITNESS
from eval.plots.style import BLUE, GREY, ORANGE, SKY, VERMILION, tidy

__all__ = ["draw"]


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
