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
    _check(options, headings)
    from agents.policy.inference import Policy
    from eval.runner.options import check_digest

    policy = Policy.load(options.policy)
    check_digest(options.policy, policy.sha256, options.policy_sha256, "--policy-sha256")
    scenes = _scenes(options, headings, policy)
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
    add("--own-speed", float, "M/S", "of the ownship (default: 75)", default=75.0)
    add("--intruder-speed", float, "M/S", "of the intruder (default: 75)", default=75.0)
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
    add("--goal-distance", float, "M", "of the goal (default: 8000)", default=8_000.0)
    add("--extent", float, "M", "how far the map reaches to each side (default: 6000)", default=6_000.0)
    add("--cells", int, "N", "along each side of the map (default: 181)", default=181)
    add("--samples", int, "N", "observations around conflicts for the mirror error (default: 50000)", default=50_000)
    add("--encounters", int, "N", "circle flights for mirror error and chatter (default: 500)", default=500)
    add("--seed", int, "N", "of samples and encounters (default: 0)", default=0)
    return parser


def _check(options: argparse.Namespace, headings: Sequence[float]) -> None:
    """Raise ``ConfigError`` for the first value that is out of its range; the own speed's is the policy's affair."""
    ranges: list[tuple[str, float, float, float, str]] = [
        ("--intruder-speed", options.intruder_speed, 0.0, 150.0, " m/s"),
        *(("--relative-heading", heading, -180.0, 180.0, " degrees") for heading in headings),
        ("--goal-bearing", options.goal_bearing, -180.0, 180.0, " degrees"),
        ("--goal-distance", options.goal_distance, 0.0, 20_000.0, " m"),
        # The corners must not be farther away than an observation can say.
        ("--extent", options.extent, 1_500.0, 14_000.0, " m"),
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


def _scenes(options: argparse.Namespace, headings: Sequence[float], policy: "Policy") -> "list[Scene]":
    """Return what each column holds fixed."""
    from eval.policy_map.advisory import Scene

    low, high = policy.limits.speed_min, policy.limits.speed_max
    if not low <= options.own_speed <= high:
        raise ConfigError(f"--own-speed: {options.own_speed:g} m/s; expected {low:g} to {high:g} m/s")
    goal = math.radians(options.goal_bearing), options.goal_distance
    return [Scene(options.own_speed, options.intruder_speed, math.radians(heading), *goal) for heading in headings]


def _examine(policy: "Policy", scenes: "Sequence[Scene]", options: argparse.Namespace) -> tuple[Any, dict[str, Any]]:
    """Return the figure and the content of the JSON file."""
    from agents.policy.versions import versions
    from envs.outcome import RULES
    from eval.policy_map.advisory import advise, shares
    from eval.policy_map.figure import policy_map
    from eval.policy_map.quality import around_conflicts, chatter, mirror_error, record

    limits = policy.limits
    maps = [advise(policy.rowwise, scene, options.extent, options.cells, limits) for scene in scenes]
    flown = record(policy.rowwise, options.encounters, options.seed, limits)
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
        "separation_m": RULES.separation,
        "limits": limits._asdict(),
        "settings": settings,
        "maps": [shares(advisory, RULES.separation) for advisory in maps],
        "mirror_error": {
            "around conflicts": mirror_error(policy.rowwise, around_conflicts(options.samples, options.seed), limits),
            "on policy": mirror_error(policy.rowwise, flown.seen, limits),
        },
        "chatter": chatter(flown, limits),
        "versions": versions("numpy", "matplotlib"),
    }
    return policy_map(maps, limits, RULES.separation, f"{name} ({policy.sha256[:8]})"), found
