"""Where the shipped policy keeps its side under small errors: ``python -m eval.policy_map.local
--out runs/local``.
"""

import argparse
import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from agents.policy.inference import Policy, check_one_layer
from commands.command import Parser, run_cli
from commands.files import write_file
from eval.plots.cells import COURSES, RATIOS, cells_figure
from eval.policy_map.proof import Scenes, answers, box_of, decide
from eval.stats.intervals import share

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from eval.policy_map.config import LocalConfig

ANSWERS = ("verified", "counterexample", "open")
QUESTIONS = ("side", "toward")

_DESCRIPTION = """\
Ask box by box what a policy does with one intruder whose reported state is wrong by up to
--position and --velocity on each axis: may the error flip the side of the commanded turn
("side"), and may the policy then turn toward the side on which the intruder will pass on straight
courses ("toward")? A turn of less than --allowed does not count.

Boxes lie about scenes whose separation is lost in --loss seconds on straight courses, drawn
evenly over the cells (difference of the courses, ratio of the speeds) and in each over speeds,
courses, time, miss distance and goal. A box is verified by bounds of all of the policy, from the
state to the turn; or has a counterexample, an exact scene that the policy answered; or stays open
after --depth cuts in two.

Written to --out: local.json, config.yaml as resolved, and the map local.png and .svg; what they
mean: docs/howto/analyse.md."""

_EPILOG = """\
examples:
  python -m eval.policy_map.local --boxes 100 --out runs/local
  python -m eval.policy_map.local --course 135 180 --position 10 --velocity 1 --out runs/head_on
  python -m eval.policy_map.local --config runs/local/config.yaml --out runs/again    repeat one"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Examine what the command line asks for and return the exit status; bad input raises
    ``InputError``.
    """
    from threadpoolctl import threadpool_limits

    from eval.plots import save as picture_folder
    from eval.runner.options import default_folder, named_policy

    options = _parser().parse_args(arguments)
    config = _load(options)
    policy = named_policy(config)
    check_one_layer(policy)
    config = config.model_copy(update={"policy_sha256": policy.sha256})
    folder = options.out or default_folder("local")
    picture_folder.create(folder, config)
    with threadpool_limits(1):
        summary = examine(policy, config, folder)
    picture_folder.write(folder, "local", summary, _figure(summary))
    for name in QUESTIONS:
        parts = (f"{100.0 * summary[name][answer]['value']:.1f} % {answer}" for answer in ANSWERS)
        print(f"{name}: {', '.join(parts)} of {config.boxes} boxes")
    print(f"written to {folder}")
    return 0


def examine(policy: Policy, config: "LocalConfig", folder: Path) -> dict[str, Any]:
    """Return shares of the answers, of all boxes and of each cell; what other verifiers read is
    written into the folder.
    """
    scenes, cell, names = draw(policy, config)
    half = np.repeat(
        [config.position / policy.aircraft.separation, config.velocity / policy.limits.speed_max],
        2,
    )
    away, toward = -np.where(answers(policy, scenes) < 0.0, -1.0, 1.0), passing_side(scenes)
    how: dict[str, Any] = {"allowed": config.allowed, "depth": config.depth, "seed": config.seed}
    decided = dict.fromkeys(QUESTIONS, decide(policy, scenes, half, away, **how))
    # Where both questions forbid the same turn, one answer serves.
    differ = np.flatnonzero(away != toward)
    decided["toward"] = decided["side"].copy()
    part = scenes._make(field[differ] for field in scenes)
    if len(differ):
        decided["toward"][differ] = decide(policy, part, half, toward[differ], **how)
    if config.vnnlib:
        part = scenes._make(field[: config.vnnlib] for field in scenes)
        _write_vnnlib(folder, policy, part, half / 4.0, away, config.allowed)

    def shares(chosen: np.ndarray) -> dict[str, Any]:
        return {
            name: {
                answer: share(np.sum(of[chosen] == i), np.sum(chosen))
                for i, answer in enumerate(ANSWERS)
            }
            for name, of in decided.items()
        }

    keys = ("boxes", "course", "loss", "position", "velocity", *how)
    settings = config.model_dump(mode="json")
    return {
        "schema_version": 1,
        "policy_sha256": policy.sha256,
        "settings": {name: settings[name] for name in keys},
        **shares(np.ones(len(cell), bool)),
        "cells": [{"name": name, **shares(cell == number)} for number, name in enumerate(names)],
    }


def draw(policy: Policy, config: "LocalConfig") -> tuple[Scenes, np.ndarray, list[str]]:
    """Return scenes spread evenly over the cells, the cell of each, and the names of the cells."""
    low, high = config.course
    edges = [low, *(edge for edge in COURSES if low < edge < high), high]
    cells = [(course, ratio) for course in pairwise(edges) for ratio in pairwise(RATIOS)]
    names = ["{:g} to {:g} deg/{:g} to {:g}".format(*course, *ratio) for course, ratio in cells]
    random, count = np.random.default_rng(config.seed), config.boxes
    cell = np.arange(count) % len(cells)
    (from_course, to_course), (from_ratio, to_ratio) = np.array(cells)[cell].transpose(1, 2, 0)
    pace, intruder_pace = _draw_speeds(policy, from_ratio, to_ratio, random)
    course = np.radians(random.uniform(from_course, to_course)) * random.choice([-1.0, 1.0], count)
    velocity = intruder_pace[:, None] * np.stack([np.cos(course), np.sin(course)], axis=-1)
    # Back from where the separation is lost: time to the loss, and miss distance on straight
    # courses.
    way = velocity - np.stack([pace, 0.0 * pace], axis=-1)
    ahead = way / np.hypot(*way.T)[:, None]
    fast, unit = policy.limits.speed_max, policy.aircraft.separation
    soonest, latest = (seconds * fast / unit for seconds in config.loss)
    miss, time = random.uniform(-1.0, 1.0, count), random.uniform(soonest, latest, count)
    lost = miss[:, None] * ahead[:, ::-1] * [-1.0, 1.0] - np.sqrt(1.0 - miss**2)[:, None] * ahead
    bearing = random.uniform(-0.5 * math.pi, 0.5 * math.pi, count)
    distance = random.uniform(2.0, 20.0, count)
    goal = distance[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    state = np.concatenate([lost - way * time[:, None], velocity], axis=-1)
    return Scenes(pace, goal, state), cell, names


def _draw_speeds(
    policy: Policy, from_ratio: np.ndarray, to_ratio: np.ndarray, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return own and intruders' speeds within the policy's domain, in the ownship's greatest, whose
    ratios lie between two, ``[N]`` each.
    """
    fast, count = policy.limits.speed_max, len(from_ratio)
    slowest, fastest = (end / fast for end in policy.domain["intruder_speed"])
    pace, intruder_pace, wrong = np.zeros(count), np.zeros(count), np.ones(count, dtype=bool)
    while wrong.any():
        pace = np.where(wrong, random.uniform(policy.limits.speed_min / fast, 1.0, count), pace)
        intruder_pace = np.where(wrong, pace * random.uniform(from_ratio, to_ratio), intruder_pace)
        wrong = ~((slowest <= intruder_pace) & (intruder_pace <= fastest))
    return pace, intruder_pace


def passing_side(scenes: Scenes) -> np.ndarray:
    """Return the side on which the intruder will pass on straight courses, 1: left, -1: right,
    ``[N]``.
    """
    x, y, vx, vy = scenes.state.T
    vx = vx - scenes.pace
    return np.where(y - vy * (x * vx + y * vy) / (vx * vx + vy * vy) < 0.0, -1.0, 1.0)


def _write_vnnlib(
    folder: Path, policy: Policy, scenes: Scenes, half: np.ndarray, away: np.ndarray, allowed: float
) -> None:
    """Write the network behind its derived inputs as ONNX, and boxes of these in which it may turn
    as is forbidden.

    A box is of a scene with a part of the error; a verifier that finds it unsatisfiable says
    *verified*.
    """
    from agents.learning.onnx import network_part

    write_file(folder / "network.onnx", network_part(policy).SerializeToString(deterministic=True))
    inputs, sign = box_of(policy, scenes, half)
    for number, (low, high) in enumerate(zip(*inputs.ends, strict=True)):
        declared = [f"(declare-const X_{i} Real)" for i in range(len(low))] + [
            f"(declare-const Y_{i} Real)" for i in (0, 1)
        ]
        ends = [
            f"(assert (>= X_{i} {a - 1e-9:.9f}))\n(assert (<= X_{i} {b + 1e-9:.9f}))"
            for i, (a, b) in enumerate(zip(low, high, strict=True))
        ]
        side = sign[number] * away[number]
        wrong = f"(assert ({'>=' if side > 0.0 else '<='} Y_1 {side * allowed:.9f}))"
        write_file(folder / f"box_{number:03}.vnnlib", "\n".join([*declared, *ends, wrong, ""]))


def _figure(summary: dict[str, Any]) -> "Figure":
    """Return the map: verified share of each cell in colour, all three in numbers."""
    names = [cell["name"].split("/") for cell in summary["cells"]]
    courses, ratios = (list(dict.fromkeys(part)) for part in zip(*names, strict=True))
    titles = {
        "side": "side flipped: never / seen / open, %",
        "toward": "turn to the passing side: never / seen / open, %",
    }
    panels = []
    for name, title in titles.items():
        parts = [[cell[name][answer]["value"] for answer in ANSWERS] for cell in summary["cells"]]
        values = 100.0 * np.array(parts, float).reshape(len(courses), len(ratios), 3)
        texts = [
            [
                " / ".join("-" if np.isnan(percent) else f"{percent:.0f}" for percent in cell)
                for cell in row
            ]
            for row in values
        ]
        panels.append((title, values[..., 0], texts))
    return cells_figure(panels, courses, ratios, 0.0, "verified, %")


def _parser() -> argparse.ArgumentParser:
    from eval.runner.options import config_option, policy_options, real, whole

    parser = Parser(
        prog="python -m eval.policy_map.local", description=_DESCRIPTION, epilog=_EPILOG
    )
    add = parser.add_argument
    config_option(parser, "an earlier examination")
    policy_options(parser)
    add(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder, new or empty (default: runs/local_DATE_TIME)",
    )
    add("--boxes", type=whole(1, 1_000_000), metavar="N", help="number of boxes (default: 100)")
    course = {
        "type": real(0.0, 180.0, "degrees"),
        "nargs": 2,
        "metavar": ("LOW", "HIGH"),
    }
    add("--course", **course, help="difference of the courses, degrees (default: 0 180)")
    loss = {
        "type": real(0.0, 60.0, "s"),
        "nargs": 2,
        "metavar": ("LOW", "HIGH"),
    }
    add("--loss", **loss, help="time to the loss of separation, s (default: 0 30)")
    add(
        "--position",
        type=real(0.0, 1000.0, "m"),
        metavar="M",
        help="error of x and y, m (default: 30)",
    )
    add(
        "--velocity",
        type=real(0.0, 50.0, "m/s"),
        metavar="M/S",
        help="error of vx and vy, m/s (default: 3)",
    )
    allowed = "turn that does not count, share of the greatest yaw rate (default: 0.1)"
    add("--allowed", type=real(0.01, 0.9), metavar="PART", help=allowed)
    add(
        "--depth",
        type=whole(0, 30),
        metavar="N",
        help="cuts of a box in two (default: 12)",
    )
    add(
        "--seed",
        type=whole(0, 2**63),
        metavar="N",
        help="seed of scenes and samples (default: 0)",
    )
    also = "also write network.onnx and N boxes (default: 0)"
    add("--vnnlib", type=whole(0, 10_000), metavar="N", help=also)
    return parser


def _load(options: argparse.Namespace) -> "LocalConfig":
    """Return the configuration of a file under what the command line says."""
    from eval.policy_map.config import LocalConfig
    from eval.runner.options import given_policy, load_with_options

    names = ("boxes", "course", "loss", "position", "velocity", "allowed", "depth", "seed")
    settings = {name: getattr(options, name) for name in (*names, "vnnlib")}
    return load_with_options(LocalConfig, options.config, settings | given_policy(options))


if __name__ == "__main__":
    run_cli("eval.policy_map.local:main")
