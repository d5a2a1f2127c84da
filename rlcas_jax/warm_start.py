"""A warm start: the networks of an earlier run, or of a policy file, that a training begins
with.
"""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from agents.config.load import ConfigError
from agents.learning.export import variables
from agents.policy import file as policy_file
from rlcas_jax import checkpoint
from rlcas_jax.config import TrainConfig


def warm_learner(config: TrainConfig, shapes: Any) -> dict[str, Any]:
    """Return the parts of the algorithm's state that ``warm_start`` names, by their field.

    Of a run or a checkpoint that is all of it, of a policy file the actor alone: the training makes
    the rest, such as critic and optimiser, afresh.

    Args:
        config: of the training that begins; ``warm_start`` is not None.
        shapes: of that training's algorithm's state.

    Raises:
        CheckpointError: there is no such run or checkpoint, it is not whole, or of other networks.
        ConfigError: a policy file is damaged, or of another network.
    """
    assert config.warm_start is not None
    source: Path = config.warm_start
    if source.is_dir():
        source = checkpoint.latest(source / "checkpoints")
    if not policy_file.claims(source):
        return checkpoint.restore(source, shapes, "learner")._asdict()
    try:
        policy = policy_file.read(source)
    except policy_file.PolicyFileError as problem:
        raise ConfigError(f"warm_start: {problem}") from None
    network = config.network
    own_inputs = [entry.name for entry in network.input_table().extra]
    for key, has, configured in (
        ("hidden", policy.hidden, tuple(network.hidden)),
        ("feature_set", policy.feature_set, network.feature_set),
        ("inputs", [contract["name"] for contract in policy.extensions], own_inputs),
    ):
        if has != configured:
            raise ConfigError(
                f"warm_start: {source} has network.{key} {has}; expected {configured} as configured"
            )
    return {"actor": jax.tree.map(jnp.asarray, variables(policy.actor))}
