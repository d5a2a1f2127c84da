"""Actor and critic in flax: separate multi-layer perceptrons over what is derived from a scene, or
from the observation of one intruder.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
from flax import linen as nn
from jaxtyping import Array, Bool, Float

from agents.policy.features import features, mirror_sign
from agents.policy.set_features import SetInputs

Variables: TypeAlias = Mapping[str, Any]
"""Those of a network as flax holds them: ``{"params": ...}`` with nested names of arrays."""

NetworkInput = jax.Array | SetInputs
"""What a network takes: the inputs derived from scenes (``own [..., F]``, ``traffic [..., K, E]``),
observations of one intruder ``[..., 8]``, or the inputs derived from those (``traffic`` is None).
"""


def derive(observation: NetworkInput, feature_set: str) -> SetInputs:
    """Return the inputs that a feature set derives of observations ``[..., 8]``; inputs that are
    derived already are returned as they are.
    """
    if isinstance(observation, SetInputs):
        return observation
    components = [observation[..., i] for i in range(observation.shape[-1])]
    inputs = jnp.stack(features(components, feature_set, jnp), axis=-1)
    sign = jnp.broadcast_to(mirror_sign(components, feature_set, jnp), inputs.shape[:-1])
    return SetInputs(inputs, None, None, sign)


@jax.custom_vjp
def greatest_products(
    traffic: Float[Array, "... K E"], kernel: Float[Array, "E W"], mask: Bool[Array, "... K"]
) -> Float[Array, "... W"]:
    """Return the greatest of the products ``traffic @ kernel`` over those of K that are present,
    minus infinity where none is.

    The gradient of each goes to the first that is the greatest.
    """
    return _greatest(traffic, kernel, mask, jnp.max)


def _greatest(
    traffic: jax.Array, kernel: jax.Array, mask: jax.Array, of: Callable[..., jax.Array]
) -> jax.Array:
    return of(jnp.where(mask[..., None], traffic @ kernel, -jnp.inf), axis=-2)


def _with_places(
    traffic: jax.Array, kernel: jax.Array, mask: jax.Array
) -> tuple[jax.Array, tuple[jax.Array, jax.Array, jax.Array]]:
    places = _greatest(traffic, kernel, mask, jnp.argmax)
    return _greatest(traffic, kernel, mask, jnp.max), (traffic, kernel, places)


def _backward(
    residuals: tuple[jax.Array, jax.Array, jax.Array], gradient: jax.Array
) -> tuple[jax.Array, jax.Array, None]:
    traffic, kernel, places = residuals
    numbers = jnp.arange(traffic.shape[-2])[:, None]
    of_each = jnp.where(places[..., None, :] == numbers, gradient[..., None, :], 0.0)
    rows, of_rows = traffic.reshape(-1, traffic.shape[-1]), of_each.reshape(-1, kernel.shape[-1])
    return of_each @ kernel.T, rows.T @ of_rows, None


greatest_products.defvjp(_with_places, _backward)


class Pooled(nn.Module):
    """A layer with tanh that each of K intruders passes, and the greatest of each of its outputs;
    -1 where there is no intruder.

    Tanh and bias keep the order of the values, so that they are left for the greatest alone: with
    ten intruders, a tenth of the work.
    """

    width: int

    @nn.compact
    def __call__(
        self, traffic: Float[Array, "... K E"], mask: Bool[Array, "... K"]
    ) -> Float[Array, "... width"]:
        """Map intruders to the pooled outputs."""
        kernel = self.param(
            "kernel", nn.initializers.orthogonal(math.sqrt(2.0)), (traffic.shape[-1], self.width)
        )
        bias = self.param("bias", nn.initializers.zeros, (self.width,))
        return jnp.tanh(greatest_products(traffic, kernel, mask) + bias)


class Trunk(nn.Module):
    """Hidden layers with tanh, orthogonal initialisation of gain sqrt(2), and a linear head.

    Of a set, each intruder passes the layers of the encoder first. The greatest of each of their
    outputs joins what describes the ownship, so that neither the order of the intruders nor absent
    ones change anything.
    """

    hidden: tuple[int, ...]
    outputs: int
    head_gain: float
    encoder: tuple[int, ...] = ()

    @nn.compact
    def __call__(self, inputs: SetInputs) -> Float[Array, "... outputs"]:
        """Map what describes the ownship, ``[..., F]``, and each intruder, ``[..., K, E]``, to the
        outputs.
        """

        def layer(x: jax.Array, width: int, name: str) -> jax.Array:
            return jnp.tanh(
                nn.Dense(width, kernel_init=nn.initializers.orthogonal(math.sqrt(2.0)), name=name)(
                    x
                )
            )

        x, traffic = inputs.own, inputs.traffic
        if traffic is not None:
            *before, last = self.encoder
            for i, width in enumerate(before):
                traffic = layer(traffic, width, f"each_{i}")
            pooled = Pooled(last, name=f"each_{len(before)}")(traffic, inputs.mask)
            x = jnp.concatenate([x, pooled], axis=-1)
        for i, width in enumerate(self.hidden):
            x = layer(x, width, f"hidden_{i}")
        return nn.Dense(
            self.outputs, kernel_init=nn.initializers.orthogonal(self.head_gain), name="head"
        )(x)


class Actor(nn.Module):
    """Gaussian policy: a mean that follows from the input and is clipped to [-1, 1] in flight, and
    a standard deviation that does not.
    """

    hidden: tuple[int, ...]
    feature_set: str
    log_std_initial: float = -0.5
    encoder: tuple[int, ...] = ()

    @nn.compact
    def __call__(
        self, network_input: NetworkInput
    ) -> tuple[Float[Array, "... 2"], Float[Array, " 2"]]:
        """Return mean and log standard deviation of the action for an input with leading axes
        ``[...]``.
        """
        inputs = derive(network_input, self.feature_set)
        mean = Trunk(self.hidden, 2, 0.01, self.encoder, name="trunk")(inputs)
        mean = mean * jnp.stack([jnp.ones_like(inputs.mirror_sign), inputs.mirror_sign], axis=-1)
        log_std = self.param("log_std", nn.initializers.constant(self.log_std_initial), (2,))
        return mean, log_std


class Critic(nn.Module):
    """State value in units of the scaled reward."""

    hidden: tuple[int, ...]
    feature_set: str
    encoder: tuple[int, ...] = ()

    @nn.compact
    def __call__(self, network_input: NetworkInput) -> Float[Array, "..."]:
        """Return the value of an input with leading axes ``[...]``."""
        inputs = derive(network_input, self.feature_set)
        return Trunk(self.hidden, 1, 1.0, self.encoder, name="trunk")(inputs)[..., 0]
