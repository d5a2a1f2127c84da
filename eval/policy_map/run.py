"""Advisory map, symmetry and chatter of a policy: ``python -m eval.policy_map --out runs/map``."""

import argparse
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agents.config.load import ConfigError, Parser
from eval.plots import save as picture_folder

if TYPE_CHECKING:
    from agents.policy.inference import Policy
    from envs.aircraft import Aircraft
    from eval.policy_map.advisory import Scene

__all__ = ["HEADINGS", "main"]

HEADINGS = (180.0, -90.0, 90.0, -30.0)  # relative headings of the default columns, degrees counter-clockwise
_MOST_COLUMNS = 8

_DESCRIPTION = """\
Draw what a policy commands: the intruder's place around the ownship (at the origin, heading up), coloured by turn rate
and by acceleration, a column for each relative heading. And measure it: the mirror error (how the decision changes
when left and right change places), the chatter of the commands and the heading reversals of flights.

Written to --out: policy_map.png, policy_map.svg, policy_map.json (contents in docs/howto/failures.md)."""

_EPILOG = """\
examples:
  python -m eval.policy_map --out runs/map
  python -m eval.policy_map --policy runs/best/policy.safetensors --own-speed 60 --intruder-speed 95 --out runs/fast
  python -m eval.policy_map --relative-heading 0 --relative-heading 15 --goal-bearing -60 --out runs/parallel

Angles count counter-clockwise as seen from above, as in the tables of runs: an intruder of relative heading 90 flies to
the left and comes from the right; a goal bearing of 90 is to the left."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw and measure what the command line asks for and return the exit status.

    Raises:
        ConfigError: bad input; so is ``PolicyFileError``.
    """
    options = _parser().parse_args(arguments)
    headings = options.relative_heading or list(HEADINGS)
    from agents.policy.inference import Policy
    from eval.runner.options import check_digest

    policy = Policy.load(options.policy)
    check_digest(options.policy, policy.sha256, options.policy_sha256, "--policy-sha256")
    _check(options, headings, policy.aircraft)
    scenes = _scenes(options, headings)
    out = options.out or Path("runs") / time.strftime("policy_map_%Y%m%d_%H%M%S")
    picture_folder.create(out)

    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        figure, found = _examine(policy, scenes, options)
    picture_folder.write(out, "policy_map", found, figure, dpi=130)
    from eval.policy_map.quality import lines_of

    print("\n".join([*lines_of(found["mirror_error"], found["chatter"]), f"written to {out}"]))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.policy_map", description=_DESCRIPTION, epilog=_EPILOG)

    def add(name: str, kind: Any, metavar: str, help_text: str, **more: Any) -> None:
        parser.add_argument(name, type=kind, metavar=metavar, help=help_text, **more)

    add("--policy", Path, "FILE", "policy file (default: the one that ships)")
    add("--policy-sha256", str, "DIGEST", "SHA-256 that the policy must have (default: any)")
    add("--out", Path, "DIR", "folder, new or empty (default: runs/policy_map_DATE_TIME)")
    add("--own-speed", float, "M/S", "of the ownship (default: 3/4 of its greatest)")
    add("--intruder-speed", float, "M/S", "of the intruder (default: half of the traffic's greatest)")
    add(
        "--relative-heading",
        float,
        "DEG",
        "intruder's heading less the own one, degrees counter-clockwise; may be repeated, a column each "
        "(default: 180, -90, 90 and -30)",
        action="append",
    )
    add(
        "--goal-bearing",
        float,
        "DEG",
        "of the goal from the own heading, degrees counter-clockwise (default: 0)",
        default=0.0,
    )
    add("--goal-distance", float, "M", "of the goal (default: 8 required separations)")
    add("--extent", float, "M", "how far the map reaches to each side (default: 6 required separations)")
    add("--cells", int, "N", "along each side of the map (default: 181)", default=181)
    add("--samples", int, "N", "observations around conflicts for the mirror error (default: 50000)", default=50_000)
    add("--encounters", int, "N", "circle flights for mirror error and chatter (default: 500)", default=500)
    add("--seed", int, "N", "of samples and encounters (default: 0)", default=0)
    return parser


def _check(options: argparse.Namespace, headings: Sequence[float], aircraft: "Aircraft") -> None:
    """Fill in what the aircraft decides, and raise ``ConfigError`` for the first value that is out of its range."""
    limits, unit = aircraft.limits, aircraft.separation
    for name, value in (
        ("own_speed", 0.75 * limits.speed_max),
        ("intruder_speed", 0.5 * aircraft.traffic_speed_max),
        ("goal_distance", 8.0 * unit),
        ("extent", 6.0 * unit),
    ):
        if getattr(options, name) is None:
            setattr(options, name, value)
    ranges: list[tuple[str, float, float, float, str]] = [
        ("--own-speed", options.own_speed, limits.speed_min, limits.speed_max, " m/s"),
        ("--intruder-speed", options.intruder_speed, 0.0, aircraft.traffic_speed_max, " m/s"),
        *(("--relative-heading", heading, -180.0, 180.0, " degrees") for heading in headings),
        ("--goal-bearing", options.goal_bearing, -180.0, 180.0, " degrees"),
        ("--goal-distance", options.goal_distance, 0.0, 20.0 * unit, " m"),
        # The corners must not be farther away than an observation can say.
        ("--extent", options.extent, 1.5 * unit, 14.0 * unit, " m"),
        ("--cells", options.cells, 11, 1_001, ""),
        ("--samples", options.samples, 1, 10_000_000, ""),
        ("--encounters", options.encounters, 1, 10_000, ""),
        ("--seed", options.seed, 0, 2**63, ""),
    ]
    for name, value, low, high, unit in ranges:
        # Inverted, so that NaN is refused.
        if not low <= value <= high:
            raise ConfigError(f"{name}: {value:g}{unit}; expected {low:g} to {high:g}{unit}")
    if len(headings) > _MOST_COLUMNS:
        raise ConfigError(f"--relative-heading: given {len(headings)} times; expected at most {_MOST_COLUMNS}")


def _scenes(options: argparse.Namespace, headings: Sequence[float]) -> "list[Scene]":
    """Return what each column holds fixed."""
    from eval.policy_map.advisory import Scene

    goal = math.radians(options.goal_bearing), options.goal_distance
    return [Scene(options.own_speed, options.intruder_speed, math.radians(heading), *goal) for heading in headings]


def _examine(policy: "Policy", scenes: "Sequence[Scene]", options: argparse.Namespace) -> tuple[Any, dict[str, Any]]:
    """Return the figure and the content of the JSON file."""
    from agents.policy.versions import versions
    from eval.policy_map.advisory import advise, shares
    from eval.policy_map.figure import policy_map
    from eval.policy_map.quality import around_conflicts, chatter, mirror_error, record

    aircraft = policy.aircraft
    limits, separation = aircraft.limits, aircraft.separation
    around = around_conflicts(options.samples, options.seed, aircraft)
    maps = [advise(policy, scene, options.extent, options.cells, aircraft) for scene in scenes]
    flown = record(policy, options.encounters, options.seed, aircraft)
    name = "the shipped policy" if options.policy is None else options.policy.name
    settings = {
        "own_speed_m_s": options.own_speed,
        "intruder_speed_m_s": options.intruder_speed,
        "goal_bearing_deg": options.goal_bearing,
        "goal_distance_m": options.goal_distance,
        "extent_m": options.extent,
        "cells": options.cells,
        "samples": options.samples,
        "encounters": options.encounters,
        "seed": options.seed,
    }
    found = {
        "schema_version": 1,
        "policy_sha256": policy.sha256,
        "separation_m": separation,
        "limits": limits._asdict(),
        "settings": settings,
        "maps": [shares(advisory, aircraft) for advisory in maps],
        "mirror_error": {
            "around conflicts": mirror_error(policy, around, aircraft),
            "on policy": mirror_error(policy, flown.scenes, aircraft),
        },
        "chatter": chatter(flown, aircraft),
        "versions": versions("numpy", "matplotlib"),
    }
    return policy_map(maps, limits, separation, f"{name} ({policy.sha256[:8]})"), found
