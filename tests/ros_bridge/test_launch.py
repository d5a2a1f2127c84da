"""How nodes are started, find each other and are recorded."""

import importlib.util
import math
import os
import runpy
import shutil
import socket
import subprocess
import sys
import types
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ros_bridge.transport.discovery import (
    CONFIGURED,
    PORTS,
    PROFILE,
    configure_dds,
    port,
    reserve_ports,
)
from tests.ros_bridge.graph import MISSING, Process, domain

pytest.importorskip("rclpy", reason=MISSING)

import yaml

from agents.config.load import load
from agents.config.world import AircraftConfig
from agents.planner.request.options import Maneuvers, Options
from agents.policy.inference import Policy
from envs.aircraft import PAPER
from envs.areas import Level
from eval.hifi.config import HifiConfig
from ros_bridge.core.aircraft import aircraft_of
from ros_bridge.core.freshness import Freshness
from ros_bridge.core.reports import USUAL
from ros_bridge.transport import parameters
from ros_bridge.transport.settings import (
    freshness_of,
    monitor_thresholds,
    parameters_of,
    planning_options,
    planning_settings,
)

PACKAGE = Path(parameters.__file__).parents[1]
LAUNCH = sorted((PACKAGE / "launch").glob("*.launch.py"))
DECLARED = {
    f"rlcas_{name}": {declared_parameter.name for declared_parameter in parameters.of(name)}
    | {"use_sim_time"}
    for name in parameters.NODES
}


class _Action:
    def __init__(self, *given, **named) -> None:
        self.given, self.named = given, named


class _Value(_Action):
    def perform(self, context: dict[str, str]) -> str:
        return context[self.given[0]]


@pytest.fixture
def stand_ins(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Put stand-ins of launch in the way of imports: they hold what they are given."""
    names = {
        "launch": {"LaunchDescription": _Action},
        "launch.actions": dict.fromkeys(
            ("DeclareLaunchArgument", "OpaqueFunction", "Shutdown"), _Action
        ),
        "launch.substitutions": {"LaunchConfiguration": _Value},
        "launch_ros": {},
        "launch_ros.actions": {"Node": _Action, "LifecycleNode": _Action},
    }
    for name, content in names.items():
        module = types.ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.delitem(sys.modules, "ros_bridge.transport.launching", raising=False)
    yield
    sys.modules.pop("ros_bridge.transport.launching", None)


@pytest.mark.parametrize("file", LAUNCH, ids=lambda file: file.name)
@pytest.mark.parametrize("params_file", ["", "some.yaml"])
def test_launch_files_start_nodes_with_declared_parameters(stand_ins, file: Path, params_file: str):
    description = runpy.run_path(str(file))["generate_launch_description"]()
    *declared, opaque = description.given[0]
    context = {action.given[0]: action.named["default_value"] for action in declared}
    assert all(action.named["description"] for action in declared)
    assert {"namespace", "use_sim_time", "params_file"} <= set(context)
    chosen = {"aircraft": "configs/aircraft/uas.yaml", "separation": "700", "sigmas": "1.0"}
    context |= {"params_file": params_file, "namespace": "n123"} | chosen
    if "translate" in context:
        context["translate"] = "true"
    nodes = opaque.named["function"](context)
    names = [node.named["name"] for node in nodes]
    assert names[:2] == ["rlcas_runner", "rlcas_monitor"] and len(names) == 3
    for node in nodes:
        module = node.named["arguments"][1]
        assert importlib.util.find_spec(module) is not None
        assert module == f"ros_bridge.{node.named['name'].removeprefix('rlcas_')}"
        values, *files = node.named["parameters"]
        assert set(values) <= DECLARED[node.named["name"]]
        assert files == ([params_file] if params_file else [])
        assert node.named["namespace"] == "n123"
        assert values["use_sim_time"] is (file.name == "simulation.launch.py")
    # What protects is started again where it has died.
    assert all(node.named["respawn"] for node in nodes[:2])
    expected = {"aircraft": "configs/aircraft/uas.yaml", "separation": 700.0, "sigmas": 1.0}
    for node in nodes[:2]:
        # What is empty is the node's own default.
        assert node.named["parameters"][0] == expected | {
            "use_sim_time": file.name == "simulation.launch.py"
        }


@pytest.mark.skipif(
    importlib.util.find_spec("launch_ros") is None, reason="launch_ros is not installed"
)
@pytest.mark.parametrize("file", LAUNCH, ids=lambda file: file.name)
def test_launch_files_are_understood_by_ros(file: Path):
    from launch import LaunchContext

    description = runpy.run_path(str(file))["generate_launch_description"]()
    context = LaunchContext()
    for entity in description.entities:
        entity.execute(context)


@pytest.mark.parametrize("file", ["parameters.yaml", "c208.yaml"])
def test_params_files_name_parameters_that_exist(file: str):
    files_parameters = yaml.safe_load((PACKAGE / "launch" / file).read_text(encoding="utf-8"))
    for pattern, content in files_parameters.items():
        node = pattern.removeprefix("/**/")
        ranges = {
            parameter.name: parameter
            for parameter in parameters_of(node.removeprefix("rlcas_"), PAPER)
        }
        for name, value in content["ros__parameters"].items():
            assert name in DECLARED[node]
            low, high = ranges[name].low, ranges[name].high
            assert low is None or low <= value <= high


def values_of(kind: str, **values: Any) -> Callable[[str], Any]:
    """Return how a node of the paper's aircraft would read its parameters."""
    return (
        {parameter.name: parameter.default for parameter in parameters_of(kind, PAPER)} | values
    ).get


def test_the_aircraft_in_flight_is_that_of_the_evaluations():
    file_parameters = yaml.safe_load((PACKAGE / "launch" / "c208.yaml").read_text(encoding="utf-8"))
    runner, monitor = (
        file_parameters[f"/**/rlcas_{name}"]["ros__parameters"] for name in ("runner", "monitor")
    )
    assert runner == monitor
    config = load(HifiConfig, PACKAGE.parent / "configs" / "flight_c208.yaml")
    assert runner["margin"] == config.planner.margin
    assert runner["vertical_margin_m"] == config.planner.vertical_margin_m
    vehicle = config.planner.options(PAPER).limits
    for options in (
        planning_settings(values_of("runner", **runner), PAPER).options,
        monitor_thresholds(values_of("monitor", **monitor), PAPER).options,
    ):
        assert options.limits == vehicle and options.manoeuvre.speed_max <= vehicle.speed_max
        assert options.requirement.margin == config.planner.margin


def test_defaults_are_the_usual_options_of_the_aircraft():
    usual = Options.for_aircraft(PAPER)
    options = planning_options(values_of("runner"), PAPER)
    assert options == replace(usual, requirement=usual.requirement._replace(margin=210.0))
    for name in ("uas", "jet"):
        aircraft = load(
            AircraftConfig, PACKAGE.parent / "configs" / "aircraft" / f"{name}.yaml"
        ).aircraft()
        defaults = {
            parameter.name: parameter.default for parameter in parameters_of("runner", aircraft)
        }
        options, usual = planning_options(defaults.get, aircraft), Options.for_aircraft(aircraft)
        assert options.requirement.separation == aircraft.separation
        assert options.max_age == pytest.approx(usual.max_age)
        # The rate goes through degrees of nine digits.
        np.testing.assert_allclose(options.limits, usual.limits, rtol=1e-9)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        (
            {"speed_min": 99.0, "speed_max": 99.5},
            "speed_min, speed_max: allows 99 to 99.5 m/s; expected a range",
        ),
        (
            {"speed_min": 90.0, "speed_max": 80.0},
            "speed_min is 90 m/s, expected less than speed_max, 80 m/s",
        ),
        (
            {"goal_radius": 1_001.0},
            "goal_radius is 1001 m, expected at most the separation, 1000 m",
        ),
        ({"spacing": 7}, "spacing is 7, expected an integer from 5 to 400, a multiple of 5"),
        ({"rejoin_by": 350.0}, "rejoin_by is 350, expected 20 to 340 s"),
        (
            {"yaw_rate_max": 0.02},
            "yaw_rate_max makes a full circle of 24000 s, expected at most the plan's 380 s",
        ),
        ({"waypoints": 5}, "yaw_rate_max makes a full circle"),
        (
            {"forget_after": 5.0, "intruder_max_age": 5.5},
            "forget_after is 5 s, expected at least intruder_max_age, 5.5 s",
        ),
        (
            {"maneuvers": "up"},
            "maneuvers is 'up', expected one of horizontal, vertical, both",
        ),
        (
            {"maneuvers": "vertical"},
            'maneuvers is "vertical", expected "horizontal": the aircraft states no limits',
        ),
        (
            {"ceiling_m": 400.0},
            'ceiling_m is given, expected maneuvers that are "vertical" or "both"',
        ),
        (
            {"own_altitude_reference": "sea"},
            "own_altitude_reference is 'sea', expected one of wgs84, msl, pressure",
        ),
    ],
)
def test_contradicting_parameters_are_refused_by_name(values: dict[str, Any], says: str):
    with pytest.raises(ValueError) as caught:
        planning_options(values_of("runner", **values), PAPER)
    assert str(caught.value).startswith(says)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"floor_m": 500.0}, "floor_m is 500 m, expected less than the ceiling, 400 m"),
        ({"floor_m": math.inf}, "floor_m is inf, expected -1000 to 30000 m"),
        ({"ceiling_m": 1e6}, "ceiling_m is 1e+06, expected -1000 to 30000 m"),
    ],
)
def test_altitudes_that_contradict_are_refused_by_name(values: dict[str, Any], says: str):
    with pytest.raises(ValueError) as caught:
        _climbing_options("runner", **({"floor_m": 120.0, "ceiling_m": 400.0} | values))
    assert str(caught.value).startswith(says)


def test_runner_and_monitor_climb_between_the_same_levels():
    values = {"floor_m": 120.0, "own_altitude_reference": "msl"}
    for kind in ("runner", "monitor"):
        options = _climbing_options(kind, **values)
        assert options.maneuvers is Maneuvers.BOTH
        assert (options.floor, options.ceiling) == (Level(120.0, "msl"), None)
        assert options.vertical_margin == Options.for_aircraft(options.aircraft).vertical_margin
        assert _climbing_options(kind, vertical_margin_m=30.0).vertical_margin == 30.0


def _climbing_options(kind: str, **values: Any) -> Options:
    """Return the options of a node whose aircraft can climb."""
    aircraft = aircraft_of("uas", "")
    usual = {parameter.name: parameter.default for parameter in parameters_of(kind, aircraft)}
    return planning_options((usual | {"maneuvers": "both"} | values).get, aircraft)


@pytest.mark.parametrize("name", ["", "uas", "light", "jet"])
def test_nodes_and_mavlink_program_hold_reports_for_as_long(name: str):
    mavlink = pytest.importorskip("ros_bridge.mavlink.judging")
    aircraft = aircraft_of(name, "")
    values = {parameter.name: parameter.default for parameter in parameters_of("runner", aircraft)}
    rules = mavlink.rules(
        aircraft, Policy.load(), margin=25.0, vertical=600.0, unknown=USUAL, deadline=0.2
    )
    of_nodes = freshness_of(values.get)
    assert of_nodes == rules.settings.freshness == Freshness.for_aircraft(aircraft)
    assert (rules.thresholds.own_age, rules.thresholds.intruder_age) == of_nodes[:2]
    assert rules.settings.options.max_age == of_nodes.intruder <= of_nodes.silence


def test_any_separation_and_limits_are_taken():
    values = {
        "separation": 150.0,
        "goal_radius": 50.0,
        "waypoints": 30,
        "spacing": 10,
        "margin": 3.0,
        "speed_max": 95.0,
    }
    options = planning_options(values_of("runner", **values), PAPER)
    assert options.requirement.separation == 150.0 and options.aircraft.goal_radius == 50.0
    assert (options.waypoints, options.interval, options.limits.speed_max) == (30, 10.0, 95.0)


def test_the_bridge_names_topics_of_the_world():
    root = ET.parse(PACKAGE / "gazebo" / "world.sdf").getroot()
    topics = {f"/{entry.text}" for tag in ("topic", "odom_topic") for entry in root.iter(tag)}
    topics.add(f"/world/{root.find('world').attrib['name']}/clock")
    bridge = yaml.safe_load((PACKAGE / "gazebo" / "bridge.yaml").read_text(encoding="utf-8"))
    assert {entry["gz_topic_name"] for entry in bridge} == topics
    keys = {"ros_topic_name", "gz_topic_name", "ros_type_name", "gz_type_name", "direction"}
    assert all(set(entry) == keys for entry in bridge)


@pytest.mark.skipif(
    shutil.which("ign") is None and shutil.which("gz") is None, reason="no SDF parser is installed"
)
def test_the_world_is_valid_for_the_parser():
    command = [
        shutil.which("gz") or shutil.which("ign"),
        "sdf",
        "-k",
        str(PACKAGE / "gazebo" / "world.sdf"),
    ]
    process = subprocess.run(command, capture_output=True, text=True, check=False)
    assert process.returncode == 0 and "Valid." in process.stdout, process.stdout + process.stderr


# A process that starts gets ports that no process of late had, and takes part by our profile of
# Fast DDS.

PROGRAM = """
import rclpy
from ros_bridge.transport.discovery import reserve_ports
rclpy.init()
with reserve_ports(3):
    node = rclpy.create_node("newcomer")
print("here", flush=True)
input()
"""


def free(port_number: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as socket_there:
        try:
            socket_there.bind(("", port_number))
        except OSError:
            return False
    return True


def test_ports_are_held_and_freed(monkeypatch: pytest.MonkeyPatch):
    with domain() as number:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        with reserve_ports(4) as first:
            assert len(first) == 4 and not any(map(free, first))
            # A process that starts at the same time is not driven further.
            with reserve_ports(6) as second:
                assert second == [port(number, 4), port(number, 5)]
        assert all(map(free, (*first, *second)))
        with reserve_ports() as drawn:
            assert len(drawn) < PORTS
        with reserve_ports(0) as nothing:
            assert nothing == []


@pytest.mark.parametrize("name", ["many", "-3", "", "232", "100000"])
def test_a_domain_that_ros_refuses_is_no_matter_here(name: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", name)
    with reserve_ports(3):
        pass


def test_a_process_gets_a_later_place():
    with domain() as number:
        environment = os.environ | {
            "ROS_DOMAIN_ID": str(number),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        with subprocess.Popen(
            [sys.executable, "-c", PROGRAM],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
            text=True,
        ) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == "here\n"
            in_use = [not free(port(number, place)) for place in range(6)]
            process.communicate("\n")
        assert in_use == [False, False, False, True, False, False]


def test_own_dds_profile_is_the_default(tmp_path: Path):
    environment = {"ROS_DOMAIN_ID": "7"}
    assert configure_dds(environment, tmp_path)
    assert environment == {
        "ROS_DOMAIN_ID": "7",
        "FASTDDS_DEFAULT_PROFILES_FILE": str(PROFILE),
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
    }


@pytest.mark.parametrize("name", CONFIGURED)
@pytest.mark.parametrize("value", ["", "theirs.xml"])
def test_dds_configuration_of_the_integrator_is_respected(name: str, value: str, tmp_path: Path):
    environment = {name: value}
    assert not configure_dds(environment, tmp_path)
    assert environment == {name: value}


@pytest.mark.parametrize("name", ["DEFAULT_FASTDDS_PROFILES.xml", "DEFAULT_FASTRTPS_PROFILES.xml"])
def test_profile_file_in_the_working_directory_is_respected(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / name).write_text("<dds/>")
    environment: dict[str, str] = {}
    assert not configure_dds(environment, tmp_path)
    monkeypatch.chdir(tmp_path)
    assert not configure_dds(environment)
    assert environment == {}


@pytest.mark.parametrize("is_chosen", [False, True])
def test_killed_node_leaves_no_port_in_shared_memory(
    is_chosen: bool, monkeypatch: pytest.MonkeyPatch
):
    """Unless the integrator wants one: a file in /dev/shm that nobody removes, and that holds the
    others up.
    """
    for name in CONFIGURED:
        monkeypatch.delenv(name, raising=False)
    if is_chosen:
        monkeypatch.setenv("FASTDDS_BUILTIN_TRANSPORTS", "DEFAULT")
    with domain() as number:
        process = Process("ros_bridge.runner", number)
        assert process.popen.stdout is not None
        try:
            # Fast DDS complains of a profile before the node is active.
            lines = (line.rstrip() for line in process.popen.stdout)
            began = next((line for line in lines if line.endswith("active") or "Error" in line), "")
            maps = Path(f"/proc/{process.popen.pid}/maps").read_text()
        finally:
            process.popen.kill()
            process.popen.communicate()
    assert began.endswith("active"), began
    assert ("fastdds_port" in maps) == is_chosen
