"""What success depends on: ``python -m eval.sensitivity --run runs/circle --vary position_std --out
runs/what``.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents.config.load import ConfigError, Parser
from envs.edge.figures import save_figure
from envs.edge.installation import versions
from envs.edge.progress import group_digits
from eval.config import PREFIXES
from eval.plots import save as picture_folder
from eval.plots.style import scenario_title
from eval.runner.command import UnfinishedError
from eval.runner.options import confidence_option, extension_option, new_folder_option, whole
from eval.sensitivity.bins import Run, bins_of, quantities, read_run
from eval.sensitivity.figure import draw_details, overview, points_of
from eval.sensitivity.sweep import Sweep, change_of, collect, fly, parse_sweep
from eval.stats.intervals import percent

_SWEEPS = "sweeps"

_DESCRIPTION = """\
Draw success as a function of what it depends on, under the bound of what can be resolved at all,
with exact intervals.

--run DIR      cuts the table of a finished run of eval.monte_carlo or eval.hifi into bins of
               what it varies.
--vary NAME    flies what a run holds fixed, a run for every value on the same encounters:
               position_std (m), velocity_std (m/s), latency (s) or the intruder's turn_rate
               (deg/s). NAME=V1,V2,... names values of one's own, rising; the first is what the
               others are compared with.

Written to --out: sensitivity.json, a figure for each quantity (PNG and SVG), overview.png and
.svg, and below sweeps/ the folder of every run flown (contents in docs/howto/sensitivity.md)."""

_EPILOG = """\
examples:
  python -m eval.sensitivity --run runs/circle --out runs/circle_sensitivity
  python -m eval.sensitivity --vary position_std --vary latency=0,1,2 --encounters 2000 \\
    --out runs/noise
  python -m eval.sensitivity --vary turn_rate --mode assured --encounters 200 --out runs/turning

A run in mode assured flies plan and policy beside, so that its figures show all three."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw what the command line asks for and return the exit status; bad input raises
    ``InputError``.
    """
    options = _parser().parse_args(arguments)
    sweeps = [parse_sweep(text) for text in options.vary]
    _check(options, sweeps)
    run = None if options.run is None else read_run(options.run)
    if options.resume:
        options.out.mkdir(parents=True, exist_ok=True)
    else:
        picture_folder.create(options.out)
    begun = time.perf_counter()
    for sweep in sweeps:
        print(
            f"flying {sweep.name} = {', '.join(f'{value:g}' for value in sweep.values)}",
            file=sys.stderr,
            flush=True,
        )
        try:
            fly(sweep, _keys(options), options.set, options.out / _SWEEPS, resume=options.resume)
        except UnfinishedError as end:
            print(f"{end}\nGo on with the same command and --resume", file=sys.stderr)
            return end.status
    found = _make_summary(options, run, sweeps)
    if not found["quantities"] and not sweeps:
        raise ConfigError(
            f"--run {options.run}: varies nothing that can be shown; expected a run with a scenario"
        )
    paths = _draw(options, found)
    found["wall_s"] = time.perf_counter() - begun
    picture_folder.write(options.out, "sensitivity", found)
    for one in [*found["quantities"], *found["sweeps"]]:
        _show(one)
    print(f"files: {options.out}: " + ", ".join(["sensitivity.json", *paths]))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.sensitivity", description=_DESCRIPTION, epilog=_EPILOG)
    add = parser.add_argument
    modes = ("policy", "plan", "assured")
    add(
        "--run",
        type=Path,
        metavar="DIR",
        help="folder of a finished run of eval.monte_carlo or eval.hifi",
    )
    add(
        "--vary",
        action="append",
        default=[],
        metavar="NAME[=V,...]",
        help="what is swept; may be repeated",
    )
    add("--mode", choices=modes, help="of sweeps: what decides (default: policy)")
    add("--scenario", metavar="NAME", help="of sweeps: a sampled scenario (default: circle)")
    add(
        "--policy",
        type=Path,
        metavar="FILE",
        help="of sweeps: policy file (default: the one that ships)",
    )
    extension_option(parser)
    add(
        "--encounters",
        type=whole(1),
        metavar="N",
        help="of sweeps: how many for each value (default: 1000)",
    )
    add(
        "--seed", type=whole(0), metavar="N", help="of sweeps: of encounters and noise (default: 0)"
    )
    add(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="of sweeps: a key of eval.monte_carlo",
    )
    add(
        "--workers",
        type=whole(0),
        metavar="N",
        help="of sweeps: processes; 0: one for every core (default: 0)",
    )
    confidence_option(parser)
    add("--resume", action="store_true", help="go on with sweeps that were interrupted")
    new_folder_option(parser)
    return parser


def _check(options: argparse.Namespace, sweeps: Sequence[Sweep]) -> None:
    if options.run is None and not sweeps:
        raise ConfigError("neither --run nor --vary is given; expected at least one of them")
    for name in (
        "mode",
        "scenario",
        "policy",
        "encounters",
        "seed",
        "workers",
        "set",
        "extension",
        "resume",
    ):
        if not sweeps and getattr(options, name) not in (None, [], False):
            raise ConfigError(f"--{name}: is for sweeps; expected --vary with it")
    names = [sweep.name for sweep in sweeps]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(
                f"--vary {name}: given {names.count(name)} times; expected once, with all values"
            )
        for key in change_of(name, 1.0):
            if any(text.startswith(f"changes.{key}=") for text in options.set):
                raise ConfigError(
                    f"--set changes.{key}: is varied by --vary {name}; expected one of them"
                )
    if options.scenario is not None and options.scenario.startswith(PREFIXES):
        raise ConfigError(
            f"--scenario: {options.scenario!r} has no numbers to vary; expected a sampled scenario"
        )


def _keys(options: argparse.Namespace) -> dict[str, Any]:
    """Return the keys of ``eval.monte_carlo`` that all values share."""
    return {
        "policy": options.policy,
        "extensions": options.extension,
        "scenario": options.scenario,
        "mode": options.mode,
        "encounters": options.encounters or 1_000,
        "seed": options.seed,
        "workers": options.workers,
    }


def _make_summary(
    options: argparse.Namespace, run: Run | None, sweeps: Sequence[Sweep]
) -> dict[str, Any]:
    confidence = options.confidence
    bins = (
        [bins_of(run, each, confidence) for each in quantities(run.aircraft).values()]
        if run
        else []
    )
    usual = {"scenario": "circle", "mode": "policy", "encounters": 1_000, "seed": 0, "set": []}
    settings = {name: getattr(options, name) or value for name, value in usual.items()}
    return {
        "schema_version": 2,
        "confidence": confidence,
        "run": None if run is None else _describe(run),
        "quantities": [one for one in bins if one is not None],
        "sweeps_settings": settings if sweeps else None,
        "sweeps": [collect(sweep, options.out / _SWEEPS, confidence) for sweep in sweeps],
        "versions": versions("numpy", "scipy", "pyarrow", "matplotlib"),
    }


def _describe(run: Run) -> dict[str, Any]:
    weighted = "weight" in run.table and bool((run.table["weight"] != 1.0).any())
    counted = {
        "folder": run.path.name,
        "encounters": len(run.table["outcome"]),
        "weights_ignored": weighted,
    }
    return counted | dict(run.settings)


def _draw(options: argparse.Namespace, found: dict[str, Any]) -> list[str]:
    bars = f"bars: {100.0 * options.confidence:g} % intervals (Clopper-Pearson)"
    figures: dict[str, Any] = {}
    titles = []
    for said, name, each in (
        (found["run"], "quantities", ""),
        (found["sweeps_settings"], "sweeps", " a value"),
    ):
        if said is not None:
            what = f"scenario {scenario_title(str(said.get('scenario')))}, mode {said.get('mode')}"
            count = group_digits(said["encounters"])
            titles.append(f"{said.get('folder', name)}: {count} encounters{each}, {what}")
            for one in found[name]:
                figures[f"{'vary_' if each else ''}{one['name']}"] = draw_details(
                    one, f"{titles[-1]}\n{bars}"
                )
    figures["overview"] = overview(
        [*found["quantities"], *found["sweeps"]], "\n".join([*titles, bars])
    )
    return [
        path.name
        for name, figure in figures.items()
        for path in save_figure(figure, options.out / name, 130)
    ]


def _show(found: dict[str, Any]) -> None:
    """Print the success of the run's mode in each bin of a quantity, or of every mode at each value
    of a sweep.
    """
    print(f"{found['label']}:")
    for cell in points_of(found):
        span = (
            f"{cell['low']:g} to {cell['high']:g} {found['unit']}"
            if "low" in cell
            else cell.get("word")
        )
        for mode, success in list(cell["success"].items())[: 1 if span else None]:
            place = f"{span:22}" if span else f"{cell['value']:g} {found['unit']:8} {mode:8}"
            rates = (success["success_given_resolvable"], success["success_rate"])
            given, every = (percent(rate, "{} % ({} .. {})", "none") for rate in rates)
            bound = f"{100.0 * cell['unresolvable_rate']['value']:.2f} % proven unresolvable"
            print(
                f"  {place} {given} of the resolvable, {every} of all "
                f"{group_digits(cell['encounters'])}, {bound}"
            )
