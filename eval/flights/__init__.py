"""Encounters flown: by a policy, by plans, under the monitor."""

from eval.flights.chunks import Evaluation, ReadyEvaluation, columns
from eval.flights.recorded import fly_recorded
from eval.flights.simulate import Flights, Unmitigated, fly
from eval.flights.trajectories import Trajectories, TrajectoryRecorder

__all__ = [
    "Evaluation",
    "Flights",
    "ReadyEvaluation",
    "Trajectories",
    "TrajectoryRecorder",
    "Unmitigated",
    "columns",
    "fly",
    "fly_recorded",
]
