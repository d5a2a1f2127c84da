"""Map of commands and chatter of a policy: ``python -m eval.policy_map --out runs/map``."""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits

from agents.config.load import ConfigError, Parser
from agents.policy.inference import Policy
from commands.command import real, whole
from commands.installation import versions
from eval.plots import save as picture_folder
from eval.policy_map.advisory import FixedStates, advise, chatter
from eval.policy_map.config import MOST_MAPS, PolicyMapConfig
from eval.policy_map.figure import policy_map
from eval.runner.options import (
    config_option,
    default_folder,
    given_policy,
    load_with_options,
    named_policy,
    policy_options,
)

_DESCRIPTION = """\
Draw what a policy commands: the intruder's place around the ownship (at the origin, heading up),
coloured by turn rate and by acceleration, a row for each relative heading. And measure chatter and
heading reversals of flights.

Written to --out: policy_map.png, policy_map.svg, policy_map.json, and config.yaml as resolved
(contents in docs/howto/analyse.md)."""

_EPILOG = """\
examples:
  python -m eval.policy_map --out runs/map
  python -m eval.policy_map --policy runs/best/policy.safetensors --own-speed 60 \\
    --out runs/fast
  python -m eval.policy_map --relative-heading 0 --relative-heading 15 --goal-bearing -60 \\
    --out runs/parallel
  python -m eval.policy_map --config runs/map/config.yaml --out runs/again          repeat one

Angles count counter-clockwise as seen from above, as in the tables of runs: an intruder of
relative heading 90 flies to the left and comes from the right; a goal bearing of 90 is to the
left."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw and measure a policy and return the exit status; bad input raises ``InputError``."""
    options = _parser().parse_args(arguments)
    config = _load(options)
    policy = named_policy(config)
    config = _resolve(config, policy)
    folder = options.out or default_folder("policy_map")
    picture_folder.create(folder, config)
    with threadpool_limits(1):
        figure, summary = _examine(policy, config)
    picture_folder.write(folder, "policy_map", summary, figure)
    print(
        "chatter, {flights} circle flights: yaw rate {yaw_rate_change_deg_s_per_s:.3f} deg/s and "
        "acceleration "
        "{acceleration_change_m_s2_per_s:.3f} m/s^2 per second; heading reversals per flight mean "
        "{mean:.2f}, "
        "95 % {p95:.0f}, max {max:.0f}".format(
            **summary["chatter"], **summary["chatter"]["reversals_per_flight"]
        )
    )
    print(f"written to {folder}")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.policy_map", description=_DESCRIPTION, epilog=_EPILOG)
    add = parser.add_argument
    angle = real(-180.0, 180.0, "degrees")
    config_option(parser, "a map")
    policy_options(parser)
    folder = "folder, new or empty (default: runs/policy_map_DATE_TIME)"
    add("--out", type=Path, metavar="DIR", help=folder)
    own = "speed of the ownship (default: 3/4 of its greatest)"
    add("--own-speed", type=float, metavar="M/S", help=own)
    intruder = "speed of the intruder (default: half of the traffic's greatest)"
    add("--intruder-speed", type=float, metavar="M/S", help=intruder)
    heading = (
        "intruder's minus the own one; may be repeated, a row each (default: 180, -90, 90 and -30)"
    )
    add("--relative-heading", type=angle, metavar="DEG", help=heading, action="append")
    bearing = "bearing of the goal from the own heading (default: 0)"
    add("--goal-bearing", type=angle, metavar="DEG", help=bearing)
    distance = "distance of the goal (default: 8 required separations)"
    add("--goal-distance", type=float, metavar="M", help=distance)
    extent = "how far the map reaches to each side (default: 6 required separations)"
    add("--extent", type=float, metavar="M", help=extent)
    cells = "cells along each side of the map (default: 181)"
    add("--cells", type=whole(11, 1_001), metavar="N", help=cells)
    circle = "circle flights for the chatter (default: 500)"
    add("--encounters", type=whole(1, 10_000), metavar="N", help=circle)
    add("--seed", type=whole(0), metavar="N", help="seed of the encounters (default: 0)")
    return parser


def _load(options: argparse.Namespace) -> PolicyMapConfig:
    """Return the configuration of a file under what the command line says."""
    headings = options.relative_heading
    if headings is not None and len(headings) > MOST_MAPS:
        raise ConfigError(
            f"--relative-heading: given {len(headings)} times; expected at most {MOST_MAPS}"
        )
    names = ("own_speed", "intruder_speed", "goal_bearing", "goal_distance", "extent", "cells")
    settings = {name: getattr(options, name) for name in (*names, "encounters", "seed")}
    settings |= {"relative_headings": headings} | given_policy(options)
    return load_with_options(PolicyMapConfig, options.config, settings)


class _Range(NamedTuple):
    """What a key of the map may be; units as of the key."""

    default: float
    low: float
    high: float
    unit: str


def _resolve(config: PolicyMapConfig, policy: Policy) -> PolicyMapConfig:
    """Return a configuration with the policy's digest, and with speeds and distances of the
    policy's aircraft where it leaves them open; ``ConfigError``: one is out of range.
    """
    aircraft, unit = policy.aircraft, policy.aircraft.separation
    slowest, fastest = aircraft.limits.speed_min, aircraft.limits.speed_max
    traffic = aircraft.traffic_speed_max
    ranges = {
        "own_speed": _Range(0.75 * fastest, slowest, fastest, "m/s"),
        "intruder_speed": _Range(0.5 * traffic, 0.0, traffic, "m/s"),
        "goal_distance": _Range(8.0 * unit, 0.0, 20.0 * unit, "m"),
        # The corners must not be farther away than an observation can say.
        "extent": _Range(6.0 * unit, 1.5 * unit, 14.0 * unit, "m"),
    }
    resolved: dict[str, Any] = {"policy_sha256": policy.sha256}
    for name, (default, low, high, of) in ranges.items():
        value = default if getattr(config, name) is None else getattr(config, name)
        if not low <= value <= high:  # inverted for nan
            problem = f"{value:g} {of}; expected {low:g} to {high:g} {of}"
            raise ConfigError(f"--{name.replace('_', '-')}: {problem}")
        resolved[name] = value
    return config.model_copy(update=resolved)


def _scenes(config: PolicyMapConfig) -> list[FixedStates]:
    """Return what each map of a configuration, as resolved, holds fixed."""
    own, intruder, away = config.own_speed, config.intruder_speed, config.goal_distance
    assert own is not None
    assert intruder is not None
    assert away is not None
    bearing = math.radians(config.goal_bearing)
    return [
        FixedStates(own, intruder, math.radians(heading), bearing, away)
        for heading in config.relative_headings
    ]


def _examine(policy: Policy, config: PolicyMapConfig) -> tuple[Figure, dict[str, Any]]:
    """Return the figure of the maps, and what policy_map.json says."""
    aircraft, extent = policy.aircraft, config.extent
    assert extent is not None  # it is resolved
    scenes = _scenes(config)
    maps = [advise(policy, scene, extent, config.cells, aircraft) for scene in scenes]
    name = "the shipped policy" if config.policy is None else config.policy.name
    units = {
        "own_speed": "_m_s",
        "intruder_speed": "_m_s",
        "goal_bearing": "_deg",
        "goal_distance": "_m",
        "extent": "_m",
        "cells": "",
        "encounters": "",
        "seed": "",
    }
    summary = {
        "schema_version": 2,
        "policy_sha256": policy.sha256,
        "separation_m": aircraft.separation,
        "limits": aircraft.limits._asdict(),
        "settings": {f"{key}{unit}": getattr(config, key) for key, unit in units.items()},
        "relative_headings_deg": [
            round(math.degrees(scene.relative_heading), 9) for scene in scenes
        ],
        "chatter": chatter(policy, config.encounters, config.seed, aircraft),
        "versions": versions("numpy", "matplotlib"),
    }
    return policy_map(maps, aircraft, f"{name} ({policy.sha256[:8]})"), summary
