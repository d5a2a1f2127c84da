"""What success depends on: ``python -m eval.sensitivity runs/circle --vary position_std --out
runs/what``.
"""

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from agents.config.load import ConfigError, Parser
from commands.command import whole
from commands.figures import save_figure
from commands.installation import versions
from commands.progress import group_digits
from eval.plots import save as picture_folder
from eval.plots.style import scenario_title
from eval.runner.command import UnfinishedError
from eval.runner.options import (
    confidence_option,
    config_file,
    config_option,
    extension_option,
    given_policy,
    load_extensions,
    load_with_options,
    named_policy,
    new_folder_option,
    policy_options,
    resume_option,
    run_argument,
    scenario_option,
    workers_option,
)
from eval.runner.outputs import ResumableFolder
from eval.sensitivity.bins import Run, bins_of, quantities, read_run
from eval.sensitivity.config import SensitivityConfig
from eval.sensitivity.figure import draw_details, overview, points_of
from eval.sensitivity.sweep import Sweep, change_of, collect, fly, parse_sweep
from eval.stats.intervals import percent

_SWEEPS = "sweeps"
_OF_SWEEPS = (
    "mode",
    "scenario",
    "policy",
    "policy_sha256",
    "encounters",
    "seed",
    "workers",
    "set",
    "extension",
)
"""Options that nothing uses without a sweep."""


class StudyFolder(ResumableFolder):
    """The folder of a study, with the runs of its sweeps; one that goes on may vary more."""

    free = ("run", "vary", "policy", "confidence", "workers")
    parts = "."


_DESCRIPTION = """\
Draw how the success rate depends on geometry, speeds, noise and turns of the intruder, with exact
intervals, and beside it the share that cannot be resolved at all.

DIR            divides the encounters of a finished run of eval.monte_carlo or eval.hifi into
               bins of what differs between them.
--vary NAME    varies what is the same in all encounters of a run, with a run for each value:
               position_std (m), velocity_std (m/s), latency (s) or the intruder's turn_rate
               (deg/s). NAME=V1,V2,... gives the values, in rising order; the others are
               compared with the first.

Written to --out: sensitivity.json, config.yaml as resolved, a figure for each quantity (PNG and
SVG), overview.png and .svg, and below sweeps/ the folder of every run flown (contents in
docs/howto/analyse.md). Ctrl-C keeps what was flown; --resume goes on."""

_EPILOG = """\
examples:
  python -m eval.sensitivity runs/circle --out runs/circle_sensitivity
  python -m eval.sensitivity --vary position_std --vary latency=0,1,2 --encounters 2000 \\
    --out runs/noise
  python -m eval.sensitivity --vary turn_rate --mode assured --encounters 200 --out runs/turning
  python -m eval.sensitivity --config runs/noise/config.yaml --out runs/again          repeat one
  python -m eval.sensitivity --resume --out runs/noise          go on with one that was interrupted

Every key of --config: docs/reference/configuration-evaluation.md.
--policy, --extension and --workers are for --vary, too.
A run in mode assured also flies plan and policy, so that its figures show all three."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw what the command line asks for and return the exit status; bad input raises
    ``InputError``.
    """
    options = _parser().parse_args(arguments)
    config = _load(options)
    sweeps = [parse_sweep(text) for text in config.vary]
    _check(options, config, sweeps)
    run = None if config.run is None else read_run(config.run)
    shown = [] if run is None else _quantities(run, config.confidence)
    if not shown and not sweeps:
        raise ConfigError(
            f"{config.run}: varies nothing that can be shown; expected a run with a scenario"
        )
    if sweeps:
        load_extensions(config.extensions)
        config = config.model_copy(update={"policy_sha256": named_policy(config).sha256})
    picture_folder.check_room(options.out)
    StudyFolder(options.out, config).begin(resume=options.resume)
    begun = time.perf_counter()
    try:
        for sweep in sweeps:
            _fly(sweep, config, options.out, resume=options.resume)
    except UnfinishedError as end:
        again = f"python -m eval.sensitivity --resume --out {options.out}"
        print(f"{end}Go on with: {again}", file=sys.stderr)
        return end.status
    summary = _make_summary(config, run, shown, sweeps, options.out)
    paths = _draw(summary, options.out)
    summary["wall_s"] = time.perf_counter() - begun
    picture_folder.write(options.out, "sensitivity", summary)
    for part in [*summary["quantities"], *summary["sweeps"]]:
        _show(part)
    print(f"files: {options.out}: " + ", ".join(["config.yaml", "sensitivity.json", *paths]))
    return 0


def _load(options: argparse.Namespace) -> SensitivityConfig:
    """Return the configuration of a file under what the command line says."""
    names = ("run", "mode", "scenario", "encounters", "seed", "workers", "confidence")
    settings = {name: getattr(options, name) for name in names}
    settings |= {
        "vary": options.vary or None,
        "extensions": options.extension or None,
        "settings": options.set or None,
    }
    settings |= given_policy(options)
    return load_with_options(SensitivityConfig, config_file(options), settings)


def _fly(sweep: Sweep, config: SensitivityConfig, folder: Path, *, resume: bool) -> None:
    values = ", ".join(f"{value:g}" for value in sweep.values)
    print(f"flying {sweep.name} = {values}", file=sys.stderr, flush=True)
    fly(sweep, _keys(config), config.settings, folder / _SWEEPS, resume=resume)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.sensitivity", description=_DESCRIPTION, epilog=_EPILOG)
    add = parser.add_argument
    modes = ("policy", "plan", "assured")
    config_option(parser, "a study")
    run_argument(parser, "folder of a finished run of eval.monte_carlo or eval.hifi")
    add(
        "--vary",
        action="append",
        default=[],
        metavar="NAME[=V,...]",
        help="what is varied; may be repeated",
    )
    add("--mode", choices=modes, help="for --vary: what decides (default: policy)")
    scenario_option(parser, when="for --vary: ")
    policy_options(parser)
    extension_option(parser)
    add(
        "--encounters",
        type=whole(1),
        metavar="N",
        help="for --vary: encounters for each value (default: 1000)",
    )
    add("--seed", type=whole(0), metavar="N", help="for --vary: seed (default: 0)")
    add(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="for --vary: a key of eval.monte_carlo",
    )
    workers_option(parser)
    confidence_option(parser)
    resume_option(parser)
    new_folder_option(parser)
    return parser


def _check(options: argparse.Namespace, config: SensitivityConfig, sweeps: Sequence[Sweep]) -> None:
    """Refuse what asks for nothing, options that nothing uses, and a number varied twice."""
    if config.run is None and not sweeps:
        raise ConfigError("neither DIR of a run nor --vary is given; expected at least one of them")
    for name in _OF_SWEEPS:
        if not sweeps and getattr(options, name) not in (None, []):
            raise ConfigError(f"--{name.replace('_', '-')}: is for sweeps; expected --vary with it")
    names = [sweep.name for sweep in sweeps]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(
                f"--vary {name}: given {names.count(name)} times; expected once, with all values"
            )
        for key in change_of(name, 1.0):
            if any(text.startswith(f"changes.{key}=") for text in config.settings):
                raise ConfigError(
                    f"--set changes.{key}: is varied by --vary {name}; expected one of them"
                )


def _keys(config: SensitivityConfig) -> dict[str, Any]:
    """Return the keys of ``eval.monte_carlo`` that all values share."""
    names = ("policy", "policy_sha256", "extensions", "scenario", "mode", "encounters", "seed")
    return {name: getattr(config, name) for name in (*names, "workers")}


def _quantities(run: Run, confidence: float) -> list[dict[str, Any]]:
    """Return the bins of each quantity that a run varies, in JSON types."""
    bins = (bins_of(run, quantity, confidence) for quantity in quantities(run.aircraft).values())
    return [binned for binned in bins if binned is not None]


def _make_summary(
    config: SensitivityConfig,
    run: Run | None,
    shown: Sequence[Mapping[str, Any]],
    sweeps: Sequence[Sweep],
    folder: Path,
) -> dict[str, Any]:
    """Return what sensitivity.json says, but for the time it took."""
    confidence = config.confidence
    names = ("scenario", "mode", "encounters", "seed")
    settings = {name: getattr(config, name) for name in names} | {"set": list(config.settings)}
    return {
        "schema_version": 2,
        "confidence": confidence,
        "run": None if run is None else _describe(run),
        "quantities": list(shown),
        "sweeps_settings": settings if sweeps else None,
        "sweeps": [collect(sweep, folder / _SWEEPS, confidence) for sweep in sweeps],
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


def _draw(summary: Mapping[str, Any], folder: Path) -> list[str]:
    """Draw the study's figures into its folder and return the names of their files."""
    bars = f"bars: {100.0 * summary['confidence']:g} % intervals (Clopper-Pearson)"
    figures: dict[str, Figure] = {}
    titles = []
    if summary["run"] is not None:
        titles.append(f"{summary['run']['folder']}: {_title(summary['run'], '')}")
        for part in summary["quantities"]:
            figures[part["name"]] = draw_details(part, f"{titles[-1]}\n{bars}")
    if summary["sweeps_settings"] is not None:
        titles.append(f"sweeps: {_title(summary['sweeps_settings'], ' a value')}")
        for part in summary["sweeps"]:
            figures[f"vary_{part['name']}"] = draw_details(part, f"{titles[-1]}\n{bars}")
    every = [*summary["quantities"], *summary["sweeps"]]
    figures["overview"] = overview(every, "\n".join([*titles, bars]))
    return [
        path.name
        for name, figure in figures.items()
        for path in save_figure(figure, folder / name, 130)
    ]


def _title(about: Mapping[str, Any], of_what: str) -> str:
    """Return how many encounters were flown, of what (`` a value``), and how."""
    count, scenario = group_digits(about["encounters"]), scenario_title(str(about.get("scenario")))
    return f"{count} encounters{of_what}, scenario {scenario}, mode {about.get('mode')}"


def _show(part: dict[str, Any]) -> None:
    """Print the success of the run's mode in each bin of a quantity, or of every mode at each value
    of a sweep.
    """
    print(f"{part['label']}:")
    for cell in points_of(part):
        span = (
            f"{cell['low']:g} to {cell['high']:g} {part['unit']}"
            if "low" in cell
            else cell.get("word")
        )
        for mode, success in list(cell["success"].items())[: 1 if span else None]:
            place = f"{span:22}" if span else f"{cell['value']:g} {part['unit']:8} {mode:8}"
            rates = (success["success_given_resolvable"], success["success_rate"])
            of_resolvable, of_all = (percent(rate, "{} % ({} .. {})", "none") for rate in rates)
            bound = f"{100.0 * cell['unresolvable_rate']['value']:.2f} % proven unresolvable"
            print(
                f"  {place} {of_resolvable} of the resolvable, {of_all} of all "
                f"{group_digits(cell['encounters'])}, {bound}"
            )
