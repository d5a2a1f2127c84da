"""What a policy comes to on its flights, and what it is told there."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from agents.learning.networks import Actor, Derived, derived
from agents.learning.ppo import Taught
from envs import surrogate
from envs.observation import DISTANCE_HALF
from rlcas_jax.dagger_config import DaggerRun
from rlcas_jax.promptness import Asked, in_the_way
from rlcas_jax.starts import Own, draw, noisy
from rlcas_jax.teaching import acting, teacher

__all__ = ["Gather", "Samples", "gatherer", "joined"]

_NEAR, _ASIDE = 2_500.0, math.radians(15.0)
"""Distance of a goal that is near, m; bearing from which on it lies aside, rad."""


class Samples(NamedTuple):
    """What was seen, and what was told of it, ``[M, ...]``."""

    observation: np.ndarray
    """``[M, 8]``."""
    following: np.ndarray
    """What was seen a time step later where that is to be smooth, and the same again where not, ``[M, 8]``."""
    low: np.ndarray
    """Within what either command shall be, 1 at the limit, infinite where anything beyond will do, ``[M, 2]``."""
    high: np.ndarray
    weight: np.ndarray
    """Of the distance from there, ``[M, 2]``."""


def joined(parts: list[Samples]) -> Samples:
    """Return several samples as one."""
    return Samples(*(np.concatenate(fields) for fields in zip(*parts, strict=True)))


Gather = Callable[[Any, int, Callable[[int], None]], tuple[Samples, float]]
"""(Parameters of a policy, number of the round, told how many rollouts are done) -> what it was told, and what share of
its flights it resolved. The number, with the seed, decides everything random."""


def gatherer(config: DaggerRun, actor: Actor) -> Gather:
    """Return how a policy is flown through a training's encounters, and told what is better; compiled once.

    Args:
        config: of the flights and of what is told.
        actor: of the policy.

    Raises:
        ConfigError: encounters or a policy that it names cannot be used.
    """
    settings, count, steps = config.dagger, config.ppo.environments, config.ppo.rollout
    own = Own.of(config)
    fly, tell = _flight(config, actor, own), _lesson(config, actor)

    def gather(variables: Any, number: int, said: Callable[[int], None]) -> tuple[Samples, float]:
        key = jax.random.fold_in(jax.random.key(config.seed), number)
        random = np.random.default_rng((config.seed, number))
        state = jax.tree.map(lambda field: field[0], draw(key, config, _scenarios(config), 1, own))
        found: list[Samples] = []
        reached = ended = 0
        for rollout in range(settings.settling + settings.rollouts):
            key, now = jax.random.split(key)
            state, flown = fly(variables, state, now)
            if rollout < settings.settling:
                continue
            observation = flown.observation.reshape(count * steps, -1)
            told = jax.device_get(tell(variables, observation, flown.mean.reshape(count * steps, -1)))
            found.append(_worthwhile(config, jax.device_get(flown), told, random))
            reached, ended = reached + int(flown.reached), ended + int(flown.ended)
            said(rollout + 1 - settings.settling)
        return joined(found), reached / max(ended, 1)

    return gather


class _Flown(NamedTuple):
    """A rollout, ``[T, N, ...]``."""

    observation: jax.Array
    following: jax.Array
    """The next one of the same encounter; the same where there is none."""
    mean: jax.Array
    reached: jax.Array
    """How many encounters were resolved, ``[]``."""
    ended: jax.Array
    """How many ended, ``[]``."""


def _scenarios(config: DaggerRun) -> list[Any]:
    return [entry.scenario() for entry in config.scenarios]


def _flight(config: DaggerRun, actor: Actor, own: Own) -> Callable[..., tuple[surrogate.State, _Flown]]:
    """Return (parameters, encounters in flight, key) -> (the same later, what was flown)."""
    world, scenarios = surrogate.World(config.world.rules(), config.world.limits()), _scenarios(config)
    count, steps = config.ppo.environments, config.ppo.rollout
    lively = (jnp.arange(count) >= round(config.dagger.still * count)).astype(jnp.float32)[:, None]

    @jax.jit
    def fly(variables: Any, state: surrogate.State, key: jax.Array) -> tuple[surrogate.State, _Flown]:
        pool_key, noise_key, see_key = jax.random.split(key, 3)
        pool = draw(pool_key, config, scenarios, config.pool_rows, own)
        noise = jax.random.normal(noise_key, (steps, count, 2)) * lively

        def forward(flying: surrogate.State, now: tuple[jax.Array, jax.Array]) -> tuple[surrogate.State, Any]:
            index, drawn = now
            flying = surrogate.restart(flying, jax.tree.map(lambda rows: rows[index % config.pool_rows], pool))
            errors = None
            if noisy(scenarios):
                errors = jax.random.normal(jax.random.fold_in(see_key, index), (4, *flying.mask.shape))
            observation = surrogate.observe(flying, errors)
            applied: Any = actor.apply(variables, observation)
            mean, log_std = applied
            action = mean + jnp.exp(log_std) * drawn
            flying, result = surrogate.step(flying, (action[:, 0], action[:, 1]), world)
            return flying, (observation, mean, result.outcome.reached, result.outcome.ended(jnp))

        state, (observation, mean, reached, ended) = jax.lax.scan(forward, state, (jnp.arange(steps), noise))
        later = jnp.concatenate([observation[1:], observation[-1:]])
        following = jnp.where(ended[..., None], observation, later)
        return state, _Flown(observation, following, mean, jnp.sum(reached), jnp.sum(ended))

    return fly


def _lesson(config: DaggerRun, actor: Actor) -> Callable[[Any, jax.Array, jax.Array], Taught]:
    """Return (parameters, observations ``[M, 8]``, mean actions ``[M, 2]``) -> what is told."""
    feature_set = config.network.feature_set
    anchor = _itself
    if config.practice.teacher is not None:
        anchor = acting(config.practice.teacher, "practice.teacher", feature_set)

    def hold(seen: Derived, mean: jax.Array) -> jax.Array:
        return jnp.where(in_the_way(seen)[..., None], mean, anchor(seen, mean))

    teach = teacher(config, Asked(config.dagger.blocked, config.dagger.flown), hold)
    assert teach is not None  # the configuration has a lesson

    @jax.jit
    def tell(variables: Any, observation: jax.Array, mean: jax.Array) -> Taught:
        seen = derived(observation, feature_set)
        everywhere = jnp.ones(observation.shape[:-1])
        return teach(seen, everywhere, mean, lambda later: actor.apply(variables, later)[0])

    return tell


def _itself(_: Derived, mean: jax.Array) -> jax.Array:
    return mean


def _worthwhile(config: DaggerRun, flown: _Flown, told: Taught, random: np.random.Generator) -> Samples:
    """Return what is to be learned of a rollout: all that lessons speak of, and a share of the rest."""
    observation, following = (
        np.asarray(field).reshape(-1, field.shape[-1]) for field in (flown.observation, flown.following)
    )
    low, high, weight = (np.asarray(field, dtype=np.float32) for field in told)
    plain = (weight == np.float32(config.practice.teaching)).all(axis=-1)
    chosen = weight.any(axis=-1) & (~plain | (random.random(len(plain)) < config.dagger.kept))
    smooth = np.where((plain & ~_turns_in(observation))[:, None], following, observation)
    return Samples(*(field[chosen] for field in (observation, smooth, low, high, weight)))


def _turns_in(observation: np.ndarray) -> np.ndarray:
    """Return who is about to turn in to the goal, ``[M]``: who is a little too gentle there passes it."""
    bearing, goal_range = observation[:, 6] * math.pi, (observation[:, 7] + 1.0) * DISTANCE_HALF
    return (goal_range < _NEAR) & (np.abs(bearing) > _ASIDE)
