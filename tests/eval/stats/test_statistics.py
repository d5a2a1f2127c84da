"""Intervals against published values, exact coverage and brute force."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from eval.stats.intervals import clopper_pearson, mean_interval
from eval.stats.plain import percent, share


@pytest.mark.parametrize(
    ("count", "total", "low", "high"),
    [
        # R. G. Newcombe, Statistics in Medicine 17 (1998) 857, table I, method 5 (Clopper-Pearson)
        (81, 263, 0.2527, 0.3676),
        (15, 148, 0.0578, 0.1617),
        (0, 20, 0.0, 0.1684),
        (1, 29, 0.0009, 0.1776),
        # by symmetry
        (20, 20, 0.8316, 1.0),
        (28, 29, 0.8224, 0.9991),
    ],
)
def test_published_intervals(count: int, total: int, low: float, high: float) -> None:
    assert clopper_pearson(count, total) == pytest.approx((low, high), abs=5e-5)


def test_closed_forms_at_the_ends() -> None:
    assert clopper_pearson(0, 50, 0.9) == (0.0, pytest.approx(1.0 - 0.05 ** (1 / 50)))
    assert clopper_pearson(50, 50, 0.9) == (pytest.approx(0.05 ** (1 / 50)), 1.0)
    assert clopper_pearson(0, 0) == (0.0, 1.0)


def test_the_paper_s_98_percent_of_ten_thousand() -> None:
    low, high = clopper_pearson(9_800, 10_000)
    assert low == pytest.approx(0.98 - 0.0029, abs=1e-4)
    assert high == pytest.approx(0.98 + 0.0026, abs=1e-4)


@given(st.integers(1, 60), st.floats(0.01, 0.99), st.sampled_from([0.8, 0.95, 0.99]))
def test_coverage_is_never_below_what_is_stated(total: int, share: float, confidence: float) -> None:
    ends = [clopper_pearson(count, total, confidence) for count in range(total + 1)]
    covered = sum(binom.pmf(k, total, share) for k, (low, high) in enumerate(ends) if low <= share <= high)
    assert covered >= confidence - 1e-9


@given(st.integers(1, 2_000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_interval_holds_the_share_is_symmetric_and_shrinks(counted: tuple[int, int]) -> None:
    count, total = counted
    low, high = clopper_pearson(count, total)
    assert 0.0 <= low <= count / total <= high <= 1.0
    mirrored = clopper_pearson(total - count, total)
    assert mirrored == pytest.approx((1.0 - high, 1.0 - low), abs=1e-9)
    wider = clopper_pearson(count, total, 0.99)
    assert wider[0] <= low and high <= wider[1]
    more = clopper_pearson(4 * count, 4 * total)
    assert more[1] - more[0] <= high - low
    if count < total:
        above = clopper_pearson(count + 1, total)
        assert above[0] > low and above[1] >= high


@pytest.mark.parametrize(
    ("count", "total", "confidence"), [(-1, 5, 0.95), (6, 5, 0.95), (1, 5, 0.0), (1, 5, 1.0), (0, -1, 0.95)]
)
def test_arguments_out_of_range_are_refused(count: int, total: int, confidence: float) -> None:
    with pytest.raises(ValueError, match="is outside"):
        clopper_pearson(count, total, confidence)


def test_the_rate_of_nothing_is_not_known() -> None:
    nothing = share(0, 0)
    assert nothing == {"value": None, "low": 0.0, "high": 1.0, "count": 0, "total": 0}
    assert percent(nothing) == percent(None) == "-"
    assert percent(share(1, 4, 0.9)) == "25.00 % [1.27, 75.14]"


def test_mean_interval_of_a_constant_and_of_nothing() -> None:
    assert mean_interval(np.full(30, 7.0)) == (7.0, 7.0, 7.0)
    assert all(math.isnan(value) for value in mean_interval(np.empty(0)))


@pytest.mark.parametrize("discrete", [True, False])
def test_mean_interval_is_the_normal_one_for_many_values(discrete: bool) -> None:
    rng = np.random.default_rng(1)
    values = rng.choice([-100.0, -10.0, 100.0], 4_000) if discrete else rng.normal(3.0, 2.0, 4_000)
    found = mean_interval(values, 0.95, 4_000)
    half = 1.96 * values.std() / math.sqrt(len(values))
    assert found.value == pytest.approx(values.mean())
    assert found.low == pytest.approx(values.mean() - half, abs=0.06 * half)
    assert found.high == pytest.approx(values.mean() + half, abs=0.06 * half)


def test_mean_interval_repeats_and_depends_on_the_seed() -> None:
    values = np.random.default_rng(2).normal(size=100)
    assert mean_interval(values, seed=5) == mean_interval(values, seed=5)
    assert mean_interval(values, seed=5) != mean_interval(values, seed=6)


def test_counts_are_resampled_like_values() -> None:
    values = np.repeat([0.0, 1.0, 5.0], [50, 30, 20])
    rng = np.random.default_rng(0)
    brute = np.array([rng.choice(values, len(values)).mean() for _ in range(4_000)])
    found = mean_interval(values, 0.9, 4_000)
    assert (found.low, found.high) == pytest.approx(tuple(np.quantile(brute, [0.05, 0.95])), abs=0.05)
