"""Other packages' messages on a graph: passed on as they mean it, or not at all and with the
reason.
"""

import importlib
import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.ros_bridge.graph import MISSING, NODE, ROOT, Client, Process, domain, running_beside

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")
pytest.importorskip("rclpy", reason=MISSING)

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Quaternion, TwistStamped, Vector3
from nav_msgs.msg import Odometry
from rclpy.exceptions import ParameterException
from rlcas_msgs.msg import Advisory, AircraftState, Trajectory, Waypoint
from rlcas_msgs.srv import GenerateTrajectory
from sensor_msgs.msg import NavSatFix

from agents.planner.answer import AdvisoryCode
from commands.command import InputError
from ros_bridge.core import adapters
from ros_bridge.core.fields import Code, FieldError
from ros_bridge.nodes.monitor import Monitor
from ros_bridge.nodes.runner import Runner
from ros_bridge.nodes.translator import Translator, main, pair
from ros_bridge.transport import parameters, qos, topics
from ros_bridge.transport.messages import time_message
from ros_bridge.transport.overrides import refuse_unknown_nodes
from tests.ros_bridge.scenes import NOW, SECOND, definitions

TRANSLATOR = "/rlcas_translator"


def odometry(
    roll: float, pitch: float, yaw: float, ahead: float, left: float, up: float
) -> Odometry:
    cr, sr, cp, sp, cy, sy = (f(0.5 * a) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
    message = Odometry()
    message.header.stamp = time_message(NOW)
    message.pose.pose.orientation = Quaternion(
        w=cr * cp * cy + sr * sp * sy,
        x=sr * cp * cy - cr * sp * sy,
        y=cr * sp * cy + sr * cp * sy,
        z=cr * cp * sy - sr * sp * cy,
    )
    message.twist.twist.linear = Vector3(x=ahead, y=left, z=up)
    return message


@given(
    *(st.floats(-1.5, 1.5) for _ in range(2)),
    st.floats(-math.pi, math.pi),
    *(st.floats(-50.0, 50.0),) * 3,
)
def test_odometry_turns_with_the_body(roll, pitch, yaw, ahead, left, up):
    # Roll about x, then pitch about y, then yaw about z: one axis after the other, as matrices do
    # it.
    x, y, z = (
        ahead,
        math.cos(roll) * left - math.sin(roll) * up,
        math.sin(roll) * left + math.cos(roll) * up,
    )
    x, z = math.cos(pitch) * x + math.sin(pitch) * z, -math.sin(pitch) * x + math.cos(pitch) * z
    x, y = math.cos(yaw) * x - math.sin(yaw) * y, math.sin(yaw) * x + math.cos(yaw) * y
    linear = adapters.odometry_velocity(odometry(roll, pitch, yaw, ahead, left, up)).linear
    assert (linear.x, linear.y, linear.z) == pytest.approx((x, y, z), abs=1e-9)


def test_an_attitude_that_is_none_is_refused():
    message = odometry(0.0, 0.0, 0.0, 70.0, 0.0, 0.0)
    message.pose.pose.orientation = Quaternion(x=0.0, y=0.0, z=0.0, w=0.0)
    with pytest.raises(FieldError, match=r"odometry\.orientation has length 0, expected 1"):
        adapters.odometry_velocity(message)


def fix(time: int, **more) -> NavSatFix:
    message = NavSatFix(latitude=47.1, longitude=8.2, altitude=1_900.0, **more)
    message.header.stamp = time_message(time)
    message.status.status = 0
    return message


def velocity(time: int, east: float = 60.0, north: float = 30.0) -> TwistStamped:
    message = TwistStamped()
    message.header.stamp = time_message(time)
    message.twist.linear.x, message.twist.linear.y = east, north
    return message


def test_a_fix_goes_with_the_velocity_of_its_time_alone():
    report = pair(fix(NOW), velocity(NOW - SECOND // 10), "n1", "msl", 0.2)
    assert (report.east, report.north, report.time) == (60.0, 30.0, NOW)
    assert report.altitude is not None and report.altitude.reference == "msl"
    turned = pair(fix(NOW), odometry(0.0, 0.0, 0.5 * math.pi, 70.0, 0.0, 0.0), "n1", "wgs84", 0.2)
    assert (turned.east, turned.north) == pytest.approx((0.0, 70.0), abs=1e-9)
    with pytest.raises(FieldError, match="velocity has not been received"):
        pair(fix(NOW), None, "n1", "msl", 0.2)
    with pytest.raises(
        FieldError, match=r"velocity\.header\.stamp is 1\.00 s from the fix's, expected 0\.2 s"
    ):
        pair(fix(NOW), velocity(NOW - SECOND), "n1", "msl", 0.2)


def test_good_states_are_passed_on_and_others_reported():
    with running_beside(
        Translator, own_source="nav_sat_fix", own_id="4b1234", own_altitude_reference="msl"
    ) as (_, client):
        states = client.hear(AircraftState, f"{NODE}/input/ownship", qos.SENSOR)
        health = client.hear(DiagnosticArray, "/diagnostics", qos.EVENTS)
        client.say(NavSatFix, f"{TRANSLATOR}/input/fix", fix(NOW), qos.SENSOR)
        client.spin(
            lambda: (
                health
                and health[-1].status[0].message
                == "velocity has not been received, expected one beside the fix"
            )
        )
        assert states == []  # an ownship without velocity is not passed on
        client.say(TwistStamped, f"{TRANSLATOR}/input/velocity", velocity(NOW), qos.SENSOR)
        client.idle(0.1)
        client.say(NavSatFix, f"{TRANSLATOR}/input/fix", fix(NOW), qos.SENSOR)
        client.spin(lambda: states)
        state = states[0]
        assert (state.id, state.latitude, state.velocity.x, state.velocity.y) == (
            "4b1234",
            47.1,
            60.0,
            30.0,
        )
        assert (state.altitude, state.altitude_reference) == (1_900.0, AircraftState.ALTITUDE_MSL)


def test_traffic_that_cannot_be_translated_is_named():
    with running_beside(Translator, traffic_source="nav_sat_fix", traffic_id="N 42") as (_, client):
        states = client.hear_traffic()
        client.say(NavSatFix, f"{TRANSLATOR}/input/fix", fix(NOW), qos.SENSOR)
        client.spin(lambda: states)
        assert (states[0].id, states[0].valid, states[0].latitude) == (
            "n 42",
            AircraftState.VALID_POSITION,
            47.1,
        )
        lost = fix(NOW)
        lost.status.status = -1
        client.say(NavSatFix, f"{TRANSLATOR}/input/fix", lost, qos.SENSOR)
        client.spin(lambda: len(states) == 2)
        assert (states[1].id, states[1].valid) == ("n 42", 0)


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ([], "own_source and traffic_source are both none"),
        (
            ["own_source:=gps"],
            "own_source is 'gps', expected one of none, nav_sat_fix, inspva, inspvax",
        ),
        (["own_source:=nav_sat_fix"], "own_id is empty"),
        (["traffic_source:=adsb"], "adsb needs the package mavros_msgs"),
    ],
)
def test_bad_parameters_are_refused_in_one_sentence(settings, says):
    with pytest.raises(InputError, match=re.escape(says)):
        main(["--ros-args", *(part for setting in settings for part in ("-p", setting))])


# mavros and NovAtel over real DDS: their packages are built from their definitions, and the
# translator reads them.

OURS = ROOT / "ros_bridge" / "rlcas_msgs"
SENDER = """
import sys, time
import rclpy
from rclpy.qos import qos_profile_sensor_data as sensor
from mavros_msgs.msg import ADSBVehicle
from novatel_oem7_msgs.msg import INSPVAX
rclpy.init()
node = rclpy.create_node("drivers")
adsb = node.create_publisher(ADSBVehicle, "/rlcas_translator/input/adsb", sensor)
ins = node.create_publisher(INSPVAX, "/rlcas_translator/input/inspva", sensor)
while True:
    now = node.get_clock().now().to_msg()
    # The last is a vehicle that drives.
    for address, heading, flags, kind, speed in (
        (1, 90.0, 15, 1, 80.0), (2, 3.0, 15, 0, 80.0), (3, 90.0, 1, 0, 80.0), (4, 90.0, 15, 17, 5.0)
    ):
        message = ADSBVehicle(icao_address=address, latitude=47.0, longitude=8.0, heading=heading, hor_velocity=speed)
        message.flags, message.emitter_type, message.header.stamp = flags, kind, now
        adsb.publish(message)
    message = INSPVAX(latitude=47.0, longitude=8.0, height=400.0, undulation=48.0, east_velocity=70.0)
    message.ins_status.status, message.header.stamp = 3, now
    ins.publish(message)
    time.sleep(0.2)
"""


def build_package(package: str, folder: Path, prefix: Path) -> None:
    """Build a package of the definitions as our own is built."""
    source = folder / package
    (source / "msg").mkdir(parents=True)
    for name, text in definitions(package).items():
        (source / "msg" / f"{name}.msg").write_text(text, encoding="utf-8")
    text = (OURS / "CMakeLists.txt").read_text(encoding="utf-8").replace("rlcas_msgs", package)
    text = re.sub(r"set\(dependencies .*\)", "set(dependencies builtin_interfaces std_msgs)", text)
    names = "\n  ".join(f"msg/{file.name}" for file in sorted((source / "msg").glob("*.msg")))
    text = re.sub(r"msg/\w+\.msg.*\.srv", names, text, flags=re.DOTALL)
    (source / "CMakeLists.txt").write_text(text, encoding="utf-8")
    described = (OURS / "package.xml").read_text(encoding="utf-8").replace("rlcas_msgs", package)
    (source / "package.xml").write_text(described, encoding="utf-8")
    command = [
        sys.executable,
        "-m",
        "ros_bridge.build_interfaces",
        "--source",
        str(source),
        "--prefix",
        str(prefix),
    ]
    process = subprocess.run(
        [*command, "--build", str(folder / "build" / package)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, process.stderr


@pytest.mark.slow
def test_translator_reads_the_messages_of_mavros_and_novatel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    prefix = tmp_path / "prefix"
    for package in ("mavros_msgs", "novatel_oem7_msgs"):
        build_package(package, tmp_path, prefix)
    [packages] = prefix.glob("lib/python*/site-packages")
    for name, value in (("PYTHONPATH", packages), ("LD_LIBRARY_PATH", prefix / "lib")):
        monkeypatch.setenv(
            name, os.pathsep.join(filter(None, [str(value), os.environ.get(name, "")]))
        )
    sources = ("own_source:=inspvax", "own_id:=own", "traffic_source:=adsb")
    with domain() as number:
        Process(
            "ros_bridge.translator",
            number,
            "--ros-args",
            *(part for entry in sources for part in ("-p", entry)),
        )
        script = tmp_path / "drivers_of_others.py"
        script.write_text(SENDER, encoding="utf-8")
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ["PYTHONPATH"]]))
        Process("drivers_of_others", number)
        client = Client(number)
        try:
            own = client.hear(AircraftState, f"{NODE}/input/ownship", qos.SENSOR)
            traffic = client.hear_traffic()
            client.spin(
                lambda: own and {entry.id for entry in traffic} >= {"000001", "000002", "000003"},
                30.0,
            )
            client.idle(1.0)
            states = {entry.id: entry for entry in traffic}
        finally:
            client.close()
    assert set(states) == {"000001", "000002", "000003"}
    assert (states["000001"].velocity.x, states["000001"].velocity.y) == pytest.approx(
        (80.0, 0.0), abs=1e-9
    )
    assert states["000002"].velocity.x == pytest.approx(4.187, abs=1e-3)  # 80 m/s at 3 degrees
    assert states["000003"].valid == AircraftState.VALID_POSITION
    assert (own[0].altitude, own[0].altitude_reference) == (448.0, AircraftState.ALTITUDE_WGS84)


# What others rely on: parameters, public names, codes of messages, the page about ROS graphs.


DOCS = Path(__file__).resolve().parents[2] / "docs" / "reference" / "ros-parameters.md"


def test_the_docs_are_current():
    advice = (
        "expected the output of `python -m ros_bridge.transport.parameters` in "
        "docs/reference/ros-parameters.md"
    )
    assert parameters.reference() in DOCS.read_text(encoding="utf-8"), advice


def test_the_layout_for_viewers_names_what_is_recorded():
    layout = json.loads(
        (DOCS.parents[1] / "assets" / "foxglove-layout.json").read_text(encoding="utf-8")
    )
    recorded = {f"/{name.removeprefix('/')}": kind for kind, name, _ in topics.EVERY}
    panels = layout["configById"]
    shown_topics = [
        *panels["3D!plan"]["topics"],
        panels["DiagnosticSummary!health"]["topicToRender"],
    ]
    assert set(shown_topics) <= set(recorded)
    values = [path["value"] for panel in panels.values() for path in panel.get("paths", [])]
    assert len(values) == 5
    for topic, _, field in (value.rpartition(".") for value in values):
        assert field in recorded[topic].get_fields_and_field_types()
    placed = re.findall(r'"(\w+!\w+)"', json.dumps(layout["layout"]))
    assert sorted(placed) == sorted(panels)


@pytest.mark.parametrize("node", parameters.NODES)
def test_defaults_lie_in_their_ranges_and_names_are_unique(node: str):
    every = list(parameters.of(node))
    numbers = [
        parameter
        for parameter in every
        if parameter.low is not None and not isinstance(parameter.default, str)
    ]
    assert all(
        parameter.low <= parameter.default <= parameter.high and parameter.meaning
        for parameter in numbers
    )
    assert len({parameter.name for parameter in every}) == len(every)


@pytest.mark.parametrize("values", [{"separaton": 2000.0}, {"marign": 500.0}, {"margin": math.nan}])
def test_unknown_and_undefined_values_are_refused_by_name(values: dict[str, float]):
    with (
        pytest.raises((ValueError, ParameterException), match=next(iter(values))),
        running_beside(Monitor, **values),
    ):
        pass


def test_parameters_of_the_node_itself_are_taken():
    with running_beside(Monitor, margin=40.0, use_sim_time=False) as (node, _):
        assert node.get_parameter("margin").value == 40.0


@pytest.mark.parametrize("node", [Runner, Monitor])
def test_default_margin_is_an_aircrafts(node: Any):
    with running_beside(node) as (started, _):
        assert started.get_parameter("margin").value == 210.0


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("/**/rlcas_runer:\n  ros__parameters: {margin: 50.0}", "rlcas_runer"),
        ("n123:\n  rlcas_montor:\n    ros__parameters: {margin: 50.0}", "rlcas_montor"),
        ("/**/rlcas_translator_2:\n  ros__parameters: {own_id: a}", ""),
        (
            "a: {b: [1, {c: d}], e: &x f}\n/rlcas_runr:\n  ros__parameters: {list: [1, 2], other: "
            "*x}",
            "rlcas_runr",
        ),
        (
            "/n123/rlcas_runner:\n  ros__parameters: {margin: 50.0}\n/other:\n  ros__parameters: "
            "{a: 1}",
            "",
        ),
    ],
)
def test_parameter_file_for_an_unknown_node_is_refused(tmp_path: Path, text: str, wrong: str):
    file = tmp_path / "some.yaml"
    file.write_text(text, encoding="utf-8")
    arguments = ["--ros-args", "--params-file", str(file)]
    names = [f"rlcas_{name}" for name in parameters.NODES]
    if not wrong:
        refuse_unknown_nodes(arguments, names)
        return
    with pytest.raises(
        ValueError, match=f"parameters for {wrong}, which is no node; the nearest is rlcas_"
    ):
        refuse_unknown_nodes(arguments, names)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{a: " * 3000 + "1" + "}" * 3000, "nested too deeply"),
        ("rlcas_runner:\n  ros__parameters: [1,\n", "line 3: not valid YAML"),
        ("rlcas_runner:\n\tros__parameters:\n", "line 2: not valid YAML"),
        ("a: 1\n---\na: 2\n", "line 2: not valid YAML"),
        ("\x00", "not valid YAML"),
    ],
)
def test_a_parameter_file_that_is_no_yaml_is_refused(tmp_path: Path, text: str, says: str):
    file = tmp_path / "some.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=f"some.yaml: .*{re.escape(says)}"):
        refuse_unknown_nodes(["--ros-args", "--params-file", str(file)], [])
    with pytest.raises(ValueError, match="there is no such file"):
        refuse_unknown_nodes(["--ros-args", "--params-file", str(tmp_path / "other.yaml")], [])


def test_a_named_pipe_is_no_parameter_file(tmp_path: Path):
    os.mkfifo(pipe := tmp_path / "pipe.yaml")
    with pytest.raises(ValueError, match="not a regular file"):
        refuse_unknown_nodes(["--ros-args", "--params-file", str(pipe)], [])


def test_argument_for_an_unknown_node_is_refused():
    names = [f"rlcas_{name}" for name in parameters.NODES]
    refuse_unknown_nodes(
        ["--ros-args", "-p", "rlcas_runner:margin:=50.0", "-p", "policy_file:=a:b"], names
    )
    with pytest.raises(
        ValueError, match="for rlcas_runer, which is no node; the nearest is rlcas_runner"
    ):
        refuse_unknown_nodes(["--ros-args", "-p", "/n1/rlcas_runer:margin:=50.0"], names)


# The rooms' public names: all of them exist, and core and sim need no ROS.
@pytest.mark.parametrize("room", ["core", "nodes", "sim", "transport"])
def test_public_names_exist(room: str):
    module = importlib.import_module(f"ros_bridge.{room}")
    assert 5 <= len(module.__all__) <= 11
    assert all(getattr(module, name) is not None for name in module.__all__)
    with pytest.raises(AttributeError):
        module.no_such_name  # noqa: B018


def test_core_and_sim_load_no_ros():
    rooms = ", ".join(f"ros_bridge.{room}" for room in ("core", "sim", "transport", "nodes"))
    program = f"import sys, {rooms}; print('rclpy' in sys.modules)"
    process = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert process.stdout.strip() == "False"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--bogus"], "unrecognized arguments: --bogus"),
        (
            ["--ros-args", "-p", "separaton:=2000.0"],
            "separaton is no parameter of rlcas_runner; the nearest is separation",
        ),
        pytest.param(
            ["--ros-args", "-p", "policy_sha256:=" + 32 * "ab"],
            "policy_sha256 is 'abab",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ["--ros-args", "-p", "separation:=0.0"],
            "separation out of range",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ["--ros-args", "-p", "separation:=many"], "separation", marks=pytest.mark.slow
        ),
        (["--ros-args", "-p", "policy_file:=/nowhere/policy"], "no such policy file"),
        pytest.param(
            ["--ros-args", "-p", "extensions:=no_such:thing"],
            "extensions: no_such:thing: no module",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ["--ros-args", "-p", "route_durability:=forever"],
            "expected transient_local or volatile",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_bad_arguments_end_with_one_line_and_code_2(arguments: list[str], says: str):
    with domain() as number:
        process = Process("ros_bridge.runner", number, *arguments)
        output, _ = process.popen.communicate(timeout=1_200)
    assert process.popen.returncode == 2
    assert says in output
    assert "Traceback" not in output


def test_messages_hold_what_the_conversions_expect():
    from ros_bridge.core import conversions as read

    bits = [name for name in dir(AircraftState) if name.startswith("VALID_")]
    assert sorted(getattr(AircraftState, name) for name in bits) == [1 << n for n in range(9)]
    assert all(
        getattr(AircraftState, name) == getattr(read, name.removeprefix("VALID_")) for name in bits
    )
    for name, bit in (("ALTITUDE", read.POINT_ALTITUDE), ("TRACK", read.POINT_TRACK)):
        assert getattr(Waypoint, f"VALID_{name}") == bit
    assert (Waypoint.VALID_GROUND_SPEED, Waypoint.VALID_TIME_OF_ARRIVAL) == (
        read.POINT_SPEED,
        read.POINT_TIME,
    )
    for name in ("SAFE", "ROUTE", "BACKUP"):
        assert getattr(Trajectory, f"STATUS_{name}") == getattr(read, f"STATUS_{name}")
    codes = {
        name.removeprefix("STATUS_"): getattr(GenerateTrajectory.Response, name)
        for name in dir(GenerateTrajectory.Response)
        if name.startswith("STATUS_")
    }
    assert codes == {code.name: code.value for code in Code}
    assert {code.name: code.value for code in AdvisoryCode} == {
        name: getattr(Advisory, name)
        for name in dir(Advisory)
        if isinstance(getattr(Advisory, name), int)
    }


# The node on the page about ROS graphs of one's own runs, and the runner answers it as the page
# says.
PAGE = (ROOT / "docs" / "howto" / "own-ros-graph.md").read_text(encoding="utf-8")
PROGRAM = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)[0]
PRINTED = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)
OWN = '        self.own.publish(aircraft("own", now, 80.0 * seconds, 80.0))\n'


@pytest.mark.slow
@pytest.mark.parametrize(
    ("left_out", "printed"), [("", PRINTED[0]), (OWN, PRINTED[1])], ids=["whole", "no ownship"]
)
def test_the_program_of_the_page_gets_the_answers_of_the_page(
    left_out: str, printed: str, tmp_path: Path
) -> None:
    assert left_out in PROGRAM
    (tmp_path / "ask.py").write_text(
        PROGRAM.replace(left_out, "") if left_out else PROGRAM, encoding="utf-8"
    )
    with domain() as number:
        Process("ros_bridge.runner", number)
        environment = os.environ | {
            "ROS_DOMAIN_ID": str(number),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "PYTHONPATH": str(ROOT),
        }
        process = subprocess.run(
            [sys.executable, "ask.py"],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            timeout=1_200,
            check=False,
        )
    assert process.returncode == 0, process.stderr
    assert process.stdout == printed
