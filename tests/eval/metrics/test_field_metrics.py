"""Volumes, risk ratios and costs: by hand, against brute force, as published; and quasi-random draws in a run."""

import json
import math
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.config.load import ConfigError, load
from envs.aircraft import PAPER
from envs.encounters import scenario
from envs.sobol import REPLICATES, quasi_numbered
from envs.starts import numbered
from envs.traffic.track_units import FOOT, NAUTICAL_MILE
from eval.config import MonteCarloConfig
from eval.flights.simulate import Direct
from eval.flights.sources import drawn, read_source
from eval.hifi.config import HifiConfig
from eval.metrics.field import costs, losses, ratio, relative
from eval.metrics.replicated import replicated
from eval.metrics.volumes import (
    ALERTS,
    VOLUMES,
    Relative,
    Volume,
    alerted,
    cylinder,
    lead_times,
    lost,
    severity,
    time_to_loss,
)
from eval.monte_carlo import run as monte_carlo
from eval.stats.intervals import clopper_pearson
from tests.support import fly_recorded, recorded


def seen(x, y, vx, vy, z=0.0, vz=0.0) -> Relative:
    return Relative(*(np.array([float(value)]) for value in (x, y, vx, vy, z, vz)))


def test_the_standards_volumes() -> None:
    en_route = VOLUMES["do365_en_route"]
    assert (en_route.horizontal, en_route.vertical, en_route.tau) == (0.66 * NAUTICAL_MILE, 450 * FOOT, 35.0)
    assert [round(volume.horizontal / FOOT) for volume in VOLUMES.values()] == [500, 4010, 1500, 2200, 2000]
    assert [round(volume.vertical / FOOT) for volume in VOLUMES.values()] == [100, 450, 450, 450, 250]
    assert {name: level.seconds for name, level in ALERTS.items()} == {
        "preventive": 55.0,
        "corrective": 55.0,
        "warning": 25.0,
    }


def test_a_cylinder_by_hand() -> None:
    volume = cylinder(1_000.0, 100.0)
    assert time_to_loss(volume, seen(5_000, 0, -100, 0))[0] == pytest.approx(40.0)
    assert time_to_loss(volume, seen(5_000, 1_001, -100, 0))[0] == math.inf
    assert time_to_loss(volume, seen(5_000, 0, 100, 0))[0] == math.inf
    assert time_to_loss(volume, seen(500, 0, 100, 0))[0] == 0.0
    # Below, and level again when the horizontal distance is lost already: at 50 s.
    assert time_to_loss(volume, seen(5_000, 0, -100, 0, z=-350, vz=5))[0] == pytest.approx(50.0)
    # The heights come together only after the circle is left, at 60 s.
    assert time_to_loss(volume, seen(5_000, 0, -100, 0, z=-450, vz=5))[0] == math.inf
    assert lost(volume, seen(0, 0, 0, 0, z=101))[0] == False  # noqa: E712
    with pytest.raises(ValueError, match="positive"):
        cylinder(0.0)


def test_modified_tau_by_hand() -> None:
    volume = Volume("by hand", 1_000.0, 100.0, 35.0)
    # Head-on at 100 m/s: (r^2 - D^2) / (100 r) = 35 at r = 3765.6 m.
    reach = 1_750.0 + math.sqrt(1_750.0**2 + 1_000.0**2)
    assert time_to_loss(volume, seen(reach + 1_000.0, 0, -100, 0))[0] == pytest.approx(10.0)
    assert lost(volume, seen(reach - 1.0, 0, -100, 0))[0]
    assert not lost(volume, seen(reach + 1.0, 0, -100, 0))[0]
    # Near, but opening, or passing aside.
    assert not lost(volume, seen(reach - 500.0, 0, 100, 0))[0]
    assert not lost(volume, seen(reach - 500.0, 1_001, -100, 0))[0]


lengths = st.floats(-6_000, 6_000)
rates = st.floats(-150, 150)


@given(lengths, lengths, rates, rates, st.floats(-400, 400), st.floats(-10, 10), st.sampled_from(sorted(VOLUMES)))
def test_time_to_loss_is_what_stepping_along_the_course_finds(x, y, vx, vy, z, vz, name) -> None:
    volume = VOLUMES[name]
    times = np.arange(0.0, 120.0, 0.05)
    path = Relative(x + vx * times, y + vy * times, vx + 0 * times, vy + 0 * times, z + vz * times, vz + 0 * times)
    square = path.x**2 + path.y**2
    closing = path.x * vx + path.y * vy
    # Straight from the definitions of the standard; a rate next to zero gives an infinite time.
    with np.errstate(over="ignore"):
        tau = np.where(closing < 0.0, (volume.horizontal**2 - square) / np.where(closing < 0.0, closing, 1.0), np.inf)
    cpa = np.maximum(-closing / max(vx * vx + vy * vy, 1e-12), 0.0)
    miss = np.hypot(path.x + vx * cpa, path.y + vy * cpa)
    inside = square <= volume.horizontal**2
    horizontal = inside | ((tau <= volume.tau) & (miss <= volume.horizontal))
    found = horizontal & (np.abs(path.z) <= volume.vertical)
    entry = float(time_to_loss(volume, seen(x, y, vx, vy, z, vz))[0])
    if found.any():
        assert entry <= times[np.argmax(found)] + 1e-6
        assert entry >= times[np.argmax(found)] - 0.0501
    elif entry < 119.0:
        # A visit shorter than the steps can be missed by them; a moment after the entry it must be there.
        margin = 1e-6 + 1e-9 * abs(entry)
        at = seen(x + vx * entry, y + vy * entry, vx, vy, z + vz * entry, vz)
        assert math.hypot(at.x[0], at.y[0]) <= volume.horizontal + volume.tau * math.hypot(vx, vy) + margin
        assert abs(at.z[0]) <= volume.vertical + 1e-6


def test_severity_by_hand() -> None:
    volume = Volume("by hand", 1_000.0, 100.0, 35.0)
    # A collision course at half the reach, level: only the range has not been penetrated fully.
    assert severity(volume, seen(0, 0, -100, 0))[0] == pytest.approx(1.0)
    reach = 1_750.0 + math.sqrt(1_750.0**2 + 1_000.0**2)
    assert severity(volume, seen(0.5 * reach, 0, -100, 0))[0] == pytest.approx(0.5)
    assert severity(volume, seen(0.5 * reach, 0, -100, 0, z=50))[0] == pytest.approx(1 - math.sqrt(0.25 + 0.75 * 0.25))
    assert severity(volume, seen(2 * reach, 0, -100, 0))[0] == 0.0
    assert severity(volume, seen(0.5 * reach, 0, -100, 0, z=100))[0] == 0.0


@given(lengths, lengths, rates, rates, st.sampled_from(sorted(VOLUMES)))
def test_severity_is_positive_where_the_volume_is_lost_only(x, y, vx, vy, name) -> None:
    volume, scene = VOLUMES[name], seen(x, y, vx, vy)
    value = severity(volume, scene)[0]
    assert 0.0 <= value <= 1.0
    if value > 1e-6:
        assert lost(volume, scene)[0]


def test_lead_times() -> None:
    alert = np.array([[0, 0, 0, 0], [1, 0, 0, 1], [1, 0, 1, 1], [1, 0, 1, 1]], bool)
    loss = np.array([[0, 0, 0, 0], [0, 0, 1, 0], [0, 1, 1, 0], [1, 1, 1, 0]], bool)
    found = lead_times(alert, loss, 2.0)
    # Two steps before; never alerted; after the loss; never lost.
    assert found[:3].tolist() == [4.0, 0.0, 0.0]
    assert math.isnan(found[3])
    warned = alerted(ALERTS["warning"], seen(9_000, 0, -100, 0))
    assert not warned[0]
    assert alerted(ALERTS["corrective"], seen(9_000, 0, -100, 0))[0]


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
    assert found.path_excess.max() < 1e-3
    assert np.abs(found.time_excess_s).max() < 1.0
    assert found.cross_track_m.max() < 30.0
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


# The key ``draws`` of an evaluation: bits unchanged by default, quasi-random on demand, else refused.


def test_random_draws_are_what_they_were() -> None:
    source, _ = read_source(MonteCarloConfig(), PAPER)
    made, usual = drawn(source, 7, 5, 20)[0], numbered(scenario("circle", PAPER), 7, 5, 20)
    np.testing.assert_array_equal(made.own.x, usual.own.x)


def test_sobol_draws_are_quasi_random() -> None:
    source, _ = read_source(load(MonteCarloConfig, None, ["draws=sobol", "encounters=64"]), PAPER)
    made, wanted = drawn(source, 7, 5, 20)[0], quasi_numbered(scenario("circle", PAPER), 7, 5, 20)
    np.testing.assert_array_equal(made.own.x, wanted.own.x)
    assert not np.array_equal(made.own.x, numbered(scenario("circle", PAPER), 7, 5, 20).own.x)


def test_a_quasi_random_run_takes_its_intervals_from_the_randomisations(tmp_path: Path, policy_path: Path) -> None:
    out = tmp_path / "run"
    quick = ["--set", "figures=false", "--set", "resamples=100", "--workers", "1"]
    asked = ["--policy", str(policy_path), "--encounters", "32", "--set", "draws=sobol", *quick]
    assert monte_carlo.main([*asked, "--out", str(out)]) == 0
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["draws"] == "sobol"
    read = pq.read_table(out / "encounters.parquet")
    table = {name: read[name].to_numpy(zero_copy_only=False) for name in read.column_names}
    expected = replicated(table, REPLICATES, 0.95)
    assert {key: summary[key] for key in expected} == expected


@pytest.mark.parametrize(
    ("model", "overrides", "said"),
    [
        (MonteCarloConfig, ["draws=halton"], "draws: 'halton' .* random or sobol"),
        (MonteCarloConfig, ["draws=sobol", "encounters=1000"], "encounters is 1000.* 16"),
        (
            MonteCarloConfig,
            ["draws=sobol", "scenario=file:x.csv", "encounters=16"],
            "draws is 'sobol'.*expected random",
        ),
        (HifiConfig, ["draws=sobol"], "draws: 'sobol'.*random$"),
    ],
)
def test_draws_that_cannot_be_had_are_refused(model: type[MonteCarloConfig], overrides: list[str], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        load(model, None, overrides)
