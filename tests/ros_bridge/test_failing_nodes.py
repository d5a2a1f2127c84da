"""Nodes whose own parts fail: what shows ends nothing, what protects says that it does not."""

import math
import uuid
from collections.abc import Callable, Iterator
from itertools import cycle, repeat
from typing import Any

import pytest

from tests.ros_bridge.graph import MISSING, NODE, Client, World, eventually, running_beside

pytest.importorskip("rclpy", reason=MISSING)

from diagnostic_msgs.msg import DiagnosticArray
from rlcas_msgs.msg import AssuranceStatus, GuidanceBands, Trajectory
from rlcas_msgs.srv import GenerateTrajectory

from envs.kinematics import VehicleState
from envs.waypoints import Waypoint
from ros_bridge.core import message_fields, updates
from ros_bridge.core.conversions import Published
from ros_bridge.core.fields import SECOND, Code, nanoseconds
from ros_bridge.core.freshness import USUAL_FRESHNESS
from ros_bridge.core.replies import geodetic_points, start_point
from ros_bridge.nodes import monitor
from ros_bridge.nodes.monitor import Monitor
from ros_bridge.nodes.runner import Runner
from ros_bridge.transport import qos
from ros_bridge.transport.messages import filled, header
from tests.ros_bridge.scenes import FRAME

MONITOR = "/rlcas_monitor"


def fail(*_: Any, **__: Any) -> Any:
    raise ValueError("operands could not be broadcast together")


class Scene:
    """A node beside its world: an ownship that flies east at 75 m/s, and what the node says."""

    def __init__(self, node: Any, client: Client) -> None:
        node.trigger_configure()
        node.trigger_activate()
        self.client, self.world = client, World(client)
        self.said = client.hear(AssuranceStatus, f"{MONITOR}/output/status", qos.STATUS)
        self.shown = client.hear(GuidanceBands, f"{MONITOR}/output/guidance", qos.LATCHED)
        self._health = client.hear(DiagnosticArray, "/diagnostics", qos.EVENTS)
        self.world.reference()

    def until(self, holds: Callable[[], Any]) -> Any:
        """Fly until something holds."""

        def fly() -> Any:
            self.world.ownship()
            self.client.idle(0.05)
            return holds()

        return self.client.spin(fly)

    def health(self) -> tuple[int, str]:
        """Return level and text of the newest diagnostics."""
        if not self._health:
            return -1, ""
        newest = self._health[-1].status[0]
        return newest.level[0], newest.message

    def is_told(self, text: str) -> bool:
        """Return whether the diagnostics tell an error with a text."""
        level, message = self.health()
        return level == 2 and text in message

    def plan(self) -> None:
        """Publish a plan straight on, as a runner does."""
        now = self.client.now()
        points = [Waypoint(n, 1_500.0 * n, 0.0, 0.0, 75.0, 20.0 * n) for n in range(1, 21)]
        own = VehicleState(0.0, 0.0, 0.0, 75.0)
        plan = Published(
            uuid.uuid4().bytes,
            1,
            now,
            start_point(FRAME, own, now, None),
            geodetic_points(FRAME, points, now, None),
            (),
        )
        message = filled(Trajectory, message_fields.plan(plan), "map")
        self.world.begin_anew()
        self.world.ownship(time=now)  # where the plan begins, however long this process waits
        self.client.say(Trajectory, f"{NODE}/output/trajectory", message, qos.LATCHED)


@pytest.fixture
def watched() -> Iterator[Scene]:
    with running_beside(Monitor, diagnostics_period=0.2, ownship_max_age=10.0) as (node, client):
        yield Scene(node, client)


@pytest.fixture
def planning_scene() -> Iterator[Scene]:
    with running_beside(Runner, diagnostics_period=0.2, ownship_max_age=10.0) as (node, client):
        yield Scene(node, client)


def test_bands_that_fail_never_end_the_monitor(watched: Scene, monkeypatch: pytest.MonkeyPatch):
    with monkeypatch.context() as broken:
        broken.setattr(monitor, "guidance", fail)
        watched.until(lambda: watched.is_told("bands and alerts failed: ValueError: operands"))
        watched.plan()
        # The judgement goes on, and is not touched by it.
        watched.until(lambda: watched.said[-1].state == AssuranceStatus.STATE_MONITORING)
        assert not watched.shown
    watched.until(lambda: watched.shown)


def test_a_judgement_that_fails_is_denied_and_then_nothing_is_to_be_flown(
    watched: Scene, monkeypatch: pytest.MonkeyPatch
):
    step_monitor, judged = monitor.step_monitor, list[int]()
    failures = repeat(False)  # of the judgements to come: whether each fails

    def step(supervision: Any, situation: Any, moment: int) -> Any:
        if next(failures):
            fail()
        judged.append(moment)
        return step_monitor(supervision, situation, moment)

    with monkeypatch.context() as broken:
        broken.setattr(monitor, "step_monitor", step)
        watched.until(lambda: watched.said)
        watched.plan()
        watched.until(lambda: watched.said[-1].fly == AssuranceStatus.FLY_PLAN)
        before = len(watched.said)
        # A failure is told for seconds: where every second judgement fails, all are denied.
        failures = cycle([True, False])
        watched.until(lambda: watched.said[-1].state == AssuranceStatus.STATE_DENIED)
        watched.until(lambda: watched.said[-1].fly == AssuranceStatus.FLY_PLAN)
        assert watched.said[-1].state == AssuranceStatus.STATE_DENIED
        failures = repeat(True)
        watched.until(lambda: watched.said[-1].fly == AssuranceStatus.FLY_NOTHING)
        denied = [
            status
            for status in watched.said[before:]
            if status.state == AssuranceStatus.STATE_DENIED
        ]
        assert watched.said[-1] in denied
        for status in denied:
            assert "the judgement failed: ValueError" in status.reasons[-1]
            assert not status.measured
            moment = nanoseconds(status.header.stamp)
            silence = (moment - max(time for time in judged if time <= moment)) / SECOND
            late = silence > USUAL_FRESHNESS.monitor
            assert status.fly == (AssuranceStatus.FLY_NOTHING if late else AssuranceStatus.FLY_PLAN)
        watched.until(lambda: watched.is_told("the judgement failed: ValueError: operands"))


def test_what_cannot_be_taken_in_makes_nothing_safe(
    planning_scene: Scene, monkeypatch: pytest.MonkeyPatch
):
    planning_scene.world.route()
    service = planning_scene.client.node.create_client(
        GenerateTrajectory, f"{NODE}/generate_trajectory"
    )
    planning_scene.client.spin(service.service_is_ready)

    def answer() -> GenerateTrajectory.Response:
        planning_scene.world.ownship()
        request = GenerateTrajectory.Request(reason=GenerateTrajectory.Request.REASON_MANUAL)
        return eventually(planning_scene.client, service.call_async(request))

    planning_scene.until(lambda: answer().status == Code.SAFE)
    with monkeypatch.context() as broken:
        broken.setattr(updates, "follow", fail)
        planning_scene.world.intruder(40_000.0, 40_000.0, math.pi)
        planning_scene.until(lambda: answer().status == Code.INTERNAL_ERROR)
        planning_scene.until(
            lambda: planning_scene.is_told("input/traffic failed: ValueError: operands")
        )


@pytest.mark.slow
def test_the_runner_tells_that_the_monitor_is_silent(planning_scene: Scene):
    planning_scene.until(lambda: planning_scene.health()[0] >= 0)
    assert "monitor" not in planning_scene.health()[1]  # there need not be one
    status = AssuranceStatus(header=header(planning_scene.client.now(), "map"))
    planning_scene.client.say(AssuranceStatus, f"{MONITOR}/output/status", status, qos.STATUS)
    planning_scene.until(lambda: planning_scene.is_told("the monitor has been silent for"))
