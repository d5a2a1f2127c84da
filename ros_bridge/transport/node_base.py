# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""What runner and monitor share: their inputs, releasing what was made, and a clock that may step back."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rlcas_msgs.msg import AircraftState, GeoReference

from ros_bridge.core import updates
from ros_bridge.core.fields import SECOND
from ros_bridge.core.situation import Situation
from ros_bridge.core.tracks import forgotten
from ros_bridge.transport import qos
from ros_bridge.transport.settings import aircraft_text, declare, planning_options, report_rules

_BACKWARD = SECOND // 2  # by how much the clock may step back before everything received is forgotten


class ListeningNode(LifecycleNode):
    """A lifecycle node whose subscriptions, publishers and timers last from its configuration to its cleaning up."""

    def __init__(self, kind: str, **more: Any) -> None:
        super().__init__(f"rlcas_{kind}", **more)
        self._entities: list[Callable[[], Any]] = []
        """How each of them is destroyed."""
        self._qos_problems: dict[str, str] = {}
        """Sentences on qualities of service that do not fit, by topic; kept until the node is configured anew."""
        self._active = False
        self._latest = 0
        self._situation = Situation()
        aircraft = declare(self, kind)
        assert aircraft is not None, "runner and monitor have an aircraft"
        self._aircraft = aircraft
        try:
            planning_options(self._value, aircraft)
        except ValueError:
            self.destroy_node()
            raise
        self.add_on_set_parameters_callback(self._fitting)

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value if self.has_parameter(name) else None

    def _fitting(self, wanted: list[Any]) -> SetParametersResult:
        given = {one.name: one.value for one in wanted}
        try:
            planning_options(lambda name: given.get(name, self._value(name)), self._aircraft)
        except ValueError as problem:
            return SetParametersResult(successful=False, reason=str(problem))
        return SetParametersResult(successful=True)

    @property
    def _flown(self) -> str:
        return aircraft_text(planning_options(self._value, self._aircraft))

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

    def _listen(self, name: str) -> None:
        """Subscribe to ownship, traffic and geo-reference under the runner's name."""
        self._subscribe(AircraftState, f"{name}/input/ownship", self._on_ownship, qos.SENSOR)
        self._subscribe(AircraftState, f"{name}/input/traffic", self._on_traffic, qos.TRAFFIC)
        self._subscribe(GeoReference, f"{name}/input/geo_reference", self._on_geo_reference, qos.LATCHED)

    def _on_ownship(self, message: AircraftState) -> None:
        now = self._now()  # may reset the situation
        self._situation = updates.ownship(self._situation, message, now, report_rules(self._value))

    def _on_traffic(self, message: AircraftState) -> None:
        now = self._now()
        self._situation = updates.traffic(self._situation, message, now, report_rules(self._value))

    def _on_geo_reference(self, message: GeoReference) -> None:
        now = self._now()
        self._situation = updates.geo_reference(self._situation, message, now)
        if self._situation.origin_fault is not None:
            self.get_logger().error(self._situation.origin_fault.message)

    def _forget(self, now: int) -> None:
        """Forget the aircraft that have fallen silent."""
        traffic, silent = forgotten(self._situation.traffic, now, self._value("forget_after"))
        if silent:
            self._situation = replace(self._situation, traffic=traffic)
            self.get_logger().info(f"silent, and forgotten: {', '.join(silent)}")

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
