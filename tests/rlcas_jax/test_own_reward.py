"""The table of rewards, and terms of a stranger's module: in the environments, and in training."""

import json
import re
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agents.config.load import ConfigError, dump, load
from envs import world
from envs.aircraft import PAPER
from envs.outcome import RULES, Outcome
from envs.rewards import (
    REWARD_TERMS,
    TERMS,
    RewardError,
    Term,
    Transition,
    learning_reward,
    register,
    table,
)
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from rlcas_jax.config import TrainConfig
from rlcas_jax.loop import prepare
from tests.stranger import python, python_blocks, settle

ROOT = Path(__file__).resolve().parents[2]
MODULE, CALLS = python_blocks("howto/own-reward.md")
WEIGHTS = {"my_rewards:close": -2.0, "my_rewards:slow": -20.0, "my_rewards:clear": 5.0}
TINY = (
    "steps=64",
    "network={hidden: [8], encoder: [6]}",
    "environments=8",
    "rollout=4",
    "ppo={minibatch: 32, segment: 4}",
    "pool_rows=2",
    "family.share=0.5",
    "evaluation={encounters: 4, final_encounters: 4}",
)
OWN = tuple(f"rewards.{name}={weight}" for name, weight in WEIGHTS.items())


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a working directory with the page's module, of which nothing has been imported."""
    return settle(tmp_path, monkeypatch, REWARD_TERMS, my_rewards=MODULE)


def make_transition(count: int = 200, seed: int = 0) -> Transition:
    """Return a step of random encounters near the end, numpy."""
    starts = encounters_of_seed(scenario("multi", PAPER, radius=(600.0, 3_000.0)), seed, 0, count)
    before = world.begin(starts, np)
    random = np.random.default_rng(seed)
    action = random.uniform(-2.0, 2.0, count), random.uniform(-2.0, 2.0, count)
    after, result = world.step(before, action, world.World(RULES, PAPER), np)
    return Transition(before, after, action, result, PAPER)


def test_the_module_of_the_page_is_short():
    assert len(MODULE.splitlines()) <= 40


def test_a_reward_is_its_scaled_sum_and_scores_are_the_task_alone():
    step = make_transition()
    found, parts = learning_reward(table(WEIGHTS | {"turn_rate": -3.0}), step, 0.9, np, 0.01)
    sparse = -100.0 * step.result.outcome.violation + 100.0 * step.result.outcome.reached
    near = np.clip(2.0 - step.result.separation / 1_000.0, 0.0, 1.0)
    np.testing.assert_allclose(parts["my_rewards:close"], -0.02 * near)
    turned = np.clip(step.action[1], -1.0, 1.0) ** 2
    rest = parts["my_rewards:clear"] + parts["my_rewards:slow"]
    expected = 0.01 * (sparse - 2.0 * near - 3.0 * turned) + rest
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert near.any()


def test_a_potential_is_paid_as_its_discounted_gain():
    step = make_transition()
    _, parts = learning_reward(table({"my_rewards:clear": 3.0}), step, 0.9, np)
    module = sys.modules["my_rewards"]
    before, after = (module.room(one, PAPER, np) for one in (step.before, step.after))
    expected = 0.9 * np.where(step.after.ended, 0.0, after) - before
    np.testing.assert_allclose(parts["my_rewards:clear"], 3.0 * expected)
    assert step.after.ended.any()
    assert not step.after.ended.all()


def test_numpy_and_jax_agree_for_every_term():
    step = make_transition()
    every = table(dict.fromkeys(TERMS, 1.0) | WEIGHTS)
    plain = learning_reward(every, step, 0.99, np, 0.5)
    compiled = jax.jit(lambda one: learning_reward(every, one, 0.99, jnp, 0.5))(step)
    np.testing.assert_allclose(plain[0], compiled[0], rtol=1e-4, atol=2e-3)
    assert plain[1].keys() == compiled[1].keys()


def test_rows_of_the_task_are_the_rules():
    config = load(TrainConfig, None, ["rewards.timeout=-70", "rewards.goal_distance=3"])
    assert config.rules() == RULES._replace(reward_timeout=-70.0)
    assert [row.name for row in config.rewards.table().rows] == [
        "violation",
        "goal",
        "timeout",
        "goal_distance",
    ]
    assert load(TrainConfig, None).rules() == RULES


def test_the_shipped_policys_reward_stands_whole_in_one_file():
    """Every row that the policy file's training used is written in configs/best.yaml."""
    text = (ROOT / "configs/best.yaml").read_text(encoding="utf-8")
    for phase in load(TrainConfig, ROOT / "configs/best.yaml").phase_configs():
        for row in phase.rewards.table().rows:
            assert re.search(rf"\b{row.name}: {row.weight:g}\b(\.0)?", text), row.name


def test_names_survive_and_import_nothing(tmp_path: Path):
    config = load(TrainConfig, None, list(OWN))
    (tmp_path / "dump.yaml").write_text(dump(config), encoding="utf-8")
    again = load(TrainConfig, tmp_path / "dump.yaml")
    assert again == config
    assert again.rewards.weights().items() >= WEIGHTS.items()
    assert "my_rewards" not in sys.modules
    assert {row.name for row in again.rewards.table().shaping} == set(WEIGHTS)
    assert "my_rewards" in sys.modules


def test_a_phase_changes_the_rows_that_it_names():
    phases = "phases=[{steps: 5}, {rewards: {'my_rewards:close': 7.0}}]"
    first, second = load(TrainConfig, None, [*OWN, phases]).phase_configs()
    assert first.rewards.weights() | {"my_rewards:close": 7.0} == second.rewards.weights()


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("rewards.turn=1", "turn is unknown; expected one of violation, .*did you mean turn_rate"),
        ("rewards.my_rewards:close=fast", "my_rewards:close is 'fast'; expected a number"),
        ("rewards.goal=1e9", "rewards.goal is .* expected a number at least -1000000"),
    ],
)
def test_rows_that_cannot_be_are_refused(override: str, message: str):
    with pytest.raises(ConfigError, match=message):
        load(TrainConfig, None, [override])


def test_names_and_things_that_are_none_are_refused():
    with pytest.raises(RewardError, match="'wind' is unknown; expected one of violation, goal"):
        table({"wind": 1.0})
    with pytest.raises(RewardError, match="no module 'no_such_module'"):
        table({"no_such_module:close": 1.0})
    with pytest.raises(RewardError, match="'math:pi' is of type float"):
        table({"math:pi": 1.0})
    with pytest.raises(RewardError, match="'goal' ships"):
        register("goal", TERMS["goal"])
    missing = load(TrainConfig, None, ["rewards.no_such_module:close=1"])
    with pytest.raises(ConfigError, match="rewards: no_such_module:close: no module"):
        missing.rewards.table()


@pytest.mark.parametrize(
    ("compute", "message"),
    [
        (lambda step, xp: step.wind, "reward 'mine': fails with AttributeError"),
        (lambda step, xp: step.before.intruders.vehicle.x, r"computes shape \(64, 1\).*\(64,\)"),
        (lambda step, xp: step.before.goal_x * np.nan, "'mine': is not finite"),
        (
            lambda step, xp: np.asarray(step.before.goal_x),
            r"'mine': fails with Tracer.*; use xp.* \(.*test_own_reward.py, line \d+\)",
        ),
    ],
)
def test_a_term_that_cannot_be_used_is_refused_before_a_training(
    compute: Any, message: str, tmp_path: Path
):
    register("mine", Term(compute, "Nothing."))
    config = load(TrainConfig, None, [*TINY, "rewards.mine=1"])
    with pytest.raises(RewardError, match=message):
        prepare(config, tmp_path / "run")


def test_the_environments_pay_the_same_table():
    pytest.importorskip("gymnasium")
    from envs.gym.gymnasium_env import DeconflictionEnv
    from envs.gym.gymnasium_vector import DeconflictionVectorEnv

    weights = WEIGHTS | {"turn_rate": -3.0, "goal_distance": 50.0, "timeout": -55.0}
    chosen = scenario("multi", PAPER, intruders=(3, 3), radius=(1_500.0, 3_000.0))
    single = DeconflictionEnv(chosen, intruders=3, rewards=weights, discount=0.99)
    bare = DeconflictionEnv(chosen, intruders=3)
    many = DeconflictionVectorEnv(4, chosen, intruders=3, rewards=weights, discount=0.99)
    assert single.world.rules == RULES._replace(reward_timeout=-55.0)
    for one in (single, bare, many):
        one.reset(seed=3)
    for _ in range(5):
        action = np.array([0.3, -0.5], np.float32)
        _, paid, ended, _, _ = single.step(action)
        _, sparse, _, _, _ = bare.step(action)
        _, batch, _, _, _ = many.step(np.tile(action, (4, 1)))
        assert paid == pytest.approx(batch[0], abs=0.02)
        assert paid != sparse
        if ended:
            break


def test_gymnax_pays_the_same_table():
    pytest.importorskip("gymnax")
    from rlcas_jax.gymnax_env import Deconfliction

    env = Deconfliction("circle", rewards=WEIGHTS | {"turn_rate": -3.0}, discount=0.99)
    params = env.default_params
    _, state = env.reset_env(jax.random.key(0), params)
    action = jnp.array([0.3, 1.0])
    _, after, paid, _, info = env.step_env(jax.random.key(1), state, action, params)
    seen = Transition(
        state.encounter,
        after.encounter,
        (action[0], action[1]),
        SimpleNamespace(
            separation=info["separation"],
            reward=0.0,
            outcome=Outcome(info["violation"], info["reached"], jnp.array(False)),
        ),  # pyright: ignore[reportArgumentType]
        PAPER,
    )
    expected, _ = learning_reward(env.rewards, seen, 0.99, jnp)
    assert float(paid) == pytest.approx(float(expected), abs=1e-4)


@pytest.mark.slow
@pytest.mark.long
def test_a_stranger_trains_evaluates_compares_and_reports(folder: Path):
    sets = [part for text in (*TINY, *OWN) for part in ("--set", text)]
    python(folder, "-m", "rlcas_jax.train", *sets, "--out", "run")
    lines = (folder / "run/metrics.jsonl").read_text().splitlines()
    for line in map(json.loads, lines):
        assert line["reward_my_rewards:close"] <= 0.0
        assert {f"reward_{name}" for name in (*WEIGHTS, "goal", "timeout")} <= line.keys()
    policy = ("--policy", "run/policy.safetensors")
    python(folder, "-m", "eval.monte_carlo", *policy, "--encounters", "20", "--out", "mc")
    beside = ("--encounters", "10", "--baseline", "none", "--out", "beside")
    python(folder, "-m", "eval.compare", *policy, *beside)
    python(folder, "-m", "eval.report", "mc", "--tracks", "5")
    python(folder, "-c", CALLS)

    reading = (
        "import sys; from agents.policy.file import read\n"
        "from agents.inference import Policy\n"
        "metadata = read('run/policy.safetensors').metadata\n"
        "Policy.load('run/policy.safetensors')\n"
        "assert 'my_rewards' not in sys.modules\n"
        "print(metadata['training']['config']['rewards']['my_rewards:close'])"
    )
    assert python(folder, "-c", reading).stdout == "-2.0\n"
