"""From the end of a manoeuvre on: along the rest of the route at constant speed, over one point
after the other.

Each point is reached by a turn and a straight line onto it, in closed form; a point inside the
turning circle is passed by. The plan's states are read off manoeuvre and tail at the waypoints'
times, and the last one is the first point of the route that is reached after the last of those.
"""

from typing import NamedTuple

import numpy as np

from agents.manoeuvres.direct_to_goal import DirectTask, arc_end
from agents.planner.request.options import Narrowed, Options, plain_task, task_of
from agents.planner.request.request import Request, latest_end
from agents.planner.search.completion_of_each import (
    COMPLETE_EACH,
    Manoeuvres,
    Plans,
    Routes,
    Whole,
)
from agents.planner.search.onward import Leg, Onward, duration, end_of, leg_to, legs_to_meet
from agents.planner.search.rollout import Rollout
from envs.angles import wrap
from envs.arrays import Array, Int
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.trees import contiguous, scatter, take
from envs.waypoints import PlanStates


class Completed(NamedTuple):
    """Whole plans, as in :class:`agents.planner.search.candidates.Candidates`; fields ``[N]``."""

    plan_states: PlanStates[Air]
    last: Array
    too_short: Array
    rejoin_time: Array
    path: Array
    reversals: Array  # changes of the turn's side until the rejoining


class _Tails(NamedTuple):
    """Plans from the ends of their manoeuvres on, as far as they have got; fields ``[M]``."""

    row: Array  # numbers of the manoeuvres
    state: VehicleState[Air]
    time: Array  # s
    point: Array  # number of the route's point that comes next
    direct: Array  # whether the first leg leads to the goal, bool


class _Legs(NamedTuple):
    """The next legs of some tails, fields ``[L]``."""

    tail: Array  # numbers of the tails
    point: Array  # numbers of the route's points at their ends
    leg: Leg


class _Piece(NamedTuple):
    """A part of tails under constant controls; fields ``[M]``."""

    begin: Array  # s; inf: not flown
    x: Array  # these four at its beginning, m
    y: Array
    heading: Array  # rad
    speed: Array  # m/s
    turn_rate: Array  # rad/s
    acceleration: Array  # m/s^2


def complete(
    request: Request, rollout: Rollout, goal: Int[Array, " N"], options: Options[Narrowed]
) -> Completed:
    """Complete manoeuvres ``[N]`` to plans that rejoin at points number ``goal``, ``[N]``."""
    if COMPLETE_EACH.ready:
        return _complete_each(request, rollout, goal, options)
    task, most = task_of(options), request.route_x.shape[1]
    wind = 0.0 if request.drift is None else np.max(np.hypot(*request.drift), initial=0.0)
    latest, extension = latest_end(request, options), options.extension
    whole, tails = _begin(rollout, goal, options)
    count = tails.row.size
    remaining, pieces = np.arange(count), list[Array]()
    for step in range(most + 1 + options.points_beyond(wind)):
        if not options.extend_route:
            ended = tails.point[remaining] >= request.points[tails.row[remaining]]
            whole.too_short[tails.row[remaining[ended]]] = True
            remaining = remaining[~ended]
        if remaining.size == 0:
            break
        legs = _next_legs(request, tails, remaining, extension, task, first=step == 0)
        if step == 0:
            legs = _to_goal(whole, rollout, tails.row, legs, task)
        tails.point[legs.tail] += 1
        passed_by = legs.tail[~legs.leg.reached]
        if passed_by.size:
            legs = take(legs, legs.leg.reached)
        pieces += _pieces(count, legs, task, level=step == 0)
        arrived = end_of(legs.leg, task)
        finished = _fly_legs(whole, request, tails, legs, arrived, latest, options)
        remaining = legs.tail[~finished]
        if passed_by.size:
            remaining = np.sort(np.concatenate([passed_by, remaining]))
    whole.too_short[tails.row[remaining]] = True
    completed = np.flatnonzero(whole.last[tails.row] >= 0)
    if completed.size:
        parts = _Piece(*np.moveaxis(np.stack(pieces)[:, :, completed], 0, 2))
        _read_off(whole.plan_states, options, rollout, take(tails, completed), parts)
    return whole


def _complete_each(
    request: Request, rollout: Rollout, goal: Array, options: Options[Narrowed]
) -> Completed:
    """Complete manoeuvres by compiled code."""
    whole, drift, most = _nothing(rollout, options), request.drift, request.route_x.shape[1]
    wind = 0.0 if drift is None else np.max(np.hypot(*drift), initial=0.0)
    states = np.full((goal.size, 5, options.waypoints + 1), np.nan)
    east, north = (np.zeros(0), np.zeros(0)) if drift is None else drift
    COMPLETE_EACH(
        Manoeuvres(
            *contiguous(
                (
                    np.stack(rollout.plan_states, axis=1),
                    rollout.end,
                    rollout.time,
                    rollout.direct,
                    rollout.turn_sign,
                )
            )
        ),
        Routes(
            x=contiguous(request.route_x),
            y=contiguous(request.route_y),
            of_route=(
                np.ones(request.route_x.shape, dtype=bool)
                if request.of_route is None
                else contiguous(request.of_route >= 0)
            ),
            points=np.array(request.points, dtype=np.int64),
            goal=np.array(goal, dtype=np.int64),
            latest=contiguous(latest_end(request, options)),
            east=contiguous(east),
            north=contiguous(north),
        ),
        Whole(
            plain_task(options),
            float(options.interval),
            float(options.finished_by),
            float(options.extension),
            bool(options.extend_route),
            most + 1 + options.points_beyond(wind),
        ),
        Plans(states, *whole[1:]),
    )
    return whole._replace(plan_states=PlanStates(*np.moveaxis(states, 1, 0)))


def _nothing(rollout: Rollout, options: Options[Narrowed]) -> Completed:
    """Return plans of which nothing but the manoeuvres is known."""
    count = rollout.time.size
    return Completed(
        PlanStates(*(np.full((count, options.waypoints + 1), np.nan) for _ in range(5))),
        last=np.full(count, -1),
        too_short=np.zeros(count, dtype=bool),
        rejoin_time=np.where(rollout.direct, np.nan, rollout.time),
        path=rollout.path.copy(),
        reversals=rollout.reversals.copy(),
    )


def _begin(rollout: Rollout, goal: Array, options: Options[Narrowed]) -> tuple[Completed, _Tails]:
    """Return plans of which nothing but the manoeuvres is known, and tails of those that end."""
    whole = _nothing(rollout, options)
    row = np.flatnonzero(np.isfinite(rollout.time))
    direct = rollout.direct[row]
    point = goal[row] + np.where(direct, 0, 1)
    return whole, _Tails(row, take(rollout.end, row), rollout.time[row], point, direct)


def _fly_legs(
    whole: Completed,
    request: Request,
    tails: _Tails,
    legs: _Legs,
    arrived: Array,
    latest: Array,
    options: Options[Narrowed],
) -> Array:
    """Move tails to the ends of legs, where they arrive at some times, s; return which of them end
    their plans there, bool ``[L]``.
    """
    leg = legs.leg
    ends = VehicleState(leg.x, leg.y, wrap(leg.course, np), leg.speed)
    scatter((tails.state, tails.time), legs.tail, (ends, arrived))
    finished = arrived >= options.finished_by
    if not finished.any():
        return finished
    row = tails.row[legs.tail]
    if request.of_route is not None:  # a plan ends at a point of the route itself
        most = request.route_x.shape[1]
        of_route = request.of_route[row, np.minimum(legs.point, most - 1)]
        finished &= (of_route >= 0) | (legs.point >= most)
    in_time = finished & (arrived <= latest[row])
    whole.last[row[in_time]] = legs.point[in_time]
    return finished


def _next_legs(
    request: Request,
    tails: _Tails,
    numbers: Array,
    extension: float,
    task: DirectTask,
    *,
    first: bool,
) -> _Legs:
    """Return the legs of the tails of some numbers to their next points; the first ones may lead
    to the goal.
    """
    row, point = tails.row[numbers], tails.point[numbers]
    onward = Onward(
        place=_point(request, row, point, extension),
        begin=take(tails.state, numbers),
        began=tails.time[numbers],
        direct=tails.direct[numbers] & first,
    )
    drift = take(request.drift, row)
    if drift is None:
        return _Legs(numbers, point, leg_to(onward, None, onward.began, task, np))
    return _Legs(numbers, point, legs_to_meet(onward, drift, task))


def _to_goal(
    whole: Completed, rollout: Rollout, rows: Array, legs: _Legs, task: DirectTask
) -> _Legs:
    """Return the first legs, without those that miss the goal, and note when the goal is reached.

    The goal itself must not be passed by, nor reached too late.
    """
    direct = rollout.direct[rows[legs.tail]]
    on = ~direct | (legs.leg.reached & legs.leg.in_time)
    if not on.all():
        legs, direct = take((legs, direct), on)
    leg = legs.leg
    straight = np.maximum(leg.length - leg.disc, 0.0)
    entered = leg.turned + duration(straight, leg.begin.speed, leg.speed, task)
    direct_rows = rows[legs.tail[direct]]
    whole.rejoin_time[direct_rows] = entered[direct]
    flown = np.abs(leg.arc) * leg.begin.speed / task.turn_rate + straight
    whole.path[direct_rows] += flown[direct]
    whole.reversals[direct_rows] += np.sign(leg.arc[direct]) * rollout.turn_sign[direct_rows] < 0.0
    return legs


def _pieces(count: int, legs: _Legs, task: DirectTask, *, level: bool) -> list[Array]:
    """Return the turns and the straight parts of legs as pieces of ``count`` tails; ``level`` adds
    what follows where the speed at the leg's end is reached.
    """
    leg, none = legs.leg, np.zeros(legs.tail.size)
    faster = leg.speed > leg.begin.speed
    gain = np.where(faster, task.limits.acceleration_max, 0.0)
    turn_rate = np.sign(leg.arc) * task.turn_rate
    middle = _turn(leg.begin, leg.arc, task.turn_rate)
    pieces = [
        _Piece(leg.began, *leg.begin, turn_rate, none),
        _Piece(leg.turned, *middle, none, gain),
    ]
    if level:
        pieces.append(_level_piece(leg, middle, task))
    return [_spread(count, legs.tail, piece) for piece in pieces]


def _level_piece(leg: Leg, middle: VehicleState[Air], task: DirectTask) -> _Piece:
    """Return what follows where the speed at the leg's end is reached, the straight part beginning
    at the states ``middle``.
    """
    none = np.zeros(leg.turned.size)
    rise = (leg.speed - leg.begin.speed) / task.limits.acceleration_max
    far = 0.5 * (leg.speed + leg.begin.speed) * rise
    x, y = middle.x + far * np.cos(middle.heading), middle.y + far * np.sin(middle.heading)
    begin = np.where(rise > 0.0, leg.turned + rise, np.inf)
    return _Piece(begin, x, y, middle.heading, leg.speed, turn_rate=none, acceleration=none)


def _point(request: Request, rows: Array, number: Array, extension: float) -> tuple[Array, Array]:
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


def _turn(state: VehicleState[Air], arc: Array, turn_rate: float) -> VehicleState[Air]:
    x, y = arc_end(state, arc, state.speed * np.abs(arc) / turn_rate)
    return VehicleState(x, y, state.heading + arc, state.speed)


def _spread(count: int, tails: Array, piece: _Piece) -> Array:
    """Return a piece of some of ``count`` tails as one of all, ``[7, count]``."""
    values = np.zeros((len(piece), count))
    values[0] = np.inf
    values[:, tails] = piece
    return values


def _read_off(
    plan_states: PlanStates[Air],
    options: Options[Narrowed],
    rollout: Rollout,
    tails: _Tails,
    parts: _Piece,
) -> None:
    """Write the plan states of whole plans from the pieces of their tails ``[M, P]``, and the
    tails' ends.
    """
    row, times = tails.row, np.arange(options.waypoints) * options.interval
    # The last part begun by each time; parts that are not flown begin never.
    begun = parts.begin[:, None] <= times[:, None]
    any_begun = begun.any(axis=-1)
    number = np.where(any_begun, begun.shape[-1] - 1 - np.argmax(begun[..., ::-1], axis=-1), 0)
    rows = np.arange(row.size)[:, None]
    part = _Piece(*(field[rows, number] for field in parts))
    seconds = np.where(any_begun, times - part.begin, 0.0)
    arc = part.turn_rate * seconds
    began: VehicleState[Air] = VehicleState(part.x, part.y, part.heading, part.speed)
    place = arc_end(began, arc, (part.speed + 0.5 * part.acceleration * seconds) * seconds)
    tail = (*place, part.heading + arc, part.speed + part.acceleration * seconds)
    flown = times <= rollout.time[row][:, None]
    have = min(times.size, rollout.plan_states.x.shape[1])
    for field, manoeuvre, after, final in zip(
        plan_states[:4], rollout.plan_states, tail, tails.state, strict=True
    ):
        before = np.full((row.size, times.size), np.nan)
        before[:, :have] = manoeuvre[row, :have]
        field[row, :-1] = np.where(flown, before, after)
        field[row, -1] = final
    plan_states.heading[row] = wrap(plan_states.heading[row], np)
    plan_states.time[row, :-1], plan_states.time[row, -1] = times, tails.time
