# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""What the launch files have in common: their arguments, and the nodes as processes of this Python.

A node is started as a module of the interpreter that runs the launch file, so that a pip installation and a colcon
workspace work alike. What runner and monitor must agree on is one argument for both.
"""

import sys
from collections.abc import Mapping
from typing import Any

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from ros_bridge.transport.parameters import MARGIN

__all__ = ["ARGUMENTS", "SHARED", "declared", "node", "value"]

ARGUMENTS = (
    ("namespace", "", "of all nodes, such as n123; empty: none"),
    ("use_sim_time", "false", "whether the nodes take the time from /clock"),
    ("params_file", "", "YAML with parameters of the nodes, which go before those given here; empty: none"),
    ("log_level", "info", "debug, info, warn, error or fatal"),
    ("separation", "1000.0", "m, least distance to every intruder; of runner and monitor"),
    ("margin", str(MARGIN), "m, added for what the autopilot leaves of the plan; of runner and monitor"),
    ("sigmas", "2.0", "standard deviations of the intruders' positions added; of runner and monitor"),
)
"""Name, default and meaning of the arguments of every launch file."""

SHARED = ("separation", "margin", "sigmas")
"""Those that are parameters of runner and monitor alike."""


def declared(*more: tuple[str, str, str], **other: str) -> list[DeclareLaunchArgument]:
    """Return the arguments of a launch file: the common ones, with ``other`` defaults, and ``more``."""
    every = [(name, other.get(name, default), meaning) for name, default, meaning in ARGUMENTS]
    return [
        DeclareLaunchArgument(name, default_value=default, description=what) for name, default, what in [*every, *more]
    ]


def value(context: Any, name: str) -> str:
    """Return an argument's value."""
    return LaunchConfiguration(name).perform(context)


def node(context: Any, name: str, parameters: Mapping[str, Any] | None = None, **more: Any) -> Node:
    """Return the action that starts one of our nodes.

    Args:
        context: of the launch.
        name: of the module, such as ``runner``.
        parameters: of the node.
        **more: for :class:`launch_ros.actions.Node`.
    """
    given: list[Any] = [{"use_sim_time": value(context, "use_sim_time").lower() == "true"} | dict(parameters or {})]
    if value(context, "params_file"):
        given.append(value(context, "params_file"))
    return Node(
        executable=sys.executable,
        arguments=["-m", f"ros_bridge.{name}"],
        ros_arguments=["--log-level", value(context, "log_level")],
        name=f"rlcas_{name}",
        namespace=value(context, "namespace"),
        parameters=given,
        output="screen",
        **more,
    )
