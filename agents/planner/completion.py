"""From the end of a manoeuvre on: along the rest of the route at constant speed, over one point after the other.

Each point is reached by a turn and a straight line onto it, in closed form; a point inside the turning circle is
passed by. The plan's knots are read off manoeuvre and tail at the waypoints' times, and the last one is the first
point of the route that is reached after the last of those.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from agents.manoeuvres.direct_to_goal import Task, end_speed
from agents.planner.options import Options, task_of
from agents.planner.rollout import Rollout
from envs.angles import wrap
from envs.kinematics import VehicleState
from envs.trees import take
from envs.waypoints import Knots

__all__ = ["Completed", "complete"]

_SPARE = 0.1  # least duration of the last leg, time steps
_EXTENSION = 5.0  # distance between points beyond the end of a route, separations


class Completed(NamedTuple):
    """Whole plans; fields ``[N]``."""

    knots: Knots
    """The request, the waypoints in between and the last point, ``[N, W + 1]``; nan where there is no whole plan."""
    last: Any
    """Number of the route's point that ends the plan; -1 where there is none; beyond the route's own points where
    it was extended."""
    too_short: Any
    """Whether the route ends before the plan does, bool."""
    rejoin_time: Any
    """When the goal's disc is entered, s; nan without a plan."""
    path: Any
    """Length until then, m."""
    reversals: Any
    """Changes of the turn's side until then."""


def complete(rollout: Rollout, route: tuple[Any, Any], points: Any, goal: Any, options: Options) -> Completed:
    """Complete manoeuvres to plans.

    Args:
        rollout: the manoeuvres, ``[N]``.
        route: its points, m, ``[N, R]`` each.
        points: how many of the R there are, ``[N]``.
        goal: number of the point to rejoin at, ``[N]``.
        options: how plans are made; turns between the points have the turn rate of :func:`task_of`.
    """
    task, extend, extension = task_of(options), options.extend_route, _EXTENSION * options.aircraft.separation
    finished_by = options.last_free + _SPARE * options.aircraft.dt
    count, most = np.shape(route[0])
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
    steps = most + 1 + (math.ceil(options.last_free * 1.5 * options.limits.speed_max / extension) if extend else 0)
    pieces = _Pieces(2 * steps + 1, rows.size)
    for step in range(steps):
        number, have = target[left], points[rows[left]]
        if not extend:
            ended = number >= have
            whole.too_short[rows[left[ended]]] = True
            left, number, have = left[~ended], number[~ended], have[~ended]
        if left.size == 0:
            break
        x, y = _point(route, rows[left], number, have, extension)
        state, at = take(now, left), time[left]
        arc, length, course, reached = _onto(state, x, y, task.turn_rate)
        turned = at + np.abs(arc) / task.turn_rate
        speed = state.speed
        if step == 0:
            # The goal itself must not be passed by, nor reached too late: there may be a need to accelerate.
            direct = ahead[left]
            straight = np.maximum(length - task.radius, 0.0)
            wanted, in_time = end_speed(straight, speed, task.until - turned, task.limits, np)
            on = ~direct | (reached & in_time)
            left, number, x, y, state, at, turned, speed = take((left, number, x, y, state, at, turned, speed), on)
            arc, length, course, reached = take((arc, length, course, reached), on)
            wanted, direct, straight = take((wanted, direct, straight), on)
            speed = np.where(direct, wanted, speed)
            there, which = rows[left[direct]], np.flatnonzero(direct)
            entered = turned + _duration(straight, state.speed, speed, task)
            whole.rejoin_time[there] = entered[which]
            whole.path[there] += (np.abs(arc) * state.speed / task.turn_rate + straight)[which]
            whole.reversals[there] += np.sign(arc[which]) * rollout.turn_sign[there] < 0.0
        none = np.zeros(left.size)
        pieces.add(left, np.where(reached, at, np.inf), state, np.sign(arc) * task.turn_rate, none)
        middle = _turned(state, arc, task.turn_rate)
        gain = np.where(speed > state.speed, task.limits.acceleration_max, 0.0)
        pieces.add(left, np.where(reached, turned, np.inf), middle, none, gain)
        arrived = turned + _duration(length, state.speed, speed, task)
        if step == 0:
            rise = (speed - state.speed) / task.limits.acceleration_max
            far = 0.5 * (speed + state.speed) * rise
            level = VehicleState(
                middle.x + far * np.cos(middle.heading), middle.y + far * np.sin(middle.heading), middle.heading, speed
            )
            pieces.add(left, np.where(reached & (rise > 0.0), turned + rise, np.inf), level, none, none)
        after = VehicleState(x, y, wrap(course, np), speed)
        for field, value in zip(now, after, strict=True):
            field[left] = np.where(reached, value, field[left])
        time[left] = np.where(reached, arrived, at)
        target[left] += 1
        done = reached & (arrived >= finished_by)
        whole.last[rows[left[done]]] = number[done]
        left = left[~done]
    whole.too_short[rows[left]] = True
    finished = np.flatnonzero(whole.last[rows] >= 0)
    times = np.arange(options.waypoints) * options.interval
    _read_off(whole.knots, times, rollout, rows, finished, pieces, take(now, finished), time[finished])
    return whole


def _point(route: tuple[Any, Any], rows: Any, number: Any, have: Any, extension: float) -> tuple[Any, Any]:
    """Return a point of the route, or one beyond its end in its last direction, m, ``[M]`` each."""
    inside = np.minimum(number, have - 1)
    x, y = route[0][rows, inside], route[1][rows, inside]
    over = number - inside
    if not over.any():
        return x, y
    before = np.maximum(have - 2, 0)
    dx, dy = x - route[0][rows, before], y - route[1][rows, before]
    step = over * extension / np.maximum(np.hypot(dx, dy), 1e-9)
    return x + np.where(over > 0, dx * step, 0.0), y + np.where(over > 0, dy * step, 0.0)


def _onto(state: VehicleState, x: Any, y: Any, turn_rate: float) -> tuple[Any, Any, Any, Any]:
    """Return the turn (rad), the straight (m) after it, the course then, and whether the point can be reached so."""
    sine, cosine = np.sin(state.heading), np.cos(state.heading)
    dx, dy = x - state.x, y - state.y
    side = np.where(dy * cosine - dx * sine >= 0.0, 1.0, -1.0)
    radius = state.speed / turn_rate
    dx, dy = dx + side * radius * sine, dy - side * radius * cosine
    square = dx * dx + dy * dy - radius * radius
    length = np.sqrt(np.maximum(square, 0.0))
    course = np.arctan2(dy, dx) + side * np.arctan2(radius, length)
    turn = np.mod(side * (course - state.heading), 2.0 * math.pi)
    # A point straight ahead must not become a full circle by rounding; one to be turned to by more than half a circle
    # is behind, and passed by.
    turn = np.where(turn > 2.0 * math.pi - 1e-6, 0.0, turn)
    reached = (square > 0.0) & (turn <= math.pi)
    return np.where(reached, side * turn, 0.0), length, course, reached


def _turned(state: VehicleState, arc: Any, turn_rate: float) -> VehicleState:
    chord = state.speed * np.abs(arc) / turn_rate * np.sinc(arc / (2.0 * math.pi))
    middle = state.heading + 0.5 * arc
    return VehicleState(
        state.x + chord * np.cos(middle), state.y + chord * np.sin(middle), state.heading + arc, state.speed
    )


def _duration(length: Any, speed: Any, wanted: Any, task: Task) -> Any:
    """Return the time for a length, s: accelerating from a speed to another, then holding that."""
    rise = (wanted - speed) / task.limits.acceleration_max
    return rise + (length - 0.5 * (speed + wanted) * rise) / wanted


class _Pieces:
    """Parts of the tails: begin time, x, y, heading, speed, yaw rate and acceleration, ``[7, P, N]``.

    A part that begins at infinity is not flown. None both turns and accelerates.
    """

    def __init__(self, most: int, count: int) -> None:
        self._fields = np.zeros((7, most, count))
        self._fields[0] = np.inf
        self._used = 0

    def add(self, rows: Any, time: Any, state: VehicleState, rate: Any, gain: Any) -> None:
        """Add a part of some tails, ``[M]`` each."""
        self._fields[:, self._used, rows] = (time, *state, rate, gain)
        self._used += 1

    def of(self, rows: Any) -> Any:
        """Return the parts of some tails, ``[7, M, P]``."""
        return np.moveaxis(self._fields[:, : self._used, rows], 1, 2)


def _read_off(
    knots: Knots, times: Any, rollout: Rollout, rows: Any, whole: Any, pieces: _Pieces, end: VehicleState, end_time: Any
) -> None:
    if whole.size == 0:
        return
    out = rows[whole]
    parts = pieces.of(whole)
    # The last part begun by each time; parts that are not flown begin never.
    begun = parts[0][:, None] <= times[:, None]
    number = np.where(begun.any(axis=-1), begun.shape[-1] - 1 - np.argmax(begun[..., ::-1], axis=-1), 0)
    began, x, y, heading, speed, rate, gain = (np.take_along_axis(field, number, axis=-1) for field in parts)
    seconds = np.where(begun.any(axis=-1), times - began, 0.0)
    arc = rate * seconds
    chord = (speed + 0.5 * gain * seconds) * seconds * np.sinc(arc / (2.0 * math.pi))
    middle = heading + 0.5 * arc
    tail = (x + chord * np.cos(middle), y + chord * np.sin(middle), heading + arc, speed + gain * seconds)
    flown = times <= rollout.time[out][:, None]
    have = min(times.size, rollout.knots.x.shape[1])
    for field, manoeuvre, after, final in zip(knots[:4], rollout.knots, tail, end, strict=True):
        before = np.full((out.size, times.size), np.nan)
        before[:, :have] = manoeuvre[out, :have]
        field[out, :-1] = np.where(flown, before, after)
        field[out, -1] = final
    knots.heading[out] = wrap(knots.heading[out], np)
    knots.time[out, :-1], knots.time[out, -1] = times, end_time
