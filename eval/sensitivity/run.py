"""What success depends on: ``python -m eval.sensitivity --run runs/circle --vary position_std --out runs/what``."""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agents.config.figures import save_figure
from agents.config.load import ConfigError, Parser
from envs.edge.files import write_file
from eval.plots import save as picture_folder
from eval.runner.options import whole

if TYPE_CHECKING:
    from eval.sensitivity.bins import Run
    from eval.sensitivity.sweep import Sweep

__all__ = ["main"]

_SWEEPS = "sweeps"
_MODES = ("policy", "plan", "assured")

_DESCRIPTION = """\
Draw success as a function of what it depends on, under the bound of what can be resolved at all, with exact intervals.

--run DIR      cuts the table of a finished run of eval.monte_carlo or eval.hifi into bins of what it varies: angle,
               distance, time to conflict, speeds, number of intruders; of eval.hifi also wind and turbulence.
               Nothing is flown.
--vary NAME    flies what a run holds fixed, a run for every value, all of them on the same encounters:
                 position_std   noise of reported positions, m        (0, 10, 30, 60, 100)
                 velocity_std   noise of reported velocities, m/s     (0, 1, 3, 6, 10)
                 latency        age of the reports, s                 (0, 0.5, 1, 1.5, 2)
                 turn_rate      largest turn rate of the intruder, deg/s (0, 0.5, 1, 2, 3)
               NAME=V1,V2,... names values of one's own, rising; the first is what the others are compared with.

Written to --out: sensitivity.json, a figure for each quantity (PNG and SVG), overview.png and .svg, and below sweeps/
the folder of every run flown."""

_EPILOG = """\
examples:
  python -m eval.sensitivity --run runs/circle --out runs/circle_sensitivity
  python -m eval.sensitivity --vary position_std --vary latency=0,1,2 --encounters 2000 --out runs/noise
  python -m eval.sensitivity --vary turn_rate --mode assured --encounters 200 --out runs/turning
  python -m eval.sensitivity --resume --vary turn_rate --mode assured --encounters 200 --out runs/turning
  python -m eval.sensitivity --run runs/hifi_moderate --out runs/wind

A run in mode assured flies plan and policy beside, so that its figures show all three."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw what the command line asks for and return the exit status.

    Raises:
        ConfigError: bad input; so are ``PolicyFileError`` and ``EncounterError``.
    """
    options = _parser().parse_args(arguments)
    _check(options)
    from eval.sensitivity.bins import read_run
    from eval.sensitivity.sweep import fly, swept

    sweeps = [swept(text) for text in options.vary]
    _check_sweeps(options, sweeps)
    run = None if options.run is None else read_run(options.run)
    if options.resume:
        options.out.mkdir(parents=True, exist_ok=True)
    else:
        picture_folder.create(options.out)
    begun = time.perf_counter()
    for sweep in sweeps:
        print(f"flying {sweep.name} = {', '.join(f'{value:g}' for value in sweep.values)}", file=sys.stderr, flush=True)
        status = fly(sweep, _passed_on(options), options.out / _SWEEPS, resume=options.resume)
        if status:
            print("Go on with the same command and --resume", file=sys.stderr)
            return status
    found = _found(options, run, sweeps)
    if not found["quantities"] and not sweeps:
        raise ConfigError(f"--run {options.run}: varies nothing that can be shown; expected a run with a scenario")
    paths = _draw(options, run, found)
    found["wall_s"] = time.perf_counter() - begun
    text = json.dumps(found, indent=2, allow_nan=False) + "\n"
    write_file(options.out / "sensitivity.json", text)
    _show(found)
    print(f"files: {options.out}: " + ", ".join(["sensitivity.json", *paths]))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.sensitivity", description=_DESCRIPTION, epilog=_EPILOG)
    add = parser.add_argument
    add("--run", type=Path, metavar="DIR", help="folder of a finished run of eval.monte_carlo or eval.hifi")
    add("--vary", action="append", default=[], metavar="NAME[=V,...]", help="what is swept; may be repeated")
    add("--mode", choices=_MODES, help="of sweeps: what decides (default: policy)")
    add("--scenario", metavar="NAME", help="of sweeps: a sampled scenario (default: circle)")
    add("--policy", type=Path, metavar="FILE", help="of sweeps: policy file (default: the one that ships)")
    add("--encounters", type=whole(1), metavar="N", help="of sweeps: how many for each value (default: 1000)")
    add("--seed", type=whole(0), metavar="N", help="of sweeps: of encounters and noise (default: 0)")
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="of sweeps: a key of eval.monte_carlo")
    add("--workers", type=whole(0), metavar="N", help="of sweeps: processes; 0: one for every core (default: 0)")
    add("--confidence", type=float, default=0.95, metavar="P", help="of all intervals (default: 0.95)")
    add("--resume", action="store_true", help="go on with sweeps that were interrupted")
    add("--out", type=Path, required=True, metavar="DIR", help="folder for what is written, new or empty")
    return parser


def _check(options: argparse.Namespace) -> None:
    """Raise ``ConfigError`` for options that do not fit together."""
    if options.run is None and not options.vary:
        raise ConfigError("neither --run nor --vary is given; expected at least one of them")
    # Inverted, so that NaN is refused.
    if not 0.5 <= options.confidence < 1.0:
        raise ConfigError(f"--confidence: {options.confidence:g}; expected 0.5 to less than 1")
    if options.vary:
        return
    for name in ("mode", "scenario", "policy", "encounters", "seed", "workers"):
        if getattr(options, name) is not None:
            raise ConfigError(f"--{name}: is for sweeps; expected --vary with it")
    if options.set or options.resume:
        raise ConfigError(f"{'--set' if options.set else '--resume'}: is for sweeps; expected --vary with it")


def _check_sweeps(options: argparse.Namespace, sweeps: "Sequence[Sweep]") -> None:
    from eval.sensitivity.sweep import PARAMETERS

    names = [sweep.name for sweep in sweeps]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f"--vary {name}: given {names.count(name)} times; expected once, with all values")
        for key in PARAMETERS[name].changes(1.0):
            if any(text.startswith(f"changes.{key}=") for text in options.set):
                raise ConfigError(f"--set changes.{key}: is varied by --vary {name}; expected one of them")
    if options.scenario is not None and ":" in options.scenario:
        raise ConfigError(f"--scenario: {options.scenario!r} has no numbers to vary; expected a sampled scenario")


def _passed_on(options: argparse.Namespace) -> list[str]:
    """Return the arguments of ``eval.monte_carlo`` that all values share."""
    named = {
        "--mode": options.mode,
        "--scenario": options.scenario,
        "--policy": options.policy,
        "--encounters": options.encounters or 1_000,
        "--seed": options.seed,
        "--workers": options.workers,
    }
    given = [part for name, value in named.items() if value is not None for part in (name, str(value))]
    return [*given, *(part for text in options.set for part in ("--set", text))]


def _found(options: argparse.Namespace, run: "Run | None", sweeps: "Sequence[Sweep]") -> dict[str, Any]:
    """Return the content of sensitivity.json, without the wall time."""
    from agents.policy.versions import versions
    from eval.sensitivity.bins import QUANTITIES, binned, mapped
    from eval.sensitivity.sweep import collected

    confidence = options.confidence
    quantities: list[dict[str, Any]] = []
    cells: list[dict[str, Any]] = []
    if run is not None:
        quantities = [one for each in QUANTITIES if (one := binned(run, each, confidence)) is not None]
        names = {each.name: each for each in QUANTITIES}
        cells = mapped(run, names["relative_heading"], names["distance"], confidence)
    return {
        "schema_version": 1,
        "confidence": confidence,
        "run": None if run is None else _run_said(run),
        "quantities": quantities,
        "map": cells,
        "sweeps_settings": _settings_said(options) if sweeps else None,
        "sweeps": [collected(sweep, options.out / _SWEEPS, confidence) for sweep in sweeps],
        "versions": versions("numpy", "scipy", "pyarrow", "matplotlib"),
    }


def _run_said(run: "Run") -> dict[str, Any]:
    known = ("scenario", "seed", "mode", "policy_sha256", "draws", "aircraft")
    said = {key: run.settings[key] for key in known if key in run.settings}
    weighted = "weight" in run.table and bool((run.table["weight"] != 1.0).any())
    return {"folder": run.path.name, "encounters": len(run.table["outcome"])} | said | {"weights_ignored": weighted}


def _settings_said(options: argparse.Namespace) -> dict[str, Any]:
    return {
        "scenario": options.scenario or "circle",
        "mode": options.mode or "policy",
        "encounters": options.encounters or 1_000,
        "seed": options.seed or 0,
        "set": options.set,
    }


def _draw(options: argparse.Namespace, run: "Run | None", found: dict[str, Any]) -> list[str]:
    """Write the figures and return the names of the files."""
    from eval.sensitivity.bins import QUANTITIES
    from eval.sensitivity.figure import map_figure, overview, quantity_figure, sweep_figure

    bars = f"bars: {100.0 * options.confidence:g} % intervals (Clopper-Pearson)"
    figures: dict[str, Any] = {}
    titles = []
    if run is not None:
        said = found["run"]
        title = (
            f"{said['folder']}: {_n(said['encounters'])} encounters, scenario {said.get('scenario')}, mode {run.mode}"
        )
        titles.append(title)
        figures |= {one["name"]: quantity_figure(one, f"{title}; {bars}") for one in found["quantities"]}
        names = {each.name: each for each in QUANTITIES}
        if len(found["map"]) > 1:
            figures["map"] = map_figure(found["map"], names["relative_heading"], names["distance"], run.mode, title)
    if found["sweeps"]:
        said = found["sweeps_settings"]
        title = f"{_n(said['encounters'])} encounters a value, scenario {said['scenario']}, mode {said['mode']}"
        titles.append(title if run is None else f"sweeps: {title}")
        figures |= {f"vary_{one['name']}": sweep_figure(one, f"{title}; {bars}") for one in found["sweeps"]}
    figures["overview"] = overview(found["quantities"], found["sweeps"], "\n".join([*titles, bars]))
    return [path.name for name, figure in figures.items() for path in save_figure(figure, options.out / name, 130)]


def _show(found: dict[str, Any]) -> None:
    """Print, for each quantity, where success of the resolvable is lowest and highest; for each sweep, every value."""
    for one in found["quantities"]:
        print(f"{one['label']}:")
        mode = next(iter(one["bins"][0]["success"]))
        for cell in one["bins"]:
            place = cell.get("word") or f"{cell['low']:g} to {cell['high']:g} {one['unit']}"
            print(f"  {place:22} {_line(cell, mode)}")
    for one in found["sweeps"]:
        print(f"{one['label']}:")
        for point in one["values"]:
            for mode in point["success"]:
                print(f"  {point['value']:g} {one['unit']:8} {mode:8} {_line(point, mode)}")


def _line(cell: dict[str, Any], mode: str) -> str:
    success = cell["success"][mode]
    return (
        f"{_percent(success['success_given_resolvable'])} of the resolvable, {_percent(success['success_rate'])} of "
        f"all {_n(cell['encounters'])}, {100.0 * cell['unresolvable_rate']['value']:.2f} % proven unresolvable"
    )


def _percent(share: dict[str, Any]) -> str:
    if share["value"] is None:
        return "none"
    return f"{100.0 * share['value']:.2f} % ({100.0 * share['low']:.2f} .. {100.0 * share['high']:.2f})"


def _n(value: int) -> str:
    return f"{value:,}".replace(",", " ")
