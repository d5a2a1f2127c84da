"""Check of resolvability by dynamic programming: ``python -m eval.boundary --out runs/boundary``."""

import argparse
import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agents.config.load import ConfigError, Parser
from eval.plots import save as picture_folder

if TYPE_CHECKING:
    from eval.boundary.grid import Solution
    from eval.boundary.slices import Slice

__all__ = ["GRIDS", "main"]

GRIDS = {
    "coarse": ((5.0, 120.0), (5.0, 60.0)),
    "default": ((5.0, 60.0), (2.5, 30.0)),
    "fine": ((5.0, 40.0), (2.5, 20.0)),
}
"""Time step (s) and cell (m) of the two grids whose difference gives the error, the finer one last."""

_SLICES = (
    ("head-on", 75.0, 75.0, 180.0),
    ("crossing from the left", 75.0, 75.0, 90.0),
    ("shallow crossing", 75.0, 75.0, 30.0),
    ("overtaken", 60.0, 100.0, 0.0),
    ("slow against fast", 50.0, 100.0, 135.0),
    ("overtaking", 100.0, 50.0, 0.0),
)

_DESCRIPTION = """\
Ask twice from where one straight intruder can still be avoided, and draw both answers: by dynamic programming on a
grid (Hamilton-Jacobi reachability), and by agents.resolvability, whose proofs and witnesses know of no grid.

A slice fixes both speeds and the difference of the courses; the intruder's place at the start varies. Without --slice
six slices are asked. The goal lies 12 km straight ahead. Limits are the surrogate's, the separation is 1000 m.

Written to --out: boundary.json and the figure boundary.png and .svg. Disagreements are points that one side says can
be avoided and the other cannot, by more than the grid's error: there must be none."""

_EPILOG = """\
examples:
  python -m eval.boundary --out runs/boundary
  python -m eval.boundary --slice 60 90 120 --slice 60 90 -45 --spacing 100 --out runs/mine

The grid's headings are 7.5 degrees apart, its speeds 1.25 m/s; at nodes that both grids share (15 degrees, 2.5 m/s)
nothing is lost by interpolation, elsewhere the stated error is larger."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the check that the command line asks for; the status is 1 if the answers disagree anywhere.

    Raises:
        ConfigError: bad input.
    """
    options = _parser().parse_args(arguments)
    cuts = _slices(options.slice)
    if not 20.0 <= options.spacing <= 500.0:
        raise ConfigError(f"--spacing: {options.spacing:g} m; expected 20 to 500 m")
    picture_folder.create(options.out)
    begun = time.perf_counter()

    from envs.kinematics import SURROGATE
    from envs.outcome import RULES
    from eval.boundary.figure import boundary_figure
    from eval.boundary.slices import compare, judge

    asked = []
    solutions: dict[float, tuple[Solution, Solution]] = {}
    for cut in sorted(cuts, key=lambda cut: cut.intruder_speed):
        if cut.intruder_speed not in solutions:
            solutions.clear()  # one at a time bounds the memory
            _say(f"solving the grids for an intruder at {cut.intruder_speed:g} m/s")
            solutions[cut.intruder_speed] = _solutions(cut.intruder_speed, options.grid)
        coarse, fine = solutions[cut.intruder_speed]
        _say(f"judging {cut.name}")
        answers = judge(cut, fine, coarse, options.spacing, RULES, SURROGATE)
        figures = compare(answers, RULES, options.spacing) | {
            "grid_nodes": fine.value.size,
            "grid_sweeps": fine.sweeps,
            "last_change_m": fine.change,
        }
        asked.append((cuts.index(cut), answers, figures))
    asked.sort(key=lambda one: one[0])

    disagreements = sum(sum(figures["disagreements"].values()) for _, _, figures in asked)
    picture_folder.write(
        options.out,
        "boundary",
        {
            "schema_version": 1,
            "separation_m": RULES.separation,
            "limits": SURROGATE._asdict(),
            "spacing_m": options.spacing,
            "grids": [{"dt_s": dt, "cell_m": cell} for dt, cell in GRIDS[options.grid]],
            "disagreements": disagreements,
            "slices": [figures for _, _, figures in asked],
            "wall_s": time.perf_counter() - begun,
        },
        boundary_figure([(answers, figures) for _, answers, figures in asked], RULES.separation),
        dpi=110,
    )
    for _, _, figures in asked:
        print(_line(figures))
    print(f"{disagreements} disagreements; written to {options.out}")
    return 1 if disagreements else 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.boundary", description=_DESCRIPTION, epilog=_EPILOG)
    add = parser.add_argument
    add(
        "--slice",
        action="append",
        nargs=3,
        type=float,
        default=[],
        metavar=("OWN", "INTRUDER", "COURSE"),
        help="own speed, intruder's speed (m/s) and its course less the own one (degrees clockwise); may be repeated",
    )
    add("--spacing", type=float, default=150.0, metavar="M", help="of the raster of starts, m (default: 150)")
    add("--grid", choices=tuple(GRIDS), default="default", help="resolution; fine takes 3 times as long")
    add("--fine", action="store_const", const="fine", dest="grid", help="the same as --grid fine")
    add("--out", type=Path, required=True, metavar="DIR", help="folder for what is written, new or empty")
    return parser


def _slices(wanted: Sequence[Sequence[float]]) -> "list[Slice]":
    from envs.kinematics import SURROGATE
    from eval.boundary.slices import Slice

    named = [(f"slice {number}", *values) for number, values in enumerate(wanted, 1)] or _SLICES
    for name, own, intruder, course in named:
        for what, value, low, high in (
            ("own speed", own, SURROGATE.speed_min, SURROGATE.speed_max),
            ("intruder's speed", intruder, 0.0, 150.0),
            ("course difference", course, -180.0, 180.0),
        ):
            if not low <= value <= high:
                unit = "degrees" if what == "course difference" else "m/s"
                raise ConfigError(
                    f"--slice: the {what} of {name} is {value:g} {unit}; expected {low:g} to {high:g} {unit}"
                )
    return [Slice(name, own, intruder, math.radians(course)) for name, own, intruder, course in named]


def _solutions(intruder_speed: float, name: str) -> "tuple[Solution, Solution]":
    """Return the value functions on the coarser and the finer grid."""
    from envs.kinematics import SURROGATE
    from envs.outcome import RULES
    from eval.boundary.grid import edge_value, make_grid, solve

    found = []
    for dt, cell in GRIDS[name]:
        grid = make_grid(SURROGATE, intruder_speed, RULES.separation, dt, cell)
        solution = solve(grid, SURROGATE, intruder_speed, RULES.separation)
        assert edge_value(solution) > RULES.separation, "a lost state touches the edge of the grid"
        found.append(solution)
    return found[0], found[1]


def _line(figures: dict[str, Any]) -> str:
    return (
        f"{figures['name']}: {figures['points']} points, {figures['resolvable']} resolvable, "
        f"{figures['unresolvable']} unresolvable, {figures['undecided']} undecided; "
        f"{sum(figures['disagreements'].values())} disagreements beyond the grid's error of "
        f"{figures['grid_error_m']:.2f} m"
    )


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
