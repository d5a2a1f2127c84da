"""Least-cost witnesses as flights: the shortest ones known that resolve each encounter.

A reference for resolvers, no resolver: the search knows the true motion of the intruders to the
end.
"""

from typing import NamedTuple

import numpy as np

from agents.baselines.baselines import BASELINES, Observation
from agents.manoeuvres.escape_manoeuvre import Counting, Manoeuvre, choose_action, takeoff
from agents.resolvability.witness import least_cost
from envs.aircraft import Aircraft
from envs.encounters import Encounter
from envs.frames import Air
from envs.trees import map_leaves, scatter, take
from eval.flights.simulate import Flights, fly
from eval.flights.trajectories import Trajectories, TrajectoryRecorder

ROUNDS = 8
"""Of the witness's refinement: 1.4 m longer than 40 on average (300 circle encounters), in a third
of the time.
"""


class WitnessSearch(NamedTuple):
    """Effort of the search for the least-cost witness of each encounter."""

    rounds: int = ROUNDS  # of its refinement


class Witness:
    """Manoeuvres ``[N]`` as a resolver of one flight of each of N encounters, which it remembers by
    number.

    Where none is known, the flight is that without a resolver, straight along the route at constant
    speed.
    """

    def __init__(
        self, encounters: Encounter, manoeuvre: Manoeuvre, exists: np.ndarray, aircraft: Aircraft
    ) -> None:
        """Take the manoeuvres of encounters ``[N]``, and which exist, bool ``[N]``."""
        self._flight = map_leaves(np.array, takeoff(encounters.own, manoeuvre))
        self._manoeuvre = manoeuvre
        self._exists = exists
        self._none = BASELINES["none"](aircraft)
        self._aircraft = aircraft
        self._step = 0

    def decide(self, observation: Observation, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return actions ``[M, 2]`` and the numbers of the encounters."""
        number = np.arange(len(memory)) if self._step == 0 else memory
        action, _ = self._none.decide(observation, memory)
        rows = np.flatnonzero(self._exists[number])
        encounters = number[rows]
        flight = take(self._flight, encounters)._replace(own=take(observation.own, rows))
        command, after = choose_action(
            flight,
            take(self._manoeuvre, encounters),
            self._step * self._aircraft.dt,
            (observation.goal_x[rows], observation.goal_y[rows]),
            take(observation.intruders, rows),
            take(Counting(observation.mask, observation.distance_scale), rows),
            self._aircraft.rules(),
            self._aircraft.limits,
        )
        action[rows] = np.stack(command, axis=-1)
        scatter(self._flight, encounters, after)
        self._step += 1
        return action, number


def fly_witnesses(
    encounters: Encounter, search: WitnessSearch, aircraft: Aircraft
) -> tuple[Flights, Trajectories[Air]]:
    """Fly the least-cost witnesses of encounters ``[N]``, float64, until the goal or the time
    limit.
    """
    best = least_cost(encounters, aircraft.rules(), aircraft.limits, rounds=search.rounds)
    recorder = TrajectoryRecorder(encounters)
    resolver = Witness(encounters, best.manoeuvre, np.isfinite(best.arrival), aircraft)
    flights = fly(encounters, resolver, aircraft, recorder=recorder, endless=True)
    return flights, recorder.stack()
