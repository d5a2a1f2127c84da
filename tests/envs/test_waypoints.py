"""The leg's curve meets its waypoints and is gentle; the follower keeps to it in position
and time.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.follower import PERIOD, KinematicVehicle, deviation, guidance, offset
from envs.kinematics import C208_PUBLISHED, SURROGATE, VehicleState, advance
from envs.waypoints import (
    ARCS,
    CLOSED,
    Legs,
    PlanStates,
    RoutePoint,
    Waypoint,
    at,
    legs,
    plan_states,
)
from tests.support import accelerations, angle_between, random_states, states, yaw_rates

SECONDS = 20


def history(count: int, seed: int, hold: int) -> VehicleState:
    """Return flown states ``[21, count]`` whose controls change every ``hold`` seconds."""
    rng = np.random.default_rng(seed)
    state = random_states(rng, count)
    flown = [state]
    for second in range(SECONDS):
        if second % hold == 0:
            acceleration, yaw_rate = (
                rng.uniform(-0.5, 0.5, count),
                rng.uniform(-1.0, 1.0, count) * math.radians(3.0),
            )
        state = advance(state, acceleration, yaw_rate, 1.0, SURROGATE, np)
        flown.append(state)
    return VehicleState(*(np.stack(field) for field in zip(*flown, strict=True)))


def ends(flown: VehicleState) -> PlanStates:
    """Return the first and the last state as plan states ``[count, 2]``."""
    count = flown.x.shape[1]
    return PlanStates(
        *(field[[0, -1]].T for field in flown), np.tile([0.0, float(SECONDS)], (count, 1))
    )


def largest_distance(flown: VehicleState) -> np.ndarray:
    """Return the largest distance of the curves from the histories, m, ``[count]``."""
    curves = legs(ends(flown))
    off = [
        np.hypot(*(a - b[i] for a, b in zip(at(curves, float(i))[:2], flown[:2], strict=True)))
        for i in range(21)
    ]
    return np.max(off, axis=0)


@pytest.mark.parametrize("hold", [20, 10, 5])
def test_legs_of_flown_histories_meet_their_ends(hold: int) -> None:
    flown = history(2_000, 1, hold)
    curves = legs(ends(flown))
    assert curves.miss.max() <= CLOSED
    end = at(curves, float(SECONDS))
    assert np.hypot(end.x - flown.x[-1], end.y - flown.y[-1])[:, None].max() <= 2.0 * CLOSED
    assert angle_between(end.heading, flown.heading[-1]).max() <= 1e-9
    assert np.abs(end.speed - flown.speed[-1]).max() <= 1e-9


@given(state=states(), yaw_rate=yaw_rates)
def test_steady_turns_are_met_exactly(state: VehicleState, yaw_rate: float) -> None:
    flown = [state]
    for _ in range(SECONDS):
        flown.append(advance(flown[-1], 0.0, yaw_rate, 1.0, SURROGATE, np))
    stacked = VehicleState(*(np.array(field)[:, None] for field in zip(*flown, strict=True)))
    assert largest_distance(stacked).max() <= 1e-3


@given(acceleration=accelerations, speed=st.floats(60.0, 90.0))
def test_steady_acceleration_is_met_exactly(acceleration: float, speed: float) -> None:
    gained = speed + acceleration * SECONDS
    path = 0.5 * (speed + gained) * SECONDS
    end = Waypoint(1, path, 0.0, 0.0, gained, float(SECONDS))
    curve = legs(plan_states(VehicleState(0.0, 0.0, 0.0, speed), [end]))
    np.testing.assert_allclose(curve.acceleration, acceleration, atol=1e-6)
    np.testing.assert_allclose(curve.yaw_rate, 0.0, atol=1e-9)


def test_the_curve_is_the_gentlest_that_meets_its_ends() -> None:
    # Any change of the controls that keeps the end makes the weighted sum of squares larger.
    whole = legs(ends(history(50, 2, 10)))
    curves = type(whole)(*(field[:, 0] for field in whole))
    step = SECONDS / ARCS

    def end_and_cost(yaw_rate: Any, acceleration: Any) -> tuple[np.ndarray, np.ndarray]:
        state = VehicleState(
            curves.x[..., 0], curves.y[..., 0], curves.heading[..., 0], curves.speed[..., 0]
        )
        wide = SURROGATE._replace(speed_min=0.0, speed_max=500.0)
        for arc in range(ARCS):
            state = advance(state, acceleration[..., arc], yaw_rate[..., arc], step, wide, np)
        cost = np.sum((yaw_rate / 0.02) ** 2 + (acceleration / 0.2) ** 2, axis=-1)
        return np.stack([*state[:2], np.sum(yaw_rate, -1), np.sum(acceleration, -1)], -1), cost

    controls = np.concatenate([curves.yaw_rate, curves.acceleration], axis=-1)
    fixed, least = end_and_cost(controls[:, :ARCS], controls[:, ARCS:])
    for row in range(50):
        # Directions in which the end does not move to first order, from a numerical Jacobian; the
        # solver takes an arc for its chord, which leaves a part in a hundred.
        jacobian = np.empty((4, 2 * ARCS))
        for i in range(2 * ARCS):
            moved = controls.copy()
            moved[:, i] += 1e-5
            jacobian[:, i] = (
                end_and_cost(moved[:, :ARCS], moved[:, ARCS:])[0][row] - fixed[row]
            ) / 1e-5
        free = np.linalg.svd(jacobian)[2][4:]
        gradient = np.concatenate(
            [2.0 * controls[row, :ARCS] / 0.02**2, 2.0 * controls[row, ARCS:] / 0.2**2]
        )
        assert np.abs(free @ gradient).max() <= 0.01 * max(np.abs(gradient).max(), 1.0)
    assert np.all(np.isfinite(least))


def test_legs_do_not_depend_on_the_batch() -> None:
    every = ends(history(64, 5, 5))
    whole = legs(every)
    for rows in (slice(3, 4), slice(10, 40)):
        part = legs(PlanStates(*(field[rows] for field in every)))
        for a, b in zip(part, whole, strict=True):
            np.testing.assert_array_equal(a, b[rows])


@given(angle=st.floats(-3.0, 3.0), east=st.floats(-1e4, 1e4))
def test_legs_move_with_the_scene(angle: float, east: float) -> None:
    flown = ends(history(20, 6, 10))
    cosine, sine = math.cos(angle), math.sin(angle)
    turned = flown._replace(
        x=flown.x * cosine - flown.y * sine + east,
        y=flown.x * sine + flown.y * cosine,
        heading=flown.heading + angle,
    )
    a, b = legs(flown), legs(turned)
    np.testing.assert_allclose(a.yaw_rate, b.yaw_rate, atol=1e-7)
    np.testing.assert_allclose(a.acceleration, b.acceleration, atol=1e-6)


def test_mirrored_legs_turn_the_other_way() -> None:
    flown = ends(history(20, 7, 10))
    a, b = legs(flown), legs(flown._replace(y=-flown.y, heading=-flown.heading))
    np.testing.assert_allclose(a.yaw_rate, -b.yaw_rate, atol=1e-7)


def test_states_on_a_plan_are_continuous_and_consistent() -> None:
    own = VehicleState(0.0, 0.0, 0.3, 80.0)
    flown = history(1, 8, 5)
    points = [Waypoint(i, *(float(field[-1, 0]) for field in flown), 20.0) for i in (1,)]
    own = VehicleState(*(float(field[0, 0]) for field in flown))
    curves = legs(plan_states(own, [*points]))
    times = np.linspace(0.0, 20.0, 401)
    path = [at(curves, time) for time in times]
    x, y = (np.array([float(getattr(state, name)) for state in path]) for name in ("x", "y"))
    heading, speed = (
        np.array([float(getattr(state, name)) for state in path]) for name in ("heading", "speed")
    )
    step = times[1]
    vx, vy = np.diff(x) / step, np.diff(y) / step
    middle = 0.5 * (speed[1:] + speed[:-1])
    assert np.abs(np.hypot(vx, vy) - middle).max() < 0.05
    assert angle_between(np.arctan2(vy, vx), heading[1:]).max() < 0.01


def test_the_leg_of_a_time_is_found() -> None:
    points = [Waypoint(i, 1600.0 * i, 0.0, 0.0, 80.0, 20.0 * i) for i in range(1, 4)]
    bent = legs(
        plan_states(VehicleState(0.0, 100.0, 0.1, 75.0), [replace(points[0], y=200.0), *points[1:]])
    )
    for time, number in ((-1.0, 0), (0.0, 0), (19.9, 0), (20.0, 1), (41.0, 2), (90.0, 2)):
        assert at(bent, time) == at(Legs(*(field[number : number + 1] for field in bent)), time)
    beyond = at(legs(plan_states(VehicleState(0.0, 0.0, 0.0, 80.0), points)), 70.0)
    assert beyond.x == pytest.approx(5_600.0)


def test_waypoints_that_contradict_each_other_show() -> None:
    # A point 9 km behind after 20 s: the curve goes backwards, which no limit allows.
    behind = Waypoint(1, -9_000.0, 0.0, 0.0, 80.0, 20.0)
    curve = legs(plan_states(VehicleState(0.0, 0.0, 0.0, 80.0), [behind]))
    assert curve.miss > CLOSED or curve.speed.min() < 0.0


def test_waypoints_are_values() -> None:
    assert RoutePoint(3, 1.0, 2.0) == RoutePoint(3, 1.0, 2.0)
    with pytest.raises(AttributeError):
        Waypoint(0, 0.0, 0.0, 0.0, 80.0, 0.0).x = 1.0  # type: ignore[misc]


# The follower keeps to the plan in position and time, and errors are kept apart as across, along
# and in time.


def flown_plans(count: int, seed: int, legs_each: int = 6) -> tuple[VehicleState, Legs]:
    """Return starts and plans of legs from flown histories, ``[count]``."""
    rng = np.random.default_rng(seed)
    state = random_states(rng, count)
    limits = SURROGATE._replace(speed_max=99.6, speed_min=50.4)
    states = [state]
    for second in range(20 * legs_each):
        if second % 8 == 0:
            acceleration, yaw_rate = (
                rng.uniform(-0.3, 0.3, count),
                rng.uniform(-1.0, 1.0, count) * math.radians(2.0),
            )
        state = advance(state, acceleration, yaw_rate, 1.0, limits, np)
        if second % 20 == 19:
            states.append(state)
    fields = [np.stack(field, axis=-1) for field in zip(*states, strict=True)]
    times = np.broadcast_to(20.0 * np.arange(legs_each + 1), fields[0].shape)
    return states[0], legs(PlanStates(*fields, times))


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
    displaced = start._replace(
        x=start.x + 20.0, y=start.y - 15.0, speed=np.clip(start.speed + 2.0, 50.0, 98.0)
    )
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
    errors = deviation(plan, state, time)
    # Far inside a turn the abeam point is found by three steps only to a part of what is left.
    assert float(errors.cross_track) == pytest.approx(across, abs=0.5)
    assert float(errors.time) == pytest.approx(late, abs=0.2)
    assert float(errors.along_track) == pytest.approx(
        -late * 0.5 * (place.speed + at(plan, time).speed), abs=15.0
    )


def test_on_the_plan_there_is_no_error() -> None:
    _, plan = flown_plans(10, 3)
    errors = deviation(plan, at(plan, 33.3), 33.3)
    for name in ("cross_track", "along_track", "time", "heading", "speed"):
        np.testing.assert_allclose(getattr(errors, name), 0.0, atol=1e-9)
