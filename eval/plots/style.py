"""Kinds of encounters in figures: what they are called, and colours and markers that tell them
apart.

Colours are those of Okabe and Ito, which stay apart for colour-blind readers; every kind has its
own marker too.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

BLUE = "#0072B2"
SKY = "#56B4E9"
GREEN = "#009E73"
ORANGE = "#E69F00"
VERMILION = "#D55E00"
PURPLE = "#CC79A7"
GREY = "#8C8C8C"
LOSS = "loss of separation"
BREACH = "geofence violation"
# In the order in which they are drawn: what matters comes last and lies on top.
MARKERS: dict[str, dict[str, Any]] = {
    "success": {"marker": "o", "color": "#8CBFE0", "s": 3.0, "linewidths": 0.0},
    "proven unresolvable": {
        "marker": "s",
        "facecolors": "none",
        "edgecolors": "#555555",
        "s": 14.0,
        "linewidths": 0.8,
    },
    "time-out": {"marker": "^", "color": ORANGE, "s": 20.0, "linewidths": 0.0},
    BREACH: {"marker": "D", "color": PURPLE, "s": 14.0, "linewidths": 0.0},
    LOSS: {"marker": "x", "color": VERMILION, "s": 20.0, "linewidths": 1.1},
}


def kinds_of(table: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return how each encounter is to be marked, a key of :data:`MARKERS`."""
    words = {
        "reached": "success",
        "violation": LOSS,
        "timeout": "time-out",
        "breach": BREACH,
    }
    kinds = np.array([words[outcome] for outcome in table["outcome"]], dtype=object)
    kinds[table["verdict"] == "unresolvable"] = "proven unresolvable"
    return kinds


def scenario_title(scenario: str) -> str:
    """Return a scenario's name as a title has room for: of a file its name without its folder."""
    kind, colon, path = scenario.partition(":")
    return f"{kind}:{PurePath(path).name}" if colon else scenario


def spread(values: np.ndarray, count: int) -> np.ndarray:
    """Return up to ``count`` of the values, evenly spaced."""
    count = min(count, len(values))
    return values[np.arange(count) * len(values) // max(count, 1)]


def tidy(axes: "Axes", grid: Literal["x", "y", "both"] = "y") -> None:
    """Draw a light grid behind the data, and no frame at the top and on the right."""
    axes.grid(axis=grid, color="#E5E5E5", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def sample(label: str, **style: Any) -> "Line2D":
    """Return a line or a mark for a legend."""
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, **style)


def legend(
    figure: "Figure", handles: Sequence["Artist"], ncols: int, fontsize: float = 9, **more: Any
) -> None:
    """Draw a legend below all panels."""
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=ncols,
        frameon=False,
        fontsize=fontsize,
        **more,
    )


def arrow(
    axes: "Axes",
    start: tuple[float, float],
    direction: float,
    way: float,
    name: str,
    **annotation: Any,
) -> None:
    """Draw an aircraft: a dot, an arrow along the way that it flies in some time, and its name.

    The start and the way's length are as the axes count, the direction is counter-clockwise from
    the axis of x, rad. Where the name stands is matplotlib's: ``xytext`` in points from the start,
    ``ha``, ``va``.
    """
    style = {
        "arrowstyle": "-|>",
        "linewidth": 2.0,
        "color": "black",
        "shrinkA": 0.0,
        "shrinkB": 0.0,
    }
    style |= {"path_effects": annotation.pop("path_effects", None)}
    end = (start[0] + way * math.cos(direction), start[1] + way * math.sin(direction))
    axes.annotate("", end, start, arrowprops=style, annotation_clip=False, zorder=6.0)
    axes.plot(
        *start, marker="o", markersize=5.0, color="black", markeredgecolor="white", zorder=6.5
    )
    box = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.85}
    axes.annotate(
        name, start, textcoords="offset points", fontsize=8, bbox=box, zorder=7.0, **annotation
    )
