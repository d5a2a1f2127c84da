"""Check of resolvability by dynamic programming: ``python -m eval.boundary --out
runs/boundary``.
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from agents.config.load import AIRCRAFT, ConfigError, Parser, file_of
from commands.command import real
from commands.json_text import parse_json
from envs.aircraft import PAPER, Aircraft
from eval.boundary.config import BoundaryConfig
from eval.boundary.figure import boundary_figure
from eval.boundary.grid import Solution, edge_value, make_grid, solve
from eval.boundary.slices import Answers, Slice, compare, judge
from eval.plots import save as picture_folder
from eval.runner.options import (
    config_file,
    config_option,
    load_with_options,
    new_folder_option,
    resume_option,
)
from eval.runner.parts import PartsFolder

# Time steps of a half turn, and cell (separations), of two grids, the finer one last: the
# difference is the error.
GRIDS = {
    "coarse": ((12, 0.12), (12, 0.06)),
    "default": ((12, 0.06), (24, 0.03)),
    "fine": ((12, 0.04), (24, 0.02)),
}
# name, own and intruder's speed (0: the ownship's least, 1: its greatest), difference of the
# courses, deg
_SLICES = (
    ("head-on", 0.5, 0.5, 180.0),
    ("crossing from the left", 0.5, 0.5, 90.0),
    ("shallow crossing", 0.5, 0.5, 30.0),
    ("overtaken", 0.2, 1.0, 0.0),
    ("slow against fast", 0.0, 1.0, 135.0),
    ("overtaking", 1.0, 0.0, 0.0),
)

_DESCRIPTION = """\
Find the places from which one intruder that flies straight can still be avoided, by two methods,
and draw both results: dynamic programming on a grid (Hamilton-Jacobi reachability), and the proofs
and witnesses of agents.resolvability, which use no grid.

A slice fixes both speeds and the difference of the courses; without --slice there are six.
Written to --out: boundary.json, config.yaml, boundary.png and .svg. A disagreement is a point for
which one method says that the intruder can be avoided and the other that it cannot, by more than
the grid's error; there must be none. Ctrl-C keeps the slices that are finished; --resume goes
on."""

_EPILOG = """\
examples:
  python -m eval.boundary --out runs/boundary
  python -m eval.boundary --slice 60 90 120 --slice 60 90 -45 --spacing 100 --out runs/mine
  python -m eval.boundary --config runs/mine/config.yaml --out runs/again          repeat one
  python -m eval.boundary --resume --out runs/mine          go on with one that was interrupted

At nodes that both grids share (15 degrees and, for the paper's aircraft, 2.5 m/s) the stated
error is smallest."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the check and return the exit status, 1 if the answers disagree; bad input raises
    ``InputError``.
    """
    options = _parser().parse_args(arguments)
    config = _load(options)
    aircraft = _aircraft(config)
    cuts = _slices(config.slices, aircraft)
    config = config.model_copy(update={"spacing": _spacing(config, aircraft)})
    picture_folder.check_room(options.out)
    folder = PartsFolder(options.out, config, "boundary")
    folder.begin(resume=options.resume)
    begun = time.perf_counter()
    with folder:
        answered = _ask(config, cuts, aircraft, folder)
        result = _result(config, answered, aircraft) | {"wall_s": time.perf_counter() - begun}
        picture_folder.write(
            options.out, "boundary", result, boundary_figure(answered, aircraft), 110
        )
    _show(result)
    print(f"{result['disagreements']} disagreements; written to {options.out}")
    return 1 if result["disagreements"] else 0


def _load(options: argparse.Namespace) -> BoundaryConfig:
    """Return the configuration of a file under what the command line says."""
    aircraft = None if options.aircraft is None else file_of(options.aircraft, AIRCRAFT)
    settings = {
        "slices": options.slice or None,
        "aircraft": aircraft,
        "spacing": options.spacing,
        "grid": options.grid,
    }
    return load_with_options(BoundaryConfig, config_file(options), settings)


def _ask(
    config: BoundaryConfig, cuts: Sequence[Slice], aircraft: Aircraft, folder: PartsFolder
) -> list[tuple[Answers, dict[str, Any]]]:
    """Return both answers to each slice, and its figures, in the order of the slices; those that
    are stored are not asked again.
    """
    answered: dict[int, tuple[Answers, dict[str, Any]]] = {}
    for number, cut in sorted(enumerate(cuts), key=lambda item: item[1].intruder_speed):
        part = folder.part(f"slice_{number}", partial(_judge, cut, config, aircraft))
        figures = parse_json(str(part.pop("figures")))
        answered[number] = Answers(slice=cut, **part), figures
    return [answered[number] for number in range(len(cuts))]


def _judge(cut: Slice, config: BoundaryConfig, aircraft: Aircraft) -> dict[str, Any]:
    """Return the part of a slice: the fields of both answers but for itself, and its figures as
    JSON.
    """
    assert config.spacing is not None  # it is resolved
    coarse, fine = _solve(cut.intruder_speed, _grids(config, aircraft), aircraft)
    print(f"judging {cut.name}", file=sys.stderr)
    answers = judge(cut, fine, coarse, config.spacing, aircraft)
    figures = compare(answers, aircraft.separation, config.spacing)
    figures |= {
        "grid_nodes": fine.value.size,
        "grid_sweeps": fine.sweeps,
        "last_change_m": fine.change,
    }
    part = answers._asdict() | {"figures": json.dumps(figures)}
    del part["slice"]
    return part


def _result(
    config: BoundaryConfig, answered: Sequence[tuple[Answers, dict[str, Any]]], aircraft: Aircraft
) -> dict[str, Any]:
    """Return what boundary.json says, but for the time it took."""
    return {
        "schema_version": 1,
        "separation_m": aircraft.separation,
        "limits": aircraft.limits._asdict(),
        "spacing_m": config.spacing,
        "grids": [{"dt_s": dt, "cell_m": cell} for dt, cell in _grids(config, aircraft)],
        "disagreements": sum(sum(figures["disagreements"].values()) for _, figures in answered),
        "slices": [figures for _, figures in answered],
    }


def _show(result: dict[str, Any]) -> None:
    for figures in result["slices"]:
        counts = ", ".join(
            f"{figures[name]} {name}"
            for name in ("points", "resolvable", "unresolvable", "undecided")
        )
        beyond = f"disagreements beyond the grid's error of {figures['grid_error_m']:.2f} m"
        print(f"{figures['name']}: {counts}; {sum(figures['disagreements'].values())} {beyond}")


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.boundary", description=_DESCRIPTION, epilog=_EPILOG)
    add = parser.add_argument
    cut: Any = {
        "action": "append",
        "nargs": 3,
        "type": real(-1e4, 1e4),
        "metavar": ("OWN", "INTRUDER", "COURSE"),
        "default": [],
    }
    config_option(parser, "a check")
    add(
        "--slice",
        help="speeds, m/s, and intruder's course minus the own, deg clockwise; may be repeated",
        **cut,
    )
    add(
        "--aircraft",
        type=Path,
        metavar="FILE",
        help="YAML file of the ownship, or a name (default: paper)",
    )
    add(
        "--spacing",
        type=real(1e-3, 1e6, "m"),
        metavar="M",
        help="of the raster of starts, m (default: 0.15 separations)",
    )
    add(
        "--grid",
        choices=tuple(GRIDS),
        help="resolution; fine takes 3 times as long (default: default)",
    )
    resume_option(parser)
    new_folder_option(parser)
    return parser


def _aircraft(config: BoundaryConfig) -> Aircraft:
    aircraft = PAPER if config.aircraft is None else config.aircraft.aircraft()
    if aircraft.limits.speed_min <= 0.0:
        raise ConfigError(
            "--aircraft: speed_min is 0; expected above 0: what can stand still has no such "
            "boundary"
        )
    return aircraft


def _spacing(config: BoundaryConfig, aircraft: Aircraft) -> float:
    separation = aircraft.separation
    spacing = 0.15 * separation if config.spacing is None else config.spacing
    if not 0.02 * separation <= spacing <= 0.5 * separation:
        raise ConfigError(
            f"--spacing: {spacing:g} m; expected {0.02 * separation:g} to {0.5 * separation:g} m"
        )
    return spacing


def _grids(config: BoundaryConfig, aircraft: Aircraft) -> tuple[tuple[float, float], ...]:
    """Return time step, s, and cell, m, of both grids."""
    half_turn = math.pi / aircraft.limits.yaw_rate_max
    return tuple(
        (round(half_turn / steps, 9), cell * aircraft.separation)
        for steps, cell in GRIDS[config.grid]
    )


def _slices(requested: Sequence[tuple[float, float, float]], aircraft: Aircraft) -> list[Slice]:
    """Return the slices that are asked for, or six that the aircraft's speeds give;
    ``ConfigError``: one is out of range.
    """
    slowest, fastest = aircraft.limits.speed_min, aircraft.limits.speed_max
    span = fastest - slowest
    cuts = [
        Slice(f"slice {number}", own, intruder, math.radians(course))
        for number, (own, intruder, course) in enumerate(requested, 1)
    ] or [
        Slice(name, slowest + own * span, slowest + intruder * span, math.radians(course))
        for name, own, intruder, course in _SLICES
    ]
    for cut in cuts:
        traffic, course = aircraft.traffic_speed_max, math.degrees(cut.course_difference)
        _check(f"own speed of {cut.name}", cut.own_speed, (slowest, fastest), "m/s")
        _check(f"intruder's speed of {cut.name}", cut.intruder_speed, (0.0, traffic), "m/s")
        _check(f"course difference of {cut.name}", course, (-180.0, 180.0), "degrees")
    return cuts


def _check(quantity: str, value: float, span: tuple[float, float], unit: str) -> None:
    low, high = span
    if not low <= value <= high:
        problem = f"{value:g} {unit}; expected {low:g} to {high:g} {unit}"
        raise ConfigError(f"--slice: the {quantity} is {problem}")


@lru_cache(1)  # of one speed at a time, which bounds the memory
def _solve(
    intruder_speed: float, grids: tuple[tuple[float, float], ...], aircraft: Aircraft
) -> list[Solution]:
    print(f"solving the grids for an intruder at {intruder_speed:g} m/s", file=sys.stderr)
    setting = aircraft.limits, intruder_speed, aircraft.separation
    solutions = [solve(make_grid(*setting, *grid), *setting) for grid in grids]
    assert min(map(edge_value, solutions)) > aircraft.separation, (
        "a lost state touches the edge of the grid"
    )
    return solutions
