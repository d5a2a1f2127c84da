"""ICAROUS: where it is, what it is told, and a mission flown by it.

It is the user's: built from https://github.com/nasa/icarous in a folder of his own
(docs/reference/beside-others.md says how), nothing of it is part of this toolkit.
"""

import json
import math
import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.icarous import inside
from benchmarks.icarous.flights import Flight
from benchmarks.icarous.judge import Track
from benchmarks.icarous.missions import CLEARANCE, CRUISE, Mission
from commands.command import InputError
from commands.json_text import parse_json
from envs.aircraft import Aircraft
from envs.areas import Keep, Polygon
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.wind import Wind

VARIABLE = "ICAROUS_HOME"
"""Environment variable that names the folder."""

_HOW = "docs/reference/beside-others.md says how nasa/icarous is built"
_NEEDED = (
    "Modules/lib/libCognition.so",
    "Python/pycarous/SimEnvironment.py",
    "Python/pycarous/data/IcarousConfig.txt",
    ".venv/bin/python",
)
_HOME = 0.1, 10.0  # degrees: near the equator, where its headings of flight plans are true
_ALTITUDE = 100.0  # m, of all
_HIGH = 1_000.0  # m, of the cylinder: no aircraft gets past another above or below
_PATIENCE = 120  # s of computation that a mission may take
_OVER = tuple(f"default_det_1_WCV_{name}" for name in ("DTHR", "ZTHR", "TTHR", "TCOA"))


class Setting(NamedTuple):
    """What is chosen of ICAROUS's own, beside the numbers that both sides share."""

    look_ahead: float = 120.0  # s, of DAIDALUS
    fences_ahead: float = 30.0  # s along the plan, within which a fence is gone round
    alert: float = 60.0  # s before a loss, from which on it acts
    resolution: int = 2  # 0: speed, 1: altitude, 2: track, 4: by its search
    return_vector: bool = True  # back to the mission by headings, not by a plan
    capture: float = 2.0  # radius within which a waypoint is reached, s at the present speed


CHOSEN = Setting()
"""What is flown; docs/reference/beside-others.md says why."""


def locate(argument: str | None) -> Path:
    """Return the folder, from an argument or the environment variable.

    Raises:
        InputError: it is not named, or something of it is missing.
    """
    name = argument or os.environ.get(VARIABLE, "")
    if not name:
        raise InputError(
            f"ICAROUS is missing: expected --icarous DIR, or {VARIABLE} in the environment; {_HOW}"
        )
    folder = Path(name)
    for needed in _NEEDED:
        if not (folder / needed).exists():
            raise InputError(f"{name}: has no {needed}, expected ICAROUS as built; {_HOW}")
    if not list((folder / "Python/pycarous").glob("AutonomyStack*.so")):
        raise InputError(f"{name}: has no AutonomyStack, expected ICAROUS as built; {_HOW}")
    return folder.resolve()


def parameters(aircraft: Aircraft, setting: Setting) -> dict[str, str]:
    """Return what differs from the parameters that ICAROUS ships; they are in the docs."""
    limits = aircraft.limits
    separation = f"{aircraft.separation} [m]"
    return {
        "min_hs": f"{limits.speed_min} [m/s]",
        "max_hs": f"{limits.speed_max} [m/s]",
        "horizontal_accel": f"{limits.acceleration_max} [m/s^2]",
        "turn_rate": f"{math.degrees(limits.yaw_rate_max)} [deg/s]",
        "min_alt": f"{_ALTITUDE - 50.0} [m]",
        "max_alt": f"{_ALTITUDE + 50.0} [m]",
        "step_hs": "1.0 [m/s]",
        "default_load_core_detection_det_1": "gov.nasa.larcfm.ACCoRD.CDCylinder",
        "default_det_1_D": separation,
        "default_det_1_H": f"{_HIGH} [m]",
        "min_horizontal_recovery": separation,
        "min_vertical_recovery": f"{_HIGH} [m]",
        "lookahead_time": f"{setting.look_ahead} [s]",
        "default_alert_1_alerting_time": f"{setting.alert} [s]",
        "default_alert_1_early_alerting_time": f"{setting.alert} [s]",
        "plan_lookahead": f"{setting.fences_ahead} [s]",
        "daa_resolution_type": str(setting.resolution),
        "return_vector": str(setting.return_vector).lower(),
        "default_wp_speed": f"{CRUISE} [m/s]",
        "maintain_eta": "false",
        "capture_radius_scaling": str(setting.capture),
        "max_capture_radius": f"{aircraft.goal_radius} [m]",
        "obstacle_buffer": f"{CLEARANCE} [m]",
        "dubins_wellclear_radius": separation,
        "dubins_wellclear_height": f"{_HIGH} [m]",
        "record_daa_logs": "false",
        "tracker_log": "false",
    }


def configuration(shipped: str, changes: Mapping[str, str]) -> str:
    """Return a file of parameters: those of the one that ships, and the changes."""
    lines = [line.split("=") for line in shipped.splitlines() if "=" in line and line[0] != "#"]
    values = {line[0].strip(): line[1].strip() for line in lines}
    values = {key: value for key, value in values.items() if key not in _OVER} | dict(changes)
    return "".join(f"{key} = {value}\n" for key, value in values.items())


def fly(mission: Mission, aircraft: Aircraft, home: Path, setting: Setting = CHOSEN) -> Flight:
    """Fly a mission by ICAROUS in its own simulation.

    A flight that takes too long, or that ends with a fault, is one until there.

    Raises:
        InputError: it does not even begin.
    """
    source = home / "Python/pycarous"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "log").mkdir()
        shipped = (source / "data/IcarousConfig.txt").read_text(encoding="utf-8")
        text = configuration(shipped, parameters(aircraft, setting))
        (folder / "parameters.txt").write_text(text, encoding="utf-8")
        content = task(mission, aircraft, "parameters.txt")
        (folder / "mission.json").write_text(json.dumps(content), encoding="utf-8")
        shutil.copy(inside.__file__, folder / "inside.py")
        ended = _run(folder, home, source)
        return read_flight(folder / "flight.jsonl", home, ended)


def _run(folder: Path, home: Path, source: Path) -> str:
    """Run the program in a folder; return why it ended before its time, "" where it did not."""
    environment = os.environ | {
        VARIABLE: str(home),
        "LD_LIBRARY_PATH": str(home / "Modules/lib"),
        "PYTHONPATH": str(source),
    }
    command = [str(home / ".venv/bin/python"), "inside.py", "mission.json", "flight.jsonl"]
    process = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    if process.returncode == 0:
        return ""
    if process.returncode == -signal.SIGXCPU:
        return f"it did not answer within {_PATIENCE} s of computation"
    words = process.stderr.strip().splitlines() or [f"ended with {process.returncode}"]
    return words[-1]


def task(mission: Mission, aircraft: Aircraft, parameters_file: str) -> dict[str, Any]:
    """Return a mission as :mod:`benchmarks.icarous.inside` reads it."""
    wind = mission.wind
    return {
        "home": [*_HOME, 0.0],
        "altitude": _ALTITUDE,
        "cruise": CRUISE,
        "waypoints": mission.waypoints,
        "fences": [
            {
                "type": "KEEPOUT" if fence.keep is Keep.OUT else "KEEPIN",
                "places": fence.shape.outer if isinstance(fence.shape, Polygon) else (),
            }
            for fence in mission.fences
        ],
        "intruders": [_intruder(intruder, wind) for intruder in mission.intruders],
        "wind_from": _compass(-float(wind.east), -float(wind.north)),
        "wind_speed": float(wind.speed),
        "limit": mission.limit,
        "end": 0.5 * aircraft.goal_radius,
        "turn_rate": math.degrees(aircraft.limits.yaw_rate_max),
        "acceleration": aircraft.limits.acceleration_max,
        "parameters": parameters_file,
        "patience": _PATIENCE,
        "speed_min": aircraft.limits.speed_min,
        "speed_max": aircraft.limits.speed_max,
    }


def _intruder(state: VehicleState[Ground], wind: Wind) -> list[float]:
    """Return distance and bearing of an intruder from the start, altitude, and its speed and
    heading through the air, which carries it in the simulation; m, m/s, degrees.
    """
    east = state.speed * math.cos(state.heading) - float(wind.east)
    north = state.speed * math.sin(state.heading) - float(wind.north)
    place = math.hypot(state.x, state.y), _compass(state.x, state.y)
    return [*place, _ALTITUDE, math.hypot(east, north), _compass(east, north)]


def read_flight(path: Path, home: Path, ended: str) -> Flight:
    """Return the flight that is written in a file, as far as it goes."""
    lines = path.read_text(encoding="utf-8").split("\n")[:-1] if path.exists() else []
    rows = [parse_json(line) for line in lines]
    slowest = math.inf
    if rows and isinstance(rows[-1], dict):
        slowest = float(rows.pop()["slowest"])
    if len(rows) < 2:
        raise InputError(f"{home}: ICAROUS does not fly: {ended or 'it says nothing'}")
    table = np.array(rows, dtype=float)
    time, x, y = table[:, :3].T
    track = Track(time, x, y, table[:, 3::2], table[:, 4::2])
    return Flight(track, slowest, np.zeros(time.size, dtype=bool), ended)


def _compass(east: float, north: float) -> float:
    """Return a direction, degrees clockwise from north."""
    return math.degrees(math.atan2(east, north)) % 360.0
