"""Shaping is potential-based: whatever is flown, it adds up to minus the potential of the start."""

import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.policy.escape_features import separations
from envs import observation, surrogate
from envs.encounters import padded, sample, scenario
from envs.kinematics import SURROGATE, VehicleState
from envs.outcome import RULES
from rlcas_jax.config import ShapingConfig
from rlcas_jax.shaping import (
    FREE_TURN_RATE,
    escape_margin,
    heading_change_cost,
    lateness,
    path_excess_cost,
    potential,
    rejoin_turn_cost,
    shaped,
    turn_rate_cost,
)

WORLD = surrogate.World(RULES, SURROGATE)
COUNT, STEPS = 128, 300


def worth(states: surrogate.State, **weights: float) -> jax.Array:
    """Return the potential of states ``[..., N]``."""
    of = partial(potential, weights=ShapingConfig(**weights), rules=RULES)
    return jax.jit(of if states.steps.ndim == 1 else jax.vmap(of))(states)


@given(st.lists(st.floats(-10.0, 10.0), min_size=2, max_size=40), st.floats(0.5, 1.0))
def test_shaping_telescopes_to_the_starts_potential(potentials: list[float], discount: float) -> None:
    """For any potential and any episode: sum_t discount^t shaped_t = -potential(s_0)."""
    steps = len(potentials) - 1
    before, after = np.float32(potentials[:-1]), np.float32(potentials[1:])
    rewards = shaped(before, after, np.arange(steps) == steps - 1, discount)
    total = float(np.sum(np.asarray(rewards, np.float64) * discount ** np.arange(steps)))
    assert total == pytest.approx(-float(before[0]), abs=1e-4)


def test_only_termination_forfeits_the_potential() -> None:
    before, after, ended = np.float32([3.0, 3.0]), np.float32([5.0, 5.0]), np.array([False, True])
    np.testing.assert_allclose(shaped(before, after, ended, 0.9), [0.9 * 5.0 - 3.0, -3.0], rtol=1e-6)


@given(st.floats(-5.0, 5.0))
def test_the_turn_rate_cost_is_symmetric_and_bounded(yaw_rate: float) -> None:
    costs = np.asarray(turn_rate_cost(jnp.float32([yaw_rate, -yaw_rate, 0.0])))
    assert costs[0] == costs[1] == pytest.approx(min(abs(yaw_rate), 1.0) ** 2, rel=1e-5, abs=1e-30)
    assert costs[2] == 0.0


def test_the_heading_change_cost_does_not_depend_on_the_rate() -> None:
    sharp, gentle = jnp.full(10, -1.0), jnp.full(40, 0.25)
    costs = [float(heading_change_cost(rates, math.radians(3.0), 1.0).sum()) for rates in (sharp, gentle, 5.0 * sharp)]
    np.testing.assert_allclose(costs, 30.0 / 90.0, rtol=1e-5)
    assert float(heading_change_cost(jnp.float32(0.0), math.radians(3.0), 1.0)) == 0.0


@given(st.floats(-math.pi, math.pi), st.floats(0.05, 3.0), st.sampled_from([-1.0, 1.0]))
def test_only_brisk_turns_towards_the_goal_have_a_rejoin_cost(heading: float, bearing: float, side: float) -> None:
    limit = math.radians(3.0)
    away = side * bearing
    own = VehicleState(*jnp.float32([[100.0], [-50.0], [heading], [70.0]]))
    goal = own.x + 4000.0 * math.cos(heading + away), own.y + 4000.0 * math.sin(heading + away)

    def cost(rate: float) -> float:
        return float(rejoin_turn_cost(own, *goal, jnp.float32([side * rate]), limit, 1.0)[0])

    assert cost(-1.0) == cost(0.0) == cost(0.99 * FREE_TURN_RATE / limit) == 0.0
    # A quarter turn at the limit takes 30 s.
    assert cost(1.0) == cost(4.0) == pytest.approx(1.0 / 30.0, rel=1e-4)
    assert 0.0 < cost(0.3) < cost(0.6) < cost(1.0)
    slow = rejoin_turn_cost(own, *goal, jnp.float32([side]), FREE_TURN_RATE, 1.0)
    assert float(slow[0]) == 0.0  # the vehicle cannot turn faster


def state_of(name: str, most: int = 1, count: int = COUNT) -> surrogate.State:
    chosen = scenario(name)
    draws = np.random.default_rng(0).random((chosen.attempts, count, chosen.dimensions))
    starts = padded(sample(chosen, draws, np)[0], most, np)
    return surrogate.reset(jax.tree.map(lambda a: jnp.asarray(a, bool if a.dtype == bool else jnp.float32), starts))


@pytest.fixture(scope="module")
def episodes() -> tuple[surrogate.State, surrogate.State, np.ndarray]:
    """Random flights: the states before and after each step, ``[T, N]``, and whether it is the episode's last."""

    def forward(state: surrogate.State, action: jax.Array) -> tuple:
        after, _ = surrogate.step(state, (action[:, 0], action[:, 1]), WORLD)
        return after, (state, after)

    held = np.random.default_rng(1).uniform(-1.0, 1.0, (STEPS // 20, COUNT, 2))
    actions = np.repeat(held, 20, axis=0).astype(np.float32)
    before, after = jax.jit(lambda state: jax.lax.scan(forward, state, actions)[1])(state_of("circle"))
    ends = np.asarray(after.ended)
    assert np.all(ends.any(axis=0))
    first = np.arange(STEPS)[:, None] == ends.argmax(axis=0)
    return before, after, first


@pytest.mark.parametrize("weights", [{"goal": 1.0}, {"goal": 3.0, "escape_margin": 0.7, "lateness": 0.4}])
@pytest.mark.parametrize("discount", [0.99, 1.0])
def test_the_shaping_of_whole_episodes_depends_on_their_start_alone(episodes, weights, discount) -> None:
    """Random flights that end by violation and by time: none gains anything by shaping."""
    before, after, last = episodes
    worths = [np.asarray(worth(states, **weights)) for states in (before, after)]
    rewards = np.asarray(shaped(*worths, last, discount), np.float64)
    lasts = last.argmax(axis=0)
    flown = np.arange(STEPS)[:, None] <= lasts
    total = np.sum(np.where(flown, discount ** np.arange(STEPS)[:, None] * rewards, 0.0), axis=0)
    np.testing.assert_allclose(total, -worths[0][0], atol=1e-4)
    assert np.std(worths[0][0]) > 0.0
    assert np.unique(lasts).size > 5


def test_the_path_excess_cost_adds_up_to_the_path_excess(episodes) -> None:
    """10 for 10 km of flight, less what the goal came nearer; no step of any flight earns anything."""
    before, after, last = episodes
    cost = np.asarray(10.0 * path_excess_cost(before.own, after.own, before.goal_x, before.goal_y), np.float64)
    lasts, count = last.argmax(axis=0), np.arange(COUNT)
    flown = np.arange(STEPS)[:, None] <= lasts
    x, y = (np.asarray(values, np.float64) for values in (before.own.x, before.own.y))
    end_x, end_y = (np.asarray(values, np.float64) for values in (after.own.x, after.own.y))
    legs = np.where(flown, np.hypot(end_x - x, end_y - y), 0.0)
    goal_x, goal_y = np.asarray(before.goal_x[0], np.float64), np.asarray(before.goal_y[0], np.float64)
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
        own._replace(x=jnp.full(3, x), y=jnp.full(3, y)) for x, y in ((80.0, 0.0), (-80.0, 0.0), (0, 80))
    )
    goal = jnp.full(3, 8_000.0), jnp.zeros(3)
    np.testing.assert_allclose(10.0 * path_excess_cost(own, ahead, *goal), 0.0, atol=1e-6)
    np.testing.assert_allclose(10.0 * path_excess_cost(own, back, *goal), 0.16, rtol=1e-4)
    np.testing.assert_allclose(
        10.0 * path_excess_cost(own, aside, *goal), 1e-3 * (80.0 + np.hypot(8_000, 80) - 8_000), rtol=1e-3
    )


def test_potential_by_hand() -> None:
    """8 km from the goal with weight 2."""
    state = state_of("head_on", count=2)
    own = state.own._replace(x=jnp.zeros(2), y=jnp.zeros(2))
    scene = state._replace(own=own, goal_x=jnp.full(2, 8_000.0), goal_y=jnp.zeros(2))
    np.testing.assert_allclose(worth(scene, goal=2.0), [-1.6, -1.6], atol=1e-5)


def test_lateness_by_hand() -> None:
    """12 km from the goal: 160 s at 75 m/s, 240 s at 50 m/s."""
    state = state_of("circle", count=4)
    own = state.own._replace(x=jnp.zeros(4), y=jnp.zeros(4), speed=jnp.array([75.0, 50.0, 50.0, 50.0]))
    scene = state._replace(own=own, goal_x=jnp.full(4, 12_000.0), goal_y=jnp.zeros(4))
    for passed, expected in ((0.0, [0.0, 0.0, 0.0, 0.0]), (60.0, [0.0, 0.5, 0.5, 0.5]), (100.0, [0.0, 1.0, 1.0, 1.0])):
        late = scene._replace(steps=jnp.full(4, passed))
        np.testing.assert_allclose(lateness(late, RULES), expected, atol=1e-5)
    sooner = RULES._replace(t_max=270.0)
    np.testing.assert_allclose(
        lateness(scene._replace(steps=jnp.full(4, 45.0)), sooner), [0.0, 0.75, 0.75, 0.75], atol=1e-5
    )


def test_the_escape_margin_is_that_of_the_network_inputs(episodes) -> None:
    """The potential sees the state, the network an observation; both must mean the same manoeuvres."""
    state: surrogate.State = jax.tree.map(lambda a: a[40], episodes[0])
    seen = np.asarray(surrogate.observe(state), np.float64)
    geometry = observation.decode(list(seen.T), np)
    best = np.max(separations(geometry, seen[:, 6] * math.pi, np), axis=0)
    found = np.asarray(escape_margin(state, 1_000.0))
    np.testing.assert_allclose(found, np.clip((best - 1_000.0) / 50.0, -1.0, 1.0), atol=2e-3)
    assert (found < 1.0).sum() > 10
    asked = state._replace(required_separation=jnp.full(COUNT, 1_080.0))
    np.testing.assert_allclose(escape_margin(asked, 1_000.0), np.clip((best - 1_080.0) / 50.0, -1.0, 1.0), atol=2e-3)


def test_the_escape_margin_counts_all_intruders() -> None:
    state = state_of("multi", 8)
    alone = [escape_margin(state._replace(mask=state.mask & (jnp.arange(8) == k)), 1_000.0) for k in range(8)]
    together = np.asarray(escape_margin(state, 1_000.0))
    assert np.all(together <= np.min(alone, axis=0) + 1e-6)
    nobody = state._replace(mask=jnp.zeros_like(state.mask))
    np.testing.assert_array_equal(escape_margin(nobody, 1_000.0), 1.0)
