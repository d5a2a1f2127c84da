"""The run-time monitor: watches the plan that is flown, asks for new ones and has a validated backup ready."""

from agents.assurance.monitor import (
    Decision,
    Inputs,
    Monitor,
    State,
    Thresholds,
    activate,
    answer,
    start,
    step,
)

__all__ = [
    "Decision",
    "Inputs",
    "Monitor",
    "State",
    "Thresholds",
    "activate",
    "answer",
    "start",
    "step",
]
