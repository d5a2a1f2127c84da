"""Rollouts of a learning policy in many environments at once."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from agents.learning.algorithm import Algorithm, Rollout
from agents.learning.networks import NetworkInput


class RolloutStep(NamedTuple):
    """What an environment's step returns with its new state."""

    reward: Float[Array, " N"]  # for learning, in scaled units, shaping included
    terminated: Bool[Array, " N"]
    statistics: Any  # anything that the caller wants stacked over time


class Environment(NamedTuple):
    """A batch of N environments as pure functions."""

    # (state, key) -> what the networks take, [N, ...]: derived once, instead of anew in every
    # epoch.
    observe: Callable[[Any, PRNGKeyArray], NetworkInput]
    # (state, action) -> (state, RolloutStep).
    step: Callable[[Any, Float[Array, "N 2"]], tuple[Any, RolloutStep]]
    # (state, index of the step in the rollout) -> state with a fresh episode wherever the last step
    # ended one.
    restart: Callable[[Any, Int[Array, ""]], Any]


def collect(
    algorithm: Algorithm,
    state: Any,
    environment: Environment,
    environment_state: Any,
    noise: Float[Array, "T N 2"],
    key: PRNGKeyArray,
) -> tuple[Any, Rollout, Any]:
    """Fly an algorithm's policy for T steps.

    The noise of the actions is standard normal; the observations draw by the key. Returns the
    environments' new state, the rollout, and the steps' statistics stacked over time.
    """
    steps = noise.shape[0]

    def observe(world: Any, index: Int[Array, ""] | int) -> NetworkInput:
        return environment.observe(world, jax.random.fold_in(key, index))

    def forward(
        world: Any, step_noise: tuple[Int[Array, ""], Float[Array, "N 2"]]
    ) -> tuple[Any, tuple[NetworkInput, Any, RolloutStep]]:
        index, epsilon = step_noise
        world = environment.restart(world, index)
        observation = observe(world, index)
        action, carried = algorithm.act(state, observation, epsilon)
        world, result = environment.step(world, action)
        return world, (observation, carried, result)

    world, (observation, carried, result) = jax.lax.scan(
        forward, environment_state, (jnp.arange(steps), noise)
    )
    rollout = Rollout(
        observation, observe(world, steps), noise, carried, result.reward, result.terminated
    )
    return world, rollout, result.statistics
