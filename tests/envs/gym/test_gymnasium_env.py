"""The Gymnasium environments fly the surrogate's encounters and keep Gymnasium's contract."""

import math
import subprocess
import sys
from functools import partial
from typing import Any

import gymnasium
import jax
import numpy as np
import pytest
from gymnasium import error
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.passive_env_checker import env_render_passive_checker
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from envs import scenarios, starts, surrogate
from envs.aircraft import PAPER, Aircraft, new_aircraft
from envs.encounters import Encounter, EncounterError
from envs.gym import flight
from envs.gym.gymnasium_env import ENV_ID, DeconflictionEnv
from envs.gym.gymnasium_vector import DeconflictionVectorEnv
from envs.intruder import Intent
from envs.kinematics import Limits, VehicleState
from envs.observation import criticality
from envs.outcome import RULES
from envs.perception import Sensor
from envs.rewards import RewardError
from envs.scenarios import SCENARIOS, scenario
from envs.trees import take

INFO_KEYS = {"separation", "min_separation", "goal_distance", "time", "outcome", "encounter"}
STRAIGHT = np.zeros(2, np.float32)
SHORT = RULES._replace(t_max=3.0)


def encounter(
    own=(-5000.0, 0.0, 0.0, 75.0), intruder=(0.0, 8000.0, 0.0, 75.0), goal=(5000.0, 0.0)
) -> Encounter:
    return Encounter(
        VehicleState(*own),
        *goal,
        VehicleState(*([value] for value in intruder)),
        [True],
        Intent([0.0], [0.0], [0.05]),
        Sensor([0.0], [0.0], [0.0]),
    )


def batch(row: Encounter, count: int) -> Encounter:
    single = starts.check_encounter(row, PAPER)
    return jax.tree.map(lambda field: np.repeat(field[None], count, axis=0), single)


def actions(steps: int, *batch_shape: int) -> np.ndarray:
    """Slowly changing commands, beyond the limits at times."""
    phase = np.arange(steps).reshape(-1, *(1,) * len(batch_shape)) + 7.0 * np.arange(
        math.prod(batch_shape)
    )
    return np.stack([1.3 * np.sin(phase / 9.0), 1.1 * np.cos(phase / 17.0)], axis=-1).astype(
        np.float32
    )


def vector(count: int, **options) -> DeconflictionVectorEnv:
    env = gymnasium.make_vec(
        ENV_ID, num_envs=count, vectorization_mode="vector_entry_point", **options
    )
    assert isinstance(env, DeconflictionVectorEnv)
    return env


@pytest.mark.parametrize("render_mode", [None, "rgb_array"])
@pytest.mark.parametrize("scenario", ["circle", "noisy", "multi"])
def test_the_environment_passes_gymnasiums_own_check(render_mode, scenario):
    env = gymnasium.make(
        f"envs.gym.gymnasium_env:{ENV_ID}", scenario=scenario, render_mode=render_mode
    )
    # Every mode is checked once in the test below, and "human", where there is a display, in
    # test_rendering.py.
    check_env(env.unwrapped, skip_render_check=True)
    if render_mode:
        env.reset(seed=0)
        env_render_passive_checker(env.unwrapped)
    env.close()


def test_check_env_passes_without_a_display(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    env = gymnasium.make(f"envs.gym.gymnasium_env:{ENV_ID}")
    assert env.unwrapped.metadata["render_modes"] == ["rgb_array"]
    check_env(env.unwrapped)
    monkeypatch.setenv("DISPLAY", ":0")
    assert gymnasium.make(f"envs.gym.gymnasium_env:{ENV_ID}").unwrapped.metadata[
        "render_modes"
    ] == [
        "rgb_array",
        "human",
    ]


def test_the_single_environment_needs_neither_jax_nor_matplotlib():
    code = (
        f"import sys, gymnasium; env = gymnasium.make('envs.gym.gymnasium_env:{ENV_ID}'); "
        "env.reset(seed=0); "
        "env.step(env.action_space.sample()); assert not {'jax', 'matplotlib'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@partial(jax.jit, static_argnums=3)
def surrogate_flight(drawn, commands, noise, late):
    """Observations before, and states and results after each step."""

    def step(state, now):
        action, draws = now
        observed = surrogate.observe(state, PAPER, draws if late else None)
        state, result = surrogate.step(
            state, (action[:, 0], action[:, 1]), surrogate.World(RULES, PAPER)
        )
        return state, (observed, state.own, state.intruders.vehicle, result)

    return jax.lax.scan(
        step, surrogate.reset(drawn, history_dt=1.0 if late else None), (commands, noise)
    )[1]


@pytest.mark.parametrize("scenario", list(SCENARIOS))
def test_flight_in_floats_is_the_surrogate_within_a_micrometre(scenario):
    count, steps, late = 4, 300, scenario == "noisy"
    drawn = starts.encounters_of_seed(scenarios.scenario(scenario, PAPER), 11, 0, count)
    commands = actions(steps, count)
    noise = np.zeros((steps, 4, count, drawn.mask.shape[1]))
    if late:
        for step, i in np.ndindex(steps, count):
            noise[step, :, i] = starts.report_noise(11, i, step, drawn.mask.shape[1])
    with jax.enable_x64(True):
        history = jax.device_get(surrogate_flight(drawn, commands.astype(float), noise, late))
    for i in range(count):
        flown = flight.begin(take(drawn, i), 1.0)
        for step in range(steps):
            observed, own, traffic, result = jax.tree.map(
                lambda field, at=(step, i): field[at], history
            )
            mine = flight.observe(flown, PAPER, noise[step, :, i] if late else None)
            np.testing.assert_allclose(mine, observed, atol=1e-7)
            flown, mine_result = flight.step(
                flown, tuple(commands[step, i].tolist()), surrogate.World(RULES, PAPER)
            )
            assert abs(mine_result.separation - result.separation) < 1e-6
            assert mine_result.reward == result.reward
            assert math.hypot(flown.own.x - own.x, flown.own.y - own.y) < 1e-6
            for k, state in enumerate(flown.intruders):
                assert (
                    math.hypot(state.vehicle.x - traffic.x[k], state.vehicle.y - traffic.y[k])
                    < 1e-6
                )


@pytest.mark.parametrize("scenario", ["circle", "multi"])
def test_vector_and_single_environment_agree_step_by_step(scenario):
    count, steps = 5, 120
    environments = (
        vector(count, scenario=scenario),
        [DeconflictionEnv(scenario) for _ in range(count)],
    )
    together, singles = environments
    observations, infos = together.reset(seed=21)
    for i, env in enumerate(singles):
        observation, info = env.reset(seed=21, options={"encounter": i})
        np.testing.assert_allclose(observation, observations[i], atol=2e-6)
        assert info["separation"] == pytest.approx(infos["separation"][i], abs=0.05)
    commands = actions(steps, count)
    going = np.ones(count, bool)
    for step in range(steps):
        observations, reward, terminated, truncated, infos = together.step(commands[step])
        for i in np.flatnonzero(going):
            observation, gain, end, limit, info = singles[i].step(commands[step, i])
            assert (gain, end, limit) == (reward[i], terminated[i], truncated[i])
            over = end or limit
            theirs = infos["final_info"] if over else infos
            # Single precision at 10 km, over the steps flown.
            np.testing.assert_allclose(
                observation, infos["final_obs"][i] if over else observations[i], atol=2e-5
            )
            for key in ("separation", "min_separation", "goal_distance"):
                assert theirs[key][i] == pytest.approx(info[key], abs=0.1)
            assert (theirs["time"][i], theirs["outcome"][i]) == (info["time"], info["outcome"])
            assert theirs["encounter"][i] == info["encounter"] == i
            going[i] = not over
    assert not going.all()


def test_infos_have_the_form_of_gymnasiums_own_vector_environment():
    ours = vector(3, rules=SHORT)
    theirs = SyncVectorEnv(
        [lambda: DeconflictionEnv(rules=SHORT) for _ in range(3)],
        autoreset_mode=AutoresetMode.SAME_STEP,
    )
    assert ours.metadata["autoreset_mode"] == theirs.metadata["autoreset_mode"]
    for name in (
        "observation_space",
        "action_space",
        "single_observation_space",
        "single_action_space",
    ):
        assert getattr(ours, name) == getattr(theirs, name)

    def form(value):
        if isinstance(value, dict):
            return {key: form(part) for key, part in value.items()}
        return (
            [type(part) for part in value] if value.dtype == object else (value.dtype, value.shape)
        )

    assert form(ours.reset(seed=0)[1]) == form(theirs.reset(seed=0)[1])
    for _ in range(4):
        mine, yours = ours.step(np.zeros((3, 2))), theirs.step(np.zeros((3, 2), np.float32))
        assert [form(part) for part in mine] == [form(part) for part in yours]
        assert ("final_obs" in mine[4]) == mine[3].any()


def test_an_encounter_that_ends_begins_anew_in_the_same_step():
    count, seed = 700, 3
    rules = SHORT._replace(separation=0.0, goal_radius=0.0)
    env = vector(count, rules=rules)
    env.reset(seed=seed)
    single = DeconflictionEnv(rules=rules)
    for step in range(1, 13):
        observations, reward, terminated, truncated, infos = env.step(np.full((count, 2), 0.5))
        assert not terminated.any()
        assert truncated.all() == truncated.any() == (step % 3 == 0)
        np.testing.assert_array_equal(reward, -10.0 * truncated)
        if not truncated.any():
            assert "final_obs" not in infos
            continue
        # The starts are the seed's, each used once, through several refills of the reserve.
        begun = count * (step // 3)
        np.testing.assert_array_equal(infos["encounter"], begun + np.arange(count))
        np.testing.assert_array_equal(
            infos["final_info"]["encounter"], begun - count + np.arange(count)
        )
        np.testing.assert_array_equal(infos["time"], 0.0)
        np.testing.assert_array_equal(infos["final_info"]["time"], 3.0)
        for index in (0, 350, count - 1):
            first, _ = single.reset(seed=seed, options={"encounter": begun + index})
            np.testing.assert_allclose(observations[index], first, atol=2e-6)
            single.reset(seed=seed, options={"encounter": begun - count + index})
            for _ in range(3):
                last, *_ = single.step(np.full(2, 0.5))
            np.testing.assert_allclose(infos["final_obs"][index], last, atol=5e-6)


def test_only_what_has_ended_begins_anew():
    close = encounter(intruder=(-3000.0, 0.0, -math.pi, 75.0))
    rows = jax.tree.map(
        lambda a, b: np.stack([a, b]),
        *(starts.check_encounter(e, PAPER) for e in (close, encounter())),
    )
    env = vector(2)
    env.reset(seed=0, options={"encounter": rows})
    for _ in range(7):
        _, reward, terminated, _, infos = env.step(np.zeros((2, 2)))
        if terminated.any():
            break
    assert terminated.tolist() == [True, False]
    assert reward.tolist() == [-100.0, 0.0]
    assert infos["encounter"].tolist() == [0, -1]
    assert infos["_final_obs"].tolist() == infos["_final_info"].tolist() == [True, False]
    assert infos["final_obs"][1] is None
    assert infos["final_info"]["outcome"].tolist() == ["violation", None]
    assert infos["final_info"]["separation"][0] < 1000.0 < infos["separation"][0]
    _, after, *_ = env.step(np.zeros((2, 2)))
    assert after.tolist() == [0.0, 0.0]


def test_seeds_repeat_and_differ():
    def fly_both(seed, name):
        together, single = vector(4, scenario=name), DeconflictionEnv(name)
        rows = [together.reset(seed=seed)[0], single.reset(seed=seed)[0]]
        for command in actions(5, 4):
            rows += [together.step(command)[0], single.step(command[0])[0]]
        return np.concatenate(
            [row.ravel() for row in [*rows, together.reset()[0], single.reset()[0]]]
        )

    for name in ("circle", "noisy"):
        np.testing.assert_array_equal(fly_both(7, name), fly_both(7, name))
        assert not np.allclose(fly_both(7, name), fly_both(8, name))
    assert not np.allclose(DeconflictionEnv().reset()[0], DeconflictionEnv().reset()[0])
    # The largest seed that gymnasium draws for itself is far beyond 32 bit.
    assert vector(4, scenario="noisy").reset(seed=2**64 - 1)[0].shape == (4, 8)


def test_noise_differs_from_step_to_step_and_goes_on_after_a_reset():
    standing = batch(encounter(), 4)._replace(
        sensor=Sensor(*(np.full((4, 1), value) for value in (30.0, 3.0, 1.0)))
    )
    env = vector(4, scenario="noisy")
    first, _ = env.reset(seed=0, options={"encounter": standing})
    again, _ = env.reset(options={"encounter": standing})
    rows = np.concatenate([first, again])[:, 5]
    assert len(np.unique(rows)) == 8
    assert np.all(np.abs(rows - rows.mean()) < 0.02)


@pytest.mark.parametrize(
    ("name", "start", "rules", "reward", "terminated"),
    [
        ("violation", encounter(intruder=(-3000.0, 0.0, -math.pi, 75.0)), RULES, -100.0, True),
        ("reached", encounter(goal=(-3900.0, 0.0)), RULES, 100.0, True),
        ("timeout", encounter(), SHORT, -10.0, False),
        # A violation outweighs the goal, and the goal the time limit, in the same step.
        (
            "violation",
            encounter(intruder=(-4100.0, 0.0, 0.0, 75.0), goal=(-4450.0, 0.0)),
            RULES,
            -100.0,
            True,
        ),
        ("reached", encounter(goal=(-4300.0, 0.0)), SHORT, 100.0, True),
    ],
)
def test_how_an_encounter_ends(name, start, rules, reward, terminated):
    env, together = DeconflictionEnv(rules=rules), vector(2, rules=rules)
    env.reset(seed=0, options={"encounter": start})
    together.reset(seed=0, options={"encounter": batch(start, 2)})
    total, over, info = 0.0, False, {}
    while not over:
        assert info.get("outcome", "flying") == "flying"
        _, gain, end, limit, info = env.step(STRAIGHT)
        _, gains, ends, limits, infos = together.step(np.zeros((2, 2)))
        assert (gain, end, limit) == (gains[0], ends[0], limits[0])
        total, over = total + gain, end or limit
    assert (info["outcome"], total, end, limit) == (name, reward, terminated, not terminated)
    assert infos["final_info"]["outcome"][0] == name
    assert info["encounter"] == -1
    with pytest.raises(error.ResetNeeded, match=f"has ended \\({name}\\); call reset"):
        env.step(STRAIGHT)


def test_a_violation_within_a_step_counts():
    # They pass each other head on at 200 m/s, 995 m apart only in the middle of a step.
    start = encounter(own=(-300.0, 0.0, 0.0, 100.0), intruder=(0.0, 995.0, -math.pi, 100.0))
    env = DeconflictionEnv()
    _, info = env.reset(options={"encounter": start})
    _, _, over, _, first = env.step(STRAIGHT)
    assert not over
    _, reward, over, _, info = env.step(STRAIGHT)
    assert first["separation"] > 1000.0 > info["separation"]
    assert (over, reward) == (True, -100.0)


def test_scenario_and_number_can_be_chosen_at_reset():
    for env in (DeconflictionEnv(), vector(2)):
        observation, info = env.reset(
            seed=4, options={"scenario": "head_on", "encounter": np.int64(9)}
        )
        expected = starts.encounters_of_seed(scenarios.scenario("head_on", PAPER), 4, 9, 1)
        own = np.ravel(observation)[1] * math.pi
        assert own == pytest.approx(expected.own.heading[0], abs=1e-5)
        assert np.ravel(info["encounter"])[0] == 9
        assert np.ravel(env.reset()[1]["encounter"])[0] == 9 + np.size(info["encounter"])
        assert env.unwrapped.scenario.name == "head_on"


def test_one_row_of_drawn_encounters_can_be_given():
    drawn = starts.encounters_of_seed(scenarios.scenario("multi", PAPER), 2, 0, 4)
    env = DeconflictionEnv("multi")
    observation, _ = env.reset(seed=1, options={"encounter": take(drawn, 3)})
    again, _ = env.reset(options={"encounter": take(drawn, slice(3, 4))})
    own, _ = env.reset(seed=2, options={"encounter": 3})
    np.testing.assert_array_equal(observation, own)
    np.testing.assert_array_equal(again, own)


# Observations of several intruders in Gymnasium, of any aircraft: a Dict space that a peer's
# learner trains on.


UAS = new_aircraft(Limits(18.0, 36.0, -0.5, 0.5, np.radians(10.0)), 610.0)
BOTH = pytest.mark.parametrize(
    "make", [DeconflictionEnv, lambda *of, **options: DeconflictionVectorEnv(2, *of, **options)]
)


@pytest.mark.parametrize(("aircraft", "intruders"), [(UAS, 1), (UAS, 4), (PAPER, 12)])
def test_the_set_environment_passes_gymnasiums_own_check(
    aircraft: Aircraft, intruders: int
) -> None:
    env = gymnasium.make(
        f"envs.gym.gymnasium_env:{ENV_ID}", scenario="multi", aircraft=aircraft, intruders=intruders
    )
    check_env(env.unwrapped, skip_render_check=True)


def test_the_most_critical_come_first_and_absent_ones_last() -> None:
    env = DeconflictionEnv("multi", intruders=10)
    for number in range(6):
        observation, _ = env.reset(seed=3, options={"encounter": number})
        start = starts.encounters_of_seed(scenario("multi", PAPER), 3, number, 1)
        rank = criticality(
            type(start.own)(*(field[:, None] for field in start.own)), start.intruders, PAPER, np
        )[0]
        order = np.argsort(rank[start.mask[0]])
        count = len(order)
        assert observation["mask"].tolist() == [1] * count + [0] * (10 - count)
        np.testing.assert_allclose(
            observation["traffic"][:count, 0],
            start.intruders.speed[0, order] / 75.0 - 1.0,
            atol=1e-6,
        )
        assert not observation["traffic"][count:].any()
        of_two, _ = DeconflictionEnv("multi", intruders=2).reset(
            seed=3, options={"encounter": number}
        )
        np.testing.assert_array_equal(of_two["traffic"], observation["traffic"][:2])
        paper_observation, _ = DeconflictionEnv("multi").reset(
            seed=3, options={"encounter": number}
        )
        np.testing.assert_array_equal(paper_observation[[2, 3, 4, 5]], observation["traffic"][0])
        np.testing.assert_array_equal(paper_observation[[0, 1, 6, 7]], observation["own"])


def test_vector_and_single_environment_agree() -> None:
    settings: dict[str, Any] = {"scenario": "multi", "aircraft": UAS, "intruders": 3}
    together, singles = (
        DeconflictionVectorEnv(3, **settings),
        [DeconflictionEnv(**settings) for _ in range(3)],
    )
    assert together.single_observation_space == singles[0].observation_space
    observations, _ = together.reset(seed=5)
    alone = [env.reset(seed=5, options={"encounter": i})[0] for i, env in enumerate(singles)]
    action = np.float32([0.3, -0.8])
    for _ in range(4):
        assert together.observation_space.contains(observations)
        for i, observation in enumerate(alone):
            for key, value in observation.items():
                np.testing.assert_allclose(observations[key][i], value, atol=5e-5)
        observations, _, ended, *_ = together.step(np.stack([action] * 3))
        alone = [env.step(action)[0] for env in singles]
        assert not ended.any()


def test_the_last_observation_of_an_encounter_is_a_dict() -> None:
    env = DeconflictionVectorEnv(2, intruders=2, rules=PAPER.rules()._replace(t_max=1.0))
    env.reset(seed=0)
    *_, truncated, infos = env.step(np.zeros((2, 2)))
    assert truncated.all()
    assert env.single_observation_space.contains(infos["final_obs"][0])


@BOTH
@pytest.mark.parametrize("intruders", [0, -1, 65, 1.5, True, "many"])
def test_a_number_of_intruders_that_cannot_be_seen_is_refused(make: Any, intruders: Any) -> None:
    with pytest.raises(
        EncounterError, match=r"^intruders is .*expected a whole number from 1 to 64"
    ):
        make(intruders=intruders)


@BOTH
def test_the_scenario_of_another_aircraft_is_refused(make: Any) -> None:
    with pytest.raises(EncounterError, match="another aircraft"):
        make(scenario("circle", PAPER), aircraft=UAS)


@pytest.mark.slow
def test_stable_baselines_trains_its_policy_for_dicts_unchanged() -> None:
    peer = pytest.importorskip("stable_baselines3")
    logger = pytest.importorskip("stable_baselines3.common.logger")
    env = gymnasium.make(
        f"envs.gym.gymnasium_env:{ENV_ID}", scenario="multi", aircraft=UAS, intruders=4
    )
    model = peer.PPO(
        "MultiInputPolicy", env, n_steps=128, batch_size=64, n_epochs=2, seed=0, device="cpu"
    )
    model.set_logger(logger.Logger(None, []))  # by default it leaves a folder
    before = [parameter.detach().clone() for parameter in model.policy.parameters()]
    model.learn(256)
    assert any(
        (old != new).any() for old, new in zip(before, model.policy.parameters(), strict=True)
    )
    action, _ = model.predict(env.reset(seed=1)[0], deterministic=True)
    assert env.action_space.contains(action)


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), "much", True])
def test_a_reward_that_is_no_finite_number_is_refused(bad: Any) -> None:
    for name in ("goal", "turn_rate"):
        with pytest.raises(RewardError, match=rf"reward '{name}' weighs .*; expected a finite"):
            DeconflictionEnv(rewards={name: bad})
    if isinstance(bad, float):
        with pytest.raises(EncounterError, match=r"rules\.reward_goal is .*; expected a finite"):
            DeconflictionEnv(rules=PAPER.rules()._replace(reward_goal=bad))
