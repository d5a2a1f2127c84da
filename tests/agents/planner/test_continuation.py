"""The route beyond the goal is clear by estimate where it is by a flight along it."""

import math

import numpy as np
import pytest

from agents.kernel.traffic import Traffic, predict
from agents.planner.request.options import Options, task_of
from agents.planner.request.request import Request
from agents.planner.search.continuation import CROWD, route_continuation
from envs.aircraft import PAPER
from envs.kinematics import VehicleState
from envs.trees import take

OPTIONS = Options.for_aircraft(PAPER)


@pytest.mark.parametrize(("intruders", "separation"), [(1, 3_000.0), (CROWD + 4, 400.0)])
def test_estimate_beyond_the_goal_is_that_of_a_flight_along_the_route(
    intruders: int, separation: float
) -> None:
    rng, speed, count = np.random.default_rng(3), 80.0, 100
    shape = count, intruders
    place_x, place_y = rng.uniform(
        [[[0.0]], [[-15_000.0]]], [[[40_000.0]], [[15_000.0]]], (2, *shape)
    )
    course, pace = rng.uniform(-math.pi, math.pi, shape), rng.uniform(50.0, 100.0, shape)
    rate, lasts = rng.uniform(-0.05, 0.05, shape), rng.uniform(0.0, 100.0, shape)
    traffic = Traffic.straight(VehicleState(place_x, place_y, course, pace))
    traffic = traffic._replace(turn_rate=rate, turn_time=lasts)
    x = np.tile(12_000.0 + 5_000.0 * np.arange(9), (count, 1))
    zero = np.zeros(count)
    own = VehicleState(zero, zero, zero, zero + speed)
    request = Request(own, traffic, x, 0.0 * x, np.full(count, 9))
    continuation, owner = (
        route_continuation(request, np.zeros(count, dtype=int), OPTIONS),
        np.arange(count),
    )
    required = np.full(shape, separation)
    is_clear = continuation.clear(own, (x[:, 0], zero), required, owner, zero, task_of(OPTIONS))

    # The goal is passed at 150 s, and the point at 32 km is the first after 380 s.
    times = np.arange(150.0, 400.01, 0.1)
    nearest = np.full(count, np.inf)
    for k in range(intruders):
        intruder = predict(take(traffic, (slice(None), slice(k, k + 1))), times)
        away = np.hypot(intruder.x - speed * times, intruder.y).min(axis=1)
        nearest = np.minimum(nearest, away)
    np.testing.assert_array_equal(is_clear, nearest >= separation)
    assert 0.05 < 1.0 - is_clear.mean() < 0.95
