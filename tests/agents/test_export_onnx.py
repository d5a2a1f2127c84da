"""The ONNX model decides as the policy does, says what it is, and is the one definition of the inputs, traced."""

import json
import subprocess
import sys
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.policy import file as policy_file
from agents.policy import onnx as export_onnx
from agents.policy.features import FEATURE_SETS, features, size
from agents.policy.file import PolicyFile
from agents.policy.inference import Policy
from agents.policy.onnx import INPUT, IR_VERSION, OPSET, ExportError, export, model
from agents.policy.onnx_trace import Graph
from agents.policy.schema import new_metadata
from envs.aircraft import PAPER
from envs.angles import atan2
from envs.edge.command import run_cli
from envs.encounters import scenario
from envs.kinematics import SURROGATE
from envs.starts import numbered
from tests.support import OnObservations, fly_recorded

onnx = pytest.importorskip("onnx")
reference = pytest.importorskip("onnx.reference")
onnxruntime = pytest.importorskip("onnxruntime")

PARITY = 2e-5
SHIPPED = Path(str(resources.files("agents").joinpath("data/policy.safetensors")))
ROOT = Path(__file__).resolve().parents[2]


@cache
def random_policy(feature_set: str, hidden: tuple[int, ...] = (16, 24)) -> PolicyFile:
    """Return a policy of random numbers; its parity vectors are those of numpy in double precision."""
    from agents.policy.inference import _forward, _layers

    random = np.random.default_rng(4)
    widths = (size(feature_set), *hidden, 2)
    names = [*(f"hidden_{i}" for i in range(len(hidden))), "head"]
    actor = {"log_std": np.zeros(2, np.float32)}
    for name, before, after in zip(names, widths, widths[1:], strict=False):
        actor[f"{name}/kernel"] = random.normal(0.0, 1.4 / np.sqrt(before), (before, after)).astype(np.float32)
        actor[f"{name}/bias"] = random.normal(0.0, 0.3, after).astype(np.float32)
    observations = random.uniform(-1.0, 1.0, (16, 8)).astype(np.float32)
    metadata = new_metadata(hidden, feature_set, SURROGATE, {}, steps=0, score=None, versions={})
    blank = PolicyFile(actor, observations, np.zeros((16, 2), np.float32), metadata)
    actions = _forward(observations.astype(np.float64), _layers(blank, np.float64), feature_set)
    return PolicyFile(actor, observations, actions.astype(np.float32), metadata)


@cache
def shipped_model() -> Any:
    return model(policy_file.read(SHIPPED))


def session(made: Any) -> Any:
    settings = onnxruntime.SessionOptions()
    settings.intra_op_num_threads = settings.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(made.SerializeToString(), settings, providers=["CPUExecutionProvider"])


def decided(made: Any, observation: np.ndarray) -> np.ndarray:
    return session(made).run(None, {INPUT: observation})[0]


def scattered(count: int) -> np.ndarray:
    """Return random observations, every third with some components at the ends or in the middle of their range."""
    random = np.random.default_rng(1)
    observation = random.uniform(-1.0, 1.0, (count, 8))
    special = random.integers(0, 2, (count, 8)).astype(bool) & (np.arange(count) % 3 == 0)[:, None]
    return np.where(special, random.choice([-1.0, 0.0, 1.0], (count, 8)), observation).astype(np.float32)


def test_it_decides_as_the_shipped_policy_on_random_observations():
    observation = scattered(30_000)
    actions = decided(shipped_model(), observation)
    assert actions.dtype == np.float32
    np.testing.assert_allclose(actions, Policy.load()(observation), rtol=0.0, atol=PARITY)


def test_it_decides_as_the_shipped_policy_in_flight():
    policy = Policy.load()
    starts = numbered(scenario("circle", PAPER), 7, 0, 60)
    decider = OnObservations(policy.rowwise)
    fly_recorded(starts, decider, PAPER)
    seen = np.concatenate(decider.seen)
    assert len(seen) > 3_000
    np.testing.assert_allclose(decided(shipped_model(), seen), policy(seen), rtol=0.0, atol=PARITY)


@pytest.mark.parametrize("feature_set", FEATURE_SETS)
def test_every_feature_set_is_exported(feature_set: str):
    content, observation = random_policy(feature_set), scattered(3_000)
    expected = Policy(content)(observation)
    assert expected.std(axis=0).min() > 0.1
    np.testing.assert_allclose(decided(model(content), observation), expected, rtol=0.0, atol=PARITY)


def test_the_batch_is_free_and_the_action_clipped():
    made = session(shipped_model())
    for count in (0, 1, 3):
        assert made.run(None, {INPUT: np.zeros((count, 8), np.float32)})[0].shape == (count, 2)
    actions = made.run(None, {INPUT: scattered(5_000)})[0]
    assert np.abs(actions).max() == 1.0
    with pytest.raises(Exception, match="Got: 7 Expected: 8"):
        made.run(None, {INPUT: np.zeros((3, 7), np.float32)})


def test_it_says_what_it_is():
    made, content = shipped_model(), policy_file.read(SHIPPED)
    said = {entry.key: entry.value for entry in made.metadata_props}
    assert said["policy_sha256"] == content.sha256 == Policy.load().sha256
    for part in ("schema", "observation", "action", "limits", "architecture"):
        assert json.loads(said[part]) == content.metadata[part]
    assert [(entry.domain, entry.version) for entry in made.opset_import] == [("", OPSET)]
    assert made.ir_version == IR_VERSION
    assert [value.name for value in (*made.graph.input, *made.graph.output)] == ["observation", "action"]
    assert all(tensor.data_type == onnx.TensorProto.FLOAT for tensor in made.graph.initializer)
    # The limits of Clip must be scalars, which not every runtime insists on.
    assert {len(t.dims) for t in made.graph.initializer if t.name.startswith("constant")} == {0}
    # Every operator is of the plain set, so that tools without control flow can read it.
    assert {node.op_type for node in made.graph.node}.isdisjoint({"If", "Loop", "Scan", "Custom"})


def test_equal_policies_give_equal_bytes():
    first, second = (model(random_policy("cpa")).SerializeToString(deterministic=True) for _ in range(2))
    assert first == second


def test_equal_operations_are_recorded_once():
    graph = Graph()
    a = graph.value("a")
    assert (a + 1.0).name == (a + 1.0).name
    assert (a + 1.0).name != (1.0 + a).name
    assert [node.op for node in graph.nodes] == ["Add", "Add"]


@pytest.mark.parametrize("name", ["arctangent", "reversed"])
def test_other_functions_of_the_core_can_be_traced(name: str):
    def compute(y: Any, x: Any, xp: Any) -> Any:
        return atan2(y, x, xp) if name == "arctangent" else 2.0 / (xp.maximum(x, y) + 3.0)

    graph = Graph()
    y, x = graph.apply_many("Split", [graph.value("points")], 2, axis=1)
    graph.rename(compute(y, x, graph), "result")
    make = onnx.helper
    ends = [make.make_tensor_value_info(n, onnx.TensorProto.FLOAT, ["N", w]) for n, w in (("points", 2), ("result", 1))]
    made = make.make_model(
        make.make_graph(
            [make.make_node(node.op, node.inputs, node.outputs, **dict(node.attributes)) for node in graph.nodes],
            "test",
            ends[:1],
            ends[1:],
            [onnx.numpy_helper.from_array(tensor, key) for key, tensor in graph.tensors.items()],
        ),
        opset_imports=[make.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
    )
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (500, 2)).astype(np.float32)
    (result,) = session(made).run(None, {"points": points})
    np.testing.assert_allclose(result[:, 0], compute(points[:, 0], points[:, 1], np), rtol=0.0, atol=1e-6)


def test_what_branches_on_its_values_cannot_be_traced():
    graph = Graph()
    with pytest.raises(TypeError, match=r"no truth value; write the choice with xp\.where"):
        bool(graph.value("a") > 0.0)


def test_a_model_that_disagrees_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def wrong(observation: list[Any], feature_set: str, xp: Any) -> list[Any]:
        return [1.01 * value for value in features(observation, feature_set, xp)]

    monkeypatch.setattr(export_onnx, "features", wrong)
    with pytest.raises(ExportError, match="the model's actions differ by"):
        export(SHIPPED, tmp_path / "policy.onnx")
    assert not list(tmp_path.iterdir())


def test_the_command_needs_no_training_framework(tmp_path: Path):
    target = tmp_path / "policy.onnx"
    target.write_bytes(model(random_policy("none")).SerializeToString())
    program = (
        "import sys; from agents.policy.onnx import main; main(sys.argv[1:]); "
        "print(sorted({'jax', 'flax', 'onnxruntime'} & set(sys.modules)))"
    )
    ran = subprocess.run(
        [sys.executable, "-c", program, str(SHIPPED), str(target)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    first, second = ran.stdout.splitlines()
    assert first.startswith(f"{target}: opset {OPSET}, largest difference from the policy")
    assert second == "[]"
    assert list(tmp_path.iterdir()) == [target]
    assert target.read_bytes() == shipped_model().SerializeToString(deterministic=True)


def test_bad_input_ends_with_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    damaged = tmp_path / "damaged.safetensors"
    damaged.write_bytes(SHIPPED.read_bytes()[:-1])
    for arguments, words in (
        ([str(tmp_path / "none.safetensors"), "out.onnx"], "no such policy file"),
        ([str(damaged), str(tmp_path / "out.onnx")], "damaged.safetensors"),
        ([str(SHIPPED), str(tmp_path / "none" / "out.onnx")], "cannot be written: No such file or directory"),
        ([str(SHIPPED), str(tmp_path)], "no ONNX model"),
        ([str(SHIPPED)], "required: OUT.onnx"),
    ):
        with pytest.raises(SystemExit) as ended:
            run_cli(lambda arguments=arguments: export_onnx.main(arguments))
        assert ended.value.code == 2
        error = capsys.readouterr().err
        assert words in error
        assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == [damaged]


@pytest.mark.parametrize("feature_set", ["none", "advised"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1.0001, -1.5, 3e38])
def test_an_observation_that_the_policy_refuses_gives_no_number(feature_set: str, bad: float):
    made = model(random_policy(feature_set))
    good = scattered(10)[:9].astype(np.float32)
    spoilt = good.copy()
    spoilt[np.arange(8), np.arange(8)] = bad
    session = onnxruntime.InferenceSession(made.SerializeToString())
    for run in (session.run, reference.ReferenceEvaluator(made).run):
        with np.errstate(invalid="ignore", over="ignore"):
            (actions,), (expected,) = run(None, {INPUT: spoilt}), run(None, {INPUT: good})
        assert np.isnan(actions[:8]).all()
        assert np.array_equal(actions[8], expected[8])
        assert np.isfinite(expected).all()


@pytest.mark.parametrize("content", [b"", b"text\n", SHIPPED.read_bytes()[:4096]])
def test_what_is_no_model_is_not_replaced(tmp_path: Path, content: bytes):
    target = tmp_path / "kept"
    target.write_bytes(content)
    with pytest.raises(ExportError, match="no ONNX model"):
        export(SHIPPED, target)
    assert target.read_bytes() == content


def test_the_policy_is_not_replaced_by_its_model(tmp_path: Path):
    policy, link = tmp_path / "policy.safetensors", tmp_path / "link"
    policy.write_bytes(SHIPPED.read_bytes())
    link.symlink_to(policy)
    for target in (policy, link):
        with pytest.raises(ExportError, match="policy file itself"):
            export(policy, target)
    assert policy.read_bytes() == SHIPPED.read_bytes()


def test_without_onnx_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(ExportError, match=r"onnx is not installed, expected the extra 'onnx': pip install"):
        model(random_policy("none"))
