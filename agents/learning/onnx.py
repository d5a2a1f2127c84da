"""From a policy file to an ONNX model: ``python -m agents.export_onnx POLICY.safetensors
OUT.onnx``.

The model is the whole decision, from where everything is: the choice of the most critical
intruders, what is far away, the derived inputs and the clip. It is converted from the
training framework's own functions, so that there is no second definition.
"""

import importlib
import logging
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from agents.learning.export import variables
from agents.learning.networks import Actor
from agents.policy.digest import canonical
from agents.policy.file import PolicyFile, read
from agents.policy.inference import TOLERANCE, Policy, check_one_layer, input_table
from agents.policy.inputs import Input, resolve
from agents.policy.scene import (
    OWN_NUMBERS,
    Scene,
    as_seen,
    parts,
    surroundings,
    unpack,
)
from agents.policy.set_features import set_inputs
from commands.command import InputError, Parser
from commands.files import write_file
from commands.installation import versions
from envs.aircraft import Aircraft
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.observation import SIZE, rank_motion
from envs.relative import RelativeMotion

OPSET = 21
"""Of the operators, domain ``ai.onnx``."""

_IR = 10  # version of the format that belongs to this set of operators; runtimes refuse later ones
# of actions from the policy's; those of the parity vectors are of double precision, the model is of
# single
_TOLERANCE = 1e-4
_DRAWN = 200  # scenes of each kind, at which the model is compared with the policy

_DESCRIPTION = """\
Write a policy as an ONNX model, float32, N and K free: the whole decision, with the choice of the
most critical intruders, what is far away, derived inputs and clip. A policy for any number of
intruders maps own [N, 7], traffic [N, K, 4 or 5] and mask [N, K] (1 or 0) to action [N, 2]: the
scene without dimension of docs/reference/policy-file.md. One of schema 1 maps observation [N, 8]
to action [N, 2]. Input that is not finite, or an observation that leaves [-1, 1], gives NaN. The
model is compared with the policy before it is written: on its parity vectors, and near, far, among
many intruders and with separations of their own."""

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
    for logger in (
        "onnx_ir",
        "jax2onnx",
    ):  # the one warns of every shape that it leaves out, the other of unused plugins
        logging.getLogger(logger).setLevel(logging.ERROR)
    names = {"input_names": list(inputs_of(content)), "output_names": ["action"]}
    proto = converter.to_onnx(function, shapes, model_name="rlcas_policy", opset=OPSET, **names)
    # The converter's shapes of what lies between are those of one batch; runtimes find them again.
    del proto.graph.value_info[:]
    proto.producer_name, proto.producer_version = "rlcas-toolkit", versions()["rlcas-toolkit"]
    onnx.helper.set_model_props(proto, _properties(content))
    onnx.checker.check_model(proto, full_check=True)
    return proto


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
    size = policy.inputs.own_size + policy.inputs.intruder_size
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
    proto = onnx.helper.make_model(
        graph, opset_imports=[onnx.helper.make_opsetid("", OPSET)], ir_version=_IR
    )
    onnx.helper.set_model_props(proto, {"policy_sha256": policy.sha256})
    onnx.checker.check_model(proto, full_check=True)
    return proto


def _layers_of(policy: Policy, make_node: Callable[..., Any]) -> _Layers:
    """Return the layers of a policy for one intruder, from ``inputs`` to ``action``.

    Rows of zeros take the place of slices: the encoder reads what describes the intruder, the trunk
    the rest.
    """
    tensors, layers = policy.tensors, _Layers(make_node)
    encoder, trunk = tensors["each_0/kernel"], tensors["hidden_0/kernel"]
    own_size, bias = policy.inputs.own_size, tensors["hidden_0/bias"]
    kernel = np.pad(encoder, ((own_size, 0), (0, 0)))
    code = layers.tanh(layers.gemm("each_0", "inputs", kernel, tensors["each_0/bias"]))
    of_own = np.pad(trunk[:own_size], ((0, len(encoder)), (0, 0)))
    own = layers.gemm("own", "inputs", of_own, bias)
    pooled = layers.gemm("pooled", code, trunk[own_size:], 0.0 * bias)
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
    own, traffic = parts(rows)
    return {"own": own, "traffic": traffic[..., :4], "mask": traffic[..., 4]}


def export(
    source: str | os.PathLike[str],
    target: str | os.PathLike[str],
    inputs: Sequence[Input] = (),
) -> float:
    """Write the ONNX model of a policy file, whole or not at all; return the largest difference on
    its parity vectors and on what is drawn. ``inputs`` are of the user's own, beside the registered
    ones.

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
    proto = model(content, inputs)
    evaluator = importlib.import_module("onnx.reference").ReferenceEvaluator(proto)
    difference = 0.0
    for kind, feed, expected in _known_actions(content, inputs):
        (actions,) = evaluator.run(None, feed)
        largest = float(np.abs(actions - expected).max())
        # Inverted, so that NaN is refused.
        if not largest <= _TOLERANCE:
            raise ExportError(
                f"{source}: the model's actions differ by {largest:.1e} ({kind}), expected "
                f"{_TOLERANCE}"
            )
        difference = max(difference, largest)
    try:
        write_file(target, proto.SerializeToString(deterministic=True))
    except OSError as problem:
        raise ExportError(f"{target}: cannot be written: {problem.strerror}") from None
    return difference


def _known_actions(
    content: PolicyFile, inputs: Sequence[Input]
) -> Iterator[tuple[str, dict[str, np.ndarray], np.ndarray]]:
    """Yield inputs of the model by name with the actions ``[N, 2]`` that the policy takes there:
    its parity vectors, and random ones of several kinds, with the kind in words.
    """
    yield "parity vectors", inputs_of(content), content.parity_action
    policy, random = Policy(content, inputs=inputs), np.random.default_rng(14)
    if not content.of_set:
        observation = random.uniform(-1.0, 1.0, (_DRAWN, SIZE)).astype(np.float32)
        yield "random observations", {"observation": observation}, policy(observation)
        return
    policy = policy.for_aircraft(policy.aircraft, outside="allow")
    for kind, size, count, own_separations in (
        ("near", 3.0, policy.most, False),
        ("inside what is seen", 18.0, policy.most, False),
        ("far", 60.0, policy.most, False),
        ("more intruders than are looked at", 30.0, policy.most + 4, False),
        ("separations of their own", 30.0, policy.most + 4, True),
    ):
        states = random_states(policy.aircraft, random, _DRAWN, count, size)
        distance_scale = random.uniform(0.3, 3.3, states.mask.shape) if own_separations else None
        yield (
            kind,
            inputs_of_states(states, policy.aircraft, distance_scale),
            policy.command(*states, distance_scale),
        )


class States(NamedTuple):
    """What :meth:`Policy.command` is asked, SI; fields ``[N]``, of intruders ``[N, K]``."""

    own: VehicleState[Air]
    intruders: VehicleState[Air]
    mask: np.ndarray
    goal_x: np.ndarray
    goal_y: np.ndarray


def random_states(
    aircraft: Aircraft, random: np.random.Generator, count: int, most: int, size: float
) -> States:
    """Return states ``[count]`` with none to ``most`` intruders; they and the goals are up to
    ``size`` separations away to each side.
    """
    limits, length = aircraft.limits, size * aircraft.separation
    shape = count, most
    x, y = random.uniform(-length, length, (2, count))
    own: VehicleState[Air] = VehicleState(
        x,
        y,
        random.uniform(-np.pi, np.pi, count),
        random.uniform(limits.speed_min, limits.speed_max, count),
    )
    x, y = random.uniform(-length, length, (2, *shape))
    intruders: VehicleState[Air] = VehicleState(
        own.x[:, None] + x,
        own.y[:, None] + y,
        random.uniform(-np.pi, np.pi, shape),
        random.uniform(0.0, aircraft.traffic_speed_max, shape),
    )
    mask = random.random(shape) < random.uniform(0.0, 1.3, (count, 1))
    x, y = random.uniform(-length, length, (2, count))
    return States(own, intruders, mask, own.x + x, own.y + y)


def inputs_of_states(
    states: States, aircraft: Aircraft, distance_scale: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    """Return the inputs of a model of schema 2 or 3 by name, float32, for states of an aircraft;
    distance scales as :meth:`Policy.command` takes them.
    """
    around = surroundings(*states, aircraft.limits, aircraft.separation, np)
    own = [around.own_speed, around.goal_x, around.goal_y]
    own += [np.full_like(around.own_speed, ratio) for ratio in around.ratios]
    traffic = [
        around.x,
        around.y,
        around.vx,
        around.vy,
        *([] if distance_scale is None else [distance_scale]),
    ]
    named = {"own": np.stack(own, -1), "traffic": np.stack(traffic, -1), "mask": states.mask}
    return {name: values.astype(np.float32) for name, values in named.items()}


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
        "its parity vectors and random scenes"
    )
    return 0


def _decision(
    content: PolicyFile, inputs: Sequence[Input]
) -> tuple[Callable[..., jax.Array], list[tuple[int | str, ...]]]:
    """Return the decision of a policy as a function of jax, and the shapes of its inputs."""
    table = input_table(content, inputs)
    actor = Actor(content.hidden, content.feature_set, encoder=content.encoder)
    weights = variables({name: jnp.asarray(tensor) for name, tensor in content.actor.items()})

    def clip(network_input: Any, nothing: jax.Array) -> jax.Array:
        mean: Any = actor.apply(weights, network_input)
        return jnp.clip(mean[0], -1.0, 1.0) + nothing[:, None]

    def of_scene(own: jax.Array, traffic: jax.Array, mask: jax.Array) -> jax.Array:
        # The distance scale is the fifth of the traffic's numbers, 1 where there are four.
        numbers = jnp.concatenate([traffic, jnp.ones_like(mask)[..., None]], axis=-1)
        x, y, vx, vy, distance_scale = (jnp.moveaxis(numbers, -1, 0)[number] for number in range(5))
        rows = jnp.stack([x, y, vx, vy, mask], axis=-1)
        scene = unpack(own, rows)._replace(distance_scale=distance_scale)
        # 0, but NaN where a number is not finite: comparisons inside would make a number of it.
        nothing = 0.0 * (
            jnp.sum(own, axis=-1) + jnp.sum(rows, axis=(-2, -1)) + jnp.sum(distance_scale, -1)
        )
        scene = _most_urgent(scene, content.metadata["architecture"]["intruders"])
        return clip(set_inputs(as_seen(scene, jnp), jnp, table), nothing)

    def of_observation(observation: jax.Array) -> jax.Array:
        inside = jnp.sqrt(1.0 + TOLERANCE - jnp.abs(observation))
        return clip(observation, 0.0 * jnp.sum(inside, axis=-1))

    if content.of_set:
        return of_scene, [("N", OWN_NUMBERS), ("N", "K", "C"), ("N", "K")]
    return of_observation, [("N", SIZE)]


def _most_urgent(scene: Scene, most: int) -> Scene:
    """Return a scene ``[N, K]`` whose mask leaves the ``most`` most urgent intruders, as
    :meth:`Policy.most_critical` chooses them.
    """
    place = scene.distance_scale * scene.x, scene.distance_scale * scene.y
    motion = RelativeMotion(*place, scene.vx - scene.own_speed[:, None], scene.vy)
    rank = rank_motion(motion, 1.0, 1.0, jnp)  # lengths in separations, speeds in the greatest
    rank = jnp.where(scene.mask, rank, jnp.inf)
    earlier = jnp.sum(rank[:, None, :] < rank[:, :, None], axis=-1)
    return scene._replace(mask=scene.mask & (earlier < most))


def _properties(content: PolicyFile) -> dict[str, str]:
    """Return the model's metadata: what the policy's numbers mean and which policy it is, JSON but
    for the digests.
    """
    names = ("schema", "scene", "observation", "action", "limits", "task", "family", "inputs")
    parts = {name: canonical(content.metadata[name]) for name in names if name in content.metadata}
    return {
        "policy_sha256": content.sha256,
        "training_config_sha256": content.metadata["training"]["config_sha256"],
        "architecture": canonical(content.metadata["architecture"]),
        **parts,
    }
