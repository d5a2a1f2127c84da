"""A sheet of flights that failed, each beside a flight that would have succeeded."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from envs.outcome import Rules
from eval.plots.flight_sheet import draw_tracks, marks
from eval.plots.style import BLUE, SKY, VERMILION
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
        draw_tracks(axes, (flight.own, flight.intruders), flight.separation, flight.goal, rules)
        if flight.witness is not None:
            axes.plot(
                flight.witness.x * _KM, flight.witness.y * _KM, color=SKY, linewidth=1.2, linestyle="-.", zorder=1.5
            )
        axes.set_title(title, fontsize=8)
        if i % columns == 0:
            axes.set_ylabel("north, km", fontsize=8)
        if i + columns >= len(flights):
            axes.set_xlabel("east, km", fontsize=8)
    legend = _legend(rules)
    beside = len(legend) if columns == _MOST else _FEWEST
    figure.legend(handles=legend, loc="outside lower center", ncols=beside, frameon=False, fontsize=9)
    return figure


def _legend(rules: Rules) -> list[Line2D]:
    line = Line2D
    return [
        line([], [], color=BLUE, marker="o", markersize=5, label="ownship, dots every minute"),
        line([], [], color=VERMILION, linestyle="--", marker="s", markersize=4.5, label="intruder"),
        line([], [], color=SKY, linestyle="-.", label="a flight that succeeds"),
        *marks(rules),
    ]
