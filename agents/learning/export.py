"""From a trained flax actor to a policy file, with parity vectors that flax itself computes."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax.traverse_util import flatten_dict, unflatten_dict

from agents.learning.networks import Actor, Variables
from agents.policy import file as policy_file
from agents.policy.file import PolicyFile, PolicyFileError
from agents.policy.inference import Policy, input_table
from agents.policy.inputs import Input
from agents.policy.scene import random_scenes, unpack_rows
from agents.policy.set_features import InputTable, set_inputs
from commands.installation import versions
from envs.observation import SIZE

_RANDOM_VECTORS = 64
_SEED = 20


def to_policy_file(
    actor_variables: Variables, metadata: Mapping[str, Any], inputs: Sequence[Input] = ()
) -> PolicyFile:
    """Return the policy file of an actor.

    Args:
        actor_variables: of :class:`agents.learning.networks.Actor`: ``{"params": {"trunk": {...},
            "log_std": [2]}}``.
        metadata: of :func:`agents.policy.schema.new_metadata`; gets the versions of what computes
            the file.
        inputs: of the user's own that the metadata names, beside the registered ones.

    Raises:
        PolicyFileError: parameters are not finite or not those of the architecture, or numpy
            disagrees with flax.
    """
    metadata = {**metadata, "versions": versions("jax", "flax", "optax", "numpy", "safetensors")}
    actor = _tensors(actor_variables)
    for name, tensor in actor.items():
        if not np.isfinite(tensor).all():
            raise PolicyFileError(
                f"new policy: parameter {name} is not finite: the training has diverged"
            )
    observations = parity_observations()
    if "family" in metadata:
        observations = random_scenes(metadata["architecture"]["intruders"], metadata["family"])
    # Shapes are checked before flax sees them: its messages do not say which file or field.
    content = PolicyFile(
        actor, observations, np.zeros((len(observations), 2), np.float32), metadata
    )
    policy_file.serialise(content)
    table = input_table(content, inputs, "new policy")
    content = replace(content, parity_action=_flax_actions(content, table).astype(np.float32))
    Policy(content, source="new policy", inputs=inputs)
    return content


def parity_observations() -> np.ndarray:
    """Return the observations of the parity vectors, float32 ``[P, 8]``: random ones and corners.

    The two velocities differ in all of them: where they are equal the closest approach is
    ill-conditioned and single precision agrees to three digits only.
    """
    random = np.random.default_rng(_SEED).uniform(-1.0, 1.0, (_RANDOM_VECTORS, SIZE))
    # Each pair of neighbouring components shares a sign: 16 of the 256 corners, and every component
    # at both ends.
    corners = np.array([np.repeat(signs, 2) for signs in product((-1.0, 1.0), repeat=SIZE // 2)])
    return np.concatenate([random, corners]).astype(np.float32)


def variables(tensors: Mapping[str, Any]) -> Variables:
    """Return the variables of :class:`~agents.learning.networks.Actor`, of a policy file's, without
    ``actor/``.
    """
    layers = {name: tensor for name, tensor in tensors.items() if name != "log_std"}
    return {"params": {"trunk": unflatten_dict(layers, sep="/"), "log_std": tensors["log_std"]}}


def _tensors(actor_variables: Variables) -> dict[str, np.ndarray]:
    """Flatten the actor's parameters to float32 arrays named ``hidden_0/kernel``, ...,
    ``log_std``.
    """
    try:
        params = actor_variables["params"]
        tensors = flatten_dict(params["trunk"], sep="/") | {"log_std": params["log_std"]}
    except (KeyError, AttributeError, TypeError) as error:
        raise PolicyFileError(
            f"new policy: variables are not those of agents.learning.networks.Actor: {error!r}"
        ) from error
    return {name: np.asarray(tensor, np.float32) for name, tensor in tensors.items()}


def _flax_actions(content: PolicyFile, table: InputTable) -> np.ndarray:
    """Return flax's clipped actions ``[P, 2]`` for the parity vectors, with the tensors as they
    will be read back.

    In double precision: an accelerator's single-precision products may keep only ten bits.
    """
    actor = Actor(content.hidden, content.feature_set, encoder=content.encoder)

    def mean(weights: Variables, rows: jax.Array) -> Any:
        inputs = set_inputs(unpack_rows(rows), jnp, table) if content.of_set else rows
        return actor.apply(weights, inputs)[0]

    with jax.enable_x64(True):
        exact = variables(
            {name: jnp.asarray(tensor, jnp.float64) for name, tensor in content.actor.items()}
        )
        actions = jax.jit(mean)(exact, jnp.asarray(content.parity_observation, jnp.float64))
        return np.clip(np.asarray(actions), -1.0, 1.0)
