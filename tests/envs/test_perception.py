"""Reports of the intruder: perfect ones change nothing, noise has its statistics and latency lets it grow."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.kinematics import Limits, VehicleState, advance
from envs.perception import Sensor, carried_back, perceive
from tests.strategies import angle_between, random_states, states

LIMITS = Limits(0.0, 150.0, -0.5, 0.5, math.radians(3.0))
SILENCE = np.zeros((4, 1))


def assert_same(found: VehicleState, expected: VehicleState) -> None:
    np.testing.assert_allclose(found.x, expected.x, atol=1e-6)
    np.testing.assert_allclose(found.y, expected.y, atol=1e-6)
    np.testing.assert_allclose(found.speed, expected.speed, atol=1e-6)
    assert np.max(angle_between(found.heading, expected.heading)) < 1e-6


@given(states(), states(), states())
def test_perfect_reports_are_the_truth(now: VehicleState, before: VehicleState, before_that: VehicleState) -> None:
    """Without noise and latency nothing but the present matters."""
    assert_same(perceive(now, before, before_that, Sensor(), SILENCE[:, 0], 1.0, np), now)


@given(states(), st.floats(0.0, 2.0))
def test_straight_flight_is_dead_reckoned_exactly(now: VehicleState, latency: float) -> None:
    before, before_that = carried_back(now, 1.0, np), carried_back(now, 2.0, np)
    assert_same(perceive(now, before, before_that, Sensor(latency=latency), SILENCE[:, 0], 1.0, np), now)


def test_carried_back_undoes_straight_flight() -> None:
    now = random_states(np.random.default_rng(0), 100)
    before = carried_back(now, 2.0, np)
    assert_same(advance(before, 0.0, 0.0, 2.0, LIMITS, np), now)


@pytest.mark.parametrize("latency", [1.0, 2.0])
def test_a_late_report_is_the_old_state_flown_straight_on(latency: float) -> None:
    """At whole steps of age: a turn since then goes unseen."""
    turn = math.radians(3.0)
    oldest = random_states(np.random.default_rng(1), 50)
    older = advance(oldest, 0.0, turn, 1.0, LIMITS, np)
    now = advance(older, 0.0, turn, 1.0, LIMITS, np)
    reported = {1.0: older, 2.0: oldest}[latency]
    found = perceive(now, older, oldest, Sensor(latency=latency), SILENCE, 1.0, np)
    assert_same(found, advance(reported, 0.0, 0.0, latency, LIMITS, np))
    assert np.min(angle_between(found.heading, now.heading)) > 0.9 * turn * latency


def errors(sensor: Sensor, count: int = 40_000) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors of position and velocity of reports on straight flight, ``[2, N]`` each."""
    generator = np.random.default_rng(2)
    now = random_states(generator, count)
    history = carried_back(now, 1.0, np), carried_back(now, 2.0, np)
    found = perceive(now, *history, sensor, generator.standard_normal((4, count)), 1.0, np)

    def velocities(state: VehicleState) -> np.ndarray:
        return np.stack([state.speed * np.cos(state.heading), state.speed * np.sin(state.heading)])

    return np.stack([found.x - now.x, found.y - now.y]), velocities(found) - velocities(now)


@pytest.mark.parametrize("latency", [0.0, 0.5, 1.0, 2.0])
@pytest.mark.parametrize(("position_std", "velocity_std"), [(30.0, 3.0), (0.0, 10.0), (30.0, 0.0)])
def test_noise_has_its_size_and_latency_lets_it_grow(position_std: float, velocity_std: float, latency: float) -> None:
    """Unbiased; in each axis the position is off by sqrt(sigma_p^2 + (sigma_v latency)^2). Bounds are 5 sigma."""
    position, velocity = errors(Sensor(position_std, velocity_std, latency))
    for found, expected in (
        (position, math.hypot(position_std, velocity_std * latency)),
        (velocity, velocity_std),
    ):
        root = math.sqrt(found.shape[1])
        np.testing.assert_allclose(found.mean(axis=1), 0.0, atol=5.0 * expected / root + 1e-6)
        np.testing.assert_allclose(found.std(axis=1), expected, rtol=5.0 / (root * math.sqrt(2.0)), atol=1e-4)


def test_the_four_draws_act_on_their_own_component() -> None:
    now = random_states(np.random.default_rng(3), 1)
    for component, (east, north) in enumerate([(30.0, 0.0), (0.0, 30.0), (4.5, 0.0), (0.0, 4.5)]):
        noise = np.zeros((4, 1))
        noise[component] = 1.0
        history = carried_back(now, 1.0, np), carried_back(now, 2.0, np)
        found = perceive(now, *history, Sensor(30.0, 3.0, 1.5), noise, 1.0, np)
        np.testing.assert_allclose([found.x[0] - now.x[0], found.y[0] - now.y[0]], [east, north], atol=1e-6)
