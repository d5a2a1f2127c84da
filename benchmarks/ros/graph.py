"""What benchmarks on a real ROS graph share: a domain, processes and their memory, places and
routes as messages.
"""

import math
import os
import subprocess
import sys
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from commands.command import require
from envs.formats.local_frame import LocalFrame
from envs.frames import Ground
from envs.kinematics import VehicleState
from ros_bridge.transport.children import free_domain, start_node

if TYPE_CHECKING:
    from builtin_interfaces.msg import Time
    from rlcas_msgs.msg import AircraftState, Waypoint

__all__ = [
    "FRAME",
    "ORIGIN",
    "PATIENCE",
    "Geodetic",
    "Scheduling",
    "advance",
    "cores_stolen",
    "exact_report",
    "geodetic",
    "own_domain",
    "resident_memory",
    "route_message",
    "scheduling",
    "start",
]

PATIENCE = 15.0
"""In which everything must happen, s."""

ORIGIN = (47.0, 8.0)
"""Of the geo-reference, degrees."""

FRAME = LocalFrame(*ORIGIN)


@contextmanager
def own_domain() -> Generator[None]:
    """Keep this process, and those that it starts, on a graph of their own on this machine; raise
    an InputError where there is no ROS.
    """
    require("the benchmark", "rclpy", "rlcas_msgs")
    with free_domain() as domain:
        os.environ |= {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        yield


def start(module: str, *arguments: str) -> "subprocess.Popen[bytes]":
    """Start a process of the graph; a node of ours ends with this process."""
    if module.startswith("ros_bridge."):
        return start_node(module, *arguments)
    return subprocess.Popen([sys.executable, "-m", module, *arguments])


def advance(state: VehicleState[Ground], time: float) -> VehicleState[Ground]:
    """Return a state after flying straight on for a time, s."""
    far = state.speed * time
    return state._replace(
        x=state.x + far * math.cos(state.heading), y=state.y + far * math.sin(state.heading)
    )


def resident_memory(process: "subprocess.Popen[bytes]") -> float:
    """Return the memory that a process keeps, MiB; nan where the system does not tell."""
    status = Path(f"/proc/{process.pid}/status")
    lines = status.read_text().splitlines() if status.exists() else []
    return next(
        (int(line.split()[1]) / 1024.0 for line in lines if line.startswith("VmRSS")), math.nan
    )


class Scheduling(NamedTuple):
    """What a process's threads together have had of the cores, s; nan where the system does not
    tell.
    """

    worked: float
    waited: float
    """How long they were ready and had no core."""


def scheduling(process: "subprocess.Popen[Any]") -> Scheduling:
    """Return what a process has had of the cores so far."""
    # Nanoseconds; the third figure counts the turns.
    times = [
        thread.read_text().split()
        for thread in Path(f"/proc/{process.pid}/task").glob("*/schedstat")
    ]
    if not times:
        return Scheduling(math.nan, math.nan)
    return Scheduling(
        sum(int(fields[0]) for fields in times) * 1e-9,
        sum(int(fields[1]) for fields in times) * 1e-9,
    )


def cores_stolen() -> float:
    """Return what the machine's host has taken from all its cores since it started, s; nan where
    the system does not tell.
    """
    counts = Path("/proc/stat")
    if not counts.exists():
        return math.nan
    return int(counts.read_text().split()[8]) / os.sysconf("SC_CLK_TCK")


class Geodetic(NamedTuple):
    """Where an aircraft is, degrees, and its velocity towards true east and north, m/s."""

    latitude: float
    longitude: float
    east: float
    north: float


def geodetic(state: VehicleState[Ground]) -> Geodetic:
    """Return a state of the local frame as reports have it."""
    at = FRAME.geodetic(state.x, state.y)
    true = state.heading - float(at.convergence)
    return Geodetic(
        float(at.latitude),
        float(at.longitude),
        state.speed * math.cos(true),
        state.speed * math.sin(true),
    )


def exact_report(name: str, state: VehicleState[Ground], stamp: "Time") -> "AircraftState":
    """Return an aircraft's report, without errors of place and velocity and in known still air."""
    from rlcas_msgs.msg import AircraftState

    where = geodetic(state)
    always_valid = AircraftState.VALID_POSITION | AircraftState.VALID_VELOCITY
    exact = (
        AircraftState.VALID_POSITION_STD
        | AircraftState.VALID_VELOCITY_STD
        | AircraftState.VALID_WIND
    )
    message = AircraftState(
        id=name, valid=always_valid | exact, latitude=where.latitude, longitude=where.longitude
    )
    message.header.stamp = stamp
    message.velocity.x, message.velocity.y = where.east, where.north
    return message


def route_message(x: Sequence[float], y: Sequence[float]) -> "list[Waypoint]":
    """Return a route through places of the local frame, m, as waypoints."""
    from rlcas_msgs.msg import Waypoint

    at = FRAME.geodetic(list(x), list(y))
    places = zip(at.latitude.tolist(), at.longitude.tolist(), strict=True)
    return [
        Waypoint(index=n, latitude=latitude, longitude=longitude)
        for n, (latitude, longitude) in enumerate(places)
    ]
