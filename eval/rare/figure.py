"""The figure of an importance splitting: how probability falls from level to level, and how well it
was explored.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from eval.plots.style import BLUE, GREY, ORANGE, VERMILION, tidy


def levels_figure(found: Mapping[str, Any]) -> Figure:
    """Return the figure of ``rare.json``'s content."""
    levels = found["levels"]
    place = np.array([each["level_m"] for each in levels])
    figure = Figure(figsize=(8.8, 6.6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3.0, 1.0))
    every = np.array([each["rate"]["repetitions"] for each in levels])
    lines = above.plot(place, np.where(every > 0.0, every, np.nan), color="#B9D4E8", linewidth=0.9)
    lines[0].set_label("each repetition")
    total = levels[0]["plain"]["total"]
    square = {
        "color": GREY,
        "marker": "s",
        "markersize": 7.0,
        "markerfacecolor": "none",
        "linestyle": "",
    }
    plain, ours = (
        f"plain sampling ({total} flights, the first of all repetitions)",
        {"color": BLUE, "marker": "o"},
    )
    splitting = f"splitting, {100.0 * found['confidence']:g} % interval"
    for kind, label, style in (("plain", plain, square), ("rate", splitting, ours)):
        rates = np.array([[each[kind][end] for end in ("value", "low", "high")] for each in levels])
        value, low, high = rates[rates[:, 0] > 0.0].T
        ends = [value - np.maximum(low, 1e-3 * value), high - value]
        above.errorbar(place[rates[:, 0] > 0.0], value, ends, label=label, capsize=2.5, **style)
    above.axvline(
        found["separation_m"],
        color=VERMILION,
        linewidth=1.4,
        linestyle="--",
        label="required separation",
    )
    above.set(yscale="log", ylabel="probability of a smaller separation")
    if np.any(every > 0.0):  # an interval that reaches 0 goes to the edge
        above.set_ylim(0.3 * float(every[every > 0.0].min()), 1.5)
    above.legend(frameon=False, loc="lower right")

    share = [
        (each["level_m"], each["acceptance"]) for each in levels if each["acceptance"] is not None
    ]
    if share:
        where, taken = zip(*share, strict=True)
        below.plot(where, 100.0 * np.array(taken), color=ORANGE, marker="o", markersize=4.0)
    below.set(
        ylim=(0.0, 100.0), ylabel="steps taken, %", xlabel="level of the smallest separation, m"
    )
    for axes in (above, below):
        tidy(axes, "both")
    what = ", proven unresolvable ones left out" if found["resolvable_only"] else ""
    rate = found["rate"]
    figure.suptitle(
        f"scenario {found['scenario']}, mode {found['mode']}{what}\n"
        f"below {found['separation_m']:g} m: {rate['value']:.3g} ({rate['low']:.2g} .. "
        f"{rate['high']:.2g}), "
        f"{found['repetitions']} repetitions of {found['particles']} particles",
        fontsize=11,
    )
    return figure
