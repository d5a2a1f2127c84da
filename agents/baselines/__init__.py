"""Published methods of conflict resolution to compare with."""

from agents.baselines.baselines import BASELINES, Baseline, NoResolution, PotentialField, RightHand

__all__ = ["BASELINES", "Baseline", "NoResolution", "PotentialField", "RightHand"]
