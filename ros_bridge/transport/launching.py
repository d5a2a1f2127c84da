# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""What the launch files have in common: their arguments, and the nodes as processes of this Python.

In a colcon workspace a node is an executable of the package, as ``ros2 run`` starts it; where the
toolkit was installed by pip it is a module of the interpreter that runs the launch file. What
runner and monitor must agree on is one
argument for both.
"""

import sys
from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode, Node

from ros_bridge.transport import parameters

ARGUMENTS = (
    ("namespace", "", "of all nodes, such as n123; empty: none"),
    ("use_sim_time", "false", "whether the nodes take the time from /clock"),
    (
        "params_file",
        "",
        "YAML with parameters of the nodes, which go before those given here; empty: none",
    ),
    ("log_level", "info", "debug, info, warn, error or fatal"),
    ("aircraft", "", "file of the aircraft and its task, of all nodes; empty: the policy's"),
    ("policy_file", "", "of all nodes; empty: the one that ships"),
    ("separation", "", "m, least distance to every intruder, of all nodes; empty: the aircraft's"),
    (
        "margin",
        "",
        "m, added for what the autopilot leaves of the plan, of runner and monitor; empty: the "
        "usual",
    ),
    (
        "sigmas",
        "",
        "standard deviations of the intruders' positions added, of runner and monitor; empty: the "
        "usual",
    ),
)
"""Name, default and meaning of the arguments of every launch file."""


MANUAL = (
    "manual",
    "false",
    "whether runner and monitor wait to be configured and activated by a lifecycle manager",
)
"""Argument of launch files with lifecycle nodes."""

_PACKAGE = "rlcas_toolkit"


def declarations(*more: tuple[str, str, str], **defaults: str) -> list[DeclareLaunchArgument]:
    """Return the arguments of a launch file: the common ones, with other ``defaults``, and
    ``more``.
    """
    common = [(name, defaults.get(name, default), meaning) for name, default, meaning in ARGUMENTS]
    return [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, default, description in [*common, *more]
    ]


def value(context: Any, name: str) -> str:
    """Return an argument's value."""
    return LaunchConfiguration(name).perform(context)


def node(
    context: Any,
    name: str,
    *own_arguments: tuple[str, str, str],
    lifecycle: bool = False,
    **settings: Any,
) -> Node:
    """Return the action that starts the node of a module, with the arguments that are its
    parameters and not empty.

    ``own_arguments`` are the arguments besides the common ones, ``lifecycle`` is whether launch
    takes part in its life cycle (with :data:`MANUAL`), ``settings`` goes to
    :class:`launch_ros.actions.Node`.
    """
    texts = {argument: value(context, argument) for argument, *_ in (*ARGUMENTS, *own_arguments)}
    values: list[Any] = [{"use_sim_time": texts["use_sim_time"].lower() == "true"}]
    for parameter in parameters.of(name):
        if texts.get(parameter.name):
            kind = type(parameter.default) if parameter.low is None else float
            values[0][parameter.name] = kind(texts[parameter.name])
    if texts["params_file"]:
        values.append(texts["params_file"])
    executable = _executable(name)
    if lifecycle and value(context, MANUAL[0]).lower() == "true":
        executable["arguments"].append("--manual")
    return (LifecycleNode if lifecycle else Node)(
        **executable,
        ros_arguments=["--log-level", texts["log_level"]],
        name=f"rlcas_{name}",
        namespace=texts["namespace"],
        parameters=values,
        output="screen",
        **settings,
    )


def protecting(context: Any, *, lifecycle: bool = False) -> list[Node]:
    """Return the actions that start runner and monitor, each again where it has died: until the
    runner answers the monitor has its backup, and until the monitor speaks nothing is flown.
    ``lifecycle`` as :func:`node` has it.
    """
    again: dict[str, Any] = {"lifecycle": lifecycle, "respawn": True, "respawn_delay": 1.0}
    return [node(context, name, **again) for name in ("runner", "monitor")]


def _executable(name: str) -> dict[str, Any]:
    """Return what starts a node, as the action of launch has it."""
    command = f"rlcas-{name}"
    try:
        installed = Path(get_package_prefix(_PACKAGE)) / "lib" / _PACKAGE / command
    except (PackageNotFoundError, OSError):  # OSError: no workspace at all
        installed = None
    if installed is not None and installed.exists():
        return {"package": _PACKAGE, "executable": command, "arguments": []}
    return {"executable": sys.executable, "arguments": ["-m", f"ros_bridge.{name}"]}
