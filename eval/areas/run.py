"""Draw the areas of a file in the local frame about a place: ``python -m eval.areas FILE``."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

from agents.config.load import ConfigError, Parser
from commands.command import real
from commands.figures import save_figure
from envs.areas import Area, AreaError, Circle, Keep
from envs.formats.areas import read_near_areas
from envs.formats.local_frame import LocalFrame
from eval.areas.config import AreasConfig
from eval.plots import save as picture_folder
from eval.plots.style import PURPLE, SKY
from eval.runner.options import config_option, default_folder, load_with_options

_DESCRIPTION = """\
Draw the areas of a file on a map, in the local frame about a place.

Written to --out: areas.png, areas.svg and config.yaml."""

_EPILOG = """\
examples:
  python -m eval.areas areas.geojson --latitude 47 --longitude 8 --out runs/areas
  python -m eval.areas --config runs/areas/config.yaml --out runs/again          repeat one"""

_COLOURS = {Keep.OUT: PURPLE, Keep.IN: SKY}


def main(arguments: Sequence[str] | None = None) -> int:
    """Read a file of areas and draw them; bad input raises ``InputError``."""
    options = _parser().parse_args(arguments)
    config = _load(options)
    areas, remarks = read_near_areas(config.file, LocalFrame(config.latitude, config.longitude))
    if not areas:
        problem = "; ".join(remarks) or f"{config.file}: holds none"
        raise AreaError(f"{problem}; expected areas to draw")
    folder = options.out or default_folder("areas")
    picture_folder.create(folder, config)
    save_figure(picture(areas), folder / "areas", 120)
    for remark in remarks:
        print(remark)
    print(f"{folder}: {len(areas)} areas")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.areas", description=_DESCRIPTION, epilog=_EPILOG)
    add = parser.add_argument
    formats = "GeoJSON, ED-269, ED-318, .plan or ICAROUS YAML"
    add("file", type=Path, nargs="?", metavar="FILE", help=formats)
    config_option(parser, "an earlier map")
    add(
        "--latitude",
        type=real(-90.0, 90.0),
        metavar="DEG",
        help="latitude of the frame's origin",
    )
    add(
        "--longitude",
        type=real(-180.0, 180.0),
        metavar="DEG",
        help="longitude of the frame's origin",
    )
    default = "folder, new or empty (default: runs/areas_DATE_TIME)"
    add("--out", type=Path, metavar="DIR", help=default)
    return parser


def _load(options: argparse.Namespace) -> AreasConfig:
    """Return the configuration of a file under what the command line says."""
    overrides = {name: getattr(options, name) for name in AreasConfig.model_fields}
    if options.config is None and None in overrides.values():
        raise ConfigError("expected FILE, --latitude and --longitude, or --config")
    return load_with_options(AreasConfig, options.config, overrides)


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
