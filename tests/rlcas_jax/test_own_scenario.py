"""A scenario from a stranger's module: drawn, refused, trained with, evaluated, reported."""

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agents.config.load import ConfigError, load
from commands.extension import load_extension
from envs.aircraft import PAPER
from envs.encounters import EncounterError, Sampler
from envs.scenarios import SAMPLERS, register, resolve, sample, scenario
from envs.starts import encounters_of_seed
from envs.trees import map_leaves, take
from eval.config import MonteCarloConfig
from eval.evidence.outside import training_box
from rlcas_jax.config import TrainConfig
from rlcas_jax.loop import prepare
from tests.stranger import python, python_blocks, run, settle
from tests.support import pool_of

MODULE, CALLS = python_blocks("howto/own-scenario.md")
NAME = "my_scenarios:trail"
TINY = (
    "steps=64",
    "network={hidden: [8], encoder: [6]}",
    "environments=8",
    "rollout=4",
    "ppo={minibatch: 32, segment: 4}",
    "pool_rows=2",
    "family.share=0.5",
    "scenarios=[{name: circle}, {name: 'my_scenarios:trail', radius: [4000, 6000]}]",
    "evaluation={encounters: 4, final_encounters: 4}",
)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a working directory with the page's module, of which nothing has been imported."""
    return settle(tmp_path, monkeypatch, SAMPLERS, my_scenarios=MODULE)


def test_the_module_of_the_page_is_short():
    assert len(MODULE.splitlines()) <= 40


def test_traffic_flies_in_trail_and_one_of_it_meets_the_ownship():
    resolve(NAME)
    drawn = encounters_of_seed(scenario(NAME, PAPER), 3, 0, 500)
    assert drawn.mask.all()
    assert drawn.mask.shape == (500, 4)
    gaps = np.hypot(np.diff(drawn.intruders.x), np.diff(drawn.intruders.y))
    np.testing.assert_allclose(gaps, 4_000.0)
    arrival = -drawn.own.x / drawn.own.speed
    there = np.hypot(
        drawn.intruders.x + (arrival * drawn.intruders.speed.T).T * np.cos(drawn.intruders.heading),
        drawn.intruders.y + (arrival * drawn.intruders.speed.T).T * np.sin(drawn.intruders.heading),
    )
    np.testing.assert_allclose(there.min(axis=-1), 0.0, atol=1e-6)


def test_an_encounter_is_the_same_in_any_company_and_in_jax():
    resolve(NAME)
    chosen = scenario(NAME, PAPER)
    many = encounters_of_seed(chosen, 3, 0, 50)
    alone = encounters_of_seed(chosen, 3, 17, 1)
    map_leaves(np.testing.assert_array_equal, take(many, slice(17, 18)), alone)
    draws = np.random.default_rng(1).random((2, 100, chosen.dimensions), np.float32)
    plain, accepted = sample(chosen, draws.astype(float), np)
    compiled, also = jax.jit(lambda one: sample(chosen, one, jnp))(draws)
    np.testing.assert_array_equal(accepted, also)
    map_leaves(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-5, atol=0.1), plain, compiled)


def test_its_numbers_are_changed_as_those_of_the_scenarios_that_ship():
    resolve(NAME)
    changed = scenario(NAME, PAPER, own_speed=(60.0, 61.0), intruders=(2, 2))
    drawn = encounters_of_seed(changed, 0, 0, 50)
    assert drawn.mask.shape == (50, 2)
    assert ((drawn.own.speed >= 60.0) & (drawn.own.speed <= 61.0)).all()
    with pytest.raises(EncounterError, match=r"^own_speed is \[10, 61\]"):
        scenario(NAME, PAPER, own_speed=(10.0, 61.0))


def test_it_takes_modifiers_that_its_sampler_heeds():
    name = f"{NAME} + noise + standing + partly_seen"
    config = load(TrainConfig, None, [*TINY[:6], f"scenarios=[{{name: '{name}'}}]"])
    assert [one.name for one in config.training_scenarios()] == [
        f"{NAME} + noise + standing + partly_seen"
    ]
    drawn = encounters_of_seed(scenario(name, PAPER), 3, 0, 100, heeds=("coverage",))
    assert (drawn.sensor.position_std == 30.0).all()
    assert drawn.coverage is not None
    assert (drawn.intruders.speed == 0.0).mean() == pytest.approx(0.25, abs=0.05)
    with pytest.raises(EncounterError, match=r"trail \+ turns': its sampler does not heed .*turns"):
        encounters_of_seed(scenario(f"{NAME} + turns", PAPER), 3, 0, 4)


def test_a_name_alone_imports_nothing():
    """Neither a configuration's check nor what a policy file says runs the user's code."""
    config = load(MonteCarloConfig, None, [f"scenario={NAME}"])
    load(TrainConfig, None, list(TINY))
    missing = rf"scenario '{NAME}' is not part of the toolkit.*--extension {NAME}"
    with pytest.raises(ConfigError, match=missing):
        config.sampled_scenario(PAPER)
    with pytest.raises(EncounterError, match=missing):
        scenario(NAME, PAPER)
    trained = {"scenarios": [{"name": "circle"}, {"name": NAME}], "phases": []}
    policy: Any = SimpleNamespace(
        metadata={"training": {"config": trained}},
        inputs=SimpleNamespace(own_size=1, intruder_size=1),
        aircraft=PAPER,
        most=4,
    )
    with pytest.raises(ConfigError, match=missing):
        training_box(policy, 1, 0)
    assert "my_scenarios" not in sys.modules


def test_a_training_loads_what_its_configuration_names():
    config = load(TrainConfig, None, list(TINY))
    assert [one.name for one in config.training_scenarios()] == ["circle", NAME]
    assert config.training_scenarios()[1].radius == (4_000.0, 6_000.0)
    assert "my_scenarios" in sys.modules


def test_the_environments_take_the_name():
    pytest.importorskip("gymnasium")
    from envs.gym.gymnasium_env import DeconflictionEnv

    env = DeconflictionEnv(NAME, intruders=4)
    observation, _ = env.reset(seed=5)
    assert observation["mask"].sum() == 4
    with pytest.raises(EncounterError, match="no module 'no_such_module'"):
        DeconflictionEnv("no_such_module:trail")


def broken(function: Any) -> Any:
    """Return the scenario of the page with what its function returns changed."""
    page = load_extension(NAME, "a scenario")
    register(
        "mine",
        page._replace(
            encounters=lambda scenario, draws, xp: function(
                *page.encounters(scenario, draws, xp), xp
            )
        ),
    )
    return scenario("mine", PAPER)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda one, accepted, xp: one, "returns Encounter; expected an"),
        (lambda one, accepted, xp: (one, accepted[:, None]), r"accepted of shape \(8, 1\)"),
        (
            lambda one, accepted, xp: (one._replace(mask=one.mask[:, :1]), accepted),
            r"mask of shape \(8, 1\); expected \(8, 4\)",
        ),
        (
            lambda one, accepted, xp: (
                one._replace(own=one.own._replace(speed=3.0 * one.own.speed)),
                accepted,
            ),
            r"scenario 'mine': own\.speed is .*; expected within 50\.\.100",
        ),
        (
            lambda one, accepted, xp: (one._replace(goal_x=one.goal_x * np.nan), accepted),
            r"scenario 'mine': goal_x is nan; expected a finite number",
        ),
        (lambda one, accepted, xp: one.no_such_field, "sampler fails with AttributeError"),
    ],
)
def test_a_sampler_that_cannot_be_used_is_refused(function: Any, message: str):
    with pytest.raises(EncounterError, match=message):
        encounters_of_seed(broken(function), 0, 0, 8)


def test_what_only_numpy_can_do_is_refused_before_a_training_begins(tmp_path: Path):
    broken(lambda one, accepted, xp: (one._replace(goal_x=np.abs(one.goal_x)), accepted))
    config = load(TrainConfig, None, [*TINY, "scenarios=[{name: mine}]"])
    with pytest.raises(EncounterError, match=r"'mine': its sampler fails with Tracer.*use xp"):
        prepare(config, tmp_path / "run")


def test_altitudes_are_refused_before_a_training_begins(tmp_path: Path):
    config = load(TrainConfig, None, [*TINY, "scenarios=[{name: circle + layered}]"])
    with pytest.raises(EncounterError, match="'circle \\+ layered' has a wind, areas or altitudes"):
        prepare(config, tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_names_and_things_that_are_none_are_refused():
    with pytest.raises(EncounterError, match="'trail' is unknown; expected one of circle, "):
        resolve("trail")
    with pytest.raises(EncounterError, match="math:pi' is of type float; expected a scenario"):
        resolve("math:pi")
    with pytest.raises(EncounterError, match="'circle' ships"):
        register("circle", Sampler(lambda scenario, draws, xp: None, 1, 1))
    with pytest.raises(EncounterError, match="shared is -1"):
        register("mine", Sampler(lambda scenario, draws, xp: None, -1, 1))


def test_scenarios_of_a_mixture_may_differ_in_their_intruders():
    resolve(NAME)
    mixed = [scenario("circle", PAPER), scenario(NAME, PAPER)]
    pool = pool_of(mixed, [0.5, 0.5], 2, 64)
    assert set(np.asarray(pool.mask.sum(axis=-1)).ravel().tolist()) == {1, 4}


@pytest.mark.slow
def test_a_stranger_trains_evaluates_compares_and_reports(folder: Path):
    sets = [part for text in TINY for part in ("--set", text)]
    python(folder, "-m", "rlcas_jax.train", *sets, "--out", "run")
    policy = ("--policy", "run/policy.safetensors")
    flown = (*policy, "--scenario", NAME, "--encounters", "40")
    python(folder, "-m", "eval.monte_carlo", *flown, "--workers", "2", "--out", "mc")
    assert f'"scenario": "{NAME}"' in (folder / "mc/summary.json").read_text()
    assert f"scenario: {NAME}" in (folder / "mc/config.yaml").read_text()
    python(folder, "-m", "eval.compare", *flown, "--baseline", "none", "--out", "beside")

    refused = run(folder, "-m", "eval.report", "mc", "--tracks", "5")
    assert refused.returncode == 2
    assert f"--extension {NAME}" in refused.stderr
    assert "Traceback" not in refused.stderr
    python(folder, "-m", "eval.report", "mc", "--tracks", "5", "--extension", NAME)
    failures = ("-m", "eval.failures", "--run", "mc", "--out", "failures", "--cases", "1")
    python(folder, *failures, "--extension", NAME)
    rare = ("--particles", "20", "--repetitions", "3", "--out", "rare")
    python(folder, "-m", "eval.rare", *policy, "--scenario", NAME, *rare)
    python(folder, "-c", CALLS)

    reading = (
        "import sys; from agents.policy.file import read\n"
        "from agents.inference import Policy\n"
        "metadata = read('run/policy.safetensors').metadata\n"
        "Policy.load('run/policy.safetensors')\n"
        "assert 'my_scenarios' not in sys.modules\n"
        "print(metadata['training']['config']['scenarios'][1]['name'])"
    )
    assert python(folder, "-c", reading).stdout == f"{NAME}\n"
