"""The picture: our bands of a scenario over time, and the program's edges on them."""

from typing import Any

import numpy as np

from agents.assurance.alerts import Alerting, Region, levels
from benchmarks.daidalus.edges import their_edges
from benchmarks.daidalus.sides import Sides
from envs.aircraft import PAPER
from eval.plots.style import tidy

COLOURS = {
    Region.FREE: "#FFFFFF",
    Region.PREVENTIVE: "#F6E3B4",
    Region.CORRECTIVE: "#F2B04C",
    Region.WARNING: "#D55E00",
}


def drawing(sides: Sides, name: str) -> Any:
    """Return the figure of one scenario."""
    import matplotlib.pyplot as plt
    from matplotlib.colors import ListedColormap
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    colours = ListedColormap(list(COLOURS.values()))
    times = Alerting.for_aircraft(PAPER).reached
    figure, axes = plt.subplots(2, 1, figsize=(7.2, 6.4), sharex=True, layout="constrained")
    seconds = sides.flight.time
    for axis, bands, circle in zip(
        axes, (sides.ours.headings, sides.ours.speeds), (True, False), strict=True
    ):
        values = (90.0 - np.degrees(bands.target[0])) % 360.0 if circle else bands.target[0]
        order = np.argsort(values)
        axis.pcolormesh(
            seconds,
            values[order],
            levels(bands.loss, times)[:, order].T,
            cmap=colours,
            vmin=-0.5,
            vmax=3.5,
            shading="nearest",
            rasterized=True,
        )
        points = [
            (now, edge.place)
            for now, second in zip(seconds, sides.seconds, strict=True)
            if second is not None
            for edge in their_edges(second.headings if circle else second.speeds, circle=circle)
        ]
        axis.plot(*np.reshape(points, (-1, 2)).T, "k.", markersize=2.0)
        tidy(axis)
    axes[0].set(ylabel="heading, deg", ylim=(0.0, 360.0), yticks=range(0, 361, 90), title=name)
    axes[1].set(ylabel="speed, m/s", xlabel="time, s")
    handles: list[Patch | Line2D] = [
        Patch(facecolor=colour, edgecolor="#8C8C8C", label=region.name.lower())
        for region, colour in COLOURS.items()
    ]
    handles.append(Line2D([], [], color="k", marker=".", linestyle="", label="edges by DAIDALUS"))
    figure.legend(handles=handles, loc="outside lower center", ncols=5, frameon=False)
    return figure
