"""Manoeuvres completed to plans one after the other, in plain floats and loops: what is compiled
(:mod:`envs.compiled`).

Without numba :mod:`agents.planner.search.completion` does the same, many side by side.
"""

import math
from typing import NamedTuple

import numpy as np

from agents.manoeuvres.direct_to_goal import DirectTask, scalar_arc_end
from agents.planner.search.onward import (
    Leg,
    Onward,
    after_turn,
    duration,
    end_of,
    leg_to,
    scalar_leg_to_meet,
)
from envs.angles import wrap
from envs.arrays import Array
from envs.backend import FLOATS
from envs.compiled import Entry, scalar
from envs.frames import Air
from envs.kinematics import Limits, VehicleState

_ALONG, _LAST, _TOO_SHORT = range(3)  # the leg flown; the plan's last one; no leg in time


class Manoeuvres(NamedTuple):
    """Manoeuvres as of :class:`agents.planner.search.rollout.Rollout`; fields ``[N]``."""

    states: Array  # plan states, [N, 4, S]
    end: VehicleState[Air]
    time: Array
    direct: Array  # bool
    turn_sign: Array


class Routes(NamedTuple):
    """What each manoeuvre comes back to; fields ``[N]``."""

    x: Array  # the route's points, at the request, m, [N, R]
    y: Array
    of_route: Array  # whether a plan may end at each of them, bool, [N, R]
    points: Array  # how many there are
    goal: Array  # number of the point at which the route is rejoined
    latest: Array  # time at which a plan ends at the latest, s
    east: Array  # drift of the points, m/s; empty: they stand still
    north: Array


class Whole(NamedTuple):
    """What a plan must be; plain numbers."""

    task: DirectTask
    interval: float  # between waypoints, s
    finished_by: float  # the last leg ends at or after this, s
    extension: float  # between points beyond the route's end, m
    extends: bool  # whether there are such points
    legs: int  # at most


class Plans(NamedTuple):
    """Plans as of :class:`agents.planner.search.completion.Completed`, written in place; fields
    ``[N]``.
    """

    states: Array  # [N, 5, W + 1]
    last: Array
    too_short: Array  # bool
    rejoin_time: Array
    path: Array
    reversals: Array


@scalar
def complete_each(manoeuvres: Manoeuvres, routes: Routes, whole: Whole, plans: Plans) -> None:
    """Complete the manoeuvres that have ended, and write the plans."""
    pieces = np.empty((2 * whole.legs + 1, 7))
    for n in range(len(manoeuvres.time)):
        if math.isfinite(manoeuvres.time[n]):
            _complete(n, manoeuvres, routes, whole, plans, pieces)


@scalar
def _complete(
    n: int, manoeuvres: Manoeuvres, routes: Routes, whole: Whole, plans: Plans, pieces: Array
) -> None:
    task, point = whole.task, routes.goal[n]
    if not manoeuvres.direct[n]:
        point += 1
    end = manoeuvres.end
    state: VehicleState[Air] = VehicleState(end.x[n], end.y[n], end.heading[n], end.speed[n])
    time, count = manoeuvres.time[n], 0
    for number in range(whole.legs):
        if not whole.extends and point >= routes.points[n]:
            plans.too_short[n] = True
            return
        to_goal = number == 0 and manoeuvres.direct[n]
        leg, reached = _next_leg(n, point, state, time, to_goal, routes, whole)
        if to_goal:
            if not (reached and leg.in_time):
                return
            _note_rejoining(n, leg, manoeuvres, plans, task)
        if reached:
            count = _add(pieces, count, leg, number == 0, task)
            time = end_of(leg, task)
            state = VehicleState(leg.x, leg.y, wrap(leg.course, FLOATS), leg.speed)
            if time >= whole.finished_by and (
                point >= routes.of_route.shape[1] or routes.of_route[n, point]
            ):
                if time <= routes.latest[n]:
                    plans.last[n] = point
                    _read_off(n, manoeuvres, state, time, whole, pieces[:count], plans)
                return
        point += 1
    plans.too_short[n] = True


@scalar
def _next_leg(
    n: int,
    point: int,
    state: VehicleState[Air],
    time: float,
    to_goal: bool,
    routes: Routes,
    whole: Whole,
) -> tuple[Leg, bool]:
    """Return the leg to a point of a route, and whether the point can be reached."""
    place = _place(n, point, routes, whole.extension)
    if len(routes.east) == 0:
        leg = leg_to(Onward(place, state, time, to_goal), None, time, whole.task, FLOATS)
        return leg, leg.reached
    drift = routes.east[n], routes.north[n]
    return scalar_leg_to_meet(Onward(place, state, time, to_goal), drift, whole.task)


@scalar
def _place(n: int, point: int, routes: Routes, extension: float) -> tuple[float, float]:
    """Return a point of a route, or one beyond its end in its last direction, m."""
    inside = min(point, routes.points[n] - 1)
    x, y = routes.x[n, inside], routes.y[n, inside]
    if point == inside:
        return x, y
    before = max(routes.points[n] - 2, 0)
    dx, dy = x - routes.x[n, before], y - routes.y[n, before]
    step = (point - inside) * extension / max(math.hypot(dx, dy), 1e-9)
    return x + dx * step, y + dy * step


@scalar
def _note_rejoining(
    n: int, leg: Leg, manoeuvres: Manoeuvres, plans: Plans, task: DirectTask
) -> None:
    """Note when the goal is reached on the direct route, on which path, and whether that turns to
    the other side.
    """
    straight = max(leg.length - leg.disc, 0.0)
    plans.rejoin_time[n] = leg.turned + duration(straight, leg.begin.speed, leg.speed, task)
    plans.path[n] += abs(leg.arc) * leg.begin.speed / task.turn_rate + straight
    if leg.arc * manoeuvres.turn_sign[n] < 0.0:
        plans.reversals[n] += 1.0


@scalar
def _add(pieces: Array, count: int, leg: Leg, level: bool, task: DirectTask) -> int:
    """Write the turn and the straight part of a leg, and with ``level`` what follows where its last
    speed is reached; return the number of pieces then.
    """
    begin, middle = leg.begin, after_turn(leg, task)
    gain = task.limits.acceleration_max if leg.speed > begin.speed else 0.0
    turn_rate = math.copysign(task.turn_rate, leg.arc) if leg.arc != 0.0 else 0.0
    _write(pieces[count], leg.began, begin, turn_rate, 0.0)
    _write(pieces[count + 1], leg.turned, middle, 0.0, gain)
    rise = (leg.speed - begin.speed) / task.limits.acceleration_max
    if not (level and rise > 0.0):
        return count + 2
    far = 0.5 * (leg.speed + begin.speed) * rise
    x = middle.x + far * math.cos(middle.heading)
    y = middle.y + far * math.sin(middle.heading)
    reached: VehicleState[Air] = VehicleState(x, y, middle.heading, leg.speed)
    _write(pieces[count + 2], leg.turned + rise, reached, 0.0, 0.0)
    return count + 3


@scalar
def _write(
    piece: Array, begin: float, state: VehicleState[Air], turn_rate: float, acceleration: float
) -> None:
    piece[0], piece[1], piece[2] = begin, state.x, state.y
    piece[3], piece[4], piece[5], piece[6] = state.heading, state.speed, turn_rate, acceleration


@scalar
def _read_off(
    n: int,
    manoeuvres: Manoeuvres,
    end: VehicleState[Air],
    time: float,
    whole: Whole,
    pieces: Array,
    plans: Plans,
) -> None:
    """Write the plan's states: the manoeuvre's, then those on the pieces, and the end."""
    states, last = plans.states[n], plans.states.shape[2] - 1
    for i in range(last):
        when = i * whole.interval
        states[4, i] = when
        if when <= manoeuvres.time[n] and i < manoeuvres.states.shape[2]:
            for field in range(4):
                states[field, i] = manoeuvres.states[n, field, i]
        else:
            state = _on_pieces(pieces, when)
            states[0, i], states[1, i] = state.x, state.y
            states[2, i], states[3, i] = state.heading, state.speed
        states[2, i] = wrap(states[2, i], FLOATS)
    states[0, last], states[1, last] = end.x, end.y
    states[2, last], states[3, last] = wrap(end.heading, FLOATS), end.speed
    states[4, last] = time


@scalar
def _on_pieces(pieces: Array, when: float) -> VehicleState[Air]:
    """Return the state on the last piece that has begun by a time."""
    number = 0
    for i in range(len(pieces)):
        if pieces[i, 0] <= when:
            number = i
    piece = pieces[number]
    began: VehicleState[Air] = VehicleState(piece[1], piece[2], piece[3], piece[4])
    turn_rate, acceleration, seconds = piece[5], piece[6], when - piece[0]
    arc = turn_rate * seconds
    length = (began.speed + 0.5 * acceleration * seconds) * seconds
    x, y = scalar_arc_end(began, arc, length)
    return VehicleState(x, y, began.heading + arc, began.speed + acceleration * seconds)


def _examples() -> list[tuple[object, ...]]:
    zero, numbers, truths = np.zeros(1), np.zeros(1, np.int64), np.zeros(1, bool)
    end: VehicleState[Air] = VehicleState(zero, zero, zero, zero)
    limits = Limits(1.0, 2.0, -1.0, 1.0, 1.0)
    return [
        (
            Manoeuvres(np.zeros((1, 4, 1)), end, zero, truths, zero),
            Routes(zero[None], zero[None], truths[None], numbers, numbers, zero, np.zeros(0), zero),
            Whole(DirectTask(limits, 1.0, 1.0, 1.0), 1.0, 1.0, 1.0, True, 1),
            Plans(np.zeros((1, 5, 1)), numbers, truths, zero, zero, zero),
        )
    ]


COMPLETE_EACH = Entry(complete_each, _examples)
"""Compiled :func:`complete_each`."""
