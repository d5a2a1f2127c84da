"""The picture: our bands of a scenario over time, and the program's edges on them."""

from typing import TYPE_CHECKING

import numpy as np

from agents.assurance.alerts import Alerting, Region, levels
from agents.assurance.bands import Bands
from benchmarks.daidalus.edges import their_edges
from benchmarks.daidalus.program import track_of
from benchmarks.daidalus.sides import Sides
from envs.aircraft import PAPER
from eval.plots.style import tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = {
    Region.FREE: "#FFFFFF",
    Region.PREVENTIVE: "#F6E3B4",
    Region.CORRECTIVE: "#F2B04C",
    Region.WARNING: "#D55E00",
}


def drawing(sides: Sides, name: str) -> "Figure":
    """Return the figure of one scenario."""
    import matplotlib.pyplot as plt
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    figure, axes = plt.subplots(2, 1, figsize=(7.2, 6.4), sharex=True, layout="constrained")
    for axis, bands, circle in zip(
        axes, (sides.ours.headings, sides.ours.speeds), (True, False), strict=True
    ):
        _draw_bands(axis, sides, bands, circle=circle)
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


def _draw_bands(axes: "Axes", sides: Sides, bands: Bands, *, circle: bool) -> None:
    """Draw our bands over time, and the program's edges; ``circle``: of headings."""
    from matplotlib.colors import ListedColormap

    values = track_of(bands.target[0]) if circle else bands.target[0]
    order = np.argsort(values)
    times = Alerting.for_aircraft(PAPER).reached
    axes.pcolormesh(
        sides.flight.time,
        values[order],
        levels(bands.loss, times)[:, order].T,
        cmap=ListedColormap(list(COLOURS.values())),
        vmin=-0.5,
        vmax=3.5,
        shading="nearest",
        rasterized=True,
    )
    points = [
        (time, edge.place)
        for time, second in zip(sides.flight.time, sides.seconds, strict=True)
        if second is not None
        for edge in their_edges(second.headings if circle else second.speeds, circle=circle)
    ]
    axes.plot(*np.reshape(points, (-1, 2)).T, "k.", markersize=2.0)
