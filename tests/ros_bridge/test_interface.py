"""What others rely on: parameters, public names, codes of messages, the page about ROS graphs."""

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

from tests.ros_bridge.graph import MISSING, ROOT, Process, domain

pytest.importorskip("rclpy", reason=MISSING)

from rclpy.exceptions import ParameterException
from rlcas_msgs.msg import AircraftState, Trajectory
from rlcas_msgs.srv import GenerateTrajectory

from ros_bridge.core.situation import Code
from ros_bridge.nodes.monitor import Monitor
from ros_bridge.nodes.runner import Runner
from ros_bridge.transport import parameters
from ros_bridge.transport.overrides import refuse_unknown_nodes
from ros_bridge.transport.recording import TOPICS
from tests.ros_bridge.graph import beside

DOCS = Path(__file__).resolve().parents[2] / "docs" / "reference" / "ros-parameters.md"


def test_the_docs_are_current():
    wanted = "expected the output of `python -m ros_bridge.transport.parameters` in docs/reference/ros-parameters.md"
    assert parameters.reference() in DOCS.read_text(encoding="utf-8"), wanted


def test_the_layout_for_viewers_names_what_is_recorded():
    layout = json.loads((DOCS.parents[1] / "assets" / "foxglove-layout.json").read_text(encoding="utf-8"))
    recorded = {f"/{name.removeprefix('/')}": kind for kind, name, _ in TOPICS}
    panels = layout["configById"]
    shown = [*panels["3D!plan"]["topics"], panels["DiagnosticSummary!health"]["topicToRender"]]
    assert set(shown) <= set(recorded)
    values = [path["value"] for panel in panels.values() for path in panel.get("paths", [])]
    assert len(values) == 5
    for topic, _, field in (value.rpartition(".") for value in values):
        assert field in recorded[topic].get_fields_and_field_types()
    placed = re.findall(r'"(\w+!\w+)"', json.dumps(layout["layout"]))
    assert sorted(placed) == sorted(panels)


@pytest.mark.parametrize("node", parameters.NODES)
def test_defaults_lie_in_their_ranges_and_names_are_unique(node: str):
    every = list(parameters.of(node))
    numbers = [one for one in every if one.low is not None and not isinstance(one.default, str)]
    assert all(one.low <= one.default <= one.high and one.meaning for one in numbers)
    assert len({one.name for one in every}) == len(every)


@pytest.mark.parametrize("given", [{"separaton": 2000.0}, {"marign": 500.0}, {"margin": math.nan}])
def test_unknown_and_undefined_values_are_refused_by_name(given: dict[str, float]):
    with pytest.raises((ValueError, ParameterException), match=next(iter(given))), beside(Monitor, **given):
        pass


def test_parameters_of_the_node_itself_are_taken():
    with beside(Monitor, margin=40.0, use_sim_time=False) as (node, _):
        assert node.get_parameter("margin").value == 40.0


@pytest.mark.parametrize("node", [Runner, Monitor])
def test_default_margin_is_an_aircrafts(node: Any):
    with beside(node) as (made, _):
        assert made.get_parameter("margin").value == 145.0


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("/**/rlcas_runer:\n  ros__parameters: {margin: 50.0}", "rlcas_runer"),
        ("n123:\n  rlcas_montor:\n    ros__parameters: {margin: 50.0}", "rlcas_montor"),
        ("/**/rlcas_translator_2:\n  ros__parameters: {own_id: a}", ""),
        ("a: {b: [1, {c: d}], e: &x f}\n/rlcas_runr:\n  ros__parameters: {list: [1, 2], other: *x}", "rlcas_runr"),
        ("{a: " * 3000 + "1" + "}" * 3000, ""),
        ("/n123/rlcas_runner:\n  ros__parameters: {margin: 50.0}\n/other:\n  ros__parameters: {a: 1}", ""),
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
    with pytest.raises(ValueError, match=f"parameters for {wrong}, which is no node; the nearest is rlcas_"):
        refuse_unknown_nodes(arguments, names)


def test_a_named_pipe_is_no_parameter_file(tmp_path: Path):
    os.mkfifo(pipe := tmp_path / "pipe.yaml")
    with pytest.raises(ValueError, match="not a regular file"):
        refuse_unknown_nodes(["--ros-args", "--params-file", str(pipe)], [])


def test_argument_for_an_unknown_node_is_refused():
    names = [f"rlcas_{name}" for name in parameters.NODES]
    refuse_unknown_nodes(["--ros-args", "-p", "rlcas_runner:margin:=50.0", "-p", "policy_file:=a:b"], names)
    with pytest.raises(ValueError, match="for rlcas_runer, which is no node; the nearest is rlcas_runner"):
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
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--bogus"], "unrecognized arguments: --bogus"),
        (
            ["--ros-args", "-p", "separaton:=2000.0"],
            "separaton is no parameter of rlcas_runner; the nearest is separation",
        ),
        (["--ros-args", "-p", "policy_sha256:=" + 32 * "ab"], "policy_sha256 is 'abab"),
        (["--ros-args", "-p", "separation:=0.0"], "separation out of range"),
        pytest.param(["--ros-args", "-p", "separation:=many"], "separation", marks=pytest.mark.slow),
        (["--ros-args", "-p", "policy_file:=/nowhere/policy"], "no such policy file"),
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
        output, _ = process.popen.communicate(timeout=15.0)
    assert process.popen.returncode == 2
    assert says in output
    assert "Traceback" not in output


def test_messages_hold_what_the_conversions_expect():
    from ros_bridge.core import conversions as read

    bits = [name for name in dir(AircraftState) if name.startswith("VALID_")]
    assert sorted(getattr(AircraftState, name) for name in bits) == [1 << n for n in range(8)]
    assert AircraftState.VALID_WIND == read.WIND and AircraftState.VALID_POSITION_STD == read.POSITION_STD
    for name in ("SAFE", "ROUTE", "BACKUP"):
        assert getattr(Trajectory, f"STATUS_{name}") == getattr(read, f"STATUS_{name}")
    codes = {
        name.removeprefix("STATUS_"): getattr(GenerateTrajectory.Response, name)
        for name in dir(GenerateTrajectory.Response)
        if name.startswith("STATUS_")
    }
    assert codes == {code.name: code.value for code in Code}


# The node on the page about ROS graphs of one's own runs, and the runner answers it as the page says.
PAGE = (ROOT / "docs" / "howto" / "own-ros-graph.md").read_text(encoding="utf-8")
PROGRAM = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)[0]
PRINTED = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)
OWN = '        self.own.publish(aircraft("own", now, 80.0 * seconds, 80.0))\n'


@pytest.mark.slow
@pytest.mark.parametrize(("left_out", "printed"), [("", PRINTED[0]), (OWN, PRINTED[1])], ids=["whole", "no ownship"])
def test_the_program_of_the_page_gets_the_answers_of_the_page(left_out: str, printed: str, tmp_path: Path) -> None:
    assert left_out in PROGRAM
    (tmp_path / "ask.py").write_text(PROGRAM.replace(left_out, "") if left_out else PROGRAM, encoding="utf-8")
    with domain() as number:
        Process("ros_bridge.runner", number)
        environment = os.environ | {
            "ROS_DOMAIN_ID": str(number),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "PYTHONPATH": str(ROOT),
        }
        done = subprocess.run(
            [sys.executable, "ask.py"],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    assert done.returncode == 0, done.stderr
    # Some metres depend on when the request is made.
    assert re.sub(r"\d+ m ", "m ", done.stdout) == re.sub(r"\d+ m ", "m ", printed)
