"""Search for an escape: coarse to fine through the family, then a local refinement of the nearest
misses.

The search is clairvoyant: it flies against the true motion of the intruders, so that what it finds
bounds from above what any resolver without foresight can achieve.
"""

from typing import NamedTuple

import numpy as np

from agents.manoeuvres.escape_manoeuvre import (
    REGARDLESS,
    Counting,
    Flight,
    Manoeuvre,
    count_in,
    fly_step,
    steps,
    takeoff,
    tracks,
)
from envs.aircraft import Aircraft
from envs.arrays import Array
from envs.draws import normals, uniforms
from envs.encounters import Encounter
from envs.frames import Air
from envs.kinematics import Limits, VehicleState
from envs.outcome import Outcome, Rules, judge
from envs.relative import distance
from envs.starts import cast
from envs.trees import first_rows, scatter, take

BLOCK = 16_384
"""Escapes flown at once against up to 8 intruders (fewer against more): some 100 MB."""

MOST = 512
"""Encounters whose intruders, up to 8 each, are flown at once: some 80 MB."""

ELITES, CHILDREN, ROUNDS = 8, 64, 16
"""Of the refinement: escapes kept, offspring a round, rounds."""

SPREAD = Manoeuvre(np.radians(12.0), 0.7, 6.0, np.radians(25.0), 0.7, 12.0, 0.06, 0.5)
"""One sigma of a first-round offspring's change; like all families here in time steps and
separations.
"""


class EscapeOutcome(NamedTuple):
    """How escapes ended; fields ``[M]``."""

    arrival: Array  # time at which the goal was reached, s; nan if it was not
    separation: Array  # smallest distance to any intruder until then, m, as of an EscapeStep
    path: Array  # length flown until the circle around the goal was entered, m; nan if it was not


class _Active(NamedTuple):
    """Escapes in the air; fields ``[M]``."""

    row: Array  # their numbers
    owner: Array  # number of the encounter
    goal: tuple[Array, Array]  # m
    counting: Counting  # how the intruders count, [M, K]
    manoeuvre: Manoeuvre
    flight: Flight
    intruders: VehicleState[Air]  # [M, K]
    length: Array  # flown so far, m
    to_goal: Array  # distance to the goal, m


class Escapes(NamedTuple):
    """The best escape of each encounter, as in :class:`EscapeOutcome`; fields ``[N]``, nan where
    none is known to work.
    """

    manoeuvre: Manoeuvre
    arrival: Array
    separation: Array
    path: Array


def _grid(
    turns_deg: Array, throttles: Array = (0.0,), delays: Array = (0.0,), slacks: Array = (0.03,)
) -> Manoeuvre:
    """Return all combinations of turns, throttles, delayed starts and slacks, ``[M]``."""
    mesh = np.meshgrid(np.radians(turns_deg), throttles, delays, slacks, indexing="ij")
    turn, throttle, delay, slack = (axis.ravel().astype(float) for axis in mesh)
    zero = np.zeros_like(turn)
    # A delayed start is an empty first part.
    return Manoeuvre(zero, zero, delay, turn, throttle, zero, slack, zero)


def scale(manoeuvre: Manoeuvre, task: Aircraft | Rules) -> Manoeuvre:
    """Return manoeuvres in seconds and metres from such in time steps and separations."""
    return manoeuvre._replace(
        switch=manoeuvre.switch * task.dt,
        resume=manoeuvre.resume * task.dt,
        slack=manoeuvre.slack * task.separation,
    )


def concatenate(*parts: Manoeuvre) -> Manoeuvre:
    """Return families one after the other, ``[M]``."""
    return Manoeuvre(*(np.concatenate(field) for field in zip(*parts, strict=True)))


_THROTTLES = (-1.0, 0.0, 1.0)
COARSE = _grid(np.arange(-180.0, 180.1, 15.0), _THROTTLES)


def _turns_that_stay_away(turns_deg: Array, resumes: Array) -> Manoeuvre:
    """Return turns that do not come back before a time: with one throttle, or slow and then fast,
    ``[M]``.
    """
    slow_then_fast = (-1.0, 1.0)
    throttles = ((-1.0, -1.0), (0.0, 0.0), (1.0, 1.0), slow_then_fast)
    mesh = np.meshgrid(np.radians(turns_deg), np.arange(len(throttles)), resumes, indexing="ij")
    turn, pair, resume = (axis.ravel() for axis in mesh)
    first, afterwards = np.array(throttles)[pair.astype(int)].T
    zero = np.zeros_like(turn)
    return Manoeuvre(
        turn, first, zero + 15.0, zero, afterwards, resume, zero, np.maximum(afterwards, 0.0)
    )


STAGES: tuple[Manoeuvre, ...] = (
    concatenate(
        _grid([0.0], slacks=[REGARDLESS]),
        _grid([20.0, 45.0, 75.0, 110.0, -20.0, -45.0, -75.0, -110.0]),
    ),
    COARSE,
    _grid(np.arange(-172.5, 172.6, 15.0), _THROTTLES),
    _grid(
        np.arange(-150.0, 150.1, 15.0),
        _THROTTLES,
        delays=[5.0, 10.0, 20.0, 40.0],
        slacks=[0.0, 0.2],
    ),
    _turns_that_stay_away(np.arange(-180.0, 180.1, 15.0), [20.0, 30.0]),
)
"""What is flown, coarse to fine: each stage only for the encounters that those before it left
unsolved.
"""


def fly_out(
    encounter: Encounter,
    traffic: VehicleState[Air],
    owner: Array,
    manoeuvre: Manoeuvre,
    rules: Rules,
    limits: Limits,
    *,
    scoring: bool = False,
    first: bool = True,
) -> EscapeOutcome:
    """Fly escapes ``[M]`` of encounters ``[N]`` to their ends, against intruders ``[T + 1, N, K]``.

    Args:
        owner: number of the encounter that each escape belongs to, ``[M]``.
        scoring: go on after a violation, to learn by how much it was missed; otherwise an escape is
            dropped there.
        first: without scoring, drop all of an encounter's escapes as soon as one of them has
            reached the goal.
    """
    outcome = EscapeOutcome(
        arrival=np.full(owner.size, np.nan),
        separation=np.full(owner.size, np.inf),
        path=np.full(owner.size, np.nan),
    )
    solved = np.zeros(np.shape(encounter.goal_x), dtype=bool)
    goal = take((encounter.goal_x, encounter.goal_y), owner)
    flight, intruders = (
        takeoff(take(encounter.own, owner), manoeuvre),
        take(traffic, (0, owner)),
    )
    active = _Active(
        row=np.arange(owner.size),
        owner=owner,
        goal=goal,
        counting=take(count_in(encounter, rules), owner),
        manoeuvre=manoeuvre,
        flight=flight,
        intruders=intruders,
        length=np.zeros(owner.size),
        to_goal=distance(goal[0] - flight.own.x, goal[1] - flight.own.y, np),
    )
    for index in range(steps(rules)):
        after = take(traffic, (index + 1, active.owner))
        active, judged = _fly_one(active, index, after, outcome, rules, limits, scoring=scoring)
        going_on = ~judged.ended(np)
        if first and not scoring:
            solved[active.owner[judged.reached]] = True
            going_on &= ~solved[active.owner]
        if not going_on.all():
            active = take(active, going_on)
            if active.row.size == 0:
                break
    return outcome


def _fly_one(
    active: _Active,
    index: int,
    after: VehicleState[Air],
    outcome: EscapeOutcome,
    rules: Rules,
    limits: Limits,
    *,
    scoring: bool,
) -> tuple[_Active, Outcome]:
    """Fly the step numbered ``index`` against traffic that is somewhere after it, and note what
    has ended; return the escapes after it and how it was judged.
    """
    intruders = active.intruders, after
    start = index * rules.dt
    step = fly_step(
        active.flight,
        active.manoeuvre,
        start,
        active.goal,
        intruders,
        active.counting,
        rules,
        limits,
    )
    row, time = active.row, (index + 1) * rules.dt
    outcome.separation[row] = np.minimum(outcome.separation[row], step.separation)
    judged = judge(np.inf if scoring else step.separation, step.to_goal, time, rules, np)
    reached = judged.reached
    outcome.arrival[row[reached]] = time
    # Of the last step only what lies outside the goal's circle counts, or the length would come
    # in whole steps.
    outside = np.clip(
        (active.to_goal - rules.goal_radius) / np.maximum(active.to_goal - step.to_goal, 1e-9),
        0.0,
        1.0,
    )
    flown = (0.5 * rules.dt) * (active.flight.own.speed + step.flight.own.speed)
    outcome.path[row[reached]] = (active.length + outside * flown)[reached]
    moved = active._replace(
        flight=step.flight, intruders=after, length=active.length + flown, to_goal=step.to_goal
    )
    return moved, judged


def search(encounter: Encounter, rules: Rules, limits: Limits) -> Escapes:
    """Look for an escape of every encounter ``[N]``: the first to reach the goal of the first stage
    that has one.
    """
    count = np.shape(encounter.goal_x)[0]
    best = nothing(count)
    for stage in STAGES:
        unsolved = np.flatnonzero(np.isnan(best.arrival))
        for part in parts(unsolved, stage.turn.size, encounter):
            chosen = take(encounter, part)
            owner = np.repeat(np.arange(part.size), stage.turn.size)
            family = Manoeuvre(*(np.tile(field, part.size) for field in scale(stage, rules)))
            flown = fly_out(
                chosen, tracks(chosen, steps(rules), rules), owner, family, rules, limits
            )
            _keep_best(best, part, owner, family, flown)
    unsolved = np.flatnonzero(np.isnan(best.arrival))
    for part in parts(unsolved, max(CHILDREN, COARSE.turn.size), encounter):
        scatter(best, part, refine(take(encounter, part), rules, limits))
    return best


def refine(encounter: Encounter, rules: Rules, limits: Limits) -> Escapes:
    """Improve the nearest misses of the coarse family by random changes until they keep the
    separation, ``[N]``.
    """
    count = np.shape(encounter.goal_x)[0]
    traffic = tracks(encounter, steps(rules), rules)
    result = nothing(count)
    unsolved = np.arange(count)
    pool, scores = np.zeros((len(SPREAD), count, 0)), np.zeros((count, 0))
    seeds = np.stack(scale(COARSE, rules))
    coarse = np.broadcast_to(seeds[:, None], (len(SPREAD), count, COARSE.turn.size))
    for index in range(ROUNDS + 1):
        tried = offspring(pool, index - 1, rules) if index else coarse
        family = Manoeuvre(*(np.ascontiguousarray(field).ravel() for field in tried))
        owner = np.repeat(unsolved, tried.shape[-1])
        flown = fly_out(encounter, traffic, owner, family, rules, limits, scoring=True)
        works = ~np.isnan(flown.arrival) & (flown.separation >= rules.separation)
        arrival = np.where(works, flown.arrival, np.nan)
        _keep_best(result, np.arange(count), owner, family, flown._replace(arrival=arrival))

        # What misses the goal comes after all that reach it.
        missed = np.isnan(flown.arrival)
        score = np.where(missed, flown.separation - 1e6, flown.separation).reshape(
            unsolved.size, -1
        )
        pool = np.concatenate([pool, tried], axis=-1)
        scores = np.concatenate([scores, score], axis=-1)
        best = np.argsort(-scores, axis=-1, kind="stable")[:, :ELITES]
        on = np.isnan(result.arrival[unsolved])
        pool = np.take_along_axis(pool, best[None], axis=-1)[:, on]
        unsolved, scores = unsolved[on], np.take_along_axis(scores, best, axis=-1)[on]
        if unsolved.size == 0:
            break
    return result


def offspring(pool: Array, index: int, task: Aircraft | Rules) -> Array:
    """Return variants ``[8, N, CHILDREN]`` of elites ``[8, N, ELITES]``, the same random changes
    for all encounters.
    """
    sigma = np.array(scale(SPREAD, task))[:, None]
    changes = sigma * normals(0, index, 1, (len(SPREAD), CHILDREN))[0] * 0.8**index
    parents = (uniforms(0, index, 1, (CHILDREN,), stream=1)[0] * ELITES).astype(int)
    return within_range(pool[..., parents] + changes[:, None])


def within_range(values: Array) -> Array:
    """Return parameters ``[8, ...]`` that are manoeuvres again."""
    changed = Manoeuvre(*values)
    return np.stack(
        changed._replace(
            throttle=np.clip(changed.throttle, -1.0, 1.0),
            switch=np.maximum(changed.switch, 0.0),
            throttle_after=np.clip(changed.throttle_after, -1.0, 1.0),
            resume=np.maximum(changed.resume, 0.0),
            throttle_home=np.clip(changed.throttle_home, -1.0, 1.0),
        )
    )


def _keep_best(
    best: Escapes, part: Array, owner: Array, family: Manoeuvre, flown: EscapeOutcome
) -> None:
    """Write, per encounter, the earliest arrival of what was flown (the widest of those) into what
    is found.
    """
    arrived = np.flatnonzero(~np.isnan(flown.arrival))
    owners, first = first_rows(owner[arrived], -flown.separation[arrived], flown.arrival[arrived])
    scatter(best, part[owners], take(Escapes(family, *flown), arrived[first]))


def to_double(encounters: Encounter) -> Encounter:
    """Return encounters ``[N]`` in double precision; raise ValueError where there is no leading
    axis.
    """
    if np.ndim(encounters.goal_x) != 1:
        raise ValueError(
            f"encounters must have one leading axis [N], got shape {np.shape(encounters.goal_x)}"
        )
    return cast(encounters, np.float64)


def nothing(count: int) -> Escapes:
    """Return that no escape is known, ``[count]``."""
    return Escapes(Manoeuvre(*np.full((len(SPREAD), count), np.nan)), *np.full((3, count), np.nan))


def parts(indices: Array, escapes: int, encounter: Encounter) -> list[Array]:
    """Split indices of encounters into parts that fit into memory, with so many escapes each."""
    crowd = max(encounter.mask.shape[-1] / 8, 1.0)
    size = max(int(min(BLOCK / escapes, MOST) / crowd), 1)
    return [indices[first : first + size] for first in range(0, indices.size, size)]
