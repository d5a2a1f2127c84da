"""Initial conditions of encounters, as figures and tables show them, and verdicts on them in
hindsight.
"""

import math
from collections.abc import Iterable
from functools import reduce
from typing import NamedTuple

import numpy as np

from agents.resolvability.classify import Method, Resolvability, Verdict, classify
from envs.aircraft import Aircraft
from envs.angles import wrap
from envs.encounters import Encounter
from envs.intruder import KnownFlight
from envs.kinematics import Limits, within
from envs.observation import most_critical
from envs.relative import bearing, distance, straight_cpa
from envs.traffic.replay import off_arcs

LARGEST_OFF = 0.75
"""m; proofs take an intruder to fly arcs within a second, and so have this to spare where it is a
recording.
"""


def conditions(encounters: Encounter, aircraft: Aircraft) -> dict[str, np.ndarray]:
    """Return the columns of a table that say how encounters begin, seen towards the most critical
    intruder, ``[N]``.

    Bearing (from the own heading) and relative heading (intruder's less own) are counter-clockwise,
    in [-180, 180) deg; time and distance of the closest point of approach are those on straight
    courses.
    """
    own = encounters.own
    other = most_critical(own, encounters.intruders, encounters.mask, aircraft, np)
    cpa = straight_cpa(own, other, np)
    return {
        "intruders": np.count_nonzero(encounters.mask, axis=-1).astype(np.int32),
        "own_speed_m_s": own.speed,
        "intruder_speed_m_s": other.speed,
        "distance_m": distance(other.x - own.x, other.y - own.y, np),
        "bearing_deg": bearing(own, other.x, other.y, np) * (180.0 / math.pi),
        "relative_heading_deg": wrap(other.heading - own.heading, np) * (180.0 / math.pi),
        "t_cpa_s": cpa.time,
        "d_cpa_m": cpa.distance,
        "route_length_m": distance(encounters.goal_x - own.x, encounters.goal_y - own.y, np),
    }


def verdicts(
    encounters: Encounter,
    aircraft: Aircraft,
    limits: Limits,
    solved: np.ndarray,
    other: np.ndarray | None = None,
) -> Resolvability:
    """Decide which encounters are resolvable within some limits; ``solved`` are those that a flight
    within these limits has solved, ``other`` those that are flown as another conflict than they
    state, bool ``[N]`` both.

    A proof that looks between the seconds holds only for a recording that keeps to arcs there:
    where it is farther off than :data:`LARGEST_OFF`, such an encounter is undecided. So is, where
    nothing has solved it, what is flown as another conflict, what begins beyond the limits' speeds,
    and what answers the ownship: proofs know of none of them. In space a flight that keeps the
    horizontal separation resolves an encounter, but a proof that there is none says nothing.
    """
    intent = encounters.intent
    reserve = LARGEST_OFF if isinstance(intent, KnownFlight) else 0.0
    decided = classify(encounters, aircraft.rules(), limits, solved=solved, reserve=reserve)
    speed = np.asarray(encounters.own.speed, float)
    # Starts are of single precision, and a hair's breadth beyond a limit is one of its rounding.
    unknown = (speed < limits.speed_min - 1e-3) | (speed > limits.speed_max + 1e-3)
    unknown |= encounters.reaction is not None
    unknown = (unknown if other is None else unknown | other) & ~solved
    if encounters.altitudes is not None:
        unknown |= decided.verdict == Verdict.UNRESOLVABLE
    if isinstance(intent, KnownFlight):
        between = np.isin(decided.method, (Method.CONTAINMENT, Method.SPLITTING))
        off = off_arcs(intent, encounters.mask, aircraft.dt)
        unknown |= between & (off > LARGEST_OFF)
    return decided._replace(
        verdict=np.where(unknown, Verdict.UNDECIDED, decided.verdict).astype(np.int8),
        method=np.where(unknown, Method.NONE, decided.method).astype(np.int8),
        proof_time=np.where(unknown, np.nan, decided.proof_time),
    )


class Flown(NamedTuple):
    """What flights ``[N]`` within some limits have solved."""

    limits: Limits
    solved: np.ndarray  # bool [N]

    def but(self, others: np.ndarray) -> "Flown":
        """Return the same without some encounters, bool ``[N]``."""
        return self._replace(solved=self.solved & ~others)


def verdict_within(
    encounters: Encounter,
    aircraft: Aircraft,
    limits: Limits,
    flown: Iterable[Flown],
    other: np.ndarray | None = None,
) -> Resolvability:
    """Decide which encounters are resolvable within some limits, by what has been flown: a flight
    counts only if its own limits lie within them; ``other`` as of :func:`verdicts`.
    """
    counted = (flights.solved for flights in flown if within(flights.limits, limits))
    nothing = np.zeros(len(encounters.goal_x), bool)
    return verdicts(encounters, aircraft, limits, reduce(np.logical_or, counted, nothing), other)
