"""Parameters: the docs name those that are declared, and nothing else can be given."""

import math
import os
from pathlib import Path
from typing import Any

import pytest

from tests.ros_bridge.graph import MISSING

pytest.importorskip("rclpy", reason=MISSING)

from rclpy.exceptions import ParameterException

from ros_bridge.nodes.monitor import Monitor
from ros_bridge.nodes.runner import Runner
from ros_bridge.transport import parameters
from ros_bridge.transport.overrides import refuse_unknown_nodes
from tests.ros_bridge.inside import beside

DOCS = Path(__file__).resolve().parents[2] / "docs" / "reference" / "ros-parameters.md"


def test_the_docs_are_current():
    wanted = "expected the output of `python -m ros_bridge.transport.parameters` in docs/reference/ros-parameters.md"
    assert parameters.reference() in DOCS.read_text(encoding="utf-8"), wanted


@pytest.mark.parametrize("node", parameters.NODES, ids=lambda node: node[0])
def test_defaults_lie_in_their_ranges_and_names_are_unique(node):
    _, numbers, others = node
    assert all(one.low <= one.default <= one.high and one.meaning for one in numbers)
    names = [one.name for one in numbers] + [name for name, *_ in others]
    assert len(set(names)) == len(names)


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
        assert made.get_parameter("margin").value == parameters.MARGIN > 100.0


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
    names = [f"rlcas_{name}" for name, *_ in parameters.NODES]
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
    names = [f"rlcas_{name}" for name, *_ in parameters.NODES]
    refuse_unknown_nodes(["--ros-args", "-p", "rlcas_runner:margin:=50.0", "-p", "policy_file:=a:b"], names)
    with pytest.raises(ValueError, match="for rlcas_runer, which is no node; the nearest is rlcas_runner"):
        refuse_unknown_nodes(["--ros-args", "-p", "/n1/rlcas_runer:margin:=50.0"], names)
