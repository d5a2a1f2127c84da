"""Over the ground and through the air are two views of one motion, and limits that are narrowed for
an unknown wind are kept in every one of them.
"""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from envs.angles import wrap
from envs.kinematics import Limits, VehicleState, advance
from envs.waypoints import PlanStates, Waypoint, at, in_air, legs, on_ground, plan_states
from envs.wind import Wind, aim_point, narrow, over_ground, through_air, turned_error

STATES = st.builds(
    VehicleState,
    st.floats(-1e4, 1e4),
    st.floats(-1e4, 1e4),
    st.floats(-3.1, 3.1),
    st.floats(40.0, 110.0),
)
WINDS = st.tuples(st.floats(-15.0, 15.0), st.floats(-15.0, 15.0)).map(lambda both: Wind(*both))
UAS = Limits(18.0, 36.0, -0.5, 0.5, math.radians(10.0))


def close(a: VehicleState, b: VehicleState) -> None:
    assert math.hypot(a.x - b.x, a.y - b.y) < 1e-6
    assert a.speed == pytest.approx(b.speed, abs=1e-9)
    assert math.cos(a.heading - b.heading) == pytest.approx(1.0, abs=1e-12)


@given(STATES, WINDS, st.floats(0.0, 500.0))
def test_there_and_back(state: VehicleState, wind: Wind, time: float) -> None:
    close(over_ground(through_air(state, wind, time), wind, time), state)


@given(STATES, STATES, WINDS, st.floats(0.0, 500.0))
def test_distances_do_not_see_the_wind(
    a: VehicleState, b: VehicleState, wind: Wind, time: float
) -> None:
    first, second = (through_air(state, wind, time) for state in (a, b))
    assert math.hypot(first.x - second.x, first.y - second.y) == pytest.approx(
        math.hypot(a.x - b.x, a.y - b.y)
    )


@given(STATES, WINDS, st.floats(0.0, 500.0))
def test_arrays_are_plain_numbers_in_a_row(state: VehicleState, wind: Wind, time: float) -> None:
    rows = through_air(VehicleState(*(np.array([field]) for field in state)), wind, time)
    close(VehicleState(*(float(field[0]) for field in rows)), through_air(state, wind, time))


@given(STATES, st.floats(-0.3, 0.3), st.floats(-0.05, 0.05), WINDS)
def test_a_leg_over_the_ground_is_a_leg_in_the_air_that_is_carried(
    a: VehicleState, gain: float, rate: float, wind: Wind
) -> None:
    free = Limits(0.0, 1e3, -1.0, 1.0, 1.0)
    b = over_ground(advance(through_air(a, wind, 0.0), gain, rate, 20.0, free, np), wind, 20.0)
    first, last = Waypoint(0, *a, 0.0), Waypoint(1, *b, 20.0)
    curves = legs(plan_states(a, [last], 0.0, wind))
    assert curves.miss.max() < 1e-3
    for point in (first, last):
        flown = at(curves, point.time, wind)
        assert math.hypot(flown.x - point.x, flown.y - point.y) < 2e-3
        assert flown.speed == pytest.approx(point.speed, abs=1e-6)
    # The velocity over the ground is what the places over the ground change by.
    before, later = (at(curves, 11.0 + s, wind) for s in (-1e-3, 1e-3))
    now = at(curves, 11.0, wind)
    assert (later.x - before.x) / 2e-3 == pytest.approx(now.speed * np.cos(now.heading), abs=1e-3)
    assert (later.y - before.y) / 2e-3 == pytest.approx(now.speed * np.sin(now.heading), abs=1e-3)


@given(st.lists(STATES, min_size=2, max_size=5), WINDS)
def test_knots_go_into_the_air_and_back(states: list[VehicleState], wind: Wind) -> None:
    rows = np.array([(*state, 20.0 * n) for n, state in enumerate(states)]).T
    back = on_ground(in_air(PlanStates(*rows), wind), wind)
    np.testing.assert_allclose(np.stack(back[:2]), rows[:2], atol=1e-8)
    np.testing.assert_allclose(wrap(back.heading - rows[2], np), 0.0, atol=1e-12)
    np.testing.assert_allclose(back.speed, rows[3], atol=1e-10)


@given(
    st.floats(-2e4, 2e4),
    st.floats(-2e4, 2e4),
    st.floats(18.0, 36.0),
    st.floats(0.0, 17.9),
    st.floats(-3.1, 3.1),
)
def test_flying_straight_to_the_meeting_meets_what_drifts(
    x: float, y: float, speed: float, strength: float, course: float
) -> None:
    drift = strength * math.cos(course), strength * math.sin(course)
    own = VehicleState(100.0, -50.0, 0.0, speed)
    aim_x, aim_y = aim_point(own, (x, y), drift, 1e9, np)
    time = math.hypot(aim_x - own.x, aim_y - own.y) / speed
    assert math.hypot(aim_x - x - drift[0] * time, aim_y - y - drift[1] * time) < 1e-5


def test_what_drifts_away_faster_is_aimed_at_where_it_will_be() -> None:
    own = VehicleState(0.0, 0.0, 0.0, 18.0)
    assert aim_point(own, (100.0, 0.0), (20.0, 0.0), 50.0, np) == pytest.approx((1100.0, 0.0))


@given(
    st.floats(0.01, 4.0),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
    st.floats(-1.0, 1.0),
    st.floats(0.0, 1.0),
    st.floats(-math.pi, math.pi),
)
def test_narrowed_limits_hold_the_given_ones_in_every_wind(
    error: float, fast: float, gain: float, turn: float, far: float, side: float
) -> None:
    within = narrow(UAS, error)
    assume(within.speed_min < within.speed_max and within.yaw_rate_max > 0.0)
    assume(within.acceleration_max > 0.0)
    speed = within.speed_min + fast * (within.speed_max - within.speed_min)
    ahead = within.acceleration_min + gain * (within.acceleration_max - within.acceleration_min)
    rate = turn * within.yaw_rate_max
    # The other air mass sees the velocity changed by up to the error, and the same acceleration.
    velocity = speed - far * error * complex(math.cos(side), math.sin(side))
    acceleration = complex(ahead, speed * rate)
    unit = velocity / abs(velocity)
    along, across = (acceleration / unit).real, (acceleration / unit).imag
    assert UAS.speed_min - 1e-9 <= abs(velocity) <= UAS.speed_max + 1e-9
    assert UAS.acceleration_min - 1e-9 <= along <= UAS.acceleration_max + 1e-9
    assert abs(across) / abs(velocity) <= UAS.yaw_rate_max + 1e-9


@given(st.floats(0.0, 5.0), st.floats(0.01, 2.0), st.floats(0.1, 4.0), st.floats(0.02, 1.0))
def test_what_hovers_keeps_speeds_turns_and_accelerations(
    slow: float, error: float, strongest: float, rate: float
) -> None:
    limits = Limits(slow, 80.0, -strongest, 0.5 * strongest, rate)
    within = narrow(limits, error)
    assume(within.speed_min < within.speed_max)
    assert within.yaw_rate_max > 0.0
    assert within.acceleration_min < 0.0 < within.acceleration_max
    assert within.speed_min >= slow + error


@given(st.floats(-9.0, 9.0), st.floats(0.0, 5.0), st.floats(-math.pi, math.pi))
def test_a_turn_in_another_wind_leads_to_a_velocity_within_the_error(
    turn: float, error: float, side: float
) -> None:
    ground, wind = complex(20.0, 5.0), complex(3.0, -6.0)
    true_wind = wind + error * complex(math.cos(side), math.sin(side))
    turned = complex(math.cos(turn), math.sin(turn))
    after, instead = ((ground - blows) * turned + blows for blows in (wind, true_wind))
    assert abs(after - instead) <= turned_error(turn, error) + 1e-9


def test_nothing_is_narrowed_where_the_wind_is_known() -> None:
    assert narrow(UAS, 0.0) == UAS
