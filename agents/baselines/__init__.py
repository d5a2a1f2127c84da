"""Published methods of conflict resolution to compare with."""

from agents.baselines.baselines import BASELINES, Baseline, Direct, PotentialField, RightHand

__all__ = ["BASELINES", "Baseline", "Direct", "PotentialField", "RightHand"]
