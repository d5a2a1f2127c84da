"""What a policy in training is kept to: what another policy does, and where metres decide, the best manoeuvre.

The reward tells of a lost metre late, and in hardly one flight of many; a teacher tells at once, and in each. It is
asked about the states that the policy comes to itself (Ross et al. 2011).
"""

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp

from agents.configuration import ConfigError
from agents.features import begins, size
from agents.foresight import COUNT
from agents.networks import Actor, Derived
from agents.ppo import Taught, met_by
from envs.kinematics import SURROGATE, Limits, VehicleState, advance, commands
from envs.observation import SPEED_HALF, SPEED_MIDDLE
from envs.relative import leg_separation
from rlcas_jax import escapes
from rlcas_jax.beginning import actor_with, policy_at
from rlcas_jax.config import TrainConfig

__all__ = ["around", "best_manoeuvre", "best_second", "flown", "teacher", "teaches"]

_GOAL = 8
"""Where the cosine and the sine of the goal's bearing are among the inputs."""

_CLEARLY = 0.01
"""What one manoeuvre keeps less than another, squashed, from which on it is clearly the worse: 0.3 m near 1000 m."""

_CLEARLY_M = 0.1
"""The same of what is kept after a second, m: who errs for a second loses less than who does for good."""

_DECIDED = 1 / 12
"""Of what is seen, as much as is looked ahead from at most, the most pressed: it takes 12 times the work."""

_PASSED, _SLOW, _SPACIOUS = 450.0, 6.0, 0.77
"""Distance at which a circle may pass the goal, m; how far above the lowest speed is slow, m/s; what the best manoeuvre
keeps where there is room, squashed: 100 m."""

_AT_LIMIT = 1e-4
"""A speed this close to a limit is at it, in units of the observation: 2.5 mm/s."""


def teaches(config: TrainConfig) -> bool:
    """Return whether there is a teacher."""
    return config.practice.teacher is not None or config.practice.pressed > 0.0 or config.practice.unwind > 0.0


def teacher(config: TrainConfig) -> Callable[[Derived, jax.Array], Taught] | None:
    """Return what a configuration's actor is kept to, of what it sees and how far it is held; None: to nothing.

    Raises:
        ConfigError: the policy of ``practice.teacher`` cannot be used, or ``practice.pressed`` or ``practice.unwind``
            lacks its inputs.
    """
    if not teaches(config):
        return None
    practice, feature_set = config.practice, config.network.feature_set
    if practice.pressed and feature_set != "pressed":
        raise ConfigError(
            f"practice.pressed is {practice.pressed:g} with network.feature_set {feature_set}; expected pressed"
        )
    if practice.unwind and not begins(feature_set, "foresight"):
        raise ConfigError(
            f"practice.unwind is {practice.unwind:g} with network.feature_set {feature_set}; "
            "expected foresight, advised or pressed"
        )
    policy = None
    if practice.teacher is not None:
        read = policy_at(practice.teacher, "practice.teacher")
        parameters = actor_with(read, feature_set, f"practice.teacher: {practice.teacher}")
        policy = Actor(read.hidden, feature_set), parameters
    limits = config.world.limits()

    def taught(seen: Derived, held: jax.Array) -> Taught:
        low = high = weight = jnp.zeros((*held.shape, 2))
        if policy is not None:
            actor, variables = policy
            low, high = flown(actor.apply(variables, seen)[0], seen, limits)
            weight = weight + practice.teaching * held[..., None]
        if practice.pressed:
            manoeuvre, near = (best_second if practice.second else best_manoeuvre)(seen)
            beyond = met_by(manoeuvre)
            low, high = (jnp.where(near > 0.0, new, old) for new, old in zip(beyond, (low, high), strict=True))
            weight = jnp.where(near > 0.0, practice.pressed * near, weight)
        if practice.unwind:
            circling = around(seen, limits)
            low, high = (jnp.where(circling > 0.0, 0.0, bound) for bound in (low, high))
            weight = jnp.where(circling > 0.0, practice.unwind * circling, weight)
        return jax.lax.stop_gradient(Taught(low, high, weight))

    return taught


def flown(action: jax.Array, seen: Derived, limits: Limits) -> tuple[jax.Array, jax.Array]:
    """Return the bounds of what has the effect of actions ``[..., 2]``: at a limit of the speed, any throttle.

    Who flies as fast as possible flies on so whether the throttle is open a little or fully: what a teacher does with
    it there is of no account, and changes in it are best not learned.

    Args:
        action: acceleration and yaw rate, 1 at the limit.
        seen: what they answer, of any feature set.
        limits: of the vehicle.
    """
    slowest, fastest = ((speed - SPEED_MIDDLE) / SPEED_HALF for speed in (limits.speed_min, limits.speed_max))
    low, high = met_by(action)
    speed, acceleration = seen.inputs[..., 0], action[..., 0]
    idle = (speed >= fastest - _AT_LIMIT) & (acceleration > 0.0), (speed <= slowest + _AT_LIMIT) & (acceleration < 0.0)
    return (
        low.at[..., 0].set(jnp.where(idle[1], -jnp.inf, jnp.where(idle[0], 0.0, low[..., 0]))),
        high.at[..., 0].set(jnp.where(idle[0], jnp.inf, jnp.where(idle[1], 0.0, high[..., 0]))),
    )


def best_manoeuvre(seen: Derived) -> tuple[jax.Array, jax.Array]:
    """Return what the one manoeuvre does that keeps most, and how far it is to be done, ``[..., 2]`` each.

    The actions are acceleration and yaw rate, 1 at the limit. Each is to be done as far as metres decide
    (:func:`agents.foresight.pressed`) and whatever does otherwise keeps less: who has passed and only gets away from
    now on may do as he likes, however close he is.

    Args:
        seen: of the feature set ``pressed``.
    """
    first = size("mirror")
    kept = seen.inputs[..., first : first + COUNT]
    twelve = _twelve(jnp.arctan2(seen.inputs[..., _GOAL + 1], seen.inputs[..., _GOAL]))
    return _told(twelve, kept, seen.inputs[..., size("advised")], _CLEARLY, seen.hand)


def best_second(seen: Derived) -> tuple[jax.Array, jax.Array]:
    """Return what the next second is best used for, and how far it is to be done, ``[..., 2]`` each.

    One of the twelve manoeuvres is flown for a second, and from there on the one that then keeps most. Where no
    manoeuvre keeps enough, one after another often does, and a policy that does this in each second finds them (a
    rollout, Tesauro and Galperin 1996).

    Args:
        seen: as for :func:`best_manoeuvre`; so is what is returned.
    """
    pressed = seen.inputs[..., size("advised")]
    near, rows = jax.lax.top_k(pressed.reshape(-1), math.ceil(pressed.size * _DECIDED))
    own, goal, other = _scene(seen.inputs.reshape(-1, 1, seen.inputs.shape[-1])[rows])  # [N, 1]
    twelve = _twelve(jnp.arctan2(goal[1], goal[0])[:, 0])
    own_then = advance(own, *commands(twelve, SURROGATE, jnp), 1.0, SURROGATE, jnp)
    other_then = advance(other, 0.0, 0.0, 1.0, SURROGATE, jnp)
    alone = jax.tree.map(lambda field: jnp.broadcast_to(field, own_then.x.shape)[..., None], other_then)
    then = escapes.best(own_then, *goal, alone, jnp.ones_like(alone.x, dtype=bool), jnp)
    kept = jnp.minimum(leg_separation(own, own_then, other, other_then, 1.0, jnp), then)
    told = _told(twelve, kept, near, _CLEARLY_M, seen.hand.reshape(-1)[rows])
    action, decided = (jnp.zeros((pressed.size, 2)).at[rows].set(part).reshape(*pressed.shape, 2) for part in told)
    return action, decided


def _twelve(bearing: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Return acceleration and yaw rate of the manoeuvres, 1 at the limit, ``[..., 12]`` each.

    Args:
        bearing: of the goal, rad, left positive, ``[...]``.
    """
    home = jnp.clip(bearing * (1.0 / SURROGATE.yaw_rate_max), -1.0, 1.0)
    turns = jnp.stack([jnp.ones_like(home), -jnp.ones_like(home), jnp.zeros_like(home), home], axis=-1)
    accelerations = jnp.tile(jnp.array([-1.0, 0.0, 1.0]), COUNT // 3)
    return jnp.broadcast_to(accelerations, (*home.shape, COUNT)), jnp.repeat(turns, 3, axis=-1)


def _told(
    twelve: tuple[jax.Array, jax.Array], kept: jax.Array, near: jax.Array, clearly: float, hand: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Return what the manoeuvre does that keeps most, and how far it is to be done, ``[..., 2]`` each.

    Args:
        twelve: what they do (:func:`_twelve`).
        kept: by each, ``[..., 12]``.
        near: how far metres decide, in [0, 1], ``[...]``.
        clearly: what a manoeuvre keeps less from which on it is clearly the worse.
        hand: factor of the yaw rate, ``[...]``.
    """
    best, most = jnp.argmax(kept, axis=-1, keepdims=True), jnp.max(kept, axis=-1)
    actions, decided = [], []
    for each in twelve:
        action = jnp.take_along_axis(each, best, axis=-1)
        otherwise = jnp.max(jnp.where(jnp.abs(each - action) > 0.5, kept, -jnp.inf), axis=-1)
        actions.append(action[..., 0])
        decided.append(near * jnp.clip((most - otherwise) * (1.0 / clearly), 0.0, 1.0))
    return jnp.stack([actions[0], actions[1] * hand], axis=-1), jnp.stack(decided, axis=-1)


def around(seen: Derived, limits: Limits) -> jax.Array:
    """Return whether a turn to the goal leads around it for ever, ``[..., 2]`` in [0, 1]: of the turn, 0 of the other.

    At the lowest speed a circle gets no smaller; it shall pass the goal within :data:`_PASSED`. Where metres decide,
    or will, it is no matter.

    Args:
        seen: of any of the sets that begin with ``foresight``.
        limits: of the vehicle; floats.
    """
    own, (x, y), _ = _scene(seen.inputs)
    y, radius = jnp.abs(y), own.speed * (1.0 / limits.yaw_rate_max)
    missed = radius - jnp.hypot(x, y - radius)
    first = size("mirror")
    spacious = jnp.max(seen.inputs[..., first : first + COUNT], axis=-1) > _SPACIOUS
    slow = jnp.clip((limits.speed_min + _SLOW - own.speed) * (2.0 / _SLOW), 0.0, 1.0)
    turn = jnp.where(spacious, slow * jnp.clip((missed - _PASSED) * (1.0 / 50.0), 0.0, 1.0), 0.0)
    return jnp.stack([jnp.zeros_like(turn), turn], axis=-1)


def _scene(inputs: jax.Array) -> tuple[VehicleState, tuple[jax.Array, jax.Array], VehicleState]:
    """Return ownship, goal and intruder behind inputs ``[..., F]`` of the feature set ``mirror``, mirrored as they are.

    The ownship is where x and y are 0, and flies along x.
    """
    intruder_range, goal_range = ((inputs[..., i] + 1.0) * 10_000.0 for i in (6, 10))
    speed, vx, vy = inputs[..., 0] * SPEED_HALF + SPEED_MIDDLE, inputs[..., 2] * 100.0, inputs[..., 3] * 100.0
    still = jnp.zeros_like(speed)
    return (
        VehicleState(still, still, still, speed),
        (inputs[..., _GOAL] * goal_range, inputs[..., _GOAL + 1] * goal_range),
        VehicleState(
            inputs[..., 4] * intruder_range, inputs[..., 5] * intruder_range, jnp.arctan2(vy, vx), jnp.hypot(vx, vy)
        ),
    )
