# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""Runner and monitor for an aircraft: ``ros2 launch rlcas_toolkit deconfliction.launch.py
namespace:=n123``.
"""

from typing import Any

from launch import LaunchDescription
from launch.actions import OpaqueFunction

from ros_bridge.transport import launching


def _nodes(context: Any) -> list[Any]:
    # A runner that has died is started again; until it answers the monitor has its backup.
    nodes = [
        launching.node(context, "runner", respawn=True, respawn_delay=1.0),
        launching.node(context, "monitor"),
    ]
    if launching.value(context, "translate").lower() == "true":
        nodes.append(launching.node(context, "translator"))
    return nodes


def generate_launch_description() -> LaunchDescription:
    """Return the description; ``--show-args`` lists the arguments."""
    translate = (
        "translate",
        "false",
        "whether to start the translator, whose sources stand in params_file",
    )
    return LaunchDescription([*launching.declarations(translate), OpaqueFunction(function=_nodes)])
