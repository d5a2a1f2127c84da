# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""Runner and monitor for an aircraft: ``ros2 launch rlcas_toolkit deconfliction.launch.py
namespace:=n123``.
"""

from typing import Any

from launch import LaunchDescription
from launch.actions import OpaqueFunction

from ros_bridge.transport import launching


def _nodes(context: Any) -> list[Any]:
    nodes: list[Any] = launching.protecting(context, lifecycle=True)
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
    return LaunchDescription(
        [*launching.declarations(translate, launching.MANUAL), OpaqueFunction(function=_nodes)]
    )
