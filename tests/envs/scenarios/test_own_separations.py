"""Separations of intruders of their own: how they are drawn, judged and shown, in numpy and jax
alike, and who refuses them.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from envs import surrogate, world
from envs.aircraft import PAPER
from envs.encounters import Encounter, EncounterError, Scenario
from envs.outcome import RULES
from envs.scenarios import own_separations as module
from envs.scenarios import scenario
from envs.starts import EVERY_FIELD, cast, check_encounter, encounters_of_seed
from envs.surrogate import World
from envs.trees import map_leaves
from tests.support import pool_of

NAME = "circle + own_separations"
WORLD = World(RULES, PAPER)


@pytest.fixture(scope="module")
def chosen() -> Scenario:
    return scenario(NAME, PAPER, intruders=(2, 4), attempts=24)


@pytest.fixture(scope="module")
def drawn(chosen: Scenario) -> Encounter:
    return encounters_of_seed(chosen, 3, 0, 300, heeds=EVERY_FIELD)


def fly_all(start: Encounter, xp: Any, steps: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Return the separations of each step ``[T, N, K]`` and whether it was lost, ``[T, N]``."""
    state = world.begin(map_leaves(xp.asarray, start), xp)
    nothing = xp.zeros_like(start.goal_x)
    separations, lost = [], []
    step: Any = jax.jit(surrogate.step) if xp is jnp else partial(world.step, xp=np)
    for _ in range(steps):
        state, result = step(state, (nothing, nothing), WORLD)
        separations.append(np.asarray(result.separations))
        lost.append(np.asarray(result.outcome.violation))
    return np.array(separations), np.array(lost)


def test_separations_are_within_their_range_and_kept_at_the_start(drawn: Encounter):
    shares = drawn.separation / PAPER.separation
    assert shares.min() >= module.LEAST
    assert shares.max() <= module.GREATEST
    apart = np.hypot(
        drawn.intruders.x - drawn.own.x[:, None], drawn.intruders.y - drawn.own.y[:, None]
    )
    assert (apart >= drawn.separation)[drawn.mask].all()
    check_encounter(drawn, PAPER, drawn.goal_x.shape)


def test_an_encounter_is_lost_where_any_intruder_comes_nearer_than_its_own(drawn: Encounter):
    """Against the distances of the same flights, judged without separations of their own."""
    counted, lost = fly_all(drawn, np)
    plain, _ = fly_all(drawn._replace(separation=None), np)
    np.testing.assert_allclose(counted, plain * PAPER.separation / drawn.separation)
    expected = (np.where(drawn.mask, plain - drawn.separation, np.inf) < 0.0).any(axis=2)
    np.testing.assert_array_equal(lost, expected)
    assert 0.1 < expected.any(axis=0).mean() < 0.99


def test_the_usual_separation_of_each_changes_nothing(drawn: Encounter):
    usual = drawn._replace(separation=np.full_like(drawn.separation, PAPER.separation))
    flights = [fly_all(encounter, np) for encounter in (usual, drawn._replace(separation=None))]
    (separations, lost), (plain, plain_lost) = flights
    np.testing.assert_array_equal(separations, plain)
    np.testing.assert_array_equal(lost, plain_lost)


def test_numpy_and_jax_judge_alike(drawn: Encounter):
    single = cast(drawn, np.float32)
    (ours, ours_lost), (theirs, theirs_lost) = fly_all(single, np), fly_all(single, jnp)
    np.testing.assert_allclose(ours, theirs, atol=1.0)
    assert (ours_lost == theirs_lost).mean() > 0.999


def test_distances_count_in_the_separation_of_each(drawn: Encounter):
    share = world.distance_scales(world.begin(drawn, np), PAPER, np)
    np.testing.assert_allclose(share, PAPER.separation / drawn.separation)
    plain = world.begin(drawn._replace(separation=None), np)
    assert world.distance_scales(plain, PAPER, np) is None


def test_eight_numbers_hold_an_intruder_at_its_distance_in_its_own_separation(drawn: Encounter):
    state = world.begin(drawn, np)
    own, true = drawn.own, drawn.intruders
    direction = (true.x - own.x[:, None]) + 1j * (true.y - own.y[:, None])
    place = own.x[:, None] + 1j * own.y[:, None] + direction * PAPER.separation / drawn.separation
    moved = true._replace(x=place.real, y=place.imag)
    plain = world.begin(drawn._replace(intruders=moved, separation=None), np)
    np.testing.assert_allclose(
        world.observe(state, PAPER, xp=np), world.observe(plain, PAPER, xp=np), atol=1e-6
    )


def test_a_pool_fills_in_the_usual_separation(chosen: Scenario):
    mixture = [scenario("circle", PAPER), chosen]
    pool = pool_of(mixture, [0.5, 0.5], 2, 200)
    separations = np.asarray(pool.separation)
    usual = (separations == PAPER.separation).all(axis=-1)
    assert separations.shape == pool.mask.shape
    assert usual.mean() == pytest.approx(0.5, abs=0.1)
    assert pool_of(mixture[:1], [1.0], 2, 8).separation is None


def test_who_would_not_keep_them_is_refused(chosen: Scenario):
    with pytest.raises(EncounterError, match="separations of their own; expected a training"):
        encounters_of_seed(chosen, 3, 0, 4)
