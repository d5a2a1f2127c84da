"""Rollouts of the stochastic policy in many environments at once, and the advantages that they
give.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from agents.learning.networks import NetworkInput
from agents.learning.ppo import (
    Batch,
    Learner,
    LearnerState,
    advantages,
    explained_variance,
    gaussian_log_prob,
)


class Step(NamedTuple):
    """What an environment's step returns with its new state; fields ``[N]``."""

    reward: jax.Array  # for learning, in scaled units, shaping included
    terminated: jax.Array
    statistics: Any  # anything that the caller wants stacked over time


class Environment(NamedTuple):
    """A batch of environments as pure functions."""

    # (state, key) -> what the networks take, [N, ...]: derived once, instead of anew in every
    # epoch.
    observe: Callable[[Any, jax.Array], NetworkInput]
    # (state, action [N, 2]) -> (state, Step).
    step: Callable[[Any, jax.Array], tuple[Any, Step]]
    # (state, index of the step in the rollout) -> state with a fresh episode wherever the last step
    # ended one.
    restart: Callable[[Any, jax.Array], Any]


def collect(
    state: LearnerState,
    environment_state: Any,
    noise: jax.Array,
    key: jax.Array,
    environment: Environment,
    parts: Learner,
    discount: float,
    gae_lambda: float,
) -> tuple[Any, Batch, Any, dict]:
    """Roll the policy out and prepare the samples of an update.

    The noise of the actions is standard normal, ``[T, N, 2]``; the observations draw by the key.
    Returns the environments' new state ``[N]``, samples ``[N, T, ...]``, stacked statistics ``[T,
    ...]`` and figures.
    """
    steps = noise.shape[0]

    def seen(world: Any, index: jax.Array | int) -> NetworkInput:
        return environment.observe(world, jax.random.fold_in(key, index))

    def forward(world: Any, now: tuple[jax.Array, jax.Array]) -> tuple[Any, Any]:
        index, epsilon = now
        world = environment.restart(world, index)
        observation = seen(world, index)
        mean, log_std = parts.policy(state.actor, observation)
        world, result = environment.step(world, mean + jnp.exp(log_std) * epsilon)
        return world, (observation, mean, result)

    world, (observation, mean, result) = jax.lax.scan(
        forward, environment_state, (jnp.arange(steps), noise)
    )
    last = seen(world, steps)
    log_std = state.actor["params"]["log_std"]
    action = mean + jnp.exp(log_std) * noise
    log_prob = gaussian_log_prob(action, mean, log_std)
    # One wide product over the whole rollout instead of a narrow one per step.
    value = parts.value(
        state.critic, jax.tree.map(lambda a, b: jnp.concatenate([a, b[None]]), observation, last)
    )
    terminated = result.terminated.astype(value.dtype)
    estimate = advantages(result.reward, value[:-1], value[1:], terminated, discount, gae_lambda)
    target = estimate + value[:-1]
    samples = Batch(observation, action, log_prob, estimate, target)
    samples = jax.tree.map(lambda a: jnp.swapaxes(a, 0, 1), samples)
    return (
        world,
        samples,
        result.statistics,
        {"explained_variance": explained_variance(value[:-1], target, parts.axis)},
    )
