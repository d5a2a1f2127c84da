"""What a policy in training is kept to, and how a policy goes on with more inputs."""

import math
from functools import cache
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agents import export, policy_file
from agents.configuration import ConfigError
from agents.features import FEATURE_SETS, begins, features, size
from agents.networks import Actor, derived
from agents.ppo import met_by
from envs import surrogate
from envs.kinematics import SURROGATE, VehicleState, advance, commands
from envs.observation import observe
from rlcas_jax import metrics
from rlcas_jax.beginning import actor_with, policy_at
from rlcas_jax.config import TrainConfig
from rlcas_jax.escapes import best
from rlcas_jax.loop import Run, run
from rlcas_jax.progress import Reporter
from rlcas_jax.starts import edges
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


def after_a_second(state: surrogate.State, acceleration: jax.Array, turn: jax.Array) -> np.ndarray:
    """Return what the best manoeuvre keeps after a second of commands in [-1, 1], m, ``[N]``; true states."""
    own = advance(state.own, *commands((acceleration, turn), SURROGATE, jnp), 1.0, SURROGATE, jnp)
    others = advance(state.intruders.vehicle, 0.0, 0.0, 1.0, SURROGATE, jnp)
    return np.asarray(best(own, state.goal_x, state.goal_y, others, state.mask, jnp))


def test_the_best_second_leaves_the_most_of_all_seconds() -> None:
    state = pressed_states()
    scenes = surrogate.observe(state)
    # Most are not looked at for want of time: twelve times over, all of these are.
    seen = derived(jnp.tile(scenes, (12, 1)), "pressed")
    action, decided = (np.asarray(field) for field in best_second(seen))
    looked = np.flatnonzero(np.any(action != 0.0, axis=1) | np.any(decided != 0.0, axis=1))
    rows, first = np.unique(looked % len(scenes), return_index=True)
    assert len(rows) > 40
    action, decided = action[looked[first]], decided[looked[first]]
    state = jax.tree.map(lambda field: field[rows], state)
    left = after_a_second(state, jnp.asarray(action[:, 0]), jnp.asarray(action[:, 1]))
    still = np.ones(len(rows), np.float32)
    for acceleration in (-1.0, 0.0, 1.0):
        for turn in (-1.0, 0.0, 1.0):
            other = after_a_second(state, jnp.asarray(acceleration * still), jnp.asarray(turn * still))
            assert (other <= left + 0.05).all()
            # Who is told to do one thing would lose by the other.
            for told, which in zip(decided.T, ((acceleration, action[:, 0]), (turn, action[:, 1])), strict=True):
                apart = np.abs(which[0] - which[1]) > 0.5
                assert (other < left)[apart & (told > 0.6)].all()
    assert (decided > 0.9).any(axis=0).all()


def test_the_best_second_of_a_mirrored_scene_is_its_mirror_image() -> None:
    scenes = pressed_scenes(50)
    mirrored = scenes * jnp.array([1.0, -1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0])
    (one, how), (other, how_other) = (best_second(derived(each, "pressed")) for each in (scenes, mirrored))
    np.testing.assert_allclose(one, other * jnp.array([1.0, -1.0]), atol=1e-5)
    np.testing.assert_allclose(how, how_other, atol=1e-3)
    assert np.asarray(how).any()


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
    low, high, weight = (np.asarray(field) for field in taught(seen, held))
    for bound, kept, urgent in zip((low, high), flown(mean, seen, SURROGATE), met_by(manoeuvre), strict=True):
        np.testing.assert_allclose(bound, np.where(pressed, urgent, kept), atol=1e-6)
    np.testing.assert_allclose(weight, np.where(pressed, 3.0 * near, 2.0 * held[:, None]), rtol=1e-6)
    alone = teacher(told(None, pressed=3.0))
    assert alone is not None
    assert not np.asarray(alone(seen, held).weight)[~pressed].any()
    assert teacher(told(None)) is None


def homeward(scene: VehicleState, goal_x: jax.Array, goal_y: jax.Array, *, unwinding: bool) -> np.ndarray:
    """Return how close those come to their goals who turn to them at the limit, m; the intruder is far away."""
    far = VehicleState(*(jnp.full(scene.x.shape, value) for value in (-15e3, 0.0, math.pi, 60.0)))
    closest = jnp.full(scene.x.shape, jnp.inf)
    for _ in range(200):
        seen = derived(observe(scene, far, goal_x, goal_y, jnp), "pressed")
        told = around(seen, SURROGATE)[..., 1] > 0.0
        turn = jnp.where(told & unwinding, 0.0, jnp.sign(seen.inputs[..., 9]) * seen.hand)
        scene = advance(scene, *commands((-jnp.ones_like(turn), turn), SURROGATE, jnp), 1.0, SURROGATE, jnp)
        closest = jnp.minimum(closest, jnp.hypot(goal_x - scene.x, goal_y - scene.y))
    return np.asarray(closest)


def test_who_is_told_to_fly_straight_on_would_circle_around_the_goal_and_then_does_not() -> None:
    rng = np.random.default_rng(8)
    count = 300
    at, off = jnp.asarray(rng.uniform(-math.pi, math.pi, count)), jnp.asarray(rng.uniform(550.0, 2_500.0, count))
    goal_x, goal_y = off * jnp.cos(at), off * jnp.sin(at)
    still = jnp.zeros(count)
    own = VehicleState(still, still, still, jnp.full(count, SURROGATE.speed_min))
    far = VehicleState(*(jnp.full(count, value) for value in (-15e3, 0.0, math.pi, 60.0)))
    told = np.asarray(around(derived(observe(own, far, goal_x, goal_y, jnp), "pressed"), SURROGATE))
    assert not told[:, 0].any()
    circling = homeward(own, goal_x, goal_y, unwinding=False) > 500.0
    assert circling.sum() > 20
    assert (told[circling, 1] > 0.9).all()
    assert (homeward(own, goal_x, goal_y, unwinding=True) < 500.0).all()
    # Who is faster can still slow down, and who is pressed has other worries.
    faster = observe(own._replace(speed=own.speed + 10.0), far, goal_x, goal_y, jnp)
    assert not np.asarray(around(derived(faster, "pressed"), SURROGATE)).any()
    beside = VehicleState(goal_x * 0.0 + 100.0, goal_y * 0.0 + 1_010.0, still, jnp.full(count, 60.0))
    assert not np.asarray(around(derived(observe(own, beside, goal_x, goal_y, jnp), "pressed"), SURROGATE)).any()
    with pytest.raises(
        ConfigError, match=r"practice\.unwind is 1 with network\.feature_set mirror; expected foresight"
    ):
        teacher(TrainConfig.model_validate({"network": {"feature_set": "mirror"}, "practice": {"unwind": 1.0}}))


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
