"""The least-cost witness: the shortest flight known that resolves an encounter.

All escapes of the search that work, and a family that stays near the direct route, are flown; the
shortest of them breed a local refinement, a differential evolution whose draws are fixed.
"""

import numpy as np

from agents.manoeuvres.escape_manoeuvre import Manoeuvre, steps, tracks
from agents.manoeuvres.escape_search import (
    SPREAD,
    STAGES,
    EscapeOutcome,
    Escapes,
    fly_out,
    nothing,
    parts,
    scale,
    search,
    to_double,
    within_range,
)
from envs.arrays import Array
from envs.draws import normals, uniforms
from envs.encounters import Encounter
from envs.frames import Air
from envs.kinematics import Limits, VehicleState
from envs.outcome import Rules
from envs.relative import bearing
from envs.trees import map_leaves, scatter, take

SECOND = 1e-3
"""Cost of a second of flight, m: of flights of the same length the earlier arrival is the better,
for any aircraft.
"""

ROUNDS = 40
"""Of the refinement."""

_ELITES = 12  # flights that breed
_CHILDREN = 48  # offspring a round
_DECAY = 0.9  # factor a round on the spread of the changes
# required beyond the separation, m, so that a replay whose sums round otherwise keeps it too
_MARGIN = 1e-6

_THROTTLES = (-1.0, 0.0, 1.0)
_NEAR_DEG = (0.0, 4.0, -4.0, 9.0, -9.0, 16.0, -16.0, 30.0, -30.0)


def least_cost(
    encounters: Encounter,
    rules: Rules,
    limits: Limits,
    start: Manoeuvre | None = None,
    rounds: int = ROUNDS,
) -> Escapes:
    """Look for the shortest flights that keep the separation until they reach the goal in time, for
    encounters ``[N]``.

    The cost is the path's length up to the goal's circle plus :data:`SECOND` for each second until
    the arrival. The result of one encounter depends on no other.

    Args:
        start: escapes known already, ``[N]``, such as the witnesses of ``classify``; nan where none
            is.
        rounds: of the refinement; fewer are faster and cost some optimality.

    Raises:
        ValueError: ``encounters`` has no leading axis.
    """
    chosen, count = to_double(encounters), np.size(encounters.goal_x)
    result = nothing(count)
    starts = np.stack(result.manoeuvre if start is None else start).astype(np.float64)
    for part in parts(np.arange(count), sum(stage.turn.size for stage in STAGES), chosen):
        scatter(result, part, _cheapest(take(chosen, part), starts[:, part], rounds, rules, limits))
    return result


def _cheapest(
    encounter: Encounter, starts: Array, rounds: int, rules: Rules, limits: Limits
) -> Escapes:
    """Return the witnesses of a part of the encounters, ``[N]``; ``starts`` are ``[8, N]``."""
    count = np.shape(encounter.goal_x)[0]
    traffic, every = tracks(encounter, steps(rules), rules), np.arange(count)
    families = np.concatenate([np.stack(scale(stage, rules)) for stage in STAGES], axis=-1)
    families = np.broadcast_to(families[:, None], (len(SPREAD), count, families.shape[-1]))
    pool = np.concatenate([families, _direct(encounter, rules), starts[:, :, None]], axis=-1)
    pool, flown = _best(pool, _fly(encounter, traffic, every, pool, rules, limits), _ELITES)

    # What no family solves may be solved by the search's refinement towards a larger separation.
    unsolved = np.flatnonzero(np.isnan(flown.arrival[:, 0]))
    if unsolved.size:
        rescued = np.stack(search(take(encounter, unsolved), rules, limits).manoeuvre)[:, :, None]
        pool[:, unsolved, :1] = rescued
        scatter(
            flown, (unsolved, slice(1)), _fly(encounter, traffic, unsolved, rescued, rules, limits)
        )

    _breed(encounter, traffic, pool, flown, rounds, rules, limits)
    works = ~np.isnan(flown.arrival[:, 0])
    best = np.where(works, pool[:, :, 0], np.nan)
    arrival, separation, path = (np.where(works, field[:, 0], np.nan) for field in flown)
    return Escapes(Manoeuvre(*best), arrival, separation, path)


def _breed(
    encounter: Encounter,
    traffic: VehicleState[Air],
    pool: Array,
    flown: EscapeOutcome,
    rounds: int,
    rules: Rules,
    limits: Limits,
) -> None:
    """Replace flights ``[8, N, E]``, cheapest first, and how they ended, ``[N, E]``, by cheaper
    ones: rounds of random changes, of which the cheapest breed on.
    """
    # Offspring of one round are the same changes for every encounter, so that results do not depend
    # on the batch.
    changes = normals(1, 0, rounds, (len(SPREAD), _CHILDREN))
    draws = uniforms(1, 0, rounds, (5, _CHILDREN), stream=1)
    for index in range(rounds):
        working = np.sum(~np.isnan(flown.arrival), axis=-1)
        alive = np.flatnonzero(working)
        if alive.size == 0:
            break
        spread = np.array(scale(SPREAD, rules))[:, None] * (changes[index] * _DECAY**index)
        tried = _offspring(pool[:, alive], working[alive], spread, draws[index])
        outcome = _fly(encounter, traffic, alive, tried, rules, limits)
        pools = map_leaves(
            lambda old, new: np.concatenate([old, new], axis=-1), take(flown, alive), outcome
        )
        best, how = _best(np.concatenate([pool[:, alive], tried], axis=-1), pools, _ELITES)
        pool[:, alive] = best
        scatter(flown, alive, how)


def _direct(encounter: Encounter, rules: Rules) -> Array:
    """Return flights near the direct route, which let the intruder pass by their speed: ``[8, N,
    F]``.
    """
    to_goal = bearing(encounter.own, encounter.goal_x, encounter.goal_y, np)
    mesh = np.meshgrid(np.radians(_NEAR_DEG), _THROTTLES, _THROTTLES, indexing="ij")
    aside, throttle, home = (axis.ravel() for axis in mesh)
    zero = np.zeros((to_goal.size, aside.size))
    never = zero + rules.t_max
    turn = to_goal[:, None] + aside
    return np.stack([turn, zero + throttle, never, zero, zero + throttle, zero, zero, zero + home])


def _offspring(pool: Array, working: Array, changes: Array, draws: Array) -> Array:
    """Return variants ``[8, N, C]`` of flights ``[8, N, E]``, best first, ``working`` of which
    work, by some draws.
    """
    last = np.maximum(working - 1, 0)[:, None]

    def draw_parents(draw: Array) -> Array:
        number = np.minimum((draw * (last + 1)).astype(int), last)
        return np.take_along_axis(pool, number[None], axis=-1)

    # The better parent is the likelier; half of the offspring vary along the differences between
    # the flights kept.
    parent = draw_parents(draws[0] ** 2)
    first, second = draw_parents(draws[1]), draw_parents(draws[2])
    along = np.where(draws[3] < 0.5, draws[4], 0.0) * (first - second)
    noise = changes * np.where(draws[3] < 0.5, 0.2, 1.0)
    return within_range(parent + along + noise[:, None])


def _fly(
    encounter: Encounter,
    traffic: VehicleState[Air],
    rows: Array,
    tried: Array,
    rules: Rules,
    limits: Limits,
) -> EscapeOutcome:
    """Fly candidates ``[8, R, C]`` of the encounters numbered ``rows``; fields ``[R, C]``, nan
    arrival if they fail.
    """
    size = tried.shape[-1]
    flat = np.ascontiguousarray(tried.reshape(tried.shape[0], -1))
    owner = np.repeat(rows, size)
    able = np.flatnonzero(np.isfinite(flat).all(axis=0))
    stricter = rules._replace(separation=rules.separation + _MARGIN)
    if encounter.separation is not None:  # of each grows in the same proportion
        separation = encounter.separation * (stricter.separation / rules.separation)
        encounter = encounter._replace(separation=separation)
    flown = fly_out(
        encounter, traffic, owner[able], Manoeuvre(*flat[:, able]), stricter, limits, first=False
    )
    result = EscapeOutcome(*np.full((3, owner.size), np.nan))
    scatter(result, able, flown)
    return EscapeOutcome(*(field.reshape(-1, size) for field in result))


def _best(pool: Array, flown: EscapeOutcome, most: int) -> tuple[Array, EscapeOutcome]:
    """Return the cheapest flights ``[8, N, most]`` that work, cheapest first, then those that do
    not.
    """
    cost = np.where(np.isnan(flown.arrival), np.inf, flown.path + SECOND * flown.arrival)
    best = np.argsort(cost, axis=-1, kind="stable")[:, :most]
    chosen = map_leaves(lambda field: np.take_along_axis(field, best, axis=-1), flown)
    return np.take_along_axis(pool, best[None], axis=-1), chosen
