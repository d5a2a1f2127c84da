"""Draw the areas of a file in the local frame about a place: ``python -m eval.areas FILE``."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

from envs.areas import Area, Circle, Keep
from envs.edge.command import Parser
from envs.edge.files import write_whole
from envs.formats.areas import read_areas
from envs.formats.local_frame import LocalFrame
from eval.plots.style import SKY, VERMILION

_COLOURS = {Keep.OUT: VERMILION, Keep.IN: SKY}


def main(arguments: Sequence[str] | None = None) -> int:
    """Read a file of areas and write the picture."""
    parser = Parser(prog="python -m eval.areas", description=__doc__)
    parser.add_argument("file", type=Path, help="GeoJSON, ED-269, ED-318, .plan or ICAROUS YAML")
    for name, what in (("latitude", "north"), ("longitude", "east")):
        parser.add_argument(
            f"--{name}", type=float, required=True, help=f"of the frame's origin, degrees {what}"
        )
    parser.add_argument("--out", type=Path, default=Path("areas.png"), help="PNG to write")
    options = parser.parse_args(arguments)
    areas = read_areas(options.file, LocalFrame(options.latitude, options.longitude))
    with write_whole(options.out) as temporary:
        picture(areas).savefig(temporary, format="png", dpi=120)
    print(f"{options.out}: {len(areas)} areas")
    return 0


def picture(areas: Sequence[Area]) -> Figure:
    """Return a map of areas: those to be kept out of are filled, and an arrow leads to where a
    moving one is after 100 s.
    """
    figure = Figure(figsize=(6.0, 5.0), layout="constrained")
    axes = figure.add_subplot()
    for area in areas:
        colour, fill = _COLOURS[area.keep], area.keep is Keep.OUT
        outline = _outline(area)
        axes.add_patch(PathPatch(outline, facecolor=colour if fill else "none", alpha=0.35))
        axes.add_patch(PathPatch(outline, facecolor="none", edgecolor=colour, linewidth=1.5))
        box = outline.get_extents()
        x, y = 0.5 * (box.x0 + box.x1), 0.5 * (box.y0 + box.y1)
        # Above an area, or in the corner of one to stay in: holes and arrows stay free.
        where: Any = (
            {"xy": (x, box.y1), "xytext": (0, 2), "ha": "center", "va": "bottom"}
            if fill
            else {"xy": (box.x0, box.y1), "xytext": (3, -3), "ha": "left", "va": "top"}
        )
        axes.annotate(area.name, textcoords="offset points", fontsize=8, **where)
        if any(area.velocity):
            dx, dy = 100.0 * np.array(area.velocity) / 1e3
            axes.annotate("", (x + dx, y + dy), (x, y), arrowprops={"arrowstyle": "->"})
    axes.autoscale_view()
    axes.set_aspect("equal")
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    figure.set_figheight(min(max(5.3 * (north - south) / (east - west) + 0.7, 2.5), 8.0))
    axes.set_xlabel("east, km")
    axes.set_ylabel("north, km")
    return figure


def _outline(area: Area) -> Outline:
    """Return the edge of an area, km."""
    if isinstance(area.shape, Circle):
        return Outline.circle((area.shape.x / 1e3, area.shape.y / 1e3), area.shape.radius / 1e3)
    return Outline.make_compound_path(
        *(Outline(np.array([*ring, ring[0]]) / 1e3, closed=True) for ring in area.shape.rings)
    )
