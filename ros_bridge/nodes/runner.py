"""The runner: takes in ownship, traffic, alerts, route and geo-reference, and answers with plans.

    python -m ros_bridge.runner [--ros-args -r __ns:=/n123 --params-file FILE
        -p intruder_max_age:=3.0 ...]

A lifecycle node that configures and activates itself (``--manual`` leaves that to others). It
subscribes from the configuration on, and answers and publishes while it is active:

    in    ~/input/ownship          rlcas_msgs/AircraftState         best effort
          ~/input/traffic          rlcas_msgs/AircraftState         best effort
          ~/input/alerts           rlcas_msgs/TrafficAlert          reliable
          ~/input/route            rlcas_msgs/Trajectory            latched (route_durability)
          ~/input/geo_reference    rlcas_msgs/GeoReference          latched
          ~/input/areas            rlcas_msgs/Areas                 latched
          rlcas_monitor/output/status  rlcas_msgs/AssuranceStatus   the monitor's sign of life
    out   ~/output/trajectory      rlcas_msgs/Trajectory            latched; SAFE, or a withdrawal
          ~/output/advisory        rlcas_msgs/Trajectory            reliable; plans that are unsafe
          ~/output/path            nav_msgs/Path                    latched
          ~/output/odometry        nav_msgs/Odometry                the ownship, map to base_link
          ~/output/markers         visualization_msgs/MarkerArray   latched
          /diagnostics             diagnostic_msgs/DiagnosticArray
    srv   ~/generate_trajectory    rlcas_msgs/GenerateTrajectory
          ~/cancel_search          std_srvs/Trigger                 ends a long search

Parameters:
"""

import time
import uuid
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.task import Future
from rlcas_msgs.msg import AssuranceStatus, Trajectory
from rlcas_msgs.srv import GenerateTrajectory
from std_srvs.srv import Trigger

from agents.planner.answer import AdvisoryCode, Plan, RequestError
from agents.planner.recheck import recheck
from agents.planner.request.fields import listed
from agents.policy.inference import Policy
from ros_bridge.core import conversions, message_fields, updates
from ros_bridge.core.aircraft import load_policy
from ros_bridge.core.fields import SECOND, Code, FieldError, Refusal, nanoseconds
from ros_bridge.core.motion import to_local
from ros_bridge.core.planning import plan_task, prepare, rehearse
from ros_bridge.core.situation import NOTHING, Situation
from ros_bridge.core.tasks import LeftOut, PlanTask, in_terms_of_messages, refusal_of, task
from ros_bridge.core.tracks import UNKNOWN, ReportCheck, Track
from ros_bridge.nodes.requests import NO_PLAN, check
from ros_bridge.transport import process, qos, topics, views
from ros_bridge.transport.messages import advisory_message, filled, plan_message
from ros_bridge.transport.node_base import ListeningNode
from ros_bridge.transport.settings import aircraft_text, freshness_of, planning_settings
from ros_bridge.transport.topics import Topic

_AGES, _ODD = 1_000, 20  # aircraft that diagnostics list by age, and by reports not taken

_VIEWS_EVERY = 0.1  # s at most from a plan to its situation


class Runner(ListeningNode):
    """The node; everything that can be decided without ROS is decided in
    :mod:`ros_bridge.core.tasks`.
    """

    kind = "runner"
    sign = topics.PLAN.private.name

    def __init__(self, **more: Any) -> None:
        super().__init__(**more)
        self._revision = 0
        self._unique = NO_PLAN
        self._views: tuple[Plan, PlanTask] | None = None
        self._answers: Counter[str] = Counter()
        self._last_answer = "none yet"
        self._outside: tuple[str, ...] = ()  # what of the last plan is outside the policy's domain
        self._thread = ThreadPoolExecutor(1, "search")
        self._search: Future | None = None  # done when the long search that runs has ended
        self._era = 0

    def _start(self) -> None:
        super()._start()
        self._policy: Policy | None = None

    # Life cycle.

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load the policy and begin to listen."""
        try:
            route = self._route_topic()
            self._policy = policy = self._load_policy()
        except ValueError as error:
            self.get_logger().error(f"cannot be configured: {error}")
            return TransitionCallbackReturn.FAILURE
        options = planning_settings(self._value, self._aircraft).options
        self.get_logger().info(f"policy {policy.sha256}; aircraft {aircraft_text(options)}")
        self.get_logger().info(prepare(policy))
        self._listen(self._on_health, private=True)
        self._subscribe(topics.ALERTS.private, partial(self._take_in, updates.alert))
        self._subscribe(route, partial(self._take_in, updates.route))
        self._trajectories = self._advertise(topics.PLAN.private)
        self._advice = self._advertise(topics.ADVISORY.private)
        self._paths = self._advertise(topics.PATH.private)
        self._markers = self._advertise(topics.MARKERS.private)
        self._odometry = self._advertise(topics.ODOMETRY.private)
        self._offer_service()
        self._call_every(_VIEWS_EVERY, partial(self._show, "path and markers", self._on_views))
        self._subscribe(topics.STATUS, self._on_status)
        # Not before: while it plans, this node and the others come to know each other.
        self._warm_up_timer = self.create_timer(
            0.0, self._warm_up, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self._entities.append(lambda: self.destroy_timer(self._warm_up_timer))
        return TransitionCallbackReturn.SUCCESS

    def _route_topic(self) -> Topic:
        """Return the route's topic, or raise ValueError."""
        durability = self._value("route_durability")
        if durability not in qos.ROUTE:
            raise ValueError(
                f"route_durability is {durability!r}, expected {' or '.join(qos.ROUTE)}"
            )
        return topics.ROUTE.private._replace(quality=qos.ROUTE[durability])

    def _load_policy(self) -> Policy:
        """Return the policy for the aircraft, or raise ValueError."""
        file, digest = self._value("policy_file"), self._value("policy_sha256")
        policy = load_policy(file)
        if digest and digest.lower() != policy.sha256:
            raise ValueError(
                f"policy_sha256 is {digest!r}, but {file or 'the policy that ships'} has "
                f"{policy.sha256}"
            )
        return policy.for_aircraft(self._aircraft, outside=self._value("outside_domain"))

    def _offer_service(self) -> None:
        answer: Any = self._on_request  # a coroutine, which rclpy's types do not know of
        # A group of its own, and reentrant: while one answer is waited for, all else goes on.
        group = ReentrantCallbackGroup()
        service = self.create_service(
            GenerateTrajectory,
            "~/generate_trajectory",
            answer,
            qos_profile=qos.REQUESTS,
            callback_group=group,
        )
        self._entities.append(lambda: self.destroy_service(service))
        cancel = self.create_service(Trigger, "~/cancel_search", self._on_cancel)
        self._entities.append(lambda: self.destroy_service(cancel))

    def _warm_up(self) -> None:
        """Plan once, so that the first request is answered as fast as the others."""
        self._warm_up_timer.cancel()
        if self._policy is not None:
            rehearse(self._policy, planning_settings(self._value, self._aircraft).options)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Withdraw the plan, because it would not be replaced, and stop answering."""
        self._withdraw()
        self._era += 1
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget everything."""
        if self._search is not None:
            self.get_logger().error(
                "the answer of a slow search is not given yet: try again in some seconds"
            )
            return TransitionCallbackReturn.FAILURE
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Withdraw the plan and forget everything."""
        self._withdraw()
        return super().on_shutdown(state)

    def _forget_time(self) -> None:
        # What has no age stays.
        self._situation = replace(self._situation, own=UNKNOWN, traffic={}, alert=NOTHING)
        self._heard = 0
        self._era += 1
        self._withdraw()

    def _on_status(self, message: AssuranceStatus) -> None:
        """Note that the monitor is there; one that is latched is as old as it says."""
        moment = self._now()
        self._heard = min(moment, nanoseconds(message.header.stamp))

    def _on_views(self) -> None:
        if self._views is None or not self._active:
            return
        (result, inputs), self._views = self._views, None
        frame = self._value("map_frame")
        self._paths.publish(views.path(result, inputs, frame))
        self._markers.publish(views.markers(result, inputs, frame))

    def _take_in(self, update: Callable[..., Situation], message: Any) -> None:
        before = self._situation.own.last
        super()._take_in(update, message)
        if self._active and self._situation.own.last is not before:
            self._show("odometry", self._publish_odometry)

    def _publish_odometry(self) -> None:
        origin, own = self._situation.origin.value, self._situation.own
        if own.last is not None and origin is not None:
            state, frame = to_local(origin.frame, own.last), self._value("map_frame")
            self._odometry.publish(views.odometry(state, own.last, own.turn_rate, frame))

    # Answers.

    async def _on_request(
        self, request: GenerateTrajectory.Request, response: GenerateTrajectory.Response
    ) -> GenerateTrajectory.Response:
        began = time.perf_counter()
        try:
            await self._answer(request, response)
        except Refusal as refusal:
            response.status = int(refusal.code)
            response.field = refusal.field
            response.message = str(refusal)
        except Exception as error:  # The node goes on, and the caller gets an answer in any case.
            if rclpy.ok(context=self.context):
                # Else it is being stopped, and nothing can be published any more.
                self.get_logger().fatal(f"a request failed for an error of the runner: {error!r}")
            response.status = int(Code.INTERNAL_ERROR)
            response.message = f"the runner failed: {error!r}"
        response.computation_time = time.perf_counter() - began
        name = Code(response.status).name
        self._answers[name] += 1
        self._last_answer = f"{name} {response.message}".strip()
        return response

    async def _answer(
        self, request: GenerateTrajectory.Request, response: GenerateTrajectory.Response
    ) -> None:
        moment = self._now()
        if not self._active or self._policy is None:
            raise Refusal(
                Code.NOT_ACTIVE, "node", "is not active, expected it to be activated first"
            )
        self._forget(moment)
        self._check_whole()
        settings = planning_settings(self._value, self._aircraft)
        check(request, moment, settings, self._unique)
        try:
            requested_route = (
                conversions.route(request.route, "request.route") if request.route else None
            )
        except FieldError as error:
            raise Refusal(Code.INVALID_ROUTE, error.field, error.problem) from error
        inputs = task(self._situation, moment, settings, requested_route)
        try:
            result = plan_task(inputs, self._policy, exhaustive=False)
            # A monitor cannot wait for the slow stages: it asks again, and has its backup
            # meanwhile.
            patient = request.reason != request.REASON_REPLAN and self._search is None
            if not result.safe and settings.options.exhaustive and patient:
                result = await self._search_beside(inputs, self._policy, requested_route)
        except RequestError as error:
            raise refusal_of(error, inputs) from error
        self._publish(result, inputs, response)

    def _check_whole(self) -> None:
        """Refuse where what was received could not be taken in: something unknown is missing."""
        failed = self._protecting.problems()
        if failed:
            problem = f"{'; '.join(failed)}, expected to take in all that is received"
            raise Refusal(Code.INTERNAL_ERROR, "node", problem)

    async def _search_beside(
        self, inputs: PlanTask, policy: Policy, requested_route: conversions.Route | None
    ) -> Plan:
        """Search exhaustively in a thread beside the node, which goes on receiving and answering
        meanwhile.
        """
        era, unique = self._era, self._unique
        self._search = search = Future(executor=self.executor)
        job = self._thread.submit(plan_task, inputs, policy, exhaustive=True)
        job.add_done_callback(lambda _: self._wake(search))
        try:
            await search
        finally:
            self._search = None
        if not job.done():
            raise Refusal(Code.CANCELLED, "request", "was cancelled while a plan was sought")
        moment = self._now()
        if era != self._era or not self._active:
            problem = (
                "was answered after the node had been deactivated or the clock had stepped back"
            )
            raise Refusal(Code.NOT_ACTIVE, "request", f"{problem}, expected another request")
        if unique != self._unique:
            raise Refusal(Code.SUPERSEDED, "plan", "was overtaken by another while it was sought")
        plan = job.result()
        if not plan.safe:
            return plan
        # SAFE only if it still is from the present states on.
        self._check_whole()
        later_inputs = task(
            self._situation, moment, planning_settings(self._value, self._aircraft), requested_route
        )
        return recheck(
            plan,
            (later_inputs.time - inputs.time) / SECOND,
            later_inputs.own,
            later_inputs.intruders,
            later_inputs.points,
            later_inputs.options,
            later_inputs.own_altitude,
            plan.wind,  # the plan is flown in the wind that it was made in
            areas=later_inputs.areas,
        )

    def _wake(self, search: Future) -> None:
        """Let the node go on with an answer; called from the other thread."""
        executor = self.executor
        if not search.done():  # nobody has cancelled it
            search.set_result(None)
        if executor is not None:
            executor.wake()

    def _on_cancel(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Answer the request whose search goes on; its thread ends by itself, and the next waits
        for it.
        """
        response.success = self._search is not None
        response.message = "" if response.success else "no long search is going on"
        if self._search is not None:
            self._search.set_result(None)
        return response

    def _publish(
        self, result: Plan, inputs: PlanTask, response: GenerateTrajectory.Response
    ) -> None:
        frame = self._value("map_frame")
        self._revision = self._next(inputs.time)
        message = plan_message(
            result, inputs, frame, self._revision, certified=self._value("certificate")
        )
        response.trajectory = message
        self._explain(result, inputs, response)
        if not result.safe:
            self._advice.publish(message)
            return
        self._unique = bytes(message.id.uuid)
        self._trajectories.publish(message)
        # The answer does not wait for path and markers.
        self._views = result, inputs

    def _explain(
        self, result: Plan, inputs: PlanTask, response: GenerateTrajectory.Response
    ) -> None:
        """Write into an answer why its plan is not safe, what was assumed, and who is left out."""
        response.status = int(Code.SAFE if result.safe else Code.UNRESOLVED)
        names = inputs.identifiers
        texts = [in_terms_of_messages(reason.message, names) for reason in result.reasons]
        response.message = "; ".join(texts)
        if result.reasons:
            response.field = in_terms_of_messages(result.reasons[0].field, names)
        advisories = [
            advisory._replace(field=in_terms_of_messages(advisory.field, inputs.identifiers))
            for advisory in (*result.advisories, *inputs.notes)
        ]
        response.advisories = [advisory_message(advisory) for advisory in advisories]
        response.advisory = "; ".join(advisory.message for advisory in advisories)
        self._outside = tuple(
            advisory.message
            for advisory in advisories
            if advisory.code is AdvisoryCode.OUTSIDE_DOMAIN
        )
        left_out = [
            *(
                LeftOut(inputs.identifiers[exclusion.number], exclusion.reason)
                for exclusion in result.excluded
            ),
            *inputs.excluded,
        ]
        response.excluded_ids = [aircraft.name for aircraft in left_out]
        response.excluded_reasons = [aircraft.reason for aircraft in left_out]

    def _next(self, moment: int) -> int:
        """Return a revision above all before, of earlier runs of the node too: they begin at the
        clock's second.
        """
        return max(self._revision + 1, min(moment // SECOND, 2**31))

    def _withdraw(self) -> None:
        if self._unique == NO_PLAN:
            return
        moment = self.get_clock().now().nanoseconds
        self._revision, self._unique = self._next(moment), NO_PLAN
        fields = message_fields.withdrawal(self._revision, moment, uuid.uuid4().bytes)
        withdrawal = filled(Trajectory, fields, self._value("map_frame"))
        if self._active and rclpy.ok(context=self.context):
            self._trajectories.publish(withdrawal)

    def _on_health(self) -> None:
        """Publish whether a request would be answered now, and what is known."""
        moment = self._now()
        self._forget(moment)
        problem, level = "", DiagnosticStatus.WARN
        try:
            task(self._situation, moment, planning_settings(self._value, self._aircraft))
        except Refusal as refusal:
            problem = str(refusal)
        silence = self._silence(moment)
        if silence > freshness_of(self._value).monitor:
            # There was one, which somebody relied on.
            silent = f"the monitor has been silent for {silence:.1f} s"
            level, problem = DiagnosticStatus.ERROR, f"{silent}; {problem}".rstrip("; ")
        # Of the last plan, and of reports that contradict themselves, with which there is none.
        contradictions = [
            track.fault.message
            for track in self._aircraft_tracks().values()
            if track.fault and track.fault.check is ReportCheck.CONTRADICTION
        ]
        outside = [*self._outside, *([listed(contradictions)] if contradictions else [])]
        values = {"silence of the monitor, s": f"{silence:.2f}"}
        self._publish_health((level, problem), outside, self._health_values(moment) | values)

    def _aircraft_tracks(self) -> dict[str, Track]:
        """Return the ownship and the traffic, sorted, by name."""
        return {"ownship": self._situation.own, **dict(sorted(self._situation.traffic.items()))}

    def _health_values(self, moment: int) -> dict[str, str]:
        """Return what is known at a time, ns, as texts by their names."""
        situation = self._situation
        values = {
            "policy sha256": "" if self._policy is None else self._policy.sha256,
            "own age, s": f"{situation.own.age(moment):.3f}",
            "intruders": str(len(situation.traffic)),
        }
        ages = {name: track.age(moment) for name, track in situation.traffic.items()}
        # Of more aircraft the oldest.
        for name in sorted(sorted(ages, key=lambda name: -ages[name])[:_AGES]):
            values[f"age of {name}, s"] = f"{ages[name]:.3f}"
        values |= {f"answers {name}": str(count) for name, count in sorted(self._answers.items())}
        values |= {"last answer": self._last_answer, "revision": str(self._revision)}
        return values | self._odd_reports()

    def _odd_reports(self) -> dict[str, str]:
        """Return how many reports of each kind were not taken: of all, and of those aircraft that
        have most of them.
        """
        odd = {
            name: {kind: n for kind, n in track.counts.items() if kind is not ReportCheck.TAKEN}
            for name, track in self._aircraft_tracks().items()
        }
        totals: Counter[ReportCheck] = Counter()
        for counts in odd.values():
            totals.update(counts)
        most = sorted(odd, key=lambda name: -sum(odd[name].values()))[:_ODD]
        return {f"reports of all: {kind.value}": str(count) for kind, count in totals.items()} | {
            f"reports of {name}: {kind.value}": str(count)
            for name in sorted(most)
            for kind, count in odd[name].items()
        }


main = partial(process.main, Runner, "runner", __doc__)
