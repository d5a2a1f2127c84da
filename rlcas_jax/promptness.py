"""What is seen where the policy dawdles, and how the soonest way home begins.

The policy is flown on in thought: who arrives much later than he could is told the way (docs/decisions/0022 and 0023).
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp

from agents.learning.networks import Derived
from agents.policy.escape_features import COUNT
from agents.policy.features import size
from envs.kinematics import VehicleState
from envs.observation import DISTANCE_HALF, SPEED_HALF, SPEED_MIDDLE
from rlcas_jax import homeward

__all__ = ["GOAL", "Asked", "blocked", "in_the_way", "prompt_second", "ranges", "scene"]

GOAL = 8
"""Where the cosine and the sine of the goal's bearing are among the inputs."""

_SECONDS = 200
"""How long it is flown on, s."""

_A_LITTLE, _DAWDLES, _DAWDLES_LONG = 5.0, 30.0, 60.0
"""By how much the policy arrives later than it could, s, where it is no example, where that begins to count, and where
it counts in full."""

_NEAR = 4_000.0
"""Distance at which a goal begins to be near, m; at half of it, it is altogether."""

_IN_THE_WAY, _AHEAD = 0.2, math.cos(math.radians(20.0))
"""What the way straight home keeps at most, squashed, where something is in the way: 7.5 m; cosine of the bearing up to
which the goal is ahead."""


class Asked(NamedTuple):
    """Of what is seen, how much there is the time for."""

    blocked: float = 1 / 8
    """As much as is looked for ways home at most."""
    flown: float = 1 / 128
    """As much as the policy is flown on from: what is late."""


def in_the_way(seen: Derived) -> jax.Array:
    """Return whether something is in the way straight home, ``[...]``.

    Args:
        seen: of any of the sets that begin with ``foresight``.
    """
    return seen.inputs[..., size("mirror") + COUNT - 1] < _IN_THE_WAY


def blocked(seen: Derived) -> jax.Array:
    """Return whether something is in the way home, or the goal is aside, ``[...]``.

    Args:
        seen: of any of the sets that begin with ``foresight``.
    """
    return in_the_way(seen) | (seen.inputs[..., GOAL] < _AHEAD)


def prompt_second(
    seen: Derived, mean: jax.Array, act: Callable[[jax.Array], jax.Array], asked: Asked | None = None
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Return how the soonest way home begins, ``[..., 2]``, how far it is to be done, and where nothing is known.

    With an intruder in the way, or the goal aside, and where even the soonest way is late, the policy is flown on, and
    with an intruder in the way near the goal, which is easily missed: it is told as far as it comes later than that
    way. With an intruder in the way it is to be held to nothing where to ask was no time, and where it comes a little
    later: what it does there is not wrong, and not to be copied either.

    Args:
        seen: of any of the sets that begin with ``foresight``.
        mean: what the policy does, ``[..., 2]``.
        act: observations ``[N, 8]`` -> the policy's mean actions ``[N, 2]``.
        asked: how much there is the time for.

    Returns:
        ``[..., 2]``, ``[...]`` and ``[...]``.
    """
    most = asked or Asked()
    shape = seen.hand.shape
    inputs, hands = seen.inputs.reshape(-1, seen.inputs.shape[-1]), seen.hand.reshape(-1)
    hand = jnp.stack([jnp.ones_like(hands), hands], axis=-1)
    does = jnp.clip(mean.reshape(-1, 2), -1.0, 1.0) * hand
    barred, met = blocked(seen).reshape(-1), in_the_way(seen).reshape(-1)
    _, rows = jax.lax.top_k(barred.astype(jnp.float32), math.ceil(barred.size * most.blocked))
    own, goal, other = scene(inputs[rows])
    arrival, action = homeward.soonest(own, *goal, other, does[rows])
    near = jnp.where(met[rows], jnp.clip((_NEAR - jnp.hypot(*goal)) * (2.0 / _NEAR), 0.0, 1.0), 0.0)
    lateness = jnp.maximum(homeward.late(arrival, jnp.hypot(*goal)), near) * (barred[rows] & jnp.isfinite(arrival))
    some, among = jax.lax.top_k(lateness, math.ceil(barred.size * most.flown))
    own, (goal_x, goal_y), other = jax.tree.map(lambda field: field[among], (own, goal, other))
    arrives = homeward.arrival_of(act, own, goal_x, goal_y, other, _SECONDS)
    later = jnp.where(some > 0.0, arrives - jnp.where(some > 0.0, arrival[among], 0.0), 0.0)
    matters = some * jnp.clip((later - _DAWDLES) * (1.0 / (_DAWDLES_LONG - _DAWDLES)), 0.0, 1.0)
    unsure = (some > 0.0) & (later > _A_LITTLE) & (matters == 0.0)
    free = met & barred.at[rows].set(lateness > 0.0).at[rows[among]].set(unsure)
    told = jnp.zeros((barred.size, 2)).at[rows[among]].set((action * hand[rows])[among])
    share = jnp.zeros(barred.size).at[rows[among]].set(matters)
    return told.reshape(*shape, 2), share.reshape(shape), free.reshape(shape)


def ranges(inputs: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Return how far intruder and goal are, m, behind inputs ``[..., F]`` of the feature set ``mirror``."""
    return (inputs[..., 6] + 1.0) * DISTANCE_HALF, (inputs[..., 10] + 1.0) * DISTANCE_HALF


def scene(inputs: jax.Array) -> tuple[VehicleState, tuple[jax.Array, jax.Array], VehicleState]:
    """Return ownship, goal and intruder behind inputs ``[..., F]`` of the feature set ``mirror``, mirrored as they are.

    The ownship is where x and y are 0, and flies along x.
    """
    intruder_range, goal_range = ranges(inputs)
    speed, vx, vy = inputs[..., 0] * SPEED_HALF + SPEED_MIDDLE, inputs[..., 2] * 100.0, inputs[..., 3] * 100.0
    still = jnp.zeros_like(speed)
    return (
        VehicleState(still, still, still, speed),
        (inputs[..., GOAL] * goal_range, inputs[..., GOAL + 1] * goal_range),
        VehicleState(
            inputs[..., 4] * intruder_range, inputs[..., 5] * intruder_range, jnp.arctan2(vy, vx), jnp.hypot(vx, vy)
        ),
    )
