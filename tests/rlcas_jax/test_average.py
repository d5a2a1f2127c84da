"""The mean of policies is a policy that lies between them; what cannot be averaged is a sentence."""

import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.config.load import ConfigError
from agents.learning.export import to_policy_file
from agents.learning.networks import Actor
from agents.policy import file as policy_file
from agents.policy.file import PolicyFile, PolicyFileError
from agents.policy.inference import Policy
from envs.kinematics import SURROGATE
from envs.observation import SIZE
from rlcas_jax import checkpoint
from rlcas_jax.average import average, main
from rlcas_jax.checkpoint import CheckpointError


def policy(seed: int, hidden: tuple[int, ...] = (8, 8), **changes: Any) -> PolicyFile:
    variables: Any = Actor(hidden, "mirror").init(jax.random.key(seed), np.zeros((1, SIZE), np.float32))
    described: dict[str, Any] = {"limits": SURROGATE, "config": {"seed": seed}, "steps": 10 + seed, **changes}
    return to_policy_file(variables, hidden, "mirror", **described)


A, B, C = (policy(seed) for seed in range(3))


@settings(max_examples=10, deadline=None)
@given(st.lists(st.floats(0.1, 10.0), min_size=3, max_size=3))
def test_weights_are_the_weighted_mean_whatever_the_scale_of_the_shares(shares: list[float]) -> None:
    found = average(list(zip((A, B, C), shares, strict=True)))
    again = average([(content, 7.0 * share) for content, share in zip((A, B, C), shares, strict=True)])
    for name, tensor in found.actor.items():
        parts = [content.actor[name] for content in (A, B, C)]
        np.testing.assert_allclose(tensor, np.average(parts, axis=0, weights=shares), rtol=1e-5, atol=1e-7)
        np.testing.assert_allclose(tensor, again.actor[name], rtol=1e-6, atol=1e-8)


def test_the_mean_of_a_policy_and_itself_is_that_policy() -> None:
    found = average([(A, 0.3), (A, 0.7)])
    assert all(np.array_equal(found.actor[name], A.actor[name]) for name in A.actor)
    np.testing.assert_array_equal(found.parity_action, A.parity_action)


def test_it_says_what_it_is_made_of_and_flies(tmp_path: Path) -> None:
    paths = [tmp_path / f"{name}.safetensors" for name in "abc"]
    for path, content in zip(paths, (A, B, C), strict=True):
        policy_file.write(path, content)
    out = tmp_path / "mean.safetensors"
    assert main([f"{paths[0]}=1", f"{paths[1]}=1", f"{paths[2]}=2", "--out", str(out)]) == 0
    found = Policy.load(out)
    notes = found.metadata["notes"]
    for share, content in (("0.25", A), ("0.25", B), ("0.5", C)):
        assert f"{share} of {content.sha256[:8]}" in notes
    assert found.metadata["training"]["config"] == {"seed": 2}
    with pytest.raises(ConfigError, match="exists"):
        main([f"{paths[0]}=1", "--out", str(out)])


@pytest.mark.parametrize(
    "other", [policy(1, (8,)), policy(1, limits=SURROGATE._replace(speed_max=90.0))], ids=["network", "limits"]
)
def test_policies_of_another_kind_are_refused(other: PolicyFile) -> None:
    with pytest.raises(PolicyFileError, match=r"expected .* as of policy"):
        average([(other, 0.5), (A, 0.5)])


class Saved(NamedTuple):
    """What stands for a run's state: the learner's part is averaged, the other is not."""

    learner: dict[str, Any]
    update: np.ndarray


def run(path: Path, seed: int, **learner: Any) -> Path:
    """Leave a directory as a training leaves it, with one checkpoint and the policy."""
    path.mkdir()
    policy_file.write(path / "policy.safetensors", policy(seed))
    known = {"weights": np.float32([seed, 2.0 * seed]), "count": np.int32(seed)}
    checkpoint.save(path / "checkpoints", 3, Saved(known | learner, np.int32(seed)), {"config": f"of {seed}"})
    return path


def test_the_mean_of_runs_is_one_that_a_training_can_begin_with(tmp_path: Path) -> None:
    runs = run(tmp_path / "a", 1), run(tmp_path / "b", 3)
    out = tmp_path / "mean"
    assert main([f"{runs[0]}=1", f"{runs[1]}=3", "--out", str(out)]) == 0
    found = checkpoint.restore_part(
        checkpoint.latest(out / "checkpoints"), {"weights": np.zeros(2, np.float32), "count": np.int32(0)}, "learner"
    )
    np.testing.assert_array_equal(found["weights"], np.float32([2.5, 5.0]))
    assert found["count"] == 3, "how many steps the optimiser has made is the last one's"
    alone = average([(policy(1), 1.0), (policy(3), 3.0)])
    assert Policy.load(out / "policy.safetensors").sha256 == alone.sha256


def test_runs_of_another_structure_and_runs_among_files_are_refused(tmp_path: Path) -> None:
    a, b = run(tmp_path / "a", 1), run(tmp_path / "b", 2, weights=np.zeros(3, np.float32))
    with pytest.raises(CheckpointError, match="made by another structure"):
        main([f"{a}=1", f"{b}=1", "--out", str(tmp_path / "mean")])
    c = run(tmp_path / "c", 3, more=np.zeros(1, np.float32))
    for order in ((a, c), (c, a)):
        with pytest.raises(CheckpointError, match=r"made by another structure .*more"):
            main([*(f"{path}=1" for path in order), "--out", str(tmp_path / "mean")])
    with pytest.raises(ConfigError, match="expected runs alone or policy files alone"):
        main([f"{a}=1", f"{b / 'policy.safetensors'}=1", "--out", str(tmp_path / "mean")])
    assert not (tmp_path / "mean").exists()


@pytest.mark.parametrize("text", ["a.safetensors", "a.safetensors=", "=1", "a=0", "a=-1", "a=nan", "a=inf", "a=x"])
def test_what_is_no_file_and_share_is_refused(text: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="expected FILE=SHARE"):
        main([text, "--out", str(tmp_path / "x.safetensors")])


def test_a_file_that_is_not_there_is_one_sentence_and_status_2(tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "rlcas_jax.average",
        "nowhere.safetensors=1",
        "--out",
        str(tmp_path / "x.safetensors"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "nowhere.safetensors" in done.stderr
