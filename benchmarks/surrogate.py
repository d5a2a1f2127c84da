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
from jaxtyping import Array, Float, Int, PRNGKeyArray

from benchmarks.measure import report, seconds
from commands.command import Parser, run_cli, whole
from envs import intruder, kinematics, observation, perception, relative, surrogate
from envs.aircraft import PAPER
from envs.encounters import Scenario
from envs.outcome import RULES
from envs.scenarios import geometry, sample, scenario

WORLD = surrogate.World(RULES, PAPER)
CIRCLE = scenario("circle", PAPER)

Advance = Callable[[PRNGKeyArray, surrogate.State], tuple[surrogate.State, Any]]
"""Advances encounters from a state with the draws of a key; also returns what was observed and the
rewards.
"""


def ours(count: int, steps: int, rows: int, source: Scenario = CIRCLE) -> Advance:
    """Return a compiled function that advances ``count`` encounters of a scenario by ``steps``,
    with fresh starts from a pool of so many rows.
    """
    return jax.jit(partial(_advance_ours, count, steps, rows, source))


def start(count: int, source: Scenario = CIRCLE) -> surrogate.State:
    """Return ``count`` encounters of a scenario at their beginning."""
    pool = surrogate.redraw_pool(jax.random.key(0), [source], [1.0], 1, count)
    return jax.tree.map(lambda rows: rows[0], jax.vmap(surrogate.reset)(pool))


def _advance_ours(
    count: int, steps: int, rows: int, source: Scenario, key: PRNGKeyArray, state: surrogate.State
) -> tuple[surrogate.State, Any]:
    pool_key, action_key = jax.random.split(key)
    pool = jax.vmap(surrogate.reset)(surrogate.redraw_pool(pool_key, [source], [1.0], rows, count))
    actions = jax.random.uniform(action_key, (steps, 2, count), minval=-1.0, maxval=1.0)
    return jax.lax.scan(partial(_step_ours, rows, pool), state, (actions, jnp.arange(steps)))


def _step_ours(
    rows: int,
    pool: surrogate.State,
    state: surrogate.State,
    step: tuple[Float[Array, "2 N"], Int[Array, ""]],
) -> tuple[surrogate.State, tuple[Any, Any]]:
    """Begin anew what has ended, observe and step; ``step`` is the action and the step's index."""
    action, index = step
    fresh = jax.tree.map(lambda field: field[index % rows], pool)
    state = surrogate.restart(state, fresh)
    inputs = surrogate.observe(state, PAPER)
    state, result = surrogate.step(state, (action[0], action[1]), WORLD)
    return state, (inputs, result.reward)


def naive(count: int, steps: int) -> Advance:
    """Return the same for the naive world; to be traced under :func:`library_trigonometry`."""
    return jax.jit(partial(_advance_naive, count, steps))


def _advance_naive(
    count: int, steps: int, key: PRNGKeyArray, state: surrogate.State
) -> tuple[surrogate.State, Any]:
    def step(
        carry: surrogate.State, step_key: PRNGKeyArray
    ) -> tuple[surrogate.State, tuple[Any, Any]]:
        return jax.vmap(_step_naive)(jax.random.split(step_key, count), carry)

    return jax.lax.scan(step, state, jax.random.split(key, steps))


def _step_naive(
    key: PRNGKeyArray, state: surrogate.State
) -> tuple[surrogate.State, tuple[Any, Any]]:
    """Advance one encounter, fields ``[]``, and draw the start that follows if it ends."""
    action_key, start_key = jax.random.split(key)
    action = jax.random.uniform(action_key, (2,), minval=-1.0, maxval=1.0)
    draws = jax.random.uniform(start_key, (2, 1, CIRCLE.dimensions))
    fresh = surrogate.reset(sample(CIRCLE, draws, jnp)[0])
    batch_of_one = jax.tree.map(lambda field: field[None], state)
    final, result = surrogate.step(batch_of_one, (action[:1], action[1:]), WORLD)
    following = surrogate.restart(final, fresh)
    inputs = surrogate.observe(following, PAPER)
    return jax.tree.map(lambda field: field[0], following), (inputs[0], result.reward[0])


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
    for module in (geometry, intruder, kinematics, observation, perception, relative):
        for name, function in replacements.items():
            if hasattr(module, name):
                stack.enter_context(mock.patch.object(module, name, function))
    return stack


def work_of(advance: Callable[[PRNGKeyArray, Any], Any], state: Any) -> Callable[[], Any]:
    """Return what advances from a state, by the same draws each time, and waits for the result."""
    key = jax.random.key(1)
    return lambda: jax.block_until_ready(advance(key, state))


def measure_rate(
    advance: Advance, state: surrogate.State, amount: int, repeats: int
) -> list[float]:
    """Return the steps a second of each repeat; ``amount``: steps of a call, of all encounters."""
    return [amount / time for time in seconds(work_of(advance, state), repeats)]


def main() -> None:
    """Measure and print."""
    options = _parser().parse_args()
    count, steps = options.environments, options.steps
    measure = partial(
        measure_rate, state=start(count), amount=count * steps, repeats=options.repeats
    )
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


def _parser() -> Parser:
    parser = Parser(description=__doc__)
    add = parser.add_argument
    help_text = "encounters in parallel (default 2048)"
    add("--environments", type=whole(1), default=2048, help=help_text)
    add("--steps", type=whole(1), default=256, help="steps a measurement (default 256)")
    add("--rows", type=whole(1), default=16, help="rows of the pool of starts (default 16)")
    add("--repeats", type=whole(1), default=7, help="measurements of each side (default 7)")
    return parser


if __name__ == "__main__":
    run_cli(main)
