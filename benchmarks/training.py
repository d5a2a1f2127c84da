"""Speed of training: ``python -m benchmarks.training [--quick]``.

Measured in turns, so that a slow moment of the machine meets every side alike:

- our whole update (rollout, advantages, all epochs) as training runs it, and the learner alone on
  the same samples;
- the float32 matrix products of one minibatch's forward and backward pass at the same shapes, and
  one plain product;
- Stable-Baselines3's PPO on the same task, network and epochs, fed by our vector environment: at
  its defaults, and at the best of a grid of batch sizes, numbers of environments and threads.

Figures are medians; ratios are medians of the ratios within each turn.
"""

import importlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import jax
import jax.numpy as jnp

from agents.config.load import ConfigError, Parser, load
from agents.learning import ppo
from agents.learning.networks import Actor, Critic
from agents.policy import features
from benchmarks import gemm
from benchmarks.learning import sb3 as sb3_task
from benchmarks.learning.sb3 import Cell
from benchmarks.measure import machine, report
from envs import observation
from envs.edge.command import run_cli
from rlcas_jax import task
from rlcas_jax.algorithm import ppo_settings
from rlcas_jax.config import TrainConfig

__all__ = ["Extent", "main", "measure"]

Work = Callable[[], Any]


@dataclass(frozen=True)
class Extent:
    """How much is measured."""

    repeats: int = 5
    batches: tuple[int, ...] = (64, 2048, 4096, 16384)
    environments: tuple[int, ...] = (8, 64, 1024)
    """With the batches: the grid on which the peer's best is looked for; an empty one leaves the
    peer out.
    """
    samples: int = 16_384
    """Least samples of a rollout of the grid, a quarter where batches are small; the rate hardly
    depends on it.
    """
    cell_s: float = 4.0
    """Least time for a cell of the grid, s."""
    finalists: int = 2
    """Best cells of the grid that are measured again, with every number of threads, in turns with
    us.
    """


QUICK = Extent(repeats=3, batches=(64, 4096), environments=(64, 1024), cell_s=1.0, finalists=1)


def networks(config: TrainConfig) -> list[list[int]]:
    """Return the widths of actor and critic."""
    trunk = [features.size(config.network.feature_set), *config.network.hidden]
    return [[*trunk, 2], [*trunk, 1]]


def whole_update(config: TrainConfig) -> Work:
    """Return a function that trains by one update, rollout included."""
    parts = task.build(config)
    state = parts.initial()

    def work() -> None:
        nonlocal state
        state, figures = parts.update(state)
        jax.block_until_ready((state, figures))

    return work


def learner_alone(config: TrainConfig) -> Work:
    """Return a function that learns by one update from samples of the same shapes that are made
    once.
    """
    settings = ppo_settings(config)
    hidden, feature_set = tuple(config.network.hidden), config.network.feature_set
    parts = ppo.learner(Actor(hidden, feature_set), Critic(hidden, feature_set), settings)
    shape = (config.ppo.environments, config.ppo.rollout)
    start_key, seen_key, noise_key, advantage_key, key = jax.random.split(
        jax.random.key(config.seed), 5
    )

    @jax.jit
    def start() -> tuple[ppo.LearnerState, ppo.Batch]:
        fresh = ppo.initial_state(parts, start_key, jnp.zeros((1, observation.SIZE)))
        seen = jax.random.uniform(seen_key, (*shape, observation.SIZE), minval=-1.0, maxval=1.0)
        mean, log_std = parts.policy(fresh.actor, seen)
        action = mean + jnp.exp(log_std) * jax.random.normal(noise_key, mean.shape)
        estimate = jax.random.normal(advantage_key, shape)
        log_prob = ppo.gaussian_log_prob(action, mean, log_std)
        return fresh, ppo.Batch(seen, action, log_prob, estimate, estimate)

    state, samples = start()
    update = jax.jit(partial(ppo.update, parts=parts, settings=settings), donate_argnums=0)

    def work() -> None:
        nonlocal state
        state, figures = update(state, samples, key, jnp.float32(config.ppo.learning_rate))
        jax.block_until_ready((state, figures))

    return work


def peer_work(model: Any, cell: Cell, threads: int) -> Work:
    """Return a function by which the peer collects one rollout and learns from it."""
    torch: Any = importlib.import_module("torch")

    def work() -> None:
        torch.set_num_threads(threads)
        model.learn(cell.samples, log_interval=None, reset_num_timesteps=False)

    return work


def scan(
    config: TrainConfig, extent: Extent, threads: Sequence[int]
) -> list[tuple[float, Cell, int, Work]]:
    """Measure the peer on the grid; return (steps/s, cell, threads, work), the fastest first."""
    found = []
    for count in extent.environments:
        for batch in extent.batches:
            samples = max(extent.samples if batch >= 2_048 else extent.samples // 4, batch)
            cell = Cell(count, samples // count, batch, config.ppo.epochs)
            model = sb3_task.algorithm(config, cell)
            for number in threads:
                work = peer_work(model, cell, number)
                rate = cell.samples / min(_for_a_while(work, extent.cell_s))
                print(f"sb3 {cell}, {number} threads: {rate:,.0f} steps/s", flush=True)
                found.append((rate, cell, number, work))
    return sorted(found, key=lambda entry: -entry[0])


def in_turns(works: dict[str, Work], repeats: int) -> dict[str, list[float]]:
    """Return the wall times of each work, s, taken in turns after one turn that is not counted."""
    times: dict[str, list[float]] = {name: [] for name in works}
    for turn in range(repeats + 1):
        for name, work in works.items():
            began = time.perf_counter()
            work()
            if turn > 0:
                times[name].append(time.perf_counter() - began)
    return times


def measure(config: TrainConfig, extent: Extent) -> dict[str, Any]:
    """Measure everything and return the figures."""
    widths = networks(config)
    minibatch = [
        product for network in widths for product in gemm.products(network, config.ppo.minibatch)
    ]
    plain = gemm.plain(config.ppo.minibatch, max(config.network.hidden))
    # About half a second each at 100 GFLOP/s; small networks, which come nowhere near that, get a
    # hundred rounds.
    shapes_rounds, plain_rounds = (
        min(max(1, round(5e10 / gemm.flop(work))), 100) for work in (minibatch, plain)
    )
    works = {
        "ours": whole_update(config),
        "learner": learner_alone(config),
        "gemm": gemm.runner(minibatch, shapes_rounds),
        "plain": gemm.runner(plain, plain_rounds),
    }
    amounts = {
        "ours": config.ppo.samples,
        "learner": config.ppo.samples,
        "gemm": shapes_rounds * gemm.flop(minibatch),
        "plain": plain_rounds * gemm.flop(plain),
    }
    cells: dict[str, tuple[Cell, int]] = {}
    grid = []
    if extent.batches and extent.environments:
        cores = machine()["cores"]
        grid = scan(config, extent, sorted({1, cores}))
        # A busy moment hits several threads harder than one, so a cell comes with both.
        finalists = list(dict.fromkeys(cell for _, cell, _, _ in grid))[: extent.finalists]
        for place, (_, cell, threads, work) in enumerate(
            entry for entry in grid if entry[1] in finalists
        ):
            works[f"finalist {place}"], cells[f"finalist {place}"] = work, (cell, threads)
        default = sb3_task.algorithm(config, sb3_task.DEFAULTS)
        same = replace(sb3_task.DEFAULTS, epochs=config.ppo.epochs)
        for name, cell, threads, model in (
            ("default", sb3_task.DEFAULTS, cores, default),
            ("default one thread", sb3_task.DEFAULTS, 1, default),
            ("default same epochs", same, cores, sb3_task.algorithm(config, same)),
        ):
            works[name], cells[name] = peer_work(model, cell, threads), (cell, threads)
        amounts |= {name: cell.samples for name, (cell, _) in cells.items()}
    times = in_turns(works, extent.repeats)
    rates = {name: [amounts[name] / t for t in seconds] for name, seconds in times.items()}
    for name, values in rates.items():
        what = "GFLOP/s" if name in ("gemm", "plain") else "steps/s"
        shown = median(values) / (1e9 if what == "GFLOP/s" else 1.0)
        label = f"sb3 {name}: {cells[name][0]}, {cells[name][1]} threads" if name in cells else name
        print(f"{label:70} {shown:12,.1f} {what} (spread {spread(values):.0%})")
    return _our_figures(config, rates) | (
        _peer_figures(rates, grid, cells) if cells else {"sb3": None}
    )


def spread(values: list[float]) -> float:
    """Return the range of repeated measurements as a share of their median."""
    return (max(values) - min(values)) / median(values)


def _our_figures(config: TrainConfig, rates: dict[str, list[float]]) -> dict[str, Any]:
    widths, epochs = networks(config), config.ppo.epochs
    usual, used = gemm.flop_per_step(widths, epochs), gemm.used_flop_per_step(widths, epochs)
    learning = used - 2 * gemm.weights(widths)
    return {
        "configuration": config.name,
        "hidden": list(config.network.hidden),
        "environments": config.ppo.environments,
        "rollout": config.ppo.rollout,
        "minibatch": config.ppo.minibatch,
        "epochs": epochs,
        "weights": gemm.weights(widths),
        "flop_per_step": usual,
        "flop_per_step_without_unused": used,
        **_rate_figures("steps_per_s", rates["ours"]),
        **_rate_figures("learner_steps_per_s", rates["learner"]),
        "gflop_per_s": usual * median(rates["ours"]) / 1e9,
        "learner_gflop_per_s": learning * median(rates["learner"]) / 1e9,
        **_rate_figures("gemm_same_shapes_gflop_per_s", [rate / 1e9 for rate in rates["gemm"]]),
        **_rate_figures("gemm_plain_gflop_per_s", [rate / 1e9 for rate in rates["plain"]]),
        "share_of_gemm_same_shapes": usual * _ratio(rates["ours"], rates["gemm"]),
        "share_of_gemm_same_shapes_without_unused": used * _ratio(rates["ours"], rates["gemm"]),
        "share_of_gemm_plain": usual * _ratio(rates["ours"], rates["plain"]),
        "learner_share_of_gemm_same_shapes": learning * _ratio(rates["learner"], rates["gemm"]),
        "learner_share_of_gemm_plain": learning * _ratio(rates["learner"], rates["plain"]),
    }


def _peer_figures(
    rates: dict[str, list[float]],
    grid: list[tuple[float, Cell, int, Work]],
    cells: dict[str, tuple[Cell, int]],
) -> dict[str, Any]:
    finalists = [name for name in cells if name.startswith("finalist")]
    best = max(finalists, key=lambda name: median(rates[name]))
    return {
        "sb3": {
            "best": _setting(*cells[best]) | _rate_figures("steps_per_s", rates[best]),
            **{
                name.replace(" ", "_"): _setting(*cells[name])
                | _rate_figures("steps_per_s", rates[name])
                for name in cells
                if name not in finalists
            },
            "grid": [
                _setting(cell, threads) | {"steps_per_s": rate} for rate, cell, threads, _ in grid
            ],
        },
        "ratio_to_sb3_best": _ratio(rates["ours"], rates[best]),
        "ratio_to_sb3_default": _ratio(rates["ours"], rates["default"]),
        "ratio_to_sb3_default_one_thread": _ratio(rates["ours"], rates["default one thread"]),
        "ratio_to_sb3_default_same_epochs": _ratio(rates["ours"], rates["default same epochs"]),
    }


def _rate_figures(name: str, values: list[float]) -> dict[str, float]:
    return {
        f"{name}_median": median(values),
        f"{name}_best": max(values),
        f"{name}_spread": spread(values),
    }


def _setting(cell: Cell, threads: int) -> dict[str, int]:
    return {
        "environments": cell.environments,
        "rollout": cell.steps,
        "batch": cell.batch,
        "epochs": cell.epochs,
        "threads": threads,
    }


def _ratio(ours: list[float], theirs: list[float]) -> float:
    return median(a / b for a, b in zip(ours, theirs, strict=True))


def _for_a_while(work: Work, least_s: float) -> list[float]:
    """Return the times of some runs, s, the first of which is counted only where it lasts long."""
    times = []
    while sum(times) < least_s or (len(times) < 2 and sum(times) < 20.0):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return times[1:] or times


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = Parser(prog="python -m benchmarks.training", description=__doc__)
    add = parser.add_argument
    add(
        "--config",
        type=Path,
        default=Path("configs/sprint.yaml"),
        help="training (default configs/sprint.yaml)",
    )
    add(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change one key of it; may be given many times",
    )
    add("--repeats", type=int, help="measurements of each side (default 5; 3 with --quick)")
    add(
        "--quick",
        action="store_true",
        help="a quarter of the rollout, fewer repeats and a smaller grid",
    )
    add("--no-sb3", action="store_true", help="leave Stable-Baselines3 out")
    options = parser.parse_args(argv)
    extent = QUICK if options.quick else Extent()
    if options.repeats is not None:
        if options.repeats < 1:
            raise ConfigError(f"--repeats is {options.repeats}; expected 1 or more")
        extent = replace(extent, repeats=options.repeats)
    config = load(TrainConfig, options.config, options.set)
    if config.network.feature_set == "set":
        raise ConfigError(
            "network.feature_set is set; expected none, cpa or mirror, as the peer takes one vector"
        )
    if options.quick:
        shorter = f"ppo.rollout={max(config.ppo.rollout // 4, config.ppo.segment)}"
        config = load(TrainConfig, options.config, [*options.set, shorter])
    versions = ["jax", "jaxlib", "flax", "optax", "numpy"]
    if options.no_sb3 or not sb3_task.available():
        if not options.no_sb3:
            print(
                "Stable-Baselines3 is not installed and is left out; to have it: "
                f"{sb3_task.INSTALL}"
            )
        extent = replace(extent, batches=())
    else:
        versions += ["stable-baselines3", "torch", "gymnasium"]
    report(measure(config, extent), tuple(versions))


if __name__ == "__main__":
    run_cli(main)
