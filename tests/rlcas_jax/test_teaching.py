"""What a policy in training is kept to, and how a policy goes on with more inputs."""

import math
from collections.abc import Callable
from functools import cache
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.typing import ArrayLike

from agents.config.load import ConfigError
from agents.learning import export
from agents.learning.networks import Actor, derived
from agents.learning.ppo import met_by
from agents.policy import file as policy_file
from agents.policy.features import FEATURE_SETS, begins, features, size
from envs import surrogate
from envs.angles import wrap
from envs.kinematics import SURROGATE, VehicleState, advance, commands
from envs.observation import observe
from envs.relative import leg_separation
from rlcas_jax import metrics
from rlcas_jax.beginning import actor_with, policy_at
from rlcas_jax.config import TrainConfig
from rlcas_jax.escape_margin import best, each
from rlcas_jax.homeward import arrival_of, late, soonest
from rlcas_jax.loop import Run, run
from rlcas_jax.progress import Reporter
from rlcas_jax.promptness import Asked, prompt_second
from rlcas_jax.starts import anywhere, edges
from rlcas_jax.teaching import around, best_manoeuvre, best_second, flown, teacher

HIDDEN = (8, 8)


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A policy of the feature set ``advised`` that does something."""
    path = tmp_path_factory.mktemp("teaching") / "policy.safetensors"
    variables = Actor(HIDDEN, "advised").init(jax.random.key(1), jnp.zeros((1, 8)))
    variables = jax.tree.map(lambda leaf: leaf * 90.0 if leaf.ndim == 2 and leaf.shape[1] == 2 else leaf, variables)
    policy_file.write(path, export.to_policy_file(variables, HIDDEN, "advised", SURROGATE, {}, steps=1))
    return path


def observations(count: int = 500) -> jax.Array:
    return jnp.asarray(np.random.default_rng(5).uniform(-1.0, 1.0, (count, 8)), jnp.float32)


def told(policy: Path | None, **practice: float) -> TrainConfig:
    given = practice if policy is None else {"teacher": policy, **practice}
    return TrainConfig.model_validate({"network": {"hidden": HIDDEN, "feature_set": "pressed"}, "practice": given})


def test_each_set_begins_with_the_inputs_of_those_that_it_is_said_to_begin_with() -> None:
    seen = list(np.asarray(observations(50)).T)
    inputs = {name: np.stack(features(seen, name, np)) for name in FEATURE_SETS}
    for longer in FEATURE_SETS:
        for shorter in FEATURE_SETS:
            same = len(inputs[shorter]) <= len(inputs[longer]) and np.array_equal(
                inputs[shorter], inputs[longer][: len(inputs[shorter])]
            )
            # The bare observation is no beginning of what is derived; cpa and mirror differ in a sign.
            assert begins(longer, shorter) == same


def test_an_actor_with_more_inputs_does_what_the_policy_does(policy: Path) -> None:
    read = policy_at(policy, "start_from")
    seen = observations()
    before, _ = Actor(HIDDEN, "advised").apply(export.variables(read.actor), seen)
    after, _ = Actor(HIDDEN, "pressed").apply(actor_with(read, "pressed", "here"), seen)
    np.testing.assert_allclose(before, after, atol=1e-6)
    assert np.abs(np.asarray(before)).max() > 0.3
    with pytest.raises(ConfigError, match=r"here has network\.feature_set advised; expected foresight as in this"):
        actor_with(read, "foresight", "here")


@cache
def pressed_states(count: int = 100) -> surrogate.State:
    """Return starts within metres of the limit."""
    config = TrainConfig.model_validate({"practice": {"edges": count, "edge": 6.0}, "seed": 5})
    starts = edges(config)
    assert starts is not None
    return surrogate.reset(starts)


def pressed_scenes(count: int = 100) -> jax.Array:
    """Return observations of them."""
    return surrogate.observe(pressed_states(count))


def test_the_best_manoeuvre_is_what_keeps_most_where_nothing_else_does() -> None:
    seen = derived(pressed_scenes(), "pressed")
    first = size("mirror")
    kept = np.asarray(seen.inputs[:, first : first + 12])
    manoeuvre, near = (np.asarray(field) for field in best_manoeuvre(seen))
    best = kept.argmax(axis=1)
    np.testing.assert_array_equal(manoeuvre[:, 0], best % 3 - 1.0)
    left = np.asarray(seen.hand)[:, None] * manoeuvre[:, 1:]
    np.testing.assert_array_equal(left[best // 3 == 0], 1.0)
    np.testing.assert_array_equal(left[best // 3 == 1], -1.0)
    # Where braking and accelerating, or left and right, keep as much, nothing is to be done.
    limit = np.asarray(seen.inputs[:, -3])
    worse = kept.max(axis=1)[:, None] - kept
    otherwise = np.arange(12) % 3 != (best % 3)[:, None]
    gap = np.where(otherwise, worse, np.inf).min(axis=1)
    np.testing.assert_allclose(near[:, 0], limit * np.clip(gap / 0.01, 0.0, 1.0), atol=1e-5)
    sides = best // 3 < 2
    gap = np.where(np.arange(12) // 3 == 1 - (best // 3)[:, None], worse, np.inf).min(axis=1)
    assert (near[sides, 1] <= limit[sides] * np.clip(gap[sides] / 0.01, 0.0, 1.0) + 1e-5).all()
    assert (near > 0.9).any(axis=0).all()
    assert ((near >= 0.0) & (near <= np.asarray(seen.inputs[:, -3:-2]))).all()
    spacious = derived(observations(), "pressed")
    assert not np.asarray(best_manoeuvre(spacious)[1])[np.asarray(spacious.inputs[:, -3]) == 0.0].any()


def looked_at(scenes: jax.Array, mean: jax.Array, leave: float) -> tuple[np.ndarray, np.ndarray]:
    """Return what is told of scenes among five times as many that nothing is at stake in: of all, that is."""
    spacious = jnp.tile(jnp.array([[0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0]]), (5 * len(scenes), 1))
    seen = derived(jnp.concatenate([scenes, spacious]), "pressed")
    action, weight = (np.asarray(field) for field in best_second(seen, jnp.tile(mean, (6, 1)), leave))
    assert not weight[len(scenes) :].any()
    return action[: len(scenes)], weight[: len(scenes)]


def left_after(state: surrogate.State, action: ArrayLike) -> np.ndarray:
    """Return what a second of actions ``[N, 2]`` and then the best manoeuvre keep beyond 1000 m, m; true states."""
    pair = jnp.clip(jnp.asarray(action), -1.0, 1.0)
    own = advance(state.own, *commands((pair[:, 0], pair[:, 1]), SURROGATE, jnp), 1.0, SURROGATE, jnp)
    others = advance(state.intruders.vehicle, 0.0, 0.0, 1.0, SURROGATE, jnp)
    before, after = (VehicleState(*(field[:, None] for field in one)) for one in (state.own, own))
    meanwhile = leg_separation(before, after, state.intruders.vehicle, others, 1.0, jnp)[:, 0]
    kept = jnp.minimum(meanwhile, best(own, state.goal_x, state.goal_y, others, state.mask, jnp))
    return np.asarray(kept) - 1_000.0


def scenes_anywhere(count: int, leave: float) -> tuple[surrogate.State, jax.Array]:
    """Return starts in which little is left to lose, and what is seen there."""
    config = TrainConfig.model_validate({"practice": {"anywhere": count, "leave": leave}, "seed": 6})
    starts = anywhere(config)
    assert starts is not None
    state = surrogate.reset(starts)
    return state, surrogate.observe(state)


def test_what_is_told_leaves_as_much_as_any_second_but_for_a_tenth_of_what_is_left() -> None:
    state, scenes = scenes_anywhere(3_000, 12.0)
    mean = jnp.asarray(np.random.default_rng(7).uniform(-1.2, 1.2, (len(scenes), 2)), jnp.float32)
    action, weight = looked_at(scenes, mean, 40.0)
    left, told = left_after(state, mean), left_after(state, action)
    assert (np.abs(action[weight[:, 0] > 0.0, 0]).round(3) % 1.0 == 0.0).all()
    for acceleration in (-1.0, 0.0, 1.0):
        for turn in (-1.0, 0.0, 1.0):
            other = left_after(state, np.full((len(scenes), 2), (acceleration, turn), np.float32))
            assert (other <= told + 0.12 + 0.1 * np.maximum(left, 0.0)).all()


def test_a_command_is_taught_as_far_as_it_costs_something_where_little_is_left() -> None:
    state, scenes = scenes_anywhere(3_000, 12.0)
    mean = np.random.default_rng(7).uniform(-1.2, 1.2, (len(scenes), 2)).astype(np.float32)
    action, weight = looked_at(scenes, jnp.asarray(mean), 40.0)
    left, told = left_after(state, mean), left_after(state, action)
    assert not weight[left > 201.0].any()
    for command in range(2):
        mixed = action.copy()
        mixed[:, command] = mean[:, command]
        worse = (told - left_after(state, mixed)) / (0.1 + 0.1 * np.maximum(left, 0.0))
        little = left < 19.0
        np.testing.assert_allclose(weight[little, command], np.clip(worse[little], 0.0, 1.0), atol=0.02)
        assert (weight[:, command] <= np.clip(worse, 0.0, 1.0) + 0.02).all()
        assert (weight[little, command] > 0.9).mean() > 0.1
    # Whoever does what is told is told nothing.
    assert looked_at(scenes, jnp.asarray(action), 40.0)[1].max() < 0.05


def test_who_hesitates_between_two_sides_is_told_earlier_and_to_take_the_one_that_he_leans_to() -> None:
    # An intruder comes head on, and a turn to either side keeps as much.
    count = 60
    still, far = jnp.zeros(count), jnp.linspace(2_600.0, 4_500.0, count)
    own = VehicleState(still, still, still, still + 90.0)
    other = VehicleState(far, still, still + math.pi, still + 90.0)
    scenes = observe(own, other, still + 9e3, still, jnp)
    spare = np.asarray(
        best(
            own, still + 9e3, still, jax.tree.map(lambda field: field[:, None], other), jnp.ones((count, 1), bool), jnp
        )
    )
    for lean in (-0.05, 0.05):
        action, weight = looked_at(scenes, jnp.tile(jnp.array([[1.0, lean]]), (count, 1)), 40.0)
        told = weight[:, 1] > 0.5
        np.testing.assert_array_equal(np.sign(action[told, 1]), np.sign(lean))
        assert spare[told].max() > 1_150.0
        assert not weight[spare > 1_400.0].any()


def test_encounters_anywhere_leave_little_on_all_courses() -> None:
    config = TrainConfig.model_validate({"practice": {"anywhere": 6_000, "leave": 25.0}, "seed": 6})
    starts = anywhere(config)
    assert starts is not None
    assert starts.goal_x.shape == (6_000,)
    kept = best(starts.own, starts.goal_x, starts.goal_y, starts.intruders, starts.mask, np)
    assert ((kept > 999.9) & (kept < 1_125.1)).all()
    twelve = each(starts.own, starts.goal_x, starts.goal_y, starts.intruders, starts.mask, np)
    left, right = (np.max(twelve[side : side + 3], axis=0) for side in (0, 3))
    plenty = kept > 1_025.1
    assert 0.05 < plenty.mean() < 0.6
    assert (np.abs(left - right)[plenty] < 100.1).all()
    courses = np.degrees(np.abs(wrap(starts.intruders.heading[:, 0] - starts.own.heading, np)))
    assert (np.histogram(courses, [0, 30, 60, 90, 120, 150, 181])[0] > 100).all()
    assert anywhere(TrainConfig()) is None
    with pytest.raises(ConfigError, match=r"practice\.leave is 0\.001 m with world\.separation 1000 m: .* are such"):
        anywhere(TrainConfig.model_validate({"practice": {"anywhere": 10, "leave": 1e-3}}))


def test_the_best_second_of_a_mirrored_scene_is_its_mirror_image() -> None:
    scenes = pressed_scenes(50)
    other_side = jnp.array([1.0, -1.0])
    mirrored = scenes * jnp.array([1.0, -1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0])
    mean = jnp.tile(jnp.array([[0.3, -0.4]]), (len(scenes), 1))
    one, how = looked_at(scenes, mean, 10.0)
    other, how_other = looked_at(mirrored, mean * other_side, 10.0)
    np.testing.assert_allclose(one, other * other_side, atol=1e-5)
    np.testing.assert_allclose(how, how_other, atol=1e-3)
    assert how.any()


def test_who_has_passed_may_do_as_he_likes_however_close_he_is() -> None:
    # 1002 m abeam, ahead of the intruder and faster: of all that leads away each keeps 1002 m.
    state = VehicleState(*(jnp.full((1,), value) for value in (0.0, 0.0, 0.0, 90.0)))
    other = VehicleState(*(jnp.full((1,), value) for value in (-300.0, 956.0, 0.0, 60.0)))
    seen = derived(observe(state, other, jnp.full((1,), 9e3), jnp.zeros(1), jnp), "pressed")
    assert seen.inputs[0, -3] > 0.9
    assert not np.asarray(best_manoeuvre(seen)[1])[0, 0]


def test_at_a_speed_limit_any_throttle_does_that_leaves_the_flight_the_same() -> None:
    seen = derived(observations(400).at[:100, 0].set(1.0).at[100:200, 0].set(-1.0), "advised")
    action = jnp.asarray(np.random.default_rng(6).uniform(-1.2, 1.2, (400, 2)), jnp.float32)
    low, high = (np.asarray(bound) for bound in flown(action, seen, SURROGATE))
    plain = [np.asarray(bound) for bound in met_by(action)]
    np.testing.assert_array_equal(low[200:], plain[0][200:])
    np.testing.assert_array_equal(high[:, 1], plain[1][:, 1])
    speed = 75.0 + 25.0 * np.asarray(seen.inputs[:, 0])

    def after(throttle: np.ndarray) -> np.ndarray:
        acceleration, _ = commands((throttle, throttle), SURROGATE, np)
        return np.clip(speed + acceleration, SURROGATE.speed_min, SURROGATE.speed_max)

    for bound in (low, high):
        np.testing.assert_allclose(after(bound[:, 0]), after(np.asarray(action)[:, 0]), atol=1e-4)
    assert np.isinf(high[:100, 0])[np.asarray(action[:100, 0]) > 0.0].all()
    assert np.isinf(low[100:200, 0])[np.asarray(action[100:200, 0]) < 0.0].all()


def test_what_is_taught_is_the_teacher_where_held_and_the_best_manoeuvre_where_pressed(policy: Path) -> None:
    observed = jnp.concatenate([observations(2_000), pressed_scenes()])
    seen, held = derived(observed, "pressed"), jnp.linspace(0.0, 1.0, len(observed))
    taught = teacher(told(policy, teaching=2.0, pressed=3.0))
    assert taught is not None
    mean, _ = Actor(HIDDEN, "pressed").apply(actor_with(policy_at(policy, ""), "pressed", ""), seen)
    manoeuvre, near = best_manoeuvre(seen)
    pressed = np.asarray(near) > 0.0
    assert 0.02 < pressed.mean() < 0.5
    low, high, weight = (np.asarray(field) for field in taught(seen, held, mean, straight_on))
    for bound, kept, urgent in zip((low, high), flown(mean, seen, SURROGATE), met_by(manoeuvre), strict=True):
        np.testing.assert_allclose(bound, np.where(pressed, urgent, kept), atol=1e-6)
    np.testing.assert_allclose(weight, np.where(pressed, 3.0 * near, 2.0 * held[:, None]), rtol=1e-6)
    alone = teacher(told(None, pressed=3.0))
    assert alone is not None
    assert not np.asarray(alone(seen, held, mean, straight_on).weight)[~pressed].any()
    assert teacher(told(None)) is None


def homeward(
    scene: VehicleState, goal_x: jax.Array, goal_y: jax.Array, *, unwinding: bool, share: float = 1.0
) -> np.ndarray:
    """Return how close those come to their goals who turn to them at a share of the limit, m; nobody is near."""
    far = VehicleState(*(jnp.full(scene.x.shape, value) for value in (-15e3, 0.0, math.pi, 60.0)))
    closest = jnp.full(scene.x.shape, jnp.inf)
    for _ in range(250):
        seen = derived(observe(scene, far, goal_x, goal_y, jnp), "pressed")
        turn, weight = around(seen, SURROGATE)
        turn = jnp.where((weight > 0.0) & unwinding, turn, share * jnp.sign(seen.inputs[..., 9]) * seen.hand)
        scene = advance(scene, *commands((-jnp.ones_like(turn), turn), SURROGATE, jnp), 1.0, SURROGATE, jnp)
        closest = jnp.minimum(closest, jnp.hypot(goal_x - scene.x, goal_y - scene.y))
    return np.asarray(closest)


def goals_around(
    count: int, nearest: float, furthest: float
) -> tuple[VehicleState, VehicleState, jax.Array, jax.Array]:
    """Return who flies as slowly as can be, an intruder far away, and goals on all sides."""
    rng = np.random.default_rng(8)
    at, off = jnp.asarray(rng.uniform(-math.pi, math.pi, count)), jnp.asarray(rng.uniform(nearest, furthest, count))
    still = jnp.zeros(count)
    own = VehicleState(still, still, still, jnp.full(count, SURROGATE.speed_min))
    far = VehicleState(*(jnp.full(count, value) for value in (-15e3, 0.0, math.pi, 60.0)))
    return own, far, off * jnp.cos(at), off * jnp.sin(at)


def test_who_would_circle_around_the_goal_for_ever_is_told_to_fly_straight_on_and_then_does_not() -> None:
    own, far, goal_x, goal_y = goals_around(300, 550.0, 2_500.0)
    turn, weight = (
        np.asarray(part) for part in around(derived(observe(own, far, goal_x, goal_y, jnp), "pressed"), SURROGATE)
    )
    circling = homeward(own, goal_x, goal_y, unwinding=False) > 500.0
    assert circling.sum() > 20
    assert (weight[circling] > 0.9).all()
    assert not turn[circling].any()
    assert (homeward(own, goal_x, goal_y, unwinding=True) < 500.0).all()
    # Who is faster can still slow down, and who is pressed has other worries.
    faster = observe(own._replace(speed=own.speed + 10.0), far, goal_x, goal_y, jnp)
    assert not np.asarray(around(derived(faster, "pressed"), SURROGATE)[1]).any()
    beside = VehicleState(goal_x * 0.0 + 100.0, goal_y * 0.0 + 1_010.0, goal_x * 0.0, goal_x * 0.0 + 60.0)
    assert not np.asarray(around(derived(observe(own, beside, goal_x, goal_y, jnp), "pressed"), SURROGATE)[1]).any()


def test_who_would_circle_in_too_wide_a_turn_is_told_to_turn_as_tightly_as_he_can() -> None:
    own, far, goal_x, goal_y = goals_around(300, 1_500.0, 3_000.0)
    turn, weight = (
        np.asarray(part) for part in around(derived(observe(own, far, goal_x, goal_y, jnp), "pressed"), SURROGATE)
    )
    turning = (weight > 0.5) & (turn != 0.0)
    assert turning.mean() > 0.4
    np.testing.assert_array_equal(turn[turning], np.sign(np.asarray(goal_y))[turning])
    assert (homeward(own, goal_x, goal_y, unwinding=False, share=0.45) > 500.0).mean() > 0.2
    assert (homeward(own, goal_x, goal_y, unwinding=True, share=0.45) < 500.0).all()


def test_circles_are_left_by_a_network_that_is_told_enough() -> None:
    with pytest.raises(
        ConfigError, match=r"practice\.unwind is 1 with network\.feature_set mirror; expected foresight"
    ):
        teacher(TrainConfig.model_validate({"network": {"feature_set": "mirror"}, "practice": {"unwind": 1.0}}))


def beside(count: int) -> tuple[VehicleState, VehicleState, jax.Array, jax.Array]:
    """Return ownships, intruders beside them on nearly the same course, and goals ahead on the other side."""
    random = np.random.default_rng(6)

    def drawn(low: float, high: float) -> jax.Array:
        return jnp.asarray(random.uniform(low, high, count), jnp.float32)

    still, side = jnp.zeros(count), jnp.asarray(random.choice([-1.0, 1.0], count), jnp.float32)
    speed = drawn(65.0, 85.0)
    own = VehicleState(still, still, still, speed)
    other = VehicleState(drawn(-200.0, 200.0), side * drawn(1_050.0, 1_500.0), still, speed + drawn(-4.0, 4.0))
    return own, other, drawn(5_000.0, 8_000.0), side * drawn(2_500.0, 3_500.0)


def straight_on(observation: jax.Array) -> jax.Array:
    return jnp.zeros((len(observation), 2))


def told_to_be_prompt(observation: jax.Array, act: Callable[[jax.Array], jax.Array]) -> tuple[np.ndarray, ...]:
    """Return what is told of all at once, so that everybody is asked."""
    asked = jnp.concatenate([observation, jnp.zeros((127 * len(observation), 8)).at[:, 7].set(1.0)])
    told = jax.jit(lambda seen: prompt_second(derived(seen, "pressed"), act(seen), act))(asked)
    return tuple(np.asarray(part)[: len(observation)] for part in told)


def test_who_flies_on_beside_an_intruder_is_told_how_the_soonest_way_past_it_begins() -> None:
    own, other, goal_x, goal_y = beside(40)
    seen = observe(own, other, goal_x, goal_y, jnp)
    action, matters, free = told_to_be_prompt(seen, straight_on)
    arrival, begins = soonest(own, goal_x, goal_y, other, straight_on(seen))
    assert np.isfinite(np.asarray(arrival)).all()
    assert not free[matters > 0.0].any()
    # What is seen is rounded.
    np.testing.assert_allclose(matters, late(arrival, jnp.hypot(goal_x, goal_y)), atol=0.1)
    assert (matters > 0.0).mean() > 0.5
    alike = np.isclose(action, begins, atol=1e-3).all(axis=1)
    assert alike[matters > 0.0].mean() > 0.9  # of ways that are nearly as soon it may be another one


def test_who_arrives_as_soon_as_can_be_is_told_nothing() -> None:
    own, other, goal_x, goal_y = beside(40)
    seen = observe(own, other, goal_x, goal_y, jnp)
    arrival, _ = soonest(own, goal_x, goal_y, other, straight_on(seen))

    def home_by_then(observation: jax.Array) -> jax.Array:
        """Nobody is in the way of who flies through everybody."""
        turn = jnp.clip(observation[:, 6] * (math.pi / SURROGATE.yaw_rate_max), -1.0, 1.0)
        return jnp.stack([jnp.ones_like(turn), turn], axis=-1)

    flown = arrival_of(home_by_then, own, goal_x, goal_y, other, 200)
    assert np.asarray(flown < arrival + 30.0).all()
    _, matters, _ = told_to_be_prompt(seen, home_by_then)
    assert not matters.any()


def test_where_there_is_no_time_to_ask_nobody_is_kept_to_the_teacher(policy: Path) -> None:
    own, other, goal_x, goal_y = beside(64)
    seen = derived(observe(own, other, goal_x, goal_y, jnp), "pressed")
    both = teacher(told(policy, teaching=2.0, prompt=3.0))
    assert both is not None
    weight = np.asarray(both(seen, jnp.ones(64), jnp.zeros((64, 2)), straight_on).weight)
    _, matters, unknown = (np.asarray(part) for part in prompt_second(seen, jnp.zeros((64, 2)), straight_on))
    assert (matters > 0.0).sum() == 1  # there is time for one of 64
    assert 56 <= unknown.sum() < 64
    np.testing.assert_allclose(weight[matters > 0.0], 3.0 * matters[matters > 0.0][:, None].repeat(2, axis=1))
    np.testing.assert_array_equal(weight[unknown], 0.0)
    # Nobody is in the way, and the goal is ahead.
    free = derived(jnp.zeros((64, 8)).at[:, 4].set(1.0).at[:, 5].set(1.0), "pressed")
    np.testing.assert_array_equal(both(free, jnp.ones(64), jnp.zeros((64, 2)), straight_on).weight, 2.0)


@pytest.mark.parametrize("hand", [1.0, -1.0])
def test_who_hesitates_with_a_safe_way_home_is_told_that_way_and_urgently(hand: float) -> None:
    # Of a flight that weaved beside a slow intruder for minutes: with 1337 m between them either side is still safe,
    # straight on is not, and the goal is behind the intruder, to the right (hand 1).
    moment = jnp.asarray([-0.77067, 0.715, -0.31103, 0.93679, -0.13405, -0.86626, -0.11991, -0.81382])
    sides = jnp.asarray([1.0, hand, 1.0, hand, hand, 1.0, hand, 1.0])
    seen = derived(jnp.tile(moment * sides, (128, 1)), "pressed")
    does = jnp.tile(jnp.asarray([-1.0, 0.1 * hand]), (128, 1))

    def weaves(observation: jax.Array) -> jax.Array:
        return jnp.tile(jnp.asarray([-1.0, 0.1 * hand]), (len(observation), 1))

    lessons = {"pressed": 3.0, "prompt": 4.0, "second": True, "leave": 60.0}
    each = {}
    for name, keys in (
        ("both", lessons),
        ("pressed", lessons | {"prompt": 0.0}),
        ("prompt", lessons | {"pressed": 0.0}),
    ):
        teach = teacher(told(None, **keys), Asked(1.0, 1.0))
        assert teach is not None
        each[name] = [np.asarray(part)[0] for part in teach(seen, jnp.ones(128), does, weaves)]
    turn = {name: (bounds[0][1], bounds[1][1], bounds[2][1]) for name, bounds in each.items()}
    to_either = met_by(jnp.asarray([[0.0, hand], [0.0, -hand]]))
    (away_low, home_low), (away_high, home_high) = (np.asarray(part)[:, 1] for part in to_either)
    assert turn["pressed"][:2] == (away_low, away_high)  # as it does, to the wrong side
    assert turn["pressed"][2] == pytest.approx(3.0, abs=0.1)
    assert turn["prompt"] == (home_low, home_high, 4.0)
    assert turn["both"] == (home_low, home_high, pytest.approx(7.0, abs=0.1))


def test_a_teacher_is_kept_to_and_one_that_cannot_teach_is_refused(policy: Path, tmp_path: Path) -> None:
    def trained(name: str, **practice: object) -> Run:
        config = TrainConfig.model_validate(
            {
                "steps": 1024,
                "network": {"hidden": HIDDEN, "feature_set": "pressed"},
                "ppo": {"environments": 16, "rollout": 16, "minibatch": 64, "epochs": 4, "learning_rate": 3e-3},
                "evaluation": {"encounters": 8, "final_encounters": 8},
                "practice": practice,
                "start_from": practice.get("teacher"),
            }
        )
        (tmp_path / name).mkdir()
        return run(config, tmp_path / name, Reporter(quiet=True))

    loose, kept = (
        metrics.read(trained(name, teacher=policy, teaching=weight).directory / "metrics.jsonl")["teaching_loss"][-1]
        / weight
        for name, weight in (("loose", 1e-6), ("kept", 100.0))
    )
    assert 0.0 < kept < 0.5 * loose
    near = trained("near", teacher=policy, teaching=1e-6, teaching_near=1e-3)
    told_only_there = metrics.read(near.directory / "metrics.jsonl")["teaching_loss"][-1] / 1e-6
    assert 0.0 <= told_only_there < 0.3 * loose
    with pytest.raises(
        ConfigError, match=r"practice\.pressed is 1 with network\.feature_set advised; expected pressed"
    ):
        teacher(TrainConfig.model_validate({"network": {"feature_set": "advised"}, "practice": {"pressed": 1.0}}))
    with pytest.raises(ConfigError, match=r"practice\.teacher: .*nobody.*no such policy file"):
        teacher(told(tmp_path / "nobody"))
