"""Actor and critic in flax: separate multi-layer perceptrons over features of the observation."""

import math

import jax
import jax.numpy as jnp
from flax import linen as nn

from agents.features import MIRRORED, features, side

__all__ = ["Actor", "Critic"]


def _components(observation: jax.Array) -> list[jax.Array]:
    return [observation[..., i] for i in range(observation.shape[-1])]


def _inputs(observation: jax.Array, feature_set: str) -> jax.Array:
    """Return the network's inputs, ``[..., F]``, of observations ``[..., 8]``."""
    return jnp.stack(features(_components(observation), feature_set, jnp), axis=-1)


class Trunk(nn.Module):
    """Hidden layers with tanh, orthogonal initialisation of gain sqrt(2), and a linear head."""

    hidden: tuple[int, ...]
    outputs: int
    head_gain: float
    feature_set: str

    @nn.compact
    def __call__(self, observation: jax.Array) -> jax.Array:
        """Map observations ``[..., 8]`` to ``[..., outputs]``."""
        x = _inputs(observation, self.feature_set)
        for i, width in enumerate(self.hidden):
            x = jnp.tanh(nn.Dense(width, kernel_init=nn.initializers.orthogonal(math.sqrt(2.0)), name=f"hidden_{i}")(x))
        return nn.Dense(self.outputs, kernel_init=nn.initializers.orthogonal(self.head_gain), name="head")(x)


class Actor(nn.Module):
    """Gaussian policy: the mean is a function of the observation, the standard deviation is learned apart.

    The mean is not squashed; deciders clip it to [-1, 1].
    """

    hidden: tuple[int, ...] = (256, 256)
    feature_set: str = "cpa"
    log_std_initial: float = -0.5

    @nn.compact
    def __call__(self, observation: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Return mean ``[..., 2]`` and log standard deviation ``[2]`` of the action."""
        mean = Trunk(self.hidden, 2, 0.01, self.feature_set, name="trunk")(observation)
        if self.feature_set in MIRRORED:
            hand = side(_components(observation), self.feature_set, jnp)
            mean = mean * jnp.stack([jnp.ones_like(hand), hand], axis=-1)
        log_std = self.param("log_std", nn.initializers.constant(self.log_std_initial), (2,))
        return mean, log_std


class Critic(nn.Module):
    """State value in units of the scaled reward."""

    hidden: tuple[int, ...] = (256, 256)
    feature_set: str = "cpa"

    @nn.compact
    def __call__(self, observation: jax.Array) -> jax.Array:
        """Return the value of observations ``[..., 8]``, ``[...]``."""
        return Trunk(self.hidden, 1, 1.0, self.feature_set, name="trunk")(observation)[..., 0]
