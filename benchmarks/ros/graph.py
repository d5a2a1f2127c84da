# pyright: reportMissingImports=false
"""What benchmarks on a real ROS graph share: processes, their memory, places and routes as
messages.
"""

import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from envs.formats.local_frame import LocalFrame
from envs.kinematics import VehicleState
from ros_bridge.transport.children import start_node

__all__ = [
    "FRAME",
    "ORIGIN",
    "PATIENCE",
    "ahead",
    "cores_stolen",
    "geodetic",
    "processor_time",
    "resident",
    "scheduling",
    "start",
    "way",
]

PATIENCE = 15.0
"""In which everything must happen, s."""

ORIGIN = (47.0, 8.0)
"""Of the geo-reference, degrees."""

FRAME = LocalFrame(*ORIGIN)


def start(module: str, *arguments: str) -> "subprocess.Popen[bytes]":
    """Start a process of the graph; a node of ours ends with this process."""
    if module.startswith("ros_bridge."):
        return start_node(module, *arguments)
    return subprocess.Popen([sys.executable, "-m", module, *arguments])


def ahead(state: VehicleState, time: float) -> VehicleState:
    """Return a state after flying straight on for a time, s."""
    far = state.speed * time
    return state._replace(
        x=state.x + far * math.cos(state.heading), y=state.y + far * math.sin(state.heading)
    )


def resident(process: "subprocess.Popen[bytes]") -> float:
    """Return the memory that a process keeps, MiB; nan where the system does not tell."""
    status = Path(f"/proc/{process.pid}/status")
    lines = status.read_text().splitlines() if status.exists() else []
    return next(
        (int(line.split()[1]) / 1024.0 for line in lines if line.startswith("VmRSS")), math.nan
    )


def processor_time(process: int) -> float:
    """Return the processor time that a process has had, s."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def scheduling(process: "subprocess.Popen[Any]") -> tuple[float, float]:
    """Return how long a process's threads have had a core, and how long they were ready and had
    none, s; or nan.
    """
    # Nanoseconds; the third figure counts the turns.
    times = [
        thread.read_text().split()
        for thread in Path(f"/proc/{process.pid}/task").glob("*/schedstat")
    ]
    if not times:
        return math.nan, math.nan
    return sum(int(one[0]) for one in times) * 1e-9, sum(int(one[1]) for one in times) * 1e-9


def cores_stolen() -> float:
    """Return what the machine's host has taken from all its cores since it started, s; nan where
    nobody tells.
    """
    counts = Path("/proc/stat")
    if not counts.exists():
        return math.nan
    return int(counts.read_text().split()[8]) / os.sysconf("SC_CLK_TCK")


def geodetic(state: VehicleState) -> tuple[tuple[float, float], float, float]:
    """Return latitude and longitude, and the velocity's east and north parts."""
    at = FRAME.geodetic(state.x, state.y)
    true = state.heading - float(at.convergence)
    return (
        (float(at.latitude), float(at.longitude)),
        state.speed * math.cos(true),
        state.speed * math.sin(true),
    )


def way(x: list[float], y: list[float]) -> list[Any]:
    """Return a route as waypoints."""
    from rlcas_msgs.msg import Waypoint

    at = FRAME.geodetic(x, y)
    places = zip(at.latitude.tolist(), at.longitude.tolist(), strict=True)
    return [
        Waypoint(index=n, latitude=latitude, longitude=longitude)
        for n, (latitude, longitude) in enumerate(places)
    ]
