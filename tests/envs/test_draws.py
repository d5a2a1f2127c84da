"""Draws by position: any split gives the same numbers, of the scenario's distribution."""

import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from envs import surrogate
from envs.aircraft import PAPER
from envs.draws import normals, uniforms
from envs.encounters import Encounter, scenario
from tests.support import angle_between

both = pytest.mark.parametrize("draw", [uniforms, normals])
shapes = st.lists(st.integers(1, 5), min_size=0, max_size=3).map(tuple)


@both
@given(
    seed=st.integers(0, 2**63), first=st.integers(0, 10**9), shape=shapes, cuts=st.lists(st.integers(0, 40), max_size=4)
)
def test_any_split_of_a_range_gives_the_same_numbers(draw, seed, first, shape, cuts) -> None:
    whole = draw(seed, first, 40, shape)
    edges = [0, *sorted(cuts), 40]
    parts = [draw(seed, first + a, b - a, shape) for a, b in itertools.pairwise(edges)]
    assert whole.shape == (40, *shape)
    assert whole.dtype == np.float64
    np.testing.assert_array_equal(np.concatenate(parts), whole)


@both
def test_one_seed_repeats_and_everything_else_differs(draw) -> None:
    base = draw(7, 100, 50, (3,), stream=2)
    np.testing.assert_array_equal(base, draw(7, 100, 50, (3,), stream=2))
    for other in (draw(8, 100, 50, (3,), stream=2), draw(7, 100, 50, (3,), stream=3), draw(7, 150, 50, (3,), stream=2)):
        assert np.intersect1d(base, other).size == 0
    assert np.unique(base).size == base.size


def test_streams_and_encounters_are_uncorrelated() -> None:
    rows = np.stack([uniforms(0, 0, 20_000, (), stream) for stream in range(4)] + [uniforms(1, 0, 20_000, ())])
    rows = np.concatenate([rows, np.roll(rows[:1], 1, axis=1)])
    assert np.max(np.abs(np.corrcoef(rows) - np.eye(len(rows)))) < 5.0 / math.sqrt(20_000)


@pytest.mark.parametrize("shape", [(), (5,), (3, 7)])
def test_uniforms_are_uniform(shape: tuple[int, ...]) -> None:
    count = 100_000 // max(1, math.prod(shape))
    draws = uniforms(3, 0, count, shape).ravel()
    assert draws.min() >= 0.0
    assert draws.max() < 1.0
    counts, _ = np.histogram(draws, 50, (0.0, 1.0))
    assert stats.chisquare(counts).pvalue > 1e-4


def test_normals_are_normal() -> None:
    draws = normals(4, 0, 25_000, (2, 2)).ravel()
    n = draws.size
    assert abs(draws.mean()) < 5.0 / math.sqrt(n)
    assert draws.var() == pytest.approx(1.0, abs=5.0 * math.sqrt(2.0 / n))
    assert stats.skew(draws) == pytest.approx(0.0, abs=5.0 * math.sqrt(6.0 / n))
    assert stats.kurtosis(draws) == pytest.approx(0.0, abs=5.0 * math.sqrt(24.0 / n))
    assert stats.kstest(draws, "norm").pvalue > 1e-4


# The pool of starts.
@jax.jit
def drawn_pool(seed: int) -> Encounter:
    mixture = [
        scenario("circle", PAPER),
        scenario("same_course", PAPER, conflicts_closer_than=500.0),
        scenario("multi", PAPER),
    ]
    return surrogate.redraw_pool(jax.random.key(seed), mixture, [0.5, 0.3, 0.2], 40, 100)


@pytest.fixture(scope="module")
def pool() -> Encounter:
    return drawn_pool(0)


def test_a_pool_holds_rows_of_padded_starts(pool: Encounter) -> None:
    assert pool.mask.shape == (40, 100, 8)
    assert {leaf.shape[:2] for leaf in jax.tree.leaves(pool)} == {(40, 100)}
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(pool) if leaf.dtype != bool)


def test_a_pool_keeps_the_conditions_of_its_scenarios(pool: Encounter) -> None:
    gap = np.hypot(pool.intruders.x - pool.own.x[..., None], pool.intruders.y - pool.own.y[..., None])
    assert np.min(np.where(pool.mask, gap, np.inf)) >= 1_000.0 - 0.01


def test_a_pool_mixes_its_scenarios_by_weight(pool: Encounter) -> None:
    several = np.asarray(pool.mask).sum(axis=-1) > 1
    difference = np.asarray(pool.own.heading[..., None] - pool.intruders.heading)[..., 0]
    aligned = ~several & (angle_between(difference, 0.0) < math.radians(20.0))
    assert several.mean() == pytest.approx(0.2, abs=0.035)
    # 0.3 of the second scenario and the ninth part of the first.
    assert aligned.mean() == pytest.approx(0.3 + 0.5 / 9.0, abs=0.04)


def test_pools_of_different_keys_differ_and_of_the_same_repeat(pool: Encounter) -> None:
    again, other = drawn_pool(0), drawn_pool(1)
    for leaf, repeated in zip(jax.tree.leaves(pool), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(leaf, repeated)
    assert np.intersect1d(pool.own.x, other.own.x).size < 5
    # A rejected start is replaced by a neighbour: only a few may repeat.
    assert np.unique(pool.own.x).size > 0.8 * pool.own.x.size
