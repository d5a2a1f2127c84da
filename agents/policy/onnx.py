"""From a policy file to an ONNX model: ``python -m agents.export_onnx POLICY.safetensors OUT.onnx``.

The model is the whole decision: eight numbers of the observation contract to the two of the action contract, with the
derived inputs and the clip. The inputs are traced from :mod:`agents.policy.features`, so that there is no second
definition.
"""

import importlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.policy.features import features, mirror_sign
from agents.policy.file import PolicyFile, read
from agents.policy.inference import PARITY_TOLERANCE, TOLERANCE, Policy
from agents.policy.onnx_trace import Graph, Traced
from agents.policy.schema import canonical
from agents.policy.versions import versions
from envs.edge.command import InputError, Parser
from envs.edge.files import check_regular, write_file
from envs.observation import SIZE

__all__ = ["INPUT", "IR_VERSION", "OPSET", "OUTPUT", "ExportError", "export", "main", "model"]

OPSET = 17
"""Of the operators, domain ``ai.onnx``: old enough for the verification tools, new enough for all that is used."""

IR_VERSION = 8
"""Of the file format, the one that belongs to the operator set."""

INPUT, OUTPUT = "observation", "action"
"""Names of the model's input, float32 ``[N, 8]``, and output, float32 ``[N, 2]``; N is free."""

_DESCRIPTION = """\
Write a policy as an ONNX model: observation [N, 8] to action [N, 2], both float32 in [-1, 1], N free, derived inputs
and clip included; an observation that is not finite, or that leaves [-1, 1], gives NaN. The model is compared with the
policy on its parity vectors before it is written."""

_EPILOG = """\
example:
  python -m agents.export_onnx agents/data/policy.safetensors runs/policy.onnx

Contracts, limits, architecture and digest are in the model's metadata (docs/reference/policy-file.md). Neither
jax nor onnxruntime is needed; the extra "onnx" installs onnx and onnxruntime."""


class ExportError(InputError):
    """A model that cannot be made or written; the message says why."""


def model(content: PolicyFile) -> Any:
    """Return the ``onnx.ModelProto`` of a policy, checked by onnx; equal policies give equal bytes.

    Args:
        content: of the policy file.

    Raises:
        ExportError: the onnx package is not installed.
    """
    onnx = _onnx()
    graph = _traced(content)
    make = onnx.helper
    nodes = [make.make_node(node.op, node.inputs, node.outputs, **dict(node.attributes)) for node in graph.nodes]
    constants = [onnx.numpy_helper.from_array(tensor, name) for name, tensor in graph.tensors.items()]
    ends = [
        make.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["N", width])
        for name, width in ((INPUT, SIZE), (OUTPUT, 2))
    ]
    made = make.make_model(
        make.make_graph(nodes, "rlcas_policy", ends[:1], ends[1:], constants),
        opset_imports=[make.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="rlcas-toolkit",
        producer_version=versions()["rlcas-toolkit"],
    )
    make.set_model_props(made, _properties(content))
    onnx.checker.check_model(made, full_check=True)
    return made


def export(source: str | os.PathLike[str], target: str | os.PathLike[str]) -> float:
    """Write the ONNX model of a policy file, whole or not at all.

    Args:
        source: the policy file.
        target: the model's file; a model that is there is replaced, anything else is left alone.

    Returns:
        The largest difference of an action from :class:`agents.inference.Policy` on the policy's parity vectors, both
        in float32.

    Raises:
        PolicyFileError: the policy file is refused.
        ExportError: the onnx package is not installed, the model disagrees, the target is the policy or another file
            that is no ONNX model, or it cannot be written.
    """
    content = read(source)
    _check_target(Path(source), Path(target))
    made = model(content)
    evaluator = importlib.import_module("onnx.reference").ReferenceEvaluator(made)
    (actions,) = evaluator.run(None, {INPUT: content.parity_observation})
    policy = Policy(content, source=os.fspath(source))
    difference = float(np.abs(actions - policy(content.parity_observation)).max())
    # Inverted, so that NaN is refused.
    if not difference <= PARITY_TOLERANCE:
        raise ExportError(f"{source}: the model's actions differ by {difference:.1e}, expected {PARITY_TOLERANCE}")
    try:
        write_file(target, made.SerializeToString(deterministic=True))
    except OSError as problem:
        raise ExportError(f"{target}: cannot be written: {problem.strerror}") from None
    return difference


def main(arguments: Sequence[str] | None = None) -> int:
    """Export what the command line asks for and return the exit status.

    Raises:
        ConfigError: bad usage; also ``PolicyFileError`` and ``ExportError``.
    """
    parser = Parser(prog="python -m agents.export_onnx", description=_DESCRIPTION, epilog=_EPILOG)
    parser.add_argument("policy", type=Path, metavar="POLICY.safetensors", help="policy file")
    parser.add_argument("out", type=Path, metavar="OUT.onnx", help="model to write; replaced if one is there")
    options = parser.parse_args(arguments)
    difference = export(options.policy, options.out)
    print(f"{options.out}: opset {OPSET}, largest difference from the policy {difference:.1e} on its parity vectors")
    return 0


def _traced(content: PolicyFile) -> Graph:
    """Return the graph of a policy; components of the observation are columns ``[N, 1]`` in it."""
    graph = Graph()
    components = graph.apply_many("Split", [graph.value(INPUT)], SIZE, axis=1)
    x = graph.apply("Concat", *features(list(components), content.feature_set, graph), axis=1)

    def layer(x: Traced, name: str) -> Traced:
        kernel, bias = (graph.tensor(f"{name}/{part}", content.actor[f"{name}/{part}"]) for part in ("kernel", "bias"))
        return graph.apply("Gemm", x, kernel, bias)

    for number in range(len(content.hidden)):
        x = graph.apply("Tanh", layer(x, f"hidden_{number}"))
    x = layer(x, "head")
    sign = mirror_sign(list(components), content.feature_set, graph)
    if isinstance(sign, Traced):
        acceleration, yaw_rate = graph.apply_many("Split", [x], 2, axis=1)
        x = graph.apply("Concat", acceleration, yaw_rate * sign, axis=1)
    # 0 where all components are in range, NaN where one is not: comparisons inside would make a number of it.
    inside = graph.sqrt(1.0 + TOLERANCE - graph.abs(graph.value(INPUT)))
    zero = graph.apply("MatMul", inside, graph.tensor("zeros", np.zeros((SIZE, 2))))
    graph.rename(graph.clip(x, -1.0, 1.0) + zero, OUTPUT)
    return graph


def _properties(content: PolicyFile) -> dict[str, str]:
    """Return the model's metadata: what the policy's numbers mean and which policy it is, JSON but for the digests."""
    parts = {name: canonical(content.metadata[name]) for name in ("schema", "observation", "action", "limits")}
    return {
        "policy_sha256": content.sha256,
        "training_config_sha256": content.metadata["training"]["config_sha256"],
        "architecture": canonical(content.metadata["architecture"]),
        **parts,
    }


def _check_target(source: Path, target: Path) -> None:
    """Refuse to replace what is no ONNX model, the policy itself first."""
    if not target.exists():
        return
    if target.samefile(source):
        raise ExportError(f"{target}: is the policy file itself; expected another file for the model")
    onnx = _onnx()
    try:
        check_regular(target)
        found = onnx.load(target, load_external_data=False)
        is_model = bool(found.opset_import) and bool(found.graph.node)
    except Exception:  # what decodes a foreign file can fail in any way
        is_model = False
    if not is_model:
        raise ExportError(f"{target}: holds something that is no ONNX model; expected a new file or a model to replace")


def _onnx() -> Any:
    try:
        return importlib.import_module("onnx")
    except ImportError:
        raise ExportError(
            "onnx is not installed, expected the extra 'onnx': pip install 'rlcas-toolkit[onnx]'"
        ) from None
