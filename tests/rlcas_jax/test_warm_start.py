"""A warm start: training begins with the networks of an earlier run or of a policy file."""

from pathlib import Path

import jax
import numpy as np
import pytest

from agents.config.load import ConfigError, load
from agents.learning import export
from agents.policy import file as policy_file
from rlcas_jax import checkpoint
from rlcas_jax.config import TrainConfig
from rlcas_jax.loop import Run, prepared, run
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
    training = prepared(load(TrainConfig, None, [*TINY, *overrides]), directory)
    directory.mkdir()
    return run(training, Reporter(quiet=True))


def first_checkpoint(run: Run) -> Path:
    return run.directory / "checkpoints" / "checkpoint-0000000000.safetensors"


@pytest.fixture(scope="module")
def earlier(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return trained(tmp_path_factory.mktemp("runs") / "earlier")


def test_networks_and_optimiser_are_those_of_the_earlier_run(earlier: Run, tmp_path: Path) -> None:
    # Other encounters and another number of them: only the networks have to be the same.
    changes = ["seed=7", "ppo.environments=32", "scenarios=[{name: noisy}]"]
    later = trained(tmp_path / "later", *changes, f"warm_start={earlier.directory}")
    begun = checkpoint.restore_part(first_checkpoint(later), earlier.state.learner, "learner")
    fresh = checkpoint.restore_part(first_checkpoint(earlier), earlier.state.learner, "learner")
    for mine, theirs, new in zip(*map(jax.tree.leaves, (begun, earlier.state.learner, fresh)), strict=True):
        np.testing.assert_array_equal(mine, theirs)
        assert not np.array_equal(mine, new)
    assert int(later.state.update) == 1


@pytest.mark.slow
def test_a_checkpoint_is_as_good_as_its_run(earlier: Run, tmp_path: Path) -> None:
    file = checkpoint.latest(earlier.directory / "checkpoints")
    of_run = trained(tmp_path / "a", f"warm_start={earlier.directory}")
    of_file = trained(tmp_path / "b", f"warm_start={file}")
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
        trained(tmp_path / "other", f"warm_start={earlier.directory}", *overrides)


def test_nothing_is_created_before_everything_is_checked(tmp_path: Path) -> None:
    changes = [argument for change in TINY for argument in ("--set", change)]
    nowhere, out = tmp_path / "nowhere", tmp_path / "run"
    with pytest.raises(checkpoint.CheckpointError, match=f"{nowhere}: there is no such checkpoint"):
        main([*changes, "--set", f"warm_start={nowhere}", "--out", str(out), "--quiet"])
    with pytest.raises(ConfigError, match=r"near_limit\.margin"):
        main([*changes, "--set", "near_limit={share: 0.1, margin: 1e-4}", "--out", str(out), "--quiet"])
    assert not out.exists()


@pytest.fixture(scope="module")
def policy(earlier: Run) -> Path:
    """The policy of the earlier run, alone."""
    path = earlier.directory / "alone.safetensors"
    config = earlier.config
    content = export.to_policy_file(
        earlier.state.learner.actor,
        config.network.hidden,
        config.network.feature_set,
        config.world.limits(),
        {},
        steps=1,
    )
    policy_file.write(path, content)
    return path


def test_the_actor_of_a_policy_waits_for_the_critic(earlier: Run, policy: Path, tmp_path: Path) -> None:
    # Two updates of 256 steps, of which the first is the critic's alone.
    changes = [f"warm_start={policy}", "checkpoint.every_seconds=0"]
    for first, moves in ((256, (False, True)), (0, (True, True))):
        later = trained(tmp_path / f"later-{first}", *changes, f"ppo.critic_warmup_steps={first}")
        learners = [
            checkpoint.restore_part(file, earlier.state.learner, "learner")
            for file in sorted((later.directory / "checkpoints").glob("*.safetensors"))
        ]
        assert same(learners[0].actor, earlier.state.learner.actor)
        assert not same(learners[0].critic, earlier.state.learner.critic)
        for before, after, moved in zip(learners, learners[1:], moves, strict=False):
            assert same(before.actor, after.actor) is not moved
            assert not same(before.critic, after.critic)


def same(one: object, other: object) -> bool:
    leaves = zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True)
    return all(np.array_equal(mine, theirs) for mine, theirs in leaves)


def test_an_unfit_policy_file_is_refused(policy: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"warm_start: .*network\.hidden \(8, 8\); expected \(8, 9\)"):
        trained(tmp_path / "other", f"warm_start={policy}", "network.hidden=[8, 9]")
    damaged = tmp_path / "damaged.safetensors"
    content = bytearray(policy.read_bytes())
    content[-1] ^= 1
    damaged.write_bytes(content)
    with pytest.raises(ConfigError, match=r"warm_start: .*edited or damaged"):
        trained(tmp_path / "of_damaged", f"warm_start={damaged}")
