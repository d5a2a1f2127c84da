"""Intervals over randomisations: their coverage, their ends, and the summary that carries them."""

import math

import numpy as np
import pytest

from eval.metrics.replicated import ratio_interval, replicated
from eval.stats.intervals import clopper_pearson


def table_of(success: np.ndarray) -> dict[str, np.ndarray]:
    """Return a table of so many encounters: failures are violations, every second one unresolvable."""
    count = len(success)
    outcome = np.where(success, "reached", "violation").astype(object)
    failed = np.flatnonzero(~success)
    verdict = np.full(count, "resolvable", dtype=object)
    verdict[failed[::2]] = "unresolvable"
    return {
        "encounter": np.arange(count),
        "outcome": outcome,
        "baseline_outcome": np.where(np.arange(count) % 4 == 0, "violation", "reached").astype(object),
        "verdict": verdict,
        "score": np.where(success, 100.0, -100.0),
        "path_excess": np.where(success, 0.01 * (np.arange(count) % 7), np.nan),
        "min_separation_m": np.linspace(900.0, 3_000.0, count),
        "duration_s": np.full(count, 100.0),
        "heading_reversals": np.zeros(count, np.int32),
    }


def test_the_interval_of_a_mean_is_students() -> None:
    # Hand-computed: mean 3, standard error sqrt(2.5 / 5), t(4 degrees of freedom, 97.5 %) = 2.776445.
    interval = ratio_interval(np.array([1.0, 2.0, 3.0, 4.0, 5.0]), np.ones(5), 0.95)
    half = 2.776445105 * math.sqrt(0.5)
    assert interval == pytest.approx((3.0, 3.0 - half, 3.0 + half))


def test_a_ratio_has_no_spread_where_the_shares_agree() -> None:
    interval = ratio_interval(np.array([1.0, 2.0, 4.0]), np.array([2.0, 4.0, 8.0]), 0.95)
    assert interval == pytest.approx((0.5, 0.5, 0.5))


def test_the_interval_covers_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(1_000):
        total = rng.binomial(300, 0.7, 16)
        low, high = ratio_interval(rng.binomial(total, 0.9), total, 0.95)[1:]
        covered += low <= 0.9 <= high
    assert 0.93 <= covered / 1_000 <= 0.97


def test_nothing_and_too_few_are_said() -> None:
    assert math.isnan(ratio_interval(np.zeros(3), np.zeros(3), 0.95).value)
    with pytest.raises(ValueError, match="at least 2"):
        ratio_interval(np.ones(1), np.ones(1), 0.95)


def test_a_summary_takes_its_intervals_from_the_randomisations() -> None:
    success = np.ones(160, bool)
    success[[0, 1, 5, 18, 40, 77, 150]] = False
    table = table_of(success)
    found = replicated(table, 16, 0.95)
    shares = success.reshape(10, 16).mean(axis=0)
    expected = ratio_interval(shares, np.ones(16), 0.95)
    rate = found["success_rate"]
    assert (rate["value"], rate["low"], rate["high"]) == pytest.approx((*expected[:2], min(expected.high, 1.0)))
    assert (rate["count"], rate["total"]) == (153, 160)
    assert found["success_given_resolvable"]["total"] == 156
    assert found["timeout_rate"]["high"] == pytest.approx(clopper_pearson(0, 160)[1])
    assert found["score_mean_interval"]["low"] < 200.0 * 153 / 160 - 100.0 < found["score_mean_interval"]["high"]
    assert found["risk_ratio_interval"]["low"] < 7 / 40 < found["risk_ratio_interval"]["high"]


def test_rates_without_a_spread_keep_an_interval() -> None:
    found = replicated(table_of(np.ones(64, bool)), 16, 0.95)
    rate = found["success_rate"]
    assert (rate["value"], rate["low"], rate["high"]) == (1.0, *clopper_pearson(64, 64))
    assert found["risk_ratio_interval"]["high"] == pytest.approx(clopper_pearson(0, 64)[1] * 4.0)
