# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""Runner, monitor and simulator: ``ros2 launch rlcas_toolkit simulation.launch.py scenario:=head_on
encounters:=5``.
"""

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
    return [
        *launching.protecting(context),
        launching.node(context, "simulator", *_MORE, on_exit=Shutdown()),
    ]


def generate_launch_description() -> LaunchDescription:
    """Return the description; ``--show-args`` lists the arguments."""
    return LaunchDescription(
        [*launching.declarations(*_MORE, use_sim_time="true"), OpaqueFunction(function=_nodes)]
    )
