"""Examples draw the policy to what they do, and a file that holds none is a sentence."""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.config.load import ConfigError, load
from agents.learning.ppo import deviation, met_by
from rlcas_jax.config import TrainConfig
from rlcas_jax.examples import exemplary
from rlcas_jax.task import Task, build

TINY = (
    *("network.hidden=[16]", "ppo.environments=32", "ppo.rollout=16", "ppo.minibatch=128", "ppo.segment=8"),
    *("pool_rows=2", "ppo.learning_rate=3e-3", "ppo.learning_rate_final=3e-3"),
)
SEEN = np.random.default_rng(0).uniform(-1.0, 1.0, (400, 8)).astype(np.float32)
DONE = np.tile(np.array([-1.0, 0.5], np.float32), (400, 1))


def written(folder: Path, **arrays: Any) -> Path:
    path = folder / "examples.npz"
    np.savez(path, **arrays)
    return path


@given(st.floats(-3.0, 3.0), st.floats(-1.0, 1.0))
def test_an_action_deviates_by_its_distance_and_full_deflection_is_met_by_more(mean: float, action: float) -> None:
    def of(mean: float, action: float) -> float:
        return float(deviation(jnp.full((1, 2), mean), *met_by(jnp.full((1, 2), action))).mean())

    found = of(mean, action)
    assert found == pytest.approx(of(-mean, -action))
    action = float(np.float32(action))
    beyond = abs(action) == 1.0 and mean * action >= 1.0
    assert found == pytest.approx(0.0 if beyond else (np.float32(mean) - np.float32(action)) ** 2, abs=1e-6)


@pytest.fixture(scope="module")
def tasks(tmp_path_factory: pytest.TempPathFactory) -> tuple[Task, Task]:
    """Return a training of a thousand updates without examples and one with them; each is compiled once."""
    path = written(tmp_path_factory.mktemp("examples"), observation=SEEN, action=DONE)
    config = [*TINY, "steps=512000"]
    shown = [*config, f"practice.examples={path}", "practice.imitation=1.0"]
    plain, drawn = (build(load(TrainConfig, None, overrides)) for overrides in (config, shown))
    return plain, drawn


@pytest.mark.slow
def test_a_training_is_drawn_to_its_examples(tasks: tuple[Task, Task]) -> None:
    plain, drawn = tasks
    state, found = drawn.initial(), []
    for _ in range(60):
        state, figures = drawn.update(state)
        found.append(float(figures["imitation_loss"]))
    assert found[-1] < 0.25 * found[0]
    # Without examples nothing of the kind is computed.
    _, figures = plain.update(plain.initial())
    assert "imitation_loss" not in figures


@pytest.mark.slow
def test_the_weight_falls_to_nothing_at_the_end(tasks: tuple[Task, Task]) -> None:
    """The last of many updates changes the actor almost as a training without examples would."""

    def step(task: Task, number: int) -> Any:
        begun = task.initial()._replace(update=jnp.asarray(number, jnp.int32))
        after, _ = task.update(begun)
        return np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(after.learner.actor)])

    plain, drawn = tasks
    early, late, without = step(drawn, 0), step(drawn, 999), step(plain, 999)
    assert np.abs(late - without).max() < 0.2 * np.abs(early - without).max()


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"observation": SEEN}, "holds no action"),
        ({"observation": SEEN, "action": DONE[:5]}, "holds 400 observations and 5 actions"),
        ({"observation": SEEN[:, :7], "action": DONE}, r"observation of .* has shape \[400, 7\]"),
        ({"observation": SEEN[:0], "action": DONE[:0]}, r"observation of .* has shape \[0, 8\]"),
        ({"observation": SEEN, "action": 2.0 * DONE}, r"action of .* holds what is not within \[-1, 1\]"),
        ({"observation": np.where(SEEN > 0.9, np.nan, SEEN), "action": DONE}, "not within"),
        ({"observation": np.array([["a"] * 8]), "action": DONE}, "expected .* of floats"),
    ],
)
def test_a_file_of_something_else_is_refused(arrays: dict[str, Any], said: str, tmp_path: Path) -> None:
    path = written(tmp_path, **arrays)
    with pytest.raises(ConfigError, match=f"practice.examples: .*{said}"):
        exemplary(load(TrainConfig, None, [f"practice.examples={path}"]))


@pytest.mark.parametrize("text", [b"", b"encounter,own_x_m\n", b"PK\x03\x04broken"])
def test_what_is_no_such_file_is_refused(text: bytes, tmp_path: Path) -> None:
    path = tmp_path / "examples.npz"
    path.write_bytes(text)
    with pytest.raises(ConfigError, match=r"cannot be read .* expected an \.npz file"):
        exemplary(load(TrainConfig, None, [f"practice.examples={path}"]))
    with pytest.raises(ConfigError, match="there is no such file"):
        exemplary(load(TrainConfig, None, [f"practice.examples={tmp_path / 'nowhere.npz'}"]))
