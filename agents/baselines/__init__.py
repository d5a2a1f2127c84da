"""Published methods of conflict resolution to compare with."""

from agents.baselines.baselines import (
    BASELINES,
    NoResolution,
    PotentialField,
    RightHand,
    StepResolver,
)

__all__ = ["BASELINES", "NoResolution", "PotentialField", "RightHand", "StepResolver"]
