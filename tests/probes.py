"""Probe environments that localise a defect of a learning algorithm: each needs one more part of it
than the one before.

A probe's episode lasts one or two steps. Everything that differs between probes is data, so that
one compiled training loop serves all of them.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from agents.learning.algorithm import Algorithm
from rlcas_jax.collect import Environment, RolloutStep, collect

COUNT, STEPS = 32, 16


class Probe(NamedTuple):
    """An environment: what is seen, how long an episode lasts and what its last step pays."""

    shows_sign: float = 0.0
    """The first component of the observation is an episode's random sign."""
    shows_clock: float = 0.0
    """The second is the number of the step."""
    length: float = 1.0
    pays: float = 0.0
    pays_sign: float = 0.0
    target: float | None = None
    """The action whose squared distance is paid for; None: any action will do."""
    target_by_sign: float = 0.0
    discount: float = 0.99


class World(NamedTuple):
    sign: jax.Array
    clock: jax.Array
    ended: jax.Array
    key: jax.Array


def environment(probe: Probe, cost: jax.Array) -> Environment:
    """Return the environment; its observations are an episode's sign and its clock."""

    def observe(world: World, key: jax.Array) -> jax.Array:
        return jnp.stack([probe.shows_sign * world.sign, probe.shows_clock * world.clock], axis=-1)

    def step(world: World, action: jax.Array) -> tuple[World, RolloutStep]:
        clock = world.clock + 1.0
        ended = clock >= probe.length
        miss = action[:, 0] - probe.target - probe.target_by_sign * world.sign
        reward = (
            jnp.where(ended, probe.pays + probe.pays_sign * world.sign, 0.0) - cost * miss * miss
        )
        return world._replace(clock=clock, ended=ended), RolloutStep(reward, ended, None)

    def restart(world: World, index: jax.Array) -> World:
        key, draw = jax.random.split(world.key)
        sign = jnp.where(jax.random.bernoulli(draw, 0.5, (COUNT,)), 1.0, -1.0)
        return World(
            jnp.where(world.ended, sign, world.sign),
            jnp.where(world.ended, 0.0, world.clock),
            jnp.zeros(COUNT, bool),
            key,
        )

    return Environment(observe, step, restart)


Make = Callable[[jax.Array], Algorithm]
"""Makes an algorithm for a discount."""


@partial(jax.jit, static_argnums=(0, 1, 2))
def _train_compiled(make: Make, updates: int, rate: float, probe: Probe, cost: jax.Array) -> Any:
    algorithm = make(probe.discount)
    world = World(jnp.ones(COUNT), jnp.zeros(COUNT), jnp.ones(COUNT, bool), jax.random.key(0))

    def one(carry: tuple[Any, World], index: jax.Array) -> tuple[tuple[Any, World], None]:
        state, world = carry
        noise_key, observe_key, update_key = jax.random.split(
            jax.random.fold_in(jax.random.key(1), index), 3
        )
        noise = jax.random.normal(noise_key, (STEPS, COUNT, 2))
        world, rollout, _ = collect(
            algorithm, state, environment(probe, cost), world, noise, observe_key
        )
        now = rate * (1.0 - index / updates)
        return (algorithm.update(state, rollout, update_key, now)[0], world), None

    begin = algorithm.init(jax.random.key(2), jnp.zeros((1, 2))), world
    return jax.lax.scan(one, begin, jnp.arange(updates))[0][0]


def train_on_probe(make: Make, updates: int, rate: float, probe: Probe) -> Any:
    """Return an algorithm's state after updates with a learning rate that falls to 0."""
    cost = 0.0 if probe.target is None else 1.0
    given = jax.tree.map(jnp.float32, probe._replace(target=probe.target or 0.0))
    return _train_compiled(make, updates, rate, given, jnp.float32(cost))
