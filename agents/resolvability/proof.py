"""Proofs that no control history resolves an encounter.

A violation cannot be avoided if at some time, before the encounter can have ended at the goal,
everything that the ownship can reach lies inside one intruder's disc. If the whole does not, its
parts may: the states that are still clear of all discs are followed
(:mod:`agents.resolvability.reachable_set`), or the control histories are split in two by their
heading or speed at some time, again and again.
"""

import math
from functools import partial
from typing import NamedTuple

import numpy as np

from agents.manoeuvres.escape_manoeuvre import steps
from agents.resolvability.reachable_bound import (
    DIRECTIONS,
    Funnel,
    delta,
    farthest,
    narrow,
    relax,
    root,
    support,
)
from agents.resolvability.reachable_set import Cells, last_time
from envs.angles import sincos, wrap
from envs.arrays import Array
from envs.encounters import Encounter
from envs.frames import Air
from envs.intruder import start, step
from envs.kinematics import UNLIMITED, Limits, VehicleState, advance
from envs.outcome import Rules
from envs.relative import distance
from envs.trees import map_leaves, take

STEP = 0.05
"""Of the integration of the supports, in time steps of the task."""

STRIDE = 2
"""Steps between the times at which containment is tested."""

CELLS = (
    Cells(turn=math.radians(30.0), speed=0.12, place=1.0, tests=80, most=3_000),
    Cells(turn=math.radians(15.0), speed=0.08, place=1.0, tests=60, most=3_000),
)
"""How finely survivors are divided, in greatest speeds and separations; one grid after the other
until one proves.
"""

NODES = 300
"""Sets of control histories that a proof by halving may look at."""

LEAST_SHARE = 0.1
"""Of the rules' separation. Nearer than that, judged distances err by more than half of
:func:`agents.resolvability.reachable_bound.delta`: proofs do without such an intruder.
"""

BLOCK = 25
"""Funnels looked at together against up to 8 intruders (fewer against more): some 150 MB."""


class Ahead(NamedTuple):
    """What a proof needs of encounters; fields ``[N, ...]``."""

    speed: Array  # initial, m/s, [N]
    # what each intruder's own separation is beyond the rules', m, [N, K]; 0 where it has none
    beyond: Array
    start_distance: Array  # at the start, less beyond, to the intruder where that is least, m, [N]
    # intruders in the ownship's initial frame at the test times, m, [N, K, T]; far off where absent
    x: Array
    y: Array
    goal_x: Array  # goal in the same frame, m, [N]
    goal_y: Array
    out_of_reach: Array  # whether the goal cannot be reached in time, bool [N]


def reach_scale(encounter: Encounter, rules: Rules) -> Array:
    """Return the separation by which a proof's horizon is measured, in whole separations of the
    rules, ``[N]``: the largest of each encounter, rounded up.
    """
    if encounter.separation is None:
        return np.ones(np.shape(encounter.goal_x))
    most = np.max(np.where(encounter.mask, encounter.separation, 0.0), axis=-1)
    return np.maximum(np.ceil(most / rules.separation), 1.0)


def look_ahead(encounter: Encounter, rules: Rules, limits: Limits) -> Ahead:
    """Fly the intruders of encounters ``[N]`` over the horizon of proofs and ask whether the goal
    is in reach.

    The horizon is that of the largest :func:`reach_scale` of them.
    """
    own, mask, beyond = encounter.own, encounter.mask, np.zeros(np.shape(encounter.mask))
    if encounter.separation is not None:
        mask = mask & (encounter.separation >= LEAST_SHARE * rules.separation)
        beyond = encounter.separation - rules.separation
    scale = float(np.max(reach_scale(encounter, rules), initial=1.0))
    times = _test_times(_tests_ahead(scale * rules.separation, rules, limits), rules)
    places = _in_frame(own, *_places(encounter, times, rules))
    x, y = (np.where(mask, place, 1e9).transpose(1, 2, 0) for place in places)
    began = distance(*_in_frame(own, encounter.intruders.x, encounter.intruders.y), np)
    goal = _in_frame(own, encounter.goal_x[:, None], encounter.goal_y[:, None])
    goal_x, goal_y = (place[:, 0] for place in goal)
    return Ahead(
        speed=own.speed,
        beyond=beyond,
        start_distance=np.min(np.where(mask, began - beyond, np.inf), axis=-1),
        x=x,
        y=y,
        goal_x=goal_x,
        goal_y=goal_y,
        out_of_reach=_out_of_reach(own.speed, goal_x, goal_y, rules, limits),
    )


def _places(encounter: Encounter, times: Array, rules: Rules) -> tuple[Array, Array]:
    """Return where the intruders of encounters are at times ``[T]``, s: x and y, m, ``[T, N, K]``
    each.
    """
    flown, index = start(encounter.intruders, np), 0
    places: list[VehicleState[Air]] = []
    while len(times):
        after = step(flown, encounter.intent, index * rules.dt, rules.dt, np)
        within = times <= (index + 1) * rules.dt + 1e-9
        seconds = (times[within] - index * rules.dt)[:, None, None]
        # The controller holds its turn rate over a step.
        turn_rate = wrap(after.vehicle.heading - flown.vehicle.heading, np) / rules.dt
        places.append(advance(flown.vehicle, 0.0 * turn_rate, turn_rate, seconds, UNLIMITED, np))
        times, flown, index = times[~within], after, index + 1
    return (
        np.concatenate([place.x for place in places]),
        np.concatenate([place.y for place in places]),
    )


def _in_frame(own: VehicleState[Air], x: Array, y: Array) -> tuple[Array, Array]:
    """Return places ``[..., N, K]`` in the initial frame of the ownships ``[N]``, m: x ahead, y to
    the left.
    """
    sine, cosine = (part[:, None] for part in sincos(own.heading, np))
    east, north = x - own.x[:, None], y - own.y[:, None]
    return cosine * east + sine * north, cosine * north - sine * east


def containment_time(ahead: Ahead, rules: Rules, limits: Limits) -> Array:
    """Return the time by which every control history has violated the separation, nan where not
    proven, ``[N]``.
    """
    proven = np.full(ahead.speed.shape, np.nan)
    # The straight flight is among the histories: an intruder that does not meet it contains
    # nothing.
    flown = ahead.speed[:, None] * _test_times(ahead.x.shape[-1], rules)
    straight = np.min(distance(ahead.x - flown[:, None], ahead.y, np), axis=-1)
    near = np.flatnonzero(np.any(straight <= _radius(ahead, rules, limits), axis=-1))
    size = _block(ahead)
    for first in range(0, near.size, size):
        part = near[first : first + size]
        chosen = take(ahead, part)
        funnel = root(chosen.speed, _times(ahead.x.shape[-1], rules), relax(limits))
        proven[part] = _look(funnel, chosen, rules, limits)[0]
    proven[ahead.start_distance <= rules.separation - delta(rules, limits)] = 0.0
    return proven


def split(ahead: Ahead, rules: Rules, limits: Limits, nodes: int = NODES) -> Array:
    """As :func:`containment_time`, for parts of the control histories: survivors, else up to so
    many halves of halves.
    """
    proven = np.full(ahead.speed.shape, np.nan)
    for index in range(ahead.speed.size):
        single = take(ahead, slice(index, index + 1))
        for cells in CELLS:
            if np.isnan(proven[index]):
                proven[index] = _survival_time(single, cells, rules, limits)
        if np.isnan(proven[index]):
            proven[index] = _bisect_until_contained(single, nodes, rules, limits)
    return proven


def _survival_time(ahead: Ahead, cells: Cells, rules: Rules, limits: Limits) -> float:
    """Follow what is still clear of all intruders of one encounter; return when nothing is, nan if
    something stays.
    """
    granted, radius = relax(limits), _radius(ahead, rules, limits)[0]
    cells = cells._replace(
        speed=cells.speed * limits.speed_max, place=cells.place * rules.separation
    )
    fastest = max(granted.speed_max, ahead.speed[0])
    reach = radius[:, None] + fastest * _test_times(ahead.x.shape[-1], rules)
    near = (radius > 0.0) & np.any(distance(ahead.x[0], ahead.y[0], np) <= reach, axis=-1)
    goal = (ahead.goal_x[0], ahead.goal_y[0], rules.goal_radius + delta(rules, limits))
    discs = (ahead.x[0, near], ahead.y[0, near], radius[near])
    return last_time(ahead.speed[0], discs, goal, STRIDE * STEP * rules.dt, cells, granted)


def _bisect_until_contained(ahead: Ahead, nodes: int, rules: Rules, limits: Limits) -> float:
    """Halve the control histories of one encounter until all are contained; return the last time,
    nan if some stay.
    """
    times, size = _times(ahead.x.shape[-1], rules), _block(ahead)
    funnel = root(ahead.speed, times, relax(limits))
    looked_at, latest = funnel.turn_low.shape[0], 0.0
    while looked_at <= nodes:
        blocks = [
            take(funnel, slice(i, i + size)) for i in range(0, funnel.turn_low.shape[0], size)
        ]
        looks = [_look(block, ahead, rules, limits) for block in blocks]
        ended, promising = (np.concatenate(part) for part in zip(*looks, strict=True))
        latest = max(latest, float(np.max(ended, where=~np.isnan(ended), initial=0.0)))
        open_still = np.isnan(ended)
        if not open_still.any():
            return latest
        funnel = _halves(
            take(funnel, open_still), promising[open_still], times, STEP * rules.dt, limits
        )
        looked_at += funnel.turn_low.shape[0]
    return np.nan


def _look(funnel: Funnel, ahead: Ahead, rules: Rules, limits: Limits) -> tuple[Array, Array]:
    """Return the first time at which a disc contains funnels ``[N]`` (nan: none), and when that is
    nearest.
    """
    supports = support(funnel, DIRECTIONS, STEP * rules.dt, relax(limits), stride=STRIDE)
    times = _test_times(ahead.x.shape[-1], rules)
    radius = _radius(ahead, rules, limits)[..., None]
    excess = np.min(farthest(supports, ahead.x, ahead.y) - radius, axis=-2)
    excess = np.where(_under_way(supports, ahead, rules, limits), excess, np.inf)
    contains = excess <= 0.0
    ended = np.where(contains.any(axis=-1), times[np.argmax(contains, axis=-1)], np.nan)
    width = np.max(supports + np.roll(supports, DIRECTIONS.size // 2, axis=-2), axis=-2)
    return ended, times[np.argmin(excess / width, axis=-1)]


def _halves(funnel: Funnel, promising: Array, times: Array, step: float, limits: Limits) -> Funnel:
    """Split funnels where it narrows most what can be reached until the promising times, ``[N]`` ->
    ``[2 N]``.
    """
    rows = np.arange(promising.size)
    until = times <= promising[:, None]
    none = np.full(promising.size, np.nan)
    least: Array = np.full(promising.size, np.inf)
    chosen = funnel, funnel
    for fraction in (0.3, 0.6, 0.9):
        at = np.clip(np.rint(fraction * promising / step).astype(int), 1, times.size - 1)
        turn = 0.5 * (funnel.turn_low + funnel.turn_high)[rows, at]
        speed = 0.5 * (funnel.speed_low + funnel.speed_high)[rows, at]
        for cut in ((turn, none), (none, speed)):
            halves = narrow(funnel, times, times[at], *cut, relax(limits))
            width = np.maximum(*(np.sum(_width(half) * until, axis=-1) for half in halves))
            better = width < least
            least = np.where(better, width, least)
            chosen = map_leaves(partial(np.where, better[:, None]), halves, chosen)
    return map_leaves(lambda *pair: np.concatenate(pair), *chosen)


def _width(funnel: Funnel) -> Array:
    """Return how fast the reachable set widens, m/s, ``[N, T]``: it guides the splitting, and is no
    bound.
    """
    turn = np.minimum(funnel.turn_high - funnel.turn_low, 3.0)
    return (
        0.5 * (funnel.speed_low + funnel.speed_high) * turn + funnel.speed_high - funnel.speed_low
    )


def _under_way(supports: Array, ahead: Ahead, rules: Rules, limits: Limits) -> Array:
    """Return whether no history of the funnels can have ended at the goal by the test times, ``[N,
    T]``.
    """
    flight = np.maximum(relax(limits).speed_max, ahead.speed) * STRIDE * (STEP * rules.dt)
    # What cannot be within the goal's radius and a stride's flight of it now has not been at it
    # since the last test.
    goal = np.cos(DIRECTIONS) * ahead.goal_x[:, None] + np.sin(DIRECTIONS) * ahead.goal_y[:, None]
    short_of = goal - (rules.goal_radius + delta(rules, limits) + flight)[:, None]
    return np.logical_and.accumulate(np.any(supports < short_of[..., None], axis=-2), axis=-1)


def _out_of_reach(
    speed: Array, goal_x: Array, goal_y: Array, rules: Rules, limits: Limits
) -> Array:
    """Return whether the outer set at the end does not touch the goal's disc in some direction,
    bool ``[N]``.
    """
    coarse = STRIDE * STEP * rules.dt
    times = coarse * np.arange(int(np.ceil(steps(rules) * rules.dt / coarse)) + 1)
    direction = np.arctan2(goal_y, goal_x)[:, None]
    funnel = root(speed, times, relax(limits))
    reach = support(funnel, direction, coarse, relax(limits), growing=True)[:, 0]
    # The support is convex in time, since its integrand grows: it is largest at one of the ends.
    return np.maximum(reach[:, -1], 0.0) < distance(goal_x, goal_y, np) - (
        rules.goal_radius + delta(rules, limits)
    )


def _block(ahead: Ahead) -> int:
    return max(BLOCK * 8 // max(ahead.x.shape[1], 8), 1)


def _radius(ahead: Ahead, rules: Rules, limits: Limits) -> Array:
    """Return the radius of the disc around each intruder that a proof holds for violated, m,
    ``[N, K]``.

    What judged distances err by does not grow with them: delta is that of the rules' separation.
    """
    return rules.separation + ahead.beyond - delta(rules, limits)


def _tests_ahead(separation: float, rules: Rules, limits: Limits) -> int:
    """Return how many times are tested: over half as long again as it takes to move aside by a
    separation, m.
    """
    # A guide, no bound: the shorter the horizon, the less is proven.
    slow, stride = max(limits.speed_min, 0.1 * limits.speed_max), STRIDE * STEP * rules.dt
    radius = slow / limits.yaw_rate_max
    turning = np.arccos(max(1.0 - separation / radius, 0.0)) / limits.yaw_rate_max
    aside = turning + max(separation - radius, 0.0) / slow
    return int(min(1.5 * aside, steps(rules) * rules.dt) / stride)


def _times(tests: int, rules: Rules) -> Array:
    """Return the times of the funnels with so many test times, s."""
    return STEP * rules.dt * np.arange(STRIDE * tests + 1)


def _test_times(tests: int, rules: Rules) -> Array:
    return _times(tests, rules)[STRIDE::STRIDE]
