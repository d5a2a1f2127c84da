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

from agents.policy.file import claims
from rlcas_jax.checkpoint import CheckpointError, latest, restore, restore_part, save
from rlcas_jax.checkpoint import meta as stored_meta

ROOT = Path(__file__).resolve().parents[2]


class Pair(NamedTuple):
    left: Any
    right: Any


def tree(seed: int = 0) -> dict[str, Any]:
    key = jax.random.key(seed)
    return {
        "parameters": Pair(jax.random.normal(key, (3, 4)), {"b": jnp.arange(5, dtype=jnp.int32)}),
        "key": jax.random.split(key, 2),
        "flags": jnp.array([True, False]),
        "half": jnp.ones((2,), jnp.bfloat16),
        "scalar": jnp.float32(0.1),
        "empty": jnp.zeros((0, 3)),
        "none": None,
        "numpy": np.array([np.nan, -0.0, np.inf, 5e-324]),
        "numbers": [7, 0.1, True],
    }


def bits(leaf: Any) -> tuple[str, tuple[int, ...], bytes]:
    if hasattr(leaf, "dtype") and jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key):
        leaf = jax.random.key_data(leaf)
    array = np.asarray(leaf)
    return str(array.dtype), array.shape, array.tobytes()


def assert_same(one: Any, other: Any) -> None:
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        assert type(a) is type(b)
        assert bits(a) == bits(b)


def test_a_tree_comes_back_bit_for_bit_with_its_kinds_of_leaves(tmp_path: Path):
    meta = {"config": "name: é\n", "numbers": [1, 0.5, None]}
    path = save(tmp_path / "made", 3, tree(), meta)
    restored, restored_meta = restore(path, like=tree(seed=1)), stored_meta(path)
    assert_same(restored, tree())
    assert restored_meta == meta
    assert jax.random.uniform(restored["key"][1]) == jax.random.uniform(tree()["key"][1])


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
        save(tmp_path, number, {"a": jnp.ones(1)}, {}, keep=2)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
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
    with pytest.raises(CheckpointError, match=r"checkpoint-0000000002\.safetensors: not a whole checkpoint"):
        restore(bad, like=tree())
    with caplog.at_level(logging.WARNING):
        assert latest(tmp_path) == good
    assert "not a whole checkpoint" in caplog.text
    assert "taking the one before it" in caplog.text


def test_a_named_pipe_is_no_checkpoint(tmp_path: Path):
    os.mkfifo(pipe := tmp_path / "checkpoint-1.safetensors")
    assert not claims(pipe)
    with pytest.raises(CheckpointError, match="not a regular file"):
        restore_part(pipe, tree(), "learner")


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
        ({"a": jnp.zeros(2), "b": jnp.zeros(1), "c": jnp.zeros(1)}, r"\['c'\] is in this run and not in .*safetensors"),
        (Pair(jnp.zeros(2), jnp.zeros(1)), r"\.left is in this run and not in"),
        ({"a": jnp.zeros(3), "b": jnp.zeros(1)}, r"\['a'\] is float32\[2\]; expected float32\[3\]"),
        ({"a": jnp.zeros(2, jnp.int32), "b": jnp.zeros(1)}, r"\['a'\] is float32\[2\]; expected int32\[2\]"),
        ({"a": jnp.zeros(2), "b": jax.random.key(0)}, r"\['b'\] is float32\[1\]; expected uint32\[2\]"),
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
    save(Path(sys.argv[1]), number, {"a": np.full(1_000_000, number)}, {"number": number})
    print(number, flush=True)
"""


def test_a_kill_at_any_moment_leaves_a_whole_checkpoint(tmp_path: Path):
    like = {"a": np.zeros(1_000_000, np.int64)}
    number = 0
    for attempt in range(3):
        with subprocess.Popen(
            [sys.executable, "-c", SAVING, str(tmp_path), str(number)], cwd=ROOT, stdout=subprocess.PIPE, text=True
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
