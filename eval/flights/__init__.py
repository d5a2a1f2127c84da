"""Encounters flown: by a policy, by plans, under the monitor."""

from eval.flights.chunks import Evaluation, Pilot, columns
from eval.flights.recorded import fly_recorded
from eval.flights.simulate import Flights, direct, fly
from eval.flights.trajectories import Trajectories, TrajectoryRecorder

__all__ = [
    "Evaluation",
    "Flights",
    "Pilot",
    "Trajectories",
    "TrajectoryRecorder",
    "columns",
    "direct",
    "fly",
    "fly_recorded",
]
