"""What a training asks of a learning algorithm: to begin, to act, and to learn from a rollout.

PPO (:class:`agents.learning.ppo.Ppo`) is one; another has the same three functions
(docs/howto/own-algorithm.md).
"""

from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from agents.learning.networks import Actor, Critic, NetworkInput


class Setup(NamedTuple):
    """What a training gives to the algorithm that it makes."""

    actor: Actor
    """The network that becomes the policy file."""
    critic: Critic
    """A network of the same shape for values; an algorithm need not use it."""
    discount: float
    """Worth of a reward one time step later."""
    axis: str | None
    """Name of the devices' axis inside ``shard_map``; None on one device."""


class Rollout(NamedTuple):
    """T time steps of N encounters, as they were flown by :meth:`Algorithm.act`.

    An encounter that ends goes on with another one in the next step.
    """

    observation: NetworkInput
    """What the networks take before each step, leading axes ``[T, N]``."""
    last: NetworkInput
    """The same after the last step, ``[N]``."""
    noise: Float[Array, "T N 2"]
    """What :meth:`Algorithm.act` was given."""
    action_data: Any
    """What :meth:`Algorithm.act` returned to be kept, ``[T, N, ...]``."""
    reward: Float[Array, "T N"]
    """Of each step, scaled, shaping included."""
    terminated: Bool[Array, "T N"]
    """Whether the step ended the encounter, after which nothing is worth anything."""

    @property
    def observations(self) -> NetworkInput:
        """All of them, ``[T + 1, N]``: entry t + 1 is what follows step t, unless that was the end
        of an encounter.
        """
        return jax.tree.map(
            lambda rows, last: jnp.concatenate([rows, last[None]]), self.observation, self.last
        )


class Algorithm(Protocol):
    """A learning algorithm: pure functions, which are compiled together with the world.

    Its state is a named tuple of arrays. The field ``actor`` holds the variables of the actor
    network; the rest is the algorithm's own, such as a critic, an optimiser or a replay buffer. A
    checkpoint holds all of it.
    """

    def init(self, key: PRNGKeyArray, blank: NetworkInput) -> Any:
        """Return the state at the start; ``blank`` is an input of one encounter."""
        ...

    def act(
        self, state: Any, observation: NetworkInput, noise: Float[Array, "N 2"]
    ) -> tuple[Float[Array, "N 2"], Any]:
        """Return an exploring action for each encounter, which the world clips to [-1, 1], and what
        :meth:`update` wants to have of it, such as the action itself; the noise is standard normal.
        """
        ...

    def update(
        self, state: Any, rollout: Rollout, key: PRNGKeyArray, learning_rate: Float[Array, ""]
    ) -> tuple[Any, dict[str, Float[Array, ""]]]:
        """Return the state after learning from a rollout, and figures to be logged by name; the
        learning rate is the schedule's.
        """
        ...
