"""Phases: parts of one training that differ in some keys, each going on with the networks of the one before."""

import json
import subprocess
import sys
import time
from pathlib import Path

import jax
import numpy as np
import pytest

from agents.config.load import ConfigError, dump, load
from rlcas_jax import checkpoint, metrics
from rlcas_jax.config import TrainConfig
from rlcas_jax.loop import Run, prepared, run
from rlcas_jax.progress import Reporter

ROOT = Path(__file__).resolve().parents[2]
TINY = """\
name: tiny
network: {hidden: [8, 8]}
ppo: {environments: 16, rollout: 16, minibatch: 64, segment: 8, epochs: 1}
pool_rows: 2
evaluation: {every_steps: 1000000, encounters: 8, final_encounters: 16}
checkpoint: {every_seconds: 0.0}
phases:
  - steps: 5120
  - steps: 10240
    ppo: {environments: 32, discount: 0.9}
    scenarios: [{name: multi}]
    world: {separation_spread: 50}
"""
UPDATES = 20 + 20


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("config") / "phases.yaml"
    path.write_text(TINY)
    return path


def trained(config: TrainConfig, directory: Path) -> Run:
    directory.mkdir()
    return run(prepared(config, directory), Reporter(quiet=True))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, file: Path) -> Run:
    return trained(load(TrainConfig, file), tmp_path_factory.mktemp("runs") / "whole")


def rows(directory: Path) -> list[dict[str, float]]:
    """Return the logged rows without what depends on the clock."""
    logged = [json.loads(line) for line in (directory / metrics.FILE).read_text().splitlines()]
    return [{name: value for name, value in row.items() if name not in metrics.WALL_CLOCK} for row in logged]


def test_each_phase_has_its_own_keys_and_the_common_ones(file: Path, tmp_path: Path) -> None:
    config = load(TrainConfig, file)
    first, second = config.in_phases()
    assert (first.steps, first.ppo.environments, first.ppo.discount) == (5120, 16, 0.995)
    assert (second.steps, second.ppo.environments, second.ppo.discount) == (10240, 32, 0.9)
    assert second.ppo.rollout == first.ppo.rollout == 16
    assert [entry.name for entry in second.scenarios] == ["multi"]
    assert TrainConfig().in_phases() == (TrainConfig(),)
    (tmp_path / "dump.yaml").write_text(dump(config))
    assert load(TrainConfig, tmp_path / "dump.yaml") == config


@pytest.mark.parametrize(
    ("phase", "said"),
    [
        ("{seed: 3}", r"phases\.0\.seed: expected one of steps, ppo"),
        ("{ppo: {clipp: 3}}", r"phases\.0: ppo\.clipp is unknown .* did you mean ppo\.clip"),
        ("{ppo: {minibatch: 5}}", r"phases\.0: ppo\.minibatch is 5; expected a divisor"),
        ("{world: {vehicle: {speed_max_mps: 90}}}", r"phases\.0\.world\.vehicle"),
        ("{ppo: 3}", r"phases\.0: ppo is 3; expected a group of keys"),
        ("3", r"phases\.0 is 3"),
    ],
)
def test_a_bad_phase_is_refused(phase: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        load(TrainConfig, None, [f"phases=[{phase}]"])


def test_steps_and_updates_are_counted_over_all_phases(whole: Run) -> None:
    log = metrics.read(whole.directory)
    np.testing.assert_array_equal(log["update"], np.arange(1, UPDATES + 1))
    np.testing.assert_array_equal(log["step"][[0, 19, 20, 39]], [256, 5120, 5120 + 512, 15360])
    assert whole.finished and whole.steps == 15360
    # The learning rate falls over each phase.
    assert log["learning_rate"][0] == log["learning_rate"][20] > log["learning_rate"][19]


def test_a_phase_goes_on_with_the_networks_of_the_one_before(whole: Run, file: Path, tmp_path: Path) -> None:
    """Its first update is that of a training of this phase alone that begins with them."""
    config = load(TrainConfig, file, ["phases.1.steps=512"])
    both = trained(config, tmp_path / "both")
    first = load(TrainConfig, file).in_phases()[0]
    alone = trained(first, tmp_path / "first")
    assert rows(alone.directory) == rows(both.directory)[:20] == rows(whole.directory)[:20]
    second = prepared(config, tmp_path / "none").tasks[1]
    state = second.initial()
    state, _ = second.update(state._replace(learner=alone.state.learner))
    for mine, theirs in zip(jax.tree.leaves(state), jax.tree.leaves(both.state), strict=True):
        np.testing.assert_array_equal(mine, theirs)


@pytest.mark.parametrize("least", [5, 25])
def test_a_kill_in_either_phase_loses_nothing(whole: Run, file: Path, tmp_path: Path, least: int) -> None:
    killed = tmp_path / "killed"
    command = [sys.executable, "-m", "rlcas_jax.train", "--quiet"]
    process = subprocess.Popen([*command, "--config", str(file), "--out", str(killed)], cwd=ROOT)
    deadline = time.monotonic() + 240
    while time.monotonic() < deadline and process.poll() is None:
        if len(metrics.read(killed / metrics.FILE).get("update", ())) >= least:
            break
        time.sleep(0.002)
    process.kill()
    process.wait()
    done = len(metrics.read(killed / metrics.FILE)["update"])
    assert least <= done < UPDATES, "the run ended before it was killed: nothing was tested"
    again = run(prepared(load(TrainConfig, file), killed, resume=True), Reporter(quiet=True))
    assert rows(killed) == rows(whole.directory)
    for mine, theirs in zip(jax.tree.leaves(again.state), jax.tree.leaves(whole.state), strict=True):
        np.testing.assert_array_equal(mine, theirs)
    newest = [checkpoint.latest(directory / "checkpoints") for directory in (killed, whole.directory)]
    assert newest[0].read_bytes() == newest[1].read_bytes()


def test_the_best_configuration_has_two_phases() -> None:
    first, second = load(TrainConfig, ROOT / "configs" / "best.yaml").in_phases()
    assert (first.steps, second.steps) == (20_000_000, 40_000_000)
    assert first.network == second.network
