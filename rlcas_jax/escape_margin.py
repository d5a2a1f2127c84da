"""What the best of twelve simple manoeuvres keeps of the separation: how much there is left to lose.

The manoeuvres are those of :mod:`agents.policy.escape_features`, here from the true state and with all intruders, which
fly straight on.
"""

from functools import partial, reduce
from typing import Any

import jax
import jax.numpy as jnp

from agents.policy.escape_features import COUNT, separations
from envs.angles import sincos
from envs.kinematics import SURROGATE, VehicleState, advance, commands, velocity
from envs.observation import Decoded
from envs.relative import bearing, leg_separation

__all__ = ["after", "best", "each", "one_by_one", "twelve", "undecided"]

_SECOND = 1.0

_TIED = 50.0
"""Up to how far apart what turns to either side keep is as much, m."""


def best(own: VehicleState, goal_x: Any, goal_y: Any, intruders: VehicleState, mask: Any, xp: Any) -> Any:
    """Return the least separation from all intruders under the manoeuvre that keeps most, m, ``[...]``.

    Args:
        own: ownship, ``[...]``.
        goal_x, goal_y: m, ``[...]``.
        intruders: fields ``[..., K]``.
        mask: which of them are there, ``[..., K]``; where none is, the answer is infinite.
        xp: array namespace, numpy or jax.numpy.
    """
    return reduce(xp.maximum, each(own, goal_x, goal_y, intruders, mask, xp))


def each(own: VehicleState, goal_x: Any, goal_y: Any, intruders: VehicleState, mask: Any, xp: Any) -> list[Any]:
    """Return the same of each manoeuvre, 12 times ``[...]``; arguments as for :func:`best`."""
    seen_by = VehicleState(*(field[..., None] for field in own))
    sine, cosine = sincos(seen_by.heading, xp)
    x, y = intruders.x - seen_by.x, intruders.y - seen_by.y
    vx, vy = velocity(intruders, xp)
    speed = xp.broadcast_to(seen_by.speed, x.shape)
    geometry = Decoded(
        speed,
        x * cosine + y * sine,
        y * cosine - x * sine,
        vx * cosine + vy * sine,
        vy * cosine - vx * sine,
        speed,  # the manoeuvres turn by the goal's bearing, wherever it is
        speed,
    )
    homeward = xp.broadcast_to(bearing(seen_by, goal_x[..., None], goal_y[..., None], xp), x.shape)
    return [xp.min(xp.where(mask, kept, xp.inf), axis=-1) for kept in separations(geometry, homeward, xp)]


def undecided(left: Any, right: Any, xp: Any) -> Any:
    """Return how far turns to either side are as good, in [0, 1], from what the best of each keep, m."""
    return xp.clip(2.0 - xp.abs(left - right) * (1.0 / _TIED), 0.0, 1.0)


def twelve(goal_bearing: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Return acceleration and yaw rate of the manoeuvres in their first second, 1 at the limit, ``[..., 12]`` each.

    Args:
        goal_bearing: direction of the goal from the ownship's heading, rad, left positive, ``[...]``.
    """
    home = jnp.clip(goal_bearing * (1.0 / SURROGATE.yaw_rate_max), -1.0, 1.0)
    turns = jnp.stack([jnp.ones_like(home), -jnp.ones_like(home), jnp.zeros_like(home), home], axis=-1)
    accelerations = jnp.tile(jnp.array([-1.0, 0.0, 1.0]), COUNT // 3)
    return jnp.broadcast_to(accelerations, (*home.shape, COUNT)), jnp.repeat(turns, 3, axis=-1)


def after(
    tried: tuple[jax.Array, jax.Array],
    own: VehicleState,
    goal_x: jax.Array,
    goal_y: jax.Array,
    intruders: VehicleState,
    mask: jax.Array,
) -> jax.Array:
    """Return the least separation of who flies a second of commands and then whichever manoeuvre keeps most.

    Args:
        tried: acceleration and yaw rate, 1 at the limit, ``[..., A]`` each.
        own: ownship, ``[...]``.
        goal_x, goal_y: m, ``[...]``.
        intruders: fields ``[..., K]``.
        mask: which of them are there, ``[..., K]``.

    Returns:
        m, ``[..., A]``.
    """
    here = VehicleState(*(field[..., None] for field in own))
    own_then = advance(here, *commands(tried, SURROGATE, jnp), _SECOND, SURROGATE, jnp)  # [..., A]
    others = VehicleState(*(field[..., None, :] for field in intruders))  # [..., 1, K]
    others_then = advance(others, 0.0, 0.0, _SECOND, SURROGATE, jnp)
    here, there = (VehicleState(*(field[..., None] for field in ownship)) for ownship in (here, own_then))
    on_the_way = leg_separation(here, there, others, others_then, _SECOND, jnp)  # [..., A, K]
    shape = on_the_way.shape
    all_then = VehicleState(*(jnp.broadcast_to(field, shape) for field in others_then))
    masks = jnp.broadcast_to(mask[..., None, :], shape)
    then = best(own_then, goal_x[..., None], goal_y[..., None], all_then, masks, jnp)
    return jnp.minimum(jnp.min(jnp.where(masks, on_the_way, jnp.inf), axis=-1), then)


@partial(jax.jit, static_argnames="seconds")
def one_by_one(
    own: VehicleState, goal_x: jax.Array, goal_y: jax.Array, intruders: VehicleState, mask: jax.Array, seconds: int
) -> jax.Array:
    """Return the least separation of who flies, second by second, what leaves the most to the best manoeuvre.

    Where none of the twelve keeps enough, one after another may (a rollout, Tesauro and Galperin 1996).

    Args:
        own: ownship, ``[N]``.
        goal_x, goal_y: m, ``[N]``.
        intruders: fields ``[N, K]``.
        mask: which of them are there, ``[N, K]``.
        seconds: how many.

    Returns:
        m, ``[N]``; what the best manoeuvre keeps from the last of them on counts, too.
    """

    def forward(carry: tuple[VehicleState, VehicleState, jax.Array], _: None) -> tuple[Any, None]:
        here, others, least = carry
        tried = twelve(bearing(here, goal_x, goal_y, jnp))
        kept = after(tried, here, goal_x, goal_y, others, mask)
        chosen = jnp.argmax(kept, axis=-1, keepdims=True)
        throttle, turn = (jnp.take_along_axis(command, chosen, axis=-1)[..., 0] for command in tried)
        there = advance(here, *commands((throttle, turn), SURROGATE, jnp), _SECOND, SURROGATE, jnp)
        others_then = advance(others, 0.0, 0.0, _SECOND, SURROGATE, jnp)
        before, beyond = (VehicleState(*(field[..., None] for field in ownship)) for ownship in (here, there))
        apart = leg_separation(before, beyond, others, others_then, _SECOND, jnp)
        return (there, others_then, jnp.minimum(least, jnp.min(jnp.where(mask, apart, jnp.inf), axis=-1))), None

    begin = own, intruders, jnp.full(goal_x.shape, jnp.inf, goal_x.dtype)
    (own, intruders, least), _ = jax.lax.scan(forward, begin, None, length=seconds)
    return jnp.minimum(least, best(own, goal_x, goal_y, intruders, mask, jnp))
