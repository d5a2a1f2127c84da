"""Motion, the end of an encounter and their one update: exact, symmetric, and alike in every
backend.
"""

import itertools
import math

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from envs import starts, world
from envs.aircraft import PAPER
from envs.backend import FLOATS
from envs.gym import flight
from envs.intruder import KnownFlight, start, step
from envs.kinematics import (
    C208_PUBLISHED,
    SURROGATE,
    Limits,
    VehicleState,
    advance,
    commands,
    velocity,
)
from envs.outcome import RULES, judge, reward
from envs.scenarios import scenario
from envs.trees import take
from envs.world import World
from tests.support import (
    BACKENDS,
    Backend,
    accelerations,
    angle_between,
    headings,
    mirror_state,
    move_state,
    random_states,
    states,
    yaw_rates,
)

RATE = math.radians(3.0)
EVERY_LIMIT = pytest.mark.parametrize(
    "limits", [SURROGATE, C208_PUBLISHED], ids=["surrogate", "c208"]
)


def random_commands(
    generator: np.random.Generator, count: int, limits: Limits
) -> tuple[np.ndarray, np.ndarray]:
    """Return accelerations and yaw rates over the limits; a quarter of each sits on zero or on an
    end.
    """
    acceleration = generator.uniform(limits.acceleration_min, limits.acceleration_max, count)
    acceleration[: count // 4] = generator.choice(
        [limits.acceleration_min, 0.0, limits.acceleration_max], count // 4
    )
    yaw_rate = generator.uniform(-limits.yaw_rate_max, limits.yaw_rate_max, count)
    yaw_rate[count // 8 : 3 * count // 8] = (
        generator.choice([-1.0, 0.0, 1.0], count // 4) * limits.yaw_rate_max
    )
    return acceleration, yaw_rate


def some_motion(
    count: int, limits: Limits = SURROGATE, seed: int = 0
) -> tuple[VehicleState, np.ndarray, np.ndarray]:
    """Return states, half of which are so near a speed limit that one step can reach it, and
    commands for them.
    """
    generator = np.random.default_rng(seed)
    state = random_states(generator, count)
    near = generator.choice([limits.speed_min, limits.speed_max], count) + generator.uniform(
        -0.6, 0.6, count
    )
    speed = generator.uniform(limits.speed_min, limits.speed_max, count)
    speed = np.where(generator.random(count) < 0.5, near, speed)
    speed = np.clip(speed, limits.speed_min, limits.speed_max)
    return state._replace(speed=speed), *random_commands(generator, count, limits)


def integrate(
    state: VehicleState,
    acceleration: np.ndarray,
    yaw_rate: np.ndarray,
    duration: float,
    limits: Limits,
) -> VehicleState:
    """Integrate the motion in steps of 1 ms with ordinary trigonometry (midpoint rule)."""
    steps = round(duration * 1_000)
    x, y, speed = state.x.copy(), state.y.copy(), state.speed.copy()
    for tick in range(steps):
        heading = state.heading + yaw_rate * (tick + 0.5) * 1e-3
        following = np.clip(speed + acceleration * 1e-3, limits.speed_min, limits.speed_max)
        x += 0.5 * (speed + following) * np.cos(heading) * 1e-3
        y += 0.5 * (speed + following) * np.sin(heading) * 1e-3
        speed = following
    return VehicleState(x, y, state.heading + yaw_rate * duration, speed)


def assert_same(
    state: VehicleState, expected: VehicleState, metres: float, radians: float = 1e-9
) -> None:
    assert np.max(np.hypot(state.x - expected.x, state.y - expected.y)) <= metres
    assert np.max(angle_between(state.heading, expected.heading)) <= radians
    np.testing.assert_allclose(state.speed, expected.speed, rtol=0.0, atol=metres)


@EVERY_LIMIT
def test_a_step_is_exact_whatever_the_command(limits: Limits) -> None:
    """Within 2 cm of a 1 ms integration, speed limits reached inside the step included."""
    state, acceleration, yaw_rate = some_motion(20_000, limits)
    moved = advance(state, acceleration, yaw_rate, 1.0, limits, np)
    expected = integrate(state, acceleration, yaw_rate, 1.0, limits)
    # The integration itself stops at a limit up to 1 ms late, which is 5e-4 m/s; the step is far
    # better than 2 cm.
    assert_same(moved, expected, metres=2e-3)


def test_a_limit_is_reached_inside_the_step() -> None:
    """By hand: 99.8 m/s at 0.5 m/s^2 takes 0.4 s to 100 m/s, then flies on at that speed."""
    state = VehicleState(np.zeros(1), np.zeros(1), np.zeros(1), np.array([99.8]))
    moved = advance(state, np.array([0.5]), np.zeros(1), 1.0, SURROGATE, np)
    np.testing.assert_allclose(moved.x, 99.8 * 0.4 + 0.5 * 0.5 * 0.4**2 + 100.0 * 0.6, atol=1e-9)
    np.testing.assert_allclose(moved.speed, 100.0, atol=1e-12)
    np.testing.assert_allclose(moved.y, 0.0, atol=1e-9)


def test_a_turn_is_the_circle_of_its_radius() -> None:
    """A full circle at 3 degrees/s takes 120 s, returns to its start and has the radius v /
    omega.
    """
    state = VehicleState(np.zeros(1), np.zeros(1), np.zeros(1), np.array([80.0]))
    track = [state]
    for _ in range(120):
        track.append(advance(track[-1], np.zeros(1), np.full(1, RATE), 1.0, SURROGATE, np))
    assert_same(track[-1], state, metres=1e-6, radians=1e-9)
    radius = [math.hypot(at.x[0], at.y[0] - 80.0 / RATE) for at in track]
    np.testing.assert_allclose(radius, 80.0 / RATE, atol=1e-6)


@given(states(), accelerations, yaw_rates, st.floats(0.0, 1.0))
def test_two_steps_equal_one(
    state: VehicleState, acceleration: float, yaw_rate: float, share: float
) -> None:
    whole = advance(state, acceleration, yaw_rate, 1.0, SURROGATE, np)
    half = advance(state, acceleration, yaw_rate, share, SURROGATE, np)
    assert_same(
        advance(half, acceleration, yaw_rate, 1.0 - share, SURROGATE, np), whole, metres=1e-9
    )


def test_two_half_steps_equal_one_for_many_commands() -> None:
    state, acceleration, yaw_rate = some_motion(20_000)
    whole = advance(state, acceleration, yaw_rate, 1.0, SURROGATE, np)
    half = advance(state, acceleration, yaw_rate, 0.5, SURROGATE, np)
    assert_same(advance(half, acceleration, yaw_rate, 0.5, SURROGATE, np), whole, metres=1e-9)


@given(states(), accelerations, yaw_rates, headings, st.floats(-1e4, 1e4), st.floats(-1e4, 1e4))
def test_motion_does_not_depend_on_place_or_direction(
    state: VehicleState,
    acceleration: float,
    yaw_rate: float,
    angle: float,
    east: float,
    north: float,
) -> None:
    moved_elsewhere = advance(
        move_state(state, angle, east, north), acceleration, yaw_rate, 1.0, SURROGATE, np
    )
    expected = move_state(
        advance(state, acceleration, yaw_rate, 1.0, SURROGATE, np), angle, east, north
    )
    assert_same(moved_elsewhere, expected, metres=1e-8)


@given(states(), accelerations, yaw_rates)
def test_motion_is_mirror_symmetric(
    state: VehicleState, acceleration: float, yaw_rate: float
) -> None:
    left = advance(state, acceleration, yaw_rate, 1.0, SURROGATE, np)
    right = advance(mirror_state(state), acceleration, -yaw_rate, 1.0, SURROGATE, np)
    assert_same(mirror_state(left), right, metres=1e-9)


@given(states(), accelerations, yaw_rates)
def test_motion_inside_the_limits_can_be_flown_back(
    state: VehicleState, acceleration: float, yaw_rate: float
) -> None:
    """Turned around at its end, with the time-reversed commands, the vehicle retraces its step."""
    assume(SURROGATE.speed_min <= state.speed + acceleration <= SURROGATE.speed_max)

    def turn_round(vehicle: VehicleState) -> VehicleState:
        return vehicle._replace(
            heading=np.remainder(vehicle.heading + 2.0 * math.pi, 2.0 * math.pi) - math.pi
        )

    moved = advance(state, acceleration, yaw_rate, 1.0, SURROGATE, np)
    back = advance(turn_round(moved), -acceleration, -yaw_rate, 1.0, SURROGATE, np)
    assert_same(turn_round(back), state, metres=1e-8, radians=1e-9)


@EVERY_LIMIT
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_speed_never_leaves_the_limits(limits: Limits, dtype: type) -> None:
    generator = np.random.default_rng(3)
    state = VehicleState(*(field.astype(dtype) for field in some_motion(2_000, limits)[0]))
    for _ in range(60):
        acceleration, yaw_rate = random_commands(generator, 2_000, limits)
        state = advance(
            state, acceleration.astype(dtype), yaw_rate.astype(dtype), dtype(1.0), limits, np
        )
        # One unit in the last place is what rounding a sum can cost.
        unit = float(np.spacing(dtype(limits.speed_max)))
        assert np.all(state.speed >= limits.speed_min - unit)
        assert np.all(state.speed <= limits.speed_max + unit)
        low, high = dtype(-math.pi), dtype(math.pi)
        assert np.all((state.heading >= low) & (state.heading < high))


@pytest.mark.parametrize(
    ("speed", "acceleration", "expected"),
    [
        (45.0, -0.5, 45.0),
        (45.0, 0.0, 45.0),
        (45.0, 0.5, 45.5),
        (120.0, 0.5, 120.0),
        (120.0, -0.5, 119.5),
    ],
)
def test_a_speed_outside_the_limits_stays_until_commanded_inwards(
    speed: float, acceleration: float, expected: float
) -> None:
    state = VehicleState(*(np.array([value]) for value in (0.0, 0.0, 0.3, speed)))
    moved = advance(state, np.array([acceleration]), np.zeros(1), 1.0, SURROGATE, np)
    np.testing.assert_allclose(moved.speed, expected, atol=1e-12)
    np.testing.assert_allclose(np.hypot(moved.x, moved.y), 0.5 * (speed + expected), atol=1e-9)


@pytest.mark.parametrize("backend", BACKENDS, ids=lambda backend: backend.name)
def test_backends_move_alike(backend: Backend) -> None:
    """One step of each against numpy in float64; 5 mm is what float32 can hold at 10 km (its unit
    is 1 mm).
    """
    state, acceleration, yaw_rate = some_motion(2_000, seed=5)
    inputs = [backend.round_values(column) for column in (*state, acceleration, yaw_rate)]
    expected = advance(VehicleState(*inputs[:4]), inputs[4], inputs[5], 1.0, SURROGATE, np)

    def step(x, y, heading, speed, a, omega):
        return advance(VehicleState(x, y, heading, speed), a, omega, 1.0, SURROGATE, backend.xp)

    moved = VehicleState(*backend.apply(step, *inputs))
    single = backend.dtype is np.float32
    assert_same(moved, expected, metres=5e-3 if single else 1e-8, radians=1e-6 if single else 1e-12)


def test_commands_scale_each_side_by_its_own_limit_and_clip() -> None:
    throttle = np.array([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 7.0])
    steering = np.array([1.5, 1.0, 0.5, 0.0, -0.5, -1.0, -9.0])
    acceleration, yaw_rate = commands((throttle, steering), C208_PUBLISHED, np)
    np.testing.assert_allclose(acceleration, [-0.8, -0.8, -0.4, 0.0, 0.25, 0.5, 0.5], atol=1e-15)
    np.testing.assert_allclose(
        np.degrees(yaw_rate), [5.0, 5.0, 2.5, 0.0, -2.5, -5.0, -5.0], atol=1e-12
    )


def test_positive_steering_turns_left() -> None:
    _, yaw_rate = commands((np.zeros(1), np.ones(1)), SURROGATE, np)
    east = VehicleState(np.zeros(1), np.zeros(1), np.zeros(1), np.full(1, 75.0))
    after = advance(east, np.zeros(1), yaw_rate, 1.0, SURROGATE, np)
    assert after.y[0] > 0.0
    np.testing.assert_allclose(after.heading, RATE, atol=1e-12)


def test_velocity_points_along_the_heading() -> None:
    quarter = 0.5 * math.pi
    state = VehicleState(
        np.zeros(4), np.zeros(4), np.array([0.0, quarter, -math.pi, -quarter]), np.full(4, 80.0)
    )
    vx, vy = velocity(state, np)
    np.testing.assert_allclose(vx, [80.0, 0.0, -80.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(vy, [0.0, 80.0, 0.0, -80.0], atol=1e-9)


def test_limits_are_data_that_broadcast() -> None:
    """A vehicle each: the same command meets a different speed limit in every row."""
    count = 3
    state = VehicleState(np.zeros(count), np.zeros(count), np.zeros(count), np.full(count, 60.0))
    limits = SURROGATE._replace(speed_max=np.array([60.0, 60.2, 100.0]))
    moved = advance(state, np.full(count, 0.5), np.zeros(count), 1.0, limits, np)
    np.testing.assert_allclose(moved.speed, [60.0, 60.2, 60.5], atol=1e-12)


# The rules: every clause of the end of an encounter, which outweighs which, and the paper's
# rewards.

FAR, CLOSE = 5_000.0, 999.9
AWAY, HOME = 3_000.0, 499.9
EARLY, LATE = 10.0, 300.0


def ends(separation: float, goal_distance: float, time: float) -> tuple[bool, bool, bool]:
    return tuple(judge(separation, goal_distance, time, RULES, FLOATS))


def test_the_rules_are_the_papers() -> None:
    assert RULES._asdict() == {
        "dt": 1.0,
        "t_max": 300.0,
        "separation": 1_000.0,
        "goal_radius": 500.0,
        "reward_violation": -100.0,
        "reward_goal": 100.0,
        "reward_timeout": -10.0,
    }


@pytest.mark.parametrize(
    ("separation", "goal_distance", "time", "expected", "points"),
    [
        (FAR, AWAY, EARLY, (False, False, False), 0.0),
        (CLOSE, AWAY, EARLY, (True, False, False), -100.0),
        (FAR, HOME, EARLY, (False, True, False), 100.0),
        (FAR, AWAY, LATE, (False, False, True), -10.0),
        (CLOSE, HOME, EARLY, (True, False, False), -100.0),
        (CLOSE, AWAY, LATE, (True, False, False), -100.0),
        (FAR, HOME, LATE, (False, True, False), 100.0),
        (CLOSE, HOME, LATE, (True, False, False), -100.0),
    ],
)
def test_every_clause_and_its_precedence(separation, goal_distance, time, expected, points) -> None:
    """A violation outweighs everything; the goal outweighs the clock; each gives the reward of the
    paper's table.
    """
    outcome = judge(separation, goal_distance, time, RULES, FLOATS)
    assert tuple(outcome) == expected
    assert outcome.ended(FLOATS) == any(expected)
    assert reward(outcome, RULES, FLOATS) == points


def test_the_thresholds_themselves() -> None:
    """Exactly 1000 m is separated; exactly 500 m is at the goal."""
    assert ends(1_000.0, AWAY, EARLY) == (False, False, False)
    assert ends(np.nextafter(1_000.0, 0.0), AWAY, EARLY) == (True, False, False)
    assert ends(FAR, 500.0, EARLY) == (False, True, False)
    assert ends(FAR, np.nextafter(500.0, 1e3), EARLY) == (False, False, False)


@pytest.mark.parametrize("dt", [1.0, 0.5, 0.1, 0.3])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_the_clock_stops_exactly_at_the_last_step(dt: float, dtype: type) -> None:
    """Time is a sum of steps: t_max falls on step 300 at 1 s, not on 299 or 301, whatever the
    rounding.
    """
    rules = RULES._replace(dt=dt)
    time, step, timeouts = dtype(0.0), 0, []
    while step < 300.0 / dt + 2:
        time, step = dtype(time + dtype(dt)), step + 1
        timeouts += [step] * bool(judge(dtype(FAR), dtype(AWAY), time, rules, np).timeout)
    assert timeouts[0] == round(300.0 / dt)


def test_at_most_one_of_the_three_holds_in_every_backend() -> None:
    """Each combination of the three causes, in numpy and jax as in plain floats."""
    cases = np.array(list(itertools.product([FAR, CLOSE], [AWAY, HOME], [EARLY, LATE])), np.float32)
    plain = [judge(*map(float, case), RULES, FLOATS) for case in cases]
    for xp in (np, jnp):
        outcome = judge(*(xp.asarray(column) for column in cases.T), RULES, xp)
        assert np.array_equal(np.stack(outcome, axis=-1), np.array(plain))
        assert np.max(np.sum(np.stack(outcome), axis=0)) == 1
        assert np.array_equal(outcome.ended(xp), np.any(np.array(plain), axis=-1))
        np.testing.assert_array_equal(
            reward(outcome, RULES, xp), [reward(o, RULES, FLOATS) for o in plain]
        )


# One update for all array namespaces: plain floats, numpy and recorded intruders.

COUNT, STEPS = 3, 120


@pytest.mark.parametrize("name", ["circle", "noisy", "multi"])
@pytest.mark.parametrize("dt", [1.0, 0.3])
def test_plain_floats_equal_numpy_to_the_last_bit(name: str, dt: float) -> None:
    aircraft = PAPER._replace(dt=dt)
    parameters = World(RULES._replace(dt=dt), aircraft)
    encounters = starts.encounters_of_seed(scenario(name, aircraft), 4, 0, COUNT)
    batch = world.begin(encounters, np, history_dt=dt)
    singles = [flight.begin(take(encounters, i), dt) for i in range(COUNT)]
    rng = np.random.default_rng(1)
    for _ in range(STEPS):
        action, noise = (
            rng.uniform(-1.2, 1.2, (COUNT, 2)),
            rng.normal(size=(4, *encounters.mask.shape)),
        )
        observations = world.observe(batch, aircraft, noise, xp=np).astype(np.float32)
        batch, result = world.step(batch, (action[:, 0], action[:, 1]), parameters, np)
        for i, mask in enumerate(encounters.mask):
            np.testing.assert_array_equal(
                flight.observe(singles[i], aircraft, noise[:, i, mask]), observations[i]
            )
            singles[i], single = flight.step(singles[i], tuple(action[i].tolist()), parameters)
            assert singles[i].own == tuple(field[i] for field in batch.own)
            assert single.outcome == tuple(field[i] for field in result.outcome)
            assert (single.reward, single.separation, single.goal_distance) == (
                result.reward[i],
                result.separation[i],
                result.goal_distance[i],
            )
            np.testing.assert_array_equal(single.separations, result.separations[i, mask])


def test_each_recorded_intruder_follows_its_own_clock() -> None:
    """Rows are read by each flight's own time, and after the last one the intruder flies straight
    on.
    """
    rows = np.arange(12.0).reshape(3, 1, 4)  # [N, K, T + 1]
    recording = KnownFlight(rows, 10.0 * rows, 0.0 * rows, 0.0 * rows + 7.0)
    clock = np.array([0, 2, 3])
    began = start(
        VehicleState(*(field[np.arange(3), 0, clock][:, None] for field in recording)), np
    )
    after = step(began, recording, 1.0 * clock[:, None], 1.0, np).vehicle
    np.testing.assert_allclose(after.x[:, 0], [1.0, 7.0, 11.0 + 7.0])
    np.testing.assert_allclose(after.y[:, 0], [10.0, 70.0, 110.0])
