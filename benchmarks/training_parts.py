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
from statistics import median
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from agents.config.load import ConfigError, Parser, load
from agents.learning import ppo
from agents.learning.algorithm import Rollout
from agents.policy import candidate_manoeuvres
from benchmarks import gemm
from benchmarks.measure import config_options, report
from benchmarks.training import Training
from commands.command import real, run_cli
from envs import surrogate
from envs.encounters import Scenario
from rlcas_jax import starts, task
from rlcas_jax.collect import Environment, collect
from rlcas_jax.config import PPO, TrainConfig

__all__ = ["Cost", "Limits", "Part", "main", "parts"]

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
    """Yield the whole update of a phase, and then its parts, on what its updates have left."""
    training = Training(config, phase)
    yield Part("whole update", training.update, config.samples)
    prepared = _prepare(config, phase, training.state)
    yield from _rollout_parts(prepared)
    yield from _learning_parts(prepared)


class _Prepared(NamedTuple):
    """What the parts of an update are computed on."""

    config: TrainConfig
    scenarios: list[Scenario]
    algorithm: ppo.Ppo
    environment: Environment
    learner: ppo.LearnerState
    flying: surrogate.State  # of the encounters, [N]
    noise: Float[Array, "T N 2"]  # of the actions
    key: PRNGKeyArray


def _prepare(config: TrainConfig, phase: int, state: task.TrainState) -> _Prepared:
    """Draw what an update needs and make its environment."""
    inside = task.context_of(config, phase=phase)
    drawn, _ = jax.jit(partial(task.draw_update, inside))(state.key)
    assert isinstance(inside.algorithm, ppo.Ppo)
    return _Prepared(
        config=config,
        scenarios=inside.scenarios,
        algorithm=inside.algorithm,
        environment=task.environment_of(inside, drawn),
        learner=state.learner,
        flying=state.environment,
        noise=drawn.noise,
        key=jax.random.key(0),
    )


def _compile_part(name: str, function: Callable[..., Any], steps: float, *arrays: Any) -> Part:
    """Return a part that is compiled on its own and computes on some arrays."""
    compiled = jax.jit(function)
    return Part(name, lambda: jax.block_until_ready(compiled(*arrays)), steps)


def _rollout_parts(prepared: _Prepared) -> Iterator[Part]:
    """Yield what is drawn and flown; a single step serves as many steps as there are
    environments.
    """
    config, environment = prepared.config, prepared.environment
    learner, flying = prepared.learner, prepared.flying
    samples, environments = config.samples, config.environments
    draw = partial(starts.draw, config=config, scenarios=prepared.scenarios, rows=config.pool_rows)
    yield _compile_part("draw starts", draw, samples, prepared.key)
    observe, act = environment.observe, prepared.algorithm.act
    yield _compile_part("inputs", observe, environments, flying, prepared.key)
    inputs = jax.jit(observe)(flying, prepared.key)
    yield _compile_part("act", act, environments, learner, inputs, prepared.noise[0])
    action, _ = act(learner, inputs, prepared.noise[0])
    yield _compile_part("world", environment.step, environments, flying, action)
    first = jnp.zeros((), jnp.int32)
    yield _compile_part("restart", environment.restart, environments, flying, first)
    roll_out = partial(_roll_out, prepared.algorithm, environment)
    whole = learner, flying, prepared.noise, prepared.key
    yield _compile_part("rollout (the four above)", roll_out, samples, *whole)


def _roll_out(
    algorithm: ppo.Ppo,
    environment: Environment,
    learner: ppo.LearnerState,
    flying: surrogate.State,
    noise: Float[Array, "T N 2"],
    key: PRNGKeyArray,
) -> tuple[surrogate.State, Rollout, Any]:
    """Fly a rollout; the arguments that are no arrays come first."""
    return collect(algorithm, learner, environment, flying, noise, key)


def _learning_parts(prepared: _Prepared) -> Iterator[Part]:
    """Yield what is learned from a rollout."""
    config, algorithm, learner = prepared.config, prepared.algorithm, prepared.learner
    samples, rate = config.samples, jnp.float32(config.learning_rate)
    roll_out = jax.jit(partial(_roll_out, algorithm, prepared.environment))
    _, rollout, _ = roll_out(learner, prepared.flying, prepared.noise, prepared.key)
    estimate = partial(ppo.samples, networks=algorithm.networks, settings=algorithm.settings)
    yield _compile_part("values, advantages", estimate, samples, learner, rollout)
    batch, _ = jax.jit(estimate)(learner, rollout)
    learn = partial(ppo.update, networks=algorithm.networks, settings=algorithm.settings)
    yield _compile_part("all epochs", learn, samples, learner, batch, prepared.key, rate)
    yield from _gradient_step_parts(prepared, batch)


def _gradient_step_parts(prepared: _Prepared, batch: ppo.Batch) -> Iterator[Part]:
    """Yield what a gradient step takes; every step of the environments is in one of each epoch."""
    algorithm, learner, samples = prepared.algorithm, prepared.learner, prepared.config.samples
    size, segment = prepared.config.ppo.minibatch, prepared.config.ppo.segment
    steps = size / prepared.config.ppo.epochs
    rows = jax.tree.map(lambda a: a.reshape(-1, segment, *a.shape[2:]), batch)
    order = jax.random.permutation(prepared.key, samples // segment)[: size // segment]
    yield _compile_part("shuffle", _gather, steps, rows, order)
    minibatch = jax.jit(_gather)(rows, order)
    networks = learner.actor, learner.critic
    gradient = partial(ppo.gradient_of, networks=algorithm.networks, settings=algorithm.settings)
    yield _compile_part("gradients", gradient, steps, networks, minibatch)
    direction = jax.tree.map(jnp.ones_like, networks)
    optimise = algorithm.networks.optimizer.update
    yield _compile_part("optimiser", optimise, steps, direction, learner.optimizer)


def _gather(rows: ppo.Batch, order: Int[Array, " R"]) -> ppo.Batch:
    """Return some segments of time, in an order, as one batch of samples."""
    return jax.tree.map(lambda a: a[order].reshape(-1, *a.shape[2:]), rows)


class Limits(NamedTuple):
    """What an update's arithmetic takes at least, for each environment step."""

    products: Cost  # of the networks
    manoeuvres: Cost  # the separations of the candidates


def limits(config: TrainConfig, least_s: float) -> Limits:
    """Return what the arithmetic takes; each rate is measured for so many seconds."""
    network, epochs = config.network, config.ppo.epochs
    most = max(scenario.intruders[1] for scenario in config.training_scenarios())
    table = network.input_table()
    encoder = [table.intruder_size, *network.encoder]
    trunks = [[table.own_size + encoder[-1], *network.hidden, outputs] for outputs in (2, 1)]
    encoders = [encoder] * (2 * most)  # of both networks, for every intruder
    flop = gemm.used_flop_per_step([*trunks, *encoders], epochs)
    product = gemm.plain(ppo.TILE, max(network.hidden))
    of_flop = measure_cost(gemm.runner(product, 20), 20 * gemm.flop(product), least_s)
    of_operation = _operation_cost(least_s)
    separations = _CHORDS * _OPERATIONS * most
    return Limits(
        Cost(*(flop * cost for cost in of_flop)),
        Cost(*(separations * cost for cost in of_operation)),
    )


def _operation_cost(least_s: float) -> Cost:
    """Return what an addition or multiplication of a polynomial takes."""

    @jax.jit
    def polynomial(x: Float[Array, " N"]) -> Float[Array, " N"]:
        total = x
        for _ in range(_DEGREE):
            total = total * x + 0.5
        return total

    values = jnp.full((1 << 16,), 0.3)
    return measure_cost(
        lambda: polynomial(values).block_until_ready(), values.size * 2 * _DEGREE, least_s
    )


def measure(config: TrainConfig, least_s: float) -> dict[str, Any]:
    """Measure every phase, print its table, and return the figures; each part is repeated for so
    many seconds at least.
    """
    phases, total = [], Cost(0.0, 0.0)
    for number, phase in enumerate(config.phase_configs()):
        costs, bounds = _measure_phase(phase, number, least_s)
        whole = costs["whole update"]
        in_limits = whole.processor / (bounds.products.processor + bounds.manoeuvres.processor)
        _print_table(number, costs, in_limits)
        # Millions of steps times microseconds for each are seconds.
        millions = phase.steps * 1e-6
        total = Cost(
            total.processor + millions * whole.processor, total.wall + millions * whole.wall
        )
        phases.append(
            {
                "steps": phase.steps,
                "steps_per_s": 1e6 / whole.wall,
                "us_per_step": {name: cost._asdict() for name, cost in costs.items()},
                "processor_time_in_limits": in_limits,
            }
        )
    return {
        "configuration": config.name,
        "phases": phases,
        "all_phases_processor_s": total.processor,
        "all_phases_wall_s": total.wall,
    }


def _measure_phase(
    config: TrainConfig, phase: int, least_s: float
) -> tuple[dict[str, Cost], Limits]:
    """Return what the parts of a phase's update take, the limits among them, and the limits."""
    costs = {
        part.name: measure_cost(part.work, part.steps, least_s) for part in parts(config, phase)
    }
    bounds = limits(config, least_s)
    costs |= {"limit: products": bounds.products, "limit: manoeuvres": bounds.manoeuvres}
    return costs, bounds


def _print_table(phase: int, costs: dict[str, Cost], in_limits: float) -> None:
    print(f"phase {phase + 1}: µs for each step{'processor':>21}{'wall':>10}")
    for name, cost in costs.items():
        print(f"  {name:35}{cost.processor:10.2f}{cost.wall:10.2f}")
    print(f"  {'whole update, in limits':35}{in_limits:10.2f}", flush=True)


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = Parser(prog="python -m benchmarks.training_parts", description=__doc__)
    config_options(parser, "configs/best.yaml")
    help_text = "time for each part, s (default 2)"
    parser.add_argument("--seconds", type=real(0.001, 3_600.0, "s"), default=2.0, help=help_text)
    options = parser.parse_args(argv)
    config = load(TrainConfig, options.config, options.set)
    if config.algorithm != PPO or config.network.feature_set != "set":
        raise ConfigError(
            f"{options.config}: trains by {config.algorithm} on {config.network.feature_set}; "
            "expected ppo on a set of intruders"
        )
    report(measure(config, options.seconds), ("jax", "jaxlib", "flax", "optax", "numpy"))


if __name__ == "__main__":
    run_cli(main)
