"""The surrogate as a host drives it: one compiled call and one transfer a step, fresh starts from a pool."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp

from envs import surrogate
from envs.encounters import Encounter
from envs.relative import distance
from envs.surrogate import State, World

__all__ = ["Setting", "begin", "step"]


class Setting(NamedTuple):
    """What a step is compiled for; plain numbers only."""

    world: World
    noisy: bool
    """Whether reports are noisy or late."""
    late: bool


@partial(jax.jit, static_argnums=3)
def begin(encounter: Encounter, key: jax.Array, tick: int, setting: Setting) -> tuple[State, jax.Array]:
    """Begin encounters ``[N]``.

    Args:
        encounter: the starts, float32.
        key: of the noise.
        tick: number of the call under this key.
        setting: static.

    Returns:
        The state and, packed as float32 ``[N, 10]``: observation (8), distance to the nearest intruder and to the
        goal, m.
    """
    state = surrogate.reset(encounter, late_reports=setting.late)
    seen = _seen(state, jax.random.fold_in(key, tick), setting.noisy)
    return state, jnp.concatenate([seen, jnp.stack(_distances(state), axis=-1)], axis=-1)


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
    """Advance all encounters; the n-th (from 0) that ends in this step begins anew from row ``used + n`` of the pool.

    Args:
        state: ``[N]``; its memory is taken over.
        pool: starts ``[P]``, at least N of them from row ``used`` on.
        used: rows of the pool that are taken.
        actions: ``[N, 2]``.
        key: of the noise.
        tick: number of the call under this key.
        setting: static.

    Returns:
        The state to go on with and, packed as float32 ``[N, 22]``, because a transfer costs more than what it
        carries: observation (8), observation at the end of the step (8), reward, code of the outcome (0 flying,
        1 violation, 2 reached, 3 timeout), smallest separation in the step, goal distance, and of the fresh start the
        distance to the nearest intruder and to the goal, m.
    """
    final, result = surrogate.step(state, (actions[:, 0], actions[:, 1]), setting.world)
    # Encounters that go on point at some row too; what they get from there is not used.
    row = jnp.maximum(used + jnp.cumsum(final.ended) - 1, 0)
    fresh = surrogate.reset(jax.tree.map(lambda field: field[row], pool), late_reports=setting.late)
    following = surrogate.restart(final, fresh)
    # Of an encounter's two observations only one is ever followed by an action, so they may share the noise.
    noise_key = jax.random.fold_in(key, tick)
    violation, reached, timeout = result.outcome
    code = 1.0 * violation + 2.0 * reached + 3.0 * timeout
    columns = jnp.stack([result.reward, code, result.separation, result.goal_distance, *_distances(fresh)], axis=-1)
    packed = [_seen(following, noise_key, setting.noisy), _seen(final, noise_key, setting.noisy), columns]
    return following, jnp.concatenate(packed, axis=-1)


def _seen(state: State, key: jax.Array, noisy: bool) -> jax.Array:
    return surrogate.observe(state, jax.random.normal(key, (4, *state.mask.shape)) if noisy else None)


def _distances(state: State) -> tuple[jax.Array, jax.Array]:
    """Return the distances to the nearest intruder and to the goal, m, ``[N]`` each."""
    own, other = state.own, state.intruders.vehicle
    apart = distance(other.x - own.x[:, None], other.y - own.y[:, None], jnp)
    nearest = jnp.min(jnp.where(state.mask, apart, jnp.inf), axis=-1)
    return nearest, distance(state.goal_x - own.x, state.goal_y - own.y, jnp)
