"""Networks and PPO in JAX, and the export of what was learned."""

from agents.learning.export import to_policy_file
from agents.learning.networks import Actor, Critic
from agents.learning.ppo import Learner, LearnerState, PpoSettings, initial_state, learner, update

__all__ = [
    "Actor",
    "Critic",
    "Learner",
    "LearnerState",
    "PpoSettings",
    "initial_state",
    "learner",
    "to_policy_file",
    "update",
]
