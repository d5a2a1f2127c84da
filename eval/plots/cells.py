"""Cells of the geometry of encounters: difference of the courses and ratio of the speeds."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COURSES = (0.0, 45.0, 90.0, 135.0, 180.0)
"""Edges of the cells: difference of the courses, degrees."""
RATIOS = (0.4, 0.7, 0.9, 1.1, 1.5, 2.6)
"""Edges of the cells: intruder's speed / own speed."""


def cells_figure(
    panels: Sequence[tuple[str, np.ndarray, Sequence[Sequence[str]] | np.ndarray]],
    courses: Sequence[str],
    ratios: Sequence[str],
    least: float,
    of: str,
) -> "Figure":
    """Return a figure of the cells, one panel below the other: of each a title, percentages in
    colour from ``least`` on, and texts, ``[courses, ratios]`` both; ``of`` names the colours.
    """
    from matplotlib.figure import Figure

    height = 0.6 + 0.45 * len(courses)
    figure = Figure((7.4, 0.6 + height * len(panels)), layout="constrained")
    column = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (title, values, texts) in zip(column, panels, strict=True):
        axes.imshow(values, vmin=least, vmax=100.0, cmap="cividis", aspect="auto")
        for (i, j), value in np.ndenumerate(values):
            color = "white" if value < least + 0.6 * (100.0 - least) else "black"
            axes.text(j, i, texts[i][j], ha="center", va="center", fontsize=8, color=color)
        axes.set_xticks(range(len(ratios)), ratios, fontsize=8)
        axes.set_yticks(range(len(courses)), courses, fontsize=8)
        axes.set_title(title, fontsize=10)
    figure.supylabel("courses differ by", fontsize=10)
    column[-1].set_xlabel("intruder's speed / own speed")
    figure.colorbar(column[0].images[0], ax=column, label=of)
    return figure
