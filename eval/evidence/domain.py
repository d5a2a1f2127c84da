"""Cells of the operating domain (course difference, speed ratio, intruders): trials, failures and a
lower bound.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from commands.files import write_whole
from eval.evidence.listed import Evidence
from eval.plots.cells import COURSES, RATIOS, cells_figure
from eval.runner.outputs import read_table
from eval.stats.intervals import share

_GEOMETRIES = [f"{low:g} to {high:g} deg" for low, high in pairwise(COURSES)]
_SPEEDS = [f"{low:g} to {high:g}" for low, high in pairwise(RATIOS)]
_ENOUGH = 100  # trials of a cell: even without a failure fewer show no more than 97 %
_KEPT = ("count", "total", "low")
PICTURE = "docs/assets/figures/domain.png"


def cells(folder: Path) -> dict[str, Any]:
    """Return success of each cell, of the encounters not proven unresolvable, from the folder of a
    finished run.

    The geometry is that of the most critical intruder at the start. The lower end is the one-sided
    95 % bound.
    """
    table = read_table(folder / "encounters.parquet", "the table of a run")
    columns = ("relative_heading_deg", "own_speed_m_s", "intruder_speed_m_s", "outcome", "verdict")
    course, own_speed, intruder_speed, outcome, verdict = (table[name] for name in columns)
    row = np.clip(np.searchsorted(COURSES, np.abs(course), "right") - 1, 0, len(_GEOMETRIES) - 1)
    column = np.clip(
        np.searchsorted(RATIOS, intruder_speed / own_speed, "right") - 1, 0, len(_SPEEDS) - 1
    )
    tried = verdict != "unresolvable"
    rates = {}
    for i, geometry in enumerate(_GEOMETRIES):
        for j, speed in enumerate(_SPEEDS):
            inside = tried & (row == i) & (column == j)
            reached = np.count_nonzero(inside & (outcome == "reached"))
            rates[f"cells/{geometry}/{speed}"] = share(reached, np.count_nonzero(inside), 0.9)
    return rates


def rows_of_cells(
    listed: Evidence, results: Mapping[str, Any], names: Sequence[str]
) -> list[list[str]]:
    """Return a table with a row for each geometry of each result, and its head."""
    rows = [["", "courses differ by", *(f"speed ratio {speed}" for speed in _SPEEDS)]]
    for name in names:
        for geometry in _GEOMETRIES:
            rows.append([listed.results[name].title, geometry])
            for speed in _SPEEDS:
                count, total, low = (
                    results[name]["figures"][f"cells/{geometry}/{speed}"][key] for key in _KEPT
                )
                bound = f"{100.0 * low:.1f} %" if total >= _ENOUGH else "too few"
                rows[-1].append(f"{total - count}/{total}; {bound}")
    return rows


def draw(root: Path, listed: Evidence, results: Mapping[str, Any]) -> list[Path]:
    """Draw the lower bounds, a panel for each result with cells; return the file, nothing without
    such results.
    """
    names = [name for name, entry in listed.results.items() if entry.cells and name in results]
    if not names:
        return []
    panels = []
    for name in names:
        rates = [
            [results[name]["figures"][f"cells/{row}/{speed}"] for speed in _SPEEDS]
            for row in _GEOMETRIES
        ]
        bound = np.array(
            [[rate["low"] if rate["total"] >= _ENOUGH else np.nan for rate in row] for row in rates]
        )
        few = [[f"too few\n({rate['total']})" for rate in row] for row in rates]
        texts = np.where(np.isfinite(bound), np.char.mod("%.1f", 100.0 * bound), few)
        panels.append((listed.results[name].title, 100.0 * bound, texts))
    figure = cells_figure(panels, _GEOMETRIES, _SPEEDS, 80.0, "success, lower 95 % bound, %")
    with write_whole(root / PICTURE) as path:
        figure.savefig(path, format="png", dpi=110)
    return [root / PICTURE]
