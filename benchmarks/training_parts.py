"""Where the time of a training's update goes: ``python -m benchmarks.training_parts [--config
FILE]``.

Each phase's update is measured as training runs it, and then each of its parts alone, compiled on
its own, on what a few updates have left. The limit beside them is what the arithmetic itself takes:
the networks' products at the rate at which this machine multiplies large matrices, and the
separations of the candidate manoeuvres at the rate of a polynomial, both measured in the same run.

Times are microseconds for each environment step, of processor time (all threads) and of wall time;
medians. The last line is one JSON object.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from agents.config.load import ConfigError, Parser, load
from agents.learning import ppo
from agents.policy import candidate_manoeuvres
from benchmarks import gemm
from benchmarks.measure import report
from envs import surrogate
from envs.edge.command import run_cli
from rlcas_jax import starts, task
from rlcas_jax.collect import collect
from rlcas_jax.config import PPO, TrainConfig

__all__ = ["Cost", "main", "parts"]

_CHORDS = candidate_manoeuvres.COUNT * 10
_OPERATIONS = 28  # additions, multiplications, comparisons and a quotient for a chord's separation
_DEGREE = 64  # of the polynomial


class Cost(NamedTuple):
    """What something takes for each environment step, µs."""

    processor: float  # of all threads
    wall: float


class Part(NamedTuple):
    """A part of an update."""

    name: str
    work: Callable[[], Any]  # waits for its result
    steps: float  # environment steps that it serves


def measure_cost(work: Callable[[], Any], steps: float, least_s: float) -> Cost:
    """Return the median cost of some runs after one that is not counted."""
    work()
    times: list[Cost] = []
    until = time.perf_counter() + least_s
    while time.perf_counter() < until or len(times) < 3:
        wall, processor = time.perf_counter(), time.process_time()
        work()
        times.append(Cost(time.process_time() - processor, time.perf_counter() - wall))
    return Cost(*(1e6 / steps * median(values) for values in zip(*times, strict=True)))


def parts(config: TrainConfig, phase: int) -> Iterator[Part]:
    """Yield the whole update of a phase, and then its parts."""
    built = task.build(config, phase=phase)
    state = built.initial()
    samples, environments = config.ppo.samples, config.ppo.environments

    def whole() -> None:
        nonlocal state
        state, figures = built.update(state)
        jax.block_until_ready((state, figures))

    yield Part("whole update", whole, samples)

    inside = task.parts_of(config, phase=phase)
    learner, flying = state.learner, state.environment
    key = jax.random.key(0)

    def part(name: str, function: Callable[..., Any], steps: float, *given: Any) -> Part:
        compiled = jax.jit(function)
        return Part(name, lambda: jax.block_until_ready(compiled(*given)), steps)

    def draws(key: jax.Array) -> surrogate.State:
        return starts.draw(key, config, inside.scenarios, config.pool_rows)

    yield part("draw starts", draws, samples, key)
    drawn, _ = jax.jit(partial(task.draw_update, inside))(state.key)
    environment = task.environment_of(inside, drawn)
    algorithm: Any = inside.algorithm
    yield part("inputs", environment.observe, environments, flying, key)
    seen = jax.jit(environment.observe)(flying, key)
    yield part("act", algorithm.act, environments, learner, seen, drawn.noise[0])
    action, _ = algorithm.act(learner, seen, drawn.noise[0])
    yield part("world", environment.step, environments, flying, action)
    yield part("restart", environment.restart, environments, flying, jnp.zeros((), jnp.int32))
    roll_out = jax.jit(
        lambda learner, flying, noise, key: collect(
            algorithm, learner, environment, flying, noise, key
        )
    )
    yield part("rollout (the four above)", roll_out, samples, learner, flying, drawn.noise, key)
    _, rollout, _ = roll_out(learner, flying, drawn.noise, key)
    networks, settings = algorithm.parts, algorithm.settings
    estimate = partial(ppo.samples, parts=networks, settings=settings)
    yield part("values, advantages", estimate, samples, learner, rollout)
    batch, _ = jax.jit(estimate)(learner, rollout)
    rate = jnp.float32(config.ppo.learning_rate)
    learn = partial(ppo.update, parts=networks, settings=settings)
    yield part("all epochs", learn, samples, learner, batch, key, rate)

    size, epochs, segment = config.ppo.minibatch, config.ppo.epochs, config.ppo.segment
    rows = jax.tree.map(lambda a: a.reshape(-1, segment, *a.shape[2:]), batch)
    order = jax.random.permutation(key, samples // segment)[: size // segment]

    def gather(rows: ppo.Batch, order: jax.Array) -> ppo.Batch:
        return jax.tree.map(lambda a: a[order].reshape(-1, *a.shape[2:]), rows)

    yield part("shuffle", gather, size / epochs, rows, order)
    minibatch = jax.jit(gather)(rows, order)
    both = learner.actor, learner.critic
    gradient = partial(ppo.gradient_of, parts=networks, settings=settings)
    yield part("gradients", gradient, size / epochs, both, minibatch)
    direction = jax.tree.map(jnp.ones_like, both)
    optimizer = networks.optimizer.update
    yield part("optimiser", optimizer, size / epochs, direction, learner.optimizer)


def limit(config: TrainConfig, least_s: float) -> tuple[Cost, Cost]:
    """Return what the networks' products and the separations of the manoeuvres take at least."""
    network, epochs = config.network, config.ppo.epochs
    most = max(scenario.intruders[1] for scenario in config.training_scenarios())
    table = network.input_table()
    encoder = [table.each_size, *network.encoder]
    trunks = [[table.own_size + encoder[-1], *network.hidden, outputs] for outputs in (2, 1)]
    encoders = [encoder] * (2 * most)  # of both networks, for every intruder
    flop = gemm.used_flop_per_step([*trunks, *encoders], epochs)
    product = gemm.plain(ppo.TILE, max(network.hidden))
    of_flop = measure_cost(gemm.runner(product, 20), 20 * gemm.flop(product), least_s)

    @jax.jit
    def polynomial(x: jax.Array) -> jax.Array:
        total = x
        for _ in range(_DEGREE):
            total = total * x + 0.5
        return total

    values = jnp.full((1 << 16,), 0.3)
    operation = measure_cost(
        lambda: polynomial(values).block_until_ready(), values.size * 2 * _DEGREE, least_s
    )
    separations = _CHORDS * _OPERATIONS * most
    return Cost(*(flop * each for each in of_flop)), Cost(*(separations * one for one in operation))


def measure(config: TrainConfig, least_s: float) -> dict[str, Any]:
    """Measure every phase, print its table, and return the figures."""
    phases, total = [], Cost(0.0, 0.0)
    for number, phase in enumerate(config.phase_configs()):
        costs = {
            part.name: measure_cost(part.work, part.steps, least_s) for part in parts(phase, number)
        }
        products, separations = limit(phase, least_s)
        costs |= {"limit: products": products, "limit: manoeuvres": separations}
        least, whole = products.processor + separations.processor, costs["whole update"]
        print(f"phase {number + 1}: µs for each step{'processor':>21}{'wall':>10}")
        for name, cost in costs.items():
            print(f"  {name:35}{cost.processor:10.2f}{cost.wall:10.2f}", flush=True)
        print(f"  {'whole update, in limits':35}{whole.processor / least:10.2f}", flush=True)
        total = Cost(
            *(so_far + phase.steps * 1e-6 * one for so_far, one in zip(total, whole, strict=True))
        )
        phases.append(
            {
                "steps": phase.steps,
                "steps_per_s": 1e6 / whole.wall,
                "us_per_step": {name: cost._asdict() for name, cost in costs.items()},
                "processor_time_in_limits": whole.processor / least,
            }
        )
    return {
        "configuration": config.name,
        "phases": phases,
        "all_phases_processor_s": total.processor,
        "all_phases_wall_s": total.wall,
    }


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = Parser(prog="python -m benchmarks.training_parts", description=__doc__)
    parser.add_argument(
        "--config",
        type=Path,
        default=Path("configs/best.yaml"),
        help="training (default configs/best.yaml)",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change one key of it; may be given many times",
    )
    parser.add_argument(
        "--seconds", type=float, default=2.0, help="time for each part, s (default 2)"
    )
    options = parser.parse_args(argv)
    if not options.seconds > 0.0:
        raise ConfigError(f"--seconds is {options.seconds:g}; expected a number above 0")
    config = load(TrainConfig, options.config, options.set)
    if config.algorithm != PPO or config.network.feature_set != "set":
        raise ConfigError(
            f"{options.config}: trains by {config.algorithm} on {config.network.feature_set}; "
            "expected ppo on a set of intruders"
        )
    report(measure(config, options.seconds), ("jax", "jaxlib", "flax", "optax", "numpy"))


if __name__ == "__main__":
    run_cli(main)
