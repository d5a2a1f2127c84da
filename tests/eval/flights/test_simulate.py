"""Flights end as the rules say, do not depend on their company, and are those of the jax
surrogate.
"""

import math
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agents.baselines.baselines import Observation, StepResolver
from agents.policy.inference import Policy
from commands.command import InputError
from envs import surrogate
from envs.aircraft import PAPER
from envs.encounters import Encounter
from envs.intruder import Intent
from envs.kinematics import VehicleState
from envs.perception import Sensor
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.world import begin
from eval.flights import simulate
from eval.flights.compiled import Compiled
from eval.flights.conditions import conditions
from eval.flights.simulate import OUTCOMES, ByPolicy, sensor_noise
from tests.eval.resolvers import OnObservations, fly_recorded

VIOLATION, REACHED, TIMEOUT = range(3)


@pytest.fixture(scope="module")
def shipped() -> Policy:
    return Policy.load()


def place_encounter(own, goal, intruder, *, present: bool = True) -> Encounter:
    """Return one encounter of hand-made numbers (x, y, heading, speed)."""
    column = np.ones((1, 1))
    return Encounter(
        VehicleState(*(np.array([float(value)]) for value in own)),
        np.array([float(goal[0])]),
        np.array([float(goal[1])]),
        VehicleState(*(column * value for value in intruder)),
        column > 0 if present else column < 0,
        Intent(column * 0, column * 0, column * 0.05),
        Sensor(column * 0, column * 0, column * 0),
    )


def steady(throttle: float, steering: float):
    return OnObservations(
        lambda observation: np.full((len(observation), 2), [throttle, steering], np.float32)
    )


FAR = (90_000, 90_000, 0, 50)


def test_straight_flight_by_hand() -> None:
    start = place_encounter((0, 0, 0, 80), (8_000, 0), FAR)
    flight, paths = fly_recorded(start, simulate.Unmitigated(PAPER), PAPER)
    # The disc of 500 m is reached at the end of the first step beyond 7500 m: 94 steps of 80 m.
    assert flight.outcome[0] == REACHED
    assert flight.score[0] == 100.0
    assert flight.duration[0] == 94.0
    assert flight.path_length[0] == pytest.approx(7_520.0)
    assert flight.goal_distance[0] == pytest.approx(480.0)
    assert flight.reversals[0] == 0
    assert paths.own.x[:, 0] == pytest.approx(80.0 * np.arange(95))


def test_time_out_and_the_length_of_an_accelerated_path() -> None:
    start = place_encounter((0, 0, 0, 80), (-90_000, 0), FAR)
    flight = simulate.fly(start, steady(1.0, 0.0), PAPER)
    assert (flight.outcome[0], flight.score[0], flight.duration[0]) == (TIMEOUT, -10.0, 300.0)
    # 40 s from 80 to 100 m/s, then 260 s at 100 m/s
    assert flight.path_length[0] == pytest.approx(90.0 * 40.0 + 26_000.0, abs=0.1)


def test_violation_ends_the_flight_and_names_its_time() -> None:
    start = place_encounter((0, 0, 0, 80), (20_000, 0), (6_000, 0, -math.pi, 100))
    flight = simulate.fly(start, simulate.Unmitigated(PAPER), PAPER)
    # 5000 m are closed at 180 m/s after 27.8 s, in the 28th step.
    assert (flight.outcome[0], flight.score[0], flight.duration[0]) == (VIOLATION, -100.0, 28.0)
    assert flight.min_separation[0] == pytest.approx(6_000.0 - 28 * 180.0)
    assert flight.time_of_min_separation[0] == 28.0


def test_separation_is_watched_between_the_steps() -> None:
    # Crossing at right angles with the closest point half a second into a step, 995 m apart.
    start = place_encounter(
        (0, 0, 0, 100), (20_000, 0), (10_050, -10_050 + 1_407, math.pi / 2, 100)
    )
    flight, paths = fly_recorded(start, simulate.Unmitigated(PAPER), PAPER, endless=True)
    apart = np.hypot(
        paths.own.x - paths.intruders.x[..., 0], paths.own.y - paths.intruders.y[..., 0]
    )
    assert flight.min_separation[0] == pytest.approx(1_407.0 / math.sqrt(2.0), abs=0.1)
    assert flight.min_separation[0] <= np.nanmin(apart)


def test_a_start_inside_the_separation_is_a_violation_at_once() -> None:
    flight = simulate.fly(
        place_encounter((0, 0, 0, 80), (9_000, 0), (500, 0, 0, 100)), steady(0, 0), PAPER
    )
    assert (flight.outcome[0], flight.duration[0], flight.min_separation[0]) == (
        VIOLATION,
        1.0,
        500.0,
    )
    assert flight.time_of_min_separation[0] == 0.0


def test_an_absent_intruder_harms_nobody() -> None:
    start = place_encounter((0, 0, 0, 80), (8_000, 0), (4_000, 0, math.pi / 2, 0.0), present=False)
    flight = simulate.fly(start, simulate.Unmitigated(PAPER), PAPER)
    assert flight.outcome[0] == REACHED
    assert flight.min_separation[0] == math.inf


def test_reversals_count_changes_of_side_of_commands_that_matter() -> None:
    commands = iter([0.5, 0.5, -0.5, 0.1, -0.1, -0.5, 0.0, 0.6, 0.0] + [0.0] * 300)

    def decide(observation: np.ndarray) -> np.ndarray:
        return np.array([[0.0, next(commands)]], np.float32)

    flight = simulate.fly(
        place_encounter((0, 0, 0, 80), (90_000, 0), FAR), OnObservations(decide), PAPER
    )
    # Left, right, left: 0.1 of 3 deg/s is below the threshold.
    assert flight.reversals[0] == 2


def test_initial_conditions_by_hand() -> None:
    start = place_encounter((0, 0, math.pi / 2, 50), (0, 9_000), (3_000, 4_000, math.pi, 75))
    columns = conditions(start, PAPER)
    assert columns["distance_m"][0] == pytest.approx(5_000.0)
    assert columns["bearing_deg"][0] == pytest.approx(
        math.degrees(math.atan2(4, 3)) - 90.0, abs=1e-4
    )
    assert columns["relative_heading_deg"][0] == pytest.approx(90.0, abs=1e-4)
    assert columns["route_length_m"][0] == 9_000.0
    closing = np.array([-75.0, -50.0])
    time = -np.dot([3_000.0, 4_000.0], closing) / np.dot(closing, closing)
    assert columns["t_cpa_s"][0] == pytest.approx(time, rel=1e-6)
    assert columns["d_cpa_m"][0] == pytest.approx(
        np.linalg.norm([3_000.0, 4_000.0] + closing * time), rel=1e-6
    )
    assert tuple(
        columns[name][0] for name in ("intruders", "own_speed_m_s", "intruder_speed_m_s")
    ) == (1, 50.0, 75.0)


def fly_some(name: str, resolver: StepResolver, first: int, count: int):
    starts = encounters_of_seed(scenario(name, PAPER), 11, first, count)
    noise = sensor_noise(11, first, *starts.mask.shape) if name == "noisy" else None
    return fly_recorded(starts, resolver, PAPER, noise=noise)


@pytest.mark.parametrize(
    "name",
    [
        "circle",
        "noisy",
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in ("maneuvering", "multi", "compiled")
        ),
    ],
)
def test_a_flight_does_not_depend_on_its_company(
    name: str, policy: Policy, shipped: Policy
) -> None:
    name, resolver = (
        ("circle", Compiled(shipped)) if name == "compiled" else (name, ByPolicy(policy))
    )
    together, paths = fly_some(name, resolver, 0, 100)
    assert len(set(together.outcome)) > 1 or isinstance(resolver, Compiled)
    for first, count in ((80, 20), (99, 1)):
        apart, part_paths = fly_some(name, resolver, first, count)
        for field in simulate.Flights._fields:
            expected = getattr(together, field)[first : first + count]
            np.testing.assert_array_equal(getattr(apart, field), expected, err_msg=field)
        steps = len(part_paths.action)
        np.testing.assert_array_equal(
            part_paths.action, paths.action[:steps, first : first + count]
        )


@pytest.mark.parametrize("name", ["circle", "multi"])
def test_backends_decide_alike(name: str, shipped: Policy) -> None:
    start = begin(encounters_of_seed(scenario(name, PAPER), 5, 0, 300), np)
    observation = Observation(
        start.own, start.intruders.vehicle, start.mask, start.goal_x, start.goal_y, 300.0
    )
    memory = np.zeros(300, np.int8)
    resolver = shipped.for_aircraft(PAPER, outside="allow")  # multi has up to eight intruders
    plain, compiled = (
        kind(resolver).decide(observation, memory)[0] for kind in (ByPolicy, Compiled)
    )
    assert np.abs(plain).max() == 1.0
    np.testing.assert_allclose(compiled, plain, rtol=0.0, atol=1e-3)


def test_a_compiled_policy_takes_any_number_of_intruders(policy: Policy) -> None:
    with pytest.raises(InputError, match="one intruder only"):
        Compiled(policy)


@pytest.mark.slow
def test_compiled_decisions_need_no_training_framework() -> None:
    code = """
import sys
from agents.policy.inference import Policy
from eval.flights.compiled import Compiled
Compiled(Policy.load())
assert not {"flax", "optax"} & sys.modules.keys()
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)


def test_rows_that_depend_on_their_place_are_refused(shipped: Policy) -> None:
    resolver = Compiled(shipped)
    resolver._decided = lambda _, rows, share: np.arange(2.0 * len(rows)).reshape(-1, 2)
    with pytest.raises(InputError, match="by its place"):
        fly_some("circle", resolver, 0, 2)


def test_trajectories_end_with_the_flight(policy: Policy) -> None:
    flights, paths = fly_some("circle", ByPolicy(policy), 0, 50)
    steps = flights.duration.astype(int)
    for i, step in enumerate(steps):
        assert np.isfinite(paths.own.x[: step + 1, i]).all()
        assert np.isnan(paths.own.x[step + 1 :, i]).all()
        assert np.isnan(paths.action[step:, i]).all()
        assert flights.min_separation[i] == pytest.approx(np.nanmin(paths.separation[:, i]))
    assert paths.action.dtype == np.float64


def test_noise_changes_what_is_seen_and_nothing_else(policy: Policy) -> None:
    starts = encounters_of_seed(scenario("noisy", PAPER), 3, 0, 40)
    sees_clear, sees_noisy = OnObservations(policy), OnObservations(policy)
    clear, clear_paths = fly_recorded(starts, sees_clear, PAPER)
    noisy, noisy_paths = fly_recorded(
        starts, sees_noisy, PAPER, noise=sensor_noise(3, 0, *starts.mask.shape)
    )
    difference = sees_noisy.seen[0] - sees_clear.seen[0]
    # The own state and the goal are known; the intruder is not.
    np.testing.assert_array_equal(difference[:, [0, 1, 6, 7]], 0.0)
    distance_error_m = difference[:, 5] * 10_000.0
    assert 20.0 < distance_error_m.std() < 45.0
    assert not np.array_equal(clear.duration, noisy.duration)
    short = min(len(clear_paths.separation), len(noisy_paths.separation))
    in_flight = np.isfinite(clear_paths.own.x[:short]) & np.isfinite(noisy_paths.own.x[:short])
    np.testing.assert_array_equal(
        clear_paths.intruders.x[:short][in_flight], noisy_paths.intruders.x[:short][in_flight]
    )


def test_seeds_differ_and_repeat() -> None:
    first, again, of_other_seed = (
        encounters_of_seed(scenario("circle", PAPER), seed, 0, 10) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first.own.x, again.own.x)
    assert not np.array_equal(first.own.x, of_other_seed.own.x)


@pytest.mark.parametrize("name", ["circle", "maneuvering", "multi"])
@pytest.mark.parametrize("double", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_parity_with_the_jax_surrogate_step_by_step(
    name: str, double: bool, policy: Policy
) -> None:
    """The same actions give the same flight: within 0.1 mm in double precision, in single within
    0.5 m.

    Single precision rounds positions of 10 km to 1 mm and headings to 2e-7 rad, 300 times.
    """
    tolerance_m, tolerance_rad = (1e-4, 1e-9) if double else (0.5, 2e-5)
    starts = encounters_of_seed(scenario(name, PAPER), 5, 0, 64)
    resolver = OnObservations(policy)
    flights, paths = fly_recorded(starts, resolver, PAPER)
    with jax.enable_x64(double):
        kind = jnp.float64 if double else jnp.float32
        cast = jax.tree.map(
            lambda a: jnp.asarray(a) if a.dtype == bool else jnp.asarray(a, kind), starts
        )
        state = surrogate.reset(cast)
        world = surrogate.World(PAPER.rules(), PAPER)
        step = jax.jit(
            lambda state, action: surrogate.step(state, (action[:, 0], action[:, 1]), world)
        )
        see = jax.jit(lambda state: surrogate.observe(state, PAPER))
        flying = np.ones(64, bool)
        for t, action in enumerate(paths.action):
            observation = np.asarray(see(state))
            state, result = step(state, jnp.asarray(np.nan_to_num(action), kind))
            own, traffic = state.own, state.intruders.vehicle

            def near(ours, theirs, tolerance: float, now=flying) -> None:
                np.testing.assert_allclose(
                    np.asarray(theirs)[now], ours[now], rtol=0.0, atol=tolerance
                )

            near(paths.own.x[t + 1], own.x, tolerance_m)
            near(paths.own.y[t + 1], own.y, tolerance_m)
            near(paths.own.speed[t + 1], own.speed, tolerance_m)
            turned = np.asarray(own.heading) - paths.own.heading[t + 1]
            near(np.zeros(64), (turned + math.pi) % (2 * math.pi) - math.pi, tolerance_rad)
            near(paths.intruders.x[t + 1], traffic.x, tolerance_m)
            near(paths.separation[t], result.separation, tolerance_m)
            if name != "multi":  # of several, which one is seen may hang on a rounding
                off = np.abs(observation[flying] - resolver.seen[t])
                assert np.minimum(off, 2.0 - off).max() < 1e-4
            ended = np.stack(result.outcome)
            for code in range(len(OUTCOMES)):
                ours = flying & (flights.duration == t + 1) & (flights.outcome == code)
                # Single precision may decide a hair's breadth otherwise.
                close = np.abs(paths.separation[t] - 1_000.0) < tolerance_m
                assert np.array_equal((ended[code] & flying)[~close], ours[~close])
            flying &= flights.duration > t + 1
        assert not flying.any()
