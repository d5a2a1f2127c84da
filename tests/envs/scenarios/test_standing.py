"""The modifier of traffic that stands or drifts: its shares, its conditions, its similarity, and
parity of numpy and jax.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from envs import surrogate
from envs.aircraft import PAPER, Aircraft
from envs.encounters import Encounter
from envs.outcome import RULES
from envs.scenarios import sample, scenario
from envs.scenarios import standing as module
from envs.starts import encounters_of_seed
from envs.surrogate import World
from envs.trees import map_leaves

NAME = "circle + standing"


@pytest.fixture(scope="module")
def drawn() -> Encounter:
    return encounters_of_seed(scenario(NAME, PAPER, intruders=(2, 16)), 3, 0, 400)


def standing(drawn: Encounter) -> np.ndarray:
    """Return which intruders stand or drift, ``[N, K]``: no other one is so slow."""
    slow = drawn.intruders.speed <= module.DRIFT * PAPER.limits.speed_max
    return slow & drawn.mask


def test_half_of_the_intruders_stand_or_drift_and_half_of_those_stand(drawn: Encounter):
    stands = standing(drawn)
    assert set(drawn.mask.sum(axis=1)) == set(range(2, 17))
    # Those that would stand too near to a start or a goal are drawn again, with their encounter.
    assert stands.sum() / drawn.mask.sum() == pytest.approx(0.5, abs=0.08)
    motionless = drawn.intruders.speed[stands] == 0.0
    assert motionless.mean() == pytest.approx(0.5, abs=0.05)


def test_they_stand_beside_the_way_and_leave_start_and_goal_free(drawn: Encounter):
    own, intruders, stands = drawn.own, drawn.intruders, standing(drawn)
    start = (own.x + 1j * own.y)[:, None]
    goal = (drawn.goal_x + 1j * drawn.goal_y)[:, None]
    place = intruders.x + 1j * intruders.y
    turned = (place - start) / (goal - start)  # 0 at the start, 1 at the goal
    assert ((turned.real >= -1e-9) & (turned.real <= 1.0 + 1e-9))[stands].all()
    aside = np.abs(turned.imag) * np.abs(goal - start)
    assert aside[stands].max() <= module.ASIDE * PAPER.separation + 1e-6
    assert np.abs(place - start)[drawn.mask].min() >= PAPER.separation
    assert np.abs(place - goal)[stands].min() >= module.FREE_GOAL * PAPER.separation


def test_numpy_and_jax_draw_the_same():
    chosen = scenario(NAME, PAPER, intruders=(1, 5))
    draws = np.random.default_rng(1).random((2, 200, chosen.dimensions)).astype(np.float32)
    ours, accepted = sample(chosen, draws, np)
    theirs, theirs_accepted = jax.jit(lambda d: sample(chosen, d, jnp))(draws)
    alike = accepted == theirs_accepted
    assert alike.mean() > 0.99  # a condition that rounding decides
    map_leaves(
        lambda a, b: np.testing.assert_allclose(
            a[alike], np.asarray(b)[alike], rtol=1e-4, atol=0.1
        ),
        ours,
        theirs,
    )


def test_an_aircraft_of_twice_the_size_meets_the_same_scaled_by_two():
    limits = PAPER.limits
    large = replace_size(2.0)
    assert large.limits.speed_max == limits.speed_max
    draws = np.random.default_rng(2).random((1, 100, 7 + 12 * 4))
    small, _ = sample(scenario(NAME, PAPER, intruders=(1, 4)), draws, np)
    wide, _ = sample(scenario(NAME, large, intruders=(1, 4)), draws, np)
    np.testing.assert_allclose(wide.intruders.x, 2.0 * small.intruders.x, atol=1e-6)
    np.testing.assert_allclose(wide.intruders.y, 2.0 * small.intruders.y, atol=1e-6)
    np.testing.assert_allclose(wide.intruders.speed, small.intruders.speed)


def replace_size(factor: float) -> Aircraft:
    limits = PAPER.limits
    smaller = limits._replace(
        acceleration_min=limits.acceleration_min / factor,
        acceleration_max=limits.acceleration_max / factor,
        yaw_rate_max=limits.yaw_rate_max / factor,
    )
    return PAPER._replace(limits=smaller, separation=factor * PAPER.separation)


def test_what_stands_stays_and_what_drifts_flies_straight(drawn: Encounter):
    """In the surrogate, from the start for 30 s."""
    encounters = map_leaves(lambda field: field[:32], drawn)
    state = surrogate.reset(map_leaves(jnp.asarray, encounters))
    step = jax.jit(
        lambda now: surrogate.step(now, (jnp.zeros(32), jnp.zeros(32)), World(RULES, PAPER))[0]
    )
    for _ in range(30):
        state = step(state)
    stands = standing(encounters)
    moved = np.hypot(
        state.intruders.vehicle.x - encounters.intruders.x,
        state.intruders.vehicle.y - encounters.intruders.y,
    )
    np.testing.assert_allclose(moved[stands], 30.0 * encounters.intruders.speed[stands], atol=0.1)
