"""Policies and baselines on the same encounters, side by side: ``python -m eval.compare --out
runs/compare``.
"""

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from threadpoolctl import threadpool_limits

from agents.config.load import Parser
from commands.command import whole
from commands.figures import save_figure
from commands.files import check_space, write_whole
from commands.installation import versions
from envs.traffic.replay import Replay
from eval.compare.config import CompareConfig
from eval.compare.resolvers import (
    BASELINE,
    WITNESS,
    Comparison,
    aircraft_of_all,
    columns,
    entries_of,
)
from eval.compare.summary import SCHEMA_VERSION, Statistics, draw, show
from eval.flights.aircraft import describe
from eval.flights.chunks import Evaluation
from eval.flights.simulate import ByPolicy
from eval.flights.sources import describe_tracks, most_intruders, say
from eval.plots import save as picture_folder
from eval.runner.command import Encounters
from eval.runner.options import (
    config_option,
    default_folder,
    extension_option,
    load_config,
    named_source,
    resume_option,
)
from eval.runner.outputs import arrow_table
from eval.runner.parts import PartsFolder

_CHUNK = 500  # encounters that are flown and stored together
_CHUNK_OF_WITNESSES = 100  # the same where witnesses are searched for: progress is to be seen

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
resolved, and compare.png, .svg (contents in docs/howto/compare.md). Ctrl-C keeps the encounters
flown so far, by the hundreds; --resume goes on."""

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


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparison of the command line and return the exit status; bad input raises
    ``InputError``.
    """
    options = _parser().parse_args(arguments)
    begun = time.perf_counter()
    config, comparison = _prepare(_load(options))
    total, out = config.default_count, options.out or default_folder("compare")
    # Figure, and rows of an entry twice, as parts and in the table, generously.
    check_space(out, 1_000_000 + 600 * total * len(comparison.entries), "the rows")
    folder = PartsFolder(out, config, "compare", free=("confidence", "resamples"))
    folder.begin(resume=options.resume)
    say(comparison.evaluation.source)
    with folder:
        # One thread: the network's rows would be rounded otherwise with another.
        with threadpool_limits(1):
            table = _fly(comparison, total, folder)
        summary = _summary(config, comparison, table) | {"wall_s": time.perf_counter() - begun}
        picture_folder.write(out, "summary", summary)
        with write_whole(out / "encounters.parquet") as path:
            pq.write_table(arrow_table(table), path)
        save_figure(draw(summary), out / "compare", 130)
    show(summary, out)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.compare", description=_DESCRIPTION, epilog=_EPILOG)
    add = parser.add_argument
    many: Any = {"action": "append", "default": []}
    config_option(parser, "a comparison")
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
    add(
        "--scenario",
        metavar="NAME",
        help="a name, file:PATH, tracks:PATH or lincoln:PATH (default: circle)",
    )
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
        help="drop and fill what is wrong in recorded tracks",
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
    resume_option(parser)
    add(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder, new or empty (default: runs/compare_DATE_TIME)",
    )
    return parser


def _load(options: argparse.Namespace) -> CompareConfig:
    """Return the configuration of a file under what the command line says."""
    lists: dict[str, list[str]] = {
        "policies": [str(path.absolute()) for path in options.policy],
        "policies_sha256": [digest.lower() for digest in options.policy_sha256],
        "modes": options.mode,
        "baselines": options.baseline,
    }
    given = {key: json.dumps(values) for key, values in lists.items() if values}
    if options.policy:  # the digests of a file are those of its own policies
        given = {"policies_sha256": "[]"} | given
    keys = {"encounters": "encounters", "seed": "seed", "repair": "tracks.repair"}
    keys |= {key: key for key in given}
    unused = {"policy": None, "policy_sha256": None}
    return load_config(
        CompareConfig, argparse.Namespace(**vars(options) | unused | given), keys, "--"
    )


def _prepare(config: CompareConfig) -> tuple[CompareConfig, Comparison]:
    """Return a configuration as resolved, and what it names."""
    aircraft = aircraft_of_all(config.policies, config.policies_sha256)
    entries = entries_of(config.policies, config.modes, config.baselines, aircraft)
    source, names, resolved = named_source(config, aircraft)
    learned = [entry.resolver for entry in entries if isinstance(entry.resolver, ByPolicy)]
    for resolver in learned:
        resolver.policy.check_intruders(most_intruders(source))
    resolved |= {
        "policies_sha256": tuple(resolver.policy.sha256 for resolver in learned),
        "modes": tuple(dict.fromkeys(config.modes)),
        "baselines": tuple(entry.name for entry in entries if entry.kind in (BASELINE, WITNESS)),
    }
    evaluation = Evaluation(None, source, names, config.seed, aircraft)
    return config.model_copy(update=resolved), Comparison(entries, evaluation)


def _fly(comparison: Comparison, total: int, folder: PartsFolder) -> dict[str, np.ndarray]:
    """Return the table of all encounters, of which chunks that are stored are not flown again."""
    witness = any(entry.kind == WITNESS for entry in comparison.entries)
    chunk = _CHUNK_OF_WITNESSES if witness else _CHUNK
    parts = []
    with Encounters(total) as progress:
        for first in range(0, total, chunk):
            size = min(chunk, total - first)
            parts.append(folder.part(f"{first:09d}", partial(columns, comparison, first, size)))
            outcome = parts[-1][f"{comparison.entries[0].name}.outcome"]
            progress.advance(size, int(np.count_nonzero(outcome == "reached")))
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _summary(
    config: CompareConfig, comparison: Comparison, table: Mapping[str, np.ndarray]
) -> dict[str, Any]:
    """Return what summary.json says, but for the time it took."""
    entries, evaluation = comparison
    weighted = bool((table["weight"] != 1.0).any())
    weights = table["weight"] if weighted else None
    found = Statistics(
        table, weights, config.confidence, config.resamples, config.seed, evaluation.aircraft
    )
    keys = ("scenario", "changes", "seed", "confidence", "resamples")
    return {
        "schema_version": SCHEMA_VERSION,
        **{key: getattr(config, key) for key in keys},
        "ahead_s": config.tracks.ahead if isinstance(evaluation.source, Replay) else None,
        "weighted": weighted,
        **found.summary(entries),
        **describe_tracks(evaluation.source),
        **describe(evaluation.aircraft, None),
        "versions": versions("numpy", "scipy", "pyarrow"),
    }
