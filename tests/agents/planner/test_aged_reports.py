"""Aged reports of turning intruders: planner, monitor and validator advance them along the same arc."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.assurance import single
from agents.planner import Intruder, Options, RequestError, plan
from agents.planner.request import checked, reported
from agents.planner.separation import same_flight
from agents.planner.traffic import advanced, predicted
from agents.policy.inference import Policy
from benchmarks.safety.resimulation import travelled
from envs.kinematics import VehicleState
from envs.trees import mapped
from envs.waypoints import RoutePoint, at, knots, legs

OWN = VehicleState(0.0, 0.0, 0.0, 75.0)
ROUTE = [RoutePoint(index, 12_000.0 + 5_000.0 * index, 0.0) for index in range(9)]
STRAIGHT = plan(OWN, [], ROUTE, Policy.load())
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


def flown(report: Intruder, time: np.ndarray) -> np.ndarray:
    """Return where a report leads by a time since the request, complex m."""
    x, y, heading, speed = report.state
    rate = report.turn_rate if report.turn_time > 0.0 else 0.0
    return x + 1j * y + travelled(heading, speed, rate, report.turn_time, time + report.age)


def test_plan_keeps_the_separation_from_an_aged_turn_as_reported() -> None:
    answer = plan(OWN, [TURNING], ROUTE, Policy.load())
    assert answer.safe
    time = np.linspace(0.0, answer.waypoints[-1].time, 4_000)
    path = mapped(lambda field: np.broadcast_to(field, (time.size, field.size)), knots(OWN, answer.waypoints))
    own = at(legs(path), time)
    apart = np.abs(own.x + 1j * own.y - flown(TURNING, time))
    assert apart.min() >= 1_000.0
    assert apart.min() == pytest.approx(answer.min_separation, abs=0.5)


@given(reports)
def test_reports_are_advanced_along_their_arc(report: Intruder) -> None:
    request, _, _ = checked(OWN, [report], ROUTE, Options())
    for time in (0.0, 1.0, 10.0, 400.0):
        now = predicted(request.traffic, time)
        there = flown(report, np.array(time))
        assert abs(now.x[0, 0] + 1j * now.y[0, 0] - there) < 1e-3
    np.testing.assert_array_equal(request.traffic.state.speed, report.state.speed)


@given(reports)
def test_monitor_expects_what_the_planner_plans_with(report: Intruder) -> None:
    planned = checked(OWN, [report], ROUTE, Options())[0].traffic
    expected = single.activate(single.begin(), STRAIGHT, OWN, {"4b1a2c": report}, 0.0).monitor.expected
    for mine, others in zip((*planned.state, *planned[1:]), (*expected.state, *expected[1:]), strict=True):
        np.testing.assert_allclose(mine, others, atol=1e-9)


@given(reports)
def test_validator_accepts_advanced_reports(report: Intruder) -> None:
    seen, age = reported([report, report])
    assert same_flight(seen, age, advanced(seen, age)).all()


@pytest.mark.parametrize("field", ["straight", "turn_time", "turn_rate", "speed"])
def test_validator_finds_wrongly_advanced_reports(field: str) -> None:
    seen, age = reported([TURNING, Intruder(OWN, 2.0)])
    right = advanced(seen, age)
    wrong = {
        "straight": right._replace(state=predicted(seen._replace(turn_time=0.0 * age), age)),
        "turn_time": right._replace(turn_time=seen.turn_time),
        "turn_rate": right._replace(turn_rate=0.999 * right.turn_rate),
        "speed": right._replace(state=right.state._replace(speed=right.state.speed + np.array([[1.0, 0.0]]))),
    }[field]
    assert same_flight(seen, age, wrong).tolist() == [[False, True]]


def test_traffic_that_does_not_follow_from_its_reports_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agents.planner.request.advanced", lambda seen, age: seen)
    with pytest.raises(RequestError) as refused:
        plan(OWN, [Intruder(OWN._replace(y=30_000.0)), TURNING], ROUTE, Policy.load())
    assert refused.value.field == "intruders[1]"
