"""An actor becomes a policy file whose expected actions are flax's own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agents.learning.export import parity_observations, to_policy_file, write
from agents.learning.networks import Actor, Critic
from agents.policy.file import PolicyFileError, read
from agents.policy.inference import Policy
from envs.kinematics import C208_PUBLISHED, SURROGATE

HIDDEN = (16, 8)


def made(hidden=HIDDEN, feature_set="cpa", module=Actor):
    """Return parameters, free to be changed, of an actor whose actions are as large as a trained one's."""
    # Shapes from flax, values from numpy: compiling the orthogonal initialisation would take most of the test's time.
    shapes = jax.eval_shape(module(hidden, feature_set).init, jax.random.key(3), jnp.zeros((1, 8)))
    rng = np.random.default_rng(3)
    return jax.tree.map(lambda leaf: rng.normal(0.0, 1.4 / np.sqrt(leaf.shape[0]), leaf.shape).astype("f4"), shapes)


def description(**changes):
    return {
        "hidden": HIDDEN,
        "feature_set": "cpa",
        "limits": SURROGATE,
        "config": {"ppo": {"epochs": 4}, "widths": (1, 2)},
        "steps": 7,
    } | changes


@pytest.mark.parametrize(
    ("hidden", "feature_set"),
    [
        (HIDDEN, "cpa"),
        ((12,), "none"),
        ((4, 4, 4), "mirror"),
        pytest.param((5, 4), "foresight", marks=pytest.mark.slow),
        ((5, 4), "advised"),
        ((5, 4), "pressed"),
    ],
)
def test_written_policy_decides_as_flax(tmp_path, hidden, feature_set):
    variables = made(hidden, feature_set)
    path = tmp_path / "p.safetensors"
    written = write(
        path, jax.tree.map(jnp.asarray, variables), **description(hidden=hidden, feature_set=feature_set, score=3)
    )
    assert read(path).sha256 == written.sha256
    policy = Policy.load(path)
    observation = np.random.default_rng(0).uniform(-1, 1, (500, 8)).astype(np.float32)
    mean, log_std = jax.jit(Actor(hidden, feature_set).apply)(variables, observation)
    np.testing.assert_allclose(policy(observation), np.clip(mean, -1, 1), atol=2e-5)
    np.testing.assert_array_equal(written.actor["log_std"], log_std)


def test_metadata(tmp_path):
    path = tmp_path / "p.safetensors"
    write(path, made(), **description(limits=C208_PUBLISHED, score=-1.5, notes="a note"))
    metadata = read(path).metadata
    assert read(path).limits == C208_PUBLISHED
    assert metadata["architecture"] == {"hidden": [16, 8], "activation": "tanh", "feature_set": "cpa", "output": "clip"}
    training = metadata["training"]
    assert (training["config"], training["steps"], training["score"]) == (
        {"ppo": {"epochs": 4}, "widths": [1, 2]},
        7,
        -1.5,
    )
    assert metadata["versions"]["jax"] == jax.__version__
    assert metadata["notes"] == "a note"


def test_parity_vectors():
    observation = parity_observations()
    assert observation.dtype == np.float32
    assert observation.shape == (64 + 16, 8)
    np.testing.assert_array_equal(observation, parity_observations())
    assert (observation.min(0) == -1.0).all()
    assert (observation.max(0) == 1.0).all()
    content = to_policy_file(made(), **description())
    np.testing.assert_array_equal(content.parity_observation, observation)
    mean, _ = jax.jit(Actor(HIDDEN).apply)(made(), observation)
    np.testing.assert_allclose(content.parity_action, np.clip(mean, -1, 1), atol=2e-5)
    # Clipped answers would hide a wrong network, and so would tiny ones.
    assert (np.abs(content.parity_action) < 1.0).mean() > 0.5
    assert content.parity_action.std() > 0.05


def test_equal_actors_give_equal_files(tmp_path):
    for name in ("a", "b"):
        write(tmp_path / name, made(), **description())
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_double_precision_is_left_as_it_was():
    to_policy_file(made(), **description())
    assert jnp.zeros(1).dtype == jnp.float32


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("where", ["hidden_1", "log_std"])
def test_diverged_parameters_are_refused(tmp_path, bad, where):
    variables = made()
    if where == "log_std":
        variables["params"]["log_std"][1] = bad
    else:
        variables["params"]["trunk"][where]["kernel"][2, 3] = bad
    with pytest.raises(PolicyFileError, match=rf"parameter {where}.* is not finite"):
        write(tmp_path / "p.safetensors", variables, **description())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("variables", "changes", "message"),
    [
        (lambda: made(module=Critic), {}, "not those of agents.learning.networks.Actor"),
        (dict, {}, "not those of agents.learning.networks.Actor"),
        (lambda: made()["params"], {}, "not those of agents.learning.networks.Actor"),
        (made, {"hidden": (16, 9)}, r"tensor actor/hidden_1/kernel has shape \[16, 8\], expected \[16, 9\]"),
        (made, {"hidden": (16,)}, "tensor 'actor/hidden_1/bias' is unexpected"),
        (made, {"hidden": (16, 8, 4)}, "tensor actor/hidden_2/bias is missing"),
        (made, {"feature_set": "none"}, r"shape \[22, 16\], expected \[8, 16\]"),
        (made, {"feature_set": "magic"}, "feature_set is 'magic'"),
        (made, {"score": float("nan")}, "metadata cannot be written as JSON"),
        (made, {"steps": -1}, "steps is -1"),
        (made, {"config": {"a": np.zeros(2)}}, "metadata cannot be written as JSON"),
    ],
)
def test_what_cannot_be_exported(variables, changes, message):
    with pytest.raises(PolicyFileError, match=message):
        to_policy_file(variables(), **description(**changes))
