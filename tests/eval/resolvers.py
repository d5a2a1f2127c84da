"""Resolvers for tests, and their flights with trajectories."""

from collections.abc import Callable
from typing import Any

import numpy as np

from agents.baselines.baselines import Observation
from envs.aircraft import PAPER, Aircraft
from envs.encounters import Encounter
from envs.observation import most_critical, observe
from eval.flights.simulate import Flights, fly
from eval.flights.trajectories import Trajectories, TrajectoryRecorder


class OnObservations:
    """A resolver made of a function from observations ``[M, 8]``, float32, to actions ``[M, 2]``."""

    def __init__(self, decide: Callable[[np.ndarray], np.ndarray]) -> None:
        self._decide = decide
        self.seen: list[np.ndarray] = []

    def decide(self, observation: Observation, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        chosen = most_critical(observation.own, observation.intruders, observation.mask, PAPER, np)
        self.seen.append(
            observe(
                observation.own, chosen, observation.goal_x, observation.goal_y, PAPER, np
            ).astype(np.float32)
        )
        return self._decide(self.seen[-1]).astype(float), memory


def fly_recorded(
    starts: Encounter,
    resolver: Any,
    aircraft: Aircraft,
    noise: Any = None,
    *,
    endless: bool = False,
) -> tuple[Flights, Trajectories]:
    """Return flights of encounters ``[N]`` and their trajectories."""
    recorder = TrajectoryRecorder(starts)
    return fly(
        starts, resolver, aircraft, noise=noise, recorder=recorder, endless=endless
    ), recorder.stack()
