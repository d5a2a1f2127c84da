"""Initial conditions of encounters, as figures and tables show them, and verdicts on them in hindsight."""

from typing import NamedTuple

import numpy as np

from agents.resolvability.classify import Method, Resolvability, Verdict, classify
from envs.aircraft import Aircraft
from envs.angles import wrap
from envs.encounters import Encounter
from envs.intruder import Recording
from envs.observation import most_critical
from envs.relative import bearing, distance, straight_cpa
from envs.traffic.replay import off_arcs

LARGEST_OFF = 0.75
"""m; proofs take an intruder to fly arcs within a second, and so have this to spare where it is a recording."""


class Conditions(NamedTuple):
    """Initial conditions, seen from the ownship towards the most critical intruder; fields ``[N]``."""

    intruders: np.ndarray  # how many there are, int32
    own_speed: np.ndarray  # m/s
    intruder_speed: np.ndarray  # m/s
    distance: np.ndarray  # m
    bearing: np.ndarray  # of the intruder from the own heading, rad in [-pi, pi), left positive
    relative_heading: np.ndarray  # intruder's heading less own heading, rad in [-pi, pi), counter-clockwise
    t_cpa: np.ndarray  # time to the closest point of approach on straight courses, s
    d_cpa: np.ndarray  # distance there, m
    route_length: np.ndarray  # distance from the start to the goal, m


def conditions(encounters: Encounter, aircraft: Aircraft) -> Conditions:
    """Return the initial conditions of encounters ``[N]`` of an aircraft."""
    own = encounters.own
    other = most_critical(own, encounters.intruders, encounters.mask, aircraft, np)
    cpa = straight_cpa(own, other, np)
    return Conditions(
        intruders=np.count_nonzero(encounters.mask, axis=-1).astype(np.int32),
        own_speed=own.speed,
        intruder_speed=other.speed,
        distance=distance(other.x - own.x, other.y - own.y, np),
        bearing=bearing(own, other.x, other.y, np),
        relative_heading=wrap(other.heading - own.heading, np),
        t_cpa=cpa.time,
        d_cpa=cpa.distance,
        route_length=distance(encounters.goal_x - own.x, encounters.goal_y - own.y, np),
    )


def verdicts(encounters: Encounter, aircraft: Aircraft, solved: np.ndarray) -> Resolvability:
    """Decide which encounters are resolvable; arguments as of :func:`agents.resolvability.classify`.

    A proof that looks between the seconds holds only for a recording that keeps to arcs there: where it is farther off
    than :data:`LARGEST_OFF`, such an encounter is undecided.
    """
    rules, limits = aircraft.rules(), aircraft.limits
    if not isinstance(encounters.intent, Recording):
        return classify(encounters, rules, limits, solved=solved)
    found = classify(encounters, rules, limits, solved=solved, reserve=LARGEST_OFF)
    between = np.isin(found.method, (Method.CONTAINMENT, Method.SPLITTING))
    loose = between & (off_arcs(encounters.intent, encounters.mask, aircraft.dt) > LARGEST_OFF)
    return found._replace(
        verdict=np.where(loose, Verdict.UNDECIDED, found.verdict).astype(np.int8),
        method=np.where(loose, Method.NONE, found.method).astype(np.int8),
        proof_time=np.where(loose, np.nan, found.proof_time),
    )
