"""The parameters in the docs are those that the nodes declare."""

from pathlib import Path

import pytest

from tests.ros_bridge.graph import MISSING

pytest.importorskip("rclpy", reason=MISSING)

from ros_bridge.transport import parameters

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
