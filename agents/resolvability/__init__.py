"""Which encounters can be resolved at all: by search, or proven not to be."""

from agents.resolvability.causal_bound import causal
from agents.resolvability.classify import Resolvability, Verdict, classify
from agents.resolvability.witness import least_cost

__all__ = ["Resolvability", "Verdict", "causal", "classify", "least_cost"]
