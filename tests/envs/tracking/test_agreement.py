"""Positions beside the integral of velocities: what agrees, what does not, and random errors."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.kinematics import VehicleState, velocity
from envs.tracking.agreement import Agreement, begin, bias, extend, worse
from tests.envs.tracking.flights import States, fly, reported

EXACT = np.float64(0.0), np.float64(0.0)
rates = st.lists(st.floats(-math.radians(6.0), math.radians(6.0)), min_size=1, max_size=40)


def compare(
    reports: States,
    declared: tuple[float, float] = (0.0, 0.0),
    dt: float = 1.0,
    lack: complex = 0.0,
) -> list[Agreement]:
    """Return the agreement after each report; the velocities lack something of the true ones, m/s."""
    errors_declared = tuple(map(np.float64, declared))
    history: list[Agreement] = []
    for number, state in enumerate(reports):
        vx, vy = velocity(state, np)
        vx, vy = vx - lack.real, vy - lack.imag
        if not history:
            history.append(begin((vx, vy), errors_declared, np))
            continue
        before = reports[number - 1]
        moved = state.x - before.x, state.y - before.y
        history.append(extend(history[-1], moved, (vx, vy), errors_declared, np.float64(dt), np))
    return history


def noisy(states: States, position_std: float, velocity_std: float) -> States:
    rng = np.random.default_rng(3)
    return [reported(state, rng, position_std, velocity_std) for state in states]


@given(rates, st.floats(0.2, 3.0))
def test_exact_reports_agree_whatever_is_flown(turns: list[float], dt: float) -> None:
    for agreement in compare(fly(turns, rows=3, dt=dt), dt=dt):
        assert not agreement.biased.any()
        for std in (agreement.position_std, agreement.velocity_std):
            np.testing.assert_array_equal(std, 0.0)


@given(
    st.floats(0.0, 100.0),
    st.floats(0.0, 10.0),
    st.floats(0.0, 100.0),
    st.floats(0.0, 10.0),
    st.integers(0, 5),
)
def test_errors_are_never_less_than_declared(
    position_std: float, velocity_std: float, far: float, fast: float, seed: int
) -> None:
    states = noisy(fly([0.0] * 10 + [0.05] * 10, rows=20, seed=seed), position_std, velocity_std)
    for agreement in compare(states, (far, fast)):
        assert (agreement.position_std >= far).all() and (agreement.velocity_std >= fast).all()


@pytest.mark.parametrize("noise", [(0.0, 0.0), (10.0, 1.0), (30.0, 3.0)])
def test_what_velocities_lack_is_found_with_its_error(noise: tuple[float, float]) -> None:
    lack = 12.0 - 16.0j
    states = noisy(fly([0.0] * 40, rows=1_000), *noise)
    agreement = compare(states, noise, lack=lack)[-1]
    x, y, variance = bias(agreement, np)
    assert agreement.biased.mean() > 0.99
    off = np.hypot(x - lack.real, y - lack.imag)[agreement.biased]
    variance = variance[agreement.biased]
    # 99 % of plane normal deviates are within 3.03 sigmas.
    assert np.mean(off <= 3.03 * np.sqrt(variance)) > 0.98
    assert np.sqrt(np.mean(off**2)) < 3.0


@pytest.mark.parametrize("noise", [(10.0, 1.0), (30.0, 3.0), (100.0, 4.0)])
@pytest.mark.parametrize("rate", [0.0, math.radians(3.0)])
def test_noise_is_rarely_taken_for_a_lack(noise: tuple[float, float], rate: float) -> None:
    states = noisy(fly([0.0] * 20 + [rate] * 40, rows=1_000), *noise)
    biased = np.mean([agreement.biased for agreement in compare(states, noise)])
    assert biased < 2e-3


def test_a_lack_that_ends_is_forgotten() -> None:
    states = noisy(fly([0.0] * 90, rows=500), 10.0, 1.0)
    wrong = [
        state if number > 30 else state._replace(speed=1.944 * state.speed)
        for number, state in enumerate(states)
    ]
    history = compare(wrong, (10.0, 1.0))
    assert history[30].biased.all()
    assert history[90].biased.mean() < 0.01
    assert history[50].biased.mean() < 0.05


@pytest.mark.parametrize("noise", [(30.0, 3.0), (10.0, 1.0), (5.0, 3.0), (30.0, 0.5)])
def test_errors_that_nobody_declares_are_shown(noise: tuple[float, float]) -> None:
    states = noisy(fly([0.0] * 40, rows=2_000), *noise)
    agreement = compare(states)[-1]
    near, fast = agreement.position_std, agreement.velocity_std
    assert np.mean(near) == pytest.approx(max(noise[0], 0.29 * noise[1]), rel=0.15)
    assert np.mean(fast) == pytest.approx(noise[1], rel=0.15)


def test_true_declarations_are_rarely_enlarged() -> None:
    for noise in ((30.0, 3.0), (10.0, 1.0)):
        states = noisy(fly([0.0] * 20 + [0.05] * 30, rows=1_000), *noise)
        for agreement in compare(states, noise)[10:]:
            assert np.mean(agreement.position_std > noise[0]) < 0.02


def test_it_is_worse_once_where_an_error_shows() -> None:
    for states, lack in ((noisy(fly([0.0] * 40), 30.0, 3.0), 0.0), (fly([0.0] * 40), 30.0)):
        history = compare(states, lack=complex(lack))
        worsened = [bool(worse(before, after, EXACT, np)[0]) for before, after in pairwise(history)]
        assert 1 <= sum(worsened) <= 3
        assert not any(worsened[20:])


@pytest.mark.parametrize("declared", [(5.0, 0.5), (60.0, 6.0)])
def test_a_report_that_declares_more_makes_those_before_no_worse(
    declared: tuple[float, float],
) -> None:
    states = noisy(fly([0.0] * 40, rows=100), *declared)
    before = compare(states[:-1], declared)[-1]
    vx, vy = velocity(states[-1], np)
    moved = states[-1].x - states[-2].x, states[-1].y - states[-2].y
    more = np.float64(3.0 * declared[0]), np.float64(3.0 * declared[1])
    after = extend(before, moved, (vx, vy), more, np.float64(1.0), np)
    np.testing.assert_array_equal(after.position_std, more[0])
    np.testing.assert_array_equal(after.velocity_std, more[1])
    assert not worse(before, after, more, np).any()


def test_a_report_that_stands_still_lacks_the_way() -> None:
    states = fly([0.0] * 20, rows=4)
    standing = [state._replace(x=states[0].x, y=states[0].y) for state in states]
    agreement = compare(standing)[-1]
    x, y, _ = bias(agreement, np)
    vx, vy = velocity(VehicleState(*states[-1]), np)
    np.testing.assert_allclose(np.hypot(x + vx, y + vy), 0.0, atol=0.1)
