"""A node as a process: arguments, spinning, an orderly end, and one line and exit code 2 for bad
input.
"""

import argparse
import gc
import re
import signal
import sys
from collections.abc import Sequence
from typing import Any

import rclpy
from rclpy.exceptions import InvalidParameterTypeException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from commands.command import InputError, Parser
from ros_bridge.transport import parameters
from ros_bridge.transport.children import FLAG, end_with_parent
from ros_bridge.transport.discovery import configure_dds, reserve_ports
from ros_bridge.transport.overrides import refuse_unknown_nodes
from ros_bridge.transport.starting import note_start

_RCL_LINE = re.compile(r"\s*, at \S+:\d+")
_LOOK = 1.0  # s between two looks at whether the node has finished


def main(
    make: type[Node], name: str, text: str | None, arguments: Sequence[str] | None = None
) -> int:
    """Run a node until it is stopped, and return the exit code; raise InputError where arguments
    cannot be used.

    A lifecycle node is configured and activated first. A node that ends by itself has ``finished``,
    and then ``code``.

    Args:
        make: class of the node; ValueError where its parameters contradict each other.
        name: of the kind of nodes, such as ``runner``.
        text: for ``--help``, before the parameters.
        arguments: of the command line, without the program's name; None: those of this process.
    """
    gc.disable()  # until everything that stays is there
    try:
        return _run(make, name, f"{text}{parameters.help_text(name)}", arguments)
    finally:
        gc.enable()


def _run(make: Any, name: str, text: str, arguments: Sequence[str] | None) -> int:
    parser = Parser(prog=f"python -m ros_bridge.{name}", description=text)
    command_line = [parser.prog, *(sys.argv[1:] if arguments is None else arguments)]
    parser.add_argument(FLAG, action="store_true", help="end when standard input is closed")
    if issubclass(make, LifecycleNode):
        parser.add_argument(
            "--manual", action="store_true", help="wait to be configured and activated by others"
        )
    options, node = _begin(make, parser, command_line)
    note_start()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        if isinstance(node, LifecycleNode) and not options.manual and not _activate(node):
            return 2
        return _spin(executor, node)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except RuntimeError:
        # A signal between two steps of the executor ends the context under it; the error has no
        # public class.
        if rclpy.ok():
            raise
        return 0
    finally:
        # A second Ctrl-C must not break the cleaning up.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()


def _begin(make: Any, parser: Parser, command_line: list[str]) -> tuple[argparse.Namespace, Node]:
    """Return our options, and the node in a context of the arguments; InputError: they cannot be
    used.
    """
    try:
        # Before ROS looks at the files, whose errors name its own lines.
        refuse_unknown_nodes(command_line, [f"rlcas_{node}" for node in parameters.NODES])
        options = parser.parse_args(remove_ros_args(command_line)[1:])
        if options.end_with_parent:
            end_with_parent()
        configure_dds()
        rclpy.init(args=command_line)
        with reserve_ports():
            return options, make()
    except InvalidParameterTypeException as error:
        rclpy.try_shutdown()
        raise InputError(f"{error} (a number needs its point, such as 3.0)") from error
    except ParameterException as error:
        rclpy.try_shutdown()
        raise InputError(str(error)) from error
    except ValueError as error:
        rclpy.try_shutdown()
        raise InputError(str(error)) from error
    except RuntimeError as error:
        rclpy.try_shutdown()
        # What rcl raises for arguments has no common class that is public; it names its own lines.
        sentence = _RCL_LINE.sub("", str(error))
        raise InputError(f"ROS arguments cannot be used: {sentence}") from error


def _activate(node: LifecycleNode) -> bool:
    """Configure and activate a lifecycle node; it logs why not."""
    steps = (node.trigger_configure, node.trigger_activate)
    return all(step() is TransitionCallbackReturn.SUCCESS for step in steps)


def _spin(executor: SingleThreadedExecutor, node: Node) -> int:
    """Let a node work until it has finished or is stopped; return its exit code."""
    # What is there by now stays, and is not gone through again and again in the middle of an
    # answer.
    gc.freeze()
    gc.enable()
    while rclpy.ok() and not getattr(node, "finished", False):
        executor.spin_once(timeout_sec=_LOOK)
    code: int = getattr(node, "code", 0)
    return code
