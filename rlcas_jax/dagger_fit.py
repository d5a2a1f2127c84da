"""Learning what was told: a regression of the policy's mean actions."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.typing import ArrayLike
from optax import contrib

from agents.learning.networks import Actor, derived
from rlcas_jax.dagger_config import DaggerConfig
from rlcas_jax.dagger_flights import Samples

__all__ = ["distances", "fit"]

_WARM_UP = 200
"""Gradient steps until the step size is greatest; a tenth of all at most."""

_NORM = 5.0
"""Gradients are scaled down to this norm."""

_AT_ONCE = 64
"""Gradient steps of a call."""


def distances(mean: ArrayLike, low: ArrayLike, high: ArrayLike, nearly: float) -> jax.Array:
    """Return how far actions are from an interval, all ``[..., 2]``: Huber's loss over ``nearly``."""
    apart = jnp.abs(jnp.asarray(mean) - jax.lax.stop_gradient(jnp.clip(mean, low, high)))
    return jnp.where(apart < nearly, jnp.square(apart) * (0.5 / nearly), apart - 0.5 * nearly)


def fit(
    actor: Actor,
    variables: Any,
    samples: Samples,
    settings: DaggerConfig,
    seed: tuple[int, int],
    said: Callable[[int, int, float], None],
) -> Any:
    """Return the parameters of a policy that does more of what it was told.

    Args:
        actor: of the policy.
        variables: its parameters; those of a policy that has its inputs already.
        samples: ``[M]``.
        settings: of the regression; a minibatch is half of the samples where there are fewer than two.
        seed: of the order.
        said: told the gradient steps done and to be done, and the mean loss since it was told last.
    """
    count = len(samples.weight)
    size = min(settings.minibatch, max(count // 2, 1))
    at_once = max(1, min(_AT_ONCE, count // size))
    # Whole calls, so that one shape is compiled: what is left over comes first in the next pass.
    calls = max(1, settings.epochs * count // (size * at_once))
    steps = calls * at_once
    optimizer = optax.chain(optax.clip_by_global_norm(_NORM), _learner(settings, steps))
    smoothness = jnp.asarray(settings.smoothness, jnp.float32)

    def does(parameters: Any, observation: Any) -> jax.Array:
        applied: Any = actor.apply(parameters, derived(observation, actor.feature_set))
        return applied[0]

    def loss(parameters: Any, batch: Samples) -> jax.Array:
        mean = does(parameters, batch.observation)
        told = jnp.sum(batch.weight * distances(mean, batch.low, batch.high, settings.nearly), axis=-1)
        if not any(settings.smoothness):
            return jnp.mean(told)
        half = max(size // 2, 1)  # of the samples: it takes as long as the rest
        later = does(parameters, batch.following[:half])
        changed = jnp.abs(jnp.clip(later, -1.0, 1.0) - jnp.clip(mean[:half], -1.0, 1.0))
        return jnp.mean(told) + jnp.mean(changed, axis=0) @ smoothness

    @jax.jit
    def learn(carry: tuple[Any, Any], batches: Samples) -> tuple[tuple[Any, Any], jax.Array]:
        def step(now: tuple[Any, Any], batch: Samples) -> tuple[tuple[Any, Any], jax.Array]:
            parameters, state = now
            value, gradient = jax.value_and_grad(loss)(parameters, batch)
            change, state = optimizer.update(gradient, state, parameters)
            return (optax.apply_updates(parameters, change), state), value

        carry, values = jax.lax.scan(step, carry, batches)
        return carry, jnp.mean(values)

    carry = variables, optimizer.init(variables)
    random = np.random.default_rng((*seed, 1))
    order, values = np.zeros(0, dtype=np.int64), []
    for call in range(calls):
        if len(order) < size * at_once:
            order = np.concatenate([order, random.permutation(count)])
        rows, order = order[: size * at_once], order[size * at_once :]
        batches = Samples(*(field[rows].reshape(at_once, size, -1) for field in samples))
        carry, value = learn(carry, batches)
        values.append(float(value))
        if (call + 1) * 8 // calls != call * 8 // calls:
            said((call + 1) * at_once, steps, float(np.mean(values)))
            values = []
    return carry[0]


def _learner(settings: DaggerConfig, steps: int) -> optax.GradientTransformation:
    """Return what makes steps of gradients: Adam, and Muon for the hidden layers' matrices where that has a rate."""

    def rate(greatest: float) -> optax.Schedule:
        return optax.warmup_cosine_decay_schedule(0.0, greatest, min(_WARM_UP, steps // 10), steps)

    if not settings.orthogonal_rate:
        return optax.adam(rate(settings.learning_rate))
    return contrib.muon(
        rate(settings.orthogonal_rate),
        adam_learning_rate=rate(settings.learning_rate),
        muon_weight_dimension_numbers=_hidden_matrices,
    )


def _hidden_matrices(variables: Any) -> Any:
    """Return, like a policy's parameters, how Muon sees the matrices of hidden layers; None of what is left to Adam."""
    matrix = contrib.MuonDimensionNumbers(0, 1)
    return jax.tree_util.tree_map_with_path(
        lambda path, _: matrix if path[-1].key == "kernel" and path[-2].key != "head" else None, variables
    )
