"""Which encounters can be resolved at all: by search, or proven not to be."""

from agents.resolvability.classify import Resolvability, Verdict, causal, classify
from agents.resolvability.witness import Witnesses, least_cost

__all__ = ["Resolvability", "Verdict", "Witnesses", "causal", "classify", "least_cost"]
