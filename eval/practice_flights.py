"""Short flights that resolve encounters: their moments as encounters, and what they do as examples."""

from typing import NamedTuple

import numpy as np

from agents.resolvability.witness import Witnesses, least_cost
from envs.angles import wrap
from envs.encounters import Encounter
from envs.intruder import Intent
from envs.kinematics import Limits
from envs.observation import CRITICAL_RADIUS, most_critical, observe
from envs.outcome import Rules
from envs.relative import distance
from envs.trees import mapped, take
from eval.flights.optimal import ROUNDS, followed
from eval.flights.simulate import Decider, fly
from eval.flights.trajectories import Trajectories

__all__ = ["Resolving", "along", "beginning_at", "examples", "moments", "resolving"]

_LEAST = 1.0
"""Beyond the separation that a moment has at least, m: what is nearer may be lost by rounding."""

_TURNED = 1e-3
"""Course to go at which an intruder's turn is over, rad."""


class Resolving(NamedTuple):
    """Flights that resolve encounters."""

    of: np.ndarray
    """Rows of the encounters for which one is known, ``[K]``."""
    encounters: Encounter
    """Those, ``[K]``."""
    arrival: np.ndarray
    """s after the start, ``[K]``."""
    film: Trajectories
    """``[T + 1, K]``."""


def resolving(encounters: Encounter, rules: Rules, limits: Limits, spare: float) -> Resolving:
    """Return the least-cost flights known that resolve encounters ``[N]``.

    Args:
        encounters: the starts, float64.
        rules: of the task.
        limits: of the ownship.
        spare: kept beyond the separation where a flight is known that does, m; who copies a flight at the limit itself
            is lost by the least deviation.
    """
    best = _found(encounters, rules, limits, spare)
    of = np.flatnonzero(np.isfinite(best.arrival))
    known = take(encounters, of)
    return Resolving(of, known, best.arrival[of], followed(known, take(best.manoeuvre, of), rules, limits))


def moments(flights: Resolving, rules: Rules, count: int) -> tuple[Encounter, np.ndarray, np.ndarray]:
    """Return what flights come to on their way, as encounters that begin there.

    Args:
        flights: ``[K]``.
        rules: of the task.
        count: moments of each flight between its start and its end, the closer together the earlier, because the side
            is chosen early. None comes of a moment at which an intruder turns, or at the limit itself.

    Returns:
        The encounters ``[M]``, for each the row of the encounter whose flight it is of, and its time, s.
    """
    columns, at = (
        axis.ravel() for axis in np.meshgrid(np.arange(flights.of.size), np.arange(1, count + 1), indexing="ij")
    )
    step = np.floor(flights.arrival[columns] / rules.dt * (at / (count + 1)) ** 2).astype(int)
    later, fit = beginning_at(take(flights.encounters, columns), flights.film, step, columns, rules)
    fit &= step > 0
    return take(later, fit), flights.of[columns][fit], (step * rules.dt)[fit]


def along(
    encounters: Encounter, policy: Decider, rules: Rules, limits: Limits, count: int
) -> tuple[Encounter, np.ndarray, np.ndarray]:
    """Return what a policy comes to on its flights, as :func:`moments` does; encounters ``[N]``.

    Args:
        encounters: the starts, float64, with perfect reports.
        policy: that flies them.
        rules: of the task.
        limits: of the ownship.
        count: moments of each flight between its start and its end, evenly. None comes of a moment at which an intruder
            turns, or at the limit itself.
    """
    flights, film = fly(encounters, policy, rules, limits, record=True)
    assert film is not None
    columns, at = (
        axis.ravel() for axis in np.meshgrid(np.arange(len(flights.duration)), np.arange(1, count + 1), indexing="ij")
    )
    step, before = (np.floor(flights.duration[columns] / rules.dt * k / (count + 1)).astype(int) for k in (at, at - 1))
    later, fit = beginning_at(take(encounters, columns), film, step, columns, rules)
    fit &= step > before
    return take(later, fit), columns[fit], (step * rules.dt)[fit]


def examples(flights: Resolving, rules: Rules, limits: Limits) -> tuple[np.ndarray, np.ndarray]:
    """Return what flights see and do each second, observations ``[M, 8]`` and actions ``[M, 2]``, float32.

    Those of encounters in which an intruder turns are left out: such flights know before it what nobody can see.
    """
    turning = np.any(flights.encounters.mask & (flights.encounters.intent.heading_change != 0.0), axis=-1)
    known = take(flights.encounters, ~turning)
    film = take((flights.film.own, flights.film.intruders), (slice(None), ~turning))
    moment, row = np.nonzero(np.isfinite(film[0].x[1:]))
    (own, traffic), following = take(film, (moment, row)), take(film[0], (moment + 1, row))
    seen = most_critical(own, traffic, known.mask[row], CRITICAL_RADIUS, np)
    observation = observe(own, seen, known.goal_x[row], known.goal_y[row], np)
    gained = (following.speed - own.speed) / rules.dt
    full = np.where(gained >= 0.0, limits.acceleration_max, -limits.acceleration_min)
    turned = wrap(following.heading - own.heading, np) / rules.dt
    action = np.stack([gained / full, turned / limits.yaw_rate_max], axis=-1)
    return observation.astype(np.float32), np.clip(action, -1.0, 1.0).astype(np.float32)


def _found(encounters: Encounter, rules: Rules, limits: Limits, spare: float) -> Witnesses:
    """Return short flights ``[N]``, with something to spare where that can be flown."""
    wide = least_cost(encounters, rules._replace(separation=rules.separation + spare), limits, rounds=ROUNDS)
    none = np.flatnonzero(np.isnan(wide.arrival))
    if none.size:
        close = least_cost(take(encounters, none), rules, limits, rounds=ROUNDS)

        def put(whole: np.ndarray, part: np.ndarray) -> np.ndarray:
            whole[none] = part
            return whole

        wide = mapped(put, wide, close)
    return wide


def beginning_at(
    encounters: Encounter, film: Trajectories, step: np.ndarray, column: np.ndarray, rules: Rules
) -> tuple[Encounter, np.ndarray]:
    """Return encounters ``[M]`` as they are at a step of a film's column, and which of them can begin there."""
    own, other = take((film.own, film.intruders), (step, column))
    before, mask = encounters.intent, encounters.mask
    time = (step * rules.dt)[:, None]
    to_go = wrap(encounters.intruders.heading + before.heading_change - other.heading, np)
    waiting = (before.heading_change == 0.0) | (time <= before.onset)
    over = ~waiting & (np.abs(to_go) < _TURNED)
    intent = Intent(
        np.where(over, 0.0, np.maximum(before.onset - time, 0.0)),
        np.where(over, 0.0, before.heading_change),
        before.turn_rate,
    )
    apart = distance(other.x - own.x[:, None], other.y - own.y[:, None], np)
    fit = np.all(~mask | ((waiting | over) & (apart >= rules.separation + _LEAST)), axis=-1)
    return encounters._replace(own=own, intruders=other, intent=intent), fit & np.isfinite(own.x)
