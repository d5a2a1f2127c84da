"""The jax surrogate against a plain numpy loop, and the contract of its steps, resets, masks and
reports.
"""

import itertools
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from envs import intruder, observation, outcome, surrogate
from envs.aircraft import PAPER
from envs.encounters import Encounter, pad
from envs.intruder import Intent
from envs.kinematics import SURROGATE, VehicleState, advance, commands
from envs.outcome import RULES
from envs.perception import Sensor
from envs.relative import leg_separation
from envs.scenarios import sample, scenario
from envs.surrogate import State, StepResult, World
from tests.support import angle_between, mirror_state

WORLD = World(RULES, PAPER)
COUNT, FEW, STEPS = 64, 4, 300

# One compilation a shape, shared by all tests; most use FEW encounters.
step = jax.jit(surrogate.step)
observe = jax.jit(lambda state, noise=None: surrogate.observe(state, PAPER, noise))
reset = jax.jit(surrogate.reset, static_argnames="history_dt")
restart = jax.jit(surrogate.restart)
STILL = (np.zeros(FEW, np.float32), np.zeros(FEW, np.float32))


class Record(NamedTuple):
    """What an episode went through, ``[T, N, ...]``."""

    own: VehicleState
    intruders: VehicleState
    steps: Any
    observation: Any
    result: StepResult


@jax.jit
def fly(state: State, actions: jax.Array) -> Record:
    """Fly on with the actions ``[T, N, 2]``, whatever the outcome of a step is."""

    def forward(now: State, action: jax.Array) -> tuple[State, Record]:
        after, result = surrogate.step(now, (action[:, 0], action[:, 1]), WORLD)
        observed = surrogate.observe(after, PAPER)
        return after, Record(after.own, after.intruders.vehicle, after.steps, observed, result)

    return jax.lax.scan(forward, state, actions)[1]


def encounters(name: str, most: int = 1, count: int = COUNT, seed: int = 0) -> Encounter:
    """Return encounters in float32 that both numpy and jax represent exactly."""
    chosen = scenario(name, PAPER)
    draws = np.random.default_rng(seed).random((chosen.attempts, count, chosen.dimensions))
    starts = pad(sample(chosen, draws, np)[0], most, np)
    return jax.tree.map(
        lambda field: field if field.dtype == bool else field.astype(np.float32), starts
    )


def actions(count: int = COUNT, seed: int = 1) -> np.ndarray:
    """Return actions that are held for 10 s each, a third of them beyond the limits, ``[T,
    N, 2]``.
    """
    held_actions = np.random.default_rng(seed).uniform(-1.5, 1.5, (STEPS // 10, count, 2))
    return np.repeat(held_actions, 10, axis=0).astype(np.float32)


def one_on_one(
    own: tuple[float, ...], opponent: tuple[float, ...], goal: tuple[float, float] = (2e4, 0.0)
) -> Encounter:
    """Return FEW times the same encounter of two vehicles, given as (x, y, heading, speed)."""

    def column(value: float, *shape: int) -> np.ndarray:
        return np.full((FEW, *shape), value, np.float32)

    return Encounter(
        VehicleState(*(column(value) for value in own)),
        column(goal[0]),
        column(goal[1]),
        VehicleState(*(column(value, 1) for value in opponent)),
        np.ones((FEW, 1), bool),
        Intent(column(0.0, 1), column(0.0, 1), column(math.radians(3.0), 1)),
        Sensor(*(column(0.0, 1) for _ in range(3))),
    )


@pytest.fixture(scope="module")
def flights() -> dict[str, Any]:
    """Episodes of manoeuvring intruders with random actions, the same encounters with K = 1 and
    padded to K = 3.
    """
    alone, wide = encounters("maneuvering"), encounters("maneuvering", most=3)
    return {
        "starts": alone,
        "actions": actions(),
        "alone": fly(reset(alone), actions()),
        "wide": fly(reset(wide), actions()),
    }


@pytest.mark.parametrize("dtype", [np.float32, pytest.param(np.float64, marks=pytest.mark.slow)])
def test_a_whole_episode_equals_a_plain_loop_over_the_core(
    flights: dict[str, Any], dtype: type
) -> None:
    """Algorithm 1 written out: intruder, ownship, then conflict, termination, score.

    Compilers contract products and sums, so that float32 headings come to differ by a unit in the
    last place here and there: 2e-6 rad, 100 m/s and 300 s make some centimetres. The first minute
    agrees within 1 cm. Against float64 the whole flight of up to 30 km is good to 0.5 m."""
    starts = jax.tree.map(
        lambda field: field if field.dtype == bool else field.astype(dtype), flights["starts"]
    )
    flown: Record = flights["alone"]
    heading_rounding = STEPS * 0.5 * float(np.spacing(np.float32(math.pi)))
    own, traffic, time = starts.own, intruder.start(starts.intruders, np), np.zeros(COUNT, dtype)
    for index, action in enumerate(flights["actions"].astype(dtype)):
        metres = 0.5 if dtype is np.float64 else 0.01 if index < 60 else 0.25
        before, traffic_before = own, traffic
        traffic = intruder.step(traffic, starts.intent, time[:, None], dtype(1.0), np)
        acceleration, yaw_rate = commands((action[:, 0], action[:, 1]), SURROGATE, np)
        own = advance(own, acceleration, yaw_rate, dtype(1.0), SURROGATE, np)
        time = time + dtype(1.0)
        separation = leg_separation(
            before,
            own,
            *(VehicleState(*(f[:, 0] for f in at.vehicle)) for at in (traffic_before, traffic)),
            1.0,
            np,
        )
        goal_distance = np.hypot(starts.goal_x - own.x, starts.goal_y - own.y)
        judged = outcome.judge(separation, goal_distance, time, RULES, np)

        for name, states in (("own", flown.own), ("intruders", flown.intruders)):
            expected = (
                own if name == "own" else VehicleState(*(field[:, 0] for field in traffic.vehicle))
            )
            at = VehicleState(
                *(np.asarray(field[index], np.float64).reshape(COUNT) for field in states)
            )
            assert np.max(np.hypot(at.x - expected.x, at.y - expected.y)) <= metres, (
                f"{name}, step {index}"
            )
            assert np.max(angle_between(at.heading, expected.heading)) <= heading_rounding
            np.testing.assert_allclose(at.speed, expected.speed, atol=1e-3)
        np.testing.assert_array_equal(flown.steps[index], index + 1.0)
        np.testing.assert_allclose(flown.result.separation[index], separation, atol=2.0 * metres)
        np.testing.assert_allclose(
            flown.result.goal_distance[index], goal_distance, atol=2.0 * metres
        )
        clear = (
            np.minimum(np.abs(separation - 1_000.0), np.abs(goal_distance - 500.0)) > 2.0 * metres
        )
        for field, expected in zip(flown.result.outcome, judged, strict=True):
            np.testing.assert_array_equal(np.asarray(field[index])[clear], expected[clear])
        points = outcome.reward(judged, RULES, np)
        np.testing.assert_array_equal(np.asarray(flown.result.reward[index])[clear], points[clear])


# Algorithm 1's contract.


def test_both_aircraft_are_compared_at_the_same_times() -> None:
    """In trail at equal speed the range stays 1010 m; comparing one old and one new position would
    see 910 m.
    """
    for leader, follower in (((1_010.0, 0.0), (0.0, 0.0)), ((0.0, 0.0), (1_010.0, 0.0))):
        starts = one_on_one((*follower, 0.0, 100.0), (*leader, 0.0, 100.0))
        _, result = step(reset(starts), STILL, WORLD)
        np.testing.assert_allclose(result.separation, 1_010.0, atol=1e-2)
        assert not result.outcome.violation[0]


def test_a_pass_inside_a_step_is_a_violation() -> None:
    """Crossing so that only the middle of the step is within 1000 m."""
    starts = one_on_one((0.0, 0.0, 0.0, 100.0), (100.0, 998.0, -math.pi, 100.0))
    after, result = step(reset(starts), STILL, WORLD)
    ends = (
        np.hypot(starts.intruders.x - starts.own.x, starts.intruders.y),
        np.hypot(after.intruders.vehicle.x - after.own.x, after.intruders.vehicle.y - after.own.y),
    )
    assert min(float(end[0, 0]) for end in ends) > 1_002.0
    assert result.outcome.violation[0]
    np.testing.assert_allclose(result.separation, 998.0, atol=0.05)
    assert float(result.reward[0]) == -100.0


def test_the_score_is_given_for_where_the_step_ends() -> None:
    """The step that arrives within the goal radius is rewarded, not the one after it."""
    starts = one_on_one((0.0, 0.0, 0.0, 100.0), (0.0, 9_000.0, 0.0, 50.0), goal=(650.0, 0.0))
    state, result = step(reset(starts), STILL, WORLD)
    assert (float(result.goal_distance[0]), bool(result.outcome.reached[0])) == (550.0, False)
    assert float(result.reward[0]) == 0.0
    _, result = step(state, STILL, WORLD)
    assert (float(result.goal_distance[0]), bool(result.outcome.reached[0])) == (450.0, True)
    assert float(result.reward[0]) == 100.0


def test_the_observation_shows_both_aircraft_after_they_moved(flights: dict[str, Any]) -> None:
    flown, starts = flights["alone"], flights["starts"]
    for index in (0, 1, 150):
        own = VehicleState(*(np.asarray(field[index], np.float64) for field in flown.own))
        opponent = VehicleState(
            *(np.asarray(field[index, :, 0], np.float64) for field in flown.intruders)
        )
        expected = observation.observe(own, opponent, starts.goal_x, starts.goal_y, PAPER, np)
        np.testing.assert_allclose(
            np.cos(np.pi * flown.observation[index]), np.cos(np.pi * expected), atol=1e-4
        )
        assert flown.observation.dtype == jnp.float32
        assert np.max(np.abs(flown.observation[index])) <= 1.0


def test_the_intruders_controller_acts_in_the_very_first_step_and_by_the_time_before_it() -> None:
    """An intent for 0 s turns in the first step, one for 0.5 or 1 s in the second."""
    starts = encounters("circle", count=FEW)
    onset = np.array([[0.0], [0.5], [1.0], [2.0]], np.float32)
    intent = Intent(onset, np.full((FEW, 1), 1.0, np.float32), np.full((FEW, 1), 0.05, np.float32))
    state = reset(starts._replace(intent=intent))
    headings = [starts.intruders.heading]
    for _ in range(2):
        state, _ = step(state, STILL, WORLD)
        headings.append(np.asarray(state.intruders.vehicle.heading))
    turned = np.stack([angle_between(b, a)[:, 0] for a, b in itertools.pairwise(headings)])
    np.testing.assert_allclose(turned, [[0.05, 0.0, 0.0, 0.0], [0.05, 0.05, 0.05, 0.0]], atol=1e-5)


def test_the_clock_ends_an_episode_with_step_300(flights: dict[str, Any]) -> None:
    judged = flights["alone"].result.outcome
    assert not np.any(judged.timeout[:-1])
    busy = np.asarray(judged.violation[-1] | judged.reached[-1])
    np.testing.assert_array_equal(judged.timeout[-1], ~busy)
    assert not busy.all()


def test_a_step_leaves_its_inputs_data_alone() -> None:
    state = reset(encounters("maneuvering", count=FEW))
    after, _ = step(state, (np.ones(FEW, np.float32), np.ones(FEW, np.float32)), WORLD)
    for name in ("goal_x", "goal_y", "mask", "intent", "sensor"):
        pairs = zip(
            *(jax.tree.leaves(getattr(stepped, name)) for stepped in (after, state)), strict=True
        )
        for after_field, before_field in pairs:
            np.testing.assert_array_equal(after_field, before_field)


# Resets.


def test_restart_begins_afresh_only_where_an_encounter_ended() -> None:
    """Rows: a violation, a goal, a time-out, and one that goes on."""
    nobody = (0.0, 9_000.0, 0.0, 50.0)
    rows = [
        one_on_one((0.0, 0.0, 0.0, 100.0), (1_100.0, 0.0, -math.pi, 100.0)),
        one_on_one((0.0, 0.0, 0.0, 100.0), nobody, goal=(550.0, 0.0)),
        one_on_one((0.0, 0.0, 0.0, 100.0), nobody),
        one_on_one((0.0, 0.0, 0.0, 100.0), nobody),
    ]
    starts = jax.tree.map(
        lambda *fields: np.stack([field[row] for row, field in enumerate(fields)]), *rows
    )
    state = reset(starts)._replace(steps=np.float32([5.0, 7.0, 299.0, 11.0]))
    fresh = reset(encounters("maneuvering", count=FEW))
    action = (np.full(FEW, 0.3, np.float32), np.full(FEW, -0.2, np.float32))
    final, result = step(state, action, WORLD)
    following = restart(final, fresh)

    np.testing.assert_array_equal(np.stack(result.outcome), np.eye(4, dtype=bool)[:3])
    np.testing.assert_array_equal(result.reward, [-100.0, 100.0, -10.0, 0.0])
    np.testing.assert_array_equal(following.steps, [0.0, 0.0, 0.0, 12.0])
    np.testing.assert_array_equal(following.ended, [False, False, False, False])
    np.testing.assert_array_equal(final.ended, [True, True, True, False])
    np.testing.assert_array_equal(final.steps, [6.0, 8.0, 300.0, 12.0])
    for after, end, begin in zip(*map(jax.tree.leaves, (following, final, fresh)), strict=True):
        np.testing.assert_array_equal(after[:3], begin[:3])
        np.testing.assert_array_equal(after[3], end[3])


def test_restart_also_replaces_the_reports_history() -> None:
    starts, replacements = encounters("noisy", count=FEW), encounters("noisy", count=FEW, seed=9)
    state = reset(starts, history_dt=1.0)._replace(steps=np.float32([299.0, 20.0, 20.0, 20.0]))
    fresh = reset(replacements, history_dt=1.0)
    final, _ = step(state, STILL, WORLD)
    following = restart(final, fresh)
    for after, end, begin in zip(
        *(jax.tree.leaves(s.previous) for s in (following, final, fresh)), strict=True
    ):
        np.testing.assert_array_equal(after[0], begin[0])
        np.testing.assert_array_equal(after[1:], end[1:])


# Several intruders.


def test_absent_intruders_do_not_matter(flights: dict[str, Any]) -> None:
    """K = 3 with two absent flies, sees and scores as K = 1 does."""
    alone, wide = flights["alone"], flights["wide"]
    results = [
        flown.result._replace(separations=flown.result.separations[..., :1])
        for flown in (alone, wide)
    ]
    for narrow, broad in ((alone.own, wide.own), results):
        for a, b in zip(jax.tree.leaves(narrow), jax.tree.leaves(broad), strict=True):
            np.testing.assert_allclose(b, a, rtol=1e-6, atol=1e-2)
    difference = np.abs(np.asarray(wide.observation) - np.asarray(alone.observation))
    assert np.max(np.minimum(difference, 2.0 - difference)) < 1e-5
    np.testing.assert_array_equal(wide.result.outcome.violation, alone.result.outcome.violation)


def test_an_absent_intruder_may_sit_on_top_of_the_ownship() -> None:
    starts = pad(one_on_one((0.0, 0.0, 0.0, 80.0), (6_000.0, 100.0, -math.pi, 80.0)), 8, np)
    for column in (0, 7):
        on_top = starts.intruders._replace(x=starts.intruders.x.copy(), y=starts.intruders.y.copy())
        on_top.x[:, column] = on_top.y[:, column] = 0.0
        mask = np.tile(np.arange(8) != column, (FEW, 1))
        state = reset(starts._replace(intruders=on_top, mask=mask))
        _, result = step(state, STILL, WORLD)
        assert not result.outcome.violation[0]
        assert float(result.separation[0]) > 5_800.0
        np.testing.assert_allclose(observe(state)[:, 5], 0.6001 - 1.0, atol=1e-3)


def test_the_nearest_of_several_intruders_decides() -> None:
    wide = encounters("multi", most=8, count=FEW)
    state = reset(wide)
    _, together = step(state, STILL, WORLD)
    singly = []
    for column in range(8):
        only = state._replace(mask=wide.mask & (np.arange(8) == column))
        singly.append(step(only, STILL, WORLD)[1].separation)
    np.testing.assert_allclose(together.separation, np.min(singly, axis=0), atol=1e-3)
    assert np.isinf(np.asarray(singly)[-1]).any()


# Symmetry.


def test_a_mirrored_episode_stays_mirrored(flights: dict[str, Any]) -> None:
    """Mirrored starts and actions: mirrored flight within 25 cm, mirrored observations, the same
    outcome.
    """
    starts = flights["starts"]
    intent = starts.intent._replace(heading_change=-starts.intent.heading_change)
    mirrored_starts = starts._replace(
        own=mirror_state(starts.own),
        goal_y=-starts.goal_y,
        intruders=mirror_state(starts.intruders),
        intent=intent,
    )
    flown, mirrored = (
        flights["alone"],
        fly(reset(mirrored_starts), flights["actions"] * np.float32([1.0, -1.0])),
    )
    for a, b in ((flown.own, mirrored.own), (flown.intruders, mirrored.intruders)):
        np.testing.assert_allclose(b.x, a.x, atol=0.25)
        np.testing.assert_allclose(b.y, -a.y, atol=0.25)
        assert np.max(angle_between(b.heading, -np.asarray(a.heading))) < 1e-5
    sign = np.float32([1, -1, 1, -1, 1, 1, 1, 1])
    turn = np.isin(np.arange(8), [1, 3, 4, 6])
    sign[[4, 6]] = -1
    difference = np.abs(np.asarray(mirrored.observation) - sign * np.asarray(flown.observation))
    difference = np.where(turn, np.minimum(difference, 2.0 - difference), difference)
    # Within 100 m a bearing turns by more than 1e-3 half turns with those 25 cm.
    near = np.min(np.asarray(flown.observation)[..., [5, 7]], axis=-1) < -0.99
    assert np.max(difference[~near]) < 1e-3
    clear = np.abs(np.asarray(flown.result.separation) - 1_000.0) > 0.5
    np.testing.assert_array_equal(
        np.asarray(mirrored.result.outcome.violation)[clear],
        np.asarray(flown.result.outcome.violation)[clear],
    )
