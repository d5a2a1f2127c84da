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

ARGUMENTS = (
    ("namespace", "", "of all nodes, such as n123; empty: none"),
    ("use_sim_time", "false", "whether the nodes take the time from /clock"),
    ("params_file", "", "YAML with parameters of the nodes, which go before those given here; empty: none"),
    ("log_level", "info", "debug, info, warn, error or fatal"),
    ("aircraft", "", "file of the aircraft and its task, of all nodes; empty: the policy's"),
    ("policy_file", "", "of all nodes; empty: the one that ships"),
    ("separation", "", "m, least distance to every intruder, of all nodes; empty: the aircraft's"),
    ("margin", "", "m, added for what the autopilot leaves of the plan, of runner and monitor; empty: the usual"),
    ("sigmas", "", "standard deviations of the intruders' positions added, of runner and monitor; empty: the usual"),
)
"""Name, default and meaning of the arguments of every launch file."""

_TEXTS, _NUMBERS = ("aircraft", "policy_file"), ("separation", "margin", "sigmas")


def declared(*more: tuple[str, str, str], **other: str) -> list[DeclareLaunchArgument]:
    """Return the arguments of a launch file: the common ones, with ``other`` defaults, and ``more``."""
    every = [(name, other.get(name, default), meaning) for name, default, meaning in ARGUMENTS]
    return [
        DeclareLaunchArgument(name, default_value=default, description=what) for name, default, what in [*every, *more]
    ]


def value(context: Any, name: str) -> str:
    """Return an argument's value."""
    return LaunchConfiguration(name).perform(context)


def shared(context: Any, *, plans: bool = True) -> dict[str, Any]:
    """Return what all nodes must agree on, with ``plans`` all that make or check plans; what is empty is left out."""
    given: dict[str, Any] = {name: value(context, name) for name in _TEXTS if value(context, name)}
    numbers = _NUMBERS if plans else _NUMBERS[:1]
    return given | {name: float(value(context, name)) for name in numbers if value(context, name)}


def node(context: Any, name: str, parameters: Mapping[str, Any] | None = None, **more: Any) -> Node:
    """Return the action that starts one of our nodes.

    Args:
        name: of the module, such as ``runner``.
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
