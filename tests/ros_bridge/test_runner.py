"""The runner as a process on a real graph: what it answers, publishes, latches, refuses and
withdraws.
"""

import json
import math
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.ros_bridge.graph import MISSING, NODE, PATIENCE, ROOT, Client, Process, World, domain
from tests.ros_bridge.scenes import FRAME

pytest.importorskip("rclpy", reason=MISSING)

from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.srv import ChangeState, GetState
from nav_msgs.msg import Path as PathMessage
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rlcas_msgs.msg import Advisory, Trajectory
from rlcas_msgs.srv import GenerateTrajectory
from rosgraph_msgs.msg import Clock
from unique_identifier_msgs.msg import UUID
from visualization_msgs.msg import MarkerArray

from agents.policy.inference import Policy
from envs.area_geometry import signed_distance
from envs.areas import Area, Circle
from ros_bridge.core.conversions import trajectory
from ros_bridge.core.fields import Code
from ros_bridge.transport import qos
from ros_bridge.transport.messages import areas_message, time_message
from ros_bridge.transport.topics import AREAS

SERVICE = f"{NODE}/generate_trajectory"


@pytest.fixture(scope="module")
def number() -> Iterator[int]:
    with domain() as number:
        yield number


@pytest.fixture(scope="module")
def runner(number: int) -> Iterator[Process]:
    # Ages are generous, so that a busy machine does not make anything stale.
    ages = (
        "ownship_max_age:=10.0",
        "intruder_max_age:=60.0",
        "request_max_age:=60.0",
        "forget_after:=600.0",
    )
    process = Process(
        "ros_bridge.runner", number, "--ros-args", *(part for age in ages for part in ("-p", age))
    )
    yield process
    process.stop()


@pytest.fixture(scope="module")
def client(number: int, runner: Process) -> Iterator[Client]:
    client = Client(number)
    yield client
    client.close()


@pytest.fixture(scope="module")
def only_world(client: Client) -> World:
    world = World(client)
    world.reference()
    world.route()
    return world


@pytest.fixture
def world(client: Client, only_world: World) -> World:
    """Return the world with the ownship at the origin and all others far away, whatever the test
    before left.
    """
    names = only_world.begin_anew()

    def apart() -> None:
        only_world.ownship()
        for name in names:
            only_world.intruder(-60_000.0, -60_000.0, -math.pi / 2.0, id=name)
        client.idle(0.05)

    for _ in range(2):  # a second report of another place confirms it
        apart()
    answer(client, Code.SAFE, apart)
    return only_world


def ask(client: Client, **more) -> GenerateTrajectory.Response:
    request = GenerateTrajectory.Request(
        **({"reason": GenerateTrajectory.Request.REASON_MANUAL} | more)
    )
    return client.call(GenerateTrajectory, SERVICE, request)


def answer(
    client: Client,
    code: Code,
    meanwhile: Callable[[], None] | None = None,
    field: str | None = None,
    **more,
) -> GenerateTrajectory.Response:
    """Ask until the answer is the wanted one, because topics and service may overtake each
    other.
    """
    end = time.monotonic() + PATIENCE
    while True:
        response = ask(client, **more)
        right = response.status == code and field in (None, response.field)
        if right or time.monotonic() > end:
            assert right, f"{Code(response.status).name} {response.field}: {response.message}"
            return response
        if meanwhile is not None:
            meanwhile()
        client.idle(0.05)


def test_missing_inputs_are_refused_one_by_one_until_a_plan():
    with domain() as number:
        process, client = Process("ros_bridge.runner", number), Client(number)
        try:
            world = World(client)
            refused = answer(client, Code.NO_GEO_REFERENCE)
            assert refused.message == "geo_reference has not been received"
            world.reference()
            answer(client, Code.NO_OWNSHIP)
            answer(client, Code.NO_ROUTE, world.ownship)
            world.route()
            response = answer(client, Code.SAFE, world.ownship)
        finally:
            client.close()
            process.stop()
    assert response.message == "" and response.field == ""
    assert Advisory.WIND_UNKNOWN in [advisory.code for advisory in response.advisories]
    assert "ownship.wind is unknown and taken as calm" in response.advisory
    assert len(response.trajectory.waypoints) == 20
    assert response.trajectory.intruder_ids == []


def encounter(world: World, name: str = "4b1a2c", **more) -> None:
    world.ownship(**more)
    world.intruder(8_000.0, -8_000.0, math.pi / 2.0, id=name)


def answer_encounter(client: Client, world: World, name: str) -> GenerateTrajectory.Response:
    """Ask until a plan counts the intruder, which no test before has reported elsewhere."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        encounter(world, name)
        response = answer(client, Code.SAFE, lambda: encounter(world, name))
        if name in response.trajectory.intruder_ids:
            return response
    raise AssertionError("no plan counts the intruder")


def test_safe_plan_is_published_and_latched(client: Client, world: World):
    response = answer_encounter(client, world, "shown1")
    plans = client.hear(Trajectory, f"{NODE}/output/trajectory", qos.LATCHED)
    paths = client.hear(PathMessage, f"{NODE}/output/path", qos.LATCHED)
    markers = client.hear(MarkerArray, f"{NODE}/output/markers", qos.LATCHED)
    # The views follow the answer, so the latched ones may still be those of the plan before, which
    # had no traffic.
    namespaces = {"plan", "waypoints", "indices", "traffic", "names"}
    client.spin(
        lambda: (
            plans
            and paths
            and markers
            and {marker.ns for marker in markers[-1].markers} >= namespaces
        )
    )
    assert plans[-1] == response.trajectory
    assert len(paths[-1].poses) == 21

    plan = trajectory(plans[-1])
    began, points = plan.began, plan.points
    assert [round((point.time - began) / 1e9, 6) for point in points[:19]] == [
        20.0 * (n + 1) for n in range(19)
    ]
    assert points[-1].time - began >= 380e9
    assert [point.of_route for point in points] == [False] * 19 + [True]
    assert len({point.index for point in points} | set(range(7, 17))) == 29


def test_trajectory_carries_the_certificate_that_proves_it(
    client: Client, world: World, tmp_path: Path
):
    plans = client.hear(Trajectory, f"{NODE}/output/trajectory", qos.LATCHED)
    response = answer_encounter(client, world, "proof1")
    client.spin(lambda: plans and plans[-1].id == response.trajectory.id)
    file = tmp_path / "plan.json"
    file.write_bytes(bytes(plans[-1].certificate))
    command = [sys.executable, "-m", "agents.check", file]
    process = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert process.returncode == 0 and "accepted" in process.stdout, process.stderr
    # It is the plan's own: the same places, in the frame about the geo-reference.
    points = trajectory(plans[-1]).points
    at = FRAME.place([point.latitude for point in points], [point.longitude for point in points])
    proven = np.array(json.loads(file.read_bytes())["waypoints"])
    np.testing.assert_allclose(proven[:, :2], np.stack([at.x, at.y], axis=-1), rtol=0.0, atol=1e-6)
    assert set_to(client, "certificate", False).successful
    assert len(answer(client, Code.SAFE, lambda: encounter(world)).trajectory.certificate) == 0
    assert set_to(client, "certificate", True).successful
    assert response.trajectory.min_separation >= 1000.0
    assert 0.0 < response.computation_time < 5.0


def test_areas_are_kept_clear_of_and_a_faulty_message_is_refused(client: Client, world: World):
    # Without areas the plan goes straight on; with one in its way, round it.
    ahead = Area(Circle(12_000.0, 100.0, 1_500.0), clearance=100.0, name="cell")
    message = areas_message([ahead], time.time_ns(), FRAME, "map")
    publisher = client.node.create_publisher(*AREAS)

    def meanwhile() -> None:
        encounter(world, valid=0xE5)  # in a wind that is known: calm
        publisher.publish(message)

    def away(response: GenerateTrajectory.Response) -> float:
        points = trajectory(response.trajectory).points
        at = FRAME.place(
            [waypoint.latitude for waypoint in points], [waypoint.longitude for waypoint in points]
        )
        return float(signed_distance(ahead, at.x, at.y).min())

    end = time.monotonic() + PATIENCE
    while away(answer(client, Code.SAFE, meanwhile)) < 99.0 and time.monotonic() < end:
        meanwhile()
    response = answer(client, Code.SAFE, meanwhile)
    assert away(response) >= 99.0
    assert len(json.loads(bytes(response.trajectory.certificate))["areas"]) == 1
    good = message.areas[0].radius
    message.areas[0].radius = math.nan
    publisher.publish(message)
    refused = answer(client, Code.INVALID_TASK, meanwhile)
    assert refused.field == "areas.areas[0].radius"
    message.areas[0].radius = good
    message.areas.clear()
    publisher.publish(message)
    answer(client, Code.SAFE, meanwhile)


def test_new_plan_has_a_greater_revision_and_replaces_the_current_one(client: Client, world: World):
    plans = client.hear(Trajectory, f"{NODE}/output/trajectory", qos.LATCHED)
    first = answer(client, Code.SAFE, lambda: encounter(world)).trajectory
    second = answer(client, Code.SAFE, lambda: encounter(world), previous_id=first.id).trajectory
    assert second.revision > first.revision
    assert bytes(second.id.uuid) != bytes(first.id.uuid)
    refused = answer(client, Code.SUPERSEDED, previous_id=first.id)
    assert refused.field == "request.previous_id"
    assert refused.trajectory.waypoints == []
    client.spin(lambda: plans and plans[-1].revision == second.revision)
    assert [plan.revision for plan in plans] == sorted({plan.revision for plan in plans})


@pytest.mark.slow
def test_unsafe_plan_is_answered_and_advised_but_not_published(client: Client, world: World):
    plans = client.hear(Trajectory, f"{NODE}/output/trajectory", qos.LATCHED)
    advice = client.hear(Trajectory, f"{NODE}/output/advisory", qos.EVENTS)

    # Nose to nose and too close for any manoeuvre.
    def close() -> None:
        world.ownship()
        world.intruder(1_500.0, 0.0, -math.pi, 100.0, id="close1")

    response = answer(client, Code.UNRESOLVED, close)
    assert response.message
    client.spin(lambda: advice)
    assert advice[-1].status == Trajectory.STATUS_UNRESOLVED
    client.idle(0.2)
    assert {plan.status for plan in plans} == {Trajectory.STATUS_SAFE}
    assert bytes(response.trajectory.id.uuid) not in {bytes(plan.id.uuid) for plan in plans}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "code", "field"),
    [
        ({"latitude": math.nan}, Code.INVALID_OWNSHIP, "ownship.latitude"),
        ({"valid": 0x04}, Code.INVALID_OWNSHIP, "ownship.valid"),
        ({"time": -1_000_000_000}, Code.INVALID_OWNSHIP, "ownship.header.stamp"),
        ({"ahead": 5.0}, Code.FUTURE_OWNSHIP, "ownship.header.stamp"),
        ({"speed": 20.0}, Code.INVALID_OWNSHIP, "own.speed"),
        ({"y": 20_000.0}, Code.INVALID_OWNSHIP, "ownship.position"),
    ],
)
def test_a_bad_ownship_is_refused_until_a_good_one_comes(
    client: Client, world: World, change, code, field
):
    def bad() -> None:
        fields = dict(change)
        if "ahead" in fields:
            fields["time"] = client.now() + round(fields.pop("ahead") * 1e9)
        world.ownship(**fields)

    bad()
    # A second report of another place would confirm it.
    answer(client, code, None if field == "ownship.position" else bad, field)
    answer(client, Code.SAFE, world.ownship)


def test_requests_are_checked(client: Client, world: World):
    assert answer(client, Code.INVALID_REQUEST, reason=0).field == "request.reason"
    assert (
        answer(client, Code.SUPERSEDED, previous_id=UUID(uuid=list(uuid.UUID(int=7).bytes))).field
        == "request.previous_id"
    )
    request = GenerateTrajectory.Request(reason=1)
    request.header.stamp.sec = 10
    assert client.call(GenerateTrajectory, SERVICE, request).status == Code.STALE_REQUEST
    request.header.stamp.sec = 2**31 - 1
    assert client.call(GenerateTrajectory, SERVICE, request).status == Code.FUTURE_REQUEST


def test_an_alert_about_an_unknown_aircraft_is_refused(client: Client, world: World):
    response = answer(client, Code.NO_INTRUDER, lambda: world.alert("beef01"))
    assert response.field == "intruder beef01"
    world.alert("beef01", "beef01")
    assert answer(client, Code.INVALID_ALERT).field == "alert.intruder_ids[1]"
    world.alert(level=0)
    answer(client, Code.SAFE, world.ownship)


def set_to(client: Client, name: str, value: float):
    kind = (
        ParameterType.PARAMETER_BOOL if isinstance(value, bool) else ParameterType.PARAMETER_DOUBLE
    )
    field = "bool_value" if isinstance(value, bool) else "double_value"
    parameter = Parameter(name=name, value=ParameterValue(type=kind, **{field: value}))
    [result] = client.call(
        SetParameters, f"{NODE}/set_parameters", SetParameters.Request(parameters=[parameter])
    ).results
    return result


@pytest.mark.slow
@pytest.mark.usefixtures("world")
def test_a_silent_ownship_is_stale(client: Client):
    assert set_to(client, "ownship_max_age", 0.3).successful
    client.idle(0.4)
    assert answer(client, Code.STALE_OWNSHIP).field == "ownship.header.stamp"
    assert set_to(client, "ownship_max_age", 10.0).successful


def test_traffic_whose_clock_is_behind_is_stale_and_not_forgotten(client: Client, world: World):
    def arrive() -> None:
        world.intruder(9_000.0, 0.0, math.pi, time=client.now() - 3_600_000_000_000, id="behind")

    response = answer(client, Code.STALE_INTRUDER, arrive)
    assert response.field == "intruder behind.header.stamp"


def test_an_aircraft_is_not_forgotten_while_it_counts(client: Client):
    refused = set_to(client, "forget_after", 30.0)
    assert not refused.successful
    assert "forget_after is 30 s, expected at least intruder_max_age, 60 s" in refused.reason


def test_contradicting_limits_of_the_aircraft_are_refused(client: Client):
    assert set_to(client, "speed_max", 70.0).successful
    refused = set_to(client, "speed_min", 80.0)
    assert (
        not refused.successful
        and "speed_min is 80 m/s, expected less than speed_max, 70 m/s" in refused.reason
    )
    assert set_to(client, "speed_max", 100.0).successful


def test_parameters_have_ranges(client: Client):
    assert set_to(client, "alert_max_age", 11.0).successful
    for value in (0.9, math.nan):
        result = set_to(client, "separation", value)
        assert not result.successful
        assert "separation" in result.reason


def test_diagnostics_name_policy_and_aircraft(client: Client):
    health = client.hear(DiagnosticArray, "/diagnostics", qos.EVENTS)
    client.spin(lambda: health)
    values = {pair.key: pair.value for pair in health[-1].status[0].values}
    assert values["policy sha256"] == Policy.load().sha256
    assert values["aircraft"].endswith("separation 1000 m, margin 210 m")


@pytest.mark.slow
def test_a_publisher_that_does_not_fit_is_reported(client: Client):
    health = client.hear(DiagnosticArray, "/diagnostics", qos.EVENTS)
    poor = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    quiet = PublisherEventCallbacks(incompatible_qos=lambda _: None)
    publisher = client.node.create_publisher(
        Trajectory, f"{NODE}/input/route", poor, event_callbacks=quiet
    )
    try:
        client.spin(lambda: health and health[-1].status[0].level == b"\x02")
        assert "~/input/route: a publisher offers less" in health[-1].status[0].message
    finally:
        client.node.destroy_publisher(publisher)


def test_deactivation_withdraws_the_plan(client: Client, world: World):
    plans = client.hear(Trajectory, f"{NODE}/output/trajectory", qos.LATCHED)
    published = answer(client, Code.SAFE, world.ownship).trajectory
    client.spin(lambda: plans and plans[-1].revision == published.revision)
    change = ChangeState.Request()
    change.transition.id = 4
    assert client.call(ChangeState, f"{NODE}/change_state", change, once=True).success
    client.spin(lambda: plans[-1].revision > published.revision)
    assert plans[-1].status == Trajectory.STATUS_WITHDRAWN
    assert plans[-1].waypoints == []
    answer(client, Code.NOT_ACTIVE)
    change.transition.id = 3
    assert client.call(ChangeState, f"{NODE}/change_state", change, once=True).success
    assert (
        client.call(GetState, f"{NODE}/get_state", GetState.Request()).current_state.label
        == "active"
    )
    answer(client, Code.SAFE, world.ownship)


@pytest.mark.slow
def test_traffic_outside_the_domain_shows_in_answer_and_diagnostics(client: Client, world: World):
    health = client.hear(DiagnosticArray, "/diagnostics", qos.EVENTS)
    began = client.now()

    def fast() -> None:
        world.ownship()
        world.intruder(
            30_000.0 + 140.0 * (client.now() - began) / 1e9, 30_000.0, 0.0, 140.0, id="fa57aa"
        )

    while (
        "outside_domain: intruder_speed is 140 m/s" not in answer(client, Code.SAFE, fast).advisory
    ):
        fast()
        client.idle(0.1)
    heard = len(health)
    client.spin(lambda: len(health) > heard)
    values = {pair.key: pair.value for pair in health[-1].status[0].values}
    assert "intruder_speed is 140 m/s" in values["outside domain"]


@pytest.mark.slow
@pytest.mark.parametrize("signal_number", [signal.SIGINT, signal.SIGTERM])
def test_the_process_ends_in_order(signal_number: signal.Signals):
    with domain() as number:
        process, client = Process("ros_bridge.runner", number), Client(number)
        try:
            assert client.call(GetState, f"{NODE}/get_state", GetState.Request())
        finally:
            client.close()
        code, output = process.stop(signal_number)
    assert code == 0, output
    assert "Traceback" not in output


@pytest.mark.slow
def test_simulated_time_that_is_zero_or_steps_back_voids_everything():
    with domain() as number:
        process = Process("ros_bridge.runner", number, "--ros-args", "-p", "use_sim_time:=true")
        client = Client(number)
        try:
            world = World(client)
            plans = client.hear(Trajectory, f"{NODE}/output/trajectory", qos.LATCHED)
            assert ask(client).status == Code.NO_CLOCK
            world.reference()
            world.route()

            def clock(seconds: int) -> None:
                client.say(Clock, "/clock", Clock(clock=time_message(seconds * 10**9)), 10)

            answer(client, Code.NO_OWNSHIP, lambda: clock(100))
            published = answer(
                client, Code.SAFE, lambda: world.ownship(time=100 * 10**9)
            ).trajectory
            assert published.header.stamp.sec == 100
            answer(client, Code.NO_OWNSHIP, lambda: clock(50))
            client.spin(lambda: plans and plans[-1].status == Trajectory.STATUS_WITHDRAWN)
            assert plans[-1].revision > published.revision

            # What is heard first after the clock has stepped back is judged by the new time alone.
            answer(client, Code.SAFE, lambda: world.ownship(time=50 * 10**9))
            clock(20)
            client.idle(0.3)
            world.ownship(time=20 * 10**9)
            client.idle(0.3)
            assert ask(client).status == Code.SAFE

            # What was sent before, from somewhere else, and comes late is no report of the new
            # time.
            clock(10)
            client.idle(0.3)
            world.ownship(x=20_000.0, time=20 * 10**9)
            world.ownship(time=10 * 10**9)
            client.idle(0.3)
            assert ask(client).status == Code.SAFE
        finally:
            client.close()
            process.stop()
