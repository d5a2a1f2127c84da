"""The run-time monitor: checks the plan that is flown, requests new ones, and falls back to a
backup.

    python -m ros_bridge.monitor [--ros-args -r __ns:=/n123 --params-file FILE
        -p separation:=1200.0 ...]

A lifecycle node that configures and activates itself (``--manual`` leaves that to others). It
subscribes to the runner's inputs under the runner's names, so that both need no remapping in one
namespace:

    in    rlcas_runner/input/ownship         rlcas_msgs/AircraftState       best effort
          rlcas_runner/input/traffic         rlcas_msgs/AircraftState       best effort
          rlcas_runner/input/geo_reference   rlcas_msgs/GeoReference        latched
          rlcas_runner/input/areas           rlcas_msgs/Areas               latched
          rlcas_runner/output/trajectory     rlcas_msgs/Trajectory          latched
          /diagnostics                       of the runner: its sign of life
    out   ~/output/status                    rlcas_msgs/AssuranceStatus     latched, every period
          ~/output/backup                    rlcas_msgs/Trajectory          latched, while flown
          ~/output/guidance                  rlcas_msgs/GuidanceBands       latched, every time step
          /diagnostics                       diagnostic_msgs/DiagnosticArray
    calls rlcas_runner/generate_trajectory   rlcas_msgs/GenerateTrajectory

What is to be flown is AssuranceStatus.fly. A status comes every period, also where the judgement
itself fails: then it is DENIED and says why, and after 1 s nothing is to be flown. Bands and alerts
only show; where they fail the diagnostics say so, and all else goes on. Parameters:
"""

import math
import time
import uuid
from functools import partial
from typing import NamedTuple

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.task import Future
from rlcas_msgs.msg import AssuranceStatus, GuidanceBands, Trajectory
from rlcas_msgs.srv import GenerateTrajectory

from agents.assurance.single import Ask
from agents.assurance.state import FlyMode, State
from ros_bridge.core import message_fields
from ros_bridge.core.assurance import (
    Published,
    accept_answer,
    activate,
    backup,
    fly_mode,
    initial,
    read_plan,
    step_monitor,
    withdraw,
)
from ros_bridge.core.fields import SECOND, FieldError, nanoseconds
from ros_bridge.core.guidance import blank, guidance
from ros_bridge.core.lookout import step_without_plan
from ros_bridge.core.planning import prepare
from ros_bridge.core.status import status
from ros_bridge.transport import process, topics
from ros_bridge.transport.messages import filled, header
from ros_bridge.transport.node_base import ListeningNode
from ros_bridge.transport.settings import (
    AGREED,
    agreed_text,
    aircraft_text,
    disagreements,
    freshness_of,
    monitor_thresholds,
    separations_by_category,
    unknown_spread,
)

_SLOW = 0.1  # s of real time; bands that take longer, as among hundreds of aircraft, ...
_GUIDE_EVERY = 10.0  # ... are made again after so many times that: judging comes first
_SHARE = 2.0  # times that a judgement takes, until the next: as much is left for messages
_BACKUP_AGAIN = SECOND  # between two publications of the backup that is flown


class _Pending(NamedTuple):
    """A request on its way to the runner."""

    number: int  # of the monitor's question
    future: "Future[GenerateTrajectory.Response]"
    since: int  # ns


class Monitor(ListeningNode):
    """The node; what it decides is decided in :mod:`ros_bridge.core.assurance` and
    :mod:`agents.assurance.single`.
    """

    kind = "monitor"
    sign = topics.STATUS.private.name

    def _start(self) -> None:
        super()._start()
        self._supervision = initial(
            monitor_thresholds(self._value, self._aircraft),
            unknown_spread(self._value),
            separations_by_category(self._value),
        )
        self._looking = self._supervision  # without a plan: for bands and alerts before the first
        self._judged = self._supervision  # as it came to its assessment
        self._differences: list[str] = []  # from the runner's parameters, a sentence each
        self._pending: _Pending | None = None
        self._waiting: Published | None = None  # a plan that may be the answer that is awaited
        self._backup_at = 0
        self._backups = 0
        self._shown = blank(self._supervision.thresholds)
        self._judged_at = self._judge_from = 0  # ns
        self._guide_from = -math.inf  # s of real time

    # Life cycle.

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to listen."""
        self._start()
        self.get_logger().info(f"aircraft {aircraft_text(self._supervision.thresholds.options)}")
        self.get_logger().info(prepare())
        self._listen(self._on_health, private=False)
        self._subscribe(topics.PLAN, self._on_trajectory)
        self._subscribe(topics.DIAGNOSTICS, self._on_diagnostics)
        self._statuses = self._advertise(topics.STATUS.private)
        self._backup = self._advertise(topics.BACKUP.private)
        self._guidance = self._advertise(topics.GUIDANCE.private)
        self._client = self.create_client(GenerateTrajectory, topics.SERVICE)
        self._entities.append(lambda: self.destroy_client(self._client))
        self._call_every(self._value("period"), partial(self._protect, "the monitor", self._check))
        return TransitionCallbackReturn.SUCCESS

    # Inputs.

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        name = self.resolve_topic_name(topics.RUNNER)
        for health in message.status:
            if health.name == name:
                self._heard = self._now()
                values = {pair.key: pair.value for pair in health.values}
                self._differences = disagreements(agreed_text(self._value), values.get(AGREED, ""))

    def _on_trajectory(self, message: Trajectory) -> None:
        self._heard = self._now()
        if message.status == Trajectory.STATUS_WITHDRAWN:
            self._supervision = withdraw(self._supervision, message.revision)
            return
        plan = self._read_plan(message)
        if plan is not None:
            self._waiting = plan
            self._take_waiting()

    def _read_plan(self, message: Trajectory) -> Published | None:
        """Return a plan that may be flown; None: the message holds none, and why is logged."""
        try:
            return read_plan(message, self._supervision.thresholds)
        except FieldError as error:
            self.get_logger().error(str(error))
            return None

    # Judgement.

    def _check(self) -> None:
        """Judge what is flown, say so, and show what there is to show."""
        moment, began = self._now(), time.monotonic()
        if not self._active or moment <= 0 or self._judged_at <= moment < self._judge_from:
            return
        went_well = self._protect("the judgement", self._judge, moment)
        self._publish(moment)
        # By this clock: a simulated one may wait for the status.
        self._judge_from = moment + round(_SHARE * (time.monotonic() - began) * SECOND)
        began = time.monotonic()
        if went_well and began >= self._guide_from:
            self._show("bands and alerts", partial(self._guide, moment))
            took = time.monotonic() - began
            self._guide_from = began + (_GUIDE_EVERY * took if took > _SLOW else 0.0)

    def _judge(self, moment: int) -> None:
        self._forget(moment)
        self._supervision = step_monitor(self._supervision, self._situation, moment)
        self._judged = self._supervision  # a plan that is taken up may know other intruders
        assessment = self._judged.assessment
        if assessment is not None:
            self._give_up_waiting(moment)
            if assessment.ask is not None:
                self._request(assessment.ask, moment)
        self._judged_at = moment

    def _request(self, ask: Ask, moment: int) -> None:
        if not self._client.service_is_ready():
            self._answer(ask.number, None)
            return
        request = GenerateTrajectory.Request(reason=GenerateTrajectory.Request.REASON_REPLAN)
        request.header = header(moment, self._value("map_frame"))
        future = self._client.call_async(request)
        self._pending = _Pending(ask.number, future, moment)
        future.add_done_callback(self._on_answer)

    def _on_answer(self, future: "Future[GenerateTrajectory.Response]") -> None:
        self._protect("the answer", self._take_answer, future)

    def _take_answer(self, future: "Future[GenerateTrajectory.Response]") -> None:
        if self._pending is None or future is not self._pending.future:
            return
        number = self._pending.number
        self._heard = self._now()
        response, plan = future.result(), None
        assert response is not None, "the future is done"
        if response.status == GenerateTrajectory.Response.STATUS_SAFE:
            plan = self._read_plan(response.trajectory)
        else:
            self.get_logger().warning(f"no plan: {response.message}")
        self._pending = None
        self._answer(number, plan)
        self._take_waiting()

    def _answer(self, number: int, plan: Published | None) -> None:
        """Tell the core what became of its question; None: there is no plan."""
        before = fly_mode(self._supervision)
        self._supervision, _ = accept_answer(self._supervision, number, plan)
        if fly_mode(self._supervision) is not before:
            self._publish(self._latest)

    def _give_up_waiting(self, moment: int) -> None:
        """Stop waiting for an answer that does not come; DDS may not yet notice that the runner is
        gone.
        """
        if self._pending is None:
            return
        if (moment - self._pending.since) / SECOND > self._value("answer_time"):
            self._client.remove_pending_request(self._pending.future)
            self._pending = None
            self._take_waiting()

    def _take_waiting(self) -> None:
        # While an answer is on its way, the plan may be that answer.
        if self._waiting is not None and self._pending is None:
            self._supervision = activate(self._supervision, self._situation, self._waiting)
            self._waiting = None

    # Outputs.

    def _publish(self, moment: int) -> None:
        """Publish the status, in any case, and the backup while it is flown."""
        if not (self._active and rclpy.ok(context=self.context)):
            return
        status = AssuranceStatus(header=header(moment, self._value("map_frame")))
        self._protect("the status", self._describe, status)
        failed = self._protecting.problems()
        if failed:
            status.state, status.reasons = AssuranceStatus.STATE_DENIED, [*status.reasons, *failed]
            status.measured = False
            if (moment - self._judged_at) / SECOND > freshness_of(self._value).monitor:
                status.fly = AssuranceStatus.FLY_NOTHING
        self._statuses.publish(status)
        self._protect("the backup", self._publish_backup, moment)

    def _publish_backup(self, moment: int) -> None:
        if fly_mode(self._supervision) is not FlyMode.BACKUP:
            self._backup_at = 0
            return
        if moment - self._backup_at < _BACKUP_AGAIN:
            return
        own = self._situation.own.last
        backup_plan = backup(self._supervision, None if own is None else own.altitude)
        if backup_plan is not None:
            self._backup_at, self._backups = moment, self._backups + 1
            named = backup_plan._replace(unique=uuid.uuid4().bytes, revision=self._backups)
            fields = message_fields.plan(named, Trajectory.STATUS_BACKUP)
            self._backup.publish(filled(Trajectory, fields, self._value("map_frame")))

    def _guide(self, moment: int) -> None:
        """Publish bands and alerts, once in a time step, of what was assessed; before the first
        plan, of a monitor that has none.
        """
        supervision = self._judged
        if supervision.assessment is None:
            supervision = self._looking = step_without_plan(self._looking, self._situation, moment)
        self._shown, bands = guidance(self._shown, supervision, moment)
        if bands is not None:
            stamp = header(moment, self._value("map_frame"))
            self._guidance.publish(GuidanceBands(header=stamp, **bands.fields()))

    def _describe(self, message: AssuranceStatus) -> None:
        """Write into a status what holds."""
        limits = self._supervision.thresholds
        fields = status(self._supervision).fields() | {
            "cross_track_limit": limits.cross_track,
            "along_track_limit": limits.along_track,
            "time_error_limit": limits.time_error,
            "runner_silence": self._silence(nanoseconds(message.header.stamp)),
        }
        for name, value in fields.items():
            setattr(message, name, value)
        if self._supervision.published_plan is not None:
            message.trajectory_id.uuid = list(self._supervision.published_plan.unique)
            message.trajectory_revision = self._supervision.published_plan.revision

    def _on_health(self) -> None:
        state = State(int(self._supervision.monitor.state[0]))
        problem = state.name if state in (State.DENIED, State.BACKUP) else ""
        level = DiagnosticStatus.WARN
        silence = self._silence(self._now())
        if not 0.0 <= silence <= freshness_of(self._value).node:
            level, problem = DiagnosticStatus.ERROR, "the runner is silent"
        elif self._differences:
            level = DiagnosticStatus.ERROR
            problem = f"the runner differs: {'; '.join(self._differences)}"
            self.get_logger().error(problem, throttle_duration_sec=30.0)
        values = {
            "state": state.name,
            "flown": fly_mode(self._supervision).name,
            "silence of the runner, s": f"{silence:.2f}",
        }
        assessment = self._judged.assessment
        outside = [] if assessment is None else assessment.outside
        self._publish_health((level, problem), outside, values)


main = partial(process.main, Monitor, "monitor", __doc__)
