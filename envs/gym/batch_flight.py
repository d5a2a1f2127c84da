"""The surrogate as a host drives it: one compiled call and one transfer a step, fresh starts from a
pool.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from envs import surrogate
from envs.arrays import Array
from envs.encounters import Encounter
from envs.observation import ROW, SIZE
from envs.relative import distance
from envs.rewards import Rewards, Transition, learning_reward
from envs.surrogate import State, World


class Setting(NamedTuple):
    """What a step is compiled for: plain numbers, and functions of a module."""

    world: World
    noisy: bool  # whether reports are noisy or late
    intruders: int  # that an observation shows: one by its eight numbers, more as a set
    rewards: Rewards = Rewards()
    discount: float = 1.0  # of potentials among them

    @property
    def history_dt(self) -> float | None:
        """Time step of the history that late reports need, s."""
        return self.world.aircraft.dt if self.noisy else None

    @property
    def size(self) -> int:
        """Numbers S of an observation, those of a set one after the other: own, traffic, mask."""
        return SIZE if self.intruders == 1 else ROW + (ROW + 1) * self.intruders


class Columns(NamedTuple):
    """What a step says beside the observations; fields ``[N]``, in the order of its packed columns.

    The distances are in m; the last two are of the start that follows where an encounter has ended.
    """

    reward: Array
    code: Array  # of the outcome: 0 flying, 1 violation, 2 reached, 3 timeout
    separation: Array  # smallest in the step
    goal_distance: Array
    new_separation: Array  # from the nearest intruder
    new_goal_distance: Array


class Packed(NamedTuple):
    """A step in one array, because a transfer costs more than what it carries, taken apart."""

    observation: np.ndarray  # observations to act on, [N, S]
    final_observation: np.ndarray  # observations at the end of the step, [N, S]
    columns: Columns


def unpack(packed: jax.Array, setting: Setting) -> Packed:
    """Return what :func:`step` has packed, on the host."""
    host, size = np.asarray(packed), setting.size
    return Packed(host[:, :size], host[:, size : 2 * size], Columns(*host[:, 2 * size :].T))


@partial(jax.jit, static_argnums=3)
def begin(
    encounter: Encounter, key: jax.Array, tick: int, setting: Setting
) -> tuple[State, jax.Array]:
    """Begin encounters ``[N]``, float32.

    Args:
        tick: number of the call under this key.

    Returns:
        The state and, packed as float32 ``[N, S + 2]``: observation (S), distance to the nearest
        intruder and to the goal, m.
    """
    state = surrogate.reset(encounter, history_dt=setting.history_dt)
    observation = _observe(state, jax.random.fold_in(key, tick), setting)
    return state, jnp.concatenate([observation, jnp.stack(_distances(state), axis=-1)], axis=-1)


@partial(jax.jit, static_argnums=6, donate_argnums=0)
def step(
    state: State,
    pool: Encounter,
    used: int,
    actions: jax.Array,
    key: jax.Array,
    tick: int,
    setting: Setting,
) -> tuple[State, jax.Array]:
    """Advance all encounters; the n-th (from 0) that ends in this step begins anew from row ``used
    + n`` of the pool.

    Args:
        state: ``[N]``; its memory is taken over.
        pool: starts ``[P]``, at least N of them from row ``used`` on.
        used: rows of the pool that are taken.
        actions: ``[N, 2]``.
        tick: number of the call under this key.

    Returns:
        The state to go on with, and float32 ``[N, 2 S + 6]`` for :func:`unpack`.
    """
    command = actions[:, 0], actions[:, 1]
    final, result = surrogate.step(state, command, setting.world)
    moved = Transition(state, final, command, result, setting.world.aircraft)
    reward, _ = learning_reward(setting.rewards, moved, setting.discount, jnp)
    # Encounters that go on point at some row too; what they get from there is not used.
    row = jnp.maximum(used + jnp.cumsum(final.ended) - 1, 0)
    fresh = surrogate.reset(
        jax.tree.map(lambda field: field[row], pool), history_dt=setting.history_dt
    )
    following = surrogate.restart(final, fresh)
    # Of an encounter's two observations only one is ever followed by an action, so they may share
    # the noise.
    noise_key = jax.random.fold_in(key, tick)
    violation, reached, timeout = result.outcome
    new_separation, new_goal_distance = _distances(fresh)
    columns = Columns(
        reward=reward,
        code=1.0 * violation + 2.0 * reached + 3.0 * timeout,
        separation=result.separation,
        goal_distance=result.goal_distance,
        new_separation=new_separation,
        new_goal_distance=new_goal_distance,
    )
    packed = [
        _observe(following, noise_key, setting),
        _observe(final, noise_key, setting),
        jnp.stack(columns, axis=-1),
    ]
    return following, jnp.concatenate(packed, axis=-1)


def _observe(state: State, key: jax.Array, setting: Setting) -> jax.Array:
    """Return observations, ``[N, S]``, with noise drawn from the key where reports are noisy."""
    noise = jax.random.normal(key, (4, *state.mask.shape)) if setting.noisy else None
    aircraft = setting.world.aircraft
    if setting.intruders == 1:
        return surrogate.observe(state, aircraft, noise)
    parts = surrogate.observe_set(state, aircraft, noise, setting.intruders)
    return jnp.concatenate(
        [part.reshape(part.shape[0], -1).astype(jnp.float32) for part in parts], axis=-1
    )


def _distances(state: State) -> tuple[jax.Array, jax.Array]:
    """Return the distances to the nearest intruder and to the goal, m, ``[N]`` each."""
    own, intruders = state.own, state.intruders.vehicle
    apart = distance(intruders.x - own.x[:, None], intruders.y - own.y[:, None], jnp)
    nearest = jnp.min(jnp.where(state.mask, apart, jnp.inf), axis=-1)
    return nearest, distance(state.goal_x - own.x, state.goal_y - own.y, jnp)
