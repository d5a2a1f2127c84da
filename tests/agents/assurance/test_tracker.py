"""The tracker: exact without noise, much closer to the truth with it, and not fooled by a turn for long."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.assurance.tracker import Tracks, begin, follow
from envs.angles import wrap
from envs.kinematics import SURROGATE, VehicleState, advance, velocity

POSITION, VELOCITY = 30.0, 3.0


def flight(seconds: int, turn: float = 0.0, rows: int = 400, speed: float = 75.0) -> list[VehicleState]:
    """Fly straight for a third of the time, then turn at a rate, rad/s."""
    rng = np.random.default_rng(1)
    states = [VehicleState(np.zeros(rows), np.zeros(rows), rng.uniform(-3.0, 3.0, rows), np.full(rows, speed))]
    limits = SURROGATE._replace(yaw_rate_max=1.0)
    for second in range(seconds):
        rate = turn if second >= seconds // 3 else 0.0
        states.append(advance(states[-1], np.zeros(rows), np.full(rows, rate), 1.0, limits, np))
    return states


def reported(state: VehicleState, rng: np.random.Generator) -> VehicleState:
    vx, vy = velocity(state, np)
    vx, vy = vx + VELOCITY * rng.normal(size=vx.shape), vy + VELOCITY * rng.normal(size=vy.shape)
    x, y = (each + POSITION * rng.normal(size=vx.shape) for each in (state.x, state.y))
    return VehicleState(x, y, np.arctan2(vy, vx), np.hypot(vx, vy))


def tracked(states: list[VehicleState]) -> tuple[list[VehicleState], list[VehicleState]]:
    """Return reports and tracks second by second."""
    rng = np.random.default_rng(7)
    reports = [reported(state, rng) for state in states]
    tracks, estimates = begin(reports[0]), [reports[0]]
    for report in reports[1:]:
        tracks = follow(tracks, report, POSITION, VELOCITY, 1.0)
        estimates.append(tracks.state)
    return reports, estimates


def errors(estimates: list[VehicleState], states: list[VehicleState]) -> tuple[np.ndarray, np.ndarray]:
    """Return the root mean squares of position and velocity by second."""
    found = []
    for one, true in zip(estimates, states, strict=True):
        (vx, vy), (wx, wy) = velocity(one, np), velocity(true, np)
        found.append((np.hypot(one.x - true.x, one.y - true.y), np.hypot(vx - wx, vy - wy)))
    position, speed = (np.sqrt(np.mean(np.square(each), axis=-1)) for each in zip(*found, strict=True))
    return position, speed


@given(st.lists(st.tuples(*[st.floats(-1e5, 1e5)] * 2, st.floats(-3.1, 3.1), st.floats(30.0, 200.0)), min_size=2))
def test_without_noise_the_track_is_the_report(reports: list[tuple[float, float, float, float]]) -> None:
    tracks = begin(VehicleState(*(np.array([value]) for value in reports[0])))
    for report in reports[1:]:
        seen = VehicleState(*(np.array([value]) for value in report))
        tracks = follow(tracks, seen, 0.0, 0.0, 1.0)
        for one, other in zip(tracks.state[:2], seen[:2], strict=True):
            np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-9)
        assert abs(float(wrap(tracks.state.heading - seen.heading, np)[0])) < 1e-12
        assert tracks.state.speed == pytest.approx(seen.speed, abs=1e-12)


def test_a_straight_flight_is_known_far_better_than_its_reports() -> None:
    states = flight(40)
    reports, estimates = tracked(states)
    position, speed = errors(estimates, states)
    raw_position, raw_speed = errors(reports, states)
    assert position[20:].mean() < 0.5 * raw_position[20:].mean()
    # Independent errors of which a share b is taken over leave sqrt(b / (2 - b)) of them.
    assert speed[20:].mean() < 1.15 * math.sqrt(0.15 / 1.85) * raw_speed[20:].mean()
    assert (speed[1:] < raw_speed[1:]).all()


@pytest.mark.parametrize("rate", [0.5, 1.0, 3.0, 6.0])
def test_a_turn_misleads_for_seconds_at_most(rate: float) -> None:
    states = flight(60, math.radians(rate))
    _, estimates = tracked(states)
    position, speed = errors(estimates, states)
    # Never far from what one report alone would give.
    assert position.max() < 1.6 * math.sqrt(2.0) * POSITION
    assert speed.max() < 2.6 * math.sqrt(2.0) * VELOCITY


def test_few_straight_flights_are_taken_for_manoeuvres() -> None:
    rng = np.random.default_rng(3)
    states = flight(100, rows=1_000)
    tracks, begun = begin(reported(states[0], rng)), 0
    for state in states[1:]:
        tracks = follow(tracks, reported(state, rng), POSITION, VELOCITY, 1.0)
        begun += int((tracks.count == 1.0).sum())
    assert begun < 0.005 * 100_000


def test_rows_do_not_know_of_each_other() -> None:
    states = flight(12, rows=5)
    rng = np.random.default_rng(2)
    reports = [reported(state, rng) for state in states]

    def run(chosen: slice) -> Tracks:
        parts = [VehicleState(*(field[chosen] for field in report)) for report in reports]
        tracks = begin(parts[0])
        for report in parts[1:]:
            tracks = follow(tracks, report, POSITION, VELOCITY, 1.0)
        return tracks

    together, alone = run(slice(None)), run(slice(3, 4))
    for one, other in zip((*together.state, *together[1:]), (*alone.state, *alone[1:]), strict=True):
        np.testing.assert_array_equal(one[3:4], other)
