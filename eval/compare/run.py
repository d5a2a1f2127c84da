"""Policies and baselines on the same encounters, side by side: ``python -m eval.compare --out
runs/compare``.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from agents.config.load import ConfigError, Parser
from commands.command import whole
from commands.figures import save_figure
from commands.installation import versions
from envs.aircraft import Aircraft
from envs.traffic.model_traffic import ModelTraffic
from envs.traffic.replay import Replay
from eval.compare.config import CompareConfig
from eval.compare.resolvers import (
    Comparison,
    Modes,
    aircraft_of_all,
    baselines_of,
    columns,
    entries_of,
)
from eval.compare.summary import SCHEMA_VERSION, Statistics, draw, show
from eval.config import PREFIXES
from eval.flights.aircraft import describe
from eval.flights.chunks import Evaluation
from eval.flights.simulate import ByPolicy
from eval.flights.sources import describe_tracks, most_intruders, say
from eval.runner.command import Command, FlownNow, Resolved, run
from eval.runner.options import (
    config_option,
    extension_option,
    last_options,
    named_source,
    scenario_option,
)
from eval.runner.outputs import RunFolder

_DESCRIPTION = """\
Fly policies and baselines through the same encounters and say how they differ, with intervals for
paired samples.

Baselines: none (straight along the route), rules (the right-hand rules of the air), mvp (modified
voltage potential, speed held), mvp_speed (the same, changing speed too). A policy is a
.safetensors file of the toolkit, or a .nnet file of HorizontalCAS or ACAS Xu. With --mode plan
its plans, made once at the start, are flown too; with --mode assured its plans under the run-time
monitor.

--baseline witness, flown only when asked for, is a reference, not a resolver: the shortest
known flight that resolves each encounter, found with knowledge of how the intruders will fly. It
takes two minutes for a thousand encounters.

Scenarios are those of eval.monte_carlo: a name, file:PATH, tracks:PATH (recorded tracks,
replayed) or lincoln:PATH. Written to --out: summary.json, encounters.parquet, config.yaml as
resolved, and compare.png, .svg (contents in docs/reference/evaluation-files.md). Ctrl-C keeps the
encounters flown so far, by the hundreds; --resume goes on. The results do not depend on the
workers."""

_EPILOG = """\
examples:
  python -m eval.compare --out runs/compare
  python -m eval.compare --policy runs/a/policy.safetensors --policy runs/b/policy.safetensors \\
    --out runs/a_b
  python -m eval.compare --mode assured --baseline mvp_speed --baseline witness --encounters 300 \\
    --out runs/mark
  python -m eval.compare --scenario tracks:encounters.json --out runs/recorded
  python -m eval.compare --mode assured --set changes.own_speed=[50,70] --out runs/slow

  python -m eval.compare --config runs/a_b/config.yaml --out runs/again          repeat one
  python -m eval.compare --resume --out runs/a_b          go on with one that was interrupted

Every key of --config and --set: docs/reference/configuration-evaluation.md."""


class CompareFolder(RunFolder):
    """The files of one comparison."""

    free = ("workers", "confidence", "resamples")
    model = CompareConfig
    schema = b"compare 1"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparison of the command line and return the exit status; bad input raises
    ``InputError``.
    """
    return run(_COMMAND, _with_lists(_parser().parse_args(arguments)))


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.compare", description=_DESCRIPTION, epilog=_EPILOG)
    add = parser.add_argument
    many: Any = {"action": "append", "default": []}
    config_option(parser, "a comparison")
    add("--help-keys", action="store_true", help="list every key of the configuration, and exit")
    add(
        "--policy",
        type=Path,
        metavar="FILE",
        help="policy file, may be repeated (default: the shipped one)",
        **many,
    )
    add(
        "--policy-sha256",
        metavar="DIGEST",
        help="SHA-256 of each --policy but .nnet files, in their order",
        **many,
    )
    extension_option(parser)
    add(
        "--baseline",
        metavar="NAME",
        help="of those above, may be repeated (default: all but witness)",
        **many,
    )
    add(
        "--mode",
        choices=("plan", "assured"),
        help="another way to fly policies; may be repeated",
        **many,
    )
    scenario_option(parser, *PREFIXES)
    add(
        "--set",
        metavar="KEY=VALUE",
        help="change a key, such as changes.own_speed=[50,70], may be repeated",
        **many,
    )
    add(
        "--repair",
        action="store_const",
        const="true",
        help="drop what is wrong in recorded tracks and accept gaps",
    )
    add(
        "--encounters",
        type=whole(1),
        metavar="N",
        help="how many (default: 1000, or all of a file's)",
    )
    add(
        "--seed",
        type=whole(0),
        metavar="N",
        help="seed of encounters, sensor noise and bootstrap (default: 0)",
    )
    last_options(parser, "compare")
    return parser


def _with_lists(options: argparse.Namespace) -> argparse.Namespace:
    """Return the options with those that may be repeated as values of their keys, in YAML; None:
    not given.
    """
    lists: dict[str, list[str]] = {
        "policies": [str(path.absolute()) for path in options.policy],
        "policies_sha256": [digest.lower() for digest in options.policy_sha256],
        "modes": options.mode,
        "baselines": options.baseline,
    }
    given = {key: json.dumps(values) if values else None for key, values in lists.items()}
    if options.policy and not options.policy_sha256:
        given["policies_sha256"] = "[]"  # those of a file are of its own policies
    unused = {"policy": None, "policy_sha256": None}
    return argparse.Namespace(**vars(options) | unused | given)


def _resolve(config: CompareConfig, _: argparse.Namespace) -> Resolved:
    """Return what a configuration names, ready to be flown, and the configuration as resolved."""
    own_aircraft = None if config.aircraft is None else config.aircraft.aircraft()
    aircraft = aircraft_of_all(config.policies, config.policies_sha256, own_aircraft)
    modes = _modes(config, aircraft)
    entries = entries_of(config.policies, modes, config.baselines, aircraft)
    source, names, resolved = named_source(config, aircraft)
    learned = [entry.resolver for entry in entries if isinstance(entry.resolver, ByPolicy)]
    for resolver in learned:
        resolver.policy.check_intruders(most_intruders(source))
    resolved |= {
        "policies_sha256": tuple(resolver.policy.sha256 for resolver in learned),
        "modes": modes.names,
        "baselines": baselines_of(config.baselines),
    }
    say(source)
    if config.planner.maneuvers != "horizontal" and not config.modes:
        raise ConfigError(
            f"planner.maneuvers is {config.planner.maneuvers!r}; expected horizontal without modes"
        )
    evaluation = Evaluation(None, source, names, config.seed, aircraft)
    comparison = Comparison(entries, evaluation, config.well_clear)
    comparison.starts(0, 1)
    row_bytes = 600 * len(entries)
    return Resolved(comparison, config.model_copy(update=resolved), (), row_bytes)


def _modes(config: CompareConfig, aircraft: Aircraft) -> Modes:
    """Return in which modes, and with which plans, policies are flown too."""
    names = tuple(dict.fromkeys(config.modes))
    if not config.maneuvers:
        return Modes(names, {"": config.planner.options(aircraft)})
    kinds = {
        kind: config.planner.model_copy(update={"maneuvers": kind}) for kind in config.maneuvers
    }
    return Modes(names, {kind: planner.options(aircraft) for kind, planner in kinds.items()})


def _prepare(comparison: Comparison, _: None) -> Comparison:
    """Return what is flown as it is: the entries hold their policies."""
    return comparison


def _outcome(comparison: Comparison) -> str:
    return f"{comparison.entries[0].name}.outcome"


def _summary(table: Mapping[str, Any], resolved: Resolved, flown: FlownNow) -> dict[str, Any]:
    """Return what summary.json says."""
    config: CompareConfig = resolved.config
    comparison: Comparison = resolved.work
    entries, evaluation = comparison.entries, comparison.evaluation
    weighted = bool((table["weight"] != 1.0).any())
    weights = table["weight"] if weighted else None
    statistics = Statistics(
        table,
        weights,
        config.confidence,
        config.resamples,
        config.seed,
        evaluation.aircraft,
        comparison.well_clear,
        in_space=comparison.starts(0, 1)[0].altitudes is not None,
        stratified=isinstance(evaluation.source, ModelTraffic) and bool(evaluation.source.strata),
    )
    keys = ("scenario", "changes", "seed", "confidence", "resamples")
    return {
        "schema_version": SCHEMA_VERSION,
        **{key: getattr(config, key) for key in keys},
        "ahead_s": config.tracks.ahead if isinstance(evaluation.source, Replay) else None,
        "weighted": weighted,
        **statistics.summary(entries),
        **describe_tracks(evaluation.source),
        **describe(evaluation.aircraft, None),
        "versions": versions("numpy", "scipy", "pyarrow"),
        "wall_s": flown.wall_s,
    }


def _draw(
    folder: Path, _: Mapping[str, Any], __: Resolved, summary: Mapping[str, Any]
) -> Sequence[Path]:
    return save_figure(draw(summary), folder / "compare", 130)


_KEYS = {
    "policies": "policies",
    "policies_sha256": "policies_sha256",
    "modes": "modes",
    "baselines": "baselines",
    "encounters": "encounters",
    "seed": "seed",
    "workers": "workers",
    "repair": "tracks.repair",
}
_COMMAND = Command(
    name="compare",
    unit="encounters",
    folder=CompareFolder,
    keys=_KEYS,
    prefix="--",
    resolve=_resolve,
    prepare=_prepare,
    columns=columns,
    summarise=_summary,
    draw=_draw,
    show=show,
    outcome=_outcome,
    names_policy=False,
)
