"""A warm start: the networks of an earlier run, or of a policy file, that a training begins with."""

from pathlib import Path

import jax
import jax.numpy as jnp

from agents.config.load import ConfigError
from agents.learning.export import variables
from agents.learning.ppo import LearnerState
from agents.policy import file as policy_file
from rlcas_jax import checkpoint
from rlcas_jax.config import TrainConfig

__all__ = ["begun"]


def begun(config: TrainConfig, fresh: LearnerState) -> LearnerState:
    """Return the networks and the optimiser that ``start_from`` names.

    Args:
        config: of the training that begins; ``start_from`` is not None.
        fresh: networks and optimiser of that training. Of a policy file only the actor is taken, the rest stays fresh.

    Raises:
        CheckpointError: there is no such run or checkpoint, it is not whole, or of other networks.
        ConfigError: a policy file is damaged, or of another network.
    """
    assert config.start_from is not None
    source: Path = config.start_from
    if source.is_dir():
        source = checkpoint.latest(source / "checkpoints")
    if not policy_file.claims(source):
        return checkpoint.restore_part(source, fresh, "learner")
    try:
        policy = policy_file.read(source)
    except policy_file.PolicyFileError as problem:
        raise ConfigError(f"start_from: {problem}") from None
    network = config.network
    for key, has, wanted in (
        ("hidden", policy.hidden, tuple(network.hidden)),
        ("feature_set", policy.feature_set, network.feature_set),
    ):
        if has != wanted:
            raise ConfigError(f"start_from: {source} has network.{key} {has}; expected {wanted} as configured")
    return fresh._replace(actor=jax.tree.map(jnp.asarray, variables(policy.actor)))
