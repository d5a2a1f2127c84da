"""A display on the ROS graph: it subscribes to what runner and monitor hear and publish."""

import threading
from functools import partial
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.signals import SignalHandlerOptions

from commands.command import InputError
from ros_bridge.display.scene import INPUTS, take
from ros_bridge.display.server import LiveSource
from ros_bridge.transport import topics
from ros_bridge.transport.clock import ClockGuard
from ros_bridge.transport.discovery import configure_dds, reserve_ports

__all__ = ["Listening"]

_LOOK = 0.5  # s between two looks at whether to stop


class Listening:
    """A node that feeds a live source from a thread of its own while it is entered.

    Args:
        arguments: ``--ros-args`` and what follows it; such as ``-r __ns:=/n123``,
            ``-p use_sim_time:=true``.
        centre: of the map where the ownship is unknown, degrees.
        separation: that is drawn, m; None: as the nodes say.

    Raises:
        InputError: the arguments cannot be used.
    """

    def __init__(
        self,
        arguments: list[str],
        centre: tuple[float, float] | None = None,
        separation: float | None = None,
    ) -> None:
        configure_dds()
        try:
            # The server ends in order at a signal, and this with it.
            rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
            with reserve_ports():
                self._node = ClockGuard("rlcas_display")
        except (ValueError, RuntimeError) as error:
            rclpy.try_shutdown()
            raise InputError(f"ROS arguments cannot be used: {error}") from error
        self.live = LiveSource(self._clock, centre, separation)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._spin, name="graph", daemon=True)

    def _clock(self) -> int:
        return self._node.get_clock().now().nanoseconds

    def __enter__(self) -> "Listening":
        """Begin to listen."""
        for topic in topics.EVERY:
            if topic is not topics.CLOCK and topic.name in INPUTS:
                topic.undemanding.subscribe(self._node, partial(self._hear, topic.name))
        self._thread.start()
        return self

    def __exit__(self, *problem: object) -> None:
        """Stop, and leave the graph."""
        self._stopped.set()
        self._thread.join()
        self._node.destroy_node()
        rclpy.try_shutdown()

    def _hear(self, name: str, message: Any) -> None:
        """Feed a message of a topic, once simulated time has begun."""
        moment = self._clock()
        if moment > 0:
            self.live.feed(partial(take, name=name, message=message, moment=moment))

    def _spin(self) -> None:
        # It waits for events instead of building a set of what to wait for at every message.
        executor = EventsExecutor()
        executor.add_node(self._node)
        try:
            while not self._stopped.is_set():
                executor.spin_once(timeout_sec=_LOOK)
        except ExternalShutdownException:
            pass
        finally:
            executor.shutdown()
