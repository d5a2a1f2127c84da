"""Kinds of encounters in figures: what they are called, and colours and markers that tell them apart.

Colours are those of Okabe and Ito, which stay apart for colour-blind readers; every kind has its own marker too.
"""

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

__all__ = ["BLUE", "GREEN", "GREY", "MARKERS", "ORANGE", "SKY", "VERMILION", "kinds_of", "tidy"]

BLUE, SKY, GREEN, ORANGE, VERMILION, GREY = "#0072B2", "#56B4E9", "#009E73", "#E69F00", "#D55E00", "#8C8C8C"
# In the order in which they are drawn: what matters comes last and lies on top.
MARKERS: dict[str, dict[str, Any]] = {
    "success": {"marker": "o", "color": "#8CBFE0", "s": 3.0, "linewidths": 0.0},
    "proven unresolvable": {"marker": "s", "facecolors": "none", "edgecolors": "#555555", "s": 14.0, "linewidths": 0.8},
    "time-out": {"marker": "^", "color": ORANGE, "s": 20.0, "linewidths": 0.0},
    "violation": {"marker": "x", "color": VERMILION, "s": 20.0, "linewidths": 1.1},
}


def kinds_of(table: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return how each encounter is to be marked, a key of :data:`MARKERS`."""
    words = {"reached": "success", "violation": "violation", "timeout": "time-out"}
    kinds = np.array([words[outcome] for outcome in table["outcome"]], dtype=object)
    kinds[table["verdict"] == "unresolvable"] = "proven unresolvable"
    return kinds


def tidy(axes: Any, grid: Literal["x", "y", "both"] = "y") -> None:
    """Draw a light grid behind the data, and no frame at the top and on the right."""
    axes.grid(axis=grid, color="#E5E5E5", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
