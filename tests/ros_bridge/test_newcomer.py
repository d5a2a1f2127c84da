"""A process that starts gets ports that no process of late had."""

import os
import socket
import subprocess
import sys

import pytest

from ros_bridge.newcomer import PORTS, apart, port
from tests.ros_bridge.graph import MISSING, domain

rclpy = pytest.importorskip("rclpy", reason=MISSING)

PROGRAM = """
import rclpy
from ros_bridge.newcomer import apart
rclpy.init()
with apart(3):
    node = rclpy.create_node("newcomer")
print("here", flush=True)
input()
"""


def free(there: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        try:
            one.bind(("", there))
        except OSError:
            return False
    return True


def test_ports_are_held_and_freed(monkeypatch: pytest.MonkeyPatch):
    with domain() as number:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        with apart(4) as first:
            assert len(first) == 4 and not any(map(free, first))
            # Who starts at the same time is not driven further.
            with apart(6) as second:
                assert second == [port(number, 4), port(number, 5)]
        assert all(map(free, (*first, *second)))
        with apart() as drawn:
            assert len(drawn) < PORTS
        with apart(0) as nothing:
            assert nothing == []


@pytest.mark.parametrize("name", ["many", "-3", "", "232", "100000"])
def test_a_domain_that_ros_refuses_is_no_matter_here(name: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", name)
    with apart(3):
        pass


def test_a_process_gets_a_later_place():
    with domain() as number:
        environment = os.environ | {"ROS_DOMAIN_ID": str(number), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        with subprocess.Popen(
            [sys.executable, "-c", PROGRAM], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, text=True
        ) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == "here\n"
            taken = [not free(port(number, place)) for place in range(6)]
            process.communicate("\n")
        assert taken == [False, False, False, True, False, False]
