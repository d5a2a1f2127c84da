"""From the end of a manoeuvre on: along the rest of the route at constant speed, over one point
after the other.

Each point is reached by a turn and a straight line onto it, in closed form; a point inside the
turning circle is passed by. The plan's knots are read off manoeuvre and tail at the waypoints'
times, and the last one is the first point of the route that is reached after the last of those.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from agents.manoeuvres.direct_to_goal import Task, arc_end, end_speed
from agents.planner.options import Options, task_of
from agents.planner.request import Request
from agents.planner.rollout import Rollout
from envs.angles import wrap
from envs.kinematics import VehicleState
from envs.trees import scatter, take
from envs.waypoints import Knots

_SPARE = 0.1  # least duration of the last leg, time steps
_EXTENSION = 5.0  # distance between points beyond the end of a route, separations


class Completed(NamedTuple):
    """Whole plans, as in :class:`agents.planner.candidates.Proposals`; fields ``[N]``."""

    knots: Knots
    last: Any
    too_short: Any
    rejoin_time: Any
    path: Any
    reversals: Any  # changes of the turn's side until the rejoining


def complete(request: Request, rollout: Rollout, goal: Any, options: Options) -> Completed:
    """Complete manoeuvres ``[N]`` to plans that rejoin at points number ``goal``, ``[N]``."""
    task, extend, extension = (
        task_of(options),
        options.extend_route,
        _EXTENSION * options.aircraft.separation,
    )
    finished_by = options.last_free + _SPARE * options.aircraft.dt
    count, most = request.route_x.shape
    rows = np.flatnonzero(np.isfinite(rollout.time))
    now = take(rollout.end, rows)
    time, ahead = rollout.time[rows], rollout.direct[rows]
    target = goal[rows] + np.where(ahead, 0, 1)
    whole = Completed(
        Knots(*(np.full((count, options.waypoints + 1), np.nan) for _ in range(5))),
        np.full(count, -1),
        np.zeros(count, dtype=bool),
        np.where(rollout.direct, np.nan, rollout.time),
        rollout.path.copy(),
        rollout.reversals.copy(),
    )
    left = np.arange(rows.size)
    pieces = []
    steps = (
        most
        + 1
        + (
            math.ceil(options.last_free * 1.5 * options.limits.speed_max / extension)
            if extend
            else 0
        )
    )
    for step in range(steps):
        number, have = target[left], request.points[rows[left]]
        if not extend:
            ended = number >= have
            whole.too_short[rows[left[ended]]] = True
            left, number, have = left[~ended], number[~ended], have[~ended]
        if left.size == 0:
            break
        x, y = _point(request, rows[left], number, have, extension)
        state, at = take(now, left), time[left]
        arc, length, course, reached = _onto(state, x, y, task.turn_rate)
        turned, speed = at + np.abs(arc) / task.turn_rate, state.speed
        if step == 0:
            # The goal itself must not be passed by, nor reached too late: there may be a need to
            # accelerate.
            direct = ahead[left]
            straight = np.maximum(length - task.radius, 0.0)
            wanted, in_time = end_speed(straight, speed, task.until - turned, task.limits, np)
            on = ~direct | (reached & in_time)
            left, number, x, y, state, at, turned, speed = take(
                (left, number, x, y, state, at, turned, speed), on
            )
            wanted, direct, straight, arc, length, course, reached = take(
                (wanted, direct, straight, arc, length, course, reached), on
            )
            speed = np.where(direct, wanted, speed)
            there, which = rows[left[direct]], np.flatnonzero(direct)
            entered = turned + _duration(straight, state.speed, speed, task)
            whole.rejoin_time[there] = entered[which]
            whole.path[there] += (np.abs(arc) * state.speed / task.turn_rate + straight)[which]
            whole.reversals[there] += np.sign(arc[which]) * rollout.turn_sign[there] < 0.0
        target[left] += 1
        on = left[reached]
        if not reached.all():
            number, x, y, state, at, turned, speed, arc, length, course = take(
                (number, x, y, state, at, turned, speed, arc, length, course), reached
            )
        none, gain = (
            np.zeros(on.size),
            np.where(speed > state.speed, task.limits.acceleration_max, 0.0),
        )
        middle = _turned(state, arc, task.turn_rate)
        pieces += [_piece(rows.size, on, at, *state, np.sign(arc) * task.turn_rate, none)]
        pieces += [_piece(rows.size, on, turned, *middle, none, gain)]
        arrived = turned + _duration(length, state.speed, speed, task)
        if step == 0:
            rise = (speed - state.speed) / task.limits.acceleration_max
            far = 0.5 * (speed + state.speed) * rise
            level = (
                middle.x + far * np.cos(middle.heading),
                middle.y + far * np.sin(middle.heading),
                middle.heading,
            )
            begin = np.where(rise > 0.0, turned + rise, np.inf)
            pieces += [_piece(rows.size, on, begin, *level, speed, none, none)]
        scatter((now, time), on, (VehicleState(x, y, wrap(course, np), speed), arrived))
        done = arrived >= finished_by
        whole.last[rows[on[done]]] = number[done]
        left = np.sort(np.concatenate([left[~reached], on[~done]]))
    whole.too_short[rows[left]] = True
    finished = np.flatnonzero(whole.last[rows] >= 0)
    if finished.size:
        parts = np.moveaxis(np.stack(pieces)[:, :, finished], 0, 2)
        _read_off(
            whole.knots, options, rollout, rows[finished], parts, *take((now, time), finished)
        )
    return whole


def _point(
    request: Request, rows: Any, number: Any, have: Any, extension: float
) -> tuple[Any, Any]:
    """Return a point of the route, or one beyond its end in its last direction, m, ``[M]`` each."""
    inside = np.minimum(number, have - 1)
    x, y = request.route_x[rows, inside], request.route_y[rows, inside]
    over = number - inside
    if not over.any():
        return x, y
    before = np.maximum(have - 2, 0)
    dx, dy = x - request.route_x[rows, before], y - request.route_y[rows, before]
    step = over * extension / np.maximum(np.hypot(dx, dy), 1e-9)
    return x + np.where(over > 0, dx * step, 0.0), y + np.where(over > 0, dy * step, 0.0)


def _onto(state: VehicleState, x: Any, y: Any, turn_rate: float) -> tuple[Any, Any, Any, Any]:
    """Return the turn (rad), the straight (m) after it, the course then, and whether the point can
    be reached so.
    """
    sine, cosine = np.sin(state.heading), np.cos(state.heading)
    dx, dy = x - state.x, y - state.y
    side = np.where(dy * cosine - dx * sine >= 0.0, 1.0, -1.0)
    radius = state.speed / turn_rate
    dx, dy = dx + side * radius * sine, dy - side * radius * cosine
    square = dx * dx + dy * dy - radius * radius
    length = np.sqrt(np.maximum(square, 0.0))
    course = np.arctan2(dy, dx) + side * np.arctan2(radius, length)
    turn = np.mod(side * (course - state.heading), 2.0 * math.pi)
    # A point straight ahead must not become a full circle by rounding; one to be turned to by more
    # than half a circle is behind, and passed by.
    turn = np.where(turn > 2.0 * math.pi - 1e-6, 0.0, turn)
    reached = (square > 0.0) & (turn <= math.pi)
    return np.where(reached, side * turn, 0.0), length, course, reached


def _turned(state: VehicleState, arc: Any, turn_rate: float) -> VehicleState:
    x, y = arc_end(state, arc, state.speed * np.abs(arc) / turn_rate)
    return VehicleState(x, y, state.heading + arc, state.speed)


def _duration(length: Any, speed: Any, wanted: Any, task: Task) -> Any:
    """Return the time for a length, s: accelerating from a speed to another, then holding that."""
    rise = (wanted - speed) / task.limits.acceleration_max
    return rise + (length - 0.5 * (speed + wanted) * rise) / wanted


def _piece(count: int, rows: Any, *values: Any) -> Any:
    """Return a piece of some of the tails, ``[7, count]``: begin (inf: not flown), state, yaw rate,
    acceleration.
    """
    piece = np.zeros((7, count))
    piece[0] = np.inf
    piece[:, rows] = values
    return piece


def _read_off(
    knots: Knots,
    options: Options,
    rollout: Rollout,
    out: Any,
    parts: Any,
    end: VehicleState,
    end_time: Any,
) -> None:
    """Write the knots of the whole plans numbered ``out`` from the pieces of their tails ``[7, M,
    P]``.
    """
    times = np.arange(options.waypoints) * options.interval
    # The last part begun by each time; parts that are not flown begin never.
    begun = parts[0][:, None] <= times[:, None]
    number = np.where(
        begun.any(axis=-1), begun.shape[-1] - 1 - np.argmax(begun[..., ::-1], axis=-1), 0
    )
    began, x, y, heading, speed, rate, gain = np.take_along_axis(parts, number[None], axis=-1)
    seconds = np.where(begun.any(axis=-1), times - began, 0.0)
    arc = rate * seconds
    there = arc_end(
        VehicleState(x, y, heading, speed), arc, (speed + 0.5 * gain * seconds) * seconds
    )
    tail = (*there, heading + arc, speed + gain * seconds)
    flown = times <= rollout.time[out][:, None]
    have = min(times.size, rollout.knots.x.shape[1])
    for field, manoeuvre, after, final in zip(knots[:4], rollout.knots, tail, end, strict=True):
        before = np.full((out.size, times.size), np.nan)
        before[:, :have] = manoeuvre[out, :have]
        field[out, :-1] = np.where(flown, before, after)
        field[out, -1] = final
    knots.heading[out] = wrap(knots.heading[out], np)
    knots.time[out, :-1], knots.time[out, -1] = times, end_time
