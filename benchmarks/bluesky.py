"""The policy in BlueSky beside BlueSky's own: ``.bluesky/bin/python -m benchmarks.bluesky``.

Episodes of BlueSky-Gym's ``HorizontalCREnv-v0``: the pilot of :mod:`eval.bluesky.gym` and a
straight flight to the waypoint, beside what the environment's authors logged of their learners.
Circles: aircraft that all meet in the middle, each draw flown with ``RESO RLCAS``, with MVP and
without resolution. Every flight is a line of a file in ``--out``, and a flight that is there
already is not flown again; it counts for one policy file.
"""

import argparse
import json
import os
import random
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from importlib import import_module
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from agents.inference import Policy
from benchmarks.measure import report
from commands.command import Parser, require, run_cli, whole
from commands.json_text import parse_json
from eval.stats.intervals import clopper_pearson

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PUBLISHED = {"SAC": 88.1, "DDPG": 80.3, "TD3": 70.6, "PPO": 42.3}
"""Episodes without intrusion, %, of the last 1000 in the logs of BlueSky-Gym's repository."""

SIZES = 4, 8, 16
METHODS = "RLCAS", "MVP", "OFF"
_COLOURS = {"RLCAS": "#0b6fb8", "MVP": "#e09a2d", "OFF": "#7a8a99"}

_MOST_ACTIONS = 200  # of an episode, 10 000 s: the environment ends at the waypoint alone

NM = 1852.0
RADIUS = 60.0 * NM  # m, of the circles
LONGEST = 1600  # s; the straight flights take 1000
REACHED = 3.0 * NM  # m from its goal, where a flight ends
EARTH = 6_371_000.0  # m, as BlueSky
_FAR = 5.0 * NM  # m, below which two aircraft have lost their separation
_ALTITUDE = 30_000 * 0.3048  # m

Row = dict[str, Any]
"""A flight as its line in the file has it."""


class Episode(NamedTuple):
    """What is flown of BlueSky-Gym."""

    pilot: str
    """``RLCAS``, ``straight`` or the file of a SAC of Stable-Baselines3."""
    seed: int


class Circle(NamedTuple):
    """What is flown of the circles."""

    method: str
    """One of :data:`METHODS`."""
    aircraft: int
    seed: int


@cache
def _environment() -> Any:
    import gymnasium

    from eval.bluesky.gym import ENVIRONMENT, Pilot

    import_module("bluesky_gym").register_envs()
    return gymnasium.make(ENVIRONMENT), Pilot()


@cache
def _load_sac(path: str) -> Any:
    sac: Any = import_module("stable_baselines3").SAC
    return sac.load(path, device="cpu")


def fly_episode(task: Episode) -> Row:
    """Fly one episode of the environment; it draws from the global generators, which the seed
    sets.
    """
    environment, _ = _environment()
    np.random.seed(task.seed)  # noqa: NPY002
    random.seed(task.seed)
    observation, _ = environment.reset(seed=task.seed)
    reached, info = False, {}
    for _ in range(_MOST_ACTIONS):
        observation, _, reached, _, info = environment.step(_act(task.pilot, observation))
        if reached:
            break
    return {
        "pilot": task.pilot,
        "seed": task.seed,
        "reached": bool(reached),
        "intrusions": int(info["total_intrusions"]),
        "drift_rad": float(info["average_drift"]),
        "reward": float(np.ravel(info["total_reward"])[0]),
    }


def _act(pilot: str, observation: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return what a pilot does."""
    if pilot == "RLCAS":
        _, policy = _environment()
        return policy(observation)
    if pilot == "straight":
        drift = np.arctan2(observation["sin_drift"], observation["cos_drift"])
        return np.clip(-drift / np.radians(45.0), -1.0, 1.0)
    action, _ = _load_sac(pilot).predict(observation, deterministic=True)
    return action


@cache
def _simulator() -> Any:
    bluesky: Any = import_module("bluesky")
    bluesky.init(mode="sim", detached=True)
    import_module("eval.bluesky.plugin")
    return bluesky


class _Ring(NamedTuple):
    """Where the aircraft of a circle start, fields ``[N]``; they fly to the points opposite."""

    angle: np.ndarray  # clockwise from north, rad
    radius: np.ndarray  # m
    mach: np.ndarray

    @classmethod
    def draw(cls, task: Circle) -> "_Ring":
        """Return the starts that follow from a seed."""
        count = task.aircraft
        draw = np.random.default_rng([task.seed, count])
        angle = 2.0 * np.pi * (np.arange(count) + draw.uniform(-0.25, 0.25, count)) / count
        radius = RADIUS * draw.uniform(0.95, 1.05, count)
        return cls(angle, radius, draw.uniform(0.73, 0.79, count))

    @property
    def north(self) -> np.ndarray:
        """Of the middle, m."""
        return self.radius * np.cos(self.angle)

    @property
    def east(self) -> np.ndarray:
        """Of the middle, m."""
        return self.radius * np.sin(self.angle)


def fly_circle(task: Circle) -> Row:
    """Fly one circle: A320s at flight level 300, of Mach 0.73 to 0.79, to the points opposite to
    where they start.
    """
    bluesky, ring = _simulator(), _Ring.draw(task)
    bluesky.sim.reset()
    for command in ("DT 1", "ASAS ON", f"RESO {task.method}"):
        bluesky.stack.stack(command)
    _create(bluesky, ring)
    bluesky.stack.stack("OP")
    lost, intrusion, nearest = set(), 0, np.inf
    path = np.zeros(task.aircraft)
    for _ in range(LONGEST):
        bluesky.sim.step()
        traffic = bluesky.traf
        number = np.array([int(name[1:]) for name in traffic.id])
        north, east = (EARTH * np.radians(degrees) for degrees in (traffic.lat, traffic.lon))
        path[number] = traffic.distflown
        pairs = np.triu_indices(len(number), 1)
        apart = np.hypot(east[:, None] - east, north[:, None] - north)[pairs]
        close = np.stack(pairs)[:, apart < _FAR]
        lost |= set(map(tuple, number[close].T.tolist()))
        intrusion += close.shape[1]
        nearest = min(nearest, apart.min(initial=np.inf))
        to_goal = np.hypot(east + ring.east[number], north + ring.north[number])
        arrived = np.flatnonzero(to_goal < REACHED)
        if arrived.size:
            traffic.delete(arrived.tolist())
        if traffic.ntraf == 0:
            break
    return {
        "method": task.method,
        "aircraft": task.aircraft,
        "seed": task.seed,
        "losses": len(lost),
        "intrusion_s": intrusion,
        "nearest_nm": float(nearest / NM),
        "extra_path": float(np.mean(path / (2.0 * ring.radius - REACHED)) - 1.0),
        "arrived": task.aircraft - int(bluesky.traf.ntraf),
    }


def _create(bluesky: Any, ring: _Ring) -> None:
    """Put the aircraft into the simulator, each on its way to the point opposite."""
    for i in range(len(ring.angle)):
        name, heading = f"A{i}", float(np.degrees(ring.angle[i]) + 180.0) % 360.0
        at = np.degrees([ring.north[i], ring.east[i]]) / EARTH
        to = np.degrees([-ring.north[i], -ring.east[i]]) / EARTH
        start = float(at[0]), float(at[1]), heading, _ALTITUDE, float(ring.mach[i])
        bluesky.traf.cre(name, "A320", *start)
        bluesky.stack.stack(f"{name} ADDWPT {to[0]} {to[1]}")
        bluesky.stack.stack(f"{name} LNAV ON")


def _silence() -> None:
    """Drop what a worker prints: BlueSky tells of the navigation data that it reads."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def _fly(
    work: Callable[[Any], Row], tasks: Sequence[Episode | Circle], path: Path, workers: int
) -> list[Row]:
    """Return the flights of all tasks in their order; those that the file does not hold are flown
    now and added to it.
    """
    digest = Policy.load().sha256[:8]
    rows = _read_rows(path)
    missing = [task for task in tasks if _key(task, digest) not in rows]
    if missing:
        path.parent.mkdir(parents=True, exist_ok=True)
        os.environ["OPENBLAS_NUM_THREADS"] = "1"  # of the workers
        unit = "episodes" if work is fly_episode else "circles"
        shown = time.monotonic()
        with (
            ProcessPoolExecutor(workers, get_context("spawn"), _silence) as pool,
            path.open("a", encoding="utf-8", buffering=1) as file,
        ):
            results = zip(missing, pool.map(work, missing), strict=True)
            for flown, (task, row) in enumerate(results, len(tasks) - len(missing) + 1):
                key = _key(task, digest)
                rows[key] = row | {"key": key}
                file.write(json.dumps(rows[key]) + "\n")
                if time.monotonic() - shown >= 5.0 or flown == len(tasks):
                    shown = time.monotonic()
                    print(f"{flown} of {len(tasks)} {unit}", file=sys.stderr, flush=True)
    return [rows[_key(task, digest)] for task in tasks]


def _key(task: Episode | Circle, digest: str) -> str:
    """Return what the flight of a task is found by; ours counts for one policy file."""
    name, *numbers = task
    return " ".join(map(str, (name, *numbers, digest if name == "RLCAS" else "")))


def _read_rows(path: Path) -> dict[str, Row]:
    """Return the flights of a file by their keys; of none where it is not there."""
    if not path.exists():
        return {}
    rows = map(parse_json, path.read_text(encoding="utf-8").splitlines())
    return {row["key"]: row for row in rows}


def _mean(rows: Iterable[Row], name: str) -> float:
    return float(np.mean([row[name] for row in rows]))


def episode_figures(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the figures of one pilot's episodes."""
    free = sum(row["intrusions"] == 0 for row in rows)
    low, high = clopper_pearson(free, len(rows))
    return {
        "episodes": len(rows),
        "free_of_intrusion": free / len(rows),
        "interval": [low, high],
        "reached": float(np.mean([row.get("reached", True) for row in rows])),
        "drift_rad": _mean(rows, "drift_rad"),
        "reward": _mean(rows, "reward"),
    }


def circle_figures(rows: Sequence[Row], ours: Sequence[Row]) -> dict[str, Any]:
    """Return the figures of one method's circles, beside ours of the same draws."""
    more = [mine["losses"] - other["losses"] for mine, other in zip(ours, rows, strict=True)]
    return {
        "draws": len(rows),
        "losses": sum(row["losses"] for row in rows),
        "draws_with_loss": sum(row["losses"] > 0 for row in rows),
        "intrusion_s": sum(row["intrusion_s"] for row in rows),
        "extra_path": _mean(rows, "extra_path"),
        "arrived": sum(row["arrived"] for row in rows) / sum(row["aircraft"] for row in rows),
        "draws_rlcas_loses_fewer": sum(difference < 0 for difference in more),
        "draws_rlcas_loses_more": sum(difference > 0 for difference in more),
    }


def draw(episodes: dict[str, Any], circles: dict[str, Any], path: Path) -> None:
    """Draw both comparisons side by side, what was flown here with its 95 % intervals."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    _draw_episodes(axes[0], episodes)
    _draw_circles(axes[1], circles)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _draw_episodes(axes: "Axes", episodes: dict[str, Any]) -> None:
    shares = PUBLISHED | {
        name: 100.0 * episode["free_of_intrusion"] for name, episode in episodes.items()
    }
    names = sorted(shares, key=shares.__getitem__)
    for place, name in enumerate(names):
        value, low, high = shares[name], shares[name], shares[name]
        if name in episodes:
            low, high = (100.0 * end for end in episodes[name]["interval"])
        spread = [[value - low], [high - value]] if name in episodes else None
        colour = _COLOURS["RLCAS"] if name == "RLCAS" else _COLOURS["OFF"]
        axes.barh(place, value, xerr=spread, color=colour, capsize=3)
        axes.text(high + 2.0, place, f"{value:.1f}", va="center", fontsize=8)
    axes.set_yticks(range(len(names)), names)
    axes.set(xlim=(0.0, 115.0), xticks=range(0, 101, 20), xlabel="episodes of HorizontalCREnv-v0")
    axes.set_title("Without intrusion, %", fontsize=10)


def _draw_circles(axes: "Axes", circles: dict[str, Any]) -> None:
    for place, method in enumerate(METHODS):
        for group, size in enumerate(SIZES):
            circle = circles.get(f"{method} {size}")
            if circle is None:
                continue
            value = 100.0 * circle["draws_with_loss"] / circle["draws"]
            low, high = clopper_pearson(circle["draws_with_loss"], circle["draws"])
            spread = [[value - 100.0 * low], [100.0 * high - value]]
            x = group + 0.27 * (place - 1)
            label = method if group == 0 else None
            axes.bar(x, value, 0.25, yerr=spread, capsize=3, color=_COLOURS[method], label=label)
            axes.text(x, 100.0 * high + 2.0, f"{value:.0f}", ha="center", fontsize=8)
    axes.set_xticks(range(len(SIZES)), [f"{size} aircraft" for size in SIZES])
    axes.set(ylim=(0.0, 118.0), yticks=range(0, 101, 20))
    axes.set_title("Circles with a loss of separation, %", fontsize=10)
    axes.legend(frameon=False, fontsize=8, ncols=3, loc="upper center")


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    options = _parser().parse_args(arguments)
    require("the benchmark", "bluesky", "bluesky_gym", "gymnasium", "matplotlib")
    if options.sac is not None:
        require("--sac", "stable_baselines3")
    episodes = measure_episodes(options)
    for name, episode in episodes.items():
        low, high = episode["interval"]
        share = f"{100 * episode['free_of_intrusion']:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"
        print(
            f"{name:10} {share} without intrusion, {episode['reached']:.1%} arrive, drift "
            f"{episode['drift_rad']:.3f} rad"
        )
    print("published ", ", ".join(f"{name} {value} %" for name, value in PUBLISHED.items()))
    circles = measure_circles(options)
    draw(episodes, circles, options.out / "bluesky.png")
    figures = {"policy": Policy.load().sha256[:8], "published_percent": PUBLISHED}
    packages = ("bluesky-simulator", "bluesky-gym", "numpy")
    report(figures | {"horizontal_cr": episodes, "circles": circles}, packages)


def measure_episodes(options: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """Return the figures of BlueSky-Gym's episodes by pilot."""
    pilots = ["RLCAS", "straight", *([str(options.sac)] if options.sac else [])]
    seeds = range(options.seed, options.seed + options.episodes)
    tasks = [Episode(pilot, seed) for pilot, seed in product(pilots, seeds)]
    rows = _fly(fly_episode, tasks, options.out / "episodes.jsonl", options.workers)
    flights = {pilot: [row for row in rows if row["pilot"] == pilot] for pilot in pilots}
    return {Path(pilot).stem: episode_figures(own) for pilot, own in flights.items() if own}


def measure_circles(options: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """Return the figures of the circles by method and size, and print each."""
    seeds = range(options.seed, options.seed + options.draws)
    tasks = [Circle(method, size, seed) for seed, size, method in product(seeds, SIZES, METHODS)]
    rows = _fly(fly_circle, tasks, options.out / "circles.jsonl", options.workers)
    circles = {}
    for size, method in product(SIZES, METHODS):
        same_size = [row for row in rows if row["aircraft"] == size]
        own, ours = ([row for row in same_size if row["method"] == m] for m in (method, "RLCAS"))
        if own:
            circle = circles[f"{method} {size}"] = circle_figures(own, ours)
            text = (
                "{losses} losses in {draws} draws, {intrusion_s} s, path +{extra_path:.1%}, "
                "{arrived:.1%} arrive"
            )
            print(f"{size:2} aircraft, {method:6}", text.format(**circle))
    return circles


def _parser() -> Parser:
    parser = Parser(description=__doc__)
    add = parser.add_argument
    add("--episodes", type=whole(0), default=1000, help="episodes of BlueSky-Gym (default 1000)")
    add("--draws", type=whole(0), default=100, help="circles of each size (default 100)")
    add("--seed", type=whole(0), default=0, help="seed of the first episode and circle (default 0)")
    add("--workers", type=whole(1), default=2, help="processes (default 2)")
    folder = Path("runs/bluesky")
    add(
        "--out", type=Path, default=folder, help=f"folder of flights and picture (default {folder})"
    )
    sac_help = "file of a SAC of Stable-Baselines3 that flies the episodes too"
    add("--sac", type=Path, help=sac_help)
    return parser


if __name__ == "__main__":
    run_cli(main)
