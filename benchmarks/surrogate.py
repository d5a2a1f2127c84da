"""Speed of the surrogate: ``python -m benchmarks.surrogate``.

Steps a second with reset, both vehicles, contract observation and outcome, under random actions
that are drawn within the measured time. "Naive" is the same world as it is commonly first written:
every encounter a struct under ``vmap``, library trigonometry, a floating-point modulo for each wrap
and a fresh start sampled for each encounter in each step in case it ends.
"""

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from statistics import median
from typing import Any
from unittest import mock

import jax
import jax.numpy as jnp

from benchmarks.measure import report, seconds
from envs import encounters, intruder, kinematics, observation, perception, relative, surrogate
from envs.aircraft import PAPER
from envs.edge.command import Parser, run_cli
from envs.outcome import RULES

WORLD = surrogate.World(RULES, PAPER)
CIRCLE = encounters.scenario("circle", PAPER)


def ours(count: int, steps: int, rows: int) -> Callable[[jax.Array, surrogate.State], Any]:
    """Return a compiled function that advances ``count`` encounters by ``steps`` from a key and a
    state.
    """

    def run(key: jax.Array, state: surrogate.State) -> Any:
        pool_key, action_key = jax.random.split(key)
        pool = jax.vmap(surrogate.reset)(
            surrogate.redraw_pool(pool_key, [CIRCLE], [1.0], rows, count)
        )
        actions = jax.random.uniform(action_key, (steps, 2, count), minval=-1.0, maxval=1.0)

        def step(
            carry: surrogate.State, now: tuple[jax.Array, jax.Array]
        ) -> tuple[surrogate.State, Any]:
            action, index = now
            fresh = jax.tree.map(lambda field: field[index % rows], pool)
            carry = surrogate.restart(carry, fresh)
            seen = surrogate.observe(carry, PAPER)
            carry, result = surrogate.step(carry, (action[0], action[1]), WORLD)
            return carry, (seen, result.reward)

        return jax.lax.scan(step, state, (actions, jnp.arange(steps)))

    return jax.jit(run)


def naive(count: int, steps: int) -> Callable[[jax.Array, surrogate.State], Any]:
    """Return the same for the naive world; to be traced under :func:`library_trigonometry`."""

    def one(key: jax.Array, state: surrogate.State) -> tuple[surrogate.State, Any]:
        action_key, start_key = jax.random.split(key)
        action = jax.random.uniform(action_key, (2,), minval=-1.0, maxval=1.0)
        draws = jax.random.uniform(start_key, (2, 1, CIRCLE.dimensions))
        fresh = surrogate.reset(encounters.sample(CIRCLE, draws, jnp)[0])
        batch_of_one = jax.tree.map(lambda field: field[None], state)
        final, result = surrogate.step(batch_of_one, (action[:1], action[1:]), WORLD)
        following = surrogate.restart(final, fresh)
        seen = surrogate.observe(following, PAPER)
        return jax.tree.map(lambda field: field[0], following), (seen[0], result.reward[0])

    def run(key: jax.Array, state: surrogate.State) -> Any:
        def step(carry: surrogate.State, step_key: jax.Array) -> tuple[surrogate.State, Any]:
            return jax.vmap(one)(jax.random.split(step_key, count), carry)

        return jax.lax.scan(step, state, jax.random.split(key, steps))

    return jax.jit(run)


def library_trigonometry() -> ExitStack:
    """Replace our polynomials by jax.numpy's functions in every module of the world while the
    context lasts.
    """
    replacements = {
        "sincos": lambda angle, xp: (jnp.sin(angle), jnp.cos(angle)),
        "atan2": lambda y, x, xp: jnp.arctan2(y, x),
        "wrap": lambda angle, xp: jnp.mod(angle + jnp.pi, 2.0 * jnp.pi) - jnp.pi,
    }
    stack = ExitStack()
    for module in (encounters, intruder, kinematics, observation, perception, relative):
        for name, function in replacements.items():
            if hasattr(module, name):
                stack.enter_context(mock.patch.object(module, name, function))
    return stack


def rate(
    function: Callable[[jax.Array, Any], Any], state: surrogate.State, work: int, repeats: int
) -> list[float]:
    """Return steps a second of each repeat."""
    times = seconds(lambda: jax.block_until_ready(function(jax.random.key(1), state)), repeats)
    return [work / time for time in times]


def main() -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    parser.add_argument(
        "--environments", type=int, default=2048, help="encounters in parallel (default 2048)"
    )
    parser.add_argument("--steps", type=int, default=256, help="steps a measurement (default 256)")
    parser.add_argument(
        "--rows", type=int, default=16, help="rows of the pool of starts (default 16)"
    )
    parser.add_argument(
        "--repeats", type=int, default=7, help="measurements of each side (default 7)"
    )
    options = parser.parse_args()
    count, steps = options.environments, options.steps
    state = jax.tree.map(
        lambda field: field[0],
        jax.vmap(surrogate.reset)(
            surrogate.redraw_pool(jax.random.key(0), [CIRCLE], [1.0], 1, count)
        ),
    )
    measure = partial(rate, state=state, work=count * steps, repeats=options.repeats)
    our_rate = measure(ours(count, steps, options.rows))
    with library_trigonometry():
        naive_rate = measure(naive(count, steps))
    print(f"ours  {median(our_rate) / 1e6:7.2f} M steps/s (best {max(our_rate) / 1e6:.2f})")
    print(f"naive {median(naive_rate) / 1e6:7.2f} M steps/s (best {max(naive_rate) / 1e6:.2f})")
    report(
        {
            "environments": count,
            "steps": steps,
            "ours_steps_per_s_median": median(our_rate),
            "ours_steps_per_s_best": max(our_rate),
            "naive_steps_per_s_median": median(naive_rate),
            "ratio_of_medians": median(our_rate) / median(naive_rate),
        },
        ("jax", "jaxlib", "numpy"),
    )


if __name__ == "__main__":
    run_cli(main)
