"""Initial conditions of encounters, as figures and tables show them, and verdicts on them in
hindsight.
"""

import math

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
    encounters: Encounter, aircraft: Aircraft, solved: np.ndarray, other: np.ndarray | None = None
) -> Resolvability:
    """Decide which encounters are resolvable; arguments as of
    :func:`agents.resolvability.classify`, and which of them are flown as another conflict than they
    state, bool ``[N]``: these are undecided where nothing has solved them.

    A proof that looks between the seconds holds only for a recording that keeps to arcs there:
    where it is farther off than :data:`LARGEST_OFF`, such an encounter is undecided.
    """
    rules, limits = aircraft.rules(), aircraft.limits
    if encounters.reaction is not None:
        # Searches and proofs know of traffic whose flight nobody changes.
        other = np.ones(solved.shape, dtype=bool)
    if other is not None and other.any():
        known = solved | ~other
        found = classify(encounters, rules, limits, solved=solved)
        return found._replace(
            verdict=np.where(known, found.verdict, Verdict.UNDECIDED).astype(np.int8),
            method=np.where(known, found.method, Method.NONE).astype(np.int8),
            proof_time=np.where(known, found.proof_time, np.nan),
        )
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
