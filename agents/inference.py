"""The policy under its public name, ``from agents.inference import Policy``
(:mod:`agents.policy.inference`).
"""

from agents.policy.inference import Policy

__all__ = ["Policy"]
