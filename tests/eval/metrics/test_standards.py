"""Figures in the units of standards: alerts by hand, parts that add up, and weights."""

import math
from dataclasses import replace

import numpy as np
import pytest

from envs.kinematics import VehicleState
from eval.flights.trajectories import FlownAltitudes, Trajectories
from eval.metrics.alerting import ALERTING, first_alert, time_to_loss
from eval.metrics.standards import Sample, standards
from eval.metrics.volumes import VOLUMES, Relative, first_loss, losses
from eval.metrics.weighted import unseen, weighted_mean, weighted_rate
from eval.stats.intervals import clopper_pearson

F3442 = VOLUMES["f3442"]
SAMPLE = Sample("f3442", None, 0.95, 200, 0)


def relative_state(x: float, vx: float, y: float = 0.0, z: float = 0.0) -> Relative:
    return Relative(*(np.array([value]) for value in (x, y, vx, 0.0, z)))


def passing(
    steps: int, *, miss: float = 0.0, above: float = 0.0, climb: float = 0.0
) -> Trajectories:
    """Return a flight at rest that an intruder passes at 100 m/s from 10 km away, second by second,
    so far aside and above at first, m, climbing, m/s.
    """
    time = np.arange(steps + 1.0)[:, None]
    zero = 0.0 * time
    own: VehicleState = VehicleState(zero, zero, zero, zero)
    x = 10_000.0 - 100.0 * time
    intruders = VehicleState(
        *(f[..., None] for f in (x, miss + zero, math.pi + zero, 100.0 + zero))
    )
    apart = np.hypot(x[1:], miss)
    levels = FlownAltitudes(zero, (above + climb * time)[..., None])
    return Trajectories(own, intruders, np.zeros((steps, 1, 2)), apart, levels)


def test_a_predicted_loss_is_that_of_straight_courses_and_even_climbs() -> None:
    radius, height = F3442.horizontal, F3442.vertical
    entry = math.ceil((6_000.0 - radius) / 100.0)
    assert time_to_loss(F3442, relative_state(6_000.0, -100.0), 0.0, 75.0) == [entry]
    assert time_to_loss(F3442, relative_state(6_000.0, 100.0), 0.0, 75.0) == [np.inf]
    assert time_to_loss(F3442, relative_state(6_000.0, -100.0, y=radius + 1.0), 0.0, 75.0) == [
        np.inf
    ]
    assert time_to_loss(F3442, relative_state(6_000.0, -100.0), 0.0, entry - 1.0) == [np.inf]
    # From above it comes down to the ownship's level while it is near.
    down = math.ceil((400.0 - height) / 5.5)
    assert entry < down <= (6_000.0 + radius) / 100.0
    assert time_to_loss(F3442, relative_state(6_000.0, -100.0, z=400.0), -5.5, 75.0) == [down]
    assert time_to_loss(F3442, relative_state(6_000.0, -100.0, z=400.0), 5.5, 75.0) == [np.inf]


def test_the_first_alert_comes_at_the_corrective_time() -> None:
    mask = np.ones((1, 1), dtype=bool)
    flown = passing(120)
    lost = first_loss(F3442, flown, mask, 1.0)
    assert lost == [math.ceil((10_000.0 - F3442.horizontal) / 100.0)]
    # Two of the last four looks must ask for it, so that it comes a second later.
    due = lost - ALERTING.reached.corrective
    assert first_alert(F3442, flown, 1.0) == due + 1.0
    assert first_alert(F3442, flown, 1.0, replace(ALERTING, m=1)) == due
    for clear in (passing(120, miss=F3442.horizontal + 1.0), passing(120, above=100.0)):
        assert not losses(F3442, clear, mask, 1.0).any()
        assert np.isinf(first_alert(F3442, clear, 1.0)).all()


def test_nobody_is_alerted_of_who_is_not_reported() -> None:
    flown = passing(120)
    late = np.arange(121)[:, None, None] < 70
    hidden = VehicleState(*(np.where(late, np.nan, field) for field in flown.intruders))
    assert first_alert(F3442, flown._replace(intruders=hidden), 1.0) == [70.0]


@pytest.mark.parametrize("name", VOLUMES)
def test_a_loss_begins_while_the_volume_is_lost(name: str) -> None:
    mask = np.ones((1, 1), dtype=bool)
    for flown in (passing(199), passing(199, above=300.0, climb=-3.0), passing(199, miss=3e3)):
        lost = first_loss(VOLUMES[name], flown, mask, 1.0)
        assert np.isfinite(lost) == losses(VOLUMES[name], flown, mask, 1.0)
        before = flown._replace(intruders=flown.intruders._replace(x=flown.intruders.x + 1e5))
        assert np.isinf(first_loss(VOLUMES[name], before, mask, 1.0)).all()


def table(count: int, seed: int) -> dict[str, np.ndarray]:
    random = np.random.default_rng(seed)
    alert = random.uniform(0.0, 100.0, count)
    return {
        "lost_nmac": random.random(count) < 0.2,
        "lost_f3442": random.random(count) < 0.5,
        "alert_s": np.where(random.random(count) < 0.3, np.inf, alert),
        "well_clear_loss_s": np.where(random.random(count) < 0.5, np.inf, alert + 40.0),
        "heading_reversals": random.integers(0, 3, count),
        "path_excess": random.random(count),
        "cross_track_m": random.uniform(0.0, 100.0, count),
        "altitude_deviation_m": random.uniform(0.0, 10.0, count),
    }


def test_what_stays_and_what_comes_anew_make_the_probability() -> None:
    ours, bare = table(300, 1), table(300, 2)
    weights = np.random.default_rng(3).uniform(0.1, 5.0, 300)
    for sample in (SAMPLE, SAMPLE._replace(weights=weights)):
        figures = standards(ours, bare, sample)
        without = standards(bare, bare, sample)
        for event in ("nmac", "lowc"):
            rate, stays, anew = (
                figures[f"{event}_{part}"]["value"] for part in ("rate", "unresolved", "induced")
            )
            assert rate == pytest.approx(stays + anew)
            ratio = figures[f"{event}_ratio"]
            assert ratio["value"] == pytest.approx(rate / without[f"{event}_rate"]["value"])
            assert ratio["low"] < ratio["value"] < ratio["high"]
            share = figures[f"{event}_stays"]["value"]
            assert share * without[f"{event}_rate"]["value"] == pytest.approx(stays)
            assert without[f"{event}_ratio"] == {"value": 1.0, "low": 1.0, "high": 1.0}
            assert without[f"{event}_induced"]["value"] == 0.0
        assert figures["nuisance_rate"]["value"] <= figures["alert_rate"]["value"]
        scaled = sample._replace(
            weights=7.0 * (np.ones(300) if sample.weights is None else weights)
        )
        for key, figure in standards(ours, bare, scaled).items():
            assert figure["value"] == pytest.approx(figures[key]["value"]), key


def test_strata_without_an_event_are_bounded_exactly() -> None:
    """No chances of events in the strata that leave the outcome likely enough have more weight."""
    random = np.random.default_rng(8)
    counts = np.array([30, 200, 80])
    masses = np.array([0.05, 0.45, 0.5])
    strata = np.repeat(np.arange(3), counts)
    weight = (masses / counts)[strata]
    none = np.zeros(strata.size, dtype=bool)
    bound = unseen(none, strata, weight)
    tail = 0.5 * (1.0 - 0.95)
    chances = np.exp(random.uniform(-9.0, -0.5, (20_000, 3)))
    quiet = np.prod((1.0 - chances) ** counts, axis=1)
    likely = chances[quiet >= tail] @ masses
    assert likely.size > 1_000 and likely.max() <= bound
    # And little more than what chances in the stratum of the heaviest encounters can have.
    assert masses[2] * clopper_pearson(0, counts[2])[1] > 0.95 * bound
    # Equal weights are no strata; where there is an event nothing is unseen.
    equal = np.ones(strata.size)
    assert unseen(none, strata, equal) == strata.size * clopper_pearson(0, strata.size)[1]
    assert unseen(np.ones_like(none), strata, weight) == 0.0
    only = strata == 0
    assert unseen(~only, strata, weight) == pytest.approx(0.05 * clopper_pearson(0, 30)[1])


def test_strata_without_an_event_raise_upper_ends() -> None:
    ours, bare = table(300, 1), table(300, 2)
    ours["lost_nmac"] = np.zeros(300, dtype=bool)
    strata = bare["lost_nmac"] + bare["lost_f3442"].astype(int)
    weights = np.array([2.0, 1.0, 0.2])[strata]
    sample = SAMPLE._replace(weights=weights)
    plain, figures = (
        standards(ours, bare, sample),
        standards(ours, bare, sample._replace(strata=strata)),
    )
    parts = "nmac_rate", "nmac_unresolved", "nmac_induced"
    whole, stays, anew = (figures[name]["high"] for name in parts)
    # What stays is at most what there is; the bound of all holds for the parts.
    assert stays <= whole and anew <= whole and stays < figures["nmac_rate"]["high"]
    assert figures["nmac_ratio"]["high"] == pytest.approx(
        whole / (weights @ bare["lost_nmac"] / weights.sum())
    )
    for key, figure in figures.items():
        assert figure["value"] == plain[key]["value"]
        if "nmac" not in key and figure["high"] is not None:
            assert figure["high"] >= plain[key]["high"]
    assert standards(bare, bare, sample._replace(strata=strata)) == standards(bare, bare, sample)


def test_a_nuisance_has_no_loss_within_the_look_ahead_and_a_manoeuvre_may_be_needless() -> None:
    calm = {name: values[:4] for name, values in table(4, 1).items()}
    calm |= {"cross_track_m": np.array([0.0, 200.0, 0.0, 0.0])}
    calm |= {"altitude_deviation_m": np.array([0.0, 0.0, 30.0, 0.0])}
    bare = {**calm, "lost_f3442": np.array([False, False, False, True])}
    bare["well_clear_loss_s"] = np.array([np.inf, 60.0, 95.0, 40.0])
    calm["alert_s"] = np.array([10.0, 10.0, 10.0, np.inf])
    figures = standards(calm, bare, SAMPLE)
    assert figures["alert_rate"]["count"] == 3
    assert figures["nuisance_rate"]["count"] == 2  # never lost, and lost later than 55 s
    assert figures["needless_rate"]["count"] == 2  # aside, and in altitude
    assert figures["time_to_loss_s"]["value"] == pytest.approx((50.0 + 85.0) / 2.0)


def test_equal_weights_are_no_weights() -> None:
    random = np.random.default_rng(4)
    counted, values = random.random(200) < 0.1, random.random(200)
    every, ones = np.ones(200, dtype=bool), np.ones(200)
    values[0] = np.nan
    rate = weighted_rate(counted, every, ones)
    assert rate["value"] == weighted_rate(counted, every, None)["value"] == counted.mean()
    assert weighted_mean(values, ones) == weighted_mean(values, None)
    assert weighted_mean(values, None)["value"] == pytest.approx(np.nanmean(values))
    assert weighted_mean(np.full(3, np.nan), None)["value"] is None
