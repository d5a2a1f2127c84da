"""Policies of random numbers."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from agents.learning.export import to_policy_file
from agents.learning.networks import Actor, Critic
from agents.policy.file import PolicyFile
from agents.policy.inputs import Input
from agents.policy.scene import random_scenes, unpack_rows
from agents.policy.schema import SetOf, new_metadata
from agents.policy.set_features import set_inputs, table
from envs.aircraft import PAPER, Ratios

FAMILY = Ratios((0.4, 0.75), (-0.4, -0.03), (0.03, 0.4), (0.3, 2.5))._asdict()


def random_weights(
    network: Actor | Critic, example: Any, spread: float = 1.4, seed: int = 3
) -> Any:
    """Return parameters, free to be changed, of a network that takes what ``example`` is; by the
    spread they give actions as large as a trained network's.
    """
    # Shapes from flax, values from numpy: compiling the orthogonal initialisation would take most
    # of the test's time.
    shapes = jax.eval_shape(network.init, jax.random.key(0), example)
    rng = np.random.default_rng(seed)
    return jax.tree.map(
        lambda leaf: rng.normal(0.0, spread / np.sqrt(leaf.shape[0]), leaf.shape).astype("f4"),
        shapes,
    )


def random_policy(
    hidden: tuple[int, ...], feature_set: str, of_set: SetOf | None = None, **random: Any
) -> PolicyFile:
    """Return a policy file of :func:`random_weights`; ``of_set``: for any number of intruders."""
    inputs: tuple[Input, ...] = ()
    encoder, example = (), jnp.zeros((1, 8))
    if of_set is not None:
        encoder, inputs = of_set.encoder, of_set.inputs
        rows = unpack_rows(random_scenes(of_set.intruders, of_set.family))
        example = set_inputs(rows, np, table(inputs))
    weights = random_weights(Actor(hidden, feature_set, encoder=encoder), example, **random)
    metadata = new_metadata(hidden, feature_set, PAPER.limits, {}, steps=0, of_set=of_set)
    return to_policy_file(weights, metadata, inputs)
