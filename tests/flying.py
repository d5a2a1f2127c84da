"""Flights with their trajectories, for tests."""

from typing import Any

from envs.encounters import Encounter
from envs.kinematics import Limits
from envs.outcome import Rules
from eval.flights.simulate import Flights, fly
from eval.flights.trajectories import Trajectories, TrajectoryRecorder


def fly_recorded(
    starts: Encounter, decider: Any, rules: Rules, limits: Limits, noise: Any = None
) -> tuple[Flights, Trajectories]:
    """Return flights of encounters ``[N]`` and their trajectories."""
    recorder = TrajectoryRecorder(starts)
    return fly(starts, decider, rules, limits, noise=noise, recorder=recorder), recorder.stack()
