"""A process that starts gets ports that no process of late had, and takes part by our profile of Fast DDS."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from ros_bridge.transport.discovery import CONFIGURED, PORTS, PROFILE, configure_dds, port, reserved_ports
from tests.ros_bridge.graph import MISSING, Process, domain

rclpy = pytest.importorskip("rclpy", reason=MISSING)

PROGRAM = """
import rclpy
from ros_bridge.transport.discovery import reserved_ports
rclpy.init()
with reserved_ports(3):
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
        with reserved_ports(4) as first:
            assert len(first) == 4 and not any(map(free, first))
            # A process that starts at the same time is not driven further.
            with reserved_ports(6) as second:
                assert second == [port(number, 4), port(number, 5)]
        assert all(map(free, (*first, *second)))
        with reserved_ports() as drawn:
            assert len(drawn) < PORTS
        with reserved_ports(0) as nothing:
            assert nothing == []


@pytest.mark.parametrize("name", ["many", "-3", "", "232", "100000"])
def test_a_domain_that_ros_refuses_is_no_matter_here(name: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", name)
    with reserved_ports(3):
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
def test_profile_file_in_the_working_directory_is_respected(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / name).write_text("<dds/>")
    environment: dict[str, str] = {}
    assert not configure_dds(environment, tmp_path)
    monkeypatch.chdir(tmp_path)
    assert not configure_dds(environment)
    assert environment == {}


@pytest.mark.parametrize("said", [False, True])
def test_killed_node_leaves_no_port_in_shared_memory(said: bool, monkeypatch: pytest.MonkeyPatch):
    """Unless the integrator wants one: a file in /dev/shm that nobody removes, and that holds the others up."""
    for name in CONFIGURED:
        monkeypatch.delenv(name, raising=False)
    if said:
        monkeypatch.setenv("FASTDDS_BUILTIN_TRANSPORTS", "DEFAULT")
    with domain() as number:
        process = Process("ros_bridge.runner", number)
        assert process.popen.stdout is not None
        try:
            # Fast DDS complains of a profile before the node is active.
            lines = (line.rstrip() for line in process.popen.stdout)
            began = next((line for line in lines if line.endswith("active") or "Error" in line), "")
            held = Path(f"/proc/{process.popen.pid}/maps").read_text()
        finally:
            process.popen.kill()
            process.popen.communicate()
    assert began.endswith("active"), began
    assert ("fastdds_port" in held) == said
