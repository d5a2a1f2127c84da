"""A warm start: the networks of an earlier run, or of a policy file, that a training begins
with.
"""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from agents.config.load import ConfigError
from agents.learning.export import variables
from agents.learning.ppo import LearnerState
from agents.policy import file as policy_file
from rlcas_jax import checkpoint
from rlcas_jax.config import TrainConfig


def warm_learner(config: TrainConfig, shapes: Any) -> Any:
    """Return the networks and the optimiser that ``warm_start`` names, as a
    :class:`~agents.learning.ppo.LearnerState`.

    Of a policy file only the actor is taken: critic and optimiser are None, as the training makes
    them afresh.

    Args:
        config: of the training that begins; ``warm_start`` is not None.
        shapes: of that training's networks and optimiser.

    Raises:
        CheckpointError: there is no such run or checkpoint, it is not whole, or of other networks.
        ConfigError: a policy file is damaged, or of another network.
    """
    assert config.warm_start is not None
    source: Path = config.warm_start
    if source.is_dir():
        source = checkpoint.latest(source / "checkpoints")
    if not policy_file.claims(source):
        return checkpoint.restore(source, shapes, "learner")
    try:
        policy = policy_file.read(source)
    except policy_file.PolicyFileError as problem:
        raise ConfigError(f"warm_start: {problem}") from None
    network = config.network
    own_inputs = [one.name for one in network.input_table().extra]
    for key, has, wanted in (
        ("hidden", policy.hidden, tuple(network.hidden)),
        ("feature_set", policy.feature_set, network.feature_set),
        ("inputs", [one["name"] for one in policy.extensions], own_inputs),
    ):
        if has != wanted:
            raise ConfigError(
                f"warm_start: {source} has network.{key} {has}; expected {wanted} as configured"
            )
    return LearnerState(jax.tree.map(jnp.asarray, variables(policy.actor)), None, None)
