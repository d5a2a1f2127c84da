"""The follower keeps to the plan in position and time, and errors are kept apart as across, along and in time."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.follower import PERIOD, KinematicVehicle, guidance
from envs.kinematics import C208_PUBLISHED, SURROGATE, VehicleState, advance
from envs.tracking import deviation, offset
from envs.waypoints import Knots, Legs, at, legs
from tests.strategies import random_states


def flown_plans(count: int, seed: int, legs_each: int = 6) -> tuple[VehicleState, Legs]:
    """Return starts and plans of legs from flown histories, ``[count]``."""
    rng = np.random.default_rng(seed)
    state = random_states(rng, count)
    limits = SURROGATE._replace(speed_max=99.6, speed_min=50.4)
    states = [state]
    for second in range(20 * legs_each):
        if second % 8 == 0:
            acceleration, yaw_rate = rng.uniform(-0.3, 0.3, count), rng.uniform(-1.0, 1.0, count) * math.radians(2.0)
        state = advance(state, acceleration, yaw_rate, 1.0, limits, np)
        if second % 20 == 19:
            states.append(state)
    fields = [np.stack(field, axis=-1) for field in zip(*states, strict=True)]
    times = np.broadcast_to(20.0 * np.arange(legs_each + 1), fields[0].shape)
    return states[0], legs(Knots(*fields, times))


def fly(vehicle: KinematicVehicle, plan: Legs, until: float) -> np.ndarray:
    """Return the distance from where the plan is after each period, m, ``[T, count]``."""
    off = []
    for step in range(round(until / PERIOD)):
        vehicle.step(*guidance(plan, vehicle.state, step * PERIOD), PERIOD)
        off.append(np.hypot(*offset(vehicle.state, at(plan, (step + 1) * PERIOD))))
    return np.array(off)


def test_a_plan_within_the_limits_is_followed_to_a_centimetre() -> None:
    start, plan = flown_plans(100, 0)
    inside = (np.abs(plan.yaw_rate) <= C208_PUBLISHED.yaw_rate_max).all((1, 2)) & (
        (plan.acceleration <= 0.5) & (plan.acceleration >= -0.8)
    ).all((1, 2))
    off = fly(KinematicVehicle(start, C208_PUBLISHED), plan, 120.0)
    assert inside.sum() > 50
    assert off[:, inside].max() < 0.01


def test_an_error_of_the_start_is_brought_to_nothing() -> None:
    start, plan = flown_plans(50, 1)
    displaced = start._replace(x=start.x + 20.0, y=start.y - 15.0, speed=np.clip(start.speed + 2.0, 50.0, 98.0))
    wide = C208_PUBLISHED._replace(speed_max=120.0)
    off = fly(KinematicVehicle(displaced, wide), plan, 60.0)
    assert np.median(off[-1]) < 0.5
    assert off[-1].max() < 5.0


def test_commands_beyond_the_limits_are_cut_off() -> None:
    vehicle = KinematicVehicle(VehicleState(0.0, 0.0, 0.0, 80.0), SURROGATE)
    vehicle.step(9.0, 1.0, 1.0)
    assert vehicle.state.speed == pytest.approx(80.5)
    assert vehicle.state.heading == pytest.approx(math.radians(3.0))


@given(across=st.floats(-200.0, 200.0), late=st.floats(-5.0, 5.0), number=st.integers(0, 19))
def test_errors_are_kept_apart(across: float, late: float, number: int) -> None:
    _, plans = flown_plans(20, 2)
    plan = Legs(*(field[number] for field in plans))
    time = 60.0
    place = at(plan, time - late)
    sine, cosine = math.sin(place.heading), math.cos(place.heading)
    state = place._replace(x=place.x - across * sine, y=place.y + across * cosine)
    found = deviation(plan, state, time)
    # Far inside a turn the abeam point is found by three steps only to a part of what is left.
    assert float(found.cross_track) == pytest.approx(across, abs=0.5)
    assert float(found.time) == pytest.approx(late, abs=0.2)
    assert float(found.along_track) == pytest.approx(-late * 0.5 * (place.speed + at(plan, time).speed), abs=15.0)


def test_on_the_plan_there_is_no_error() -> None:
    _, plan = flown_plans(10, 3)
    found = deviation(plan, at(plan, 33.3), 33.3)
    for name in ("cross_track", "along_track", "time", "heading", "speed"):
        np.testing.assert_allclose(getattr(found, name), 0.0, atol=1e-9)
