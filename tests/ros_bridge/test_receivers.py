"""Receivers: what arrives is what was true, at its rate, no sooner than its latency, and with the noise asked for."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.kinematics import VehicleState
from ros_bridge.sim.receivers import Quality, Receiver

STEP = 0.1


def heard(quality: Quality, seconds: float, seed: int = 0, names: tuple[str, ...] = ("a",)):
    """Return (time of arrival, report) of aircraft that fly east at 70 m/s."""
    receiver, result = Receiver(quality, seed), []
    for number in range(round(seconds / STEP)):
        time = round(number * STEP, 6)
        truth = {name: VehicleState(70.0 * time, 0.0, 0.0, 70.0) for name in names}
        result += [(time, one) for one in receiver.receive(time, truth)]
    return result


@given(rate=st.sampled_from([0.5, 1.0, 2.0, 5.0, 10.0]), latency=st.floats(0.0, 3.0), seed=st.integers(0, 1000))
def test_reports_come_once_in_order_at_rate_and_latency(rate, latency, seed):
    reports = heard(Quality(rate, latency), 20.0, seed)
    times = [one.time for _, one in reports]
    assert times == sorted(set(times))
    # The period is met on average, each report within the step of the world.
    assert len(times) == pytest.approx((20.0 - latency) * rate, abs=2.0)
    for arrival, one in reports:
        assert latency - 1e-6 <= arrival - one.time < latency + STEP
        assert one.state == VehicleState(70.0 * one.time, 0.0, 0.0, 70.0)


def test_aircraft_report_at_the_start_and_then_at_moments_of_their_own():
    names = tuple(f"n{number}" for number in range(20))
    reports = heard(Quality(rate=1.0), 3.0, names=names)
    assert {one.identifier for time, one in reports if time == 0.0} == set(names)
    assert len({time for time, _ in reports if time > 0.0}) > 8


def test_losses_and_noise_are_as_configured():
    quality = Quality(10.0, dropout=0.3, position_std=20.0, velocity_std=2.0)
    reports = heard(quality, 400.0)
    assert len(reports) == pytest.approx(2800, abs=5.0 * math.sqrt(4000 * 0.3 * 0.7))
    x = np.array([one.state.x - 70.0 * one.time for _, one in reports])
    north = np.array([one.state.speed * math.sin(one.state.heading) for _, one in reports])
    east = np.array([one.state.speed * math.cos(one.state.heading) - 70.0 for _, one in reports])
    for values, spread in ((x, 20.0), (north, 2.0), (east, 2.0)):
        assert float(values.std()) == pytest.approx(spread, rel=0.08)
        assert abs(float(values.mean())) < 5.0 * spread / math.sqrt(len(values))


def test_losses_can_be_total_and_a_seed_repeats_itself():
    assert heard(Quality(dropout=1.0), 5.0) == []
    noisy = Quality(1.0, 0.2, 0.2, 30.0, 3.0)
    assert heard(noisy, 20.0, seed=3) == heard(noisy, 20.0, seed=3) != heard(noisy, 20.0, seed=4)
