"""Encounters flown: by a policy, by plans, under the monitor."""

from eval.flights.chunks import Evaluation, ReadyEvaluation, columns
from eval.flights.recorded import fly_recorded
from eval.flights.simulate import Direct, Flights, fly
from eval.flights.trajectories import Trajectories, TrajectoryRecorder

__all__ = [
    "Direct",
    "Evaluation",
    "Flights",
    "ReadyEvaluation",
    "Trajectories",
    "TrajectoryRecorder",
    "columns",
    "fly",
    "fly_recorded",
]
