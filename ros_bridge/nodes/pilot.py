# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""The pilot: flies what the monitor selects, as speed and yaw rate for an autopilot or a simulator
that takes these.

    python -m ros_bridge.pilot --ros-args -r '~/output/command:=/ownship/cmd_vel'

    in    rlcas_runner/input/ownship           rlcas_msgs/AircraftState    for position and velocity
          rlcas_runner/output/trajectory       rlcas_msgs/Trajectory
          rlcas_monitor/output/status, backup  rlcas_msgs/AssuranceStatus, Trajectory
    out   ~/output/command                     geometry_msgs/Twist, every 0.1 s: linear.x speed
                                               along the track, m/s, angular.z turn rate of the
                                               track, rad/s, positive to the left

Nothing is published while nothing is to be flown, nor while the ownship's state cannot be used or
is older than ownship_max_age: the autopilot must then hold course and speed. An example of the
least that an integration does, and no autopilot: an aircraft that rolls needs to look ahead
(envs.c208.guidance). Parameters:
"""

import math
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import Twist
from rclpy.node import Node
from rlcas_msgs.msg import AircraftState

from envs.follower import PERIOD, guidance
from envs.formats.local_frame import LocalFrame
from ros_bridge.core import updates
from ros_bridge.core.fields import SECOND, FieldError, nanoseconds
from ros_bridge.core.situation import Situation, to_local
from ros_bridge.core.tracks import Rules
from ros_bridge.sim.guidance import Flying, Guidance, curve
from ros_bridge.transport import process, qos, topics
from ros_bridge.transport.settings import declare, limits_of

_SILENCE = 0.5  # s of the monitor, after which an error is logged


class Pilot(Node):
    """The node; what is to be flown is :mod:`ros_bridge.sim.guidance`, how,
    :mod:`envs.follower`.
    """

    def __init__(self, **more: Any) -> None:
        super().__init__("rlcas_pilot", **more)
        declare(self, "pilot")
        self._guidance = Guidance(monitored=bool(self.get_parameter("monitor").value))
        self._situation = Situation()
        self._line: tuple[bytes, LocalFrame, Flying] | None = None
        self._commands = self.create_publisher(Twist, "~/output/command", qos.EVENTS)
        topics.OWNSHIP.heard(self, self._on_ownship)
        topics.PLAN.heard(self, self._guidance.add_plan)
        topics.STATUS.heard(self, partial(setattr, self._guidance, "status"))
        topics.BACKUP.heard(self, partial(setattr, self._guidance, "backup"))
        self.create_timer(PERIOD, self._on_timer)

    def _on_ownship(self, message: AircraftState) -> None:
        now = self.get_clock().now().nanoseconds
        self._situation = updates.ownship(self._situation, message, now, Rules())
        fault = self._situation.own.fault
        if fault is not None:
            self.get_logger().error(fault.message, throttle_duration_sec=5.0)

    def _on_timer(self) -> None:
        wanted, track = self._guidance.select(), self._situation.own
        own = track.last
        if wanted is None or own is None or track.fault is not None:
            return
        now = self.get_clock().now().nanoseconds
        age = (now - own.time) / SECOND
        if not -0.5 <= age <= self.get_parameter("ownship_max_age").value:
            self.get_logger().warning(
                f"the ownship's state is {age:.1f} s old", throttle_duration_sec=5.0
            )
            return
        name = bytes(wanted.id.uuid)
        if self._line is None or self._line[0] != name:
            frame = LocalFrame(wanted.start.latitude, wanted.start.longitude)
            try:
                self._line = name, frame, curve(frame, wanted)
            except FieldError as error:
                self.get_logger().error(f"cannot be flown: {error}", throttle_duration_sec=5.0)
                return
        status = self._guidance.status
        silent = 0.0 if status is None else (now - nanoseconds(status.header.stamp)) / SECOND
        if silent > _SILENCE:
            # Its last selection is still the best that is known, but no monitor checks it any more.
            self.get_logger().error(
                f"the monitor has been silent for {silent:.1f} s", throttle_duration_sec=1.0
            )
        _, frame, line = self._line
        state = to_local(frame, own)
        reach = state.speed * age
        state = state._replace(
            x=state.x + reach * math.cos(state.heading), y=state.y + reach * math.sin(state.heading)
        )
        time = np.float64((now - line.began) / SECOND)
        acceleration, turn = guidance(line.legs, state, time, wind=line.wind)
        limits = limits_of(lambda name: self.get_parameter(name).value)
        acceleration = min(
            max(float(acceleration), limits.acceleration_min), limits.acceleration_max
        )
        turn = min(max(float(turn), -limits.yaw_rate_max), limits.yaw_rate_max)
        # The limits are those of the air speed.
        blows = 0.0 if line.wind is None else float(line.wind.speed)
        low, high = max(limits.speed_min - blows, 0.0), limits.speed_max + blows
        speed = min(max(state.speed + acceleration * PERIOD, low), high)
        command = Twist()
        command.linear.x, command.angular.z = speed, turn
        self._commands.publish(command)


main = partial(process.main, Pilot, "pilot", __doc__)
