"""The mean of policies is a policy that lies between them; what cannot be averaged is a sentence."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents import policy_file
from agents.configuration import ConfigError
from agents.export import to_policy_file
from agents.inference import Policy
from agents.networks import Actor
from agents.policy_file import PolicyFile, PolicyFileError
from envs.kinematics import SURROGATE
from envs.observation import SIZE
from rlcas_jax.average import average, main


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
