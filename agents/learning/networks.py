"""Actor and critic in flax: separate multi-layer perceptrons over features of the observation."""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from flax import linen as nn

from agents.policy.features import MIRRORED, features, mirror_sign

__all__ = ["Actor", "Critic", "Derived", "derived"]


class Derived(NamedTuple):
    """The inputs that the networks derive from an observation, once for several uses."""

    inputs: jax.Array
    """Of the first layer, ``[..., F]``."""
    mirror_sign: jax.Array
    """Factor of the yaw rate, -1 where the scene is seen mirrored, ``[...]``."""


def derived(observation: jax.Array, feature_set: str) -> Derived:
    """Return what networks with a feature set take instead of observations ``[..., 8]``."""
    components = [observation[..., i] for i in range(observation.shape[-1])]
    inputs = jnp.stack(features(components, feature_set, jnp), axis=-1)
    return Derived(inputs, jnp.broadcast_to(mirror_sign(components, feature_set, jnp), inputs.shape[:-1]))


def _derived(seen: jax.Array | Derived, feature_set: str) -> Derived:
    return seen if isinstance(seen, Derived) else derived(seen, feature_set)


class Trunk(nn.Module):
    """Hidden layers with tanh, orthogonal initialisation of gain sqrt(2), and a linear head."""

    hidden: tuple[int, ...]
    outputs: int
    head_gain: float

    @nn.compact
    def __call__(self, inputs: jax.Array) -> jax.Array:
        """Map inputs ``[..., F]`` to ``[..., outputs]``."""
        x = inputs
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
    def __call__(self, observation: jax.Array | Derived) -> tuple[jax.Array, jax.Array]:
        """Return mean ``[..., 2]`` and log standard deviation ``[2]`` of the action at observations ``[..., 8]``."""
        inputs, sign = _derived(observation, self.feature_set)
        mean = Trunk(self.hidden, 2, 0.01, name="trunk")(inputs)
        if self.feature_set in MIRRORED:
            mean = mean * jnp.stack([jnp.ones_like(sign), sign], axis=-1)
        log_std = self.param("log_std", nn.initializers.constant(self.log_std_initial), (2,))
        return mean, log_std


class Critic(nn.Module):
    """State value in units of the scaled reward."""

    hidden: tuple[int, ...] = (256, 256)
    feature_set: str = "cpa"

    @nn.compact
    def __call__(self, observation: jax.Array | Derived) -> jax.Array:
        """Return the value of observations ``[..., 8]``, ``[...]``."""
        inputs, _ = _derived(observation, self.feature_set)
        return Trunk(self.hidden, 1, 1.0, name="trunk")(inputs)[..., 0]
