"""The filter is a Kalman filter: beside one of matrices, and by the field's tests of consistency
(Bar-Shalom, Li and Kirubarajan 2001, section 5.4).
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from envs.backend import FLOATS
from envs.kinematics import VehicleState, advance, velocity
from envs.tracking.estimate import (
    Covariance,
    Estimate,
    Measurement,
    correct,
    mix,
    predict,
    white_acceleration,
    white_jerk,
)
from tests.envs.tracking.flights import AGILE
from tests.support import angle_between

NOTHING = Covariance(*[0.0] * 6)
RUNS = 50  # as in the book
rates = st.floats(-0.3, 0.3)


def matrix(c: Covariance) -> np.ndarray:
    """Return covariances as matrices ``[..., 3, 3]``."""
    rows = np.stack(np.broadcast_arrays(c.pp, c.pv, c.pa, c.pv, c.vv, c.va, c.pa, c.va, c.aa), -1)
    return rows.reshape(*rows.shape[:-1], 3, 3)


@st.composite
def estimates(draw: st.DrawFn) -> Estimate:
    root = np.array(draw(st.lists(st.floats(-5.0, 5.0), min_size=9, max_size=9))).reshape(3, 3)
    p, v, a = root @ root.T + 0.1 * np.eye(3)
    mean = draw(st.tuples(*[st.floats(-100.0, 100.0)] * 6))
    return Estimate(*mean, Covariance(p[0], p[1], p[2], v[1], v[2], a[2]))


@given(
    st.floats(-math.pi, math.pi, exclude_max=True),
    st.floats(1.0, 300.0),
    rates | st.floats(-1e-4, 1e-4),
    st.floats(0.01, 3.0),
)
def test_a_turn_is_that_of_the_world(heading: float, speed: float, rate: float, dt: float) -> None:
    start = VehicleState(*(np.float64(value) for value in (3.0, -4.0, heading, speed)))
    vx, vy = velocity(start, np)
    turning = Estimate(start.x, start.y, vx, vy, -rate * vy, rate * vx, NOTHING)
    limits = AGILE._replace(speed_min=0.0, speed_max=400.0)
    flown = advance(start, np.float64(0.0), np.float64(rate), np.float64(dt), limits, np)
    predicted = predict(turning, np.float64(rate), NOTHING, np.float64(dt), np)
    assert math.hypot(predicted.x - flown.x, predicted.y - flown.y) < 1e-6 * (1.0 + speed * dt)
    assert math.hypot(predicted.vx, predicted.vy) == pytest.approx(speed, rel=1e-9)
    assert angle_between(math.atan2(predicted.vy, predicted.vx), flown.heading) < 1e-6


@given(estimates(), rates, st.floats(0.1, 10.0), st.floats(0.1, 10.0))
def test_two_steps_are_one(estimate: Estimate, rate: float, first: float, second: float) -> None:
    once = predict(estimate, rate, NOTHING, first + second, FLOATS)
    twice = predict(predict(estimate, rate, NOTHING, first, FLOATS), rate, NOTHING, second, FLOATS)
    np.testing.assert_allclose(twice[:6], once[:6], rtol=1e-7, atol=1e-6)
    np.testing.assert_allclose(twice.covariance, once.covariance, rtol=1e-7, atol=1e-4)


@given(st.floats(0.1, 10.0), st.floats(0.1, 10.0))
def test_noise_of_two_steps_is_that_of_one(first: float, second: float) -> None:
    for noise in (white_acceleration, white_jerk):
        estimate = Estimate(*[0.0] * 6, noise(0.3, first))
        twice = predict(estimate, 0.0, noise(0.3, second), second, FLOATS)
        np.testing.assert_allclose(twice.covariance, noise(0.3, first + second), rtol=1e-9)


@given(
    estimates(),
    st.tuples(*[st.floats(-200.0, 200.0)] * 4),
    st.floats(0.1, 1e3),
    st.floats(0.1, 1e2),
)
def test_a_report_is_taken_in_as_by_matrices(
    estimate: Estimate, report: tuple[float, float, float, float], position: float, speed: float
) -> None:
    corrected, unlike, off = correct(estimate, Measurement(*report, position, speed), FLOATS)
    before, selects = matrix(estimate.covariance), np.eye(3)[:2]
    total = selects @ before @ selects.T + np.diag([position, speed])
    gain = before @ selects.T @ np.linalg.inv(total)
    after = (np.eye(3) - gain @ selects) @ before
    np.testing.assert_allclose(matrix(corrected.covariance), after, rtol=1e-6, atol=1e-6)
    squared = 0.0
    for axis in range(2):
        mean = np.array(estimate[axis:6:2])
        innovation = np.array(report[axis::2]) - mean[:2]
        np.testing.assert_allclose(
            corrected[axis:6:2], mean + gain @ innovation, rtol=1e-6, atol=1e-6
        )
        squared += innovation @ np.linalg.solve(total, innovation)
    assert off == pytest.approx(squared, rel=1e-6)
    assert unlike == pytest.approx(squared + 2.0 * math.log(np.linalg.det(total)), rel=1e-6)


@given(estimates(), estimates(), st.floats(0.0, 1.0))
def test_a_mixture_has_the_moments_of_its_parts(
    first: Estimate, second: Estimate, share: float
) -> None:
    mixture = mix(first, second, share)
    shares, parts = (1.0 - share, share), (first, second)
    scatter = np.zeros((3, 3))
    for axis in range(2):
        mean = sum(
            part * np.array(component[axis:6:2])
            for part, component in zip(shares, parts, strict=True)
        )
        np.testing.assert_allclose(mixture[axis:6:2], mean, rtol=1e-9, atol=1e-9)
        for part, estimate in zip(shares, parts, strict=True):
            apart = np.array(estimate[axis:6:2]) - mean
            scatter += part * (matrix(estimate.covariance) + np.outer(apart, apart))
    # Both axes together have what they have in truth.
    np.testing.assert_allclose(2.0 * matrix(mixture.covariance), scatter, rtol=1e-9, atol=1e-6)


def consistency(
    rate: float, noise: Covariance, dt: float, report: tuple[float, float], states: int, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean NEES and NIS of runs of flights that the filter's own noise moves, by
    step.

    Args:
        rate: of the turn, rad/s.
        noise: of a step.
        dt: length of a step, s.
        report: one sigma per axis of positions and velocities, m and m/s.
        states: 2 for flights without acceleration, 3.
        steps: of a run.
    """
    rng = np.random.default_rng(11)
    root = np.zeros((3, 3))
    root[:states, :states] = np.linalg.cholesky(matrix(noise)[:states, :states])
    prior = np.diag([report[0], report[1], 3.0 if states == 3 else 0.0])
    spread = np.diag(prior) ** 2
    zero = np.zeros(RUNS)
    initial = Covariance(*(zero + value for value in (spread[0], 0, 0, spread[1], 0, spread[2])))
    true = np.zeros((2, 3, RUNS)) + np.array([[0.0, 80.0, 0.0], [0.0, 0.0, 0.0]])[..., None]
    mean = true + np.einsum("ij,ajn->ain", prior, rng.normal(size=true.shape))
    estimate = Estimate(*mean.transpose(1, 0, 2).reshape(6, RUNS), initial)
    nees, nis = [], []
    for _ in range(steps):
        flown = predict(
            Estimate(*true.transpose(1, 0, 2).reshape(6, RUNS), initial), rate, NOTHING, dt, np
        )
        true = np.stack(flown[:6]).reshape(3, 2, RUNS).transpose(1, 0, 2)
        true = true + np.einsum("ij,ajn->ain", root, rng.normal(size=true.shape))
        reports = true[:, :2] + np.array(report)[:, None] * rng.normal(size=(2, 2, RUNS))
        measured = Measurement(*reports.transpose(1, 0, 2).reshape(4, RUNS), *np.square(report))
        estimate, _, off = correct(predict(estimate, rate, noise, dt, np), measured, np)
        nis.append(np.mean(off))
        inverse = np.linalg.inv(matrix(estimate.covariance)[:, :states, :states])
        error = np.stack(estimate[:6]).reshape(3, 2, RUNS).transpose(1, 0, 2) - true
        error = error[:, :states]
        nees.append(np.mean(np.einsum("ain,nij,ajn->n", error, inverse, error)))
    return np.array(nees), np.array(nis)


@pytest.mark.parametrize("report", [(30.0, 3.0), (10.0, 1.0), (5.0, 0.5)])
@pytest.mark.parametrize("dt", [1.0, 5.0])
@pytest.mark.parametrize("turns", [False, True])
def test_nees_and_nis_are_within_their_intervals(
    report: tuple[float, float], dt: float, turns: bool
) -> None:
    noise = white_jerk(0.3, dt) if turns else white_acceleration(0.05, dt)
    states, steps = (3 if turns else 2), 200
    nees, nis = consistency(0.05 if turns else 0.0, noise, dt, report, states, steps)
    for mean, freedom in ((nees, 2 * states), (nis, 4)):
        low, high = chi2.ppf([0.025, 0.975], RUNS * freedom) / RUNS
        inside = np.mean((low <= mean) & (mean <= high))
        # 95 % are expected; errors of successive steps are alike.
        assert inside > 0.88, f"{inside:.3f} of {freedom}"
        assert mean.mean() == pytest.approx(freedom, rel=0.08)
