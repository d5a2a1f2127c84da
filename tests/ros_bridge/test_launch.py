"""Launch files, world and bridge: what they name exists. Run by ROS where it is installed, else by stand-ins."""

import importlib.util
import runpy
import shutil
import subprocess
import sys
import types
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.ros_bridge.graph import MISSING

pytest.importorskip("rclpy", reason=MISSING)

import yaml

from agents.assurance.thresholds import Thresholds
from agents.config.load import load
from agents.planner.request import Options
from envs.kinematics import SURROGATE, within
from eval.hifi.config import HifiConfig
from ros_bridge.transport import parameters
from ros_bridge.transport.settings import monitor_thresholds, planning_settings, vehicle_limits

PACKAGE = Path(parameters.__file__).parents[1]
LAUNCH = sorted((PACKAGE / "launch").glob("*.launch.py"))
DECLARED = {
    f"rlcas_{name}": {one.name for one in numbers} | {one for one, *_ in others} | {"use_sim_time"}
    for name, numbers, others in parameters.NODES
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
        "launch.actions": dict.fromkeys(("DeclareLaunchArgument", "OpaqueFunction", "Shutdown"), _Action),
        "launch.substitutions": {"LaunchConfiguration": _Value},
        "launch_ros": {},
        "launch_ros.actions": {"Node": _Action},
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
    context = {one.given[0]: one.named["default_value"] for one in declared}
    assert all(one.named["description"] for one in declared)
    assert {"namespace", "use_sim_time", "params_file"} <= set(context)
    context |= {"params_file": params_file, "namespace": "n123"}
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
    shared = ("separation", "margin", "sigmas")
    first, second = ({name: node.named["parameters"][0][name] for name in shared} for node in nodes[:2])
    assert first == second


@pytest.mark.skipif(importlib.util.find_spec("launch_ros") is None, reason="launch_ros is not installed")
@pytest.mark.parametrize("file", LAUNCH, ids=lambda file: file.name)
def test_launch_files_are_understood_by_ros(file: Path):
    from launch import LaunchContext

    description = runpy.run_path(str(file))["generate_launch_description"]()
    context = LaunchContext()
    for entity in description.entities:
        entity.execute(context)


@pytest.mark.parametrize("file", ["parameters.yaml", "c208.yaml"])
def test_params_files_name_parameters_that_exist(file: str):
    given = yaml.safe_load((PACKAGE / "launch" / file).read_text(encoding="utf-8"))
    ranges = {f"rlcas_{name}": {one.name: one for one in numbers} for name, numbers, _ in parameters.NODES}
    for pattern, content in given.items():
        node = pattern.removeprefix("/**/")
        for name, value in content["ros__parameters"].items():
            assert name in DECLARED[node]
            if name in ranges[node]:
                assert ranges[node][name].low <= value <= ranges[node][name].high


def test_the_aircraft_in_flight_is_that_of_the_evaluations():
    given = yaml.safe_load((PACKAGE / "launch" / "c208.yaml").read_text(encoding="utf-8"))
    runner, monitor = (given[f"/**/rlcas_{name}"]["ros__parameters"] for name in ("runner", "monitor"))
    assert runner == monitor
    config = load(HifiConfig, PACKAGE.parent / "configs" / "flight_c208.yaml")
    assert runner["margin"] == config.planner.margin
    vehicle = config.planner.setting().limits
    assert vehicle_limits(runner.__getitem__) == (vehicle, within(SURROGATE, vehicle))
    for name, read in (("runner", lambda node: planning_settings(node).options), ("monitor", monitor_thresholds)):
        _, numbers, others = next(one for one in parameters.NODES if one[0] == name)
        values = {one.name: one.default for one in numbers} | {each: default for each, default, _ in others} | runner
        node = types.SimpleNamespace(
            get_parameter=lambda each, values=values: types.SimpleNamespace(value=values[each])
        )
        assert read(node).limits == vehicle
        assert read(node).manoeuvre.speed_max <= vehicle.speed_max
        assert read(node).requirement.margin == config.planner.margin


def test_default_limits_are_the_papers_vehicle():
    given = {one.name: one.default for one in parameters.NUMBERS}
    assert vehicle_limits(given.__getitem__) == (Options().limits, Thresholds().manoeuvre)
    with pytest.raises(ValueError, match="speed_min, speed_max: allows 99 to 99\\.5 m/s; expected a range"):
        vehicle_limits((given | {"speed_min": 99.0, "speed_max": 99.5}).__getitem__)


def test_the_bridge_names_topics_of_the_world():
    root = ET.parse(PACKAGE / "gazebo" / "world.sdf").getroot()
    topics = {f"/{one.text}" for tag in ("topic", "odom_topic") for one in root.iter(tag)}
    topics.add(f"/world/{root.find('world').attrib['name']}/clock")
    bridge = yaml.safe_load((PACKAGE / "gazebo" / "bridge.yaml").read_text(encoding="utf-8"))
    assert {one["gz_topic_name"] for one in bridge} == topics
    keys = {"ros_topic_name", "gz_topic_name", "ros_type_name", "gz_type_name", "direction"}
    assert all(set(one) == keys for one in bridge)


@pytest.mark.skipif(shutil.which("ign") is None and shutil.which("gz") is None, reason="no SDF parser is installed")
def test_the_world_is_valid_for_the_parser():
    command = [shutil.which("gz") or shutil.which("ign"), "sdf", "-k", str(PACKAGE / "gazebo" / "world.sdf")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "Valid." in done.stdout, done.stdout + done.stderr
