"""Least-cost witnesses as flights: the shortest ones known that resolve each encounter.

A reference for deciders, no resolver: the search knows the true motion of the intruders to the end.
"""

from typing import NamedTuple

import numpy as np

from agents.baselines.baselines import BASELINES
from agents.manoeuvres.escape_manoeuvre import Manoeuvre, fly, steps, takeoff, tracks
from agents.resolvability.witness import least_cost
from envs.aircraft import Aircraft
from envs.angles import wrap
from envs.encounters import Encounter
from envs.relative import distance, leg_separation
from envs.trees import column, mapped, take
from eval.flights import simulate
from eval.flights.simulate import OUTCOMES, Flights, reversal_rate, turned_to
from eval.flights.trajectories import Trajectories, TrajectoryRecorder

ROUNDS = 8
"""Of the witness's refinement: 1.4 m longer than 40 on average (300 circle encounters), in a third of the time."""


class WitnessSearch(NamedTuple):
    """Effort of the search for the least-cost witness of each encounter."""

    rounds: int = ROUNDS  # of its refinement


def fly_witnesses(encounters: Encounter, search: WitnessSearch, aircraft: Aircraft) -> tuple[Flights, Trajectories]:
    """Fly the least-cost witnesses of encounters ``[N]``, float64, until the goal or the time limit.

    Where no witness is known, the flight is that without a resolver, straight along the route at constant speed, which
    goes on after a loss.
    """
    rules, limits = aircraft.rules(), aircraft.limits
    best = least_cost(encounters, rules, limits, rounds=search.rounds)
    known = np.isfinite(best.arrival)
    solved, left = np.flatnonzero(known), np.flatnonzero(~known)
    witnesses = followed(take(encounters, solved), take(best.manoeuvre, solved), aircraft)
    resolving = ended(take(encounters, solved), witnesses, aircraft)

    others = take(encounters, left)
    unresolved = BASELINES["none"](aircraft)
    recorder = TrajectoryRecorder(others)
    straight = simulate.fly(others, unresolved, aircraft, recorder=recorder, endless=True)

    def rows(first: np.ndarray, other: np.ndarray) -> np.ndarray:
        whole = np.zeros(len(known), first.dtype)
        whole[solved], whole[left] = first, other
        return whole

    def frames(first: np.ndarray, other: np.ndarray) -> np.ndarray:
        whole = np.full((max(len(first), len(other)), len(known), *first.shape[2:]), np.nan)
        whole[: len(first), solved], whole[: len(other), left] = first, other
        return whole

    return mapped(rows, resolving, straight), mapped(frames, witnesses, recorder.stack())


def followed(encounters: Encounter, manoeuvre: Manoeuvre, aircraft: Aircraft) -> Trajectories:
    """Return the trajectories of manoeuvres ``[N]``, each flown in its encounter ``[N]`` to the goal or the time limit.

    The same flight as :func:`agents.resolvability.replay` of each; losses of separation do not end it here.
    """
    rules, limits = aircraft.rules(), aircraft.limits
    traffic = tracks(encounters, steps(rules), rules)
    recorder, rows = TrajectoryRecorder(encounters), np.arange(len(encounters.goal_x))
    flight, goal, mask = takeoff(encounters.own, manoeuvre), (encounters.goal_x, encounters.goal_y), encounters.mask
    for index in range(steps(rules)):
        if not rows.size:
            break
        now, after = take(traffic, (index, rows)), take(traffic, (index + 1, rows))
        moved = fly(flight, manoeuvre, index * rules.dt, goal, now, mask, rules, limits)
        apart = leg_separation(column(flight.own), column(moved.own), now, after, rules.dt, np)
        separation = np.min(np.where(mask, apart, np.inf), axis=-1)
        recorder.append(rows, moved.own, after, separation)
        on = distance(goal[0] - moved.own.x, goal[1] - moved.own.y, np) > rules.goal_radius
        rows, flight, manoeuvre, goal, mask = take((rows, moved, manoeuvre, goal, mask), on)
    return recorder.stack()


def ended(encounters: Encounter, flown: Trajectories, aircraft: Aircraft) -> Flights:
    """Return how recorded flights ``[N]``, NaN after their ends, ended without a loss: at the goal or in time-out."""
    own, first, rules = flown.own, take(flown.intruders, 0), aircraft.rules()
    count = np.arange(len(encounters.goal_x))
    last = np.count_nonzero(np.isfinite(own.x), axis=0) - 1
    apart = distance(first.x - own.x[0, :, None], first.y - own.y[0, :, None], np)
    at_start = np.min(np.where(encounters.mask, apart, np.inf), axis=-1)
    separation = np.concatenate([at_start[None], flown.separation])
    closest = np.nanargmin(separation, axis=0)
    # A running sum adds in the order of time, so that a flight's length does not depend on its company.
    length = np.nancumsum((0.5 * rules.dt) * (own.speed[:-1] + own.speed[1:]), axis=0)[-1]
    to_goal = distance(encounters.goal_x - own.x[last, count], encounters.goal_y - own.y[last, count], np)
    reached = to_goal <= rules.goal_radius
    return Flights(
        np.where(reached, OUTCOMES.index("reached"), OUTCOMES.index("timeout")).astype(np.int8),
        np.where(reached, rules.reward_goal, rules.reward_timeout),
        last * rules.dt,
        separation[closest, count],
        closest * rules.dt,
        length,
        to_goal,
        _reversals(wrap(np.diff(own.heading, axis=0), np) / rules.dt, reversal_rate(aircraft.limits)),
    )


def _reversals(yaw_rate: np.ndarray, straight: float) -> np.ndarray:
    """Return how often turns at rates ``[T, N]``, rad/s, changed side, as :mod:`eval.flights.simulate` counts it."""
    side = np.zeros(yaw_rate.shape[1])
    count = np.zeros(yaw_rate.shape[1], np.int32)
    for rate in yaw_rate:
        side, reversed_ = turned_to(rate, side, straight)
        count += reversed_
    return count
