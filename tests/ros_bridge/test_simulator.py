"""The simulator as a node: what it publishes and flies, and the whole loop of runner, monitor and
simulator.
"""

import importlib.util
import math
import os
import re
import resource
import subprocess
import sys
import time
import uuid
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.ros_bridge.graph import MISSING, ROOT, Process, domain, running_beside
from tests.ros_bridge.scenes import FRAME, NOW, SECOND, stamp

pytest.importorskip("rclpy", reason=MISSING)
pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from geometry_msgs.msg import Twist, TwistStamped
from rlcas_msgs.msg import AssuranceStatus, Trajectory

from agents.planner.request.request import Altitude
from agents.policy.inference import Policy
from commands.command import InputError
from envs.aircraft import PAPER
from envs.kinematics import C208_PUBLISHED, VehicleState
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.waypoints import Waypoint
from ros_bridge import demo
from ros_bridge.core import conversions, message_fields
from ros_bridge.core.aircraft import aircraft_of
from ros_bridge.core.conversions import Published
from ros_bridge.core.replies import geodetic_points, start_point
from ros_bridge.core.tracks import Report
from ros_bridge.nodes.pilot import Pilot
from ros_bridge.nodes.series import main
from ros_bridge.nodes.simulator import Simulator
from ros_bridge.nodes.simulator_messages import route_of
from ros_bridge.sim.flight_log import keep_promises
from ros_bridge.sim.guidance import Guidance
from ros_bridge.sim.world import EncounterFlight
from ros_bridge.transport import qos
from ros_bridge.transport.mcap_file import GrowingFile
from ros_bridge.transport.messages import aircraft_message, filled, header
from tests.ros_bridge.graph import MISSING, NODE, World

SPEEDS = st.floats(-120.0, 120.0)
MAYBE = st.floats(0.1, 50.0) | st.just(0.0)
HEIGHTS = st.none() | st.builds(
    Altitude,
    st.floats(-500.0, 20_000.0),
    st.sampled_from(["wgs84", "msl", "pressure"]),
    st.floats(-50.0, 50.0),
)


@given(
    st.floats(-90.0, 90.0),
    st.floats(-180.0, 180.0),
    SPEEDS,
    SPEEDS,
    HEIGHTS,
    MAYBE,
    MAYBE,
    st.booleans(),
)
def test_reports_come_back_from_their_messages_as_they_were(
    latitude, longitude, east, north, altitude, position_std, velocity_std, own
):
    more = {"wind": (0.0, 0.0), "true_airspeed": math.hypot(east, north)} if own else {}
    report = Report(
        "n1", NOW, latitude, longitude, east, north, altitude, position_std, velocity_std, **more
    )
    assert conversions.aircraft(aircraft_message(report), "ownship") == report


def test_route_passes_the_goal_and_is_long_enough_for_every_plan():
    flight = EncounterFlight(
        encounters_of_seed(scenario("circle", PAPER), 0, 3, 1), PAPER, C208_PUBLISHED
    )
    route = conversions.published_route(route_of(flight, FRAME, 1_000.0))
    at = FRAME.place(
        [route_point.latitude for route_point in route],
        [route_point.longitude for route_point in route],
    )
    assert (float(at.x[0]), float(at.y[0])) == pytest.approx(flight.goal, abs=1e-3)
    # A plan at 100 m/s takes 400 s and goes no further.
    assert math.hypot(float(at.x[-1]) - flight.own.x, float(at.y[-1]) - flight.own.y) > 45_000.0
    assert len({route_point.index for route_point in route}) == len(route) == 10


@pytest.mark.skipif(importlib.util.find_spec("jsbsim") is None, reason="JSBSim is not installed")
def test_encounter_that_cannot_be_flown_is_a_logged_failure():
    encounter = encounters_of_seed(scenario("circle", PAPER), 0, 0, 1)
    fast = encounter._replace(own=encounter.own._replace(speed=encounter.own.speed * 0.0 + 300.0))
    with running_beside(Simulator, vehicle="c208") as (node, _):
        node.begin(fast, "too fast")
        assert not node.flying
        assert node.logs[0].failure.startswith("vehicle 'c208': the flight cannot begin")
        assert not keep_promises(node.logs)


@pytest.mark.parametrize(
    ("argument", "says"),
    [
        ("vehicle:=glider", "vehicle is 'glider', expected one of kinematic, point_mass, c208"),
        ("scenario:=sideways", "scenario 'sideways' is unknown"),
        ("encounters:=0", "encounters is 0, expected 1 or more"),
        ("seed:=-1", "seed is -1; expected 0 <= seed"),
        ("traffic_dropout:=2.0", "traffic_dropout"),
        ("flightgear:=localhost:5550", "flightgear: vehicle is kinematic, expected c208"),
    ],
)
def test_bad_parameters_are_refused_in_one_sentence(argument: str, says: str):
    with pytest.raises(InputError, match=re.escape(says)):
        main(["--ros-args", "-p", argument])


# What is flown: plans called SAFE that the monitor names, its backup, and nothing else.


def test_the_codes_are_those_of_the_messages():
    from ros_bridge.sim import guidance

    assert guidance.STATUS_WITHDRAWN == Trajectory.STATUS_WITHDRAWN
    assert (guidance.FLY_PLAN, guidance.FLY_BACKUP) == (
        AssuranceStatus.FLY_PLAN,
        AssuranceStatus.FLY_BACKUP,
    )


def message(number: int, status: int = Trajectory.STATUS_SAFE) -> SimpleNamespace:
    return SimpleNamespace(id=SimpleNamespace(uuid=uuid.UUID(int=number).bytes), status=status)


def word(fly: int, number: int = 0, time: int = NOW) -> SimpleNamespace:
    header = SimpleNamespace(stamp=stamp(time))
    return SimpleNamespace(header=header, fly=fly, trajectory_id=message(number).id)


def test_the_monitor_decides_which_plan_is_flown():
    guidance, first, second, backup = (
        Guidance(),
        message(1),
        message(2),
        message(9, Trajectory.STATUS_BACKUP),
    )

    def select(*words: int) -> SimpleNamespace | None:
        if words:
            guidance.hear(word(*words), NOW)
        return guidance.select(NOW)

    assert guidance.add_plan(first) and select() is None
    assert select(AssuranceStatus.FLY_PLAN, 1) is first
    # A newer plan is flown when the monitor has taken it up, and one that has not come yet is none.
    assert guidance.add_plan(second) and select() is first
    assert select(AssuranceStatus.FLY_PLAN, 2) is second
    assert select(AssuranceStatus.FLY_PLAN, 3) is None
    assert select(AssuranceStatus.FLY_BACKUP) is None
    guidance.backup = backup
    assert select() is backup
    assert select(AssuranceStatus.FLY_NOTHING) is None


def test_without_the_monitor_nothing_is_flown_after_a_second():
    guidance, plan = Guidance(), message(1)
    guidance.add_plan(plan)
    assert guidance.problem(NOW) == "no monitor has been heard of"
    guidance.hear(word(AssuranceStatus.FLY_PLAN, 1), NOW)
    assert guidance.select(NOW + SECOND) is plan and not guidance.problem(NOW + SECOND)
    assert guidance.select(NOW + SECOND + 1) is None
    assert guidance.problem(NOW + 2 * SECOND) == "the monitor has been silent for 2.0 s"
    # A status that is latched is as old as it says, and one from the future no newer than now.
    guidance.hear(word(AssuranceStatus.FLY_PLAN, 1), NOW + 5 * SECOND)
    assert guidance.select(NOW + 5 * SECOND) is None
    guidance.hear(word(AssuranceStatus.FLY_PLAN, 1, NOW + 9 * SECOND), NOW)
    assert guidance.select(NOW + 2 * SECOND) is None


def test_unsafe_and_withdrawn_plans_are_not_flown():
    guidance = Guidance(monitored=False)
    assert (
        not guidance.add_plan(message(1, Trajectory.STATUS_UNRESOLVED))
        and guidance.select(NOW) is None
    )
    safe = message(2)
    assert guidance.add_plan(safe) and guidance.select(NOW) is safe
    assert (
        not guidance.add_plan(message(3, Trajectory.STATUS_WITHDRAWN))
        and guidance.select(NOW) is None
    )


@pytest.mark.slow
def test_pilot_turns_to_the_plan_and_stops_without_an_ownship_or_a_monitor():
    with running_beside(Pilot, ownship_max_age=0.5) as (_, client):
        world = World(client)
        now = client.now()
        # Straight east at 75 m/s, 20 s a leg; the ownship is 30 m to its right.
        points = [Waypoint(n, 1_500.0 * n, 0.0, 0.0, 75.0, 20.0 * n) for n in range(1, 21)]
        start = start_point(
            FRAME, SimpleNamespace(x=0.0, y=0.0, heading=0.0, speed=75.0), now, None
        )
        every = geodetic_points(FRAME, points, now, None)
        published = Published(uuid.uuid4().bytes, 0, now, start, every, ())
        plan = filled(Trajectory, message_fields.plan(published), "map")
        client.say(Trajectory, f"{NODE}/output/trajectory", plan, qos.LATCHED)

        def monitor() -> None:
            status = AssuranceStatus(fly=AssuranceStatus.FLY_PLAN, trajectory_id=plan.id)
            status.header = header(client.now(), "map")
            client.say(AssuranceStatus, "/rlcas_monitor/output/status", status, qos.STATUS)

        monitor()
        commands: list[Twist] = client.hear(Twist, "/rlcas_pilot/output/command", qos.EVENTS)
        stamped = client.hear(TwistStamped, "/rlcas_pilot/output/command_stamped", qos.EVENTS)
        client.idle(0.3)
        assert commands == []

        def turning() -> bool:
            east = 75.0 * (client.now() - now) / 1e9
            world.ownship(east, -30.0)
            monitor()
            return bool(commands)

        client.spin(turning)
        command = commands[-1]
        # Lateral acceleration of 0.25 / s^2 a metre, as a turn rate at 75 m/s, cut off at the limit
        # of 5 degrees/s.
        assert command.angular.z == pytest.approx(
            min(0.25 * 30.0 / 75.0, math.radians(5.0)), rel=0.05
        )
        assert command.linear.x == pytest.approx(75.0, abs=0.5)
        client.spin(lambda: stamped)
        assert stamped[0].header.frame_id == "base_link"
        assert stamped[0].twist in commands
        # Without an ownship, and without a monitor, it commands nothing.
        for speaks in (monitor, lambda: world.ownship(75.0 * (client.now() - now) / 1e9, -30.0)):
            for _ in range(15):
                speaks()
                client.idle(0.1)
            before = len(commands)
            speaks()
            client.idle(0.3)
            assert len(commands) == before
            client.spin(lambda before=before: turning() and len(commands) > before)


def test_pilot_commands_the_climb_of_a_plan():
    with running_beside(Pilot, aircraft="uas", monitor=False) as (_, client):
        world, now = World(client), client.now()
        level = Altitude(1_000.0, "wgs84", 3.0)
        points = [
            Waypoint(n, 500.0 * n, 0.0, 0.0, 25.0, 20.0 * n, 1_000.0 + 60.0 * n, 3.0)
            for n in range(1, 21)
        ]
        own = VehicleState(0.0, 0.0, 0.0, 25.0)
        start = start_point(FRAME, own, now, level, climbs=True)
        every = geodetic_points(FRAME, points, now, level)
        published = Published(uuid.uuid4().bytes, 0, now, start, every, ())
        plan = filled(Trajectory, message_fields.plan(published), "map")
        client.say(Trajectory, f"{NODE}/output/trajectory", plan, qos.LATCHED)
        commands: list[Twist] = client.hear(Twist, "/rlcas_pilot/output/command", qos.EVENTS)
        height = {"valid": 0xCF, "altitude": 1_000.0, "altitude_reference": 1}

        def climbing() -> bool:
            seconds = (client.now() - now) / 1e9
            height["altitude"] = 1_000.0 + 3.0 * seconds
            world.ownship(25.0 * seconds, 0.0, 0.0, 25.0, climb=3.0, **height)
            return bool(commands)

        client.spin(climbing)
        assert commands[-1].linear.z == pytest.approx(3.0, abs=0.1)


# The whole loop: runner, monitor and simulator fly, what they fly is recorded, and others can read
# it.


def run_demo(*arguments: str, seconds: float = 600.0) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "ros_bridge.demo", *arguments]
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=seconds, check=False
    )


@pytest.mark.slow
def test_encounter_is_flown_safely_and_recorded(tmp_path: Path):
    reader = pytest.importorskip(
        "mcap.reader", reason="mcap is not installed; to have it: make ros"
    )
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="mcap-ros2-support is not installed")
    file = tmp_path / "flight.mcap"
    process = run_demo("--scenarios", "crossing_right", "--record", str(file), "--rate", "100")
    assert process.returncode == 0, process.stdout + process.stderr
    assert "1 of 1 encounters had a plan called SAFE" in process.stdout
    judged = process.stdout.split("plans that were flown\n\n")[1].splitlines()
    assert judged[1].startswith("crossing_right 0")
    assert judged[1].split()[-1] in ("kept", "exceeded")

    messages: dict[str, list] = {}
    last = 0
    with file.open("rb") as stream:
        for _, channel, message, content in reader.make_reader(
            stream, decoder_factories=[decoder.DecoderFactory()]
        ).iter_decoded_messages():
            assert message.log_time >= last
            last = message.log_time
            messages.setdefault(channel.topic, []).append(content)
    plans = messages["/rlcas_runner/output/trajectory"]
    assert plans[0].status == 1 and len(plans[0].waypoints) == 20
    assert plans[0].min_separation >= 1_025.0
    assert {recorded.fly for recorded in messages["/rlcas_monitor/output/status"]} == {0, 1}
    assert messages["/rlcas_runner/input/traffic"][0].id == "4b0001"
    values = {
        pair.key: pair.value
        for recorded in messages["/diagnostics"]
        for pair in recorded.status[0].values
    }
    assert values["policy sha256"] == Policy.load().sha256
    assert len(messages["/clock"]) > 500 and messages["/rlcas_runner/output/markers"]


@pytest.mark.slow
def test_a_head_on_encounter_is_resolved_by_a_climb():
    uas = aircraft_of("uas", "")
    assert uas.vertical is not None
    # The margin holds what is flown until the plan is taken up, too.
    parameters = {"aircraft": "uas", "maneuvers": "vertical", "vertical_margin_m": 10.0}
    settings = [
        f"{name}:={value}" for name, value in (parameters | {"use_sim_time": "true"}).items()
    ]
    arguments = [part for setting in settings for part in ("-p", setting)]
    with running_beside(Simulator, aircraft="uas", monitor=False, rate=100.0) as (node, client):
        runner = Process(
            "ros_bridge.runner", client.context.get_domain_id(), "--ros-args", *arguments
        )
        node.begin(encounters_of_seed(scenario("head_on", uas), 0, 0, 1), "head-on")
        client.spin(lambda: not node.flying, 300.0)
        runner.stop()
        (log,) = node.logs
    assert (log.failure, log.first, log.source) == ("", "SAFE", "vertical")
    assert log.separation >= uas.separation
    assert uas.vertical.separation <= log.height < math.inf
    (flown,) = log.flown
    assert flown.error < 1.0


def children(process: int) -> list[int]:
    files = Path(f"/proc/{process}/task").glob("*/children")
    return [int(number) for file in files for number in file.read_text().split()]


def alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def eventually(holds: Callable[[], object], seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, "it did not come to pass in time"
        time.sleep(0.1)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="needs /proc")
def test_killed_demo_leaves_no_process_and_a_readable_recording(tmp_path: Path):
    reader = pytest.importorskip(
        "mcap.reader", reason="mcap is not installed; to have it: make ros"
    )
    file = tmp_path / "flight.mcap"
    command = [
        sys.executable,
        "-m",
        "ros_bridge.demo",
        "--random",
        "9",
        "--rate",
        "5",
        "--record",
        str(file),
    ]
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.DEVNULL) as demo:
        eventually(lambda: len(children(demo.pid)) == 2)
        nodes = children(demo.pid)
        eventually(lambda: file.stat().st_size > 30_000)
        demo.kill()
    eventually(lambda: not any(map(alive, nodes)))
    with file.open("rb") as stream:
        topics = {channel.topic for _, channel, _ in reader.make_reader(stream).iter_messages()}
    assert {"/clock", "/rlcas_runner/input/ownship"} <= topics


@pytest.mark.slow
def test_full_disk_ends_a_recording_in_one_sentence_and_keeps_it(tmp_path: Path):
    reader = pytest.importorskip(
        "mcap.reader", reason="mcap is not installed; to have it: make ros"
    )
    file = tmp_path / "flight.mcap"
    command = ["--scenarios", "head_on", "--each", "9", "--rate", "20", "--record", str(file)]
    # Files may grow to so many blocks only: what a full disk does, without one.
    limited = [
        "bash",
        "-c",
        'ulimit -f 64; exec "$@"',
        "bash",
        sys.executable,
        "-m",
        "ros_bridge.demo",
        *command,
    ]
    process = subprocess.run(
        limited, cwd=ROOT, capture_output=True, text=True, timeout=1_200, check=False
    )
    assert process.returncode == 1, process.stderr
    assert f"error: {file}: File too large" in process.stderr and "Traceback" not in process.stderr
    assert not file.exists()
    with (tmp_path / "flight.partial.mcap").open("rb") as stream:
        assert sum(1 for _ in reader.make_reader(stream).iter_messages()) > 100


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--vehicle", "glider"], "argument --vehicle: invalid choice: 'glider' (choose from"),
        (["--scenarios", "sideways"], "scenario 'sideways' is unknown"),
        (["--scenarios", "none"], "expected something to fly"),
        (["--random", "-1"], "--random is -1, expected 0 or more"),
        (["--areas", "99"], "--areas is 99, expected 8 at most"),
        (["--rate", "0"], "rate"),
        (["--aircraft", "/nowhere.yaml"], "aircraft: /nowhere.yaml: there is no such file"),
        (["--margin", "-1"], "--margin is -1 m, expected 0 to 5000 m"),
        (["--record", "/nowhere/x.mcap"], "/nowhere/x.mcap cannot be written"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(arguments: list[str], says: str, monkeypatch):
    for name in ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE"):
        monkeypatch.setenv(name, "0")
    with pytest.raises(InputError, match=re.escape(says)):
        demo.main(arguments)


def rows(text: str) -> list[dict[str, str]]:
    """Return the cells of the demo's table by their columns, for each encounter."""
    head, *lines = text[text.index("encounter  ") :].split("\n\n", 1)[0].splitlines()
    starts = [match.start() for match in re.finditer(r"(?:^|(?<=  ))\S", head)]
    spans = list(zip(starts, [*starts[1:], None], strict=True))
    return [{head[a:b].strip(): line[a:b].strip() for a, b in spans} for line in lines]


@pytest.mark.slow
def test_noise_of_traffic_asks_for_few_new_plans():
    """With 30 m and 3 m/s of noise and reports 1 to 2 s old."""
    process = run_demo("--scenarios", "noisy", "--each", "3", seconds=900.0)
    assert process.returncode == 0, process.stdout + process.stderr
    table = rows(process.stdout)
    assert len(table) == 3 and "3 of 3 encounters had a plan called SAFE" in process.stdout
    assert np.median([int(row["re-plans"]) for row in table]) <= 3
    assert max(float(row["backup, s"]) for row in table) <= 10.0


@pytest.mark.slow
def test_another_aircraft_is_flown_safely_at_its_own_separation():
    uas = ("--aircraft", "configs/aircraft/uas.yaml", "--outside-domain", "allow")
    process = run_demo(*uas, "--scenarios", "crossing_right")
    assert process.returncode == 0, process.stdout + process.stderr
    assert (
        "1 of 1 encounters had a plan called SAFE" in process.stdout
        and "below 610 m: none" in process.stdout
    )


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", [pytest.param("kinematic", marks=pytest.mark.long), "c208"])
def test_the_four_scenarios_are_flown_safely(vehicle: str):
    if vehicle == "c208":
        pytest.importorskip("jsbsim")
    process = run_demo("--vehicle", vehicle)
    assert process.returncode == 0, process.stdout + process.stderr
    assert "4 of 4 encounters had a plan called SAFE" in process.stdout


IMPATIENT = """
from ros_bridge.nodes import simulator
from ros_bridge.simulator import main
simulator._COME_UP = 3.0
main()
"""


@pytest.mark.slow
def test_simulator_alone_names_the_missing_nodes():
    with domain() as number:
        alone = {"ROS_DOMAIN_ID": str(number), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        process = subprocess.run(
            [sys.executable, "-c", IMPATIENT, "--ros-args", "-p", "monitor:=false"],
            cwd=ROOT,
            env=os.environ | alone,
            capture_output=True,
            text=True,
            timeout=1_200,
            check=False,
        )
    assert process.returncode == 1
    assert "the runner has not answered within 3 s" in process.stdout + process.stderr


def begin_file(file: Path) -> tuple[GrowingFile, Any, int]:
    writer = pytest.importorskip(
        "mcap.writer", reason="mcap is not installed; to have it: make ros"
    )
    growing = GrowingFile(file)
    mcap = writer.Writer(growing)
    mcap.start(profile="ros2", library="test")
    schema = mcap.register_schema("a/msg/B", "ros2msg", b"int32 a")
    return growing, mcap, mcap.register_channel("/topic", "cdr", schema)


def messages(file: Path) -> list[int]:
    reader = pytest.importorskip(
        "mcap.reader", reason="mcap is not installed; to have it: make ros"
    )
    with file.open("rb") as stream:
        return [message.sequence for _, _, message in reader.make_reader(stream).iter_messages()]


def add(mcap: Any, channel: int, number: int, size: int = 8) -> None:
    mcap.add_message(
        channel, log_time=number, publish_time=number, sequence=number, data=bytes(size)
    )


def test_file_is_readable_after_each_flush_and_at_the_end(tmp_path: Path):
    file = tmp_path / "one.mcap"
    growing, mcap, channel = begin_file(file)
    for number in range(20):
        add(mcap, channel, number)
        mcap.flush()
        assert messages(file) == list(range(number + 1))
    mcap.finish()
    growing.close(finished=True)
    with file.open("rb") as stream:
        reader = pytest.importorskip(
            "mcap.reader", reason="mcap is not installed; to have it: make ros"
        )
        summary = reader.make_reader(stream).get_summary()
    assert summary is not None and summary.statistics.message_count == 20
    assert messages(file) == list(range(20))


def test_file_that_can_grow_no_more_holds_what_it_held(tmp_path: Path):
    file = tmp_path / "one.mcap"
    growing, mcap, channel = begin_file(file)
    add(mcap, channel, 0)
    mcap.flush()
    content = file.read_bytes()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(content) + 100, hard))
    try:
        with pytest.raises(OSError, match="File too large") as caught:
            for number in range(1, 50):
                add(mcap, channel, number)
                mcap.flush()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    growing.close(finished=False)
    assert caught.value.filename == str(file)
    assert messages(file) == [0]
