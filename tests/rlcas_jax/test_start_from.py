"""A training that begins with the networks of an earlier one."""

from pathlib import Path

import jax
import numpy as np
import pytest

from agents.configuration import ConfigError, load
from rlcas_jax import checkpoint
from rlcas_jax.cli import Job
from rlcas_jax.config import TrainConfig
from rlcas_jax.loop import Run, run
from rlcas_jax.progress import Reporter
from rlcas_jax.train import main

TINY = [
    "steps=512",
    "network.hidden=[8, 8]",
    "ppo.environments=16",
    "ppo.rollout=16",
    "ppo.minibatch=64",
    "ppo.segment=8",
    "ppo.epochs=1",
    "pool_rows=2",
    "evaluation.encounters=8",
]


def trained(directory: Path, *overrides: str) -> Run:
    directory.mkdir()
    job = Job(load(TrainConfig, None, [*TINY, *overrides]), directory, resume=False)
    return run(job.config, job.directory, Reporter(quiet=True))


def first_checkpoint(run: Run) -> Path:
    return run.directory / "checkpoints" / "checkpoint-0000000000.safetensors"


@pytest.fixture(scope="module")
def earlier(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return trained(tmp_path_factory.mktemp("runs") / "earlier")


def test_it_begins_with_the_networks_and_the_optimiser_of_the_earlier_run(earlier: Run, tmp_path: Path) -> None:
    # Other encounters and another number of them: only the networks have to be the same.
    changes = ["seed=7", "ppo.environments=32", "scenarios=[{name: noisy}]", "checkpoint.keep=9"]
    later = trained(tmp_path / "later", *changes, f"start_from={earlier.directory}")
    begun = checkpoint.restore_part(first_checkpoint(later), earlier.state.learner, "learner")
    fresh = checkpoint.restore_part(first_checkpoint(earlier), earlier.state.learner, "learner")
    for mine, theirs, new in zip(*map(jax.tree.leaves, (begun, earlier.state.learner, fresh)), strict=True):
        np.testing.assert_array_equal(mine, theirs)
        assert not np.array_equal(mine, new)
    assert int(later.state.update) == 1


@pytest.mark.slow
def test_a_checkpoint_s_file_is_as_good_as_its_run(earlier: Run, tmp_path: Path) -> None:
    file = checkpoint.latest(earlier.directory / "checkpoints")
    of_run = trained(tmp_path / "a", f"start_from={earlier.directory}")
    of_file = trained(tmp_path / "b", f"start_from={file}")
    for mine, theirs in zip(jax.tree.leaves(of_run.state), jax.tree.leaves(of_file.state), strict=True):
        np.testing.assert_array_equal(mine, theirs)


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (["network.hidden=[8, 9]"], "expected float32"),
        pytest.param(["network.hidden=[8]"], "made by another structure", marks=pytest.mark.slow),
    ],
)
def test_other_networks_are_refused(overrides: list[str], said: str, earlier: Run, tmp_path: Path) -> None:
    with pytest.raises(checkpoint.CheckpointError, match=said):
        trained(tmp_path / "other", f"start_from={earlier.directory}", *overrides)


def test_where_there_is_no_run_it_is_said_in_a_sentence(tmp_path: Path) -> None:
    changes = [argument for change in TINY for argument in ("--set", change)]
    nowhere = tmp_path / "nowhere"
    with pytest.raises(ConfigError, match=f"{nowhere}: there is no such checkpoint"):
        main([*changes, "--set", f"start_from={nowhere}", "--out", str(tmp_path / "run"), "--quiet"])
