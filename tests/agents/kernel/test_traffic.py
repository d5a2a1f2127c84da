"""Aged reports of turning intruders: planner, monitor and validator advance them along the same
arc.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.assurance import single
from agents.kernel.traffic import (
    Requirement,
    advance_reports,
    growth,
    predict,
    requirement_of,
    same_flight,
    turn_error,
    uncertainty,
    whole,
)
from agents.planner import Intruder, Options, RequestError, plan
from agents.planner.request.reports import arrays_of_reports
from agents.planner.request.request import check_request
from agents.policy.inference import Policy
from envs.aircraft import PAPER
from envs.kinematics import VehicleState
from envs.trees import map_leaves
from envs.waypoints import RoutePoint, at, legs, plan_states
from tests.agents.scenes import PATIENT, THRESHOLDS

OWN = VehicleState(0.0, 0.0, 0.0, 75.0)
ROUTE = [RoutePoint(index, 12_000.0 + 5_000.0 * index, 0.0) for index in range(9)]
STRAIGHT = plan(OWN, [], ROUTE, Policy.load(), PATIENT)
TURNING = Intruder(VehicleState(4468.8, 1203.5, 2.973826, 96.0175), 5.0, math.radians(3.0), 26.704)
reports = st.builds(
    Intruder,
    st.builds(
        VehicleState,
        st.floats(-2e4, 2e4),
        st.floats(-2e4, 2e4),
        st.floats(-math.pi, math.pi, exclude_max=True),
        st.floats(0.0, 400.0),
    ),
    st.floats(-0.5, 5.0),
    st.floats(-0.5, 0.5),
    st.sampled_from([0.0, 0.3, 2.0, 5.0, 30.0]),
)


def place_at(report: Intruder, time: np.ndarray) -> np.ndarray:
    """Return where a report leads by a time since the request, complex m."""
    x, y, heading, speed = report.state
    rate = report.turn_rate if report.turn_time > 0.0 else 0.0
    turning = np.minimum(time + report.age, report.turn_time)
    turn = rate * turning
    chord = np.exp(0.5j * turn) * np.sinc(0.5 * turn / math.pi) * turning
    straight = np.exp(1j * turn) * (time + report.age - turning)
    return x + 1j * y + speed * np.exp(1j * heading) * (chord + straight)


def test_plan_keeps_the_separation_from_an_aged_turn_as_reported() -> None:
    answer = plan(OWN, [TURNING], ROUTE, Policy.load(), PATIENT)
    assert answer.safe
    time = np.linspace(0.0, answer.waypoints[-1].time, 4_000)
    path = map_leaves(
        lambda field: np.broadcast_to(field, (time.size, field.size)),
        plan_states(OWN, answer.waypoints),
    )
    own = at(legs(path), time)
    apart = np.abs(own.x + 1j * own.y - place_at(TURNING, time))
    assert apart.min() >= 1_000.0
    assert apart.min() == pytest.approx(answer.min_separation, abs=0.5)


@given(reports)
def test_reports_are_advanced_along_their_arc(report: Intruder) -> None:
    request, _, _ = check_request(OWN, [report], ROUTE, Options.for_aircraft(PAPER))
    for time in (0.0, 1.0, 10.0, 400.0):
        now = predict(request.traffic, time)
        place = place_at(report, np.array(time))
        assert abs(now.x[0, 0] + 1j * now.y[0, 0] - place) < 1e-3
    np.testing.assert_array_equal(request.traffic.state.speed, report.state.speed)


@given(reports)
def test_monitor_expects_what_the_planner_plans_with(report: Intruder) -> None:
    planned = check_request(OWN, [report], ROUTE, Options.for_aircraft(PAPER))[0].traffic
    expected = single.activate(
        single.begin(THRESHOLDS), STRAIGHT, OWN, {"4b1a2c": report}, 0.0
    ).monitor.expected
    for mine, theirs in zip(
        (*planned.state, *whole(planned)[1:]), (*expected.state, *expected[1:]), strict=True
    ):
        np.testing.assert_allclose(mine, theirs, atol=1e-9)


@given(reports)
def test_validator_accepts_advanced_reports(report: Intruder) -> None:
    reported, age = arrays_of_reports([report, report])
    assert same_flight(reported, age, advance_reports(reported, age)).all()


@pytest.mark.parametrize("field", ["straight", "turn_time", "turn_rate", "speed"])
def test_validator_finds_wrongly_advanced_reports(field: str) -> None:
    reported, age = arrays_of_reports([TURNING, Intruder(OWN, 2.0)])
    right = advance_reports(reported, age)
    wrong = {
        "straight": right._replace(state=predict(reported._replace(turn_time=0.0 * age), age)),
        "turn_time": right._replace(turn_time=reported.turn_time),
        "turn_rate": right._replace(turn_rate=0.999 * right.turn_rate),
        "speed": right._replace(
            state=right.state._replace(speed=right.state.speed + np.array([[1.0, 0.0]]))
        ),
    }[field]
    assert same_flight(reported, age, wrong).tolist() == [[False, True]]


def test_traffic_that_does_not_follow_from_its_reports_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        "agents.planner.request.request.advance_reports", lambda reported, age: reported
    )
    with pytest.raises(RequestError) as refused:
        plan(OWN, [Intruder(OWN._replace(y=30_000.0)), TURNING], ROUTE, Policy.load(), PATIENT)
    assert refused.value.field == "intruders[1]"


@given(reports, st.floats(0.0, 400.0))
def test_one_velocity_error_counts_from_the_report_on(report: Intruder, time: float) -> None:
    vague = replace(report, position_std=40.0, velocity_std=3.0)
    now = advance_reports(*arrays_of_reports([vague]))
    sigma = math.hypot(40.0, 3.0 * (abs(report.age) + time))
    assert uncertainty(now, time).item() == pytest.approx(sigma)
    requirement = Requirement(1_000.0, 0.0, 2.0)
    need = requirement_of(now, VehicleState(*np.full((4, 1), 1e7)), requirement) + growth(
        now, np.float64(time), requirement.sigmas
    )
    assert need.item() == pytest.approx(1_000.0 + 2.0 * sigma)


def test_the_monitor_hands_reports_on_with_their_age() -> None:
    vague = Intruder(
        VehicleState(3_000.0, 0.0, math.pi, 60.0), 2.0, position_std=40.0, velocity_std=3.0
    )
    watch = single.activate(single.begin(THRESHOLDS), STRAIGHT, OWN, {"4b1a2c": vague}, 0.0)
    _, verdict = single.step(watch, 0.0, OWN, {"4b1a2c": vague})
    assert verdict.ask is not None
    assert verdict.ask.intruders == (vague,)


@given(st.floats(0.0, 0.1), st.floats(0.0, 30.0), st.floats(0.0, 300.0))
def test_a_line_bounds_what_an_error_of_the_turn_makes(
    turn_std: float, turn_time: float, time: float
) -> None:
    turned = min(time, turn_time)
    bend = 0.5 * turned**2 + turned * (time - turned)
    assert 75.0 * turn_std * bend <= turn_error(75.0, turn_std, turn_time) * time + 1e-9
