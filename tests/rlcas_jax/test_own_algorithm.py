"""A learning algorithm from a stranger's module: it learns, trains, resumes, and is refused in one
sentence where it cannot be used.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agents.config.load import ConfigError, dump, load, validate
from agents.learning.algorithm import Setup
from agents.learning.networks import Actor, Critic
from agents.policy import file as policy_file
from commands.command import InputError
from envs.rewards import Term
from envs.scenarios import SHIPPED
from rlcas_jax import algorithm as own_algorithm
from rlcas_jax import metrics
from rlcas_jax.algorithm import algorithm_of, register
from rlcas_jax.config import TrainConfig
from rlcas_jax.loop import prepare
from rlcas_jax.training import Extensions, _config_of, resume, train
from tests.probes import Probe, train_on_probe
from tests.stranger import block_with, names_of, python, run, settle

MODULE = block_with("howto/own-algorithm.md", "class ActorCritic")
TINY = {
    "name": "tiny",
    "algorithm": "my_algorithm:ActorCritic",
    "algorithm_settings": {"gae_lambda": 0.9},
    "network": {"hidden": [8], "feature_set": "mirror"},
    "environments": 8,
    "rollout": 4,
    "pool_rows": 2,
    "evaluation": {"every_steps": 64, "encounters": 4, "final_encounters": 4},
    "checkpoint": {"every_seconds": 0.0},
    "phases": [{"steps": 64}, {"steps": 96, "environments": 16}],
}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a working directory in which there is no module yet."""
    return settle(tmp_path, monkeypatch, own_algorithm.ALGORITHMS)


def test_the_module_of_the_page_is_short():
    assert len(MODULE.splitlines()) <= 40


# It learns: the two hardest probes of PPO.

ACTOR, CRITIC = Actor((16,), "none"), Critic((16,), "none")
ACTOR_CRITIC = names_of(MODULE, "my_algorithm")["ActorCritic"]


def with_discount(discount: Any) -> Any:
    return ACTOR_CRITIC(Setup(ACTOR, CRITIC, discount, None))


def test_it_learns_which_action_pays_for_which_observation():
    probe = Probe(shows_sign=1.0, target=0.0, target_by_sign=0.5)
    state = train_on_probe(with_discount, 1_000, 1e-2, probe)
    mean, log_std = ACTOR.apply(state.actor, np.float32([[1.0, 0.0], [-1.0, 0.0]]))
    np.testing.assert_allclose(mean[:, 0], [0.5, -0.5], atol=0.15)
    assert log_std[0] < -1.0


def test_it_learns_what_a_later_reward_is_worth():
    probe = Probe(shows_clock=1.0, length=2.0, pays=1.0, discount=0.7)
    state = train_on_probe(with_discount, 1_000, 1e-2, probe)
    value: Any = CRITIC.apply(state.critic, np.float32([[0.0, 1.0], [0.0, 0.0]]))
    np.testing.assert_allclose(value, [1.0, 0.7], atol=0.1)


# What cannot be used is refused in one sentence.


class State(NamedTuple):
    actor: Any


class Still:
    """Learns nothing."""

    several_devices = True

    def __init__(self, setup: Setup) -> None:
        self.actor = setup.actor

    def init(self, key: jax.Array, blank: Any) -> Any:
        return State(self.actor.init(key, blank))

    def act(self, state: Any, observation: Any, noise: jax.Array) -> tuple[jax.Array, Any]:
        return noise, None

    def update(self, state: Any, rollout: Any, key: jax.Array, rate: jax.Array) -> Any:
        return state, {}


class Actorless(Still):
    def init(self, key: jax.Array, blank: Any) -> Any:
        return {"weights": jnp.zeros(3)}


class Failing(Still):
    def update(self, state: Any, rollout: Any, key: jax.Array, rate: jax.Array) -> Any:
        raise RuntimeError("no gradient\nat all")


class Growing(Still):
    def update(self, state: Any, rollout: Any, key: jax.Array, rate: jax.Array) -> Any:
        return jax.tree.map(lambda leaf: leaf.astype(jnp.float16), state), {}


class Sized(Still):
    """Has a buffer of a rollout, whose size depends on the phase."""

    def init(self, key: jax.Array, blank: Any) -> Any:
        return State(self.actor.init(key, blank) | {"buffer": jnp.zeros(next(SIZES))})


class Formless:
    def __init__(self, setup: Setup) -> None:
        self.update = None


class Wanting(Still):
    def __init__(self, setup: Setup, clip: float) -> None:
        super().__init__(setup)


SIZES = iter(range(1, 100))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (Actorless, "its state has no actor; expected a named tuple with the field actor"),
        (Failing, r"fails with RuntimeError: no gradient \(.*test_own_algorithm.py, line \d+\)$"),
        (Growing, "an update of phase 0 changes its state from .*float32.* to .*float16"),
        (Sized, "phase 1 changes its state from .* to .*"),
        (Formless, r"has no init, act; expected init, act and update"),
        (Wanting, "fails with TypeError: .*'clip'"),
    ],
)
def test_an_algorithm_that_cannot_be_used_is_refused(make: Any, message: str, tmp_path: Path):
    config = validate(TrainConfig, TINY | {"algorithm": "x:y", "algorithm_settings": {}})
    config = config.model_copy(update={"algorithm": register(make)})
    with pytest.raises(ConfigError, match=f"algorithm .*{message}") as raised:
        prepare(config, tmp_path)
    assert "\n" not in str(raised.value)


def test_a_mistake_is_reported_with_its_line(folder: Path):
    wrong = MODULE.replace("known[1:], ends", "known[2:], ends")
    (folder / "my_algorithm.py").write_text(wrong, encoding="utf-8")
    line = next(i for i, text in enumerate(wrong.splitlines(), 1) if "known[2:]" in text)
    with pytest.raises(ConfigError, match=rf"fails with .*\(my_algorithm.py, line {line}\)$"):
        prepare(validate(TrainConfig, TINY), folder)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["algorithm=pp0"], "algorithm is 'pp0'; expected ppo, or module:name of your own"),
        (["algorithm_settings.clip=0.1"], "algorithm_settings has clip; expected none"),
        (["algorithm=no_such_module:Mine"], "algorithm: no_such_module:Mine: no module"),
        (["algorithm=math:pi"], "algorithm math:pi: fails with TypeError"),
    ],
)
def test_names_and_settings_that_lead_nowhere_are_refused(changes: list[str], message: str):
    with pytest.raises(ConfigError, match=message):
        algorithm_of(load(TrainConfig, None, changes))


def test_a_setting_that_it_does_not_know_is_refused(folder: Path):
    (folder / "my_algorithm.py").write_text(MODULE, encoding="utf-8")
    changes = ["algorithm=my_algorithm:ActorCritic", "algorithm_settings.decay=0.9"]
    with pytest.raises(ConfigError, match="unexpected keyword argument 'decay'"):
        algorithm_of(load(TrainConfig, None, changes))


def test_several_devices_are_for_algorithms_that_know_of_them():
    config = load(TrainConfig, None, [f"algorithm={register(ACTOR_CRITIC)}"])
    with pytest.raises(ConfigError, match="does not say several_devices; expected one device"):
        algorithm_of(config, "encounters")
    config = load(TrainConfig, None, [f"algorithm={register(Still)}"])
    assert isinstance(algorithm_of(config, "encounters"), Still)


@pytest.mark.parametrize("thing", [3, lambda setup: None])
def test_only_what_has_a_name_is_registered(thing: Any):
    with pytest.raises(InputError, match=r"algorithm is .*; expected a class or a function"):
        register(thing)


@pytest.mark.parametrize("form", ["keys", "configuration", "file"])
def test_extensions_of_a_call_are_named_in_its_configuration(form: str, folder: Path):
    given = {key: value for key, value in TINY.items() if key != "algorithm"}
    config: Any = given
    if form == "configuration":
        config = validate(TrainConfig, TINY | {"algorithm": "another:Algorithm"})
    if form == "file":
        config = folder / "tiny.yaml"
        config.write_text(json.dumps(given))  # JSON is YAML, too
    found = _config_of(config, Extensions(algorithm=ACTOR_CRITIC))
    assert found == validate(TrainConfig, TINY)


def test_scenarios_and_rewards_of_a_call_are_known_by_their_names():
    """Objects of a notebook's own, which no module holds."""
    extensions = Extensions(
        scenarios={"again": SHIPPED["circle"]},
        rewards={"waiting": Term(lambda step, xp: xp.ones_like(step.after.own.x), "a step")},
    )
    given = {"scenarios": [{"name": "again"}], "rewards": {"waiting": -0.5}}
    found = _config_of(given, extensions)
    assert [one.name for one in found.training_scenarios()] == ["again"]
    assert [row.weight for row in found.rewards.table().rows if row.name == "waiting"] == [-0.5]
    assert set(given["rewards"]) <= set(found.rewards.weights())


def test_a_written_configuration_names_it():
    config = validate(TrainConfig, TINY)
    assert "algorithm: my_algorithm:ActorCritic" in dump(config)
    assert "gae_lambda: 0.9" in dump(config)


# A training with it, as a stranger runs it.


def logged_rows(directory: Path) -> list[dict[str, float]]:
    """Return the logged rows without what depends on the clock."""
    rows = [json.loads(line) for line in (directory / metrics.FILE).read_text().splitlines()]
    return [
        {name: value for name, value in row.items() if name not in metrics.WALL_CLOCK}
        for row in rows
    ]


class Stopped(Exception):
    """Ends a training as a fault in a callback does."""


@pytest.mark.slow
def test_a_python_call_trains_calls_back_and_resumes_bit_for_bit(folder: Path):
    given = {key: value for key, value in TINY.items() if key != "algorithm"}
    extensions = Extensions(algorithm=ACTOR_CRITIC)
    seen: list[Mapping[str, float]] = []
    whole = train(given, "whole", extensions=extensions, callback=seen.append)
    assert whole == json.loads(Path("whole/summary.json").read_text())
    assert [row["update"] for row in seen] == [1, 2, 3]
    assert [row["algorithm/mean_value"] for row in seen] == pytest.approx(
        [row["algorithm/mean_value"] for row in logged_rows(Path("whole"))]
    )
    with pytest.raises(ConfigError, match="whole exists and is not empty"):
        train(given, "whole", extensions=extensions)

    def stop(row: Mapping[str, float]) -> None:
        if row["update"] == 2:
            raise Stopped

    with pytest.raises(Stopped):
        train(given, "parts", extensions=extensions, callback=stop)
    with pytest.raises(ConfigError, match="no module 'my_algorithm'"):
        own_algorithm.ALGORITHMS.own.clear()
        resume("parts")
    resume("parts", extensions=extensions)
    assert logged_rows(Path("parts")) == logged_rows(Path("whole"))
    assert Path("parts/policy.safetensors").read_bytes() == (
        Path("whole/policy.safetensors").read_bytes()
    )


@pytest.mark.slow
@pytest.mark.long
def test_a_stranger_trains_resumes_and_evaluates_it(tmp_path: Path):
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "my_algorithm.py").write_text(MODULE, encoding="utf-8")
    family = {"network": {"hidden": [8], "encoder": [6]}, "family": {"share": 0.5}}
    config = validate(TrainConfig, TINY | family)
    (mine / "tiny.yaml").write_text(dump(config), encoding="utf-8")
    python(mine, "-m", "rlcas_jax.train", "--config", "tiny.yaml", "--out", "run")
    whole = (mine / "run/policy.safetensors").read_bytes()
    rows = logged_rows(mine / "run")
    assert not {"std_acceleration", "std_yaw_rate", "entropy"} & set(rows[0])
    drawn = {path.name for path in (mine / "run/figures").glob("*.png")}
    assert drawn == {"episode_reward.png", "training.png"}

    # The newest checkpoint is lost, as by a kill before it: the run goes on from the one before.
    max((mine / "run/checkpoints").glob("*.safetensors")).unlink()
    (mine / "run/policy.safetensors").unlink()
    python(mine, "-m", "rlcas_jax.train", "--resume", "run")
    assert (mine / "run/policy.safetensors").read_bytes() == whole
    assert logged_rows(mine / "run") == rows

    content = policy_file.read(mine / "run/policy.safetensors")
    assert content.metadata["training"]["config"]["algorithm"] == "my_algorithm:ActorCritic"
    (mine / "my_algorithm.py").unlink()
    without = run(mine, "-m", "rlcas_jax.train", "--resume", "run")
    assert without.returncode == 2
    assert "algorithm: my_algorithm:ActorCritic: no module 'my_algorithm'" in without.stderr
    assert "Traceback" not in without.stderr
    flight = ("--policy", "run/policy.safetensors", "--encounters", "20", "--workers", "1")
    flown = run(mine, "-m", "eval.monte_carlo", *flight, "--set", "figures=false", "--out", "one")
    assert flown.returncode == 0, flown.stderr
