"""The intruder: how it flies and changes its intent, and what reports of it show."""

import math

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs import intruder, observation
from envs.aircraft import PAPER
from envs.intruder import Intent, IntruderState
from envs.kinematics import Limits, VehicleState, advance
from envs.perception import Sensor, carry_back, perceive
from tests.envs.test_surrogate import COUNT, FEW, WORLD, encounters, observe, reset, step
from tests.support import (
    ARRAY_BACKENDS,
    Backend,
    angle_between,
    mirror_state,
    random_states,
    states,
)

STEPS = 300
HEADINGS = np.concatenate([np.linspace(-math.pi, math.pi, 97)[:-1], [-3.1415925, 3.1415925, 1e-6]])


def fly(vehicle: VehicleState, intent: Intent, xp=np, steps: int = STEPS) -> list[IntruderState]:
    """Return the states at 0, 1, ..., steps seconds."""
    flight = [intruder.start(vehicle, xp)]
    for time in range(steps):
        flight.append(intruder.step(flight[-1], intent, float(time), 1.0, xp))
    return flight


def passive(like: np.ndarray) -> Intent:
    return Intent(0.0 * like, 0.0 * like, 0.0 * like + math.radians(3.0))


@pytest.mark.parametrize("backend", ARRAY_BACKENDS, ids=lambda backend: backend.name)
def test_a_passive_intruder_keeps_its_course(backend: Backend) -> None:
    """For 300 s at any heading and speed: 1e-6 rad, and 1 cm of a straight line in float64.

    Float32 adds half a unit in the last place of a coordinate with every step, 2 mm at 45 km.
    """
    heading = np.repeat(HEADINGS, 3)
    speed = np.tile([20.0, 75.0, 150.0], HEADINGS.size)
    inputs = [
        backend.round_values(field)
        for field in (0.0 * heading + 7_000.0, 0.0 * heading - 9_000.0, heading, speed)
    ]
    vehicle = VehicleState(*(backend.xp.asarray(field, backend.dtype) for field in inputs))
    flight = fly(vehicle, passive(vehicle.x), backend.xp)
    x, y, heading, speed = inputs
    rounding = 0.5 * float(np.spacing(np.float32(45_000.0))) if backend.dtype is np.float32 else 0.0
    for seconds in range(0, STEPS + 1, 20):
        at = flight[seconds].vehicle
        assert np.max(angle_between(at.heading, heading)) <= 1e-6
        east = np.asarray(at.x, np.float64) - x - speed * seconds * np.cos(heading)
        north = np.asarray(at.y, np.float64) - y - speed * seconds * np.sin(heading)
        assert np.max(np.hypot(east, north)) <= 0.01 + rounding * seconds
        np.testing.assert_array_equal(at.speed, speed)


def test_the_waypoint_lies_ahead_and_is_never_reached() -> None:
    """At least 50 km ahead, which is more than 150 m/s flies in 300 s."""
    vehicle = random_states(np.random.default_rng(0), 100)
    begun = intruder.start(vehicle, np)
    ahead = np.hypot(begun.waypoint_x - vehicle.x, begun.waypoint_y - vehicle.y)
    assert np.all(ahead >= 50_000.0 - 1.0)
    course = np.arctan2(begun.waypoint_y - vehicle.y, begun.waypoint_x - vehicle.x)
    assert np.max(angle_between(course, vehicle.heading)) < 1e-6


def maneuvering(count: int, seed: int) -> tuple[VehicleState, Intent]:
    generator = np.random.default_rng(seed)
    change = np.radians(generator.uniform(5.0, 170.0, count)) * generator.choice([-1.0, 1.0], count)
    return random_states(generator, count), Intent(
        onset=generator.uniform(0.0, 60.0, count),
        heading_change=change,
        turn_rate=np.radians(generator.uniform(1.0, 3.0, count)),
    )


def total_turn(flight: list[IntruderState]) -> np.ndarray:
    """Return the heading change since the start, without wraps, ``[time, N]``."""
    return (
        np.unwrap(np.stack([state.vehicle.heading for state in flight]), axis=0)
        - flight[0].vehicle.heading
    )


def test_a_change_of_intent_turns_to_the_announced_course() -> None:
    """In the announced direction, by the announced amount to 0.5 degrees, and it stays there to the
    end.
    """
    vehicle, intent = maneuvering(500, seed=1)
    change = total_turn(fly(vehicle, intent)) * np.sign(intent.heading_change)
    assert np.min(change) >= -1e-6, "it turned to the other side first"
    # P control closes the last error exponentially: 20 s after the turn at full rate nothing is
    # left.
    settled = (
        np.ceil(intent.onset + np.abs(intent.heading_change) / intent.turn_rate).astype(int) + 20
    )
    for column in range(500):
        after = change[settled[column] :, column]
        np.testing.assert_allclose(
            np.degrees(after), np.degrees(abs(intent.heading_change[column])), atol=0.5
        )


def test_a_turn_is_never_quicker_than_announced() -> None:
    vehicle, intent = maneuvering(500, seed=2)
    rate = np.abs(np.diff(total_turn(fly(vehicle, intent)), axis=0))
    assert np.all(rate <= intent.turn_rate + 1e-9)
    # And for most of a large turn it is just that quick.
    large = np.abs(intent.heading_change) > math.radians(60.0)
    np.testing.assert_allclose(np.max(rate, axis=0)[large], intent.turn_rate[large], rtol=1e-9)


@pytest.mark.parametrize(
    ("onset", "first"), [(0.0, 0), (0.3, 1), (1.0, 1), (7.0, 7), (7.001, 8), (299.5, None)]
)
def test_the_turn_begins_with_the_first_step_at_or_after_its_onset(
    onset: float, first: int | None
) -> None:
    vehicle = random_states(np.random.default_rng(3), 4)
    intent = Intent(
        np.full(4, onset), np.radians([60.0, -60.0, 120.0, -120.0]), np.full(4, math.radians(2.0))
    )
    moving = np.abs(np.diff(total_turn(fly(vehicle, intent)), axis=0)) > 1e-5
    if first is None:
        assert not moving.any()
    else:
        assert not moving[:first].any()
        assert moving[first].all()


@pytest.mark.parametrize("backend", ARRAY_BACKENDS, ids=lambda backend: backend.name)
def test_no_intruder_ever_turns_back_of_its_own(backend: Backend) -> None:
    """Over 300 s the course moves monotonically towards the announced one and never beyond by 0.5
    degrees.
    """
    vehicle, intent = maneuvering(64, seed=4)
    vehicle = VehicleState(*(backend.xp.asarray(field, backend.dtype) for field in vehicle))
    intent = Intent(*(backend.xp.asarray(field, backend.dtype) for field in intent))
    flight = [state.vehicle.heading for state in fly(vehicle, intent, backend.xp)]
    heading = np.unwrap(np.asarray(flight, np.float64), axis=0)
    amount = np.abs(np.asarray(intent.heading_change, np.float64))
    progress = (heading - heading[0]) * np.sign(np.asarray(intent.heading_change, np.float64))
    slack = math.radians(0.5)
    assert np.min(np.diff(progress, axis=0)) > -1e-4
    assert np.all(progress <= amount + slack)
    assert np.all(progress[-1] >= amount - slack)


def test_intruders_are_mirror_symmetric() -> None:
    vehicle, intent = maneuvering(100, seed=5)
    mirrored_intent = intent._replace(heading_change=-intent.heading_change)
    left, right = (
        fly(vehicle, intent, steps=120)[-1],
        fly(mirror_state(vehicle), mirrored_intent, steps=120)[-1],
    )
    expected = mirror_state(left.vehicle)
    np.testing.assert_allclose(right.vehicle.x, expected.x, atol=1e-3)
    np.testing.assert_allclose(right.vehicle.y, expected.y, atol=1e-3)
    assert np.max(angle_between(right.vehicle.heading, expected.heading)) < 1e-6


def test_all_three_gains_act() -> None:
    """By hand for one step with an error of 0.01 rad: the yaw rate is P e + I e dt + D (e -
    e_before) / dt.
    """
    vehicle = VehicleState(np.zeros(1), np.zeros(1), np.array([-0.01]), np.full(1, 80.0))
    state = IntruderState(
        vehicle, np.array([1e7]), np.zeros(1), np.array([0.004]), np.array([0.02])
    )
    gains = intruder.Gains(proportional=0.3, integral=0.1, derivative=0.2)
    after = intruder.step(state, passive(vehicle.x), 5.0, 1.0, np, gains)
    rate = 0.3 * 0.01 + 0.1 * (0.02 + 0.01) + 0.2 * (0.01 - 0.004)
    np.testing.assert_allclose(after.vehicle.heading, -0.01 + rate, atol=1e-7)
    np.testing.assert_allclose(after.error, 0.01, atol=1e-7)
    np.testing.assert_allclose(after.error_sum, 0.03, atol=1e-7)


# Reports of the intruder: perfect ones change nothing, noise has its statistics and latency lets it
# grow.
LIMITS = Limits(0.0, 150.0, -0.5, 0.5, math.radians(3.0))
SILENCE = np.zeros((4, 1))


def assert_same(state: VehicleState, expected: VehicleState) -> None:
    np.testing.assert_allclose(state.x, expected.x, atol=1e-6)
    np.testing.assert_allclose(state.y, expected.y, atol=1e-6)
    np.testing.assert_allclose(state.speed, expected.speed, atol=1e-6)
    assert np.max(angle_between(state.heading, expected.heading)) < 1e-6


@given(states(), states(), states())
def test_perfect_reports_are_the_truth(
    now: VehicleState, before: VehicleState, before_that: VehicleState
) -> None:
    """Without noise and latency nothing but the present matters."""
    assert_same(perceive(now, before, before_that, Sensor(), SILENCE[:, 0], 1.0, np), now)


@given(states(), st.floats(0.0, 2.0))
def test_straight_flight_is_dead_reckoned_exactly(now: VehicleState, latency: float) -> None:
    before, before_that = carry_back(now, 1.0, np), carry_back(now, 2.0, np)
    assert_same(
        perceive(now, before, before_that, Sensor(latency=latency), SILENCE[:, 0], 1.0, np), now
    )


def test_carried_back_undoes_straight_flight() -> None:
    now = random_states(np.random.default_rng(0), 100)
    before = carry_back(now, 2.0, np)
    assert_same(advance(before, 0.0, 0.0, 2.0, LIMITS, np), now)


@pytest.mark.parametrize("latency", [1.0, 2.0])
def test_a_late_report_is_the_old_state_flown_straight_on(latency: float) -> None:
    """At whole steps of age: a turn since then goes unseen."""
    turn = math.radians(3.0)
    oldest = random_states(np.random.default_rng(1), 50)
    older = advance(oldest, 0.0, turn, 1.0, LIMITS, np)
    now = advance(older, 0.0, turn, 1.0, LIMITS, np)
    reported = {1.0: older, 2.0: oldest}[latency]
    report = perceive(now, older, oldest, Sensor(latency=latency), SILENCE, 1.0, np)
    assert_same(report, advance(reported, 0.0, 0.0, latency, LIMITS, np))
    assert np.min(angle_between(report.heading, now.heading)) > 0.9 * turn * latency


def errors(sensor: Sensor, count: int = 40_000) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors of position and velocity of reports on straight flight, ``[2, N]`` each."""
    generator = np.random.default_rng(2)
    now = random_states(generator, count)
    history = carry_back(now, 1.0, np), carry_back(now, 2.0, np)
    report = perceive(now, *history, sensor, generator.standard_normal((4, count)), 1.0, np)

    def velocities(state: VehicleState) -> np.ndarray:
        return np.stack([state.speed * np.cos(state.heading), state.speed * np.sin(state.heading)])

    return np.stack([report.x - now.x, report.y - now.y]), velocities(report) - velocities(now)


@pytest.mark.parametrize("latency", [0.0, 0.5, 1.0, 2.0])
@pytest.mark.parametrize(("position_std", "velocity_std"), [(30.0, 3.0), (0.0, 10.0), (30.0, 0.0)])
def test_noise_has_its_size_and_latency_lets_it_grow(
    position_std: float, velocity_std: float, latency: float
) -> None:
    """Unbiased; in each axis the position is off by sqrt(sigma_p^2 + (sigma_v latency)^2). Bounds
    are 5 sigma.
    """
    position, velocity = errors(Sensor(position_std, velocity_std, latency))
    for error, expected in (
        (position, math.hypot(position_std, velocity_std * latency)),
        (velocity, velocity_std),
    ):
        root = math.sqrt(error.shape[1])
        np.testing.assert_allclose(error.mean(axis=1), 0.0, atol=5.0 * expected / root + 1e-6)
        np.testing.assert_allclose(
            error.std(axis=1), expected, rtol=5.0 / (root * math.sqrt(2.0)), atol=1e-4
        )


def test_the_four_draws_act_on_their_own_component() -> None:
    now = random_states(np.random.default_rng(3), 1)
    for component, (east, north) in enumerate([(30.0, 0.0), (0.0, 30.0), (4.5, 0.0), (0.0, 4.5)]):
        noise = np.zeros((4, 1))
        noise[component] = 1.0
        history = carry_back(now, 1.0, np), carry_back(now, 2.0, np)
        report = perceive(now, *history, Sensor(30.0, 3.0, 1.5), noise, 1.0, np)
        np.testing.assert_allclose(
            [report.x[0] - now.x[0], report.y[0] - now.y[0]], [east, north], atol=1e-6
        )


# Reports.
NO_NOISE = np.zeros((4, FEW, 1), np.float32)


def test_perfect_reports_are_no_reports() -> None:
    state = reset(encounters("maneuvering", count=FEW))
    np.testing.assert_allclose(observe(state, NO_NOISE), observe(state), atol=1e-6)


@pytest.mark.parametrize("latency", [1.0, 2.0])
def test_a_late_report_shows_the_intruder_where_it_would_be_had_it_not_turned(
    latency: float,
) -> None:
    """The present observation of an intruder dead-reckoned from its true state of one or two
    seconds ago.
    """
    starts = encounters("maneuvering", count=FEW)
    starts = starts._replace(
        intent=Intent(
            *(np.full((FEW, 1), value, np.float32) for value in (0.0, 1.5, math.radians(3.0)))
        ),
        sensor=Sensor(*(np.full((FEW, 1), value, np.float32) for value in (0.0, 0.0, latency))),
    )
    state = reset(starts, history_dt=1.0)
    history = [state.intruders.vehicle]
    for _ in range(5):
        state, _ = step(state, (np.zeros(FEW, np.float32), np.ones(FEW, np.float32)), WORLD)
        history.append(state.intruders.vehicle)
    old = VehicleState(
        *(np.asarray(field[:, 0], np.float64) for field in history[-1 - int(latency)])
    )
    carried = old._replace(
        x=old.x + latency * old.speed * np.cos(old.heading),
        y=old.y + latency * old.speed * np.sin(old.heading),
    )
    own = VehicleState(*(np.asarray(field, np.float64) for field in state.own))
    expected = observation.observe(own, carried, starts.goal_x, starts.goal_y, PAPER, np)
    late = np.asarray(observe(state, NO_NOISE))
    difference = np.abs(late - expected)
    assert np.max(np.minimum(difference, 2.0 - difference)) < 2e-5
    assert np.min(np.abs(late - np.asarray(observe(state)))[:, 3]) > 1e-3


def test_before_the_first_step_a_late_report_is_that_of_straight_flight() -> None:
    state = reset(encounters("noisy", count=FEW), history_dt=1.0)
    np.testing.assert_allclose(observe(state, NO_NOISE), observe(state), atol=1e-5)


def test_noise_moves_the_intruder_and_leaves_the_rest_alone() -> None:
    state = reset(encounters("noisy"), history_dt=1.0)
    noisy = np.asarray(observe(state, jax.random.normal(jax.random.key(0), (4, COUNT, 1))))
    exact = np.asarray(observe(state))
    np.testing.assert_array_equal(noisy[:, [0, 1, 6, 7]], exact[:, [0, 1, 6, 7]])
    assert np.all(np.abs(noisy - exact)[:, 2:6].max(axis=0) > 0.0)
    off = 1e4 * (noisy - exact)[:, 5]
    assert 20.0 < off.std() < 60.0
