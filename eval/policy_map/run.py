"""Advisory map and chatter of a policy: ``python -m eval.policy_map --out runs/map``."""

import argparse
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from agents.config.load import ConfigError, Parser
from agents.policy.inference import Policy
from envs.aircraft import Aircraft
from envs.edge.installation import versions
from eval.plots import save as picture_folder
from eval.policy_map.advisory import FixedStates, advise, chatter
from eval.policy_map.figure import policy_map
from eval.runner.options import check_digest, real, whole

HEADINGS = (
    180.0,
    -90.0,
    90.0,
    -30.0,
)  # relative headings of the default maps, degrees counter-clockwise
_MOST_MAPS = 8

_DESCRIPTION = """\
Draw what a policy commands: the intruder's place around the ownship (at the origin, heading up),
coloured by turn rate and by acceleration, a row for each relative heading. And measure chatter and
heading reversals of flights.

Written to --out: policy_map.png, policy_map.svg, policy_map.json (contents in
docs/howto/failures.md)."""

_EPILOG = """\
examples:
  python -m eval.policy_map --out runs/map
  python -m eval.policy_map --policy runs/best/policy.safetensors --own-speed 60 \\
    --out runs/fast
  python -m eval.policy_map --relative-heading 0 --relative-heading 15 --goal-bearing -60 \\
    --out runs/parallel

Angles count counter-clockwise as seen from above, as in the tables of runs: an intruder of
relative heading 90 flies to the left and comes from the right; a goal bearing of 90 is to the
left."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw and measure a policy and return the exit status; bad input raises ``InputError``."""
    options = _parser().parse_args(arguments)
    policy = Policy.load(options.policy)
    check_digest(options.policy, policy.sha256, options.policy_sha256, "--policy-sha256")
    scenes = _scenes(options, policy.aircraft)
    out = options.out or Path("runs") / time.strftime("policy_map_%Y%m%d_%H%M%S")
    picture_folder.create(out)
    with threadpool_limits(1):
        figure, found = _examine(policy, scenes, options)
    picture_folder.write(out, "policy_map", found, figure)
    print(
        "chatter, {flights} circle flights: yaw rate {yaw_rate_change_deg_s_per_s:.3f} deg/s and "
        "acceleration "
        "{acceleration_change_m_s2_per_s:.3f} m/s^2 per second; heading reversals per flight mean "
        "{mean:.2f}, "
        "95 % {p95:.0f}, max {max:.0f}".format(
            **found["chatter"], **found["chatter"]["reversals_per_flight"]
        )
    )
    print(f"written to {out}")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.policy_map", description=_DESCRIPTION, epilog=_EPILOG)

    def add(
        name: str, kind: Any, metavar: str, help_text: str, default: Any = None, **more: Any
    ) -> None:
        parser.add_argument(
            name, type=kind, metavar=metavar, help=help_text, default=default, **more
        )

    angle = real(-180.0, 180.0, "degrees")
    add("--policy", Path, "FILE", "policy file (default: the one that ships)")
    add("--policy-sha256", str, "DIGEST", "SHA-256 that the policy must have (default: any)")
    add("--out", Path, "DIR", "folder, new or empty (default: runs/policy_map_DATE_TIME)")
    add("--own-speed", float, "M/S", "of the ownship (default: 3/4 of its greatest)")
    add(
        "--intruder-speed",
        float,
        "M/S",
        "of the intruder (default: half of the traffic's greatest)",
    )
    heading = (
        "intruder's less the own one; may be repeated, a row each (default: 180, -90, 90 and -30)"
    )
    add("--relative-heading", angle, "DEG", heading, action="append")
    add("--goal-bearing", angle, "DEG", "of the goal from the own heading (default: 0)", 0.0)
    add("--goal-distance", float, "M", "of the goal (default: 8 required separations)")
    add(
        "--extent",
        float,
        "M",
        "how far the map reaches to each side (default: 6 required separations)",
    )
    add("--cells", whole(11, 1_001), "N", "along each side of the map (default: 181)", 181)
    add("--encounters", whole(1, 10_000), "N", "circle flights for the chatter (default: 500)", 500)
    add("--seed", whole(0, 2**63), "N", "of encounters (default: 0)", 0)
    return parser


def _scenes(options: argparse.Namespace, aircraft: Aircraft) -> list[FixedStates]:
    limits, unit = aircraft.limits, aircraft.separation
    for name, default, low, high, of in (
        ("own_speed", 0.75 * limits.speed_max, limits.speed_min, limits.speed_max, "m/s"),
        (
            "intruder_speed",
            0.5 * aircraft.traffic_speed_max,
            0.0,
            aircraft.traffic_speed_max,
            "m/s",
        ),
        ("goal_distance", 8.0 * unit, 0.0, 20.0 * unit, "m"),
        # The corners must not be farther away than an observation can say.
        ("extent", 6.0 * unit, 1.5 * unit, 14.0 * unit, "m"),
    ):
        value = default if getattr(options, name) is None else getattr(options, name)
        if not low <= value <= high:  # inverted for nan
            said = f"{value:g} {of}; expected {low:g} to {high:g} {of}"
            raise ConfigError(f"--{name.replace('_', '-')}: {said}")
        setattr(options, name, value)
    headings = options.relative_heading or HEADINGS
    if len(headings) > _MOST_MAPS:
        raise ConfigError(
            f"--relative-heading: given {len(headings)} times; expected at most {_MOST_MAPS}"
        )
    goal = math.radians(options.goal_bearing), options.goal_distance
    return [
        FixedStates(options.own_speed, options.intruder_speed, math.radians(heading), *goal)
        for heading in headings
    ]


def _examine(
    policy: Policy, scenes: list[FixedStates], options: argparse.Namespace
) -> tuple[Any, dict[str, Any]]:
    aircraft = policy.aircraft
    maps = [advise(policy, scene, options.extent, options.cells, aircraft) for scene in scenes]
    name = "the shipped policy" if options.policy is None else options.policy.name
    units = {
        "own_speed": "_m_s",
        "intruder_speed": "_m_s",
        "goal_bearing": "_deg",
        "goal_distance": "_m",
    }
    units |= {"extent": "_m", "cells": "", "encounters": "", "seed": ""}
    found = {
        "schema_version": 2,
        "policy_sha256": policy.sha256,
        "separation_m": aircraft.separation,
        "limits": aircraft.limits._asdict(),
        "settings": {f"{key}{unit}": getattr(options, key) for key, unit in units.items()},
        "relative_headings_deg": [
            round(math.degrees(scene.relative_heading), 9) for scene in scenes
        ],
        "chatter": chatter(policy, options.encounters, options.seed, aircraft),
        "versions": versions("numpy", "matplotlib"),
    }
    return policy_map(maps, aircraft, f"{name} ({policy.sha256[:8]})"), found
