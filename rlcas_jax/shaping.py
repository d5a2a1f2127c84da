"""What learning is paid besides the reward: hints by a potential, which leave the optimal policy as it is, and prices.

Potential-based shaping: Ng, Harada, Russell 1999.
"""

import math

import jax
import jax.numpy as jnp

from envs.kinematics import VehicleState
from envs.outcome import Rules
from envs.relative import bearing, distance, straight_cpa
from envs.surrogate import State
from rlcas_jax.config import ShapingConfig, TrainConfig
from rlcas_jax.escape_margin import best

__all__ = [
    "GENTLE",
    "delay",
    "detour",
    "escape",
    "paid",
    "potential",
    "price",
    "rejoin",
    "shaped",
    "swing",
    "worth",
]

ESCAPE_UNIT = 50.0
"""Metres beyond the separation that count 1 in :func:`escape`; what is beyond counts no more."""

GENTLE = math.radians(0.35)
"""Rate up to which a turn towards the goal costs nothing, rad/s; it is below what counts as a turn when heading
reversals are counted."""


def potential(state: State, weights: ShapingConfig, rules: Rules) -> jax.Array:
    """Return the potential of each encounter, ``[N]``, in units of the scaled reward.

    Args:
        state: encounters in progress.
        weights: of the goal, a predicted conflict, an escape (:func:`escape`), a delay (:func:`delay`).
        rules: separation, before which ``state.required_separation`` goes, and time limit.
    """
    separation = rules.separation
    total = -weights.goal * distance(state.goal_x - state.own.x, state.goal_y - state.own.y, jnp) * 1e-4
    if weights.conflict:
        own = VehicleState(*(field[:, None] for field in state.own))
        cpa = straight_cpa(own, state.intruders.vehicle, jnp)
        depth = jnp.where(state.mask, jnp.clip(1.0 - cpa.distance / separation, 0.0, 1.0), 0.0)
        total = total - weights.conflict * depth.max(axis=-1)
    if weights.escape:
        total = total + weights.escape * escape(state, separation)
    if weights.delay:
        total = total - weights.delay * delay(state, rules)
    return total


def delay(state: State, rules: Rules) -> jax.Array:
    """Return whether the present speed is too slow for the goal, ``[N]``: 0 with 30 s to spare, 1 if 30 s too late.

    No input tells the time, and a policy that trails a slow intruder meets the penalty too late to
    do anything about it.

    Args:
        state: encounters in progress.
        rules: time step and time limit.
    """
    left = distance(state.goal_x - state.own.x, state.goal_y - state.own.y, jnp)
    spare = rules.t_max - state.steps * rules.dt - left / jnp.maximum(state.own.speed, 1.0)
    return jnp.clip(0.5 - spare * (1.0 / 60.0), 0.0, 1.0)


def escape(state: State, separation: float) -> jax.Array:
    """Return what the best of twelve manoeuvres keeps beyond the separation, ``[N]`` in [-1, 1].

    It says within a step what a turn to the wrong side, or at the wrong speed, takes away, which the loss says much
    later and in the few encounters only that leave nothing to spare.

    Args:
        state: encounters in progress.
        separation: m; ``state.required_separation`` goes before it.
    """
    kept = best(state.own, state.goal_x, state.goal_y, state.intruders.vehicle, state.mask, jnp)
    spare = kept - (separation if state.required_separation is None else state.required_separation)
    return jnp.clip(spare * (1.0 / ESCAPE_UNIT), -1.0, 1.0)


def shaped(before: jax.Array, after: jax.Array, terminated: jax.Array, discount: float) -> jax.Array:
    """Return the shaping reward of a step: the discounted gain in potential, which is 0 once terminated."""
    return discount * jnp.where(terminated, 0.0, after) - before


def price(yaw_rate: jax.Array, full: float) -> jax.Array:
    """Return what a step's turn costs, ``[N]``, in units of the scaled reward.

    Without it a turn that leads nowhere costs next to nothing, and a policy keeps wider of the others, and swerves more
    often, than it must.

    Args:
        yaw_rate: as commanded, 1 at the limit; what is beyond is not flown.
        full: cost of a step at the limit; it falls with the square.
    """
    return full * jnp.square(jnp.clip(yaw_rate, -1.0, 1.0))


def swing(yaw_rate: jax.Array, rate_max: float, dt: float, price_90_degrees: float) -> jax.Array:
    """Return what a step's change of heading costs, ``[N]``, in units of the scaled reward.

    Its sum over a flight is that of all turns, however sharp: one turn too many costs what it turns, and what can be
    resolved by speed alone is resolved for nothing.

    Args:
        yaw_rate: as commanded, 1 at the limit; what is beyond is not flown.
        rate_max: the limit, rad/s.
        dt: the step, s.
        price_90_degrees: of a quarter turn.
    """
    turned = jnp.abs(jnp.clip(yaw_rate, -1.0, 1.0)) * (rate_max * dt)
    return price_90_degrees * turned / (0.5 * jnp.pi)


def rejoin(
    own: VehicleState,
    goal_x: jax.Array,
    goal_y: jax.Array,
    yaw_rate: jax.Array,
    limit: float,
    dt: float,
    price_90_degrees: float,
) -> jax.Array:
    """Return what a step's turn towards the goal costs, ``[N]``, in units of the scaled reward.

    The way back has time, unlike the way out: it alone is to be gentle, and turning away costs nothing.

    Args:
        own: the ownship at the start of the step.
        goal_x, goal_y: m.
        yaw_rate: as commanded, 1 at the limit; what is beyond is not flown.
        limit: rad/s.
        dt: the step, s.
        price_90_degrees: of a quarter turn at the limit; what is slower than :data:`GENTLE` is free.
    """
    towards = jnp.clip(yaw_rate, -1.0, 1.0) * limit * jnp.sign(bearing(own, goal_x, goal_y, jnp))
    share = jnp.maximum(towards - GENTLE, 0.0) / max(limit - GENTLE, 1e-9)  # a vehicle may be slower than that
    return swing(share, limit, dt, price_90_degrees)


def detour(
    before: VehicleState, after: VehicleState, goal_x: jax.Array, goal_y: jax.Array, price_10km: float
) -> jax.Array:
    """Return what a step's way costs beyond what it brought the goal nearer, ``[N]``, in units of the scaled reward.

    Its sum over a flight is the price of the flight's path excess. The discount asks for short times instead, and so
    prefers a fast detour to a slow straight way.

    Args:
        before: the ownship at the start of the step.
        after: the same at its end.
        goal_x, goal_y: m.
        price_10km: of 10 km.
    """
    flown = distance(after.x - before.x, after.y - before.y, jnp)
    left = [distance(goal_x - own.x, goal_y - own.y, jnp) for own in (before, after)]
    return price_10km * 1e-4 * (flown - (left[0] - left[1]))


def worth(state: State, config: TrainConfig) -> jax.Array:
    """Return the potential of each encounter under a configuration, ``[N]``."""
    return potential(state, config.shaping, config.world.rules())


def paid(reward: jax.Array, before: State, after: State, yaw_rate: jax.Array, config: TrainConfig) -> jax.Array:
    """Return what a step is worth to the learner, ``[N]``: the scaled reward with everything besides it.

    Args:
        reward: the task's.
        before: encounters before the step.
        after: the same after it, ended or not.
        yaw_rate: as commanded, 1 at the limit.
        config: scale, discount and shaping.
    """
    prices = config.shaping
    worths = worth(before, config), worth(after, config)
    total = config.ppo.reward_scale * reward + shaped(*worths, after.ended, config.ppo.discount)
    if prices.turn:
        total = total - price(yaw_rate, prices.turn)
    limit, dt = float(config.world.limits().yaw_rate_max), float(config.world.rules().dt)
    if prices.swing:
        total = total - swing(yaw_rate, limit, dt, prices.swing)
    if prices.rejoin:
        total = total - rejoin(before.own, before.goal_x, before.goal_y, yaw_rate, limit, dt, prices.rejoin)
    if prices.detour:
        total = total - detour(before.own, after.own, before.goal_x, before.goal_y, prices.detour)
    return total
