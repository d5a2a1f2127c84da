"""Five probe environments that localise a defect of PPO: each needs one more part of it than the one before.

A probe's episode lasts one or two steps. Everything that differs between probes is data, so that one compiled
training loop serves all of them.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agents.learning import ppo
from agents.learning.networks import Actor, Critic
from rlcas_jax.collect import Environment, Step, collect

COUNT, STEPS, UPDATES = 32, 16, 150
SETTINGS = ppo.PpoSettings(epochs=4, minibatches=4, segment=4)
PARTS = ppo.learner(Actor((16,), "none"), Critic((16,), "none"), SETTINGS)


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
    def observe(world: World, key: jax.Array) -> jax.Array:
        return jnp.stack([probe.shows_sign * world.sign, probe.shows_clock * world.clock], axis=-1)

    def step(world: World, action: jax.Array) -> tuple[World, Step]:
        clock = world.clock + 1.0
        ended = clock >= probe.length
        miss = action[:, 0] - probe.target - probe.target_by_sign * world.sign
        reward = jnp.where(ended, probe.pays + probe.pays_sign * world.sign, 0.0) - cost * miss * miss
        return world._replace(clock=clock, ended=ended), Step(reward, ended, None)

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


@jax.jit
def trained(probe: Probe, cost: jax.Array) -> ppo.LearnerState:
    """Return the learner after UPDATES updates with a learning rate that falls to 0."""
    world = World(jnp.ones(COUNT), jnp.zeros(COUNT), jnp.ones(COUNT, bool), jax.random.key(0))

    def one(carry: tuple[ppo.LearnerState, World], index: jax.Array) -> tuple[tuple[ppo.LearnerState, World], None]:
        state, world = carry
        noise_key, observe_key, shuffle_key = jax.random.split(jax.random.fold_in(jax.random.key(1), index), 3)
        noise = jax.random.normal(noise_key, (STEPS, COUNT, 2))
        world, samples, _, _ = collect(
            state, world, noise, observe_key, environment(probe, cost), PARTS, probe.discount, 0.95
        )
        rate = 2e-2 * (1.0 - index / UPDATES)
        return (ppo.update(state, samples, shuffle_key, rate, PARTS, SETTINGS)[0], world), None

    begin = ppo.initial_state(PARTS, jax.random.key(2), jnp.zeros((1, 2))), world
    return jax.lax.scan(one, begin, jnp.arange(UPDATES))[0][0]


def solved(probe: Probe) -> tuple[ppo.LearnerState, np.ndarray]:
    """Train on a probe and return the learner and its action's standard deviation."""
    cost = 0.0 if probe.target is None else 1.0
    state = trained(jax.tree.map(jnp.float32, probe._replace(target=probe.target or 0.0)), jnp.float32(cost))
    return state, np.exp(state.actor["params"]["log_std"])


def value(state: ppo.LearnerState, *observation: float) -> float:
    return float(PARTS.value(state.critic, np.float32(observation)))


def action(state: ppo.LearnerState, *observation: float) -> float:
    return float(PARTS.policy(state.actor, np.float32(observation))[0][0])


def test_value_only() -> None:
    """Every one-step episode pays 1: a failure points to the value loss or the optimiser."""
    state, _ = solved(Probe(pays=1.0))
    assert value(state, 0.0, 0.0) == pytest.approx(1.0, abs=0.02)


def test_value_that_depends_on_the_observation() -> None:
    """What is paid is what was shown: a failure points to how observations reach the critic."""
    state, _ = solved(Probe(shows_sign=1.0, pays_sign=1.0))
    assert value(state, 1.0, 0.0) == pytest.approx(1.0, abs=0.05)
    assert value(state, -1.0, 0.0) == pytest.approx(-1.0, abs=0.05)


def test_discounting() -> None:
    """The second of two steps pays 1: a failure points to the bootstrap, the discount or the ends of episodes."""
    state, _ = solved(Probe(shows_clock=1.0, length=2.0, pays=1.0, discount=0.7))
    assert value(state, 0.0, 1.0) == pytest.approx(1.0, abs=0.05)
    assert value(state, 0.0, 0.0) == pytest.approx(0.7, abs=0.05)


def test_policy() -> None:
    """The action 0.5 pays best: a failure points to the policy loss or to the advantages' sign."""
    state, std = solved(Probe(target=0.5))
    assert action(state, 0.0, 0.0) == pytest.approx(0.5, abs=0.05)
    # Exploring costs its variance, which therefore shrinks from its initial exp(-0.5) squared = 0.37.
    assert std[0] < 0.3


def test_policy_and_value_together() -> None:
    """The best action and the pay both follow what is shown: a failure points to samples that got out of step."""
    state, std = solved(Probe(shows_sign=1.0, pays_sign=1.0, target=0.0, target_by_sign=0.5))
    assert action(state, 1.0, 0.0) == pytest.approx(0.5, abs=0.1)
    assert action(state, -1.0, 0.0) == pytest.approx(-0.5, abs=0.1)
    assert value(state, 1.0, 0.0) == pytest.approx(1.0 - std[0] ** 2, abs=0.1)
    assert value(state, -1.0, 0.0) == pytest.approx(-1.0 - std[0] ** 2, abs=0.1)
