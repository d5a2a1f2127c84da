"""From a policy file to an ONNX model: ``python -m agents.export_onnx POLICY.safetensors
OUT.onnx``.

The model is the whole decision, with the derived inputs and the clip. It is converted from the
training framework's own functions, so that there is no second definition.
"""

import importlib
import logging
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from agents.learning.export import variables
from agents.learning.networks import Actor
from agents.policy.digest import canonical
from agents.policy.file import PolicyFile, read
from agents.policy.inference import TOLERANCE, Policy, input_table
from agents.policy.inputs import Input, resolve
from agents.policy.scene import OWN_NUMBERS, parts, unpack
from agents.policy.set_features import set_inputs
from agents.policy.set_network import check_one_layer
from envs.edge.command import InputError, Parser
from envs.edge.files import write_file
from envs.edge.installation import versions
from envs.observation import SIZE

OPSET = 21
"""Of the operators, domain ``ai.onnx``."""

_IR = 10  # version of the format that belongs to this set of operators; runtimes refuse later ones
# of actions from the parity vectors, which are of double precision; the model is of single
_TOLERANCE = 1e-4

_DESCRIPTION = """\
Write a policy as an ONNX model, float32, N and K free, derived inputs and clip included. A policy
for any number of intruders maps own [N, 7], traffic [N, K, 4] and mask [N, K] (1 or 0) to
action [N, 2]: the scene without dimension of docs/reference/policy-file.md. One of schema 1 maps
observation [N, 8] to action [N, 2]. Input that is not finite, or an observation that leaves [-1,
1], gives NaN. The model is compared with the policy on its parity vectors before it is written."""

_EPILOG = """\
example:
  python -m agents.export_onnx agents/data/policy.safetensors runs/policy.onnx

Contracts, limits, architecture and digest are in the model's metadata
(docs/reference/policy-file.md)."""


class ExportError(InputError):
    """A model that cannot be made or written; the message says why."""


def model(content: PolicyFile, inputs: Sequence[Input] = ()) -> Any:
    """Return the ``onnx.ModelProto`` of a policy, checked by onnx; equal policies give
    equal bytes. ``inputs`` are of the user's own, beside the registered ones.
    """
    onnx: Any = importlib.import_module("onnx")
    converter: Any = importlib.import_module("jax2onnx")
    function, shapes = _decision(content, inputs)
    for each in (
        "onnx_ir",
        "jax2onnx",
    ):  # the one warns of every shape that it leaves out, the other of unused plugins
        logging.getLogger(each).setLevel(logging.ERROR)
    names = {"input_names": list(inputs_of(content)), "output_names": ["action"]}
    made = converter.to_onnx(function, shapes, model_name="rlcas_policy", opset=OPSET, **names)
    # The converter's shapes of what lies between are those of one batch; runtimes find them again.
    del made.graph.value_info[:]
    made.producer_name, made.producer_version = "rlcas-toolkit", versions()["rlcas-toolkit"]
    onnx.helper.set_model_props(made, _properties(content))
    onnx.checker.check_model(made, full_check=True)
    return made


class _Layers:
    """The nodes of a network, and the values of its tensors by their names."""

    def __init__(self, make_node: Callable[..., Any]) -> None:
        self._make_node = make_node
        self.nodes: list[Any] = []
        self.values: dict[str, np.ndarray] = {}

    def gemm(self, name: str, source: str, kernel: np.ndarray, bias: np.ndarray) -> str:
        """Add a product with a kernel ``[in, out]`` and a bias; return the name of its output."""
        self.values |= {f"{name}/kernel": kernel, f"{name}/bias": bias}
        return self.node("Gemm", name, source, f"{name}/kernel", f"{name}/bias")

    def tanh(self, source: str) -> str:
        """Add a tanh; return the name of its output."""
        return self.node("Tanh", f"{source}/tanh", source)

    def node(self, kind: str, name: str, *sources: str) -> str:
        """Add a node; return the name of its output."""
        self.nodes.append(self._make_node(kind, [*sources], [name]))
        return name


def network_part(policy: Policy) -> Any:
    """Return the ``onnx.ModelProto`` of the network for one intruder behind its derived inputs, for
    verifiers.

    Gemm, Tanh and one Add, from ``inputs`` ``[N, 53]`` to ``action`` ``[N, 2]``: before the clip,
    and as the scene is seen mirrored (:mod:`agents.policy.set_features`: what describes the
    ownship, then the intruder). Raises an InputError where the policy has not one layer for each
    intruder.
    """
    check_one_layer(policy)
    onnx: Any = importlib.import_module("onnx")
    layers = _layers_of(policy, onnx.helper.make_node)
    size = policy.inputs.own_size + policy.inputs.each_size
    graph = onnx.helper.make_graph(
        layers.nodes,
        "rlcas_policy_network",
        [onnx.helper.make_tensor_value_info("inputs", onnx.TensorProto.FLOAT, ["N", size])],
        [onnx.helper.make_tensor_value_info("action", onnx.TensorProto.FLOAT, ["N", 2])],
        [
            onnx.numpy_helper.from_array(np.asarray(value, np.float32), name)
            for name, value in layers.values.items()
        ],
    )
    made = onnx.helper.make_model(
        graph, opset_imports=[onnx.helper.make_opsetid("", OPSET)], ir_version=_IR
    )
    onnx.helper.set_model_props(made, {"policy_sha256": policy.sha256})
    onnx.checker.check_model(made, full_check=True)
    return made


def _layers_of(policy: Policy, make_node: Callable[..., Any]) -> _Layers:
    """Return the layers of a policy for one intruder, from ``inputs`` to ``action``.

    Rows of zeros take the place of slices: the encoder reads what describes the intruder, the trunk
    the rest.
    """
    tensors, layers = policy.tensors, _Layers(make_node)
    encoder, trunk = tensors["each_0/kernel"], tensors["hidden_0/kernel"]
    own_size, bias = policy.inputs.own_size, tensors["hidden_0/bias"]
    each = np.pad(encoder, ((own_size, 0), (0, 0)))
    seen = layers.tanh(layers.gemm("each_0", "inputs", each, tensors["each_0/bias"]))
    of_own = np.pad(trunk[:own_size], ((0, len(encoder)), (0, 0)))
    own = layers.gemm("own", "inputs", of_own, bias)
    pooled = layers.gemm("pooled", seen, trunk[own_size:], 0.0 * bias)
    last = layers.tanh(layers.node("Add", "hidden_0", own, pooled))
    for number in range(1, len(policy.metadata["architecture"]["hidden"])):
        name = f"hidden_{number}"
        last = layers.gemm(name, last, tensors[f"{name}/kernel"], tensors[f"{name}/bias"])
        last = layers.tanh(last)
    layers.gemm("action", last, tensors["head/kernel"], tensors["head/bias"])
    return layers


def inputs_of(content: PolicyFile) -> dict[str, np.ndarray]:
    """Return the model's inputs by name, with the values of the policy's parity vectors,
    float32.
    """
    rows = content.parity_observation
    if not content.of_set:
        return {"observation": rows}
    own, each = parts(rows)
    return {"own": own, "traffic": each[..., :4], "mask": each[..., 4]}


def export(
    source: str | os.PathLike[str],
    target: str | os.PathLike[str],
    inputs: Sequence[Input] = (),
) -> float:
    """Write the ONNX model of a policy file, whole or not at all; return the largest difference on
    its parity vectors. ``inputs`` are of the user's own, beside the registered ones.

    Raises:
        PolicyFileError: the policy file is refused.
        ExportError: the model disagrees, the target is the policy itself, or it cannot be written.
        ModuleNotFoundError: the extra ``onnx`` is not installed.
    """
    content = read(source)
    if Path(target).exists() and Path(target).samefile(source):
        raise ExportError(
            f"{target}: is the policy file itself; expected another file for the model"
        )
    made = model(content, inputs)
    evaluator = importlib.import_module("onnx.reference").ReferenceEvaluator(made)
    (actions,) = evaluator.run(None, inputs_of(content))
    difference = float(np.abs(actions - content.parity_action).max())
    # Inverted, so that NaN is refused.
    if not difference <= _TOLERANCE:
        raise ExportError(
            f"{source}: the model's actions differ by {difference:.1e}, expected {_TOLERANCE}"
        )
    try:
        write_file(target, made.SerializeToString(deterministic=True))
    except OSError as problem:
        raise ExportError(f"{target}: cannot be written: {problem.strerror}") from None
    return difference


def main(arguments: Sequence[str] | None = None) -> int:
    """Export what the command line asks for and return the exit status; bad input raises an
    InputError.
    """
    parser = Parser(prog="python -m agents.export_onnx", description=_DESCRIPTION, epilog=_EPILOG)
    parser.add_argument("policy", type=Path, metavar="POLICY.safetensors", help="policy file")
    parser.add_argument(
        "out", type=Path, metavar="OUT.onnx", help="model to write; replaced if one is there"
    )
    parser.add_argument(
        "--extension",
        action="append",
        default=[],
        metavar="MODULE:NAME",
        help="input of your own that the policy needs; may be repeated",
    )
    options = parser.parse_args(arguments)
    difference = export(options.policy, options.out, resolve(options.extension))
    print(
        f"{options.out}: opset {OPSET}, largest difference from the policy {difference:.1e} on "
        "its parity vectors"
    )
    return 0


def _decision(
    content: PolicyFile, inputs: Sequence[Input]
) -> tuple[Callable[..., jax.Array], list[tuple[int | str, ...]]]:
    """Return the decision of a policy as a function of jax, and the shapes of its inputs."""
    table = input_table(content, inputs)
    actor = Actor(content.hidden, content.feature_set, encoder=content.encoder)
    weights = variables({name: jnp.asarray(tensor) for name, tensor in content.actor.items()})

    def clip(seen: Any, nothing: jax.Array) -> jax.Array:
        mean: Any = actor.apply(weights, seen)
        return jnp.clip(mean[0], -1.0, 1.0) + nothing[:, None]

    def of_scene(own: jax.Array, traffic: jax.Array, mask: jax.Array) -> jax.Array:
        rows = jnp.concatenate([traffic, mask[..., None]], axis=-1)
        seen = unpack(own, rows)
        # 0, but NaN where a number is not finite: comparisons inside would make a number of it.
        nothing = 0.0 * (jnp.sum(own, axis=-1) + jnp.sum(rows, axis=(-2, -1)))
        return clip(set_inputs(seen, jnp, table), nothing)

    def of_observation(observation: jax.Array) -> jax.Array:
        inside = jnp.sqrt(1.0 + TOLERANCE - jnp.abs(observation))
        return clip(observation, 0.0 * jnp.sum(inside, axis=-1))

    if content.of_set:
        return of_scene, [("N", OWN_NUMBERS), ("N", "K", 4), ("N", "K")]
    return of_observation, [("N", SIZE)]


def _properties(content: PolicyFile) -> dict[str, str]:
    """Return the model's metadata: what the policy's numbers mean and which policy it is, JSON but
    for the digests.
    """
    kept = ("schema", "scene", "observation", "action", "limits", "task", "family", "inputs")
    parts = {name: canonical(content.metadata[name]) for name in kept if name in content.metadata}
    return {
        "policy_sha256": content.sha256,
        "training_config_sha256": content.metadata["training"]["config_sha256"],
        "architecture": canonical(content.metadata["architecture"]),
        **parts,
    }
