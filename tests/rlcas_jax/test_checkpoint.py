"""Checkpoints survive every end of a process, and a warm start begins with the networks of an
earlier run.
"""

import logging
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agents.config.load import ConfigError, load
from agents.learning import export
from agents.policy import file as policy_file
from agents.policy.file import claims
from agents.policy.schema import new_metadata
from rlcas_jax import checkpoint
from rlcas_jax.checkpoint import CheckpointError, latest, restore, save
from rlcas_jax.checkpoint import meta as stored_meta
from rlcas_jax.config import TrainConfig
from rlcas_jax.loop import Run, prepare, run
from rlcas_jax.progress import Reporter
from rlcas_jax.train import main

ROOT = Path(__file__).resolve().parents[2]


class Pair(NamedTuple):
    left: Any
    right: Any


def tree(seed: int = 0) -> dict[str, Any]:
    key = jax.random.key(seed)
    return {
        "parameters": Pair(jax.random.normal(key, (3, 4)), {"b": jnp.arange(5, dtype=jnp.int32)}),
        "key": jax.random.key_data(jax.random.split(key, 2)),
        "flags": jnp.array([True, False]),
        "scalar": jnp.float32(0.1),
        "empty": jnp.zeros((0, 3)),
        "none": None,
        "special": jnp.array([jnp.nan, -0.0, jnp.inf, 1e-45]),
        "numbers": [jnp.array(7), jnp.array(0.1)],
    }


def bits(leaf: Any) -> tuple[str, tuple[int, ...], bytes]:
    array = np.asarray(leaf)
    return str(array.dtype), array.shape, array.tobytes()


def assert_same(one: Any, other: Any) -> None:
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        assert type(a) is type(b)
        assert bits(a) == bits(b)


def test_a_run_whose_folder_has_gone_is_not_begun_anew_by_a_checkpoint(tmp_path: Path):
    with pytest.raises(FileNotFoundError, match="gone"):
        save(tmp_path / "gone" / "checkpoints", 3, tree(), {})


def test_a_tree_comes_back_bit_for_bit_with_its_kinds_of_leaves(tmp_path: Path):
    meta = {"config": "name: é\n", "numbers": [1, 0.5, None]}
    path = save(tmp_path / "made", 3, tree(), meta)
    restored, restored_meta = restore(path, like=tree(seed=1)), stored_meta(path)
    assert_same(restored, tree())
    assert restored_meta == meta


def test_shapes_alone_are_enough_to_restore(tmp_path: Path):
    whole = {"a": jnp.arange(3.0), "key": jax.random.PRNGKey(5)}
    path = save(tmp_path, 0, whole, {})
    assert_same(restore(path, like=jax.eval_shape(lambda: whole)), whole)


def test_a_restored_array_can_be_donated(tmp_path: Path):
    path = save(tmp_path, 0, jnp.arange(3.0), {})
    restored = restore(path, like=jnp.zeros(3))
    assert jax.jit(lambda x: x + 1.0, donate_argnums=0)(restored).tolist() == [1.0, 2.0, 3.0]


def test_the_same_state_gives_the_same_file(tmp_path: Path):
    files = [save(tmp_path / name, 1, tree(), {"a": 1}) for name in ("one", "other")]
    assert files[0].read_bytes() == files[1].read_bytes()


def test_only_the_newest_are_kept(tmp_path: Path):
    (tmp_path / "notes.safetensors").touch()
    for number in (8, 9, 10, 11):
        save(tmp_path, number, {"a": jnp.ones(1)}, {})
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "checkpoint-0000000009.safetensors",
        "checkpoint-0000000010.safetensors",
        "checkpoint-0000000011.safetensors",
        "notes.safetensors",
    ]
    assert latest(tmp_path).name == "checkpoint-0000000011.safetensors"


@pytest.mark.parametrize("damage", ["truncated", "emptied", "flipped", "header", "meta", "garbage"])
def test_a_damaged_checkpoint_is_passed_over_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, damage: str
):
    good = save(tmp_path, 1, tree(), {"mark": "aaaa"})
    bad = save(tmp_path, 2, tree(), {"mark": "aaaa"})
    content = bytearray(bad.read_bytes())
    if damage == "truncated":
        content = content[:-1]
    elif damage == "emptied":
        content.clear()
    elif damage == "flipped":
        content[-1] ^= 1
    elif damage == "header":
        content[0] ^= 255
    elif damage == "meta":
        content = content.replace(b"aaaa", b"aaab")
    else:
        content = bytearray(os.urandom(1000))
    bad.write_bytes(content)
    with pytest.raises(
        CheckpointError, match=r"checkpoint-0000000002\.safetensors: not a whole checkpoint"
    ):
        restore(bad, like=tree())
    with caplog.at_level(logging.WARNING):
        assert latest(tmp_path) == good
    assert "not a whole checkpoint" in caplog.text
    assert "taking the one before it" in caplog.text


def test_a_named_pipe_is_no_checkpoint(tmp_path: Path):
    os.mkfifo(pipe := tmp_path / "checkpoint-1.safetensors")
    assert not claims(pipe)
    with pytest.raises(CheckpointError, match="not a regular file"):
        restore(pipe, tree(), "learner")


def test_nothing_to_resume_from_is_an_error(tmp_path: Path):
    with pytest.raises(CheckpointError, match="there is no checkpoint"):
        latest(tmp_path / "none")
    save(tmp_path, 1, tree(), {}).write_bytes(b"")
    with pytest.raises(CheckpointError, match="none of its 1 checkpoints is whole"):
        latest(tmp_path)
    with pytest.raises(CheckpointError, match="there is no such checkpoint"):
        restore(tmp_path / "none", like=tree())


def test_a_file_of_another_kind_is_refused(tmp_path: Path):
    from safetensors.numpy import save_file

    save_file({"a": np.zeros(1)}, tmp_path / "other.safetensors", {"schema": "policy"})
    with pytest.raises(CheckpointError, match="its schema is None; expected 'rlcas-checkpoint-1'"):
        restore(tmp_path / "other.safetensors", like={"a": np.zeros(1)})


@pytest.mark.parametrize(
    ("like", "sentence"),
    [
        ({"a": jnp.zeros(2)}, r"\['b'\] is in .*safetensors and not in this run"),
        (
            {"a": jnp.zeros(2), "b": jnp.zeros(1), "c": jnp.zeros(1)},
            r"\['c'\] is in this run and not in .*safetensors",
        ),
        (Pair(jnp.zeros(2), jnp.zeros(1)), r"\.left is in this run and not in"),
        ({"a": jnp.zeros(3), "b": jnp.zeros(1)}, r"\['a'\] is float32\[2\]; expected float32\[3\]"),
        (
            {"a": jnp.zeros(2, jnp.int32), "b": jnp.zeros(1)},
            r"\['a'\] is float32\[2\]; expected int32\[2\]",
        ),
    ],
)
def test_another_structure_is_refused_by_the_leafs_name(tmp_path: Path, like: Any, sentence: str):
    path = save(tmp_path, 0, {"a": jnp.zeros(2), "b": jnp.zeros(1)}, {})
    with pytest.raises(CheckpointError, match=sentence):
        restore(path, like=like)


# Without jax arrays, so that the process spends its time in the part that matters: writing.
SAVING = """
import sys
from pathlib import Path
import numpy as np
from rlcas_jax.checkpoint import save
number = int(sys.argv[2])
while True:
    number += 1
    save(Path(sys.argv[1]), number, {"a": np.full(1_000_000, number, np.int32)}, {"number": number})
    print(number, flush=True)
"""


def test_a_kill_at_any_moment_leaves_a_whole_checkpoint(tmp_path: Path):
    like = {"a": np.zeros(1_000_000, np.int32)}
    number = 0
    for attempt in range(3):
        with subprocess.Popen(
            [sys.executable, "-c", SAVING, str(tmp_path), str(number)],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            text=True,
        ) as process:
            assert process.stdout is not None
            confirmed = int(process.stdout.readline())
            time.sleep(0.003 + 0.022 * attempt)
            process.send_signal(signal.SIGKILL)
            confirmed = max([confirmed, *map(int, process.stdout.read().split())])
        assert process.returncode == -signal.SIGKILL
        restored, meta = restore(latest(tmp_path), like), stored_meta(latest(tmp_path))
        number = meta["number"]
        # What was reported as saved is there; the next one may be.
        assert number in (confirmed, confirmed + 1)
        assert (restored["a"] == number).all()
    # A save that was cut short leaves nothing behind that the next one does not clear away.
    save(tmp_path, number + 1, like, {})
    assert len(list(tmp_path.iterdir())) == 3


# A warm start: training begins with the networks of an earlier run or of a policy file.

TINY = [
    "steps=512",
    "network.hidden=[8, 8]",
    "network.feature_set=mirror",
    "environments=16",
    "rollout=16",
    "ppo.minibatch=64",
    "ppo.segment=8",
    "ppo.epochs=1",
    "pool_rows=2",
    "evaluation.encounters=8",
]


def train_in(directory: Path, *overrides: str) -> Run:
    training = prepare(load(TrainConfig, None, [*TINY, *overrides]), directory)
    directory.mkdir()
    return run(training, Reporter(quiet=True))


def first_checkpoint(run: Run) -> Path:
    return run.directory / "checkpoints" / "checkpoint-0000000000.safetensors"


@pytest.fixture(scope="module")
def earlier(tmp_path_factory: pytest.TempPathFactory, share_programs: None) -> Run:
    return train_in(tmp_path_factory.mktemp("runs") / "earlier")


@pytest.mark.slow
def test_networks_and_optimiser_are_those_of_the_earlier_run(earlier: Run, tmp_path: Path) -> None:
    # Other encounters and another number of them: only the networks have to be the same.
    changes = ["seed=7", "environments=32", "scenarios=[{name: noisy}]"]
    later = train_in(tmp_path / "later", *changes, f"warm_start={earlier.directory}")
    begun = checkpoint.restore(first_checkpoint(later), earlier.state.learner, "learner")
    fresh = checkpoint.restore(first_checkpoint(earlier), earlier.state.learner, "learner")
    for mine, theirs, new in zip(
        *map(jax.tree.leaves, (begun, earlier.state.learner, fresh)), strict=True
    ):
        np.testing.assert_array_equal(mine, theirs)
        assert not np.array_equal(mine, new)
    assert int(later.state.update) == 1


@pytest.mark.slow
def test_a_checkpoint_is_as_good_as_its_run(earlier: Run, tmp_path: Path) -> None:
    file = checkpoint.latest(earlier.directory / "checkpoints")
    of_run = train_in(tmp_path / "a", f"warm_start={earlier.directory}")
    of_file = train_in(tmp_path / "b", f"warm_start={file}")
    for mine, theirs in zip(
        jax.tree.leaves(of_run.state), jax.tree.leaves(of_file.state), strict=True
    ):
        np.testing.assert_array_equal(mine, theirs)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (["network.hidden=[8, 9]"], "expected float32"),
        (["network.hidden=[8]"], "made by another structure"),
    ],
)
def test_other_networks_are_refused(
    overrides: list[str], said: str, earlier: Run, tmp_path: Path
) -> None:
    with pytest.raises(checkpoint.CheckpointError, match=said):
        train_in(tmp_path / "other", f"warm_start={earlier.directory}", *overrides)


def test_nothing_is_created_before_everything_is_checked(tmp_path: Path) -> None:
    changes = [argument for change in TINY for argument in ("--set", change)]
    nowhere, out = tmp_path / "nowhere", tmp_path / "run"
    with pytest.raises(checkpoint.CheckpointError, match=f"{nowhere}: there is no such checkpoint"):
        main([*changes, "--set", f"warm_start={nowhere}", "--out", str(out), "--quiet"])
    assert not out.exists()


@pytest.fixture(scope="module")
def policy(earlier: Run) -> Path:
    """The policy of the earlier run, alone."""
    path = earlier.directory / "alone.safetensors"
    config = earlier.config
    network = config.network
    metadata = new_metadata(
        tuple(network.hidden), network.feature_set, config.aircraft.limits(), {}, steps=1
    )
    content = export.to_policy_file(earlier.state.learner.actor, metadata)
    policy_file.write(path, content)
    return path


@pytest.mark.slow
def test_a_policy_begins_a_training_with_a_fresh_critic(
    earlier: Run, policy: Path, tmp_path: Path
) -> None:
    later = train_in(tmp_path / "later", f"warm_start={policy}", "checkpoint.every_seconds=0")
    first = sorted((later.directory / "checkpoints").glob("*.safetensors"))[0]
    learner = checkpoint.restore(first, earlier.state.learner, "learner")
    assert same(learner.actor, earlier.state.learner.actor)
    assert not same(learner.critic, earlier.state.learner.critic)


def same(one: object, other: object) -> bool:
    leaves = zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True)
    return all(np.array_equal(mine, theirs) for mine, theirs in leaves)


@pytest.mark.slow
def test_an_unfit_policy_file_is_refused(policy: Path, tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"warm_start: .*network\.hidden \(8, 8\); expected \(8, 9\)"
    ):
        train_in(tmp_path / "other", f"warm_start={policy}", "network.hidden=[8, 9]")
    damaged = tmp_path / "damaged.safetensors"
    content = bytearray(policy.read_bytes())
    content[-1] ^= 1
    damaged.write_bytes(content)
    with pytest.raises(ConfigError, match=r"warm_start: .*edited or damaged"):
        train_in(tmp_path / "of_damaged", f"warm_start={damaged}")
