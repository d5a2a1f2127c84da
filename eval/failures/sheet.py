"""A sheet of flights that failed, each beside a flight that would have succeeded."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from envs.outcome import Rules
from eval.plots.flight_sheet import marks
from eval.plots.style import BLUE, GREEN, GREY, SKY, VERMILION
from eval.report.flights import Replayed

__all__ = ["sheet"]

_FEWEST, _MOST = 3, 6  # columns; with fewer the legend has no room
_WIDTH = 16.0 / 6  # inches, of a column
_KM = 1e-3


def sheet(flights: Sequence[Replayed], titles: Sequence[str], rules: Rules) -> Figure:
    """Return the sheet.

    Args:
        flights: at least one.
        titles: of each.
        rules: of the task.
    """
    columns = int(np.clip(len(flights), _FEWEST, _MOST))
    lines = -(-len(flights) // columns)
    figure = Figure(figsize=(_WIDTH * columns, 3.1 * lines + 0.7), layout="constrained")
    for i, (flight, title) in enumerate(zip(flights, titles, strict=True)):
        axes = figure.add_subplot(lines, columns, i + 1)
        _draw(axes, flight, rules)
        axes.set_title(title, fontsize=8)
        if i % columns == 0:
            axes.set_ylabel("north, km", fontsize=8)
        if i + columns >= len(flights):
            axes.set_xlabel("east, km", fontsize=8)
    legend = _legend(rules)
    beside = len(legend) if columns == _MOST else _FEWEST
    figure.legend(handles=legend, loc="outside lower center", ncols=beside, frameon=False, fontsize=9)
    return figure


def _draw(axes: Axes, flight: Replayed, rules: Rules) -> None:
    own, goal = flight.own * _KM, (flight.goal[0] * _KM, flight.goal[1] * _KM)
    axes.plot([own[0, 0], goal[0]], [own[1, 0], goal[1]], color=GREY, linewidth=0.8, linestyle=":")
    axes.add_patch(Circle(goal, rules.goal_radius * _KM, color=GREEN, alpha=0.35, linewidth=0))
    if flight.witness is not None:
        axes.plot(flight.witness.x * _KM, flight.witness.y * _KM, color=SKY, linewidth=1.2, linestyle="-.")
    axes.plot(*own, color=BLUE, linewidth=1.4)
    axes.plot(*own[:, ::60], ".", color=BLUE, markersize=4)
    axes.plot(*own[:, 0], "o", color=BLUE, markersize=4.5)
    step = int(np.argmin(flight.separation)) + 1
    for track in flight.intruders * _KM:
        axes.plot(*track, color=VERMILION, linewidth=1.1, linestyle="--")
        axes.plot(*track[:, ::60], ".", color=VERMILION, markersize=4)
        axes.plot(*track[:, 0], "s", color=VERMILION, markersize=4)
        ring = Circle(track[:, step], rules.separation * _KM, fill=False, edgecolor=VERMILION, linewidth=0.8)
        axes.add_patch(ring)
    axes.plot(*own[:, step], "D", color="black", markersize=3.5, markerfacecolor="white", zorder=5)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.06)
    axes.tick_params(labelsize=7)
    axes.grid(color="#EBEBEB", linewidth=0.5)
    axes.set_axisbelow(True)


def _legend(rules: Rules) -> list[Line2D]:
    line = Line2D
    return [
        line([], [], color=BLUE, marker="o", markersize=5, label="ownship, dots every minute"),
        line([], [], color=VERMILION, linestyle="--", marker="s", markersize=4.5, label="intruder"),
        line([], [], color=SKY, linestyle="-.", label="a flight that succeeds"),
        *marks(rules),
    ]
