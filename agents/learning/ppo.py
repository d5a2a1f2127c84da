"""Proximal policy optimisation (Schulman et al. 2017): advantages, losses and the update, apart
from any loop.

Time runs along the first axis of a rollout, encounters along the second: ``[T, N]``.
"""

import math
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int, PRNGKeyArray

from agents.learning.algorithm import Rollout, Setup
from agents.learning.networks import Actor, Critic, NetworkInput, Variables

_LOG_SQRT_TWO_PI = 0.9189385332046727

TILE = 2048
"""Samples that pass the networks at a time where they are many, on a CPU."""


@dataclass(frozen=True)
class PpoSettings:
    """Numbers of the algorithm that are fixed when it is compiled."""

    epochs: int = 4
    minibatches: int = 32
    # steps that stay together when a rollout is shuffled; sorting single ones is slow on a CPU
    segment: int = 16
    discount: float = 0.995
    gae_lambda: float = 0.95
    clip: float = 0.2
    value: float = 0.5
    """Weight of the value loss."""
    entropy: float = 0.0
    """Weight of the entropy bonus."""
    action_bound_coef: float = 0.0
    """Weight of what the mean action is beyond [-1, 1]: there it is clipped, and noise around it
    teaches nothing.
    """
    max_grad_norm: float = 0.5
    adam_epsilon: float = 1e-5
    normalize_advantage: bool = True


class Networks(NamedTuple):
    """The networks and the optimiser: functions only."""

    actor: Actor
    critic: Critic
    optimizer: optax.GradientTransformation
    axis: str | None = None  # name of the devices' axis inside shard_map; None on one device

    def policy(
        self, variables: Variables, observation: NetworkInput
    ) -> tuple[Float[Array, "... 2"], Float[Array, " 2"]]:
        """Return mean and log standard deviation of the action for network inputs with leading axes
        ``[...]``.
        """
        applied: Any = self.actor.apply(variables, observation)
        return applied

    def value(self, variables: Variables, observation: NetworkInput) -> Float[Array, "..."]:
        """Return the values of network inputs with leading axes ``[...]``."""
        applied: Any = self.critic.apply(variables, observation)
        return applied


class LearnerState(NamedTuple):
    """What learning changes."""

    actor: Variables
    critic: Variables
    optimizer: optax.OptState


class Batch(NamedTuple):
    """Samples for the losses; leading axes are free."""

    observation: NetworkInput  # of the networks
    action: Float[Array, "... 2"]  # as drawn, before it is clipped to the limits
    log_prob: Float[Array, "..."]  # of that action under the policy that drew it
    advantage: Float[Array, "..."]
    target: Float[Array, "..."]  # return that the critic is fitted to


def make_networks(actor: Actor, critic: Critic, settings: PpoSettings) -> Networks:
    """Return networks with Adam and clipping; the learning rate is applied by :func:`update`.

    The gradient of each network is clipped by its own norm: a critic with large errors must not
    shorten the actor's step.
    """
    optimizer = optax.chain(
        _clip_apart(settings.max_grad_norm),
        optax.scale_by_adam(eps=settings.adam_epsilon),
    )
    return Networks(actor, critic, optimizer)


def _clip_apart(norm: float) -> optax.GradientTransformation:
    """Return the scaling of each of several gradients, apart from the others, down to a global
    norm.
    """
    clip = optax.clip_by_global_norm(norm)

    def apart(updates: Any, state: Any, params: Any = None) -> tuple[Any, Any]:
        return tuple(clip.update(gradient, state)[0] for gradient in updates), state

    return optax.GradientTransformation(clip.init, apart)


class Ppo(NamedTuple):
    """PPO as a training takes it (:class:`agents.learning.algorithm.Algorithm`)."""

    networks: Networks
    settings: PpoSettings

    def init(self, key: PRNGKeyArray, blank: NetworkInput) -> LearnerState:
        """Return fresh networks and a fresh optimiser."""
        return initial_state(self.networks, key, blank)

    def act(
        self, state: LearnerState, observation: NetworkInput, noise: Float[Array, "N 2"]
    ) -> tuple[Float[Array, "N 2"], Float[Array, "N 2"]]:
        """Return an action drawn from the policy, and the policy's mean."""
        mean, log_std = self.networks.policy(state.actor, observation)
        return mean + jnp.exp(log_std) * noise, mean

    def update(
        self,
        state: LearnerState,
        rollout: Rollout,
        key: PRNGKeyArray,
        learning_rate: Float[Array, ""],
    ) -> tuple[LearnerState, dict[str, Float[Array, ""]]]:
        """Estimate advantages and improve both networks by some epochs over the rollout."""
        batch, figures = samples(state, rollout, self.networks, self.settings)
        state, learned = update(state, batch, key, learning_rate, self.networks, self.settings)
        std = jnp.exp(state.actor["params"]["log_std"])
        noise = {"std_acceleration": std[0], "std_yaw_rate": std[1]}
        return state, figures | learned | noise


def ppo(setup: Setup, settings: PpoSettings) -> Ppo:
    """Return the algorithm for the networks of a training."""
    networks = make_networks(setup.actor, setup.critic, settings)
    return Ppo(networks._replace(axis=setup.axis), settings)


def initial_state(networks: Networks, key: PRNGKeyArray, blank: NetworkInput) -> LearnerState:
    """Initialise parameters and optimiser from a key; ``blank`` has the shapes of what the networks
    take.
    """
    actor_key, critic_key = jax.random.split(key)
    actor, critic = networks.actor.init(actor_key, blank), networks.critic.init(critic_key, blank)
    return LearnerState(actor, critic, networks.optimizer.init((actor, critic)))


def samples(
    state: LearnerState, rollout: Rollout, networks: Networks, settings: PpoSettings
) -> tuple[Batch, dict[str, Float[Array, ""]]]:
    """Return the samples of a rollout, leading axes ``[N, T]``, and how well the critic predicts
    them.
    """
    mean, log_std = rollout.action_data, state.actor["params"]["log_std"]
    action = mean + jnp.exp(log_std) * rollout.noise
    log_prob = gaussian_log_prob(action, mean, log_std)
    value_t = _values(state.critic, rollout.observation, networks)
    last = networks.value(state.critic, rollout.last)
    value_tp1 = jnp.concatenate([value_t[1:], last[None]])
    terminated = rollout.terminated.astype(value_t.dtype)
    estimate = advantages(
        rollout.reward, value_t, value_tp1, terminated, settings.discount, settings.gae_lambda
    )
    target = estimate + value_t
    batch = Batch(rollout.observation, action, log_prob, estimate, target)
    batch = jax.tree.map(lambda a: jnp.swapaxes(a, 0, 1), batch)
    return batch, {"explained_variance": explained_variance(value_t, target, networks.axis)}


def _values(
    critic: Variables, observation: NetworkInput, networks: Networks
) -> Float[Array, "T N"]:
    """Return the values of a rollout's observations ``[T, N]``: by wide products instead of
    a narrow one per step.
    """
    shape = jax.tree.leaves(observation)[0].shape[:2]
    rows = jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:]), observation)
    tiles = in_tiles(rows, math.prod(shape))
    if tiles is None:
        return networks.value(critic, rows).reshape(shape)
    return jax.lax.map(partial(networks.value, critic), tiles).reshape(shape)


def gaussian_log_prob(
    action: Float[Array, "*batch D"], mean: Float[Array, "*batch D"], log_std: Float[Array, " D"]
) -> Float[Array, "*batch"]:
    """Return the log density of a diagonal Gaussian, summed over the last axis."""
    z = (action - mean) * jnp.exp(-log_std)
    return jnp.sum(-0.5 * z * z - log_std - _LOG_SQRT_TWO_PI, axis=-1)


def gaussian_entropy(log_std: Float[Array, "*batch D"]) -> Float[Array, "*batch"]:
    """Return the entropy of a diagonal Gaussian, summed over the last axis, nats."""
    return jnp.sum(log_std + 0.5 + _LOG_SQRT_TWO_PI, axis=-1)


def advantages(
    reward_t: Float[Array, "T N"],
    value_t: Float[Array, "T N"],
    value_tp1: Float[Array, "T N"],
    terminated_t: Float[Array, "T N"],
    discount: float,
    gae_lambda: float,
) -> Float[Array, "T N"]:
    """Return generalised advantage estimates (Schulman et al. 2016), of which ``gae_lambda`` is the
    decay.

    Of each step: its reward, the values of the observations before it and after it
    (before any reset), and whether it ended the episode for good, after which nothing is worth
    anything.
    """
    goes_on = 1.0 - terminated_t
    delta_t = reward_t + discount * value_tp1 * goes_on - value_t
    decay_t = discount * gae_lambda * goes_on

    def backward(
        carry: jax.Array, step: tuple[jax.Array, jax.Array]
    ) -> tuple[jax.Array, jax.Array]:
        delta, decay = step
        estimate = delta + decay * carry
        return estimate, estimate

    _, estimates = jax.lax.scan(
        backward, jnp.zeros_like(delta_t[0]), (delta_t, decay_t), reverse=True
    )
    return estimates


def normalize(advantage: Float[Array, "B M"], axis: str | None = None) -> Float[Array, "B M"]:
    """Return the advantages of B minibatches, each with mean 0 and standard deviation 1 over its M
    samples.

    The devices of an axis have a part of each minibatch's samples each, and get all moments in one
    message.
    """
    mean, std = _moments(advantage, axis)
    return (advantage - mean[:, None]) / (std[:, None] + 1e-8)


def losses(
    parameters: tuple[Variables, Variables],
    batch: Batch,
    networks: Networks,
    settings: PpoSettings,
) -> tuple[Float[Array, ""], dict[str, Float[Array, ""]]]:
    """Return the scalar loss of a minibatch and its parts, means over this device's samples;
    advantages as given.
    """
    actor_variables, critic_variables = parameters
    mean, log_std = networks.policy(actor_variables, batch.observation)
    value = networks.value(critic_variables, batch.observation)

    log_prob = gaussian_log_prob(batch.action, mean, log_std)
    log_ratio = log_prob - batch.log_prob
    ratio = jnp.exp(log_ratio)
    clipped = jnp.clip(ratio, 1.0 - settings.clip, 1.0 + settings.clip)
    policy_loss = -jnp.mean(jnp.minimum(ratio * batch.advantage, clipped * batch.advantage))
    value_loss = 0.5 * jnp.mean(jnp.square(value - batch.target))
    entropy = gaussian_entropy(log_std)
    beyond = jnp.mean(jnp.square(mean - jnp.clip(mean, -1.0, 1.0)).sum(axis=-1))
    loss = (
        policy_loss
        + settings.value * value_loss
        - settings.entropy * entropy
        + settings.action_bound_coef * beyond
    )
    return loss, {
        "loss": loss,
        "policy_loss": policy_loss,
        "value_loss": value_loss,
        "entropy": entropy,
        "beyond_limits": beyond,
        "neg_log_prob": -jnp.mean(log_prob),
        "approx_kl": jnp.mean(ratio - 1.0 - log_ratio),
        "clip_fraction": jnp.mean(jnp.abs(ratio - 1.0) > settings.clip),
    }


def gradient_of(
    parameters: tuple[Variables, Variables], batch: Batch, networks: Networks, settings: PpoSettings
) -> tuple[Any, dict[str, Float[Array, ""]]]:
    """Return the gradient of :func:`losses` of a minibatch ``[M, ...]``, and the losses' parts: the
    means of those of its tiles (:func:`in_tiles`).
    """
    gradient = jax.grad(partial(losses, networks=networks, settings=settings), has_aux=True)
    tiles = in_tiles(batch, len(batch.log_prob))
    if tiles is None:
        return gradient(parameters, batch)

    def add(total: Any, tile: Batch) -> tuple[Any, None]:
        return jax.tree.map(jnp.add, total, gradient(parameters, tile)), None

    shapes = jax.eval_shape(gradient, parameters, batch)
    nothing = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), shapes)
    total, _ = jax.lax.scan(add, nothing, tiles)
    return jax.tree.map(lambda a: a / len(tiles.log_prob), total)


def in_tiles(tree: Any, rows: int) -> Any:
    """Return arrays ``[rows, ...]`` as ``[tiles, TILE, ...]``, or None where they are not to be cut
    up.

    On a CPU the layers of a tile stay in its cache. Other devices take all rows at once.
    """
    if jax.default_backend() != "cpu" or rows <= TILE or rows % TILE:
        return None
    return jax.tree.map(lambda a: a.reshape(-1, TILE, *a.shape[1:]), tree)


def update(
    state: LearnerState,
    rollout: Batch,
    key: PRNGKeyArray,
    learning_rate: Float[Array, ""],
    networks: Networks,
    settings: PpoSettings,
) -> tuple[LearnerState, dict[str, Float[Array, ""]]]:
    """Improve the networks by some epochs over a rollout.

    On several devices each shuffles and cuts up the encounters that it has flown; gradients and the
    advantages' statistics are taken over all of them, so that every device makes the same step. The
    rollout is ``[N, T, ...]``, so that a segment of time is contiguous; ``segment`` must divide T,
    and ``minibatches`` the number of segments. Returns the new state and the mean of each part of
    the loss over the last epoch, with the gradient's norm.
    """
    encounters, steps = rollout.log_prob.shape
    segments = encounters * steps // settings.segment
    rows = jax.tree.map(lambda a: a.reshape(segments, settings.segment, *a.shape[2:]), rollout)
    if networks.axis is not None:
        key = jax.random.fold_in(key, jax.lax.axis_index(networks.axis))
    improve = partial(_epoch, _UpdateContext(rows, learning_rate, networks, settings))
    state, logged = jax.lax.scan(improve, state, jax.random.split(key, settings.epochs))
    return state, {name: jnp.mean(values[-1]) for name, values in logged.items()}


class _UpdateContext(NamedTuple):
    """What the epochs of an update learn from, and how."""

    rows: Batch  # segments of time, [S, segment, ...]
    learning_rate: Float[Array, ""]
    networks: Networks
    settings: PpoSettings


def _epoch(
    context: _UpdateContext, state: LearnerState, key: PRNGKeyArray
) -> tuple[LearnerState, dict[str, Float[Array, " minibatches"]]]:
    """Improve the networks by every minibatch once, of segments in random order; return the new
    state and the parts of the loss of each.
    """
    rows, settings = context.rows, context.settings
    segments, minibatches = len(rows.log_prob), settings.minibatches
    order = jax.random.permutation(key, segments).reshape(minibatches, segments // minibatches)
    advantage = rows.advantage[order].reshape(minibatches, -1)
    if settings.normalize_advantage:
        advantage = normalize(advantage, context.networks.axis)
    return jax.lax.scan(partial(_gradient_step, context), state, (order, advantage))


def _gradient_step(
    context: _UpdateContext,
    state: LearnerState,
    minibatch: tuple[Int[Array, " segments"], Float[Array, " samples"]],
) -> tuple[LearnerState, dict[str, Float[Array, ""]]]:
    """Improve the networks by a minibatch: numbers of segments, and the advantages of their
    samples.
    """
    (chosen, advantage), networks = minibatch, context.networks
    batch = jax.tree.map(lambda a: a[chosen].reshape(-1, *a.shape[2:]), context.rows)._replace(
        advantage=advantage
    )
    variables = (state.actor, state.critic)
    gradient, parts_of_loss = gradient_of(variables, batch, networks, context.settings)
    if networks.axis is not None:
        gradient, parts_of_loss = mean_of_devices((gradient, parts_of_loss), networks.axis)
    direction, optimizer = networks.optimizer.update(gradient, state.optimizer)
    actor, critic = jax.tree.map(lambda p, d: p - context.learning_rate * d, variables, direction)
    parts_of_loss["grad_norm"] = optax.tree.norm(gradient)
    return LearnerState(actor, critic, optimizer), parts_of_loss


def explained_variance(
    value: Float[Array, "*batch"], target: Float[Array, "*batch"], axis: str | None = None
) -> Float[Array, ""]:
    """Return the share of the returns' variance that the critic explains, 1 at best; over all
    devices of an axis.
    """
    if axis is None:
        return 1.0 - jnp.var(target - value) / (jnp.var(target) + 1e-8)
    (_, unexplained), (_, whole) = (
        _moments((target - value).ravel(), axis),
        _moments(target.ravel(), axis),
    )
    return 1.0 - jnp.square(unexplained) / (jnp.square(whole) + 1e-8)


def mean_of_devices(tree: Any, axis: str) -> Any:
    """Return the mean of a tree over the devices of an axis, by one message instead of one
    a leaf.
    """
    flat, restored = ravel_pytree(tree)
    return restored(jax.lax.pmean(flat, axis))


def _moments(
    values: Float[Array, "*batch M"], axis: str | None
) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
    """Return mean and standard deviation along the last axis, of all devices' values where there is
    an axis of them.
    """
    own_mean = values.mean(axis=-1)
    if axis is None:
        return own_mean, values.std(axis=-1)
    # One message: the variance over all is that within the devices and that of their means.
    mean, square, within = jax.lax.pmean(
        jnp.stack([own_mean, jnp.square(own_mean), values.var(axis=-1)]), axis
    )
    return mean, jnp.sqrt(within + jnp.maximum(square - jnp.square(mean), 0.0))
