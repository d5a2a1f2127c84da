"""A long search, and traffic with faults: the runner answers meanwhile, refuses, and never calls
such a plan SAFE.
"""

import math
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tests.ros_bridge.graph import (
    MISSING,
    NODE,
    PATIENCE,
    Client,
    Process,
    World,
    domain,
    eventually,
    running_beside,
)

pytest.importorskip("rclpy", reason=MISSING)

from rclpy.parameter import Parameter
from rlcas_msgs.srv import GenerateTrajectory
from std_srvs.srv import Trigger

from ros_bridge.core import planning as planner
from ros_bridge.core.fields import Code
from ros_bridge.nodes import runner as planning

Request = GenerateTrajectory.Request


class Scene:
    """A runner whose long searches last until they are let go, and an aircraft too near to be
    avoided.
    """

    def __init__(self, node: planning.Runner, client, patch: pytest.MonkeyPatch) -> None:
        self.node, self.client, self.world = node, client, World(client)
        self.begun, self.go_on = threading.Event(), threading.Event()
        really = planning.plan_task

        def plan_when_told(requested, policy, *, exhaustive):
            if exhaustive:
                self.begun.set()
                assert self.go_on.wait(20.0)
            return really(requested, policy, exhaustive=False)

        patch.setattr(planning, "plan_task", plan_when_told)
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
        future = self.ask(Request.REASON_ALERT)
        self.client.spin(self.begun.is_set)
        return future


@pytest.fixture
def scene(monkeypatch: pytest.MonkeyPatch) -> Iterator[Scene]:
    ages = {"ownship_max_age": 10.0, "intruder_max_age": 60.0, "request_max_age": 60.0}
    with running_beside(planning.Runner, **ages) as (node, client):
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


def test_a_long_search_can_be_cancelled(scene: Scene):
    cancel = scene.client.node.create_client(Trigger, f"{NODE}/cancel_search")
    scene.client.spin(cancel.service_is_ready)
    idle = eventually(scene.client, cancel.call_async(Trigger.Request()))
    assert (idle.success, idle.message) == (False, "no long search is going on")
    long = scene.searching()
    assert eventually(scene.client, cancel.call_async(Trigger.Request())).success
    answer = eventually(scene.client, long)
    assert answer.status == Code.CANCELLED
    assert answer.message == "request was cancelled while a plan was sought"
    # Its thread may go on; the next search waits for it.
    scene.go_on.set()
    assert eventually(scene.client, scene.ask(Request.REASON_ALERT)).status == Code.UNRESOLVED


def test_every_request_is_answered_however_many_come_at_once(scene: Scene):
    waiting = [scene.ask(Request.REASON_REPLAN) for _ in range(60)]
    answers = [eventually(scene.client, future) for future in waiting]
    # The last may find the ownship too old on a busy machine; they are told so.
    assert {answer.status for answer in answers} <= {Code.UNRESOLVED, Code.STALE_OWNSHIP}


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
    really = planner.plan
    monkeypatch.setattr(
        planner, "plan", lambda *arguments, **more: planned.append(really(*arguments, **more))
    )
    with running_beside(planning.Runner) as (node, client):
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


# Faults of real traffic over real DDS: a runner that must refuse, or leave out, and never call such
# a plan SAFE.

SERVICE = f"{NODE}/generate_trajectory"
_EVERY = 0.2  # s between reports


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    ages = ("intruder_max_age:=1.0", "request_max_age:=60.0", "forget_after:=5.0")
    with domain() as number:
        process = Process(
            "ros_bridge.runner",
            number,
            "--ros-args",
            *(part for age in ages for part in ("-p", age)),
        )
        client = Client(number)
        try:
            world = World(client)
            world.reference()
            world.route()
            yield world
        finally:
            client.close()
            process.stop()


def report_for(world: World, seconds: float, reported: Callable[[int], None]) -> None:
    """Report for some seconds; ``reported`` is called with the number of the report."""
    for number in range(round(seconds / _EVERY)):
        reported(number)
        world.client.idle(_EVERY)


def ask_for_plan(world: World) -> GenerateTrajectory.Response:
    return world.client.call(GenerateTrajectory, SERVICE, GenerateTrajectory.Request(reason=3))


def becomes(
    world: World, code: Code, reported: Callable[[int], None]
) -> GenerateTrajectory.Response:
    """Report and ask until the answer is the wanted one."""
    for number in range(round(PATIENCE / _EVERY)):
        reported(number)
        world.client.idle(_EVERY)
        response = ask_for_plan(world)
        if response.status == code:
            return response
    raise AssertionError(f"{Code(response.status).name} {response.message}, expected {code.name}")


@pytest.mark.slow
def test_echo_of_the_ownship_before_its_first_state_is_no_intruder(world: World):
    for _ in range(3):
        world.intruder(0.0, 0.0, 0.0, 75.0, id="4B1A2C  ")
        world.client.idle(0.1)
    response = becomes(world, Code.SAFE, lambda _: world.ownship(id="4b1a2c"))
    assert list(response.trajectory.intruder_ids) == []

    def report_both(_: int) -> None:
        world.ownship(id="4b1a2c")
        world.intruder(0.0, 0.0, 0.0, 75.0, id="4B1A2C")

    report_for(world, 1.0, report_both)
    assert ask_for_plan(world).status == Code.SAFE


@pytest.mark.slow
def test_far_aircraft_without_velocity_or_reports_is_excluded_by_name(world: World):
    def far(number: int) -> None:  # in a wind that is known: calm
        world.ownship(id="4b1a2c", valid=0xE5)
        world.intruder(320_000.0, 0.0, math.pi, 75.0, id="novelo", valid=0x01)
        if number == 0:
            world.intruder(0.0, 330_000.0, math.pi, 75.0, id="silent")

    report_for(world, 1.6, far)
    response = becomes(world, Code.SAFE, lambda _: far(1))
    assert list(response.trajectory.intruder_ids) == []
    left_out = dict(zip(response.excluded_ids, response.excluded_reasons, strict=True))
    assert set(left_out) == {"novelo", "silent"} and all(
        "km away" in why for why in left_out.values()
    )

    def near(_: int) -> None:
        world.ownship(id="4b1a2c", valid=0xE5)
        world.intruder(9_000.0, 0.0, math.pi, id="novelo", valid=0x01)

    assert becomes(world, Code.INVALID_INTRUDER, near).field == "intruder novelo.valid"


@pytest.mark.slow
def test_frozen_ownship_is_refused_until_it_moves(world: World):
    becomes(world, Code.SAFE, lambda _: world.ownship(id="4b1a2c"))

    def frozen(number: int) -> None:
        world.ownship(x=0.3 * (number % 2), y=500.0, id="4b1a2c")

    report_for(world, 4.0, frozen)
    for number in range(5):
        frozen(number)
        world.client.idle(_EVERY)
        response = ask_for_plan(world)
        assert (response.status, response.field) == (Code.INVALID_OWNSHIP, "ownship.position")
    becomes(world, Code.SAFE, lambda _: world.ownship(y=500.0, id="4b1a2c"))


@pytest.mark.slow
def test_two_aircraft_under_one_id_are_told_apart(world: World):
    becomes(world, Code.SAFE, lambda _: world.ownship(id="4b1a2c"))
    began = world.client.now()

    def report_both(number: int) -> None:
        world.ownship(id="4b1a2c", valid=0xE5)
        for x, y in ((60_000.0, 0.0), (8_000.0, 8_000.0)):
            flown = 75.0 * (world.client.now() - began) / 1e9
            world.intruder(x - flown, y, math.pi, 75.0, id="shared")

    report_both(0)
    # One report of each is a jump, more of either show two aircraft.
    assert becomes(world, Code.INVALID_INTRUDER, lambda _: None).field == "intruder shared.position"
    response = becomes(world, Code.SAFE, report_both)
    identifiers = {*response.trajectory.intruder_ids, *response.excluded_ids}
    assert identifiers == {"shared", "shared#2"}
    assert "several aircraft" in response.advisory
