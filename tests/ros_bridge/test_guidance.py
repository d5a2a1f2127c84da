"""What is flown: plans called SAFE that the monitor names, its backup, and nothing else."""

import math
import uuid
from types import SimpleNamespace

import pytest

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from ros_bridge.sim.guidance import Guidance
from tests.ros_bridge.graph import MISSING, NODE, World
from tests.ros_bridge.inside import beside

pytest.importorskip("rclpy", reason=MISSING)

from geometry_msgs.msg import Twist
from rlcas_msgs.msg import AssuranceStatus, Trajectory, Waypoint

from envs.waypoints import Waypoint as LocalWaypoint
from ros_bridge.core.replies import backup_points, start_point
from ros_bridge.nodes.pilot import Pilot
from ros_bridge.transport import qos
from ros_bridge.transport.messages import header, identity, point_message
from tests.ros_bridge.scenes import FRAME


def test_the_codes_are_those_of_the_messages():
    from ros_bridge.sim import guidance

    assert guidance.STATUS_WITHDRAWN == Trajectory.STATUS_WITHDRAWN
    assert (guidance.FLY_PLAN, guidance.FLY_BACKUP) == (AssuranceStatus.FLY_PLAN, AssuranceStatus.FLY_BACKUP)


def message(number: int, status: int = Trajectory.STATUS_SAFE) -> SimpleNamespace:
    return SimpleNamespace(id=identity(uuid.UUID(int=number)), status=status)


def word(fly: int, number: int = 0) -> SimpleNamespace:
    return SimpleNamespace(fly=fly, trajectory_id=identity(uuid.UUID(int=number)))


def test_the_monitor_decides_which_plan_is_flown():
    guidance, first, second, backup = Guidance(), message(1), message(2), message(9, Trajectory.STATUS_BACKUP)
    assert guidance.add_plan(first) and guidance.selected() is None
    guidance.set_status(word(AssuranceStatus.FLY_PLAN, 1))
    assert guidance.selected() is first
    # A newer plan is flown when the monitor has taken it up, and one that has not come yet is none.
    assert guidance.add_plan(second) and guidance.selected() is first
    guidance.set_status(word(AssuranceStatus.FLY_PLAN, 2))
    assert guidance.selected() is second
    guidance.set_status(word(AssuranceStatus.FLY_PLAN, 3))
    assert guidance.selected() is None
    guidance.set_status(word(AssuranceStatus.FLY_BACKUP))
    assert guidance.selected() is None
    guidance.set_backup(backup)
    assert guidance.selected() is backup
    guidance.set_status(word(AssuranceStatus.FLY_NOTHING))
    assert guidance.selected() is None


def test_unsafe_and_withdrawn_plans_are_not_flown():
    guidance = Guidance(monitored=False)
    assert not guidance.add_plan(message(1, Trajectory.STATUS_UNRESOLVED)) and guidance.selected() is None
    safe = message(2)
    assert guidance.add_plan(safe) and guidance.selected() is safe
    assert not guidance.add_plan(message(3, Trajectory.STATUS_WITHDRAWN)) and guidance.selected() is None


def test_pilot_turns_to_the_plan_and_stops_without_an_ownship():
    with beside(Pilot, ownship_max_age=0.5) as (_, client):
        world = World(client)
        now = client.now()
        # Straight east at 75 m/s, 20 s a leg; the ownship is 30 m to its right.
        points = [LocalWaypoint(n, 1_500.0 * n, 0.0, 0.0, 75.0, 20.0 * n) for n in range(1, 21)]
        start = start_point(FRAME, SimpleNamespace(x=0.0, y=0.0, heading=0.0, speed=75.0), now, None)
        every: list[Waypoint] = [point_message(point) for point in backup_points(FRAME, points, now, None)]
        name = identity(uuid.uuid4())
        plan = Trajectory(header=header(now, "map"), id=name, status=1, start=point_message(start), waypoints=every)
        client.say(Trajectory, f"{NODE}/output/trajectory", plan, qos.LATCHED)
        status = AssuranceStatus(fly=AssuranceStatus.FLY_PLAN, trajectory_id=name)
        client.say(AssuranceStatus, "/rlcas_monitor/output/status", status, qos.LATCHED)
        commands: list[Twist] = client.hear(Twist, "/rlcas_pilot/output/command", qos.EVENTS)
        client.idle(0.3)
        assert commands == []

        def turning() -> bool:
            east = 75.0 * (client.now() - now) / 1e9
            world.ownship(east, -30.0)
            return bool(commands)

        client.spin(turning)
        command = commands[-1]
        # Lateral acceleration of 0.25 / s^2 a metre, as a turn rate at 75 m/s, cut off at the limit of 5 degrees/s.
        assert command.angular.z == pytest.approx(min(0.25 * 30.0 / 75.0, math.radians(5.0)), rel=0.05)
        assert command.linear.x == pytest.approx(75.0, abs=0.5)
        client.idle(0.7)
        before = len(commands)
        client.idle(0.3)
        assert len(commands) == before
