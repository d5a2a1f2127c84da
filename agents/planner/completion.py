"""From the end of a manoeuvre on: along the rest of the route at constant speed, over one point
after the other.

Each point is reached by a turn and a straight line onto it, in closed form; a point inside the
turning circle is passed by. The plan's states are read off manoeuvre and tail at the waypoints'
times, and the last one is the first point of the route that is reached after the last of those.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from agents.manoeuvres.direct_to_goal import DirectTask, arc_end, end_speed
from agents.planner.options import Options, task_of
from agents.planner.request import Request, drift_points, latest_end
from agents.planner.rollout import Rollout
from envs.angles import wrap
from envs.kinematics import VehicleState
from envs.trees import scatter, take
from envs.waypoints import PlanStates

_SECANTS = 12  # of the search for when a drifting point is met
_SAME_PLACE = 1e-6  # m by which it may be missed


class Completed(NamedTuple):
    """Whole plans, as in :class:`agents.planner.candidates.Proposals`; fields ``[N]``."""

    plan_states: PlanStates
    last: Any
    too_short: Any
    rejoin_time: Any
    path: Any
    reversals: Any  # changes of the turn's side until the rejoining


class _Legs(NamedTuple):
    """The next leg of some tails, fields ``[M]``: a turn at the task's rate, then straight on."""

    tail: Any  # numbers of the tails
    point: Any  # numbers of the route's points at their ends
    x: Any  # of those points, m
    y: Any
    begin: VehicleState
    began: Any  # s
    arc: Any  # of the turn, rad, positive to the left
    length: Any  # of the straight part, m
    course: Any  # of the straight part, rad
    reached: Any  # whether the point can be reached so; else it is passed by, bool
    turned: Any  # time at which the straight part begins, s
    disc: Any  # how far before the point on the straight part its disc begins, m
    speed: Any  # at the end, m/s; it differs from that at the beginning on the way to the goal only
    in_time: Any  # whether the goal can be reached in time, bool; true of all other points


def complete(request: Request, rollout: Rollout, goal: Any, options: Options) -> Completed:
    """Complete manoeuvres ``[N]`` to plans that rejoin at points number ``goal``, ``[N]``."""
    task, (count, most) = task_of(options), request.route_x.shape
    blows = 0.0 if request.drift is None else np.max(np.hypot(*request.drift), initial=0.0)
    latest = latest_end(request, options)
    whole = Completed(
        PlanStates(*(np.full((count, options.waypoints + 1), np.nan) for _ in range(5))),
        np.full(count, -1),
        np.zeros(count, dtype=bool),
        np.where(rollout.direct, np.nan, rollout.time),
        rollout.path.copy(),
        rollout.reversals.copy(),
    )
    # A tail for each manoeuvre that ends: where it is now, when, and the next point of the route.
    rows = np.flatnonzero(np.isfinite(rollout.time))
    now, time = take(rollout.end, rows), rollout.time[rows]
    target = goal[rows] + np.where(rollout.direct[rows], 0, 1)
    left, pieces = np.arange(rows.size), []
    for step in range(most + 1 + points_beyond(options, blows)):
        if not options.extend_route:
            ended = target[left] >= request.points[rows[left]]
            whole.too_short[rows[left[ended]]] = True
            left = left[~ended]
        if left.size == 0:
            break
        direct = rollout.direct[rows[left]] if step == 0 else None
        begin = take((now, time), left)
        legs = _next_legs(request, rows, left, target[left], begin, direct, options)
        if step == 0:
            legs = _to_goal(whole, rollout, rows, legs, task)
        target[legs.tail] += 1
        passed_by, legs = legs.tail[~legs.reached], take(legs, legs.reached)
        pieces += _pieces(rows.size, legs, task)
        if step == 0:
            pieces.append(_level_piece(rows.size, legs, task))
        arrived = _end(legs, task)
        there = VehicleState(legs.x, legs.y, wrap(legs.course, np), legs.speed)
        scatter((now, time), legs.tail, (there, arrived))
        done = arrived >= options.finished_by
        if request.of_route is not None:  # a plan ends at a point of the route itself
            asked = request.of_route[rows[legs.tail], np.minimum(legs.point, most - 1)]
            done &= (asked >= 0) | (legs.point >= most)
        in_time = done & (arrived <= latest[rows[legs.tail]])
        whole.last[rows[legs.tail[in_time]]] = legs.point[in_time]
        left = np.sort(np.concatenate([passed_by, legs.tail[~done]]))
    whole.too_short[rows[left]] = True
    finished = np.flatnonzero(whole.last[rows] >= 0)
    if finished.size:
        parts = np.moveaxis(np.stack(pieces)[:, :, finished], 0, 2)
        _read_off(
            whole.plan_states, options, rollout, rows[finished], parts, *take((now, time), finished)
        )
    return whole


def points_beyond(options: Options, wind: float) -> int:
    """Return how many points beyond the end of its route a plan may fly over in some wind, m/s."""
    if not options.extend_route:
        return 0
    fastest = 1.5 * options.limits.speed_max + wind
    return math.ceil(options.last_free * fastest / options.extension)


def _next_legs(
    request: Request,
    rows: Any,
    tails: Any,
    point: Any,
    begin: tuple[VehicleState, Any],
    direct: Any | None,
    options: Options,
) -> _Legs:
    """Return the legs of some tails, of requests ``rows[tails]``, to points of the route.

    A tail begins in a state at a time, s; ``direct`` says which lead to the goal (None: none):
    there may be a need to accelerate.
    """
    task, (state, time) = task_of(options), begin
    at_request = _point(request, rows[tails], point, options.extension)
    drift = take(request.drift, rows[tails])

    def legs_to(when: Any) -> _Legs:
        x, y = drift_points(at_request, drift, when)
        arc, length, course, reached = _onto(state, x, y, task.turn_rate)
        turned = time + np.abs(arc) / task.turn_rate
        way = tails, point, x, y, state, time, arc, length, course, reached, turned
        if direct is None:
            return _Legs(*way, disc=length, speed=state.speed, in_time=reached)
        disc = np.full(length.shape, task.radius)
        if drift is not None:
            disc = _disc(state.speed, course, drift, task.radius)
        straight = np.maximum(length - disc, 0.0)
        wanted, in_time = end_speed(straight, state.speed, task.until - turned, task.limits, np)
        return _Legs(*way, disc, np.where(direct, wanted, state.speed), in_time | ~direct)

    return legs_to(time) if drift is None else _meeting(legs_to, time, drift, task)


def _disc(speed: Any, course: Any, drift: tuple[Any, Any], radius: float) -> Any:
    """Return how far an aircraft flies through the air from the edge of a drifting point's disc to
    the point, m.
    """
    closing = np.hypot(speed * np.cos(course) - drift[0], speed * np.sin(course) - drift[1])
    return speed * radius / np.maximum(closing, 1e-3)


def _meeting(
    legs_to: Callable[[Any], _Legs], time: Any, drift: tuple[Any, Any], task: DirectTask
) -> _Legs:
    """Return the legs that end where the points are when they end: by secants on the time of that.

    A point that is not met so is not reached.
    """
    strength = np.hypot(*drift)
    before, legs = time, legs_to(time)
    late_before = _end(legs, task) - before
    when = before + late_before
    for _ in range(_SECANTS):
        legs = legs_to(when)
        late = _end(legs, task) - when
        # Legs that are found stay as they are, however many others are still searched.
        going_on = np.abs(late) * strength > _SAME_PLACE
        if not going_on.any():
            break
        slope = (late - late_before) / np.where(when == before, 1.0, when - before)
        # A slope that is not negative belongs to another turn or to a point that gets away.
        step = late / np.where(slope < -0.1, -slope, 1.0)
        before, late_before = when, late
        when = np.where(going_on, np.maximum(when + step, time), when)
    met = np.abs(_end(legs, task) - when) * strength <= _SAME_PLACE
    return legs._replace(reached=legs.reached & met)


def _end(legs: _Legs, task: DirectTask) -> Any:
    """Return when legs end, s."""
    return legs.turned + _duration(legs.length, legs.begin.speed, legs.speed, task)


def _to_goal(whole: Completed, rollout: Rollout, rows: Any, legs: _Legs, task: DirectTask) -> _Legs:
    """Return the first legs, without those that miss the goal, and note when the goal is reached.

    The goal itself must not be passed by, nor reached too late.
    """
    direct = rollout.direct[rows[legs.tail]]
    on = ~direct | (legs.reached & legs.in_time)
    legs, direct = take((legs, direct), on)
    straight = np.maximum(legs.length - legs.disc, 0.0)
    entered = legs.turned + _duration(straight, legs.begin.speed, legs.speed, task)
    there = rows[legs.tail[direct]]
    whole.rejoin_time[there] = entered[direct]
    flown = np.abs(legs.arc) * legs.begin.speed / task.turn_rate + straight
    whole.path[there] += flown[direct]
    whole.reversals[there] += np.sign(legs.arc[direct]) * rollout.turn_sign[there] < 0.0
    return legs


def _pieces(count: int, legs: _Legs, task: DirectTask) -> list[Any]:
    """Return the turns and the straight parts of legs as pieces of ``count`` tails."""
    none = np.zeros(legs.tail.size)
    faster = legs.speed > legs.begin.speed
    gain = np.where(faster, task.limits.acceleration_max, 0.0)
    turn_rate = np.sign(legs.arc) * task.turn_rate
    middle = _turn(legs.begin, legs.arc, task.turn_rate)
    return [
        _piece(count, legs.tail, legs.began, *legs.begin, turn_rate, none),
        _piece(count, legs.tail, legs.turned, *middle, none, gain),
    ]


def _level_piece(count: int, legs: _Legs, task: DirectTask) -> Any:
    """Return what follows where the speed at the leg's end is reached, as a piece of the tails."""
    none = np.zeros(legs.tail.size)
    rise = (legs.speed - legs.begin.speed) / task.limits.acceleration_max
    far = 0.5 * (legs.speed + legs.begin.speed) * rise
    middle = _turn(legs.begin, legs.arc, task.turn_rate)
    x, y = middle.x + far * np.cos(middle.heading), middle.y + far * np.sin(middle.heading)
    begin = np.where(rise > 0.0, legs.turned + rise, np.inf)
    return _piece(count, legs.tail, begin, x, y, middle.heading, legs.speed, none, none)


def _point(request: Request, rows: Any, number: Any, extension: float) -> tuple[Any, Any]:
    """Return a point of the route, or one beyond its end in its last direction, m, ``[M]`` each."""
    have = request.points[rows]
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


def _turn(state: VehicleState, arc: Any, turn_rate: float) -> VehicleState:
    x, y = arc_end(state, arc, state.speed * np.abs(arc) / turn_rate)
    return VehicleState(x, y, state.heading + arc, state.speed)


def _duration(length: Any, speed: Any, wanted: Any, task: DirectTask) -> Any:
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
    plan_states: PlanStates,
    options: Options,
    rollout: Rollout,
    out: Any,
    parts: Any,
    end: VehicleState,
    end_time: Any,
) -> None:
    """Write the plan states of the whole plans numbered ``out`` from the pieces of their tails
    ``[7, M, P]``.
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
    have = min(times.size, rollout.plan_states.x.shape[1])
    for field, manoeuvre, after, final in zip(
        plan_states[:4], rollout.plan_states, tail, end, strict=True
    ):
        before = np.full((out.size, times.size), np.nan)
        before[:, :have] = manoeuvre[out, :have]
        field[out, :-1] = np.where(flown, before, after)
        field[out, -1] = final
    plan_states.heading[out] = wrap(plan_states.heading[out], np)
    plan_states.time[out, :-1], plan_states.time[out, -1] = times, end_time
