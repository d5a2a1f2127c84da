"""A policy over a family of random aircraft: ``python -m eval.family --aircraft-seed 0 --count 20
--out runs/family``.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.config.load import Parser, dump
from agents.config.world import AircraftConfig
from agents.policy.domain import TRAFFIC_SPEED
from commands.command import whole
from commands.files import write_file
from envs.aircraft import ratios
from envs.scenarios import resolve
from eval.family.aircraft import draw_aircraft
from eval.family.config import FamilyConfig
from eval.monte_carlo.run import evaluate
from eval.plots import save as picture_folder
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
    scenario_option,
    workers_option,
)
from eval.runner.outputs import ResumableFolder
from eval.stats.intervals import share

_MODES = ("policy", "plan", "assured")
_RATES = ("success_rate", "success_given_resolvable", "success_given_solved", "violation_rate")


class FamilyFolder(ResumableFolder):
    """The folder of a family, with the runs of its aircraft."""

    free = ("policy", "confidence", "workers")
    parts = "."


_DESCRIPTION = """\
Fly a policy with each of a number of random aircraft: greatest speed 25 to 240 m/s, turn circle
0.3 to 2.5 separations, accelerations 0.03 to 0.4 speed_max^2/D, least speed 0.4 to 0.75 and
traffic 0.4 to 1.3 of the greatest.

Written to --out, a new or empty folder: family.json (rates of each aircraft with exact intervals,
their mean and the worst), config.yaml as resolved, aircraft_NN.yaml, each to be flown again by
eval.monte_carlo --aircraft, and aircraft_NN, the run of each. Ctrl-C keeps what was flown; --resume
goes on."""

_EPILOG = """\
examples:
  python -m eval.family --policy runs/set/policy.safetensors --encounters 500 --out runs/family
  python -m eval.family --policy runs/set/policy.safetensors --intruders 2 4 --turning \\
    --out runs/family_turning
  python -m eval.family --config runs/family/config.yaml --out runs/again          repeat one
  python -m eval.family --resume --out runs/family          go on with one that was interrupted

Every key of --config: docs/reference/configuration-evaluation.md."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly the family of the command line and return the exit status; bad input raises
    ``InputError``.
    """
    options = _parser().parse_args(arguments)
    config = _load(options)
    resolve(config.scenario)
    load_extensions(config.extensions)
    policy = named_policy(config)
    config = config.model_copy(update={"policy_sha256": policy.sha256})
    aircraft = [draw_aircraft(config.aircraft_seed, number) for number in range(config.count)]
    if not config.allow_outside_domain:
        policy.check_intruders(config.intruders[1])
        for member in aircraft:
            policy.for_aircraft(member.aircraft())
    picture_folder.check_room(options.out)
    FamilyFolder(options.out, config).begin(resume=options.resume)
    try:
        summaries = _fly(config, aircraft, options.out, resume=options.resume)
    except UnfinishedError as end:
        print(
            f"{end}Go on with: python -m eval.family --resume --out {options.out}", file=sys.stderr
        )
        return end.status
    summary = _make_summary(config, aircraft, summaries) | {"out": str(options.out)}
    picture_folder.write(options.out, "family", summary)
    _show(summary, options.out)
    return 0


def _load(options: argparse.Namespace) -> FamilyConfig:
    """Return the configuration of a file under what the command line says."""
    names = ("allow_outside_domain", "aircraft_seed", "count", "encounters", "seed", "scenario")
    names += ("intruders", "turning", "noisy", "mode", "confidence", "workers")
    settings = {name: getattr(options, name) for name in names}
    settings |= {"extensions": options.extension or None} | given_policy(options)
    return load_with_options(FamilyConfig, config_file(options), settings)


def _fly(
    config: FamilyConfig, aircraft: Sequence[AircraftConfig], folder: Path, *, resume: bool
) -> list[Mapping[str, Any]]:
    """Fly the run of every aircraft below a folder, or what is missing, and return the summaries;
    the first that does not finish raises ``UnfinishedError``.
    """
    summaries = []
    for number, member in enumerate(aircraft):
        file = folder / f"aircraft_{number:02}.yaml"
        write_file(file, dump(member))
        print(f"aircraft {number} of {config.count}", file=sys.stderr, flush=True)
        run = evaluate(_keys(config, member, file), file.with_suffix(""), resume=resume)
        summaries.append(run.summary)
    return summaries


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.family", description=_DESCRIPTION, epilog=_EPILOG)
    add = parser.add_argument
    flag: Any = {"action": "store_const", "const": True}
    config_option(parser, "a family")
    policy_options(parser)
    add(
        "--allow-outside-domain",
        **flag,
        help="fly what the policy was not trained for, too",
    )
    add(
        "--aircraft-seed",
        type=whole(0),
        metavar="N",
        help="seed of the aircraft (default: 0)",
    )
    add("--count", type=whole(1), metavar="N", help="number of aircraft (default: 20)")
    add(
        "--encounters",
        type=whole(1),
        metavar="N",
        help="encounters of each aircraft (default: 500)",
    )
    add(
        "--seed",
        type=whole(0),
        metavar="N",
        help="seed of encounters and sensor noise (default: 0)",
    )
    scenario_option(parser)
    kinds: Any = {"type": whole(1), "nargs": 2, "metavar": ("MIN", "MAX")}
    add("--intruders", help="fewest and most intruders of an encounter (default: 1 1)", **kinds)
    add(
        "--turning",
        **flag,
        help="let each intruder turn once, at up to the ownship's turn rate",
    )
    add(
        "--noisy",
        **flag,
        help="report them with the scenario noisy's errors and latency",
    )
    add("--mode", choices=_MODES, help="what decides (default: policy)")
    confidence_option(parser)
    extension_option(parser)
    workers_option(parser)
    resume_option(parser)
    new_folder_option(parser)
    return parser


def _keys(config: FamilyConfig, aircraft: AircraftConfig, file: Path) -> dict[str, Any]:
    """Return the keys of ``eval.monte_carlo`` for the run with one aircraft."""
    fastest = aircraft.speed_max_mps
    changes: dict[str, Any] = {
        "intruders": config.intruders,
        "intruder_speed": [part * fastest for part in TRAFFIC_SPEED],
        "attempts": 200,
    }
    if config.turning:
        changes["turn_rate_deg_s"] = aircraft.yaw_rate_max_deg_s
    return {
        "policy": config.policy,
        "extensions": config.extensions,
        "aircraft": file,
        "allow_outside_domain": True,
        "scenario": "noisy" if config.noisy else config.scenario,
        "changes": changes,
        "mode": config.mode,
        "encounters": config.encounters,
        "seed": config.seed,
        "confidence": config.confidence,
        "resamples": 100,
        "workers": config.workers,
    }


def _make_summary(
    config: FamilyConfig,
    aircraft: Sequence[AircraftConfig],
    summaries: Sequence[Mapping[str, Any]],
) -> dict[str, Any]:
    """Return what family.json says, but for the folder."""
    rows = []
    for number, (member, summary) in enumerate(zip(aircraft, summaries, strict=True)):
        unlike = ratios(member.limits(), member.separation_m)._asdict()
        rows.append({"aircraft": number, "ratios": unlike} | {key: summary[key] for key in _RATES})
    settings = config.model_dump(mode="json")
    settings["extension"] = settings.pop("extensions")
    family: dict[str, Any] = {"schema_version": 1, **settings, "rows": rows}
    for key in _RATES:
        measured = [row for row in rows if row[key]["value"] is not None]
        count, total = (sum(row[key][part] for row in measured) for part in ("count", "total"))
        worst = (max if key == "violation_rate" else min)(
            measured, key=lambda row: row[key]["value"], default=None
        )
        # Aircraft that differ spread less than one with their mean: the interval is no narrower
        # than it should be.
        family[key] = share(count, total, config.confidence) | {
            "mean": float(np.mean([row[key]["value"] for row in measured])) if measured else None,
            "worst": None if worst is None else {"aircraft": worst["aircraft"]} | worst[key],
        }
    return family


def _show(family: Mapping[str, Any], folder: Path) -> None:
    print(
        f"{'aircraft':>8} {'turn':>6} {'least':>6} {'brake':>6} {'gain':>6}   success of "
        "resolvable, of all, lost"
    )
    for row in family["rows"]:
        speed, brake, gain, turn = row["ratios"].values()
        rates = [
            row[key]["value"]
            for key in ("success_given_resolvable", "success_rate", "violation_rate")
        ]
        cells = "  ".join("      -" if rate is None else f"{rate:7.2%}" for rate in rates)
        print(f"{row['aircraft']:>8} {turn:6.2f} {speed:6.2f} {brake:6.2f} {gain:6.2f}   {cells}")
    for key in _RATES:
        rate = family[key]
        if rate["mean"] is None:
            continue
        worst = rate["worst"]
        print(
            f"{key:26} mean {rate['mean']:7.2%} ({rate['low']:.2%} .. {rate['high']:.2%}), worst "
            f"{worst['value']:7.2%} "
            f"({worst['low']:.2%} .. {worst['high']:.2%}), aircraft {worst['aircraft']}"
        )
    print(f"written to {folder}")
