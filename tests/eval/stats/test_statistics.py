"""Intervals and paired statistics against published values, exact coverage and brute force."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.stats import binom, multinomial

from envs.aircraft import PAPER
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.traffic.track_units import FOOT, NAUTICAL_MILE
from eval.flights.simulate import Unmitigated
from eval.metrics.volumes import (
    VOLUMES,
    Relative,
    Volume,
    costs,
    is_lost,
    losses,
    relative,
    severity,
)
from eval.metrics.weighted import ratio
from eval.stats.intervals import clopper_pearson, mean_interval, percent, share
from eval.stats.paired import Pairs, mcnemar_exact, pairs, tango
from tests.eval.resolvers import fly_recorded
from tests.support import recorded_path


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
def test_coverage_is_never_below_what_is_stated(
    total: int, share: float, confidence: float
) -> None:
    ends = [clopper_pearson(count, total, confidence) for count in range(total + 1)]
    covered = sum(
        binom.pmf(k, total, share) for k, (low, high) in enumerate(ends) if low <= share <= high
    )
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
    ("count", "total", "confidence"),
    [(-1, 5, 0.95), (6, 5, 0.95), (1, 5, 0.0), (1, 5, 1.0), (0, -1, 0.95)],
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
    interval = mean_interval(values, 0.95, 4_000)
    half = 1.96 * values.std() / math.sqrt(len(values))
    assert interval.value == pytest.approx(values.mean())
    assert interval.low == pytest.approx(values.mean() - half, abs=0.06 * half)
    assert interval.high == pytest.approx(values.mean() + half, abs=0.06 * half)


def test_mean_interval_repeats_and_depends_on_the_seed() -> None:
    values = np.random.default_rng(2).normal(size=100)
    assert mean_interval(values, seed=5) == mean_interval(values, seed=5)
    assert mean_interval(values, seed=5) != mean_interval(values, seed=6)


def test_counts_are_resampled_like_values() -> None:
    values = np.repeat([0.0, 1.0, 5.0], [50, 30, 20])
    rng = np.random.default_rng(0)
    brute = np.array([rng.choice(values, len(values)).mean() for _ in range(4_000)])
    interval = mean_interval(values, 0.9, 4_000)
    assert (interval.low, interval.high) == pytest.approx(
        tuple(np.quantile(brute, [0.05, 0.95])), abs=0.05
    )


# Statistics of pairs against published examples, their own symmetry, and exact coverage.

# Each cell counts (both, first only, second only, neither).
# M. W. Fagerland, S. Lydersen, P. Laake, Statistics in Medicine 33 (2014) 2850, airway
# hyper-responsiveness of 21 children before and after a transplantation (Bentur et al. 2009).
AIRWAY = Pairs(1, 1, 7, 12)
# The same authors, "Statistical Analysis of Contingency Tables" (2017), chapter 8, complete
# response before and after consolidation therapy (Cavo et al. 2012).
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
def test_published_paired_intervals(
    counts: Pairs, confidence: float, low: float, high: float, digits: int
) -> None:
    interval = tango(counts, confidence)
    assert (round(interval.low, digits), round(interval.high, digits)) == (low, high)
    assert interval.value == (counts.second_only - counts.first_only) / sum(counts)


@pytest.mark.parametrize(
    ("counts", "p"),
    [
        (AIRWAY, 0.0703),
        (RESPONSE, 0.0525),
        # P. Armitage, G. Berry, "Statistical Methods in Medical Research" (1994), p. 127: two
        # culture media
        (Pairs(20, 12, 2, 16), 0.0129),
        (Pairs(5, 0, 0, 5), 1.0),
        (Pairs(5, 3, 3, 5), 1.0),
    ],
)
def test_published_p(counts: Pairs, p: float) -> None:
    assert round(mcnemar_exact(counts), 4) == p


cells = st.integers(0, 60)


@given(cells, cells, cells, cells, st.floats(0.5, 0.999))
def test_exchange_of_the_two_mirrors_everything(
    both: int, first_only: int, second_only: int, none: int, confidence: float
) -> None:
    counts = Pairs(both, first_only, second_only, none)
    if not sum(counts):
        return
    interval, turned = (
        tango(counts, confidence),
        tango(Pairs(both, second_only, first_only, none), confidence),
    )
    assert -1.0 <= interval.low <= interval.value <= interval.high <= 1.0
    assert interval.low < interval.high
    assert turned.value == -interval.value
    assert (turned.low, turned.high) == pytest.approx((-interval.high, -interval.low), abs=1e-9)
    assert mcnemar_exact(counts) == mcnemar_exact(Pairs(none, second_only, first_only, both))
    assert 0.0 < mcnemar_exact(counts) <= 1.0


@given(cells, cells, st.integers(1, 60))
def test_the_interval_is_one_with_the_score_test_of_no_difference(
    first_only: int, second_only: int, in_both: int
) -> None:
    # At a difference of 0 the score statistic is McNemar's, (c - b) / sqrt(b + c).
    interval = tango(Pairs(in_both, first_only, second_only, 0))
    statistic = abs(second_only - first_only) / math.sqrt(max(first_only + second_only, 1))
    if abs(statistic - 1.959964) > 1e-6:
        assert (statistic > 1.959964) == (not interval.low <= 0.0 <= interval.high)


def test_exact_coverage_is_near_what_is_stated() -> None:
    total, shares = 30, np.array([0.72, 0.05, 0.11, 0.12])
    covered = 0.0
    for first_only, second_only in itertools.product(range(total + 1), repeat=2):
        if first_only + second_only <= total:
            # The interval does not ask how the others agree.
            interval = tango(Pairs(total - first_only - second_only, first_only, second_only, 0))
            weight = multinomial.pmf(
                [first_only, second_only, total - first_only - second_only],
                total,
                [shares[1], shares[2], shares[0] + shares[3]],
            )
            covered += weight * (interval.low <= shares[2] - shares[1] <= interval.high)
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


# Volumes, risk ratios and costs: by hand, against their definitions, as published.


def make_relative(x, y, vx, vy) -> Relative:
    return Relative(*(np.array([float(value)]) for value in (x, y, vx, vy)))


def test_the_standards_volumes() -> None:
    en_route = VOLUMES["do365_en_route"]
    assert (en_route.horizontal, en_route.vertical, en_route.tau) == (
        0.66 * NAUTICAL_MILE,
        450 * FOOT,
        35.0,
    )
    assert [round(volume.horizontal / FOOT) for volume in VOLUMES.values()] == [
        500,
        4010,
        1500,
        2200,
        2000,
    ]
    assert [round(volume.vertical / FOOT) for volume in VOLUMES.values()] == [
        100,
        450,
        450,
        450,
        250,
    ]


def test_modified_tau_by_hand() -> None:
    volume = Volume(1_000.0, 100.0, 35.0)
    # Head-on at 100 m/s: (r^2 - D^2) / (100 r) = 35 at r = 3765.6 m.
    reach = 1_750.0 + math.sqrt(1_750.0**2 + 1_000.0**2)
    assert is_lost(volume, make_relative(reach - 1.0, 0, -100, 0))[0]
    assert not is_lost(volume, make_relative(reach + 1.0, 0, -100, 0))[0]
    # Near, but opening, or passing aside.
    assert not is_lost(volume, make_relative(reach - 500.0, 0, 100, 0))[0]
    assert not is_lost(volume, make_relative(reach - 500.0, 1_001, -100, 0))[0]


lengths = st.floats(-6_000, 6_000)
rates = st.floats(-150, 150)


@given(lengths, lengths, rates, rates, st.sampled_from(sorted(VOLUMES)))
def test_a_loss_is_what_the_standard_defines(x, y, vx, vy, name) -> None:
    volume = VOLUMES[name]
    apart, closing = math.hypot(x, y), x * vx + y * vy
    cpa = max(-closing / max(vx * vx + vy * vy, 1e-12), 0.0)
    miss = math.hypot(x + vx * cpa, y + vy * cpa)
    tau = (apart**2 - volume.horizontal**2) / -closing if closing < 0.0 else math.inf
    assume(
        all(
            abs(a - b) > 1e-6
            for a, b in ((apart, volume.horizontal), (miss, volume.horizontal), (tau, volume.tau))
        )
    )
    expected = apart <= volume.horizontal or (tau <= volume.tau and miss <= volume.horizontal)
    assert is_lost(volume, make_relative(x, y, vx, vy))[0] == expected


def test_severity_by_hand() -> None:
    volume = Volume(1_000.0, 100.0, 35.0)
    # A collision course at half the reach, level: only the range has not been penetrated fully.
    assert severity(volume, make_relative(0, 0, -100, 0))[0] == pytest.approx(1.0)
    reach = 1_750.0 + math.sqrt(1_750.0**2 + 1_000.0**2)
    assert severity(volume, make_relative(0.5 * reach, 0, -100, 0))[0] == pytest.approx(0.5)
    assert severity(volume, make_relative(2 * reach, 0, -100, 0))[0] == 0.0


def test_the_vertical_part_of_a_volume_counts() -> None:
    volume = Volume(1_000.0, 100.0, 35.0)
    for height, lost in ((0.0, True), (100.0, True), (-100.0, True), (101.0, False)):
        relative_state = make_relative(500, 0, -100, 0)._replace(z=np.array([height]))
        assert is_lost(volume, relative_state)[0] == lost
    collision = make_relative(0, 0, -100, 0)
    assert severity(volume, collision._replace(z=np.array([50.0])))[0] == pytest.approx(0.5)
    assert severity(volume, collision._replace(z=np.array([-120.0])))[0] == 0.0


@given(lengths, lengths, rates, rates, st.sampled_from(sorted(VOLUMES)))
def test_severity_is_positive_where_the_volume_is_lost_only(x, y, vx, vy, name) -> None:
    volume, scene = VOLUMES[name], make_relative(x, y, vx, vy)
    value = severity(volume, scene)[0]
    assert 0.0 <= value <= 1.0
    if value > 1e-6:
        assert is_lost(volume, scene)[0]


def test_published_risk_ratios() -> None:
    """10 000 simulated encounters with and without a system: published ratios, weighted and not."""
    data = np.genfromtxt(recorded_path("lincoln_lab/results_10000.csv"), delimiter=",", names=True)
    golden = {"nmac": (0.118261, 0.126765), "lowc": (0.463995, 0.414920)}
    intervals = {"nmac": (0.095, 0.161), "lowc": (0.372, 0.465)}
    for kind, (plain, weighted) in golden.items():
        event, without = data[f"{kind}_with"] > 0, data[f"{kind}_without"] > 0
        risk_ratio = ratio(event, without, data["weight"])
        assert ratio(event, without, resamples=100).value == pytest.approx(plain, abs=1e-6)
        assert risk_ratio.value == pytest.approx(weighted, abs=1e-6)
        assert risk_ratio.unresolved + risk_ratio.induced == pytest.approx(risk_ratio.value)
        assert (risk_ratio.low, risk_ratio.high) == pytest.approx(intervals[kind], abs=0.005)
        assert risk_ratio.effective < risk_ratio.total


flags = st.lists(
    st.tuples(st.booleans(), st.booleans(), st.integers(0, 5)), min_size=1, max_size=40
)


@given(flags, st.floats(0.01, 100.0))
def test_a_ratio_s_parts_scale_and_weights_that_count(rows, scale: float) -> None:
    event, without, weight = (np.array(column) for column in zip(*rows, strict=True))
    event, without, weight = event.astype(bool), without.astype(bool), weight.astype(float)
    if not weight.sum():
        with pytest.raises(ValueError, match="at least one of them positive"):
            ratio(event, without, weight)
        return
    risk_ratio = ratio(event, without, weight, resamples=100)
    if not weight @ without:
        assert math.isnan(risk_ratio.value)
        assert "undefined" in risk_ratio.warnings[0]
        return
    assert risk_ratio.value == pytest.approx(risk_ratio.unresolved + risk_ratio.induced)
    again = ratio(event, without, scale * weight, resamples=100)
    assert again.value == pytest.approx(risk_ratio.value)
    assert again.effective == pytest.approx(risk_ratio.effective)
    # A whole weight is as good as that many copies.
    repeat = weight.astype(int)
    copies = ratio(np.repeat(event, repeat), np.repeat(without, repeat), resamples=100)
    assert copies.value == pytest.approx(risk_ratio.value)
    assert copies.unresolved == pytest.approx(risk_ratio.unresolved)


def test_the_bootstrap_is_that_of_drawing_whole_encounters() -> None:
    rng = np.random.default_rng(1)
    weight = rng.uniform(0.5, 3.0, 400)
    without = rng.random(400) < 0.4
    event = (without & (rng.random(400) < 0.3)) | (rng.random(400) < 0.02)
    risk_ratio = ratio(event, without, weight, resamples=4_000)
    draws = rng.integers(0, 400, (4_000, 400))
    ratios = (weight * event)[draws].sum(1) / (weight * without)[draws].sum(1)
    assert (risk_ratio.low, risk_ratio.high) == pytest.approx(
        np.quantile(ratios, [0.025, 0.975]), abs=0.01
    )


def test_a_sample_that_cannot_carry_the_claim_says_so() -> None:
    without = np.zeros(1_000, bool)
    without[:5] = True
    risk_ratio = ratio(without & (np.arange(1_000) == 0), without)
    assert any("only 5 events" in warning for warning in risk_ratio.warnings)
    assert any("wide" in warning for warning in risk_ratio.warnings)
    none = ratio(np.zeros(1_000, bool), np.arange(1_000) < 500)
    # No event in 1000: the exact upper end of the rate, 0.00368, over a half.
    assert (none.value, none.low, none.high) == (0.0, 0.0, pytest.approx(0.007364, abs=1e-5))
    weight = np.ones(1_000)
    weight[0] = 500.0
    heavy = ratio(np.arange(1_000) < 100, np.arange(1_000) < 500, weight)
    assert any("one encounter carries" in warning for warning in heavy.warnings)
    with pytest.raises(ValueError, match="one length"):
        ratio(without, without[:-1])
    with pytest.raises(ValueError, match="finite"):
        ratio(without, without, np.full(1_000, np.nan))


def test_costs_and_losses_of_flights() -> None:
    starts = encounters_of_seed(scenario("circle", PAPER), 3, 0, 60)
    flights, paths = fly_recorded(starts, Unmitigated(PAPER), PAPER, endless=True)
    columns = costs(starts, flights, paths, PAPER)
    # Without a resolver the route is flown: nothing is lost but the turn onto it.
    assert columns["path_excess"].max() < 1e-3
    assert np.abs(columns["time_excess_s"]).max() < 1.0
    assert columns["cross_track_m"].max() < 30.0
    for name, volume in VOLUMES.items():
        lost = losses(volume, paths, starts.mask, PAPER.dt)
        if volume.tau == 0.0:
            np.testing.assert_array_equal(
                lost, flights.min_separation < volume.horizontal, err_msg=name
            )
        else:
            assert (lost | (flights.min_separation >= volume.horizontal)).all()
        absent = losses(volume, paths, np.zeros_like(starts.mask), PAPER.dt)
        assert volume.tau == 0.0 or not absent.any()
    assert np.isnan(relative(paths).x[-1]).sum() == (flights.duration < len(paths.action)).sum()


def test_a_ratio_by_hand() -> None:
    without = np.arange(100) < 40
    risk_ratio = ratio(np.arange(100) < 10, without)
    assert risk_ratio.value == 0.25
    assert 0.1 < risk_ratio.low < 0.25 < risk_ratio.high < 0.42
    ratio_of_equals = ratio(without, without)
    low, high = clopper_pearson(40, 100)
    assert (ratio_of_equals.value, ratio_of_equals.low, ratio_of_equals.high) == (
        1.0,
        low / high,
        high / low,
    )
    none = ratio(np.zeros(100, bool), without)
    assert (none.value, none.low, none.high) == (
        0.0,
        0.0,
        pytest.approx(clopper_pearson(0, 100)[1] / 0.4),
    )
    assert np.isnan(ratio(without, np.zeros(100, bool)).value)


def test_a_ratio_of_one_encounter_proves_nothing() -> None:
    once = np.ones(1, bool)
    risk_ratio = ratio(once, once)
    assert risk_ratio.value == 1.0
    assert risk_ratio.low < 0.1
    assert risk_ratio.high > 10.0
    forty = np.arange(1000) < 40  # the same 40 with and without
    risk_ratio = ratio(forty, forty)
    assert 0.4 < risk_ratio.low < 1.0 < risk_ratio.high < 2.5


def test_an_encounter_that_begins_at_the_goal_has_no_path_excess() -> None:
    starts = encounters_of_seed(scenario("circle", PAPER), 3, 0, 2)
    starts = starts._replace(goal_x=starts.own.x + np.array([1.0, 9e3]), goal_y=starts.own.y)
    flights, paths = fly_recorded(starts, Unmitigated(PAPER), PAPER, endless=True)
    excess = costs(starts, flights, paths, PAPER)["path_excess"]
    assert np.isnan(excess[0])
    assert 0.0 <= excess[1] < 10.0
