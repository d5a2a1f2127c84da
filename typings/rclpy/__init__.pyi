# The part of rclpy that is in use, written by hand; a test compares it with the installed package.

from collections.abc import Sequence

from rclpy.context import Context as Context
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import ok as ok

def init(
    *,
    args: Sequence[str] | None = ...,
    context: Context | None = ...,
    domain_id: int | None = ...,
    signal_handler_options: SignalHandlerOptions | None = ...,
) -> object: ...
def try_shutdown(*, context: Context | None = ...) -> None: ...
def create_node(
    node_name: str, *, context: Context | None = ..., namespace: str | None = ...
) -> Node: ...
def spin(node: Node, executor: Executor | None = ...) -> None: ...
def spin_once(
    node: Node, *, executor: Executor | None = ..., timeout_sec: float | None = ...
) -> None: ...
def spin_until_future_complete(
    node: Node,
    future: Future[object],
    executor: Executor | None = ...,
    timeout_sec: float | None = ...,
) -> None: ...
