"""A policy over a family of random aircraft: ``python -m eval.family --aircraft-seed 0 --count 20
--out runs/family``.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.config.load import ConfigError, Parser, dump
from agents.config.world import AircraftConfig
from agents.policy.domain import TRAFFIC_SPEED
from agents.policy.inference import Policy
from envs.aircraft import ratios
from envs.edge.files import write_file
from envs.scenarios import resolve
from eval.config import PREFIXES
from eval.family.aircraft import draw_aircraft
from eval.monte_carlo.run import evaluate
from eval.plots import save as picture_folder
from eval.runner.command import UnfinishedError
from eval.runner.options import (
    check_digest,
    confidence_option,
    extension_option,
    load_extensions,
    new_folder_option,
    whole,
)
from eval.stats.intervals import share

_MODES = ("policy", "plan", "assured")
_RATES = ("success_rate", "success_given_resolvable", "success_given_solved", "violation_rate")

_DESCRIPTION = """\
Fly a policy with each of a number of random aircraft: greatest speed 25 to 240 m/s, turn circle
0.3 to 2.5 separations, accelerations 0.03 to 0.4 speed_max^2/D, least speed 0.4 to 0.75 and
traffic 0.4 to 1.3 of the greatest.

Written to --out, a new or empty folder: family.json (rates of each aircraft with exact intervals,
their mean and the worst), aircraft_NN.yaml, each to be flown again by eval.monte_carlo
--aircraft, and aircraft_NN, the run of each."""

_EPILOG = """\
examples:
  python -m eval.family --policy runs/set/policy.safetensors --encounters 500 --out runs/family
  python -m eval.family --policy runs/set/policy.safetensors --intruders 2 4 --turning \\
    --out runs/family_turning"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly the family of the command line and return the exit status; bad input raises
    ``InputError``.
    """
    options = _parser().parse_args(arguments)
    if options.intruders[0] > options.intruders[1]:
        raise ConfigError("--intruders: expected the fewest first, then the most")
    if options.noisy and options.scenario != "circle":
        raise ConfigError("--noisy is a scenario of its own; expected it without --scenario")
    if options.scenario.startswith(PREFIXES):
        raise ConfigError(
            f"--scenario: {options.scenario!r} is a file; expected a sampled scenario"
        )
    resolve(options.scenario)
    load_extensions(options.extension)
    policy = Policy.load(options.policy)
    check_digest(options.policy, policy.sha256, options.policy_sha256, "--policy-sha256")
    aircraft = [draw_aircraft(options.aircraft_seed, number) for number in range(options.count)]
    if not options.allow_outside_domain:
        policy.check_intruders(options.intruders[1])
        for one in aircraft:
            policy.for_aircraft(one.aircraft())
    picture_folder.create(options.out)
    summaries = []
    for number, one in enumerate(aircraft):
        file = options.out / f"aircraft_{number:02}.yaml"
        write_file(file, dump(one))
        print(f"aircraft {number} of {options.count}", file=sys.stderr, flush=True)
        try:
            summaries.append(evaluate(_keys(options, one, file), file.with_suffix("")).summary)
        except UnfinishedError as end:
            print(end, file=sys.stderr)
            return end.status
    found = _make_summary(options, aircraft, summaries) | {"policy_sha256": policy.sha256}
    picture_folder.write(options.out, "family", found)
    _show(found, options.out)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.family", description=_DESCRIPTION, epilog=_EPILOG)
    add = parser.add_argument
    add("--policy", type=Path, metavar="FILE", help="policy file (default: the one that ships)")
    add(
        "--policy-sha256", metavar="DIGEST", help="SHA-256 that the policy must have (default: any)"
    )
    add(
        "--allow-outside-domain",
        action="store_true",
        help="fly what the policy was not trained for, too",
    )
    add(
        "--aircraft-seed",
        type=whole(0),
        default=0,
        metavar="N",
        help="of the aircraft (default: 0)",
    )
    add("--count", type=whole(1), default=20, metavar="N", help="of aircraft (default: 20)")
    add(
        "--encounters",
        type=whole(1),
        default=500,
        metavar="N",
        help="of each aircraft (default: 500)",
    )
    add(
        "--seed",
        type=whole(0),
        default=0,
        metavar="N",
        help="of encounters and sensor noise (default: 0)",
    )
    add("--scenario", default="circle", metavar="NAME", help="a sampled scenario (default: circle)")
    kinds = {"type": whole(1), "nargs": 2, "default": [1, 1], "metavar": ("MIN", "MAX")}
    add("--intruders", help="fewest and most intruders of an encounter (default: 1 1)", **kinds)
    add(
        "--turning",
        action="store_true",
        help="let each intruder turn once, at up to the ownship's turn rate",
    )
    add(
        "--noisy",
        action="store_true",
        help="report them with the scenario noisy's errors and latency",
    )
    add("--mode", default="policy", choices=_MODES, help="what decides (default: policy)")
    confidence_option(parser)
    extension_option(parser)
    add(
        "--workers",
        type=whole(0),
        default=0,
        metavar="N",
        help="processes; 0: one for every core (default: 0)",
    )
    new_folder_option(parser)
    return parser


def _keys(options: argparse.Namespace, aircraft: AircraftConfig, file: Path) -> dict[str, Any]:
    """Return the keys of ``eval.monte_carlo`` for the run with one aircraft."""
    fastest = aircraft.speed_max_mps
    changes: dict[str, Any] = {
        "intruders": options.intruders,
        "intruder_speed": [part * fastest for part in TRAFFIC_SPEED],
        "attempts": 200,
    }
    if options.turning:
        changes["turn_rate_deg_s"] = aircraft.yaw_rate_max_deg_s
    return {
        "policy": options.policy,
        "extensions": options.extension,
        "aircraft": file,
        "allow_outside_domain": True,
        "scenario": "noisy" if options.noisy else options.scenario,
        "changes": changes,
        "mode": options.mode,
        "encounters": options.encounters,
        "seed": options.seed,
        "confidence": options.confidence,
        "resamples": 100,
        "workers": options.workers,
    }


def _make_summary(
    options: argparse.Namespace,
    aircraft: Sequence[AircraftConfig],
    summaries: Sequence[Mapping[str, Any]],
) -> dict[str, Any]:
    rows = []
    for number, (one, summary) in enumerate(zip(aircraft, summaries, strict=True)):
        unlike = ratios(one.limits(), one.separation_m)._asdict()
        rows.append({"aircraft": number, "ratios": unlike} | {key: summary[key] for key in _RATES})
    found: dict[str, Any] = {"schema_version": 1, **vars(options)}
    found |= {
        "policy": None if options.policy is None else str(options.policy),
        "out": str(options.out),
        "rows": rows,
    }
    for key in _RATES:
        known = [row for row in rows if row[key]["value"] is not None]
        count, total = (sum(row[key][part] for row in known) for part in ("count", "total"))
        worst = (max if key == "violation_rate" else min)(
            known, key=lambda row: row[key]["value"], default=None
        )
        # Aircraft that differ spread less than one with their mean: the interval is no narrower
        # than it should be.
        found[key] = share(count, total, options.confidence) | {
            "mean": float(np.mean([row[key]["value"] for row in known])) if known else None,
            "worst": None if worst is None else {"aircraft": worst["aircraft"]} | worst[key],
        }
    return found


def _show(found: Mapping[str, Any], out: Path) -> None:
    print(
        f"{'aircraft':>8} {'turn':>6} {'least':>6} {'brake':>6} {'gain':>6}   success of "
        "resolvable, of all, lost"
    )
    for row in found["rows"]:
        speed, brake, gain, turn = row["ratios"].values()
        rates = [
            row[key]["value"]
            for key in ("success_given_resolvable", "success_rate", "violation_rate")
        ]
        cells = "  ".join("      -" if rate is None else f"{rate:7.2%}" for rate in rates)
        print(f"{row['aircraft']:>8} {turn:6.2f} {speed:6.2f} {brake:6.2f} {gain:6.2f}   {cells}")
    for key in _RATES:
        one = found[key]
        if one["mean"] is None:
            continue
        worst = one["worst"]
        print(
            f"{key:26} mean {one['mean']:7.2%} ({one['low']:.2%} .. {one['high']:.2%}), worst "
            f"{worst['value']:7.2%} "
            f"({worst['low']:.2%} .. {worst['high']:.2%}), aircraft {worst['aircraft']}"
        )
    print(f"written to {out}")
