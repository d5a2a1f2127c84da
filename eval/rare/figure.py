"""The figure of an importance splitting: how probability falls from level to level, and how well it
was explored.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eval.plots.style import BLUE, GREY, ORANGE, VERMILION, legend, tidy

_PLAIN: dict[str, Any] = {
    "color": GREY,
    "marker": "s",
    "markersize": 7.0,
    "markerfacecolor": "none",
    "linestyle": "",
}
_SPLITTING: dict[str, Any] = {"color": BLUE, "marker": "o"}


def levels_figure(estimate: Mapping[str, Any]) -> Figure:
    """Return the figure of ``rare.json``'s content."""
    figure = Figure(figsize=(8.8, 6.6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3.0, 1.0))
    _draw_probabilities(above, estimate)
    _draw_acceptance(below, estimate["levels"])
    for axes in (above, below):
        tidy(axes, "both")
    figure.suptitle(_title(estimate), fontsize=11)
    # Below, where it covers nothing, however the probability falls.
    legend(figure, above.get_legend_handles_labels()[0], 2)
    return figure


def _draw_probabilities(axes: Axes, estimate: Mapping[str, Any]) -> None:
    """Draw the probability of a smaller separation than each level, by splitting and by plain
    sampling.
    """
    levels = estimate["levels"]
    place = np.array([level["level_m"] for level in levels])
    every = np.array([level["rate"]["repetitions"] for level in levels])
    lines = axes.plot(place, np.where(every > 0.0, every, np.nan), color="#B9D4E8", linewidth=0.9)
    lines[0].set_label("each repetition")
    total = levels[0]["plain"]["total"]
    plain = f"plain sampling ({total} flights, the first of all repetitions)"
    _draw_rates(axes, place, [level["plain"] for level in levels], plain, _PLAIN)
    splitting = f"splitting, {100.0 * estimate['confidence']:g} % interval"
    _draw_rates(axes, place, [level["rate"] for level in levels], splitting, _SPLITTING)
    axes.axvline(
        estimate["separation_m"],
        color=VERMILION,
        linewidth=1.4,
        linestyle="--",
        label="required separation",
    )
    axes.set(yscale="log", ylabel="probability of a smaller separation")
    if np.any(every > 0.0):  # an interval that reaches 0 goes to the edge
        axes.set_ylim(0.3 * float(every[every > 0.0].min()), 1.5)


def _draw_rates(
    axes: Axes,
    place: np.ndarray,
    rates: Sequence[Mapping[str, float]],
    label: str,
    style: Mapping[str, Any],
) -> None:
    """Draw those rates that are above 0 with their intervals, at levels ``[L]``, m."""
    ends = np.array([[rate[end] for end in ("value", "low", "high")] for rate in rates])
    positive = ends[:, 0] > 0.0
    value, low, high = ends[positive].T
    # A lower end of 0 would lie infinitely far below.
    bars = [value - np.maximum(low, 1e-3 * value), high - value]
    axes.errorbar(place[positive], value, bars, label=label, capsize=2.5, **style)


def _draw_acceptance(axes: Axes, levels: Sequence[Mapping[str, Any]]) -> None:
    """Draw the share of the steps that are taken below each level."""
    accepted = [level for level in levels if level["acceptance"] is not None]
    if accepted:
        place = [level["level_m"] for level in accepted]
        percent = 100.0 * np.array([level["acceptance"] for level in accepted])
        axes.plot(place, percent, color=ORANGE, marker="o", markersize=4.0)
    below = "level of the smallest separation, m"
    axes.set(ylim=(0.0, 100.0), ylabel="steps taken, %", xlabel=below)


def _title(estimate: Mapping[str, Any]) -> str:
    condition = ", proven unresolvable ones left out" if estimate["resolvable_only"] else ""
    rate = estimate["rate"]
    return (
        f"scenario {estimate['scenario']}, mode {estimate['mode']}{condition}\n"
        f"below {estimate['separation_m']:g} m: {rate['value']:.3g} ({rate['low']:.2g} .. "
        f"{rate['high']:.2g}), "
        f"{estimate['repetitions']} repetitions of {estimate['particles']} particles"
    )
