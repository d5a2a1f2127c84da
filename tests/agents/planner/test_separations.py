"""An intruder's own separation is kept by plans, and by all that judges them, as one of all is."""

import dataclasses
import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from agents import check
from agents.assurance import bands
from agents.assurance.monitor import Cause
from agents.assurance.single import activate, begin, step
from agents.assurance.thresholds import Thresholds
from agents.kernel.traffic import Requirement, Traffic
from agents.planner.answer import AdvisoryCode, Kind, Plan, RequestError
from agents.planner.judge.validator import validate
from agents.planner.planner import plan
from agents.planner.request.observation import distance_scales
from agents.planner.request.request import Altitude, Intruder, Options
from agents.policy.inference import Policy
from envs.aircraft import PAPER
from envs.kinematics import C208_PUBLISHED, VehicleState
from envs.waypoints import RoutePoint, at, legs, plan_states
from tests.agents.planner.test_validator import plans, traffic

POLICY = Policy.load()
OPTIONS = Options.for_aircraft(PAPER, deadline_s=math.inf)
OWN = VehicleState(0.0, 0.0, 0.0, 80.0)
ROUTE = [RoutePoint(100 + i, 12_000.0 + 5_000.0 * i, 0.0) for i in range(9)]
SEPARATIONS = 300.0, 700.0, 1_600.0, 2_500.0


def crossing(rng: np.random.Generator) -> VehicleState:
    """Return an intruder that would come near the straight flight."""
    crossing_time, course, speed = (
        rng.uniform(50.0, 130.0),
        rng.uniform(-3.0, 3.0),
        rng.uniform(40.0, 110.0),
    )
    x, y = 80.0 * crossing_time + rng.uniform(-900.0, 900.0), rng.uniform(-900.0, 900.0)
    back = speed * crossing_time
    return VehicleState(x - back * math.cos(course), y - back * math.sin(course), course, speed)


def scenes(count: int, seed: int) -> list[list[Intruder]]:
    """Return intruders, each with a separation of its own, that begin beyond it."""
    rng, accepted = np.random.default_rng(seed), []
    while len(accepted) < count:
        reports = [
            Intruder(crossing(rng), separation=float(rng.choice(SEPARATIONS)))
            for _ in range(rng.integers(1, 4))
        ]
        if all(
            math.hypot(*report.state[:2]) > (report.separation or 0.0) + 500.0 for report in reports
        ):
            accepted.append(reports)
    return accepted


def test_own_separations_are_remarked() -> None:
    level = Altitude(1_000.0, "msl", 0.0)
    intruders = [
        VehicleState(9_000.0, 6_000.0, 0.0, 80.0),
        Intruder(VehicleState(9_000.0, -6_000.0, 0.0, 80.0), separation=PAPER.separation),
        Intruder(
            VehicleState(12_000.0, 9_000.0, 0.0, 80.0),
            altitude=level,
            separation=2_500.0,
            vertical_separation=300.0,
        ),
    ]
    answer = plan(OWN, intruders, ROUTE, POLICY, OPTIONS, own_altitude=level)
    remarks = [
        advisory for advisory in answer.advisories if advisory.code is AdvisoryCode.OWN_SEPARATION
    ]
    assert [(str(advisory.field), advisory.text) for advisory in remarks] == [
        ("intruders[2].separation", "is 2500 m, of the others 1000 m"),
        (
            "intruders[2].vertical_separation",
            f"is 300 m, of the others {OPTIONS.vertical_filter:g} m",
        ),
    ]
    assert answer.safe


def nearest(answer: Plan, intruder: Intruder) -> float:
    """Return the smallest sampled distance to a straight intruder, m."""
    state, times = intruder.state, np.arange(0.0, answer.waypoints[-1].time, 0.25)
    own = at(legs(plan_states(OWN, answer.waypoints)), times)
    x = state.x + state.speed * times * math.cos(state.heading) - own.x
    y = state.y + state.speed * times * math.sin(state.heading) - own.y
    return float(np.hypot(x, y).min())


def test_every_intruder_is_kept_as_far_as_it_asks_and_the_certificate_proves_it() -> None:
    safe, least = 0, []
    for reports in scenes(16, 1):
        answer = plan(OWN, reports, ROUTE, POLICY, OPTIONS)
        if not answer.safe:
            continue
        safe += 1
        apart = [nearest(answer, report) for report in reports]
        for report, away in zip(reports, apart, strict=True):
            assert report.separation is not None and away >= report.separation
        assert answer.min_separation == pytest.approx(min(apart), abs=15.0)
        least.append(min(apart))
        assert answer.certificate is not None
        data = json.loads(answer.certificate)
        assert [row[9] for row in data["intruders"]] == [report.separation for report in reports]
        check.accept(data)
        # What is proven is the separation of each: a metre beyond its distance is refused.
        closest = int(np.argmin(data["bounds"]))
        data["intruders"][closest][9] = data["bounds"][closest] + 1.0
        with pytest.raises(check.RefusedError, match=f"intruder {closest}"):
            check.accept(data)
    assert safe >= 14
    assert min(least) < 1_000.0  # otherwise no small separation was ever used


def test_the_aircrafts_separation_said_of_each_changes_no_bit() -> None:
    for scene in scenes(6, 2):
        unsaid = [replace(report, separation=None) for report in scene]
        stated = [replace(report, separation=1_000.0) for report in scene]
        first, second = (plan(OWN, reports, ROUTE, POLICY, OPTIONS) for reports in (unsaid, stated))
        assert first == second
        if first.safe:
            assert first.certificate == second.certificate


@pytest.mark.parametrize("separation", SEPARATIONS)
def test_one_separation_of_all_intruders_is_judged_like_that_of_the_requirement(
    separation: float,
) -> None:
    flown, reports = plans(60, 5), traffic(60, 4, 6, turning=True)
    own = reports._replace(separation=np.full(reports.mask.shape, separation))
    by_own = validate(flown, own, Requirement(1_000.0, 5.0), C208_PUBLISHED)
    by_requirement = validate(flown, reports, Requirement(separation, 5.0), C208_PUBLISHED)
    for mine, theirs in zip(by_own, by_requirement, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert 0 < by_own.safe.sum() < 60 or separation == 300.0


def test_bands_and_planner_are_one_truth() -> None:
    own = VehicleState(*(np.array([value]) for value in OWN))
    for scene in scenes(6, 3):
        states = [
            VehicleState(*(np.array([[value]]) for value in report.state)) for report in scene
        ]
        for report, state in zip(scene, states, strict=True):
            reported = Traffic.straight(state)
            assert report.separation is not None
            mine = reported._replace(separation=np.full((1, 1), report.separation))
            arguments = C208_PUBLISHED, 120.0
            own_bands = bands.heading_bands(own, mine, Requirement(1_000.0, 1.0), *arguments)
            bands_of_requirement = bands.heading_bands(
                own, reported, Requirement(report.separation, 1.0), *arguments
            )
            np.testing.assert_array_equal(own_bands.loss, bands_of_requirement.loss)
            np.testing.assert_array_equal(
                own_bands.clearance < 0.0, bands_of_requirement.clearance < 0.0
            )


def causes_told(separation: float | None, ahead: float) -> Any:
    """Return the causes of a monitor whose plan passes an intruder at 2000 m, that many metres
    nearer than was expected.
    """
    thresholds = Thresholds.for_plans(OPTIONS)
    answer = plan(OWN, [], ROUTE, POLICY, OPTIONS)
    expected = Intruder(VehicleState(9_000.0, 2_000.0, math.pi, 80.0), separation=separation)
    watch = activate(begin(thresholds), answer, OWN, {"a": expected}, 0.0)
    now = replace(expected, state=expected.state._replace(y=2_000.0 - ahead))
    _, verdict = step(watch, 0.1, OWN._replace(x=8.0), {"a": now})
    return verdict


def test_the_monitor_watches_the_separation_of_each() -> None:
    for separation, ahead, lost in (
        (None, 900.0, False),
        (None, 1_100.0, True),
        (1_800.0, 100.0, False),
        (1_800.0, 300.0, True),
        (500.0, 1_400.0, False),
        (500.0, 1_600.0, True),
    ):
        verdict = causes_told(separation, ahead)
        causes = {why.cause for why in verdict.reasons}
        assert (Cause.SEPARATION in causes) is lost, (separation, ahead)
        if verdict.ask is not None:
            assert verdict.ask.intruders[0].separation == separation


def test_a_reason_says_what_was_expected_of_that_intruder() -> None:
    report = Intruder(VehicleState(1_500.0, 0.0, 0.0, 80.0), separation=2_000.0)
    answer = plan(OWN, [report], ROUTE, POLICY, OPTIONS)
    reasons = {reason.kind: reason.message for reason in answer.reasons}
    assert reasons[Kind.START_IN_VIOLATION] == (
        "intruders[0] is 1500.0 m away at the request, expected 2000.0 m or more"
    )
    assert "expected 2000.0 m or more" in reasons[Kind.SEPARATION]
    assert plan(OWN, [replace(report, separation=1_000.0)], ROUTE, POLICY, OPTIONS).safe


def test_far_aircraft_are_left_out_by_their_own_separation() -> None:
    far = VehicleState(0.0, 160_000.0, math.pi / 2.0, 80.0)
    usual = plan(OWN, [far], ROUTE, POLICY, OPTIONS)
    assert len(usual.excluded) == 1
    wide = plan(OWN, [Intruder(far, separation=60_000.0)], ROUTE, POLICY, OPTIONS)
    assert wide.excluded == ()


def test_a_vertical_separation_of_its_own_decides_who_is_left_out() -> None:
    level = Altitude(2_000.0, "msl", 0.0)
    above = Intruder(
        VehicleState(9_000.0, 0.0, math.pi, 80.0), altitude=replace(level, value=2_500.0)
    )
    for vertical, left_out in ((None, False), (450.0, True), (700.0, False)):
        report = replace(above, vertical_separation=vertical)
        answer = plan(OWN, [report], ROUTE, POLICY, OPTIONS, own_altitude=level)
        assert answer.safe and bool(answer.excluded) is left_out
        assert answer.certificate is not None
        data = json.loads(answer.certificate)
        check.accept(data)
        if left_out:
            assert data["excluded"][0][5] == vertical
            data["excluded"][0][5] = 501.0
            with pytest.raises(check.RefusedError, match="above or below"):
                check.accept(data)


@pytest.mark.parametrize("name", ["separation", "vertical_separation"])
@pytest.mark.parametrize("value", [0.0, -5.0, math.nan, math.inf, 1e9, "300", True])
def test_a_separation_that_is_none_is_refused_by_name(name: str, value: Any) -> None:
    reports = [VehicleState(9_000.0, 0.0, math.pi, 80.0), Intruder(OWN._replace(x=5_000.0))]
    reports[1] = dataclasses.replace(reports[1], **{name: value})
    with pytest.raises(RequestError) as refused:
        plan(OWN, reports, ROUTE, POLICY, OPTIONS)
    assert refused.value.field == f"intruders[1].{name}"
    assert str(refused.value).count("expected") == 1


def test_the_policy_counts_distances_in_the_separation_of_each() -> None:
    state = VehicleState(3_100.0, 4_200.0, 1.0, 70.0)
    reports = Traffic.straight(state)._replace(separation=np.array([2_000.0, 500.0, math.nan]))
    np.testing.assert_array_equal(distance_scales(reports, Requirement(1_000.0)), [0.5, 2.0, 1.0])
    assert distance_scales(Traffic.straight(state), Requirement(1_000.0)) is None
