"""Policies that a training is given: those that it begins with, and the teacher that it keeps to."""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from agents.config.load import ConfigError
from agents.learning.export import variables
from agents.learning.ppo import LearnerState
from agents.policy import file as policy_file
from agents.policy.features import begins, size
from rlcas_jax import checkpoint
from rlcas_jax.config import TrainConfig

__all__ = ["actor_with", "begun", "policy_at"]

_AS_HERE = "as in this configuration"
_FIRST = "hidden_0/kernel"


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
    policy = policy_at(of, "start_from")
    hidden = tuple(config.network.hidden)
    if policy.hidden != hidden:
        raise ConfigError(f"start_from: {of} has network.hidden {policy.hidden}; expected {hidden} {_AS_HERE}")
    return fresh._replace(actor=actor_with(policy, config.network.feature_set, f"start_from: {of}"))


def policy_at(of: Path, key: str) -> policy_file.PolicyFile:
    """Return the policy of a file that a configuration's key names.

    Raises:
        ConfigError: there is none, or it is damaged.
    """
    try:
        return policy_file.read(of)
    except policy_file.PolicyFileError as problem:
        raise ConfigError(f"{key}: {problem}") from None


def actor_with(policy: policy_file.PolicyFile, feature_set: str, where: str) -> Any:
    """Return the variables of an actor that does with a feature set what a policy does with its own.

    Args:
        policy: of a feature set with whose inputs the other one begins; the others have no weight.
        feature_set: of the actor.
        where: what an error names.

    Raises:
        ConfigError: the feature set begins otherwise.
    """
    if not begins(feature_set, policy.feature_set):
        raise ConfigError(
            f"{where} has network.feature_set {policy.feature_set}; expected {feature_set} {_AS_HERE}, "
            "or one whose inputs these begin with"
        )
    first = policy.actor[_FIRST]
    more = np.zeros((size(feature_set) - len(first), first.shape[1]), first.dtype)
    return jax.tree.map(jnp.asarray, variables({**policy.actor, _FIRST: np.concatenate([first, more])}))
