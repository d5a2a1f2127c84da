"""The policy: its file, its features and its forward pass in numpy."""

from agents.policy.features import FEATURE_SETS
from agents.policy.file import PolicyFile, PolicyFileError, read, write
from agents.policy.inference import Policy

__all__ = ["FEATURE_SETS", "Policy", "PolicyFile", "PolicyFileError", "read", "write"]
