"""What runner and monitor share: their inputs, releasing what was made, and a clock that may step
back.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSCompatibility, QoSPolicyKind, qos_check_compatible

from agents.planner.request.fields import listed
from envs.formats.local_frame import LocalFrame
from ros_bridge.core import updates
from ros_bridge.core.areas import areas_of_file
from ros_bridge.core.categories import BY_CATEGORY
from ros_bridge.core.failures import Failures
from ros_bridge.core.fields import SECOND, FieldError, nanoseconds
from ros_bridge.core.situation import Situation
from ros_bridge.core.tracks import forget_silent
from ros_bridge.transport import topics, views
from ros_bridge.transport.clock import ClockGuard, call_in_any_time
from ros_bridge.transport.losses import Losses
from ros_bridge.transport.settings import (
    AGREED,
    agreed_text,
    aircraft_text,
    declare,
    freshness_of,
    planning_options,
    report_rules,
)
from ros_bridge.transport.topics import Topic

_BACKWARD = SECOND // 2
"""By how much the clock may step back before everything received is forgotten, ns."""

_IN_FLIGHT = SECOND  # for how long after that messages may arrive that were sent before
_FORGOTTEN_EVERY = 5.0  # s of real time between two lines in the log
_COUNTED = topics.TRAFFIC, topics.TRAFFIC_ARRAY, topics.ALERTS
"""Of the inputs those where each message counts; of the others a newer one follows soon, or only
the last one holds.
"""


def _is_ahead(update: Callable[..., Situation], message: Any, most: float) -> bool:
    """Return whether a message belongs to a moment after a time, ns."""
    if update not in (updates.ownship, updates.traffic, updates.traffic_array, updates.alert):
        return False  # it holds until the next
    parts = message.states if update is updates.traffic_array else [message]
    return any(nanoseconds(part.header.stamp) > most for part in parts)


class ListeningNode(ClockGuard, LifecycleNode):
    """A lifecycle node whose subscriptions, publishers and timers last from its configuration to
    its cleaning up.
    """

    kind: str  # such as "runner"
    sign: str  # a topic that no other node publishes

    def __init__(self, **more: Any) -> None:
        super().__init__(f"rlcas_{self.kind}", **more)
        self._entities: list[Callable[[], Any]] = []  # how each of them is destroyed
        self._areas_problem = ""  # why the areas of the file cannot be used
        self._qos_problems: dict[str, tuple[Topic, str]] = {}
        """Topics and sentences, by name, as long as something there does not fit."""
        self._protecting = Failures(self.get_logger().fatal)
        """Of what is promised to others: while there are any, nothing may be called safe."""
        self._showing = Failures(self.get_logger().error)
        """Of what only shows."""
        self._losses = Losses()
        self._active = False
        aircraft = declare(self, self.kind)
        assert aircraft is not None, "runner and monitor have an aircraft"
        self._aircraft = aircraft
        planning_options(self._value, aircraft)
        self._fixed_areas = areas_of_file(self._value("areas_file"))
        self.add_on_set_parameters_callback(self._check_parameters)
        self._start()

    def _start(self) -> None:
        """Forget everything that was received."""
        self._situation = Situation(
            fixed_areas=self._fixed_areas, areas_file=self._value("areas_file") or ""
        )
        self._latest = self._settled = 0
        self._heard = 0  # when the other of runner and monitor was heard last, ns; 0: never
        self._forgotten: tuple[str, ...] = ()  # and not logged yet
        self._logged_forgotten = -math.inf  # when that was logged last, s of real time

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value if self.has_parameter(name) else None

    def _check_parameters(self, parameters: list[Any]) -> SetParametersResult:
        """Refuse values that contradict each other or those that stay."""
        values = {parameter.name: parameter.value for parameter in parameters}
        try:
            planning_options(lambda name: values.get(name, self._value(name)), self._aircraft)
        except ValueError as problem:
            return SetParametersResult(successful=False, reason=str(problem))
        return SetParametersResult(successful=True)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to work."""
        self._active = True
        result = super().on_activate(state)
        self.get_logger().info("active")
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop working."""
        self._active = False
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget everything."""
        for destroy in self._entities:
            destroy()
        self._entities.clear()
        self._qos_problems.clear()
        for failures in (self._protecting, self._showing):
            failures.forget()
        self._start()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop working and forget everything."""
        self._active = False
        return ListeningNode.on_cleanup(self, state)

    def _subscribe(self, topic: Topic, callback: Callable[[Any], None]) -> None:
        says = "a publisher offers less {} than asked for; nothing of it is received"
        events = SubscriptionEventCallbacks(incompatible_qos=self._misfit(topic, says))
        counted = any(
            topic.name in (counted_topic.name, counted_topic.private.name)
            for counted_topic in _COUNTED
        )
        receive: Callable[..., Any] = partial(self._protect, topic.name, callback)
        receive = self._losses.counting(topic.name, receive, time.monotonic) if counted else receive
        subscription = topic.subscribe(self, receive, event_callbacks=events)
        self._entities.append(lambda: self.destroy_subscription(subscription))

    def _advertise(self, topic: Topic) -> Any:
        says = "a subscriber asks for more {} than offered; it receives nothing"
        events = PublisherEventCallbacks(incompatible_qos=self._misfit(topic, says))
        # Diagnostics are published by the inactive node too.
        always = topic is topics.DIAGNOSTICS
        make = self.create_publisher if always else self.create_lifecycle_publisher
        publisher = make(*topic, event_callbacks=events)
        self._entities.append(lambda: self.destroy_publisher(publisher))
        return publisher

    def _misfit(self, topic: Topic, says: str) -> Callable[[Any], None]:
        """Return what notes that a quality of service does not fit: ``says``, with its name."""

        def note(event: Any) -> None:
            policy = QoSPolicyKind(int(event.last_policy_kind)).name.lower()
            problem = f"{topic.name}: {says.format(policy)}"
            self._qos_problems[topic.name] = topic, problem
            self.get_logger().error(problem)

        return note

    def _problems_of_graph(self) -> list[str]:
        """Return what is wrong with the publishers and subscribers that there are."""
        self._qos_problems = {
            name: misfit
            for name, misfit in self._qos_problems.items()
            if not self._all_fit(misfit[0])
        }
        problems = [problem for _, problem in self._qos_problems.values()]
        name = self.resolve_topic_name(self.sign)
        namesakes = self.count_publishers(name)
        if namesakes > 1:
            problems.append(
                f"{name} has {namesakes} publishers, expected this node alone: another of its name "
                "runs, or one was killed in the last 20 s"
            )
        return problems

    def _all_fit(self, topic: Topic) -> bool:
        """Return whether what publishes and subscribes to a topic fits this node's side of it."""
        name, mine = self.resolve_topic_name(topic.name), (self.get_namespace(), self.get_name())
        return not any(
            qos_check_compatible(offered.qos_profile, requested.qos_profile)[0]
            == QoSCompatibility.ERROR
            for offered in self.get_publishers_info_by_topic(name)
            for requested in self.get_subscriptions_info_by_topic(name)
            if mine
            in [(endpoint.node_namespace, endpoint.node_name) for endpoint in (offered, requested)]
        )

    def _protect(self, name: str, work: Callable[..., Any], *arguments: Any) -> bool:
        """Do a part of what is promised, and return whether it went well; if not, the node goes on
        and says so (:attr:`_protecting`).
        """
        return self._attempt(self._protecting, name, partial(work, *arguments))

    def _show(self, name: str, work: Callable[[], Any]) -> bool:
        """Do what only shows, and return whether it went well."""
        return self._attempt(self._showing, name, work)

    def _attempt(self, failures: Failures, name: str, work: Callable[[], Any]) -> bool:
        try:
            work()
        except Exception as error:
            if not rclpy.ok(context=self.context):
                raise  # the node is being stopped
            failures.note(name, error)
            return False
        failures.clear(name)
        return True

    def _call_every(self, period: float, callback: Callable[[], Any]) -> None:
        timer = self.create_timer(period, callback)
        self._entities.append(lambda: self.destroy_timer(timer))

    def _listen(self, health: Callable[[], None], *, private: bool) -> None:
        """Subscribe to ownship, traffic, geo-reference and areas, and publish the state of health;
        the runner privately.
        """
        for topic, update in (
            (topics.OWNSHIP, updates.ownship),
            (topics.TRAFFIC, updates.traffic),
            (topics.TRAFFIC_ARRAY, updates.traffic_array),
            (topics.GEO_REFERENCE, updates.geo_reference),
            (topics.AREAS, updates.areas),
        ):
            self._subscribe(topic.private if private else topic, partial(self._take_in, update))
        self._health = self._advertise(topics.DIAGNOSTICS)
        report = partial(self._tell_health, health)
        for timer in call_in_any_time(self, self._value("diagnostics_period"), report):
            self._entities.append(partial(self.destroy_timer, timer))

    def _tell_health(self, health: Callable[[], None]) -> None:
        """Publish the state of health; where that itself fails, what is wrong."""
        if not self._show("diagnostics", health):
            errors = "; ".join([*self._protecting.problems(), *self._showing.problems()])
            self._health.publish(views.diagnostics(self, DiagnosticStatus.ERROR, errors, {}))

    def _take_in(self, update: Callable[..., Situation], message: Any) -> None:
        """Take a message into the situation, and log an origin, a route or areas that cannot be
        used.
        """
        moment, rules = self._now(), report_rules(self._value)  # may reset the situation
        if moment < self._settled and _is_ahead(update, message, moment + rules.future * SECOND):
            # Just after the clock has stepped back, what is ahead of it was sent before that.
            return
        before = self._situation
        self._situation = after = update(before, message, moment, rules)
        for previous, new in (
            (before.origin, after.origin),
            (before.route, after.route),
            (before.areas, after.areas),
        ):
            if new is not previous and new.fault is not None:
                self.get_logger().error(new.fault.message)
        if after.origin.value is not None and after.origin.value != before.origin.value:
            self._tell_areas(after.origin.value.frame)

    def _tell_areas(self, frame: LocalFrame) -> None:
        """Log which areas of the file count about an origin."""
        name, log = self._situation.areas_file, self.get_logger()
        if not name:
            return
        self._areas_problem = ""
        try:
            placed = self._situation.fixed_in(frame, self._latest)
        except FieldError as problem:
            self._areas_problem = str(problem)
            log.error(self._areas_problem)
            return
        for change in placed.changes:
            log.warning(change)
        left_out = f"; left out: {placed.far}" if placed.far else ""
        log.info(f"{name}: {len(placed.areas)} areas count{left_out}")

    def _publish_health(
        self, problem: tuple[bytes, str], outside: Sequence[str], values: dict[str, str]
    ) -> None:
        """Publish a level and what is wrong ("": nothing), or what is worse; ``outside`` its domain
        is a warning.
        """
        level, message = problem if problem[1] else (DiagnosticStatus.OK, "ready")
        if not self._active:
            level, message = DiagnosticStatus.WARN, "not active"
        lost = self._losses.problem(time.monotonic())
        failed = [*self._protecting.problems(), *self._showing.problems()]
        errors = [*self._problems_of_graph(), lost, self._areas_problem, *failed]
        if any(errors):
            level, message = DiagnosticStatus.ERROR, "; ".join(filter(None, errors))
        if outside and level == DiagnosticStatus.OK:
            level, message = DiagnosticStatus.WARN, "; ".join(outside)
        options = planning_options(self._value, self._aircraft)
        values = {
            "aircraft": aircraft_text(options),
            "separation, m": f"{options.requirement.separation:g}",
            AGREED: agreed_text(self._value),
            BY_CATEGORY: self._value("category_separations") or "",
            **freshness_of(self._value).texts(),
            "outside domain": "; ".join(outside),
            **{f"lost of {topic}": str(n) for topic, n in sorted(self._losses.counts.items())},
        } | values
        if rclpy.ok(context=self.context):
            self._health.publish(views.diagnostics(self, level, message, values))

    def _forget(self, moment: int) -> None:
        """Forget the aircraft that have fallen silent."""
        after = freshness_of(self._value).silence
        traffic, silent = forget_silent(self._situation.traffic, moment, after)
        if silent:
            self._situation = replace(self._situation, traffic=traffic)
            self._forgotten += silent
        if self._forgotten and time.monotonic() - self._logged_forgotten > _FORGOTTEN_EVERY:
            forgotten, self._forgotten = self._forgotten, ()
            self._logged_forgotten = time.monotonic()
            self.get_logger().info(f"silent, and forgotten: {listed(forgotten)}")

    def _now(self) -> int:
        """Return the node's time, ns; when it has stepped back, everything received belongs to
        another time.
        """
        moment = self.get_clock().now().nanoseconds
        if moment < self._latest - _BACKWARD:
            back = (self._latest - moment) / SECOND
            self.get_logger().warning(
                f"the clock stepped back by {back:.1f} s: all that was received is forgotten"
            )
            self._forget_time()
            self._latest, self._settled = moment, moment + _IN_FLIGHT
        self._latest = max(self._latest, moment)
        return moment

    def _silence(self, moment: int) -> float:
        """Return for how long the other of runner and monitor is silent, s; -1: it never spoke."""
        return -1.0 if self._heard == 0 else (moment - self._heard) / SECOND

    def _forget_time(self) -> None:
        """Forget what belongs to another time."""
        before = self._situation
        self._start()
        self._situation = replace(self._situation, origin=before.origin, areas=before.areas)
