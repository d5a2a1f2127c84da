"""Helpers of several rooms' tests: flights with trajectories, and recorded encounters that are not in the project."""

import os
from pathlib import Path
from typing import Any

import pytest

from envs.encounters import Encounter
from envs.kinematics import Limits
from envs.outcome import Rules
from eval.flights.simulate import Flights, fly
from eval.flights.trajectories import Trajectories, TrajectoryRecorder

__all__ = ["case", "fly_recorded", "recorded"]


def fly_recorded(
    starts: Encounter, decider: Any, rules: Rules, limits: Limits, noise: Any = None
) -> tuple[Flights, Trajectories]:
    """Return flights of encounters ``[N]`` and their trajectories."""
    recorder = TrajectoryRecorder(starts)
    return fly(starts, decider, rules, limits, noise=noise, recorder=recorder), recorder.stack()


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
