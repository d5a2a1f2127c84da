"""Networks and PPO in JAX, and the export of what was learned."""

from agents.learning.export import to_policy_file
from agents.learning.networks import Actor, Critic
from agents.learning.ppo import (
    LearnerState,
    Networks,
    PpoSettings,
    initial_state,
    make_networks,
    update,
)

__all__ = [
    "Actor",
    "Critic",
    "LearnerState",
    "Networks",
    "PpoSettings",
    "initial_state",
    "make_networks",
    "to_policy_file",
    "update",
]
