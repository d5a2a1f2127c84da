"""The reward for learning: the task's, potential-based shaping, and costs of turns and detours.

Potentials leave the optimal policy as it is (Ng, Harada, Russell 1999); costs do not.
"""

import jax
import jax.numpy as jnp

from envs.aircraft import Aircraft
from envs.kinematics import VehicleState
from envs.relative import distance
from envs.surrogate import State
from rlcas_jax.config import ShapingConfig, TrainConfig

DETOUR = 4.0
"""Way round per metre by which the goal lies inside the turning circle; from its centre 4.5 radii
are the shortest.
"""


def learning_reward(
    reward: jax.Array,
    before: State,
    after: State,
    yaw_rate: jax.Array,
    config: TrainConfig,
    aircraft: Aircraft,
) -> jax.Array:
    """Return the reward that is learned from, ``[N]``: the scaled one of the task, shaping and
    costs.

    Of encounters that may have ended, the yaw rate as commanded, 1 at the limit; limits are floats
    or ``[N]``.
    """
    weights = config.shaping
    potentials = potential(before, weights, aircraft), potential(after, weights, aircraft)
    total = config.ppo.reward_scale * reward + shaped(*potentials, after.ended, config.ppo.discount)
    if weights.turn_rate_cost:
        total = total - weights.turn_rate_cost * turn_rate_cost(yaw_rate)
    if weights.heading_change_cost:
        cost = heading_change_cost(yaw_rate, aircraft.limits.yaw_rate_max, aircraft.dt)
        total = total - weights.heading_change_cost * cost
    if weights.path_excess_cost:
        cost = path_excess_cost(
            before.own, after.own, (before.goal_x, before.goal_y), aircraft.separation
        )
        total = total - weights.path_excess_cost * cost
    return total


def potential(state: State, weights: ShapingConfig, aircraft: Aircraft) -> jax.Array:
    """Return the potential of each encounter, ``[N]``, in units of the scaled reward.

    It counts the distance to the goal, and the way round where the goal lies inside the turning
    circle: without that, circling the goal for ever is no worse than leaving it to come back.
    """
    own, x, y = state.own, state.goal_x - state.own.x, state.goal_y - state.own.y
    radius = own.speed / aircraft.limits.yaw_rate_max
    sine, cosine = jnp.sin(own.heading), jnp.cos(own.heading)
    # The centre of the turning circle on the goal's side lies abeam.
    from_centre = distance(x * cosine + y * sine, jnp.abs(y * cosine - x * sine) - radius, jnp)
    inside = jnp.maximum(radius - aircraft.goal_radius - from_centre, 0.0)
    return -weights.goal * (distance(x, y, jnp) + DETOUR * inside) * (0.1 / aircraft.separation)


def shaped(
    before: jax.Array, after: jax.Array, terminated: jax.Array, discount: float
) -> jax.Array:
    """Return the shaping reward of a step: the discounted gain in potential, which is 0 once
    terminated.
    """
    return discount * jnp.where(terminated, 0.0, after) - before


def turn_rate_cost(yaw_rate: jax.Array) -> jax.Array:
    """Return the squared turn rate as flown, ``[N]``, from commands of which 1 is the limit."""
    return jnp.square(jnp.clip(yaw_rate, -1.0, 1.0))


def heading_change_cost(yaw_rate: jax.Array, limit: float, dt: float) -> jax.Array:
    """Return the change of heading in a step of ``dt`` s, in quarter turns, ``[N]``; the limit is
    in rad/s.
    """
    turned = jnp.abs(jnp.clip(yaw_rate, -1.0, 1.0)) * (limit * dt)
    return turned / (0.5 * jnp.pi)


def path_excess_cost(
    before: VehicleState, after: VehicleState, goal: tuple[jax.Array, jax.Array], separation: float
) -> jax.Array:
    """Return the path of a step less what it brought the goal nearer, in ten separations, ``[N]``;
    the goal is x, y, m.

    The discount alone favours short times, and so a fast detour over a slow straight path.
    """
    flown = distance(after.x - before.x, after.y - before.y, jnp)
    left = [distance(goal[0] - own.x, goal[1] - own.y, jnp) for own in (before, after)]
    return (0.1 / separation) * (flown - (left[0] - left[1]))
