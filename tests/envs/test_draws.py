"""Draws by position: any split of the encounters gives the same numbers, and the numbers are random."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from envs.draws import normals, uniforms

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
