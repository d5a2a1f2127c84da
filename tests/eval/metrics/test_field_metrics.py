"""Volumes, risk ratios and costs: by hand, against their definitions, as published."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from envs.aircraft import PAPER
from envs.encounters import scenario
from envs.starts import numbered
from envs.traffic.track_units import FOOT, NAUTICAL_MILE
from eval.flights.simulate import Direct
from eval.metrics.volumes import VOLUMES, Relative, Volume, costs, losses, lost, relative, severity
from eval.metrics.weighted import ratio
from eval.stats.intervals import clopper_pearson
from tests.support import fly_recorded, recorded


def seen(x, y, vx, vy) -> Relative:
    return Relative(*(np.array([float(value)]) for value in (x, y, vx, vy)))


def test_the_standards_volumes() -> None:
    en_route = VOLUMES["do365_en_route"]
    assert (en_route.horizontal, en_route.vertical, en_route.tau) == (0.66 * NAUTICAL_MILE, 450 * FOOT, 35.0)
    assert [round(volume.horizontal / FOOT) for volume in VOLUMES.values()] == [500, 4010, 1500, 2200, 2000]
    assert [round(volume.vertical / FOOT) for volume in VOLUMES.values()] == [100, 450, 450, 450, 250]


def test_modified_tau_by_hand() -> None:
    volume = Volume("by hand", 1_000.0, 100.0, 35.0)
    # Head-on at 100 m/s: (r^2 - D^2) / (100 r) = 35 at r = 3765.6 m.
    reach = 1_750.0 + math.sqrt(1_750.0**2 + 1_000.0**2)
    assert lost(volume, seen(reach - 1.0, 0, -100, 0))[0]
    assert not lost(volume, seen(reach + 1.0, 0, -100, 0))[0]
    # Near, but opening, or passing aside.
    assert not lost(volume, seen(reach - 500.0, 0, 100, 0))[0]
    assert not lost(volume, seen(reach - 500.0, 1_001, -100, 0))[0]


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
        all(abs(a - b) > 1e-6 for a, b in ((apart, volume.horizontal), (miss, volume.horizontal), (tau, volume.tau)))
    )
    expected = apart <= volume.horizontal or (tau <= volume.tau and miss <= volume.horizontal)
    assert lost(volume, seen(x, y, vx, vy))[0] == expected


def test_severity_by_hand() -> None:
    volume = Volume("by hand", 1_000.0, 100.0, 35.0)
    # A collision course at half the reach, level: only the range has not been penetrated fully.
    assert severity(volume, seen(0, 0, -100, 0))[0] == pytest.approx(1.0)
    reach = 1_750.0 + math.sqrt(1_750.0**2 + 1_000.0**2)
    assert severity(volume, seen(0.5 * reach, 0, -100, 0))[0] == pytest.approx(0.5)
    assert severity(volume, seen(2 * reach, 0, -100, 0))[0] == 0.0


@given(lengths, lengths, rates, rates, st.sampled_from(sorted(VOLUMES)))
def test_severity_is_positive_where_the_volume_is_lost_only(x, y, vx, vy, name) -> None:
    volume, scene = VOLUMES[name], seen(x, y, vx, vy)
    value = severity(volume, scene)[0]
    assert 0.0 <= value <= 1.0
    if value > 1e-6:
        assert lost(volume, scene)[0]


def test_published_risk_ratios() -> None:
    """10 000 simulated encounters with and without a system: published ratios, weighted and not."""
    data = np.genfromtxt(recorded("lincoln_lab/results_10000.csv"), delimiter=",", names=True)
    golden = {"nmac": (0.118261, 0.126765), "lowc": (0.463995, 0.414920)}
    intervals = {"nmac": (0.095, 0.161), "lowc": (0.372, 0.465)}
    for kind, (plain, weighted) in golden.items():
        event, without = data[f"{kind}_with"] > 0, data[f"{kind}_without"] > 0
        found = ratio(event, without, data["weight"])
        assert ratio(event, without, resamples=100).value == pytest.approx(plain, abs=1e-6)
        assert found.value == pytest.approx(weighted, abs=1e-6)
        assert found.unresolved + found.induced == pytest.approx(found.value)
        assert (found.low, found.high) == pytest.approx(intervals[kind], abs=0.005)
        assert found.effective < found.total


flags = st.lists(st.tuples(st.booleans(), st.booleans(), st.integers(0, 5)), min_size=1, max_size=40)


@given(flags, st.floats(0.01, 100.0))
def test_a_ratio_s_parts_scale_and_weights_that_count(rows, scale: float) -> None:
    event, without, weight = (np.array(column) for column in zip(*rows, strict=True))
    event, without, weight = event.astype(bool), without.astype(bool), weight.astype(float)
    if not weight.sum():
        with pytest.raises(ValueError, match="at least one of them positive"):
            ratio(event, without, weight)
        return
    found = ratio(event, without, weight, resamples=100)
    if not weight @ without:
        assert math.isnan(found.value)
        assert "undefined" in found.warnings[0]
        return
    assert found.value == pytest.approx(found.unresolved + found.induced)
    again = ratio(event, without, scale * weight, resamples=100)
    assert again.value == pytest.approx(found.value)
    assert again.effective == pytest.approx(found.effective)
    # A whole weight is as good as that many copies.
    repeat = weight.astype(int)
    copies = ratio(np.repeat(event, repeat), np.repeat(without, repeat), resamples=100)
    assert copies.value == pytest.approx(found.value)
    assert copies.unresolved == pytest.approx(found.unresolved)


def test_the_bootstrap_is_that_of_drawing_whole_encounters() -> None:
    rng = np.random.default_rng(1)
    weight = rng.uniform(0.5, 3.0, 400)
    without = rng.random(400) < 0.4
    event = (without & (rng.random(400) < 0.3)) | (rng.random(400) < 0.02)
    found = ratio(event, without, weight, resamples=4_000)
    draws = rng.integers(0, 400, (4_000, 400))
    ratios = (weight * event)[draws].sum(1) / (weight * without)[draws].sum(1)
    assert (found.low, found.high) == pytest.approx(np.quantile(ratios, [0.025, 0.975]), abs=0.01)


def test_a_sample_that_cannot_carry_the_claim_says_so() -> None:
    without = np.zeros(1_000, bool)
    without[:5] = True
    found = ratio(without & (np.arange(1_000) == 0), without)
    assert any("only 5 events" in each for each in found.warnings)
    assert any("wide" in each for each in found.warnings)
    none = ratio(np.zeros(1_000, bool), np.arange(1_000) < 500)
    # No event in 1000: the exact upper end of the rate, 0.00368, over a half.
    assert (none.value, none.low, none.high) == (0.0, 0.0, pytest.approx(0.007364, abs=1e-5))
    weight = np.ones(1_000)
    weight[0] = 500.0
    heavy = ratio(np.arange(1_000) < 100, np.arange(1_000) < 500, weight)
    assert any("one encounter carries" in each for each in heavy.warnings)
    with pytest.raises(ValueError, match="one length"):
        ratio(without, without[:-1])
    with pytest.raises(ValueError, match="finite"):
        ratio(without, without, np.full(1_000, np.nan))


def test_costs_and_losses_of_flights() -> None:
    starts = numbered(scenario("circle", PAPER), 3, 0, 60)
    flights, paths = fly_recorded(starts, Direct(PAPER), PAPER, endless=True)
    found = costs(starts, flights, paths)
    # Without a resolver the route is flown: nothing is lost but the turn onto it.
    assert found["path_excess"].max() < 1e-3
    assert np.abs(found["time_excess_s"]).max() < 1.0
    assert found["cross_track_m"].max() < 30.0
    for name, volume in VOLUMES.items():
        there = losses(volume, paths, starts.mask)
        if volume.tau == 0.0:
            np.testing.assert_array_equal(there, flights.min_separation < volume.horizontal, err_msg=name)
        else:
            assert (there | (flights.min_separation >= volume.horizontal)).all()
        absent = losses(volume, paths, np.zeros_like(starts.mask))
        assert volume.tau == 0.0 or not absent.any()
    assert np.isnan(relative(paths).x[-1]).sum() == (flights.duration < len(paths.action)).sum()


def test_a_ratio_by_hand() -> None:
    without = np.arange(100) < 40
    found = ratio(np.arange(100) < 10, without)
    assert found.value == 0.25
    assert 0.1 < found.low < 0.25 < found.high < 0.42
    same = ratio(without, without)
    assert (same.value, same.low, same.high) == (1.0, 1.0, 1.0)
    none = ratio(np.zeros(100, bool), without)
    assert (none.value, none.low, none.high) == (0.0, 0.0, pytest.approx(clopper_pearson(0, 100)[1] / 0.4))
    assert np.isnan(ratio(without, np.zeros(100, bool)).value)
