"""Rollouts: samples that belong together stay together, episodes end and begin where they should."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agents.learning import ppo
from agents.learning.networks import Actor, Critic
from rlcas_jax.collect import Environment, Step, collect

COUNT, STEPS, DISCOUNT, LAMBDA = 3, 10, 0.9, 0.7
PARTS = ppo.learner(Actor((8,), "none", -1.0), Critic((8,), "none"), ppo.PpoSettings())


class World(NamedTuple):
    """A counter per environment that the action moves a little; an episode ends at 4 + its number."""

    number: jax.Array
    clock: jax.Array
    moved: jax.Array
    ended: jax.Array


class Seen(NamedTuple):
    """Statistics: the action as the environment got it, and the world before the step."""

    action: jax.Array
    clock: jax.Array


def observe(world: World, key: jax.Array) -> jax.Array:
    """Number, clock, what the actions moved, and a draw that is new with every observation."""
    return jnp.stack([world.number, world.clock, world.moved, jax.random.uniform(key, (COUNT,))], axis=-1)


def step(world: World, action: jax.Array) -> tuple[World, Step]:
    clock = world.clock + 1.0
    moved = world.moved + action[:, 0]
    ended = clock >= 4.0 + world.number
    after = World(world.number, clock, moved, ended)
    return after, Step(clock + 10.0 * world.number, ended, Seen(action, world.clock))


def restart(world: World, index: jax.Array) -> World:
    return world._replace(
        clock=jnp.where(world.ended, 0.0, world.clock),
        moved=jnp.where(world.ended, 100.0 + index, world.moved),
        ended=jnp.zeros(COUNT, bool),
    )


ENVIRONMENT = Environment(observe, step, restart)
BEGIN = World(jnp.arange(float(COUNT)), jnp.zeros(COUNT), jnp.zeros(COUNT), jnp.zeros(COUNT, bool))


@jax.jit
def rolled(state: ppo.LearnerState, world: World, seed: int) -> Any:
    noise_key, key = jax.random.split(jax.random.key(seed))
    noise = jax.random.normal(noise_key, (STEPS, COUNT, 2))
    return collect(state, world, noise, key, ENVIRONMENT, PARTS, DISCOUNT, LAMBDA)


@pytest.fixture(scope="module")
def state() -> ppo.LearnerState:
    return ppo.initial_state(PARTS, jax.random.key(0), 4)


@pytest.fixture(scope="module")
def rollout(state: ppo.LearnerState) -> tuple[World, ppo.Batch, Seen, dict]:
    return rolled(state, BEGIN, 1)


def test_samples_have_encounters_first_and_statistics_time_first(rollout) -> None:
    world, samples, statistics, figures = rollout
    assert samples.observation.inputs.shape == (COUNT, STEPS, 4)
    assert samples.action.shape == (COUNT, STEPS, 2)
    assert {field.shape for field in (samples.log_prob, samples.advantage, samples.target)} == {(COUNT, STEPS)}
    assert statistics.action.shape == (STEPS, COUNT, 2)
    assert world.clock.shape == (COUNT,)
    assert set(figures) == {"explained_variance"}


def test_episodes_run_through_and_begin_again_in_the_step_after_their_end(rollout) -> None:
    """By hand: episodes last 4, 5 and 6 steps; the first observation after an end is that of the new start."""
    world, samples, _, _ = rollout
    clocks = [[t % (4 + n) for t in range(STEPS)] for n in range(COUNT)]
    np.testing.assert_array_equal(samples.observation.inputs[..., 1], clocks)
    np.testing.assert_array_equal(samples.observation.inputs[..., 0], np.tile(np.arange(COUNT)[:, None], (1, STEPS)))
    # A start knows the step of the rollout at which it was needed.
    assert [float(samples.observation.inputs[n, 4 + n, 2]) for n in range(COUNT)] == [104.0, 105.0, 106.0]
    # The rollout ends after an episode's last step only for the second: its end is kept for the next rollout.
    np.testing.assert_array_equal(world.ended, [False, True, False])


def test_the_environment_gets_the_action_that_is_stored(rollout) -> None:
    _, samples, statistics, _ = rollout
    np.testing.assert_allclose(np.swapaxes(statistics.action, 0, 1), samples.action, rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(np.swapaxes(statistics.clock, 0, 1), samples.observation.inputs[..., 1])
    # And what it did shows in the next observation of the same encounter.
    same = np.asarray(samples.observation.inputs[:, 1:, 1]) > 0.0
    moved = np.diff(np.asarray(samples.observation.inputs[..., 2]), axis=1)
    np.testing.assert_allclose(moved[same], np.asarray(samples.action[:, :-1, 0])[same], atol=2e-5)


def test_the_log_probability_is_that_of_the_drawing_policy(rollout, state) -> None:
    _, samples, _, _ = rollout
    mean, log_std = PARTS.policy(state.actor, samples.observation)
    np.testing.assert_allclose(samples.log_prob, ppo.gaussian_log_prob(samples.action, mean, log_std), atol=1e-5)
    z = (np.asarray(samples.action) - mean) / np.exp(-1.0)
    assert 0.5 < z.std() < 1.5
    assert np.unique(z).size == z.size


def test_advantages_and_targets_bootstrap_from_the_next_observation_but_never_across_an_end(rollout, state) -> None:
    world, samples, _, _ = rollout
    value = np.asarray(PARTS.value(state.critic, samples.observation), np.float64)
    last_key = jax.random.fold_in(jax.random.split(jax.random.key(1))[1], STEPS)
    last = np.asarray(PARTS.value(state.critic, observe(world, last_key)), np.float64)
    for n in range(COUNT):
        expected, following = np.zeros(STEPS), 0.0
        for t in reversed(range(STEPS)):
            clock = t % (4 + n) + 1
            reward, ended = clock + 10.0 * n, clock == 4 + n
            after = last[n] if t == STEPS - 1 else value[n, t + 1]
            goes_on = 0.0 if ended else 1.0
            following = reward + DISCOUNT * after * goes_on - value[n, t] + DISCOUNT * LAMBDA * goes_on * following
            expected[t] = following
        np.testing.assert_allclose(samples.advantage[n], expected, rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(samples.target, samples.advantage + value, rtol=1e-5, atol=1e-4)


def test_rollouts_go_on_where_the_last_one_stopped(rollout, state) -> None:
    world, _, _, _ = rollout
    _, samples, _, _ = rolled(state, world, 2)
    clocks = [[(STEPS + t) % (4 + n) for t in range(STEPS)] for n in range(COUNT)]
    np.testing.assert_array_equal(samples.observation.inputs[..., 1], clocks)


def test_every_observation_and_action_has_a_draw_of_its_own(rollout, state) -> None:
    _, samples, _, _ = rollout
    noise = np.asarray(samples.observation.inputs[..., 3])
    assert np.unique(noise).size == noise.size
    _, again, _, _ = rolled(state, BEGIN, 1)
    np.testing.assert_array_equal(again.action, samples.action)
    _, other, _, _ = rolled(state, BEGIN, 3)
    assert np.intersect1d(other.action, samples.action).size == 0
    assert np.intersect1d(other.observation.inputs[..., 3], noise).size == 0
