"""From a trained flax actor to a policy file, with parity vectors that flax itself computes."""

import os
from collections.abc import Mapping
from functools import partial
from itertools import product
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from agents.learning.networks import Actor
from agents.policy import file as policy_file
from agents.policy.file import PolicyFile, PolicyFileError
from agents.policy.inference import Policy
from agents.policy.scene import unpacked_rows
from agents.policy.schema import SetOf, new_metadata
from agents.policy.set_features import set_inputs
from envs.aircraft import Ratios
from envs.edge.installation import versions
from envs.kinematics import Limits
from envs.observation import SIZE

__all__ = ["SetOf", "parity_observations", "parity_scenes", "to_policy_file", "variables", "write"]

_RANDOM_VECTORS = 64
_SEED = 20


def to_policy_file(  # noqa: PLR0913 - it describes a file
    actor_variables: Mapping[str, Any],
    hidden: tuple[int, ...],
    feature_set: str,
    limits: Limits,
    config: Mapping[str, Any],
    *,
    steps: int,
    score: float | None = None,
    notes: str = "",
    of_set: SetOf | None = None,
) -> PolicyFile:
    """Return the policy file of an actor.

    Args:
        actor_variables: of :class:`agents.learning.networks.Actor`: ``{"params": {"trunk": {...}, "log_std": [2]}}``.
        feature_set: its derived inputs, one of :data:`agents.policy.features.FEATURE_SETS`.
        limits: of the vehicle it was trained for, floats, SI.
        config: the resolved training configuration, of JSON types.
        score: mean sparse reward per encounter, None if it was not evaluated.
        of_set: for the feature set ``set``.

    Raises:
        PolicyFileError: parameters are not finite or not those of the architecture, the metadata cannot be written
            as JSON, or the numpy network disagrees with flax.
    """
    made_with = versions("jax", "flax", "optax", "numpy", "safetensors")
    described: dict[str, Any] = {"steps": steps, "score": score, "versions": made_with, "notes": notes}
    metadata = new_metadata(hidden, feature_set, limits, config, **described, of_set=of_set)
    encoder, observations = (), parity_observations()
    if of_set is not None:
        encoder, observations = of_set.encoder, parity_scenes(of_set.intruders, of_set.family)
    actor = _tensors(actor_variables)
    for name, tensor in actor.items():
        if not np.isfinite(tensor).all():
            raise PolicyFileError(f"new policy: parameter {name} is not finite: the training has diverged")
    # Shapes are checked before flax sees them: its messages do not say which file or field.
    content = PolicyFile(actor, observations, np.zeros((len(observations), 2), np.float32), metadata)
    policy_file.serialise(content)
    actions = _flax_actions(actor, Actor(hidden, feature_set, encoder=encoder), observations)
    content = PolicyFile(actor, observations, actions.astype(np.float32), metadata)
    Policy(content, source="new policy")
    return content


def write(path: str | os.PathLike[str], actor_variables: Mapping[str, Any], **description: Any) -> PolicyFile:
    """Write an actor to a policy file and return its content; ``description`` as for :func:`to_policy_file`.

    Raises:
        PolicyFileError: as :func:`to_policy_file`, or the file cannot be written.
    """
    content = to_policy_file(actor_variables, **description)
    policy_file.write(path, content)
    return content


def parity_observations() -> np.ndarray:
    """Return the observations of the parity vectors, float32 ``[P, 8]``: random ones and corners.

    The two velocities differ in all of them: where they are equal the closest approach is ill-conditioned and
    single precision agrees to three digits only.
    """
    random = np.random.default_rng(_SEED).uniform(-1.0, 1.0, (_RANDOM_VECTORS, SIZE))
    # Each pair of neighbouring components shares a sign: 16 of the 256 corners, and every component at both ends.
    corners = np.array([np.repeat(signs, 2) for signs in product((-1.0, 1.0), repeat=SIZE // 2)])
    return np.concatenate([random, corners]).astype(np.float32)


def parity_scenes(most: int, family: Mapping[str, tuple[float, float]]) -> np.ndarray:
    """Return the scenes of the parity vectors, float32 ``[P, 7 + 5 most]`` (:func:`agents.policy.scene.unpacked_rows`).

    They are random over the family, with none to all of the intruders, whose velocities differ from the ownship's.
    """
    random = np.random.default_rng(_SEED)
    count = 2 * _RANDOM_VECTORS
    of_family = [random.uniform(*family[name], count) for name in Ratios._fields]
    speed = of_family[0] + (1.0 - of_family[0]) * random.random(count)
    goal, course = random.uniform(0.3, 18.0, count), random.uniform(-np.pi, np.pi, count)
    away = random.uniform(0.5, 12.0, (count, most))
    bearing, heading = random.uniform(-np.pi, np.pi, (2, count, most))
    pace = random.uniform(0.3, 1.4, (count, most))
    present = random.random((count, most)) < random.random((count, 1))
    each = [away * np.cos(bearing), away * np.sin(bearing), pace * np.cos(heading), pace * np.sin(heading)]
    traffic = np.where(present, each, [[[1e3]], [[0.0]], [[0.0]], [[0.0]]])
    rows = np.concatenate([traffic, present[None]]).transpose(1, 2, 0).reshape(count, -1)
    own = np.stack([speed, goal * np.cos(course), goal * np.sin(course), *of_family], axis=-1)
    return np.concatenate([own, rows], axis=-1).astype(np.float32)


def variables(tensors: Mapping[str, Any]) -> dict[str, Any]:
    """Return the variables of :class:`~agents.learning.networks.Actor`, of a policy file's, without ``actor/``."""
    trunk: dict[str, dict[str, Any]] = {}
    for name, tensor in tensors.items():
        if name != "log_std":
            layer, part = name.split("/")
            trunk.setdefault(layer, {})[part] = tensor
    return {"params": {"trunk": trunk, "log_std": tensors["log_std"]}}


def _tensors(actor_variables: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Flatten the actor's parameters to float32 arrays named ``hidden_0/kernel``, ..., ``log_std``."""
    try:
        params = actor_variables["params"]
        tensors = {
            f"{layer}/{part}": np.asarray(value, np.float32)
            for layer, parts in params["trunk"].items()
            for part, value in parts.items()
        }
        tensors["log_std"] = np.asarray(params["log_std"], np.float32)
    except (KeyError, AttributeError, TypeError) as error:
        raise PolicyFileError(
            f"new policy: variables are not those of agents.learning.networks.Actor: {error!r}"
        ) from error
    return tensors


def _flax_actions(tensors: Mapping[str, np.ndarray], actor: Actor, observations: np.ndarray) -> np.ndarray:
    """Return flax's clipped actions ``[P, 2]`` for the tensors as they will be read back.

    In double precision: an accelerator's single-precision products may keep only ten bits.
    """
    with jax.enable_x64(True):
        exact = variables({name: jnp.asarray(tensor, jnp.float64) for name, tensor in tensors.items()})
        mean = _mean(exact, jnp.asarray(observations, jnp.float64), actor)
        return np.clip(np.asarray(mean), -1.0, 1.0)


@partial(jax.jit, static_argnames="actor")
def _mean(variables: Any, observation: jax.Array, actor: Actor) -> jax.Array:
    """Return the actor's mean actions; compiled once, because a training run exports many times."""
    seen = set_inputs(unpacked_rows(observation), jnp) if actor.encoder else observation
    return actor.apply(variables, seen)[0]
