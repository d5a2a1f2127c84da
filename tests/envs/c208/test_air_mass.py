"""Over the ground and through the air are two views of one motion."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.c208.air_mass import air_commands, ground_commands, over_ground, through_air
from envs.kinematics import SURROGATE, VehicleState, advance

STATES = st.builds(
    VehicleState, st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.floats(-3.1, 3.1), st.floats(40.0, 110.0)
)
WINDS = st.tuples(st.floats(-15.0, 15.0), st.floats(-15.0, 15.0))
COMMANDS = st.tuples(st.floats(-0.8, 0.5), st.floats(-0.08, 0.08))


def close(a: VehicleState, b: VehicleState) -> None:
    assert math.hypot(a.x - b.x, a.y - b.y) < 1e-6
    assert a.speed == pytest.approx(b.speed, abs=1e-9)
    assert math.cos(a.heading - b.heading) == pytest.approx(1.0, abs=1e-12)


@given(STATES, WINDS, st.floats(0.0, 500.0))
def test_there_and_back(state: VehicleState, wind: tuple[float, float], time: float) -> None:
    close(over_ground(through_air(state, wind, time), wind, time), state)


@given(STATES, STATES, WINDS, st.floats(0.0, 500.0))
def test_distances_do_not_see_the_wind(
    a: VehicleState, b: VehicleState, wind: tuple[float, float], time: float
) -> None:
    there, other = (through_air(state, wind, time) for state in (a, b))
    assert math.hypot(there.x - other.x, there.y - other.y) == pytest.approx(math.hypot(a.x - b.x, a.y - b.y))


@given(STATES, WINDS, st.floats(0.0, 500.0))
def test_arrays_are_plain_numbers_in_a_row(state: VehicleState, wind: tuple[float, float], time: float) -> None:
    rows = through_air(VehicleState(*(np.array([field]) for field in state)), wind, time)
    close(VehicleState(*(float(field[0]) for field in rows)), through_air(state, wind, time))


@given(STATES, WINDS, COMMANDS)
def test_commands_are_the_same_acceleration(
    state: VehicleState, wind: tuple[float, float], command: tuple[float, float]
) -> None:
    air = through_air(state, wind, 0.0)
    assert ground_commands(air, *air_commands(state, *command, wind), wind) == pytest.approx(command, abs=1e-9)
    # A moment later both views are still of one motion.
    free = SURROGATE._replace(speed_min=0.0, speed_max=1e3)
    later = advance(state, *command, 0.01, free, np)
    drifted = advance(air, *air_commands(state, *command, wind), 0.01, free, np)
    there = over_ground(VehicleState(*(float(field) for field in drifted)), wind, 0.01)
    assert math.hypot(there.x - later.x, there.y - later.y) < 1e-4
    assert there.speed == pytest.approx(float(later.speed), abs=2e-3)
