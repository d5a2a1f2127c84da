"""Actor and critic in flax: separate multi-layer perceptrons over features of the observation."""

import math

import jax
import jax.numpy as jnp
from flax import linen as nn

from agents.policy.features import features, mirror_sign
from agents.policy.set_features import SetInputs

Seen = jax.Array | SetInputs
"""What a network takes: observations ``[..., 8]``, or the inputs derived from them or from scenes
of several intruders; those of observations have no part for each intruder."""


def derived(observation: Seen, feature_set: str) -> SetInputs:
    """Return what networks with a feature set take of observations ``[..., 8]``; what is derived
    already as it is.
    """
    if isinstance(observation, SetInputs):
        return observation
    components = [observation[..., i] for i in range(observation.shape[-1])]
    inputs = jnp.stack(features(components, feature_set, jnp), axis=-1)
    sign = jnp.broadcast_to(mirror_sign(components, feature_set, jnp), inputs.shape[:-1])
    return SetInputs(inputs, None, None, sign)


class Trunk(nn.Module):
    """Hidden layers with tanh, orthogonal initialisation of gain sqrt(2), and a linear head.

    Of a set, each intruder passes the layers of the encoder first, and the greatest of each of
    their numbers joins what describes the ownship: whatever the intruders' order, and blind to
    absent ones.
    """

    hidden: tuple[int, ...]
    outputs: int
    head_gain: float
    encoder: tuple[int, ...] = ()

    @nn.compact
    def __call__(self, seen: SetInputs) -> jax.Array:
        """Map inputs ``[..., F]``, and those of intruders ``[..., K, E]``, to ``[...,
        outputs]``.
        """

        def layer(x: jax.Array, width: int, name: str) -> jax.Array:
            return jnp.tanh(
                nn.Dense(width, kernel_init=nn.initializers.orthogonal(math.sqrt(2.0)), name=name)(
                    x
                )
            )

        x, each = seen.own, seen.each
        if each is not None:
            for i, width in enumerate(self.encoder):
                each = layer(each, width, f"each_{i}")
            pooled = jnp.max(jnp.where(seen.present[..., None], each, -1.0), axis=-2)
            x = jnp.concatenate([x, pooled], axis=-1)
        for i, width in enumerate(self.hidden):
            x = layer(x, width, f"hidden_{i}")
        return nn.Dense(
            self.outputs, kernel_init=nn.initializers.orthogonal(self.head_gain), name="head"
        )(x)


class Actor(nn.Module):
    """Gaussian policy: a mean, which deciders clip to [-1, 1], of the observation, and a standard
    deviation apart.
    """

    hidden: tuple[int, ...] = (256, 256)
    feature_set: str = "cpa"
    log_std_initial: float = -0.5
    encoder: tuple[int, ...] = ()

    @nn.compact
    def __call__(self, observation: Seen) -> tuple[jax.Array, jax.Array]:
        """Return mean ``[..., 2]`` and log standard deviation ``[2]`` of the action at observations
        ``[..., 8]``.
        """
        seen = derived(observation, self.feature_set)
        mean = Trunk(self.hidden, 2, 0.01, self.encoder, name="trunk")(seen)
        mean = mean * jnp.stack([jnp.ones_like(seen.mirror_sign), seen.mirror_sign], axis=-1)
        log_std = self.param("log_std", nn.initializers.constant(self.log_std_initial), (2,))
        return mean, log_std


class Critic(nn.Module):
    """State value in units of the scaled reward."""

    hidden: tuple[int, ...] = (256, 256)
    feature_set: str = "cpa"
    encoder: tuple[int, ...] = ()

    @nn.compact
    def __call__(self, observation: Seen) -> jax.Array:
        """Return the value of observations ``[..., 8]``, ``[...]``."""
        return Trunk(self.hidden, 1, 1.0, self.encoder, name="trunk")(
            derived(observation, self.feature_set)
        )[..., 0]
