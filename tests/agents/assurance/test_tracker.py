"""Reports with noise and age: the tracker comes closer to the truth, and all advance a report along
the same arc.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.assurance import single
from agents.assurance.tracker import Tracks, begin, follow
from agents.kernel.traffic import (
    Requirement,
    advance_reports,
    growth,
    predict,
    requirement_of,
    same_flight,
    uncertainty,
    whole,
)
from agents.planner import Intruder, Options, RequestError, plan
from agents.planner.request.reports import arrays_of_reports
from agents.planner.request.request import check_request
from agents.policy.inference import Policy
from envs.aircraft import PAPER
from envs.angles import wrap
from envs.kinematics import SURROGATE, VehicleState, advance, velocity
from envs.trees import map_leaves
from envs.waypoints import RoutePoint, at, legs, plan_states
from tests.agents.scenes import PATIENT, THRESHOLDS

POSITION, VELOCITY = 30.0, 3.0


def flight(
    seconds: int, turn: float = 0.0, rows: int = 400, speed: float = 75.0
) -> list[VehicleState]:
    """Fly straight for a third of the time, then turn at a rate, rad/s."""
    rng = np.random.default_rng(1)
    states = [
        VehicleState(
            np.zeros(rows), np.zeros(rows), rng.uniform(-3.0, 3.0, rows), np.full(rows, speed)
        )
    ]
    limits = SURROGATE._replace(yaw_rate_max=1.0)
    for second in range(seconds):
        rate = turn if second >= seconds // 3 else 0.0
        states.append(advance(states[-1], np.zeros(rows), np.full(rows, rate), 1.0, limits, np))
    return states


def noisy(state: VehicleState, rng: np.random.Generator) -> VehicleState:
    vx, vy = velocity(state, np)
    vx, vy = vx + VELOCITY * rng.normal(size=vx.shape), vy + VELOCITY * rng.normal(size=vy.shape)
    x, y = (each + POSITION * rng.normal(size=vx.shape) for each in (state.x, state.y))
    return VehicleState(x, y, np.arctan2(vy, vx), np.hypot(vx, vy))


def track_reports(states: list[VehicleState]) -> tuple[list[VehicleState], list[VehicleState]]:
    """Return reports and tracks second by second."""
    rng = np.random.default_rng(7)
    reports = [noisy(state, rng) for state in states]
    tracks, estimates = begin(reports[0], POSITION, VELOCITY), [reports[0]]
    for report in reports[1:]:
        tracks = follow(tracks, report, POSITION, VELOCITY, 1.0)
        estimates.append(tracks.state)
    return reports, estimates


def errors(
    estimates: list[VehicleState], states: list[VehicleState]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the root mean squares of position and velocity by second."""
    found = []
    for one, true in zip(estimates, states, strict=True):
        (vx, vy), (wx, wy) = velocity(one, np), velocity(true, np)
        found.append((np.hypot(one.x - true.x, one.y - true.y), np.hypot(vx - wx, vy - wy)))
    position, speed = (
        np.sqrt(np.mean(np.square(each), axis=-1)) for each in zip(*found, strict=True)
    )
    return position, speed


@given(
    st.lists(
        st.tuples(*[st.floats(-1e5, 1e5)] * 2, st.floats(-3.1, 3.1), st.floats(30.0, 200.0)),
        min_size=2,
    )
)
def test_without_noise_the_track_is_the_report(
    reports: list[tuple[float, float, float, float]],
) -> None:
    tracks = begin(VehicleState(*(np.array([value]) for value in reports[0])), 0.0, 0.0)
    for report in reports[1:]:
        seen = VehicleState(*(np.array([value]) for value in report))
        tracks = follow(tracks, seen, 0.0, 0.0, 1.0)
        for one, other in zip(tracks.state[:2], seen[:2], strict=True):
            np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-9)
        assert abs(float(wrap(tracks.state.heading - seen.heading, np)[0])) < 1e-12
        assert tracks.state.speed == pytest.approx(seen.speed, abs=1e-12)


def test_errors_of_straight_flights_are_as_large_as_said() -> None:
    rng = np.random.default_rng(5)
    states = flight(60, rows=4_000)
    tracks = begin(noisy(states[0], rng), POSITION, VELOCITY)
    # Reports come at no fixed rate. A tenth is for the odd report that a track begins anew with.
    for second, state in enumerate(states[1:], 1):
        if second % 3 == 1:
            continue
        tracks = follow(
            tracks, noisy(state, rng), POSITION, VELOCITY, 2.0 if second % 3 == 2 else 1.0
        )
        if second in (2, 3, 6, 15, 30, 60):
            for axis, true in enumerate((state.x, state.y)):
                off = np.std(tracks.state[axis] - true)
                assert off == pytest.approx(math.sqrt(np.mean(tracks.position_variance)), rel=0.1)
            (vx, _), (wx, _) = velocity(tracks.state, np), velocity(state, np)
            assert np.std(vx - wx) == pytest.approx(
                math.sqrt(np.mean(tracks.velocity_variance)), rel=0.1
            )


def test_a_straight_flight_is_known_far_better_than_its_reports() -> None:
    states = flight(40)
    reports, estimates = track_reports(states)
    position, speed = errors(estimates, states)
    raw_position, raw_speed = errors(reports, states)
    assert position[20:].mean() < 0.5 * raw_position[20:].mean()
    # Independent errors of which a share b is taken over leave sqrt(b / (2 - b)) of them.
    assert speed[20:].mean() < 1.15 * math.sqrt(0.15 / 1.85) * raw_speed[20:].mean()
    assert (speed[1:] < raw_speed[1:]).all()


@pytest.mark.parametrize("rate", [0.5, 1.0, 3.0, 6.0])
def test_a_turn_misleads_for_seconds_at_most(rate: float) -> None:
    states = flight(60, math.radians(rate))
    _, estimates = track_reports(states)
    position, speed = errors(estimates, states)
    # Never far from what one report alone would give.
    assert position.max() < 1.6 * math.sqrt(2.0) * POSITION
    assert speed.max() < 2.6 * math.sqrt(2.0) * VELOCITY


def test_few_straight_flights_are_taken_for_manoeuvres() -> None:
    rng = np.random.default_rng(3)
    states = flight(100, rows=1_000)
    tracks, begun = begin(noisy(states[0], rng), POSITION, VELOCITY), 0
    for state in states[1:]:
        tracks = follow(tracks, noisy(state, rng), POSITION, VELOCITY, 1.0)
        begun += int((tracks.count == 1.0).sum())
    assert begun < 0.005 * 100_000


def test_rows_do_not_know_of_each_other() -> None:
    states = flight(12, rows=5)
    rng = np.random.default_rng(2)
    reports = [noisy(state, rng) for state in states]

    def run(chosen: slice) -> Tracks:
        parts = [VehicleState(*(field[chosen] for field in report)) for report in reports]
        tracks = begin(parts[0], POSITION, VELOCITY)
        for report in parts[1:]:
            tracks = follow(tracks, report, POSITION, VELOCITY, 1.0)
        return tracks

    together, alone = run(slice(None)), run(slice(3, 4))
    for one, other in zip(
        (*together.state, *together[1:]), (*alone.state, *alone[1:]), strict=True
    ):
        np.testing.assert_array_equal(one[3:4], other)


# Aged reports of turning intruders: planner, monitor and validator advance them along the same arc.

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
        there = place_at(report, np.array(time))
        assert abs(now.x[0, 0] + 1j * now.y[0, 0] - there) < 1e-3
    np.testing.assert_array_equal(request.traffic.state.speed, report.state.speed)


@given(reports)
def test_monitor_expects_what_the_planner_plans_with(report: Intruder) -> None:
    planned = check_request(OWN, [report], ROUTE, Options.for_aircraft(PAPER))[0].traffic
    expected = single.activate(
        single.begin(THRESHOLDS), STRAIGHT, OWN, {"4b1a2c": report}, 0.0
    ).monitor.expected
    for mine, others in zip(
        (*planned.state, *whole(planned)[1:]), (*expected.state, *expected[1:]), strict=True
    ):
        np.testing.assert_allclose(mine, others, atol=1e-9)


@given(reports)
def test_validator_accepts_advanced_reports(report: Intruder) -> None:
    seen, age = arrays_of_reports([report, report])
    assert same_flight(seen, age, advance_reports(seen, age)).all()


@pytest.mark.parametrize("field", ["straight", "turn_time", "turn_rate", "speed"])
def test_validator_finds_wrongly_advanced_reports(field: str) -> None:
    seen, age = arrays_of_reports([TURNING, Intruder(OWN, 2.0)])
    right = advance_reports(seen, age)
    wrong = {
        "straight": right._replace(state=predict(seen._replace(turn_time=0.0 * age), age)),
        "turn_time": right._replace(turn_time=seen.turn_time),
        "turn_rate": right._replace(turn_rate=0.999 * right.turn_rate),
        "speed": right._replace(
            state=right.state._replace(speed=right.state.speed + np.array([[1.0, 0.0]]))
        ),
    }[field]
    assert same_flight(seen, age, wrong).tolist() == [[False, True]]


def test_traffic_that_does_not_follow_from_its_reports_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("agents.planner.request.request.advance_reports", lambda seen, age: seen)
    with pytest.raises(RequestError) as refused:
        plan(OWN, [Intruder(OWN._replace(y=30_000.0)), TURNING], ROUTE, Policy.load(), PATIENT)
    assert refused.value.field == "intruders[1]"


@given(reports, st.floats(0.0, 400.0))
def test_one_velocity_error_counts_from_the_report_on(report: Intruder, time: float) -> None:
    vague = replace(report, position_std=40.0, velocity_std=3.0)
    now = advance_reports(*arrays_of_reports([vague]))
    whole = math.hypot(40.0, 3.0 * (abs(report.age) + time))
    assert uncertainty(now, time).item() == pytest.approx(whole)
    asked = Requirement(1_000.0, 0.0, 2.0)
    need = requirement_of(now, VehicleState(*np.full((4, 1), 1e7)), asked) + growth(
        now, np.float64(time), asked.sigmas
    )
    assert need.item() == pytest.approx(1_000.0 + 2.0 * whole)


def test_the_monitor_hands_reports_on_with_their_age() -> None:
    vague = Intruder(
        VehicleState(3_000.0, 0.0, math.pi, 60.0), 2.0, position_std=40.0, velocity_std=3.0
    )
    watch = single.activate(single.begin(THRESHOLDS), STRAIGHT, OWN, {"4b1a2c": vague}, 0.0)
    _, verdict = single.step(watch, 0.0, OWN, {"4b1a2c": vague})
    assert verdict.ask is not None
    assert verdict.ask.intruders == (vague,)
