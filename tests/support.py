"""Helpers of several rooms' tests: flights with trajectories, reports along geodesics, and recorded encounters."""

import gzip
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyproj import Geod

from agents.baselines.baselines import Sight
from envs.aircraft import PAPER, Aircraft
from envs.encounters import Encounter
from envs.observation import most_critical, observe
from envs.traffic.track_units import FOOT, KNOT
from eval.flights.simulate import Flights, fly
from eval.flights.trajectories import Trajectories, TrajectoryRecorder

__all__ = ["WGS84", "OnObservations", "case", "flight", "fly_recorded", "recorded", "reports_file"]


class OnObservations:
    """A decider made of a function from observations ``[M, 8]``, float32, to actions ``[M, 2]``."""

    def __init__(self, decide: Callable[[np.ndarray], np.ndarray]) -> None:
        self._decide = decide
        self.seen: list[np.ndarray] = []

    def decide(self, sight: Sight, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        chosen = most_critical(sight.own, sight.intruders, sight.mask, PAPER, np)
        self.seen.append(observe(sight.own, chosen, sight.goal_x, sight.goal_y, PAPER, np).astype(np.float32))
        return self._decide(self.seen[-1]).astype(float), memory


def fly_recorded(
    starts: Encounter, decider: Any, aircraft: Aircraft, noise: Any = None, *, endless: bool = False
) -> tuple[Flights, Trajectories]:
    """Return flights of encounters ``[N]`` and their trajectories."""
    recorder = TrajectoryRecorder(starts)
    return fly(starts, decider, aircraft, noise=noise, recorder=recorder, endless=endless), recorder.stack()


def recorded(name: str) -> Path:
    """Return the path of a file or folder of recorded data, or skip the test."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    path = Path(os.environ.get("RLCAS_DATA") or beside) / name
    if not path.exists():
        pytest.skip(f"{name} is not part of the project: set RLCAS_DATA to a folder that has it")
    return path


def case(name: str) -> Path:
    """Return the path of a synthetic case beside the recorded data, or skip the test."""
    path = recorded(".").parent / "cases" / name
    if not path.exists():
        pytest.skip(f"{name} is not part of the project: put it beside the folder of RLCAS_DATA")
    return path


WGS84 = Geod(ellps="WGS84")


def flight(
    name: str,
    latitude: float,
    longitude: float,
    track: float,
    *,
    speed: float = 80.0,
    altitude: Any = 3_000.0,
    climb: float = 0.0,
    seconds: int = 240,
    begin: float = 1_600_000_000.0,
    step: float = 1.0,
) -> list[dict[str, Any]]:
    """Return a report a second: degrees, m/s, ft, m/s; a flight that climbs begins at the altitude."""
    reports = []
    for after in np.arange(0.0, seconds + 0.5 * step, step):
        x, y, back = WGS84.fwd(longitude, latitude, track, speed * after)
        reports.append(
            {
                "icao24": name,
                "timestamp": 1_000.0 * (begin + after),
                "latitude": y,
                "longitude": x,
                "altitude": altitude(after) if callable(altitude) else altitude + climb * after / FOOT,
                "groundspeed": speed / KNOT,
                "track": (back + 180.0) % 360.0,
                "vertical_rate": climb * 60.0 / FOOT,
            }
        )
    return reports


def reports_file(folder: Path, *flights: list[dict[str, Any]], name: str = "adsb.json") -> Path:
    """Write reports of several flights, one after the other."""
    path = folder / name
    data = json.dumps([report for each in flights for report in each]).encode()
    path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    return path
