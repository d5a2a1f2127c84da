"""A policy that is flown, told and learns: what it is told, what it learns, and that a run goes on where it stopped."""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.config.load import ConfigError, load
from agents.learning import export
from agents.learning.networks import Actor
from agents.policy import file as policy_file
from envs.kinematics import SURROGATE
from rlcas_jax.dagger import main, parse
from rlcas_jax.dagger_config import DaggerConfig, DaggerRun
from rlcas_jax.dagger_fit import distances, fit
from rlcas_jax.dagger_flights import Gather, Samples, gatherer, joined
from rlcas_jax.dagger_rounds import refine

HIDDEN = (8, 8)
SMALL: dict[str, Any] = {
    "network": {"hidden": HIDDEN, "feature_set": "foresight"},
    "ppo": {"environments": 16, "rollout": 8, "minibatch": 32, "segment": 4},
    "pool_rows": 2,
    # Some are slow, and the goal is within the circle of their tightest turn.
    "scenarios": [{"name": "circle", "radius": [500, 1500], "displacement": 2000, "own_speed": [50, 54]}],
    "evaluation": {"final_encounters": 8},
    "practice": {"unwind": 3.0, "teaching": 1.0},
    "dagger": {"rounds": 2, "rollouts": 3, "settling": 1, "minibatch": 32, "epochs": 2},
}


class Silent:
    """Whom nothing is of interest."""

    def note(self, text: str, *, always: bool = False) -> None:
        pass

    def progress(self, what: str, done: int, of: int) -> None:
        pass


def actor_and_variables(seed: int = 1) -> tuple[Actor, Any]:
    actor = Actor(HIDDEN, "foresight")
    variables = actor.init(jax.random.key(seed), jnp.zeros((1, 8)))
    # A fresh head does hardly anything.
    return actor, jax.tree.map(lambda leaf: leaf * 60.0 if leaf.ndim == 2 and leaf.shape[1] == 2 else leaf, variables)


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("dagger") / "policy.safetensors"
    _, variables = actor_and_variables()
    policy_file.write(path, export.to_policy_file(variables, HIDDEN, "foresight", SURROGATE, {}, steps=5))
    return path


def run_of(policy: Path, **changes: Any) -> DaggerRun:
    dagger = SMALL["dagger"] | changes.pop("dagger", {})
    practice = SMALL["practice"] | changes.pop("practice", {})
    return DaggerRun.model_validate(SMALL | {"start_from": policy, "dagger": dagger, "practice": practice} | changes)


def silent(_: int) -> None:
    pass


@pytest.fixture(scope="module")
def gather(policy: Path) -> Gather:
    return gatherer(run_of(policy), actor_and_variables()[0])


@pytest.fixture(scope="module")
def told(gather: Gather) -> Samples:
    samples, resolved = gather(actor_and_variables()[1], 1, silent)
    assert 0.0 <= resolved <= 1.0
    return samples


NUMBERS = st.floats(-3.0, 3.0)


@settings(max_examples=60, deadline=None)
@given(mean=NUMBERS, ends=st.tuples(NUMBERS, NUMBERS), nearly=st.floats(0.01, 1.0))
def test_within_what_is_told_nothing_is_lost_and_beyond_it_the_more_the_farther(
    mean: float, ends: tuple[float, float], nearly: float
) -> None:
    low, high = min(ends), max(ends)
    here, farther = (float(distances(at, low, high, nearly)) for at in (mean, mean + (0.5 if mean > high else -0.5)))
    inside = low <= mean <= high
    assert here == 0.0 if inside else here > 0.0
    if not inside:
        assert farther > here
        assert farther - here <= 0.5 + 1e-5  # never more than linearly
    assert float(distances(mean, -np.inf, np.inf, nearly)) == 0.0


def test_what_no_lesson_speaks_of_is_what_the_policy_does_and_what_follows_it(told: Samples) -> None:
    actor, variables = actor_and_variables()
    applied: Any = actor.apply(variables, jnp.asarray(told.observation))
    mean = np.asarray(applied[0])
    plain = (told.weight == 1.0).all(axis=1)
    assert 0 < plain.sum() < len(plain)  # some circle
    assert (told.low <= mean + 1e-5)[plain].all()
    assert (mean - 1e-5 <= told.high)[plain].all()
    assert (told.weight[~plain] > 0.0).any(axis=1).all()
    np.testing.assert_array_equal(told.following[~plain], told.observation[~plain])
    smooth = (told.following != told.observation).any(axis=1)
    assert smooth[plain].mean() > 0.5
    # Who turns in to a near goal, 15 degrees aside, is not to be smooth.
    near, aside = told.observation[:, 7] < 2_500.0 / 1e4 - 1.0, np.abs(told.observation[:, 6]) > 15.0 / 180.0
    assert (plain & near & aside).any()
    assert not smooth[near & aside].any()
    # A second later the goal is at most 100 m elsewhere.
    assert np.abs(told.following - told.observation)[:, 7].max() <= 100.0 / 1e4 + 1e-5


def test_of_a_teacher_is_learned_where_nothing_is_in_the_way_and_of_oneself_where_something_is(
    policy: Path, tmp_path: Path
) -> None:
    actor, other = actor_and_variables(seed=7)
    path = tmp_path / "other.safetensors"
    policy_file.write(path, export.to_policy_file(other, HIDDEN, "foresight", SURROGATE, {}, steps=5))
    config = run_of(policy, practice={"teacher": path}, scenarios=[{"name": "same_course"}])
    _, variables = actor_and_variables()
    samples, _ = gatherer(config, actor)(variables, 1, silent)
    plain = (samples.weight == 1.0).all(axis=1)
    does, taught = (np.asarray(actor.apply(each, jnp.asarray(samples.observation))[0]) for each in (variables, other))
    apart = np.abs(np.clip(does, -1.0, 1.0) - np.clip(taught, -1.0, 1.0)).max(axis=1) > 0.01

    def within(action: np.ndarray) -> np.ndarray:
        return np.all((samples.low <= action + 1e-5) & (action - 1e-5 <= samples.high), axis=1)

    assert (within(does) | within(taught))[plain].all()
    assert within(taught)[plain & apart].any()
    assert within(does)[plain & apart].any()


@pytest.mark.parametrize("orthogonal_rate", [0.0, 0.05])
def test_it_learns_what_it_is_told_and_keeps_what_it_is_to_keep(orthogonal_rate: float) -> None:
    actor, variables = actor_and_variables()
    seen = np.random.default_rng(2).uniform(-1.0, 1.0, (4_000, 8)).astype(np.float32)
    applied: Any = actor.apply(variables, jnp.asarray(seen))
    mean = np.clip(np.asarray(applied[0]), -1.0, 1.0)
    asked = seen[:, 0] > 0.3  # of the fast it is asked to brake
    low = np.where(asked[:, None], [-np.inf, -np.inf], mean)
    high = np.where(asked[:, None], [-1.0, np.inf], mean)
    samples = Samples(seen, seen, *(part.astype(np.float32) for part in (low, high, np.ones_like(mean))))
    lost: list[float] = []
    learned = fit(
        actor,
        variables,
        samples,
        DaggerConfig(epochs=40, minibatch=256, learning_rate=1e-2, orthogonal_rate=orthogonal_rate),
        (0, 1),
        lambda _done, _of, loss: lost.append(loss),
    )
    assert len(lost) == 8
    assert lost[-1] < 0.5 * lost[0]
    after: Any = actor.apply(learned, jnp.asarray(seen))
    before, now = (np.asarray(distances(each, low, high, 0.1)) for each in (applied[0], after[0]))
    assert now[asked, 0].mean() < 0.3 * before[asked, 0].mean()
    assert now[~asked].mean() < 0.15


@pytest.mark.parametrize(
    "change",
    [
        {"epochs": 3},
        {"minibatch": 16},
        {"learning_rate": 1e-3},
        {"orthogonal_rate": 1e-2},
        {"nearly": 0.5},
        {"smoothness": (1.0, 0.0)},
        {"smoothness": (0.0, 1.0)},
    ],
)
def test_each_key_of_the_learning_changes_what_is_learned(told: Samples, change: dict[str, Any]) -> None:
    actor, variables = actor_and_variables()

    def learned(**keys: Any) -> np.ndarray:
        given = DaggerConfig.model_validate(SMALL["dagger"] | keys)
        found = fit(actor, variables, told, given, (0, 1), lambda *_: None)
        return np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(found)])

    assert np.array_equal(learned(), learned())
    assert not np.array_equal(learned(), learned(**change))


@pytest.mark.parametrize("change", [{"rollouts": 2}, {"settling": 2}, {"still": 1.0}, {"kept": 1.0}])
def test_each_key_of_the_flights_changes_what_is_told(policy: Path, told: Samples, change: dict[str, Any]) -> None:
    actor, variables = actor_and_variables()
    samples, _ = gatherer(run_of(policy, dagger=change), actor)(variables, 1, silent)
    assert samples.observation.shape != told.observation.shape or not np.array_equal(
        samples.observation, told.observation
    )


def test_another_round_flies_other_encounters_and_the_same_round_the_same(gather: Gather, told: Samples) -> None:
    _, variables = actor_and_variables()
    again, another = (gather(variables, number, silent)[0] for number in (1, 2))
    for field, likewise in zip(told, again, strict=True):
        np.testing.assert_array_equal(field, likewise)
    assert another.observation.shape != told.observation.shape or not np.array_equal(
        another.observation, told.observation
    )
    assert len(joined([told, another]).weight) == len(told.weight) + len(another.weight)


def test_a_run_that_was_stopped_goes_on_as_one_that_was_not(policy: Path, tmp_path: Path) -> None:
    config = run_of(policy)
    whole = tmp_path / "whole"
    whole.mkdir()
    summary = refine(config, whole, Silent())
    assert [row["told"] > 0 for row in summary["rounds"]] == [False, True, True]
    assert len({row["policy_sha256"] for row in summary["rounds"]}) == 3
    written = policy_file.read(whole / "policy.safetensors")
    assert written.sha256 == summary["policy_sha256"]
    assert written.metadata["training"]["steps"] == 5 + 2 * 3 * 16 * 8
    lines = (whole / "metrics.jsonl").read_text(encoding="utf-8")
    # Stopped after the first round, and after the flights of the second.
    for name, lost in (
        ("first", ("told-2.npz", "policy-2.safetensors", "judged-2.json")),
        ("flown", ("policy-2.safetensors",)),
    ):
        stopped = tmp_path / name
        shutil.copytree(whole, stopped)
        (stopped / "policy.safetensors").unlink()
        for file in lost:
            (stopped / "rounds" / file).unlink()
        again = refine(config, stopped, Silent())
        assert (stopped / "metrics.jsonl").read_text(encoding="utf-8") == lines
        assert policy_file.read(stopped / "policy.safetensors").sha256 == written.sha256
        assert [row["policy_sha256"] for row in again["rounds"]] == [row["policy_sha256"] for row in summary["rounds"]]


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (["start_from=null"], "start_from is null; expected the policy file"),
        (["practice.unwind=0"], "practice.pressed, prompt and unwind are 0; expected a lesson"),
        (["network.feature_set=mirror"], "network.feature_set is mirror; expected foresight, advised or pressed"),
        (["dagger.flown=0.5"], "dagger.flown is 0.5; expected dagger.blocked, 0.3, at most"),
        (["dagger.rouds=2"], "dagger.rouds"),
        (["network.hidden=[4]"], r"has network.hidden (8, 8); expected (4,) as configured"),
        (["world.vehicle.speed_max_mps=120"], "is of a vehicle with other limits than world.vehicle"),
        (["practice.teacher=nowhere.safetensors"], "practice.teacher"),
    ],
)
def test_what_cannot_be_refined_is_a_sentence(policy: Path, tmp_path: Path, changes: list[str], sentence: str) -> None:
    file = tmp_path / "config.yaml"
    file.write_text(json.dumps(json.loads(json.dumps(SMALL)) | {"start_from": str(policy)}), encoding="utf-8")
    with pytest.raises((ConfigError, policy_file.PolicyFileError)) as problem:
        main(["--config", str(file), "--out", str(tmp_path / "out"), *(f"--set={change}" for change in changes)])
    assert sentence in str(problem.value)


def test_a_run_is_not_written_over_and_what_is_none_is_not_resumed(policy: Path, tmp_path: Path) -> None:
    (tmp_path / "something").write_text("precious", encoding="utf-8")
    file = tmp_path / "config.yaml"
    file.write_text(json.dumps(json.loads(json.dumps(SMALL)) | {"start_from": str(policy)}), encoding="utf-8")
    with pytest.raises(ConfigError, match="is not empty; name another"):
        parse(["--config", str(file), "--out", str(tmp_path)])
    with pytest.raises(ConfigError, match="so it is no run"):
        parse(["--resume", str(tmp_path / "nowhere")])
    with pytest.raises(ConfigError, match="--set cannot change a run that is resumed"):
        parse(["--resume", str(tmp_path), "--set", "dagger.rounds=4"])
    assert parse(["--config", str(file), "--out", str(tmp_path / "new")]).config == load(DaggerRun, file)


def test_its_help_names_every_key_and_needs_no_jax() -> None:
    program = (
        "import sys; from rlcas_jax.dagger import _parser; _parser().format_help(); sys.exit('jax' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
    shown = subprocess.run(
        [sys.executable, "-m", "rlcas_jax.dagger", "--help"], capture_output=True, text=True, check=True
    ).stdout
    assert all(f"dagger.{key}" in shown for key in DaggerConfig.model_fields)
