"""Published waypoints are flown by the true aircraft to metres and tenths of a second."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs import follower
from envs.c208.conditions import Conditions
from envs.c208.guidance import Guide, Path, follow
from envs.c208.vehicle import C208Vehicle
from envs.follower import PERIOD
from envs.kinematics import SURROGATE, VehicleState, advance
from envs.tracking import deviation
from envs.waypoints import Knots, Legs, at, legs


def history(seed: int, count: int = 5) -> tuple[VehicleState, Legs]:
    """Return a start and legs of 20 s through a random flight of the surrogate, held 10 s a command."""
    rng = np.random.default_rng(seed)
    state = VehicleState(0.0, 0.0, rng.uniform(-3.0, 3.0), rng.uniform(62.0, 85.0))
    limits = SURROGATE._replace(speed_min=58.0, speed_max=92.0)
    states = [state]
    for second in range(20 * count):
        if second % 10 == 0:
            acceleration, yaw_rate = rng.uniform(-0.4, 0.4), rng.uniform(-1.0, 1.0) * math.radians(2.5)
        state = advance(state, acceleration, yaw_rate, 1.0, limits, np)
        if second % 20 == 19:
            states.append(state)
    fields = (np.array(field, dtype=float) for field in zip(*states, strict=True))
    return states[0], legs(Knots(*fields, 20.0 * np.arange(count + 1)))


PLANS = [history(seed) for seed in range(3)]
PATHS = [Path(plan) for _, plan in PLANS]


@given(st.floats(-5.0, 130.0), st.integers(0, 2))
def test_a_path_is_the_legs(time: float, number: int) -> None:
    expected, found = at(PLANS[number][1], time), PATHS[number].at(time)
    np.testing.assert_allclose(found[:2], [float(expected.x), float(expected.y)], atol=1e-3)
    assert math.cos(found.heading - float(expected.heading)) == pytest.approx(1.0, abs=1e-9)
    assert found.speed == pytest.approx(float(expected.speed), abs=1e-9)


def errors(plan: Legs, states: list[VehicleState]) -> tuple[np.ndarray, np.ndarray]:
    clock = PERIOD * np.arange(1, len(states) + 1)
    flight = VehicleState(*(np.array(field) for field in zip(*states, strict=True)))
    found = deviation(Legs(*(np.broadcast_to(field, (clock.size, *field.shape)) for field in plan)), flight, clock)
    return np.abs(found.cross_track), np.abs(found.time)


@pytest.mark.parametrize("number", range(3))
def test_plans_are_flown_in_calm_air(number: int) -> None:
    start, plan = PLANS[number]
    cross, late = errors(plan, follow(C208Vehicle(start), PATHS[number], 100.0)[0])
    assert np.percentile(cross, 95) < 5.0
    assert cross.max() < 10.0
    assert late.max() < 0.1


def test_plans_are_flown_in_wind_and_turbulence() -> None:
    start, plan = PLANS[0]
    rough = Conditions(wind_east=6.0, wind_north=-8.0, turbulence="moderate", seed=2)
    cross, _ = errors(plan, follow(C208Vehicle(start, conditions=rough), PATHS[0], 100.0)[0])
    assert np.percentile(cross, 95) < 10.0


def test_the_generic_follower_flies_it_too() -> None:
    start, plan = PLANS[1]
    vehicle, states = C208Vehicle(start), []
    for number in range(600):
        vehicle.step(*follower.guidance(plan, vehicle.state, number * PERIOD), PERIOD)
        states.append(vehicle.state)
    cross, late = errors(plan, states)
    assert np.percentile(cross, 95) < 5.0
    assert late.max() < 0.1


@given(st.floats(-80.0, 80.0), st.floats(-0.3, 0.3))
def test_errors_are_steered_against(left: float, heading: float) -> None:
    path = PATHS[2]
    place = path.at(50.0)
    aside = place._replace(
        x=place.x - left * math.sin(place.heading),
        y=place.y + left * math.cos(place.heading),
        heading=place.heading + heading,
    )
    _, straight = Guide(path).commands(place, 50.0)
    _, turn = Guide(path).commands(aside, 50.0)
    expected = -1.1 * heading - 0.30 * left / place.speed
    assert turn - straight == pytest.approx(expected, abs=0.02)


@given(st.floats(-40.0, 40.0))
def test_a_late_aircraft_flies_the_same_path(late: float) -> None:
    path = PATHS[2]
    place = path.at(50.0)
    guide = Guide(path, late=late)
    acceleration, turn = guide.commands(place, 50.0 + late)
    assert guide.late == pytest.approx(late, abs=1e-6)
    assert turn == pytest.approx(Guide(path).commands(place, 50.0)[1], abs=1e-9)
    if abs(late) > 5.0:
        assert acceleration * late > 0.0
