"""What a training begins with if not with fresh networks: an earlier run's, a checkpoint's, or a policy alone."""

import jax
import jax.numpy as jnp

from agents import policy_file
from agents.configuration import ConfigError
from agents.export import variables
from agents.ppo import LearnerState
from rlcas_jax import checkpoint
from rlcas_jax.config import TrainConfig

__all__ = ["begun"]


def begun(config: TrainConfig, fresh: LearnerState) -> LearnerState:
    """Return the networks and the optimiser that ``start_from`` names.

    Args:
        config: of the training that begins; ``start_from`` is not None.
        fresh: networks and optimiser of that training. Of a policy only the actor is taken, the rest stays fresh.

    Raises:
        CheckpointError: there is no such run or checkpoint, it is not whole, or of other networks.
        ConfigError: a policy is damaged, or of another network.
    """
    of = config.start_from
    assert of is not None
    if of.is_dir():
        of = checkpoint.latest(of / "checkpoints")
    if not policy_file.claims(of):
        return checkpoint.restore_part(of, fresh, "learner")
    try:
        policy = policy_file.read(of)
    except policy_file.PolicyFileError as problem:
        raise ConfigError(f"start_from: {problem}") from None
    for name, has, wanted in (
        ("hidden", policy.hidden, tuple(config.network.hidden)),
        ("feature_set", policy.feature_set, config.network.feature_set),
    ):
        if has != wanted:
            raise ConfigError(f"start_from: {of} has network.{name} {has}; expected {wanted} as in this configuration")
    return fresh._replace(actor=jax.tree.map(jnp.asarray, variables(policy.actor)))
