"""What messages mean, without ROS: reports, tracks, the situation, and the planner's task that
follows from it.
"""

from envs.formats.local_frame import LocalFrame
from ros_bridge.core.fields import Code, FieldError, Refusal
from ros_bridge.core.reports import Report
from ros_bridge.core.situation import Situation
from ros_bridge.core.tasks import PlanTask, Settings, task
from ros_bridge.core.tracks import Rules, Track

__all__ = [
    "Code",
    "FieldError",
    "LocalFrame",
    "PlanTask",
    "Refusal",
    "Report",
    "Rules",
    "Settings",
    "Situation",
    "Track",
    "task",
]
