"""Rollouts keep samples together, and shaping adds up to minus the potential of the start."""

import math
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.learning import ppo
from agents.learning.networks import Actor, Critic
from envs import surrogate
from envs.aircraft import PAPER
from envs.encounters import pad
from envs.kinematics import VehicleState
from envs.outcome import RULES
from envs.rewards import (
    DETOUR,
    Transition,
    goal_distance,
    heading_change,
    path_excess,
    shaping_reward,
    turn_rate,
)
from envs.scenarios import sample, scenario
from rlcas_jax.collect import Environment, RolloutStep, collect

COUNT, STEPS, DISCOUNT, LAMBDA = 3, 10, 0.9, 0.7
SETTINGS = ppo.PpoSettings(discount=DISCOUNT, gae_lambda=LAMBDA)
PARTS = ppo.make_networks(Actor((8,), "none", -1.0), Critic((8,), "none"), SETTINGS)


class World(NamedTuple):
    """A counter per environment that the action moves a little; an episode ends at 4 + its
    number.
    """

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
    return jnp.stack(
        [world.number, world.clock, world.moved, jax.random.uniform(key, (COUNT,))], axis=-1
    )


def step(world: World, action: jax.Array) -> tuple[World, RolloutStep]:
    clock = world.clock + 1.0
    moved = world.moved + action[:, 0]
    ended = clock >= 4.0 + world.number
    after = World(world.number, clock, moved, ended)
    return after, RolloutStep(clock + 10.0 * world.number, ended, Seen(action, world.clock))


def restart(world: World, index: jax.Array) -> World:
    return world._replace(
        clock=jnp.where(world.ended, 0.0, world.clock),
        moved=jnp.where(world.ended, 100.0 + index, world.moved),
        ended=jnp.zeros(COUNT, bool),
    )


ENVIRONMENT = Environment(observe, step, restart)
BEGIN = World(jnp.arange(float(COUNT)), jnp.zeros(COUNT), jnp.zeros(COUNT), jnp.zeros(COUNT, bool))


@jax.jit
def roll(state: ppo.LearnerState, world: World, seed: int) -> Any:
    noise_key, key = jax.random.split(jax.random.key(seed))
    noise = jax.random.normal(noise_key, (STEPS, COUNT, 2))
    algorithm = ppo.Ppo(PARTS, SETTINGS)
    world, rollout, statistics = collect(algorithm, state, ENVIRONMENT, world, noise, key)
    return world, *ppo.samples(state, rollout, PARTS, SETTINGS), statistics


@pytest.fixture(scope="module")
def state() -> ppo.LearnerState:
    return ppo.initial_state(PARTS, jax.random.key(0), jnp.zeros((1, 4)))


@pytest.fixture(scope="module")
def rollout(state: ppo.LearnerState) -> tuple[World, ppo.Batch, dict, Seen]:
    return roll(state, BEGIN, 1)


def test_samples_have_encounters_first_and_statistics_time_first(rollout) -> None:
    world, samples, figures, statistics = rollout
    assert samples.observation.shape == (COUNT, STEPS, 4)
    assert samples.action.shape == (COUNT, STEPS, 2)
    assert {field.shape for field in (samples.log_prob, samples.advantage, samples.target)} == {
        (COUNT, STEPS)
    }
    assert statistics.action.shape == (STEPS, COUNT, 2)
    assert world.clock.shape == (COUNT,)
    assert set(figures) == {"explained_variance"}


def test_episodes_run_through_and_begin_again_in_the_step_after_their_end(rollout) -> None:
    """By hand: episodes last 4, 5 and 6 steps; the first observation after an end is that of the
    new start.
    """
    world, samples, _, _ = rollout
    clocks = [[t % (4 + n) for t in range(STEPS)] for n in range(COUNT)]
    np.testing.assert_array_equal(samples.observation[..., 1], clocks)
    np.testing.assert_array_equal(
        samples.observation[..., 0], np.tile(np.arange(COUNT)[:, None], (1, STEPS))
    )
    # A start knows the step of the rollout at which it was needed.
    assert [float(samples.observation[n, 4 + n, 2]) for n in range(COUNT)] == [104.0, 105.0, 106.0]
    # The rollout ends after an episode's last step only for the second: its end is kept for the
    # next rollout.
    np.testing.assert_array_equal(world.ended, [False, True, False])


def test_the_environment_gets_the_action_that_is_stored(rollout) -> None:
    _, samples, _, statistics = rollout
    np.testing.assert_allclose(
        np.swapaxes(statistics.action, 0, 1), samples.action, rtol=1e-5, atol=1e-6
    )
    np.testing.assert_array_equal(np.swapaxes(statistics.clock, 0, 1), samples.observation[..., 1])
    # And what it did shows in the next observation of the same encounter.
    same = np.asarray(samples.observation[:, 1:, 1]) > 0.0
    moved = np.diff(np.asarray(samples.observation[..., 2]), axis=1)
    np.testing.assert_allclose(moved[same], np.asarray(samples.action[:, :-1, 0])[same], atol=2e-5)


def test_the_log_probability_is_that_of_the_drawing_policy(rollout, state) -> None:
    _, samples, _, _ = rollout
    mean, log_std = PARTS.policy(state.actor, samples.observation)
    np.testing.assert_allclose(
        samples.log_prob, ppo.gaussian_log_prob(samples.action, mean, log_std), atol=1e-5
    )
    z = (np.asarray(samples.action) - mean) / np.exp(-1.0)
    assert 0.5 < z.std() < 1.5
    assert np.unique(z).size == z.size


def test_advantages_and_targets_bootstrap_from_the_next_observation_but_never_across_an_end(
    rollout, state
) -> None:
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
            following = (
                reward
                + DISCOUNT * after * goes_on
                - value[n, t]
                + DISCOUNT * LAMBDA * goes_on * following
            )
            expected[t] = following
        np.testing.assert_allclose(samples.advantage[n], expected, rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(samples.target, samples.advantage + value, rtol=1e-5, atol=1e-4)


def test_rollouts_go_on_where_the_last_one_stopped(rollout, state) -> None:
    world, _, _, _ = rollout
    _, samples, _, _ = roll(state, world, 2)
    clocks = [[(STEPS + t) % (4 + n) for t in range(STEPS)] for n in range(COUNT)]
    np.testing.assert_array_equal(samples.observation[..., 1], clocks)


def test_every_observation_and_action_has_a_draw_of_its_own(rollout, state) -> None:
    _, samples, _, _ = rollout
    noise = np.asarray(samples.observation[..., 3])
    assert np.unique(noise).size == noise.size
    _, again, _, _ = roll(state, BEGIN, 1)
    np.testing.assert_array_equal(again.action, samples.action)
    _, other, _, _ = roll(state, BEGIN, 3)
    assert np.intersect1d(other.action, samples.action).size == 0
    assert np.intersect1d(other.observation[..., 3], noise).size == 0


# Shaping is potential-based: whatever is flown, it adds up to minus the potential of the start.

WORLD = surrogate.World(RULES, PAPER)
FLIGHTS, SECONDS = 128, 300


def worth(states: surrogate.State, weight: float) -> jax.Array:
    """Return the potential of states ``[..., N]``."""
    of = partial(goal_distance, aircraft=PAPER, xp=jnp)
    return weight * jax.jit(of if states.steps.ndim == 1 else jax.vmap(of))(states)


def turn_step(yaw_rate: Any) -> Any:
    """Return a step of a command, 1 at the limit of 3 deg/s."""
    return Transition(*(Any,) * 2, (0.0, yaw_rate), Any, PAPER)


@given(st.lists(st.floats(-10.0, 10.0), min_size=2, max_size=40), st.floats(0.5, 1.0))
def test_shaping_telescopes_to_the_starts_potential(
    potentials: list[float], discount: float
) -> None:
    """For any potential and any episode: sum_t discount^t shaped_t = -potential(s_0)."""
    steps = len(potentials) - 1
    before, after = np.float32(potentials[:-1]), np.float32(potentials[1:])
    rewards = shaping_reward(before, after, np.arange(steps) == steps - 1, discount, jnp)
    total = float(np.sum(np.asarray(rewards, np.float64) * discount ** np.arange(steps)))
    assert total == pytest.approx(-float(before[0]), abs=1e-4)


def test_only_termination_forfeits_the_potential() -> None:
    before, after, ended = np.float32([3.0, 3.0]), np.float32([5.0, 5.0]), np.array([False, True])
    np.testing.assert_allclose(
        shaping_reward(before, after, ended, 0.9, jnp), [0.9 * 5.0 - 3.0, -3.0], rtol=1e-6
    )


@given(st.floats(-5.0, 5.0))
def test_the_turn_rate_cost_is_symmetric_and_bounded(yaw_rate: float) -> None:
    costs = np.asarray(turn_rate(turn_step(jnp.float32([yaw_rate, -yaw_rate, 0.0])), jnp))
    assert costs[0] == costs[1] == pytest.approx(min(abs(yaw_rate), 1.0) ** 2, rel=1e-5, abs=1e-30)
    assert costs[2] == 0.0


def test_the_heading_change_cost_does_not_depend_on_the_rate() -> None:
    sharp, gentle = jnp.full(10, -1.0), jnp.full(40, 0.25)
    costs = [
        float(heading_change(turn_step(rates), jnp).sum()) for rates in (sharp, gentle, 5.0 * sharp)
    ]
    np.testing.assert_allclose(costs, 30.0 / 90.0, rtol=1e-5)
    assert float(heading_change(turn_step(jnp.float32(0.0)), jnp)) == 0.0


def state_of(name: str, most: int = 1, count: int = FLIGHTS) -> surrogate.State:
    chosen = scenario(name, PAPER)
    draws = np.random.default_rng(0).random((chosen.attempts, count, chosen.dimensions))
    starts = pad(sample(chosen, draws, np)[0], most, np)
    return surrogate.reset(
        jax.tree.map(lambda a: jnp.asarray(a, bool if a.dtype == bool else jnp.float32), starts)
    )


@pytest.fixture(scope="module")
def episodes() -> tuple[surrogate.State, surrogate.State, np.ndarray]:
    """Random flights: the states before and after each step, ``[T, N]``, and whether it is the
    episode's last.
    """

    def forward(state: surrogate.State, action: jax.Array) -> tuple:
        after, _ = surrogate.step(state, (action[:, 0], action[:, 1]), WORLD)
        return after, (state, after)

    held = np.random.default_rng(1).uniform(-1.0, 1.0, (SECONDS // 20, FLIGHTS, 2))
    actions = np.repeat(held, 20, axis=0).astype(np.float32)
    before, after = jax.jit(lambda state: jax.lax.scan(forward, state, actions)[1])(
        state_of("circle")
    )
    ends = np.asarray(after.ended)
    assert np.all(ends.any(axis=0))
    first = np.arange(SECONDS)[:, None] == ends.argmax(axis=0)
    return before, after, first


@pytest.mark.parametrize("weight", [1.0, 3.0])
@pytest.mark.parametrize("discount", [0.99, 1.0])
def test_the_shaping_of_whole_episodes_depends_on_their_start_alone(
    episodes, weight, discount
) -> None:
    """Random flights that end by violation and by time: none gains anything by shaping."""
    before, after, last = episodes
    worths = [np.asarray(worth(states, weight)) for states in (before, after)]
    rewards = np.asarray(shaping_reward(*worths, last, discount, jnp), np.float64)
    lasts = last.argmax(axis=0)
    flown = np.arange(SECONDS)[:, None] <= lasts
    total = np.sum(np.where(flown, discount ** np.arange(SECONDS)[:, None] * rewards, 0.0), axis=0)
    np.testing.assert_allclose(total, -worths[0][0], atol=1e-4)
    assert np.std(worths[0][0]) > 0.0
    assert np.unique(lasts).size > 5


def test_the_path_excess_cost_adds_up_to_the_path_excess(episodes) -> None:
    """10 for 10 km of flight, less what the goal came nearer; no step of any flight earns
    anything.
    """
    before, after, last = episodes
    cost = np.asarray(
        10.0 * path_excess(Transition(before, after, (0.0, 0.0), Any, PAPER), jnp),
        np.float64,
    )
    lasts, count = last.argmax(axis=0), np.arange(FLIGHTS)
    flown = np.arange(SECONDS)[:, None] <= lasts
    x, y = (np.asarray(values, np.float64) for values in (before.own.x, before.own.y))
    end_x, end_y = (np.asarray(values, np.float64) for values in (after.own.x, after.own.y))
    legs = np.where(flown, np.hypot(end_x - x, end_y - y), 0.0)
    goal_x, goal_y = (
        np.asarray(before.goal_x[0], np.float64),
        np.asarray(before.goal_y[0], np.float64),
    )
    nearer = np.hypot(goal_x - x[0], goal_y - y[0]) - np.hypot(
        goal_x - end_x[lasts, count], goal_y - end_y[lasts, count]
    )
    np.testing.assert_allclose(
        np.sum(np.where(flown, cost, 0.0), axis=0), 1e-3 * (legs.sum(axis=0) - nearer), atol=2e-3
    )
    assert np.min(cost[flown]) > -1e-5
    assert np.max(cost[flown]) > 0.1


def test_the_straight_path_to_the_goal_has_no_cost() -> None:
    state = state_of("circle", count=3)
    own = state.own._replace(x=jnp.zeros(3), y=jnp.zeros(3))
    ahead, back, aside = (
        own._replace(x=jnp.full(3, x), y=jnp.full(3, y))
        for x, y in ((80.0, 0.0), (-80.0, 0.0), (0, 80))
    )
    start = state_of("head_on", count=3)._replace(goal_x=jnp.full(3, 8_000.0), goal_y=jnp.zeros(3))

    def excess(later: VehicleState) -> jax.Array:
        states = start._replace(own=own), start._replace(own=later)
        return path_excess(Transition(*states, (0.0, 0.0), Any, PAPER), jnp)

    np.testing.assert_allclose(10.0 * excess(ahead), 0.0, atol=1e-6)
    np.testing.assert_allclose(10.0 * excess(back), 0.16, rtol=1e-4)
    np.testing.assert_allclose(
        10.0 * excess(aside),
        1e-3 * (80.0 + np.hypot(8_000, 80) - 8_000),
        rtol=1e-3,
    )


def test_potential_by_hand() -> None:
    """8 km from the goal with weight 2."""
    state = state_of("head_on", count=2)
    own = state.own._replace(x=jnp.zeros(2), y=jnp.zeros(2))
    scene = state._replace(own=own, goal_x=jnp.full(2, 8_000.0), goal_y=jnp.zeros(2))
    np.testing.assert_allclose(worth(scene, 2.0), [-1.6, -1.6], atol=1e-5)


def way_left(x: float, y: float, *, speed: float = 90.0, scale: float = 1.0) -> float:
    """Return the potential's way to a goal ahead at x and left at y, m, for an aircraft that turns
    at 3 deg/s.
    """
    aircraft = PAPER._replace(
        separation=scale * PAPER.separation, goal_radius=scale * PAPER.goal_radius
    )
    aircraft = aircraft._replace(
        limits=aircraft.limits._replace(yaw_rate_max=math.radians(3.0) / scale)
    )
    state = state_of("head_on", count=1)
    own = state.own._replace(
        x=jnp.zeros(1),
        y=jnp.zeros(1),
        heading=jnp.full(1, 0.5),
        speed=jnp.full(1, speed, jnp.float32),
    )
    cosine, sine = math.cos(0.5), math.sin(0.5)
    goal = (
        jnp.full(1, scale * v, jnp.float32) for v in (x * cosine - y * sine, x * sine + y * cosine)
    )
    scene = state._replace(own=own, goal_x=next(goal), goal_y=next(goal))
    return -1e4 * scale * float(goal_distance(scene, aircraft, jnp)[0])


def test_a_goal_that_the_next_turn_cannot_meet_counts_the_way_round() -> None:
    """A goal that is met by turning at the limit is as far as its distance, one inside the circle
    is farther.
    """
    radius = 90.0 / math.radians(3.0)
    assert way_left(-3_000.0, 1_000.0) == pytest.approx(math.hypot(3_000.0, 1_000.0), rel=1e-5)
    assert way_left(0.0, 2.0 * radius) == pytest.approx(2.0 * radius, rel=1e-5)
    centre = way_left(0.0, radius)
    assert centre == pytest.approx(radius + DETOUR * (radius - PAPER.goal_radius), rel=1e-5)
    assert way_left(0.0, -radius) == pytest.approx(centre, rel=1e-5)
    assert way_left(0.0, radius, scale=7.0) == pytest.approx(7.0 * centre, rel=1e-5)
    # Flying straight on from there is progress though the goal gets farther, and so is slowing
    # down.
    assert way_left(-300.0, radius) < centre
    assert way_left(0.0, radius, speed=60.0) < centre
