"""Whether an encounter can be resolved at all: by an escape to show, not by a proof, or not known.

An encounter is resolvable if some control history within the limits keeps the separation (from each
intruder its own, where it has one) until it reaches the goal within ``rules.t_max`` (the definition
of policy mode). Success of a resolver is judged against all encounters that are not *proven*
unresolvable, so that a weak search here can never flatter it. ``classify`` stops at the first
escape that works; :func:`agents.resolvability.witness.least_cost` looks for the shortest.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from agents.manoeuvres.escape_manoeuvre import Manoeuvre, count_in, fly_step, steps, takeoff, tracks
from agents.manoeuvres.escape_search import parts, search, to_double
from agents.resolvability.proof import containment_time, look_ahead, reach_scale, split
from envs.arrays import Array
from envs.encounters import Encounter
from envs.frames import Air
from envs.kinematics import Limits, VehicleState
from envs.outcome import Rules, judge
from envs.starts import cast
from envs.trees import map_leaves, scatter, take


class Verdict(IntEnum):
    """What is known of an encounter."""

    UNDECIDED = 0
    RESOLVABLE = 1
    UNRESOLVABLE = 2


class Method(IntEnum):
    """What decided it."""

    NONE = 0
    SOLVED_ELSEWHERE = 1  # the caller said so
    SEARCH = 2  # a witness was found
    START = 3  # proof: it starts in violation
    # proof: one intruder's disc contains everything that can be reached at one time
    CONTAINMENT = 4
    SPLITTING = 5  # proof: the same for each of several sets of control histories
    GOAL = 6  # proof: the goal is out of reach in time


class Resolvability(NamedTuple):
    """Verdicts; fields ``[N]``."""

    verdict: Array  # Verdict, int8
    method: Array  # Method, int8
    # parameters of an escape that works; nan where none was searched for or found
    witness: Manoeuvre
    arrival: Array  # time at which the witness reaches the goal, s; nan without one
    separation: Array
    """Smallest distance of the witness to any intruder, m; nan without one. The distance to an
    intruder with a separation of its own is scaled by the rules' separation over that."""
    proof_time: Array  # time by which any control history has failed, s; nan without a proof


class Replay(NamedTuple):
    """The flight of a witness, T steps."""

    time: Array  # s, [T + 1]
    own: VehicleState[Air]  # [T + 1]
    intruders: VehicleState[Air]  # [T + 1, K]
    # smallest distance to any intruder during each step, m, [T]; counted likewise
    separation: Array


def classify(
    encounters: Encounter,
    rules: Rules,
    limits: Limits,
    solved: Array | None = None,
    *,
    reserve: float = 0.0,
) -> Resolvability:
    """Decide which encounters ``[N]`` (numpy) are resolvable.

    Args:
        solved: bool ``[N]``; those that any other method has solved are resolvable without a
            search.
        reserve: by how much more a proof needs the separation to be missed, m, such as where it is
            not known so exactly how the intruders fly between the seconds.

    Raises:
        ValueError: ``encounters`` has no leading axis, or ``solved`` is not one bool for each of
            them.
    """
    chosen, count = to_double(encounters), np.size(encounters.goal_x)
    is_solved = np.zeros(count, dtype=bool) if solved is None else np.asarray(solved)
    if is_solved.shape != (count,) or is_solved.dtype != bool:
        raise ValueError(
            f"solved must be bool [{count}], got {is_solved.dtype} {list(is_solved.shape)}"
        )
    result = Resolvability(
        np.where(is_solved, Verdict.RESOLVABLE, Verdict.UNDECIDED).astype(np.int8),
        np.where(is_solved, Method.SOLVED_ELSEWHERE, Method.NONE).astype(np.int8),
        Manoeuvre(*np.full((len(Manoeuvre._fields), count), np.nan)),
        *np.full((3, count), np.nan),
    )
    scale = reach_scale(chosen, rules)
    for horizon in np.unique(scale):
        for part in parts(np.flatnonzero(~is_solved & (scale == horizon)), 1, chosen):
            _decide(take(chosen, part), part, rules, limits, reserve, result)
    return result


def replay(encounter: Encounter, witness: Manoeuvre, rules: Rules, limits: Limits) -> Replay:
    """Fly the witness of one encounter, both without a leading axis (``take(encounters, 7)``),
    until that ends.

    Raises a ValueError where there is none (its parameters are nan).
    """
    if not np.all(np.isfinite(witness)):
        raise ValueError("the encounter has no witness: its manoeuvre is not finite")
    single, manoeuvre = map_leaves(
        lambda field: np.asarray(field)[None], (cast(encounter, np.float64), witness)
    )
    traffic = tracks(single, steps(rules), rules)
    flight, goal = takeoff(single.own, manoeuvre), (single.goal_x, single.goal_y)
    counting = count_in(single, rules)
    states, separations = [flight.own], []
    for index in range(steps(rules)):
        ends = take(traffic, index), take(traffic, index + 1)
        start, end = index * rules.dt, (index + 1) * rules.dt
        step = fly_step(flight, manoeuvre, start, goal, ends, counting, rules, limits)
        flight = step.flight
        states.append(flight.own)
        separations.append(float(step.separation[0]))
        if judge(step.separation, step.to_goal, end, rules, np).ended(np).all():
            break
    flown = np.arange(len(states))
    own: VehicleState[Air] = VehicleState(
        *(np.concatenate(field) for field in zip(*states, strict=True))
    )
    return Replay(flown * rules.dt, own, take(traffic, (flown, 0)), np.array(separations))


def _decide(
    chosen: Encounter,
    part: Array,
    rules: Rules,
    limits: Limits,
    reserve: float,
    result: Resolvability,
) -> None:
    """Write the verdicts of the encounters numbered ``part`` into the result: what is cheap comes
    first.
    """
    missed = rules._replace(separation=rules.separation - reserve)
    ahead = look_ahead(chosen, rules, limits)

    def note_proof(numbers: Array, times: Array, method: Method) -> None:
        holds = ~np.isnan(times)
        rows = part[numbers[holds]]
        result.verdict[rows], result.method[rows] = Verdict.UNRESOLVABLE, method
        result.proof_time[rows] = times[holds]

    def undecided_rows() -> Array:
        return np.flatnonzero(result.verdict[part] == Verdict.UNDECIDED)

    every = np.arange(part.size)
    note_proof(every, np.where(ahead.out_of_reach, steps(rules) * rules.dt, np.nan), Method.GOAL)
    times = containment_time(ahead, missed, limits)
    note_proof(every, times, Method.CONTAINMENT)
    note_proof(every, np.where(times == 0.0, times, np.nan), Method.START)

    undecided = undecided_rows()
    escapes = search(take(chosen, undecided), rules, limits)
    works = ~np.isnan(escapes.arrival)
    rows = part[undecided[works]]
    result.verdict[rows], result.method[rows] = Verdict.RESOLVABLE, Method.SEARCH
    scatter(result.witness, rows, take(escapes.manoeuvre, works))
    result.arrival[rows], result.separation[rows] = (
        escapes.arrival[works],
        escapes.separation[works],
    )

    undecided = undecided_rows()
    note_proof(undecided, split(take(ahead, undecided), missed, limits), Method.SPLITTING)
