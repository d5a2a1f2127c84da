"""What a policy should have done instead: its own late flights, flown on from moments after a while of other commands.

Where an intruder flies beside the route, a policy must outpace it or let it pass. Both are soon too far apart for an
exploration of single commands to come from one to the other. Here one command is kept to for :data:`WHILE`, the policy
flies on, and the flight tells which is better: policy improvement by rollouts (Bertsekas 2020).
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from agents.baselines.baselines import Sight
from envs.encounters import Encounter
from envs.kinematics import Limits
from envs.observation import CRITICAL_RADIUS, most_critical, observe
from envs.outcome import Rules
from envs.trees import take
from eval.flights.simulate import OUTCOMES, Decider, Flights, OnStates, fly
from eval.flights.trajectories import Trajectories
from eval.practice_flights import beginning_at

__all__ = ["MOMENTS", "WHILE", "Branches", "branched"]

MOMENTS = (0.0, 10.0, 20.0, 35.0, 50.0, 70.0, 90.0)
"""At which a flight is branched, s after its start."""

WHILE = 15.0
"""How long a branch keeps to its commands, s."""

_COMMANDS = tuple((throttle, turn) for throttle in (-1.0, 1.0) for turn in (math.nan, 0.0, 0.5, -0.5))
"""Acceleration and yaw rate of the branches, 1 at the limit; the turn is the policy's where it is not a number."""

_OF_EACH = 2
"""Branches kept of each flight, the best: examples of all moments of one flight tell the same."""

_SPARE = 40.0
"""Beyond the separation that a branch keeps, m: who imitates it is off by some metres."""

_ENDS_IN = 30.0
"""How long a flight goes on at least after a moment at which it is branched, s."""


class Branches(NamedTuple):
    """The branches of late flights that are worth most."""

    of: np.ndarray
    """Rows of the flights, ``[B]``."""
    time: np.ndarray
    """Where each begins, s after the start."""
    saved: np.ndarray
    """How much sooner it arrives, s; a flight that does not arrive counts as long as the task allows."""
    observation: np.ndarray
    """What is seen in its commanded seconds, float32 ``[M, 8]``."""
    action: np.ndarray
    """What is done in them, float32 ``[M, 2]``."""


class _Commanded(NamedTuple):
    """A decider that keeps to a command for a while and then does what the policy does."""

    policy: Decider
    throttle: float
    turn: float
    until_left: float
    """Time that is left of the task when the command ends, s."""

    def decide(self, sight: Sight, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return actions ``[M, 2]``; nothing is remembered."""
        seen = most_critical(sight.own, sight.intruders, sight.mask, CRITICAL_RADIUS, np)
        observation = observe(sight.own, seen, sight.goal_x, sight.goal_y, np).astype(np.float32)
        action = self.policy(observation).astype(np.float64)
        if sight.left > self.until_left:
            action[:, 0] = self.throttle
            if not math.isnan(self.turn):
                action[:, 1] = self.turn
        return action, memory


def branched(
    encounters: Encounter,
    flights: Flights,
    film: Trajectories,
    policy: Decider,
    rules: Rules,
    limits: Limits,
    *,
    least: float,
    progress: Callable[[int], None] = lambda done: None,
) -> Branches:
    """Return the branches that save most of flights ``[N]``.

    Args:
        encounters: the starts, float64.
        flights: how the policy ended them; those without a violation are branched, where no intruder turns any more.
        film: of the flights.
        policy: that flew them.
        rules: of the task.
        limits: of the ownship.
        least: what a branch saves at least, s.
        progress: told after each of the commands how many are flown.
    """
    rows, times = (axis.ravel() for axis in np.meshgrid(np.arange(len(flights.outcome)), MOMENTS, indexing="ij"))
    goes_on = times <= flights.duration[rows] - _ENDS_IN
    goes_on &= flights.outcome[rows] != OUTCOMES.index("violation")
    rows, times = rows[goes_on], times[goes_on]
    starts, fit = beginning_at(take(encounters, rows), film, np.rint(times / rules.dt).astype(int), rows, rules)
    # A branch knows before a turn what nobody can see.
    fit &= np.all(~starts.mask | (starts.intent.heading_change == 0.0), axis=-1)
    rows, times, starts = rows[fit], times[fit], take(starts, fit)
    seconds = int(WHILE / rules.dt)
    before = flights.duration[rows] - times
    best = np.full(len(rows), -np.inf)
    observation, action = np.zeros((len(rows), seconds, 8), np.float32), np.zeros((len(rows), seconds, 2), np.float32)
    for number, (throttle, turn) in enumerate(_COMMANDS):
        decider = OnStates(_Commanded(policy, throttle, turn, rules.t_max - WHILE))
        flown, seen = fly(starts, decider, rules, limits, record=True)
        assert seen is not None
        works = (flown.outcome == OUTCOMES.index("reached")) & (flown.min_separation >= rules.separation + _SPARE)
        saved = np.where(works & (flown.duration > WHILE), before - flown.duration, -np.inf)
        better = np.flatnonzero(saved > best)
        best[better] = saved[better]
        observation[better] = np.moveaxis(seen.observation[:seconds, better], 0, 1)
        action[better] = np.moveaxis(seen.action[:seconds, better], 0, 1)
        progress(number + 1)
    kept = _best_of_each(rows, best, least)
    return Branches(rows[kept], times[kept], best[kept], observation[kept].reshape(-1, 8), action[kept].reshape(-1, 2))


def _best_of_each(rows: np.ndarray, saved: np.ndarray, least: float) -> np.ndarray:
    """Return which branches are among the best of their flight and save enough, in the order of the flights."""
    order = np.lexsort((-saved, rows))
    first = np.r_[True, np.diff(rows[order]) > 0] if len(order) else np.zeros(0, bool)
    rank = np.arange(len(order)) - np.maximum.accumulate(np.where(first, np.arange(len(order)), 0))
    return order[(rank < _OF_EACH) & (saved[order] >= least)]
