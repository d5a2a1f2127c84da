"""A node's clock: a message of ``/clock`` that is no time is passed over, and what must go on goes
on while the clock stands still.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rosgraph_msgs.msg import Clock as ClockMessage

from ros_bridge.core.fields import FieldError, integer

__all__ = ["ClockGuard", "call_in_any_time"]

_LOG_EVERY = 5.0  # s
_LAST = 2**31 - 1 - 100_000  # s: plans from then on end before the times of messages do


class ClockGuard(Node):
    """A node that a wrong message of ``/clock`` does not end: rclpy raises an error for a negative
    time where nothing catches it.
    """

    def create_subscription(
        self,
        msg_type: Any,
        topic: str,
        callback: Callable[..., Any],
        *positional: Any,
        **named: Any,
    ) -> Any:
        """Return a subscription as rclpy makes it; of ``/clock`` one that looks at the time
        first.
        """
        if msg_type is ClockMessage and not named.get("raw"):
            callback = partial(self._take_clock, callback)
        return super().create_subscription(msg_type, topic, callback, *positional, **named)

    def _take_clock(self, take: Callable[..., Any], message: ClockMessage) -> None:
        try:
            integer("/clock.clock.sec", message.clock.sec, 0, _LAST)
            integer("/clock.clock.nanosec", message.clock.nanosec, 0, 999_999_999)
        except FieldError as error:
            self.get_logger().error(f"passed over: {error}", throttle_duration_sec=_LOG_EVERY)
            return
        take(message)


def call_in_any_time(node: Node, period: float, callback: Callable[[], None]) -> tuple[Any, Any]:
    """Have a callback called every ``period`` s of the node's time, and, where that stands still,
    of real time; return both timers.
    """
    called = False

    def on_time() -> None:
        nonlocal called
        called = True
        callback()

    def on_real_time() -> None:
        nonlocal called
        if not called:
            callback()
        called = False

    steady = Clock(clock_type=ClockType.STEADY_TIME)
    # The second looks back over more than one period of the first.
    return (
        node.create_timer(period, on_time),
        node.create_timer(1.5 * period, on_real_time, clock=steady),
    )
