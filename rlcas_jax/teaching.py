"""What a policy in training is kept to: what another policy does, and where metres decide, the best manoeuvre.

The reward tells of a lost metre late, and in hardly one flight of many; a teacher tells at once, and in each. It is
asked about the states that the policy comes to itself (Ross et al. 2011).
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from agents.config.load import ConfigError
from agents.learning.networks import Actor, Derived
from agents.learning.ppo import Taught, Teacher, met_by
from agents.policy.escape_features import COUNT
from agents.policy.features import KEPT_UNIT, begins, size
from envs.kinematics import Limits
from envs.observation import SPEED_HALF, SPEED_MIDDLE
from rlcas_jax import escape_margin as escapes
from rlcas_jax import homeward
from rlcas_jax.beginning import actor_with, policy_at
from rlcas_jax.config import TrainConfig
from rlcas_jax.promptness import GOAL, Asked, prompt_second, ranges, scene
from rlcas_jax.starts import EARLIER

__all__ = [
    "Hold",
    "acting",
    "around",
    "best_manoeuvre",
    "best_second",
    "flown",
    "teacher",
    "teaches",
]

_CLEARLY = 0.01
"""What one manoeuvre keeps less than another, squashed, from which on it is clearly the worse: 0.3 m near 1000 m."""

_CLEARLY_M = 0.1
"""The same of what is kept after a second, m: who errs for a second loses less than who does for good."""

_CLEARLY_OF = 0.1
"""By how much that grows with each metre that is kept beyond 1000 m."""

_DECIDED = 1 / 6
"""Of what is seen, as much as is looked ahead from at most, what has least to lose: it takes 15 times the work."""


Hold = Callable[[Derived, jax.Array], jax.Array]
"""(What is seen ``[...]``, the policy's mean actions ``[..., 2]``) -> actions ``[..., 2]``."""

_LOST = 30.0
"""By how much the best manoeuvre comes too close where nothing is to be saved any more, m."""

_PASSED, _SLOW, _SPACIOUS = 450.0, 6.0, 0.77
"""Distance at which a circle may pass the goal, m; how far above the lowest speed is slow, m/s; what the best manoeuvre
keeps where there is room, squashed: 100 m."""

_ASIDE = math.radians(25.0)
"""How far aside of the nose the goal begins to be, rad."""

_AT_LIMIT = 1e-4
"""A speed this close to a limit is at it, in units of the observation: 2.5 mm/s."""


def teaches(config: TrainConfig) -> bool:
    """Return whether there is a teacher."""
    practice = config.practice
    return practice.teacher is not None or max(practice.pressed, practice.prompt, practice.unwind) > 0.0


def teacher(config: TrainConfig, asked: Asked | None = None, hold: Hold | None = None) -> Teacher | None:
    """Return what a configuration's actor is kept to, of what it sees, how far it is held and what it does.

    Where it is kept to nothing the answer is None.

    Args:
        config: lessons and their weights.
        asked: for how much of what is seen ``practice.prompt`` has the time.
        hold: what is held to where no lesson speaks; by default what the policy of ``practice.teacher`` does.

    Raises:
        ConfigError: the policy of ``practice.teacher`` cannot be used, or ``practice.pressed``, ``practice.prompt``
            or ``practice.unwind`` lacks its inputs.
    """
    if not teaches(config):
        return None
    practice, feature_set = config.practice, config.network.feature_set
    if practice.pressed and feature_set != "pressed":
        raise ConfigError(
            f"practice.pressed is {practice.pressed:g} with network.feature_set {feature_set}; expected pressed"
        )
    for key, weight in (("prompt", practice.prompt), ("unwind", practice.unwind)):
        if weight and not begins(feature_set, "foresight"):
            raise ConfigError(
                f"practice.{key} is {weight:g} with network.feature_set {feature_set}; "
                "expected foresight, advised or pressed"
            )
    limits = config.world.limits()
    if hold is None and practice.teacher is not None:
        hold = acting(practice.teacher, "practice.teacher", feature_set)

    def taught(seen: Derived, held: jax.Array, mean: jax.Array, act: Callable[[jax.Array], jax.Array]) -> Taught:
        bounds = jnp.zeros((*held.shape, 2))
        does = Taught(bounds, bounds, bounds)
        if hold is not None:
            low, high = flown(hold(seen, mean), seen, limits)
            does = Taught(low, high, does.weight + practice.teaching * held[..., None])
        matters = jnp.zeros((*held.shape, 1))
        if practice.prompt:
            way, sooner, free = prompt_second(seen, mean, act, asked or Asked())
            does, matters = does._replace(weight=jnp.where(free[..., None], 0.0, does.weight)), sooner[..., None]
            does = _instead(does, way, matters, practice.prompt)
        if practice.pressed:
            manoeuvre, near = best_second(seen, mean, practice.leave) if practice.second else best_manoeuvre(seen)
            # Of two safe sides the way home's is told: whoever hesitates comes closest to the other one, and weaves.
            decided = (matters > 0.0) & (ranges(seen.inputs)[0] > homeward.ROOM)[..., None]
            does = _instead(does, manoeuvre, jnp.where(decided, 0.0, near), practice.pressed)
            does = does._replace(weight=does.weight + jnp.where(decided, practice.pressed * near, 0.0))
        if practice.unwind:
            turn, circling = (jnp.stack([jnp.zeros_like(part), part], axis=-1) for part in around(seen, limits))
            does = _instead(does, turn, circling, practice.unwind)
        return jax.lax.stop_gradient(does)

    return taught


def acting(of: Path, key: str, feature_set: str) -> Hold:
    """Return what a policy file does that a configuration's key names.

    Raises:
        ConfigError: there is none, it is damaged, or its inputs do not begin those of the feature set.
    """
    read = policy_at(of, key)
    actor, variables = Actor(read.hidden, feature_set), actor_with(read, feature_set, f"{key}: {of}")

    def does(seen: Derived, _: jax.Array) -> jax.Array:
        applied: Any = actor.apply(variables, seen)
        return applied[0]

    return does


def _instead(before: Taught, action: jax.Array, share: jax.Array, weight: float) -> Taught:
    """Return what is taught with actions ``[..., 2]`` instead, with so much of a weight, wherever that is any."""
    told = share > 0.0
    low, high = met_by(action)
    return Taught(
        jnp.where(told, low, before.low),
        jnp.where(told, high, before.high),
        jnp.where(told, weight * share, before.weight),
    )


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
    (:func:`agents.policy.escape_features.pressed`) and whatever does otherwise keeps less: who has passed and only gets
    away from now on may do as he likes, however close he is.

    Args:
        seen: of the feature set ``pressed``.
    """
    first = size("mirror")
    kept, near = seen.inputs[..., first : first + COUNT], seen.inputs[..., size("advised")]
    best, most = jnp.argmax(kept, axis=-1, keepdims=True), jnp.max(kept, axis=-1)
    actions, decided = [], []
    for each in escapes.twelve(jnp.arctan2(seen.inputs[..., GOAL + 1], seen.inputs[..., GOAL])):
        action = jnp.take_along_axis(each, best, axis=-1)
        otherwise = jnp.max(jnp.where(jnp.abs(each - action) > 0.5, kept, -jnp.inf), axis=-1)
        actions.append(action[..., 0])
        decided.append(near * jnp.clip((most - otherwise) * (1.0 / _CLEARLY), 0.0, 1.0))
    return jnp.stack([actions[0], actions[1] * seen.hand], axis=-1), jnp.stack(decided, axis=-1)


def best_second(seen: Derived, mean: jax.Array, leave: float) -> tuple[jax.Array, jax.Array]:
    """Return what the next second is best used for, and how far it is to be done, ``[..., 2]`` each.

    One of the twelve manoeuvres is flown for a second, and from there on the one that then keeps most. Where no
    manoeuvre keeps enough, one after another often does, and a policy that does this in each second finds them (a
    rollout, Tesauro and Galperin 1996). Of those that keep nearly as much it is the one that the policy comes closest
    to. Either command is to be done as far as little is left after a second of the policy's own commands and it takes
    more away than the best.

    Who hesitates between two sides that are as good loses a hundred metres a second, and may have them to spare until
    the last: where left and right keep as much, little begins at :data:`rlcas_jax.starts.EARLIER` times as many metres.

    Args:
        seen: as for :func:`best_manoeuvre`; so is what is returned.
        mean: what the policy does, ``[..., 2]``.
        leave: beyond 1000 m, from which on less begins to be too little, m; with a half of it, it is altogether.
    """
    first, shape = size("mirror"), seen.hand.shape
    spare = _metres(jnp.max(seen.inputs[..., first : first + COUNT], axis=-1)).reshape(-1)
    _, rows = jax.lax.top_k(jnp.where(spare > -_LOST, -spare, -jnp.inf), math.ceil(spare.size * _DECIDED))
    own, goal, alone = scene(seen.inputs.reshape(-1, seen.inputs.shape[-1])[rows])
    other = jax.tree.map(lambda field: field[:, None], alone)
    hand = jnp.stack([jnp.ones_like(rows, mean.dtype), seen.hand.reshape(-1)[rows]], axis=-1)
    does = jnp.clip(mean.reshape(-1, 2)[rows], -1.0, 1.0) * hand

    def kept_by(tried: jax.Array) -> jax.Array:
        """Return what is kept beyond 1000 m after a second of actions ``[N, A, 2]``, ``[N, A]``."""
        commanded = tried[..., 0], tried[..., 1]
        return escapes.after(commanded, own, *goal, other, jnp.ones_like(other.x, dtype=bool)) - 1_000.0

    twelve = jnp.stack(escapes.twelve(jnp.arctan2(goal[1], goal[0])), axis=-1)  # [N, 12, 2]
    kept = kept_by(jnp.concatenate([twelve, does[:, None]], axis=1))
    kept, left = kept[:, :COUNT], kept[:, COUNT]
    most, clearly = jnp.max(kept, axis=-1), _CLEARLY_M + _CLEARLY_OF * jnp.maximum(left, 0.0)
    as_good = kept >= (most - clearly)[:, None]
    apart = jnp.sum(jnp.square(twelve - does[:, None]), axis=-1)
    chosen = jnp.argmin(jnp.where(as_good, apart, jnp.inf), axis=-1)
    action = jnp.take_along_axis(twelve, chosen[:, None, None], axis=1)[:, 0]
    keeps = jnp.take_along_axis(kept, chosen[:, None], axis=1)
    # Each command of the policy beside the other one of the best.
    lost = keeps - kept_by(jnp.stack([action.at[:, i].set(does[:, i]) for i in range(2)], axis=1))
    to_the_left, to_the_right = (jnp.max(kept[:, side : side + 3], axis=-1) for side in (0, 3))
    enough = leave * (1.0 + (EARLIER - 1.0) * escapes.undecided(to_the_left, to_the_right, jnp))
    near = jnp.clip(2.0 - left * (2.0 / enough), 0.0, 1.0)
    weight = near[:, None] * jnp.clip(lost / clearly[:, None], 0.0, 1.0)
    whole = jnp.zeros((spare.size, 2))
    return whole.at[rows].set(action * hand).reshape(*shape, 2), whole.at[rows].set(weight).reshape(*shape, 2)


def _metres(kept: jax.Array) -> jax.Array:
    """Return what is kept beyond 1000 m, m, of what it is among the inputs."""
    return KEPT_UNIT * kept / jnp.maximum(1.0 - jnp.abs(kept), 1e-6)


def around(seen: Derived, limits: Limits) -> tuple[jax.Array, jax.Array]:
    """Return the yaw rate, 1 at the limit, of who is not to circle around the goal, and how far it is to be done.

    At the lowest speed a circle gets no smaller. Where the tightest turn to the goal leads around it for ever, it is
    to fly straight on; where it leads there, or within :data:`_PASSED` m, no wider one is to be flown. Where metres
    decide, or will, it is no matter.

    Args:
        seen: of any of the sets that begin with ``foresight``.
        limits: of the vehicle; floats.

    Returns:
        ``[...]`` each.
    """
    own, (x, y), _ = scene(seen.inputs)
    side, y, radius = jnp.sign(y), jnp.abs(y), own.speed * (1.0 / limits.yaw_rate_max)
    missed = radius - jnp.hypot(x, y - radius)
    first = size("mirror")
    kept = seen.inputs[..., first : first + COUNT]
    slow = jnp.clip((limits.speed_min + _SLOW - own.speed) * (2.0 / _SLOW), 0.0, 1.0)
    beyond = jnp.clip((missed - _PASSED) * (1.0 / 50.0), 0.0, 1.0)
    within = jnp.clip((_PASSED - missed) * (1.0 / 50.0), 0.0, 1.0)
    aside = jnp.clip((jnp.arctan2(y, x) - _ASIDE) * (1.0 / _ASIDE), 0.0, 1.0)
    spacious = jnp.max(kept, axis=-1) > _SPACIOUS
    way_home = jnp.min(kept[..., COUNT - 3 : COUNT - 1], axis=-1) > _SPACIOUS  # braking and steady
    turning = jnp.where(way_home, within * aside, 0.0)
    straight = jnp.where(spacious, beyond, 0.0)
    return jnp.where(turning > 0.0, side * seen.hand, 0.0), slow * jnp.maximum(turning, straight)
