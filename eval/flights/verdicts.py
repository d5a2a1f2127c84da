"""Verdicts on encounters with the intruders' whole motion known, recordings included."""

import numpy as np

from agents.resolvability.classify import Method, Resolvability, Verdict, classify
from envs.aircraft import Aircraft
from envs.encounters import Encounter
from envs.intruder import Recording
from envs.traffic.replay import off_arcs

__all__ = ["LARGEST_OFF", "verdicts"]

LARGEST_OFF = 0.75
"""m; proofs take an intruder to fly arcs within a second, and so have this to spare where it is a recording."""


def verdicts(encounters: Encounter, aircraft: Aircraft, solved: np.ndarray) -> Resolvability:
    """Decide which encounters are resolvable; arguments as of :func:`agents.resolvability.classify`.

    The search and the proofs know what the intruders are going to do, a recording as well as an intent. A search that
    finds an escape holds for every recording. A proof that looks between the seconds holds only for one that keeps to
    arcs there: where it is farther off than :data:`LARGEST_OFF`, such an encounter is undecided.
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
