"""The ONNX model decides as the policy does, says what it is, and gives no number for bad input."""

import json
import sys
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.learning import onnx as export_onnx
from agents.learning.onnx import (
    OPSET,
    ExportError,
    States,
    export,
    inputs_of,
    inputs_of_states,
    model,
    random_states,
)
from agents.policy import file as policy_file
from agents.policy.file import PolicyFile
from agents.policy.inference import Policy
from agents.policy.schema import SetOf
from commands.command import run_cli
from envs.aircraft import PAPER
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from tests.agents.policies import FAMILY, random_policy

onnx = pytest.importorskip("onnx")
pytest.importorskip("jax2onnx")
reference = pytest.importorskip("onnx.reference")
onnxruntime = pytest.importorskip("onnxruntime")

pytestmark = pytest.mark.slow

PARITY = 1e-4
SHIPPED = Path(str(resources.files("agents").joinpath("data/policy.safetensors")))


def states(count: int, most: int) -> tuple[Any, ...]:
    """Return encounters at their start: own, intruders, mask and goal."""
    drawn = encounters_of_seed(scenario("multi", PAPER, intruders=(1, most)), 7, 0, count)
    return drawn.own, drawn.intruders, drawn.mask, drawn.goal_x, drawn.goal_y


@cache
def random_content(feature_set: str) -> PolicyFile:
    """Return a policy file of random numbers."""
    of_set = SetOf((12,), 3, PAPER, FAMILY) if feature_set == "set" else None
    return random_policy((16, 24), feature_set, of_set, spread=1.0, seed=4)


@cache
def shipped_model() -> Any:
    return model(policy_file.read(SHIPPED))


@cache
def random_model(feature_set: str) -> Any:
    return model(random_content(feature_set))


def run_onnx(onnx_model: Any, inputs: dict[str, np.ndarray]) -> np.ndarray:
    settings = onnxruntime.SessionOptions()
    settings.intra_op_num_threads = settings.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(
        onnx_model.SerializeToString(), settings, providers=["CPUExecutionProvider"]
    )
    return session.run(None, inputs)[0]


def as_inputs(*states: Any) -> dict[str, np.ndarray]:
    return inputs_of_states(States(*states), PAPER)


# What flies, and how far the actions may differ; on the line to the goal the side is of rounding.
@pytest.mark.parametrize(
    ("size", "most", "own_separations"),
    [(3.0, 4, False), (18.0, 12, False), (60.0, 4, False), (400.0, 1, False), (30.0, 20, True)],
    ids=["near", "seen", "far", "very far", "many with separations of their own"],
)
def test_it_decides_as_the_shipped_policy(size: float, most: int, own_separations: bool):
    random = np.random.default_rng(int(size))
    states = random_states(PAPER, random, 2000, most, size)
    distance_scale = random.uniform(0.3, 3.3, states.mask.shape) if own_separations else None
    flown = Policy.load().for_aircraft(PAPER, outside="allow").command(*states, distance_scale)
    actions = run_onnx(shipped_model(), inputs_of_states(states, PAPER, distance_scale))
    assert np.abs(actions - flown).max() <= 1e-5


def test_an_absent_intruder_s_separation_counts_nowhere():
    states = random_states(PAPER, np.random.default_rng(0), 200, 3, 9.0)
    nobody = states._replace(mask=np.zeros_like(states.mask))
    policy, far = Policy.load(), np.full(states.mask.shape, 3.3)
    assert np.array_equal(policy.command(*nobody, far), policy.command(*nobody, 0.1 * far))


@pytest.mark.parametrize("feature_set", ["none", "mirror", "set"])
def test_every_network_is_exported(feature_set: str):
    content = random_content(feature_set)
    actions = run_onnx(random_model(feature_set), inputs_of(content))
    np.testing.assert_allclose(actions, content.parity_action, rtol=0.0, atol=PARITY)
    assert content.parity_action.std(axis=0).min() > 0.03


def test_batch_and_intruders_are_free_and_the_action_clipped():
    onnx_model = shipped_model()
    for count, most in ((1, 1), (3, 5)):
        actions = run_onnx(onnx_model, as_inputs(*states(count, most)))
        assert actions.shape == (count, 2)
        assert np.abs(actions).max() <= 1.0


def test_it_says_what_it_is():
    onnx_model, content = shipped_model(), policy_file.read(SHIPPED)
    properties = {entry.key: entry.value for entry in onnx_model.metadata_props}
    assert properties["policy_sha256"] == content.sha256 == Policy.load().sha256
    for part in ("schema", "scene", "action", "limits", "task", "family", "architecture"):
        assert json.loads(properties[part]) == content.metadata[part]
    assert [
        (entry.domain, entry.version) for entry in onnx_model.opset_import if not entry.domain
    ] == [("", OPSET)]
    assert [value.name for value in onnx_model.graph.input] == ["own", "traffic", "mask"]
    assert [value.name for value in onnx_model.graph.output] == ["action"]
    # Every operator is of the plain set, so that tools without control flow can read it.
    assert {node.op_type for node in onnx_model.graph.node}.isdisjoint(
        {"If", "Loop", "Scan", "Custom"}
    )


def test_equal_policies_give_equal_bytes():
    again = model(random_content("mirror"))
    assert again.SerializeToString(deterministic=True) == random_model("mirror").SerializeToString(
        deterministic=True
    )


def test_a_model_that_disagrees_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(export_onnx, "read", lambda _: random_content("none"))
    monkeypatch.setattr(export_onnx, "model", lambda *_: random_model("mirror"))
    with pytest.raises(ExportError, match="the model's actions differ by"):
        export(SHIPPED, tmp_path / "policy.onnx")
    assert not list(tmp_path.iterdir())


def test_bad_input_ends_with_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    damaged = tmp_path / "damaged.safetensors"
    damaged.write_bytes(SHIPPED.read_bytes()[:-1])
    for arguments, words in (
        ([str(tmp_path / "none.safetensors"), "out.onnx"], "no such policy file"),
        ([str(damaged), str(tmp_path / "out.onnx")], "damaged.safetensors"),
        (
            [str(SHIPPED), str(tmp_path / "none" / "out.onnx")],
            "cannot be written: No such file or directory",
        ),
        ([str(SHIPPED), str(tmp_path)], "cannot be written: Is a directory"),
        ([str(SHIPPED)], "required: OUT.onnx"),
    ):
        with pytest.raises(SystemExit) as ended:
            run_cli(lambda arguments=arguments: export_onnx.main(arguments))
        assert ended.value.code == 2
        error = capsys.readouterr().err
        assert words in error
        assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == [damaged]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1.0001, -1.5, 3e38])
def test_an_observation_that_the_policy_refuses_gives_no_number(bad: float):
    onnx_model = random_model("mirror")
    good = np.random.default_rng(1).uniform(-1.0, 1.0, (9, 8)).astype(np.float32)
    spoilt = good.copy()
    spoilt[np.arange(8), np.arange(8)] = bad
    with np.errstate(invalid="ignore", over="ignore"):
        actions, expected = (
            run_onnx(onnx_model, {"observation": spoilt}),
            run_onnx(onnx_model, {"observation": good}),
        )
    assert np.isnan(actions[:8]).all()
    assert np.array_equal(actions[8], expected[8])
    assert np.isfinite(expected).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_scene_that_is_not_finite_gives_no_number(bad: float):
    onnx_model, good = random_model("set"), inputs_of(random_content("set"))
    for name in good:
        spoilt = {key: values.copy() for key, values in good.items()}
        spoilt[name][0].flat[0] = bad
        actions = run_onnx(onnx_model, spoilt)
        assert np.isnan(actions[0]).all()
        assert np.isfinite(actions[1:]).all()


def test_the_policy_is_not_replaced_by_its_model(tmp_path: Path):
    policy, link = tmp_path / "policy.safetensors", tmp_path / "link"
    policy.write_bytes(SHIPPED.read_bytes())
    link.symlink_to(policy)
    for target in (policy, link):
        with pytest.raises(ExportError, match="policy file itself"):
            export(policy, target)
    assert policy.read_bytes() == SHIPPED.read_bytes()


def test_without_onnx_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(SystemExit) as ended:
        run_cli(lambda: export_onnx.main([str(SHIPPED), str(tmp_path / "out.onnx")]))
    assert ended.value.code == 2
    assert (
        "onnx is not installed; expected the extra: pip install 'rlcas-toolkit[onnx]'"
        in capsys.readouterr().err
    )
