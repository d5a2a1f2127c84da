# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""What runner and monitor share: a lifecycle node that gives back what it made, and a clock that may step back."""

from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from ros_bridge.core.fields import SECOND
from ros_bridge.transport import qos
from ros_bridge.transport.settings import declare, vehicle_limits

__all__ = ["ListeningNode"]

_BACKWARD = SECOND // 2  # by how much the clock may step back before everything received is forgotten


class ListeningNode(LifecycleNode):
    """A lifecycle node whose subscriptions, publishers and timers last from its configuration to its cleaning up."""

    def __init__(self, name: str, **more: Any) -> None:
        super().__init__(name, **more)
        self._entities: list[Callable[[], Any]] = []
        """How each of them is destroyed."""
        self._qos_problems: dict[str, str] = {}
        """Sentences on qualities of service that do not fit, by topic; kept until the node is configured anew."""
        self._active = False
        self._latest = 0

    def _declare(self, *declared: Any) -> None:
        """Declare parameters; limits that contradict each other are refused, now and whenever they are set.

        Raises:
            ValueError: they do.
        """
        declare(self, *declared)
        vehicle_limits(lambda name: self.get_parameter(name).value)
        self.add_on_set_parameters_callback(self._fitting)

    def _fitting(self, wanted: list[Any]) -> SetParametersResult:
        given = {one.name: one.value for one in wanted}
        try:
            vehicle_limits(lambda name: given.get(name, self.get_parameter(name).value))
        except ValueError as problem:
            return SetParametersResult(successful=False, reason=str(problem))
        return SetParametersResult(successful=True)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to work."""
        self._active = True
        done = super().on_activate(state)
        self.get_logger().info("active")
        return done

    def _destroy(self) -> None:
        for destroy in self._entities:
            destroy()
        self._entities.clear()
        self._qos_problems.clear()

    def _subscribe(self, kind: type, topic: str, callback: Callable[[Any], None], quality: Any) -> None:
        events = qos.subscription_events(topic, self._on_qos_problem)
        made = self.create_subscription(kind, topic, callback, quality, event_callbacks=events)
        self._entities.append(lambda: self.destroy_subscription(made))

    def _advertise(self, kind: type, topic: str, quality: Any) -> Any:
        events = qos.publisher_events(topic, self._on_qos_problem)
        # Diagnostics are published by the inactive node too.
        make = self.create_publisher if topic == "/diagnostics" else self.create_lifecycle_publisher
        made = make(kind, topic, quality, event_callbacks=events)
        self._entities.append(lambda: self.destroy_publisher(made))
        return made

    def _call_every(self, period: float, callback: Callable[[], None]) -> None:
        timer = self.create_timer(period, callback)
        self._entities.append(lambda: self.destroy_timer(timer))

    def _on_qos_problem(self, topic: str, sentence: str) -> None:
        self._qos_problems[topic] = sentence
        self.get_logger().error(sentence)

    def _now(self) -> int:
        """Return the node's time, ns; when it has stepped back, everything received belongs to another time."""
        now = self.get_clock().now().nanoseconds
        if now < self._latest - _BACKWARD:
            back = (self._latest - now) / SECOND
            self.get_logger().warning(f"the clock stepped back by {back:.1f} s: all that was received is forgotten")
            self._latest = now
            self._stepped_back()
        self._latest = max(self._latest, now)
        return now

    def _stepped_back(self) -> None:
        """Forget what belongs to another time."""
        raise NotImplementedError
