# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""Runner, monitor and simulator: ``ros2 launch rlcas_toolkit simulation.launch.py scenario:=head_on encounters:=5``."""

from typing import Any

from launch import LaunchDescription
from launch.actions import OpaqueFunction, Shutdown

from ros_bridge.transport import launching

_MORE = (
    ("scenario", "crossing_left", "family of encounters"),
    ("seed", "0", "of the encounters"),
    ("encounters", "1", "how many are flown"),
    ("vehicle", "kinematic", "kinematic, point_mass or c208 (JSBSim)"),
    ("rate", "1.0", "times real time, at most"),
)


def _nodes(context: Any) -> list[Any]:
    shared = launching.shared(context)
    flown = launching.shared(context, plans=False) | {
        "scenario": launching.value(context, "scenario"),
        "seed": int(launching.value(context, "seed")),
        "encounters": int(launching.value(context, "encounters")),
        "vehicle": launching.value(context, "vehicle"),
        "rate": float(launching.value(context, "rate")),
    }
    return [
        launching.node(context, "runner", shared),
        launching.node(context, "monitor", shared),
        launching.node(context, "simulator", flown, on_exit=Shutdown()),
    ]


def generate_launch_description() -> LaunchDescription:
    """Return the description; ``--show-args`` lists the arguments."""
    return LaunchDescription([*launching.declared(*_MORE, use_sim_time="true"), OpaqueFunction(function=_nodes)])
