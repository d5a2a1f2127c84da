"""Statistics of pairs against published examples, their own symmetry, and exact coverage."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, multinomial

from eval.stats.paired import Pairs, mcnemar_exact, pairs, tango

# Each cell counts (both, first only, second only, neither).
# M. W. Fagerland, S. Lydersen, P. Laake, Statistics in Medicine 33 (2014) 2850, airway hyper-responsiveness of 21
# children before and after a transplantation (Bentur et al. 2009).
AIRWAY = Pairs(1, 1, 7, 12)
# The same authors, "Statistical Analysis of Contingency Tables" (2017), chapter 8, complete response before and after
# consolidation therapy (Cavo et al. 2012).
RESPONSE = Pairs(59, 6, 16, 80)


@pytest.mark.parametrize(
    ("counts", "confidence", "low", "high", "digits"),
    [
        (AIRWAY, 0.95, 0.026, 0.517, 3),
        (RESPONSE, 0.95, 0.0054, 0.1240, 4),
        # scoreci.mp(25, 28, 618, 0.9) of the R package PropCIs
        (Pairs(0, 25, 28, 565), 0.90, -0.0148, 0.0247, 4),
    ],
)
def test_published_intervals(counts: Pairs, confidence: float, low: float, high: float, digits: int) -> None:
    found = tango(counts, confidence)
    assert (round(found.low, digits), round(found.high, digits)) == (low, high)
    assert found.value == (counts.second_only - counts.first_only) / counts.total


@pytest.mark.parametrize(
    ("counts", "p"),
    [
        (AIRWAY, 0.0703),
        (RESPONSE, 0.0525),
        # P. Armitage, G. Berry, "Statistical Methods in Medical Research" (1994), p. 127: two culture media
        (Pairs(20, 12, 2, 16), 0.0129),
        (Pairs(5, 0, 0, 5), 1.0),
        (Pairs(5, 3, 3, 5), 1.0),
    ],
)
def test_published_p(counts: Pairs, p: float) -> None:
    assert round(mcnemar_exact(counts), 4) == p


cells = st.integers(0, 60)


@given(cells, cells, cells, cells, st.floats(0.5, 0.999))
def test_exchange_of_the_two_mirrors_everything(both: int, one: int, two: int, none: int, confidence: float) -> None:
    counts = Pairs(both, one, two, none)
    if not counts.total:
        return
    found, turned = tango(counts, confidence), tango(Pairs(both, two, one, none), confidence)
    assert -1.0 <= found.low <= found.value <= found.high <= 1.0
    assert found.low < found.high
    assert turned.value == -found.value
    assert (turned.low, turned.high) == pytest.approx((-found.high, -found.low), abs=1e-9)
    assert mcnemar_exact(counts) == mcnemar_exact(Pairs(none, two, one, both))
    assert 0.0 < mcnemar_exact(counts) <= 1.0


@given(cells, cells, st.integers(1, 60))
def test_the_interval_is_one_with_the_score_test_of_no_difference(one: int, two: int, same: int) -> None:
    # At a difference of 0 the score statistic is McNemar's, (c - b) / sqrt(b + c).
    found = tango(Pairs(same, one, two, 0))
    statistic = abs(two - one) / math.sqrt(max(one + two, 1))
    if abs(statistic - 1.959964) > 1e-6:
        assert (statistic > 1.959964) == (not found.low <= 0.0 <= found.high)


def test_exact_coverage_is_near_what_is_stated() -> None:
    total, shares = 30, np.array([0.72, 0.05, 0.11, 0.12])
    covered = 0.0
    for one, two in itertools.product(range(total + 1), repeat=2):
        if one + two <= total:
            # The interval does not ask how the others agree.
            found = tango(Pairs(total - one - two, one, two, 0))
            weight = multinomial.pmf(
                [one, two, total - one - two], total, [shares[1], shares[2], shares[0] + shares[3]]
            )
            covered += weight * (found.low <= shares[2] - shares[1] <= found.high)
    assert 0.93 < covered < 0.985


def test_p_is_a_coin_s_tail() -> None:
    assert mcnemar_exact(Pairs(9, 3, 11, 2)) == pytest.approx(2.0 * binom.cdf(3, 14, 0.5))


def test_pairs_are_counted_and_bad_ones_refused() -> None:
    first = np.array([True, True, False, False, True])
    second = np.array([True, False, True, False, False])
    assert pairs(first, second) == Pairs(1, 2, 1, 1)
    with pytest.raises(ValueError, match=r"one length, got bool \[5\] and bool \[4\]"):
        pairs(first, second[:4])
    with pytest.raises(ValueError, match="int64"):
        pairs(first, second.astype(int))
    with pytest.raises(ValueError, match="no pair"):
        tango(Pairs(0, 0, 0, 0))
    with pytest.raises(ValueError, match="confidence"):
        tango(AIRWAY, 1.0)
    with pytest.raises(ValueError, match="first_only is -1"):
        mcnemar_exact(Pairs(1, -1, 1, 1))
