"""The run-time monitor: watches the plan that is flown, asks for new ones and has a validated
backup ready.
"""

from agents.assurance.inputs import Inputs, inputs
from agents.assurance.monitor import activate, answer, references, step
from agents.assurance.state import Decision, Monitor, State, start
from agents.assurance.thresholds import Thresholds

__all__ = ["Decision", "Inputs", "Monitor", "State", "Thresholds"]
__all__ += ["activate", "answer", "inputs", "references", "start", "step"]
