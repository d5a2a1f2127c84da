"""The outlook: how close the rest of a plan comes to the intruders as they fly now.

A lower bound as the validator's (:mod:`agents.planner.judge.validator`), in three steps, each only
where the one before does not decide: whole legs against their chords, arcs against theirs, and
parts of :data:`FINE` of an arc. Of a whole leg the sagitta is measured once, when the plan arrives.
"""

from typing import NamedTuple

import numpy as np

from agents.kernel.separation import FINE
from agents.kernel.traffic import Traffic, predict, uncertainty, within_window
from envs.arrays import Array
from envs.kinematics import Limits, VehicleState, advance
from envs.relative import chord, distance
from envs.trees import column, take
from envs.waypoints import ARCS, Legs, PlanStates

ANY = Limits(-np.inf, np.inf, -np.inf, np.inf, np.inf)
"""No limits, where the controls respect them already."""


class Course(NamedTuple):
    """What is flown, ready to be looked ahead on; fields ``[N, ...]``."""

    plan_states: PlanStates  # [N, L + 1], their times on the plan's clock
    legs: Legs  # [N, L]
    # largest distance of each leg from uniform motion along its chord, m, [N, L]; an upper bound
    sagitta: Array


class Outlook(NamedTuple):
    """What the rest of a plan holds; fields ``[N, K]``."""

    # Smallest distance less what uncertainty grows to while an intruder counts, m: a lower bound,
    # exact to 5 mm below the level of interest; inf for absent intruders and after the plan's end.
    separation: Array
    # when the separation first falls below the level of interest, s from now; inf where it does not
    loss: Array


def course(plan_states: PlanStates, legs: Legs) -> Course:
    """Return legs with what the outlook needs of them."""
    share = np.arange(ARCS) / ARCS
    sagittas = [
        field - (end[..., :-1, None] * (1.0 - share) + end[..., 1:, None] * share)
        for field, end in ((legs.x, plan_states.x), (legs.y, plan_states.y))
    ]
    step = legs.duration[..., None] / ARCS
    relative_acceleration = _own_acceleration(legs.speed, legs.acceleration, legs.yaw_rate, step)
    arc = np.max(0.125 * relative_acceleration * step * step, axis=-1)
    sagitta = np.max(distance(sagittas[0], sagittas[1], np), axis=-1) + arc + legs.miss
    return Course(plan_states, legs, sagitta)


def outlook(course: Course, since: Array, traffic: Traffic, level: Array, sigmas: float) -> Outlook:
    """Look ahead on the rest of plans ``[N]``, ``since`` seconds on their clocks, against intruders
    ``[N, K]`` now.

    Separations above ``level``, m, ``[N, K]``, are bounded coarsely; so many sigmas of what
    uncertainty grows by are taken off.
    """
    shape = traffic.mask.shape
    found = Outlook(np.full(shape, np.inf), np.full(shape, np.inf))
    if traffic.mask.size == 0:
        return found
    times, wide = course.plan_states.time - since[:, None], column(traffic)
    began, ended = times[:, :-1], times[:, 1:]
    ends = predict(wide, times[..., None])
    x, y = ends.x - course.plan_states.x[..., None], ends.y - course.plan_states.y[..., None]
    turn = np.where(
        began[..., None] < wide.turn_time, wide.state.speed * np.abs(wide.turn_rate), 0.0
    )
    length = (ended - began)[..., None]
    sagitta = course.sagitta[..., None] + 0.125 * turn * length * length
    near = chord(x[:, :-1], y[:, :-1], x[:, 1:], y[:, 1:]) - sagitta
    near = near - growth(wide, ended[..., None], sigmas)
    counts = within_window(wide, began[..., None], ended[..., None])
    ahead = (ended > 0.0)[..., None] & wide.mask & counts
    near = np.where(ahead, near, np.inf)
    unclear = near < level[:, None]
    found.separation[...] = np.min(np.where(unclear, np.inf, near), axis=1)
    n, leg, k = np.nonzero(unclear)
    if n.size:
        _lower_by_arcs(found, course, since, (n, leg, k), traffic, level, sigmas)
    return found


class _Arcs(NamedTuple):
    """The arcs of M legs, each with one intruder; an arc begun already counts as a whole, since
    what has been flown of it decides nothing but whether to look closer.
    """

    legs: Legs  # [M]
    end_x: Array  # where the legs end, m, [M]
    end_y: Array
    times: Array  # of the arcs' ends, s from now, [M, ARCS + 1]
    step: Array  # how long each lasts, s, [M, 1]
    relative_acceleration: Array  # a bound of it, m/s^2, [M, ARCS]


def _lower_by_arcs(
    found: Outlook,
    course: Course,
    since: Array,
    which: tuple[Array, Array, Array],
    traffic: Traffic,
    level: Array,
    sigmas: float,
) -> None:
    """Lower what was found by the arcs of some legs, and by parts of those that are not clear.

    Args:
        which: numbers of courses, of their legs and of intruders, ``[M]`` each.
    """
    n, leg, k = which
    one = column(take(traffic, (n, k)))
    arcs = _arcs(course, since, n, leg, one)
    near = _bound_arcs(arcs, one, sigmas)
    unclear = near < level[n, k, None]
    np.minimum.at(found.separation, (n, k), np.min(np.where(unclear, np.inf, near), axis=1))
    m, arc = np.nonzero(unclear)
    if m.size == 0:
        return
    pair = n[m], k[m]
    unclear_arcs = _UnclearArcs(
        arcs=take(arcs.legs, m),
        arc=arc,
        begin=arcs.times[m, arc][:, None],
        step=arcs.step[m],
        relative_acceleration=arcs.relative_acceleration[m, arc][:, None],
    )
    near, begins = _parts(unclear_arcs, take(one, m), sigmas)
    lost = np.min(np.where(near < level[pair][:, None], begins, np.inf), axis=1)
    np.minimum.at(found.separation, pair, near.min(axis=1))
    np.minimum.at(found.loss, pair, np.maximum(lost, 0.0))


def _arcs(course: Course, since: Array, n: Array, leg: Array, traffic: Traffic) -> _Arcs:
    """Return the arcs of legs, by numbers of courses and of their legs ``[M]``, with an intruder
    each, ``[M, 1]``.
    """
    legs = take(course.legs, (n, leg))
    step = (legs.duration / ARCS)[:, None]
    times = (legs.time - since[n])[:, None] + np.arange(ARCS + 1) * step
    own = _own_acceleration(legs.speed, legs.acceleration, legs.yaw_rate, step)
    turns = times[:, :-1] < traffic.turn_time
    other = np.where(turns, traffic.state.speed * np.abs(traffic.turn_rate), 0.0)
    end_x, end_y = (field[n, leg + 1] for field in (course.plan_states.x, course.plan_states.y))
    return _Arcs(legs, end_x, end_y, times, step, own + other)


def _bound_arcs(arcs: _Arcs, traffic: Traffic, sigmas: float) -> Array:
    """Return a lower bound of the separation in each arc from intruders ``[M, 1]``, m, ``[M,
    ARCS]``; inf where an arc is past or its intruder above or below.
    """
    there = predict(traffic, arcs.times)
    own_x = np.concatenate([arcs.legs.x, arcs.end_x[:, None]], axis=1)
    own_y = np.concatenate([arcs.legs.y, arcs.end_y[:, None]], axis=1)
    x, y = there.x - own_x, there.y - own_y
    begin, end = arcs.times[:, :-1], arcs.times[:, 1:]
    near = (
        chord(x[:, :-1], y[:, :-1], x[:, 1:], y[:, 1:])
        - 0.125 * arcs.relative_acceleration * arcs.step * arcs.step
        - arcs.legs.miss[:, None]
    )
    near = near - growth(traffic, end, sigmas)
    counts = within_window(traffic, begin, end)
    return np.where((end > 0.0) & counts, near, np.inf)


class _UnclearArcs(NamedTuple):
    """Arcs whose chords do not decide; fields ``[M, 1]`` but for the first two."""

    arcs: Legs  # those of their legs, [M]
    arc: Array  # which of them, [M]
    begin: Array  # s from now
    step: Array  # how long they last, s
    relative_acceleration: Array  # a bound of it, m/s^2


def _parts(given: _UnclearArcs, traffic: Traffic, sigmas: float) -> tuple[Array, Array]:
    """Return a lower bound of the separation in each part of arcs from intruders ``[M, 1]``, m, and
    when the parts begin, s from now, ``[M, FINE]``.
    """
    row, begin, step = np.arange(given.arc.size), given.begin, given.step
    *state, yaw_rate, acceleration = column(take(given.arcs[3:], (row, given.arc)))
    # Parts already flown shrink to the present.
    parts = begin + np.arange(FINE + 1) * (step / FINE)
    parts = np.maximum(parts, np.minimum(0.0, begin + step))
    moved = advance(VehicleState(*state), acceleration, yaw_rate, parts - begin, ANY, np)
    there = predict(traffic, parts)
    x, y = there.x - moved.x, there.y - moved.y
    length = np.diff(parts, axis=1)
    near = (
        chord(x[:, :-1], y[:, :-1], x[:, 1:], y[:, 1:])
        - 0.125 * given.relative_acceleration * length * length
    )
    near = near - given.arcs.miss[:, None] - growth(traffic, parts[:, 1:], sigmas)
    counts = within_window(traffic, parts[:, :-1], parts[:, 1:])
    return np.where(counts, near, np.inf), parts[:, :-1]


def _own_acceleration(speed: Array, acceleration: Array, yaw_rate: Array, step: Array) -> Array:
    """Return the greatest acceleration of arcs of ``step`` seconds, along and across, m/s^2."""
    fastest = np.maximum(speed, speed + acceleration * step)
    return distance(acceleration, fastest * yaw_rate, np)


def growth(traffic: Traffic, time: Array, sigmas: float) -> Array:
    """Return what uncertainty adds to the required distance by some seconds from now, m.

    The intruders broadcast against the times.
    """
    if not (traffic.velocity_std.any() and sigmas):
        return 0.0
    return sigmas * (uncertainty(traffic, np.maximum(time, 0.0)) - uncertainty(traffic, 0.0))
