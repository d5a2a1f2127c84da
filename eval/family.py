"""A policy over a family of random aircraft: ``python -m eval.family --aircraft-seed 0 --count 20
--out runs/family``.

Aircraft of a seed are drawn by number, so that number 3 is the same however many are drawn. Drawn
uniformly: the greatest speed, the time that it takes for one separation, and what makes aircraft
unlike: least speed, both accelerations and the turn circle, in units of separation and greatest
speed.
"""

import argparse
import json
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from agents.policy.domain import TRAFFIC_SPEED
from agents.policy.inference import Policy
from envs.aircraft import ratios
from envs.draws import uniforms
from envs.edge.command import ConfigError, Parser, run_cli
from envs.edge.files import write_file
from eval.stats.intervals import share

if TYPE_CHECKING:
    from agents.config.world import AircraftConfig

FAMILY = {
    "speed_max": (25.0, 240.0),  # m/s
    "time_unit": (
        8.0,
        40.0,
    ),  # separation at the greatest speed, s; alike aircraft differ in nothing by it
    "speed_min": (0.4, 0.75),  # of the greatest
    "acceleration_min": (0.03, 0.4),  # of speed_max^2 / separation, as a deceleration
    "acceleration_max": (0.03, 0.4),
    "turn_radius": (0.3, 2.5),  # of the circle at the greatest speed, separations
}
"""Ranges of what is drawn for each aircraft."""

_MODES = ("policy", "plan", "assured")
_STREAM = 0x6661_6D69  # keeps the draws apart from those of encounters with the same seed
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


def drawn(seed: int, number: int) -> "AircraftConfig":
    """Return an aircraft of a seed by its number."""
    from agents.config.world import AircraftConfig

    u = uniforms(seed, number, 1, (len(FAMILY),), stream=_STREAM)[0]
    of = {
        name: low + (high - low) * float(draw)
        for (name, (low, high)), draw in zip(FAMILY.items(), u, strict=True)
    }
    # Rounded, so that the file says the same aircraft.
    fast, separation = _rounded(of["speed_max"]), _rounded(of["speed_max"] * of["time_unit"])
    unit = fast * fast / separation
    return AircraftConfig(
        speed_min_mps=_rounded(of["speed_min"] * fast),
        speed_max_mps=fast,
        acceleration_min_mps2=_rounded(-of["acceleration_min"] * unit),
        acceleration_max_mps2=_rounded(of["acceleration_max"] * unit),
        yaw_rate_max_deg_s=_rounded(math.degrees(fast / (of["turn_radius"] * separation))),
        separation_m=separation,
    )


def _rounded(value: float) -> float:
    return float(f"{value:.5g}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly the family of the command line and return the exit status; bad input raises
    ``InputError``.
    """
    from agents.config.load import dump
    from eval.monte_carlo.run import run_quietly
    from eval.plots import save as picture_folder
    from eval.runner.options import check_digest

    options = _parser().parse_args(arguments)
    if options.intruders[0] > options.intruders[1]:
        raise ConfigError("--intruders: expected the fewest first, then the most")
    policy = Policy.load(options.policy)
    check_digest(options.policy, policy.sha256, options.policy_sha256, "--policy-sha256")
    aircraft = [drawn(options.aircraft_seed, number) for number in range(options.count)]
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
        status = run_quietly(*_flown(options, one, file), file.with_suffix(""))
        if status:
            return status
        summaries.append(
            json.loads((file.with_suffix("") / "summary.json").read_text(encoding="utf-8"))
        )
    found = _found(options, aircraft, summaries) | {"policy_sha256": policy.sha256}
    picture_folder.write(options.out, "family", found)
    _show(found, options.out)
    return 0


def _parser() -> argparse.ArgumentParser:
    from eval.runner.options import whole

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
    add(
        "--confidence",
        type=float,
        default=0.95,
        metavar="P",
        help="of all intervals (default: 0.95)",
    )
    add(
        "--workers",
        type=whole(0),
        default=0,
        metavar="N",
        help="processes; 0: one for every core (default: 0)",
    )
    add(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="folder for what is written, new or empty",
    )
    return parser


def _flown(
    options: argparse.Namespace, aircraft: "AircraftConfig", file: Path
) -> tuple[dict[str, Any], list[str]]:
    """Return the options and the keys of the run of ``eval.monte_carlo`` with one aircraft."""
    fast = aircraft.speed_max_mps
    speeds = [part * fast for part in TRAFFIC_SPEED]
    changes = {"intruders": options.intruders, "intruder_speed": speeds, "attempts": 200}
    changes |= {"turn_rate_deg_s": aircraft.yaw_rate_max_deg_s} if options.turning else {}
    named = {
        "aircraft": file,
        "mode": options.mode,
        "scenario": "noisy" if options.noisy else "circle",
    }
    named |= {name: getattr(options, name) for name in ("policy", "encounters", "seed", "workers")}
    sets = [f"changes={json.dumps(changes)}", f"confidence={options.confidence}", "resamples=100"]
    return named, [*sets, "allow_outside_domain=true"]


def _found(
    options: argparse.Namespace,
    aircraft: Sequence["AircraftConfig"],
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


if __name__ == "__main__":
    run_cli("eval.family:main")
