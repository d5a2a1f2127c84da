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

import argparse
import importlib
import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from statistics import median
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from agents.config.load import ConfigError, Parser, load
from agents.learning import ppo
from agents.learning.networks import Actor, Critic
from agents.policy import features
from benchmarks import gemm
from benchmarks.learning import sb3 as sb3_task
from benchmarks.learning.sb3 import Cell
from benchmarks.measure import config_options, machine, report
from commands.command import run_cli, whole
from envs import observation
from rlcas_jax import task
from rlcas_jax.algorithm import ppo_settings
from rlcas_jax.config import TrainConfig

__all__ = ["Extent", "Training", "main", "measure"]

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


class Training:
    """A training as it runs, an update at a time.

    Args:
        config: of the training, or of its phase.
        phase: its number.
    """

    def __init__(self, config: TrainConfig, phase: int = 0) -> None:
        self._task = task.build(config, phase=phase)
        self.state = self._task.initial()

    def update(self) -> None:
        """Fly a rollout, learn from it, and wait for the result."""
        self.state, figures = self._task.update(self.state)
        jax.block_until_ready((self.state, figures))


class Learner:
    """Learns again and again from samples of a training's shapes that are made once.

    Args:
        config: of the training.
    """

    def __init__(self, config: TrainConfig) -> None:
        settings = ppo_settings(config)
        hidden, feature_set = tuple(config.network.hidden), config.network.feature_set
        parts = ppo.make_networks(Actor(hidden, feature_set), Critic(hidden, feature_set), settings)
        shape = config.environments, config.rollout
        start_key, *keys, self._key = jax.random.split(jax.random.key(config.seed), 5)
        blank = jnp.zeros((1, observation.SIZE))
        start = jax.jit(lambda key: ppo.initial_state(parts, key, blank))
        self._state = start(start_key)
        draw = jax.jit(partial(_draw_samples, parts, shape))
        self._samples = draw(self._state.actor, *keys)
        self._rate = jnp.float32(config.learning_rate)
        update = partial(ppo.update, networks=parts, settings=settings)
        self._update = jax.jit(update, donate_argnums=0)

    def update(self) -> None:
        """Learn, and wait for the result."""
        self._state, figures = self._update(self._state, self._samples, self._key, self._rate)
        jax.block_until_ready((self._state, figures))


def _draw_samples(
    parts: ppo.Networks,
    shape: tuple[int, int],
    actor: Any,
    inputs_key: PRNGKeyArray,
    noise_key: PRNGKeyArray,
    advantage_key: PRNGKeyArray,
) -> ppo.Batch:
    """Return random samples ``[N, T]`` of an actor's policy, given by its variables."""
    inputs = jax.random.uniform(inputs_key, (*shape, observation.SIZE), minval=-1.0, maxval=1.0)
    mean, log_std = parts.policy(actor, inputs)
    action = mean + jnp.exp(log_std) * jax.random.normal(noise_key, mean.shape)
    estimate = jax.random.normal(advantage_key, shape)
    log_prob = ppo.gaussian_log_prob(action, mean, log_std)
    return ppo.Batch(inputs, action, log_prob, estimate, estimate)


class Entry(NamedTuple):
    """A side of the comparison."""

    work: Work
    amount: int
    """Environment steps, or floating-point operations, of one call."""
    cell: Cell | None = None
    """Of a peer."""
    threads: int = 0
    """Of a peer."""

    @classmethod
    def peer(cls, model: Any, cell: Cell, threads: int) -> "Entry":
        """Return a peer that collects one rollout and learns from it."""
        return cls(partial(_run_peer, model, cell, threads), cell.samples, cell, threads)

    def setting(self) -> dict[str, int]:
        """Return the setting of a peer, for JSON."""
        assert self.cell is not None
        return {
            "environments": self.cell.environments,
            "rollout": self.cell.steps,
            "batch": self.cell.batch,
            "epochs": self.cell.epochs,
            "threads": self.threads,
        }


class GridPoint(NamedTuple):
    """A peer as measured on the grid."""

    rate: float
    """Steps a second."""
    entry: Entry


def _run_peer(model: Any, cell: Cell, threads: int) -> None:
    torch: Any = importlib.import_module("torch")
    torch.set_num_threads(threads)
    model.learn(cell.samples, log_interval=None, reset_num_timesteps=False)


def scan(config: TrainConfig, extent: Extent, threads: Sequence[int]) -> list[GridPoint]:
    """Measure the peer on the grid, each cell with some numbers of threads; the fastest comes
    first.
    """
    points = []
    for count, batch in itertools.product(extent.environments, extent.batches):
        samples = max(extent.samples if batch >= 2_048 else extent.samples // 4, batch)
        cell = Cell(count, samples // count, batch, config.ppo.epochs)
        model = sb3_task.algorithm(config, cell)
        for number in threads:
            entry = Entry.peer(model, cell, number)
            rate = cell.samples / min(_time_for_a_while(entry.work, extent.cell_s))
            print(f"sb3 {cell}, {number} threads: {rate:,.0f} steps/s", flush=True)
            points.append(GridPoint(rate, entry))
    return sorted(points, key=lambda point: -point.rate)


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
    entries, grid = our_entries(config), []
    peers: dict[str, Entry] = {}
    if extent.batches and extent.environments:
        cores = machine()["cores"]
        grid = scan(config, extent, sorted({1, cores}))
        peers = finalists(grid, extent.finalists) | default_entries(config, cores)
        entries |= peers
    times = in_turns({name: entry.work for name, entry in entries.items()}, extent.repeats)
    rates = {name: [entries[name].amount / t for t in seconds] for name, seconds in times.items()}
    _print_rates(entries, rates)
    return _our_figures(config, rates) | (
        _peer_figures(rates, grid, peers) if peers else {"sb3": None}
    )


_PRODUCTS = "gemm", "plain"
"""Entries whose amount is counted in floating-point operations."""


def our_entries(config: TrainConfig) -> dict[str, Entry]:
    """Return our update, our learner alone, and the matrix products."""
    minibatch = [
        product
        for widths in networks(config)
        for product in gemm.products(widths, config.ppo.minibatch)
    ]
    plain = gemm.plain(config.ppo.minibatch, max(config.network.hidden))
    return {
        "ours": Entry(Training(config).update, config.samples),
        "learner": Entry(Learner(config).update, config.samples),
        "gemm": _product_entry(minibatch),
        "plain": _product_entry(plain),
    }


def _product_entry(work: list[gemm.Product]) -> Entry:
    """Return matrix products, repeated for about half a second at 100 GFLOP/s; small ones, which
    come nowhere near that, a hundred times.
    """
    rounds = min(max(1, round(5e10 / gemm.flop(work))), 100)
    return Entry(gemm.runner(work, rounds), rounds * gemm.flop(work))


def finalists(grid: Sequence[GridPoint], count: int) -> dict[str, Entry]:
    """Return the peer in the best cells of the grid, with every number of threads: a busy moment
    slows several threads more than one.
    """
    cells = list(dict.fromkeys(point.entry.cell for point in grid))[:count]
    entries = [point.entry for point in grid if point.entry.cell in cells]
    return {f"finalist {place}": entry for place, entry in enumerate(entries)}


def default_entries(config: TrainConfig, cores: int) -> dict[str, Entry]:
    """Return the peer at its defaults, with one thread, and with as many epochs as ours."""
    default = sb3_task.algorithm(config, sb3_task.DEFAULTS)
    same = replace(sb3_task.DEFAULTS, epochs=config.ppo.epochs)
    return {
        "default": Entry.peer(default, sb3_task.DEFAULTS, cores),
        "default one thread": Entry.peer(default, sb3_task.DEFAULTS, 1),
        "default same epochs": Entry.peer(sb3_task.algorithm(config, same), same, cores),
    }


def _print_rates(entries: dict[str, Entry], rates: dict[str, list[float]]) -> None:
    for name, values in rates.items():
        entry = entries[name]
        unit, size = ("GFLOP/s", 1e9) if name in _PRODUCTS else ("steps/s", 1.0)
        label = name if entry.cell is None else f"sb3 {name}: {entry.cell}, {entry.threads} threads"
        rate = median(values) / size
        print(f"{label:70} {rate:12,.1f} {unit} (spread {spread(values):.0%})")


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
        "environments": config.environments,
        "rollout": config.rollout,
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
    rates: dict[str, list[float]], grid: Sequence[GridPoint], peers: dict[str, Entry]
) -> dict[str, Any]:
    names = [name for name in peers if name.startswith("finalist")]
    best = max(names, key=lambda name: median(rates[name]))
    return {
        "sb3": {
            "best": peers[best].setting() | _rate_figures("steps_per_s", rates[best]),
            **{
                name.replace(" ", "_"): entry.setting() | _rate_figures("steps_per_s", rates[name])
                for name, entry in peers.items()
                if name not in names
            },
            "grid": [point.entry.setting() | {"steps_per_s": point.rate} for point in grid],
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


def _ratio(ours: list[float], theirs: list[float]) -> float:
    return median(a / b for a, b in zip(ours, theirs, strict=True))


def _time_for_a_while(work: Work, least_s: float) -> list[float]:
    """Return the times of some runs, s, the first of which is counted only where it lasts long."""
    times = []
    while sum(times) < least_s or (len(times) < 2 and sum(times) < 20.0):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return times[1:] or times


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and print."""
    options = _parser().parse_args(argv)
    extent, config = _extent(options), _config(options)
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


def _parser() -> Parser:
    parser = Parser(prog="python -m benchmarks.training", description=__doc__)
    add = parser.add_argument
    config_options(parser, "configs/sprint.yaml")
    help_text = "measurements of each side (default 5; 3 with --quick)"
    add("--repeats", type=whole(1), help=help_text)
    help_text = "a quarter of the rollout, fewer repeats and a smaller grid"
    add("--quick", action="store_true", help=help_text)
    add("--no-sb3", action="store_true", help="leave Stable-Baselines3 out")
    return parser


def _extent(options: argparse.Namespace) -> Extent:
    """Return the extent that the options ask for."""
    extent = QUICK if options.quick else Extent()
    if options.repeats is None:
        return extent
    return replace(extent, repeats=options.repeats)


def _config(options: argparse.Namespace) -> TrainConfig:
    """Return the training that the options ask for; raise ConfigError where the peer has none like
    it.
    """
    config = load(TrainConfig, options.config, options.set)
    if config.network.feature_set == "set":
        raise ConfigError(
            "network.feature_set is set; expected none or mirror, as the peer takes one vector"
        )
    if options.quick:
        shorter = f"rollout={max(config.rollout // 4, config.ppo.segment)}"
        config = load(TrainConfig, options.config, [*options.set, shorter])
    return config


if __name__ == "__main__":
    run_cli(main)
