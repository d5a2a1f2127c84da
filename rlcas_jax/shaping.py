"""The reward for learning: the task's, potential-based shaping, and costs of turns and detours.

Potentials leave the optimal policy as it is (Ng, Harada, Russell 1999); costs move it towards short and steady flights.
Scores contain neither.
"""

import jax
import jax.numpy as jnp

from envs.aircraft import Aircraft
from envs.kinematics import VehicleState
from envs.relative import bearing, distance
from envs.surrogate import State
from rlcas_jax.config import ShapingConfig, TrainConfig
from rlcas_jax.escape_margin import best

__all__ = [
    "FREE_TURN",
    "escape_margin",
    "heading_change_cost",
    "lateness",
    "learning_reward",
    "path_excess_cost",
    "potential",
    "rejoin_turn_cost",
    "shaped",
    "turn_rate_cost",
]

MARGIN_UNIT = 0.05
"""Separations beyond the required one that count 1 in :func:`escape_margin`; what is beyond counts no more."""

FREE_TURN = 0.35 / 3.0
"""Share of the greatest turn rate up to which a turn towards the goal costs nothing."""


def learning_reward(
    reward: jax.Array, before: State, after: State, yaw_rate: jax.Array, config: TrainConfig, aircraft: Aircraft
) -> jax.Array:
    """Return the reward that is learned from, ``[N]``: the scaled one of the task, shaping and costs.

    Args:
        reward: the task's.
        before: encounters before the step.
        after: the same after it, ended or not.
        yaw_rate: as commanded, 1 at the limit.
        config: scale, discount and shaping.
        aircraft: the ownship; floats, or limits ``[N]``.
    """
    weights = config.shaping
    potentials = potential(before, weights, aircraft), potential(after, weights, aircraft)
    total = config.ppo.reward_scale * reward + shaped(*potentials, after.ended, config.ppo.discount)
    limit, dt = aircraft.limits.yaw_rate_max, aircraft.dt
    if weights.turn_rate_cost:
        total = total - weights.turn_rate_cost * turn_rate_cost(yaw_rate)
    if weights.heading_change_cost:
        total = total - weights.heading_change_cost * heading_change_cost(yaw_rate, limit, dt)
    if weights.rejoin_turn_cost:
        cost = rejoin_turn_cost(before.own, before.goal_x, before.goal_y, yaw_rate, limit, dt)
        total = total - weights.rejoin_turn_cost * cost
    if weights.path_excess_cost:
        cost = path_excess_cost(before.own, after.own, (before.goal_x, before.goal_y), aircraft.separation)
        total = total - weights.path_excess_cost * cost
    return total


def shaped(before: jax.Array, after: jax.Array, terminated: jax.Array, discount: float) -> jax.Array:
    """Return the shaping reward of a step: the discounted gain in potential, which is 0 once terminated."""
    return discount * jnp.where(terminated, 0.0, after) - before


def potential(state: State, weights: ShapingConfig, aircraft: Aircraft) -> jax.Array:
    """Return the potential of each encounter, ``[N]``, in units of the scaled reward.

    Args:
        state: encounters in progress.
        weights: of the distance to the goal, :func:`escape_margin` and :func:`lateness`.
        aircraft: the ownship; ``state.required_separation`` has precedence over its separation.
    """
    left = distance(state.goal_x - state.own.x, state.goal_y - state.own.y, jnp)
    total = -weights.goal * left * (0.1 / aircraft.separation)
    if weights.escape_margin:
        total = total + weights.escape_margin * escape_margin(state, aircraft.separation)
    if weights.lateness:
        total = total - weights.lateness * lateness(state, aircraft)
    return total


def escape_margin(state: State, separation: float) -> jax.Array:
    """Return what the best of twelve escape manoeuvres keeps beyond the separation, ``[N]`` in [-1, 1].

    It drops within a step when a turn goes to the wrong side; a violation comes much later, and only where little
    margin was left.

    Args:
        state: encounters in progress.
        separation: m; ``state.required_separation`` has precedence.
    """
    kept = best(state.own, state.goal_x, state.goal_y, state.intruders.vehicle, state.mask, jnp)
    spare = kept - (separation if state.required_separation is None else state.required_separation)
    return jnp.clip(spare * (1.0 / (MARGIN_UNIT * separation)), -1.0, 1.0)


def lateness(state: State, aircraft: Aircraft) -> jax.Array:
    """Return how late the goal is reached at the present speed, ``[N]``.

    It is 0 with a tenth of the time limit to spare and 1 if a tenth too late.

    The observation does not contain the time, so that the time limit alone is learned slowly.

    Args:
        state: encounters in progress.
        aircraft: its time step, time limit and speed.
    """
    left = distance(state.goal_x - state.own.x, state.goal_y - state.own.y, jnp)
    speed = jnp.maximum(state.own.speed, 0.01 * aircraft.limits.speed_max)
    spare = aircraft.t_max - state.steps * aircraft.dt - left / speed
    return jnp.clip(0.5 - spare * (1.0 / (0.2 * aircraft.t_max)), 0.0, 1.0)


def turn_rate_cost(yaw_rate: jax.Array) -> jax.Array:
    """Return the squared turn rate as flown, ``[N]``, from commands of which 1 is the limit."""
    return jnp.square(jnp.clip(yaw_rate, -1.0, 1.0))


def heading_change_cost(yaw_rate: jax.Array, limit: float, dt: float) -> jax.Array:
    """Return the change of heading of a step in quarter turns, ``[N]``; its sum over a flight is that of all turns.

    Args:
        yaw_rate: as commanded, 1 at the limit; what is beyond is not flown.
        limit: of the turn rate, rad/s.
        dt: the step, s.
    """
    turned = jnp.abs(jnp.clip(yaw_rate, -1.0, 1.0)) * (limit * dt)
    return turned / (0.5 * jnp.pi)


def rejoin_turn_cost(
    own: VehicleState, goal_x: jax.Array, goal_y: jax.Array, yaw_rate: jax.Array, limit: float, dt: float
) -> jax.Array:
    """Return the cost of a step's turn towards the goal, ``[N]``, 1 for a quarter turn at the limit.

    Turns up to :data:`FREE_TURN` of the limit and those away from the goal cost nothing: rejoining need not be brisk,
    avoiding may have to be.

    Args:
        own: the ownship at the start of the step.
        goal_x, goal_y: m.
        yaw_rate: as commanded, 1 at the limit; what is beyond is not flown.
        limit: of the turn rate, rad/s.
        dt: the step, s.
    """
    towards = jnp.clip(yaw_rate, -1.0, 1.0) * jnp.sign(bearing(own, goal_x, goal_y, jnp))
    excess = jnp.maximum(towards - FREE_TURN, 0.0) / (1.0 - FREE_TURN)
    return heading_change_cost(excess, limit, dt)


def path_excess_cost(
    before: VehicleState, after: VehicleState, goal: tuple[jax.Array, jax.Array], separation: float
) -> jax.Array:
    """Return the path of a step less what it brought the goal nearer, in ten separations, ``[N]``.

    Its sum is the path excess.

    The discount alone asks for short times, and so prefers a fast detour to a slow straight path.

    Args:
        before: the ownship at the start of the step.
        after: the same at its end.
        goal: x and y, m.
        separation: m.
    """
    flown = distance(after.x - before.x, after.y - before.y, jnp)
    left = [distance(goal[0] - own.x, goal[1] - own.y, jnp) for own in (before, after)]
    return (0.1 / separation) * (flown - (left[0] - left[1]))
