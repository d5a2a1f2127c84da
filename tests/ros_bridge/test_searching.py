"""A long search: the runner hears and answers meanwhile, and what comes of it is judged by the present."""

import math
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from tests.ros_bridge.graph import MISSING, NODE, World
from tests.ros_bridge.inside import beside, eventually

pytest.importorskip("rclpy", reason=MISSING)

from rclpy.parameter import Parameter
from rlcas_msgs.srv import GenerateTrajectory

from ros_bridge.core.situation import Code
from ros_bridge.nodes import runner as planning

Request = GenerateTrajectory.Request


class Scene:
    """A runner whose long searches last until they are let go, and an aircraft too near to be avoided."""

    def __init__(self, node: planning.Runner, client, patch: pytest.MonkeyPatch) -> None:
        self.node, self.client, self.world = node, client, World(client)
        self.begun, self.go_on = threading.Event(), threading.Event()
        really = planning.planned

        def planned(wanted, policy, *, exhaustive):
            if exhaustive:
                self.begun.set()
                assert self.go_on.wait(20.0)
            return really(wanted, policy, exhaustive=False)

        patch.setattr(planning, "planned", planned)
        node.trigger_configure()
        node.trigger_activate()
        self.world.reference()
        self.world.route()
        self.near()
        self.service = client.node.create_client(GenerateTrajectory, f"{NODE}/generate_trajectory")
        client.spin(self.service.service_is_ready)

    def near(self) -> None:
        self.world.ownship()
        self.world.intruder(1_200.0, 0.0, math.pi)
        self.client.idle(0.1)

    def away(self) -> None:
        """The aircraft that was near is somewhere else; a second report confirms it."""
        for _ in range(2):
            self.world.ownship()
            self.world.intruder(0.0, 60_000.0, 0.5 * math.pi)
            self.client.idle(0.1)

    def ask(self, reason: int):
        return self.service.call_async(Request(reason=reason))

    def searching(self):
        """Ask so that a long search begins, and return its answer to come."""
        asked = self.ask(Request.REASON_ALERT)
        self.client.spin(self.begun.is_set)
        return asked


@pytest.fixture
def scene(monkeypatch: pytest.MonkeyPatch) -> Iterator[Scene]:
    ages = {"ownship_max_age": 10.0, "intruder_max_age": 60.0, "request_max_age": 60.0}
    with beside(planning.Runner, **ages) as (node, client):
        scene = Scene(node, client, monkeypatch)
        try:
            yield scene
        finally:
            scene.go_on.set()


def test_messages_and_requests_are_handled_during_a_long_search(scene: Scene):
    long = scene.searching()
    for reason in (Request.REASON_REPLAN, Request.REASON_MANUAL):
        short = eventually(scene.client, scene.ask(reason))
        assert short.status == Code.UNRESOLVED
    assert not long.done()
    scene.go_on.set()
    assert eventually(scene.client, long).status == Code.UNRESOLVED


def test_search_overtaken_by_another_plan_is_superseded(scene: Scene):
    long = scene.searching()
    scene.away()
    assert eventually(scene.client, scene.ask(Request.REASON_REPLAN)).status == Code.SAFE
    scene.go_on.set()
    answer = eventually(scene.client, long)
    assert answer.status == Code.SUPERSEDED
    assert answer.message == "plan was overtaken by another while it was sought"


def test_a_search_does_not_outlive_the_activation(scene: Scene):
    long = scene.searching()
    scene.node.trigger_deactivate()
    scene.node.trigger_cleanup()
    scene.go_on.set()
    assert eventually(scene.client, long).status == Code.NOT_ACTIVE
    # The answer was owed, so nothing was torn down under it.
    assert scene.node.trigger_cleanup().name == "SUCCESS"


def test_failed_search_is_no_plan_however_old_the_ownship(scene: Scene):
    long = scene.searching()
    scene.node.set_parameters([Parameter("ownship_max_age", value=0.05)])
    scene.client.idle(0.2)
    scene.go_on.set()
    assert eventually(scene.client, long).status == Code.UNRESOLVED


def test_node_plans_once_before_its_first_request(monkeypatch: pytest.MonkeyPatch):
    """Else the first request would wait for what is made at the first plan."""
    planned: list[Any] = []
    really = planning.plan
    monkeypatch.setattr(planning, "plan", lambda *given, **more: planned.append(really(*given, **more)))
    with beside(planning.Runner) as (node, client):
        node.trigger_configure()
        assert planned == []
        node.trigger_activate()
        client.spin(lambda: planned)
        client.idle(0.2)
        assert len(planned) == 1
        # And again for the policy of another configuration.
        node.trigger_deactivate()
        node.trigger_cleanup()
        node.trigger_configure()
        client.spin(lambda: len(planned) == 2)
