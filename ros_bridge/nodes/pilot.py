"""The pilot: flies what the monitor selects, as speed and yaw rate for an autopilot or a simulator
that takes these.

    python -m ros_bridge.pilot --ros-args -r '~/output/command:=/ownship/cmd_vel'

    in    rlcas_runner/input/ownship           rlcas_msgs/AircraftState    for position and velocity
          rlcas_runner/output/trajectory       rlcas_msgs/Trajectory
          rlcas_monitor/output/status, backup  rlcas_msgs/AssuranceStatus, Trajectory
    out   ~/output/command                     geometry_msgs/Twist, every 0.1 s: linear.x speed
                                               along the track, m/s, linear.z climb, m/s,
                                               angular.z turn rate of the track, rad/s, positive
                                               to the left
          ~/output/command_stamped             geometry_msgs/TwistStamped, the same in base_link

Nothing is published while nothing is to be flown, nor while the ownship's state cannot be used or
is older than ownship_max_age, nor 1 s after the monitor's last status (monitor_silence), which the
log says: the autopilot must then hold course and speed. An example of the
least that an integration does, and no autopilot: an aircraft that rolls needs to look ahead
(envs.c208.guidance). Parameters:
"""

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.event_handler import SubscriptionEventCallbacks
from rlcas_msgs.msg import AircraftState, AssuranceStatus, Trajectory

from envs.follower import PERIOD, guidance
from envs.formats.local_frame import LocalFrame
from envs.profile import Height, Profile
from ros_bridge.core import updates
from ros_bridge.core.fields import SECOND, FieldError
from ros_bridge.core.motion import to_local
from ros_bridge.core.reports import Report
from ros_bridge.core.situation import Situation
from ros_bridge.core.tracks import Rules
from ros_bridge.sim.climbing import follow
from ros_bridge.sim.guidance import Flying, Guidance, curve
from ros_bridge.transport import process, qos, topics, views
from ros_bridge.transport.clock import ClockGuard
from ros_bridge.transport.messages import header
from ros_bridge.transport.settings import declare, freshness_of, limits_of


class _Line(NamedTuple):
    """What is flown of a trajectory."""

    unique: bytes  # the trajectory's id
    frame: LocalFrame
    flying: Flying  # in the frame
    profile: Profile | None  # of its altitude; None: level


class Pilot(ClockGuard):
    """The node; what is to be flown is :mod:`ros_bridge.sim.guidance`, how,
    :mod:`envs.follower`.
    """

    def __init__(self, **more: Any) -> None:
        super().__init__("rlcas_pilot", **more)
        aircraft = declare(self, "pilot")
        assert aircraft is not None
        self._vertical = aircraft.vertical
        silence = freshness_of(self._value).monitor
        self._guidance = Guidance(monitored=bool(self._value("monitor")), silence=silence)
        self._situation = Situation()
        self._line: _Line | None = None
        self._commands = self.create_publisher(Twist, "~/output/command", qos.EVENTS)
        stamped = "~/output/command_stamped"
        self._stamped = self.create_publisher(TwistStamped, stamped, qos.EVENTS)
        topics.OWNSHIP.subscribe(self, self._on_ownship)
        topics.PLAN.subscribe(self, self._guidance.add_plan)
        topics.STATUS.subscribe(self, self._on_status, event_callbacks=self._events())
        topics.BACKUP.subscribe(self, self._on_backup)
        self.create_timer(PERIOD, self._on_timer)

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value if self.has_parameter(name) else None

    def _events(self) -> SubscriptionEventCallbacks:
        """Return what is logged of the monitor's silence before it counts, by the wall's clock."""

        def late(_: Any) -> None:
            if not self._value("use_sim_time"):  # whose seconds are others
                self._warn("the monitor's status is late")

        def changed(event: Any) -> None:
            if event.alive_count == 0:
                self._warn("the monitor is gone")

        return SubscriptionEventCallbacks(deadline=late, liveliness=changed)

    def _warn(self, text: str) -> None:
        self.get_logger().warning(text, throttle_duration_sec=5.0)

    def _on_ownship(self, message: AircraftState) -> None:
        moment = self.get_clock().now().nanoseconds
        self._situation = updates.ownship(self._situation, message, moment, Rules())
        fault = self._situation.own.fault
        if fault is not None:
            self.get_logger().error(fault.message, throttle_duration_sec=5.0)

    def _on_status(self, message: AssuranceStatus) -> None:
        self._guidance.hear(message, self.get_clock().now().nanoseconds)

    def _on_backup(self, message: Trajectory) -> None:
        self._guidance.backup = message

    def _on_timer(self) -> None:
        moment, track = self.get_clock().now().nanoseconds, self._situation.own
        trajectory, own = self._guidance.select(moment), track.last
        unwatched = self._guidance.problem(moment)
        if unwatched and self._guidance.has_plan:
            text = f"{unwatched}: nothing is commanded"
            self.get_logger().error(text, throttle_duration_sec=1.0)
        if trajectory is None or own is None or track.fault is not None:
            return
        age, fresh = (moment - own.time) / SECOND, freshness_of(self._value)
        if not -fresh.future <= age <= fresh.own:
            self._warn(f"the ownship's state is {age:.1f} s old")
            return
        line = self._line_of(trajectory)
        if line is None:
            return
        command = self._command(line, own, moment)
        self._commands.publish(command)
        self._stamped.publish(TwistStamped(header=header(moment, views.BODY), twist=command))

    def _line_of(self, trajectory: Trajectory) -> _Line | None:
        """Return what is flown of a trajectory; None where it cannot be flown."""
        unique = bytes(trajectory.id.uuid)
        if self._line is None or self._line.unique != unique:
            frame = LocalFrame(trajectory.start.latitude, trajectory.start.longitude)
            try:
                flying = curve(frame, trajectory)
                self._line = _Line(unique, frame, flying, flying.profile(self._vertical))
            except FieldError as error:
                self.get_logger().error(f"cannot be flown: {error}", throttle_duration_sec=5.0)
                return None
        return self._line

    def _command(self, line: _Line, own: Report, moment: int) -> Twist:
        """Return speed along the track, m/s, and its turn rate, rad/s, for the next period."""
        flying = line.flying
        state = to_local(line.frame, own)
        reach = state.speed * ((moment - own.time) / SECOND)
        state = state._replace(
            x=state.x + reach * math.cos(state.heading), y=state.y + reach * math.sin(state.heading)
        )
        time = np.float64((moment - flying.began) / SECOND)
        acceleration, turn = guidance(flying.legs, state, time, wind=flying.wind)
        limits = limits_of(self._value)
        acceleration = _clip(float(acceleration), limits.acceleration_min, limits.acceleration_max)
        # The limits are those of the air speed.
        blows = 0.0 if flying.wind is None else float(flying.wind.speed)
        low, high = max(limits.speed_min - blows, 0.0), limits.speed_max + blows
        command = Twist()
        command.linear.z = self._climb(line, own, moment)
        command.linear.x = _clip(state.speed + acceleration * PERIOD, low, high)
        command.angular.z = _clip(float(turn), -limits.yaw_rate_max, limits.yaw_rate_max)
        return command

    def _climb(self, line: _Line, own: Report, moment: int) -> float:
        """Return the climb for the next period, m/s."""
        if line.profile is None or self._vertical is None:
            return 0.0
        planned, height = line.flying.altitude, own.altitude
        if height is None or planned is None or height.reference != planned.reference:
            self._warn("the ownship's altitude cannot be compared with the plan's: it flies level")
            return 0.0
        climb, age = height.climb(0.0)[0], (moment - own.time) / SECOND
        own_height = Height(height.value + climb * age, climb)
        time = (moment - line.flying.began) / SECOND
        return follow(own_height, line.profile, time, self._vertical, PERIOD).climb


def _clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


main = partial(process.main, Pilot, "pilot", __doc__)
