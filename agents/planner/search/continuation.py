"""Whether the route beyond the goal is clear of traffic once a manoeuvre is back on it.

The way to the goal is often clear when the route behind it is not. So that a manoeuvre goes on
until both are, this estimates the rest of the plan: the ownship on the lines of
the route at constant speed, intruders straight on after their turns. The validator judges the plan.
"""

import math
from typing import NamedTuple

import numpy as np

from agents.kernel.traffic import Traffic, predict, scalar_uncertainty, uncertainty
from agents.manoeuvres.direct_to_goal import DirectTask, arc_end, arrival, direct, scalar_arc_end
from agents.planner.request.options import Narrowed, Options, task_of
from agents.planner.request.request import Request
from envs.arrays import Array, Bool, Float, Int
from envs.backend import FLOATS
from envs.compiled import records, scalar
from envs.frames import Air
from envs.kinematics import VehicleState, velocity
from envs.trees import column, map_leaves, scatter, take
from envs.wind import aim_point

CROWD = 16
"""Intruders beyond which a search looks at the nearest ones first, and the policy's rollout beyond
the goal.
"""

_STRAIGHT = 1e-6  # rad between two legs of a route that are one


class RouteLegs(NamedTuple):
    """Straight legs of routes; fields ``[N, L]``, or numbers of one."""

    x: Array  # where each begins, m
    y: Array
    course: Array  # rad
    begin: Array  # length of the route from the point after the goal to there, m
    length: Array  # m; 0: none


class RouteContinuation(NamedTuple):
    """The routes of requests beyond their goals, and the intruders, ``[N, K]``."""

    legs: RouteLegs
    next_x: Array  # the point after the goal, m, [N]; the goal itself where there is none
    next_y: Array
    points: Array  # lengths of the route from there to its points, m, [N, P]; inf: none
    traffic: Traffic
    straight: VehicleState[
        Air
    ]  # the intruders after their turns, moved back along the line to time 0
    # numbers of a crowd by how near it comes to the direct flight, [N, K]; None: no crowd
    order: Array | None
    sigmas: float
    until: float  # a plan ends at the first point that is reached at or after this, s

    def clear(
        self,
        own: VehicleState[Air],
        goal: tuple[Float[Array, " R"], Float[Array, " R"]],
        required: Float[Array, "R K"],
        owner: Int[Array, " R"],
        time: Float[Array, " R"],
        task: DirectTask,
    ) -> Bool[Array, " R"]:
        """Return whether the route is clear after the direct route to the goal from states ``[R]``
        of requests ``owner`` at some times, s.

        ``required`` is the separation before uncertainty grows, m, ``[R, K]``.
        """
        flown = self._flights(own, goal, owner, time, task)
        if self.order is None:
            return self._clear_of(flown, required, owner, np.arange(required.shape[-1])[None])
        # The nearest block most ways: the others are looked at where those do not.
        clear = self._clear_of(flown, required, owner, self.order[owner, :CROWD])
        rows = np.flatnonzero(clear)
        if rows.size:
            flown_on, least, of = take((flown, required, owner), rows)
            clear[rows] = self._clear_of(flown_on, least, of, self.order[of, CROWD:])
        return clear

    def _clear_of(self, flown: "_Lines", required: Array, owner: Array, numbers: Array) -> Array:
        """Return whether flights keep clear of the intruders with these ``numbers``, ``[R, k]``,
        bool ``[R]``.
        """
        passing = self._pass(flown, owner, numbers)
        needed = required[np.arange(owner.size)[:, None], numbers][:, None]
        if self.traffic.velocity_std.any():
            traffic = take(self.traffic, (owner[:, None, None], numbers[:, None]))
            growth = uncertainty(traffic, passing.last) - uncertainty(traffic, 0.0)
            needed = needed + self.sigmas * growth
        near = passing.square < needed * np.abs(needed)
        return ~(near & (passing.last > passing.first)).any(axis=(1, 2))

    def _pass(self, flown: "_Lines", owner: Array, numbers: Array) -> "_Passing":
        """Return how flights pass the intruders with these ``numbers``, ``[R, k]``."""
        begin = first = flown.first[..., None]
        last = flown.last[..., None]
        number = owner[:, None, None], numbers[:, None]
        if self.traffic.window is not None:
            counts = take(self.traffic.window, number)
            first, last = np.maximum(first, counts.begin), np.minimum(last, counts.end)
        other = take(self.straight, number)
        vx, vy = velocity(other, np)
        x = other.x + vx * begin - flown.x[..., None]
        y = other.y + vy * begin - flown.y[..., None]
        vx, vy = vx - flown.vx[..., None], vy - flown.vy[..., None]
        nearest = -(x * vx + y * vy) / np.maximum(vx * vx + vy * vy, 1e-9)
        nearest = np.clip(nearest, first - begin, np.maximum(last - begin, first - begin))
        x, y = x + vx * nearest, y + vy * nearest
        return _Passing(x * x + y * y, first, last)

    def nearest_first(
        self,
        own: VehicleState[Air],
        goal: tuple[Float[Array, " N"], Float[Array, " N"]],
        task: DirectTask,
    ) -> Int[Array, "N K"]:
        """Return the numbers of intruders by how near they come to the route beyond the goal after
        direct flights from the request on.
        """
        rows = np.arange(np.size(own.x))
        every = np.arange(self.traffic.mask.shape[-1])[None].repeat(rows.size, axis=0)
        flown = self._flights(own, goal, rows, np.zeros(rows.size), task)
        passing = self._pass(flown, rows, every)
        counts = (passing.last > passing.first) & self.traffic.mask[:, None]
        away = np.where(counts, passing.square, np.inf)
        return np.argsort(away.min(axis=1), axis=-1, kind="stable")

    def _flights(
        self,
        own: VehicleState[Air],
        goal: tuple[Array, Array],
        owner: Array,
        time: Array,
        task: DirectTask,
    ) -> "_Lines":
        """Return the flights of ``R`` manoeuvres beyond the goal: the turn onto the next point as
        its chord, the way there, and the rest of the route.
        """
        at_goal, course, speed = arrival(own, goal, time, task, np)
        state_at_goal: VehicleState[Air] = VehicleState(*goal, course, speed)
        to_next, at_next = self._to_next(state_at_goal, at_goal, owner, task)
        beyond_next = self._on_route(speed, at_next, owner)
        return map_leaves(lambda *parts: np.concatenate(parts, axis=-1), to_next, beyond_next)

    def _to_next(
        self, state: VehicleState[Air], time: Array, owner: Array, task: DirectTask
    ) -> tuple["_Lines", Array]:
        """Return the turn onto the next point and the way there, ``[R, 2]``, from states at some
        times, and when the point is reached, s.
        """
        speed = state.speed
        way = direct(state, (self.next_x[owner], self.next_y[owner]), time, task, np)
        turned_x, turned_y = arc_end(state, way.side * way.turn, speed * way.turning)
        turned = time + way.turning
        at_next = turned + (way.straight + task.radius) / speed
        turning = np.maximum(way.turning, 1e-9)
        chord_vx, chord_vy = (turned_x - state.x) / turning, (turned_y - state.y) / turning
        vx, vy = speed * np.cos(way.course), speed * np.sin(way.course)
        lines = _Lines(
            x=np.stack([state.x, turned_x], axis=-1),
            y=np.stack([state.y, turned_y], axis=-1),
            vx=np.stack([chord_vx, vx], axis=-1),
            vy=np.stack([chord_vy, vy], axis=-1),
            first=np.stack([time, turned], axis=-1),
            last=np.stack([turned, at_next], axis=-1),
        )
        return lines, at_next

    def _on_route(self, speed: Array, at_next: Array, owner: Array) -> "_Lines":
        """Return the flights along the legs after the next point, which is reached at some times,
        s, until the plans end, ``[R, L]``.
        """
        legs, pace = take(self.legs, owner), speed[:, None]
        reached = at_next[:, None] + self.points[owner] / pace
        end = np.min(reached, axis=1, where=reached >= self.until, initial=np.inf)
        first = at_next[:, None] + legs.begin / pace
        return _Lines(
            x=legs.x,
            y=legs.y,
            vx=pace * np.cos(legs.course),
            vy=pace * np.sin(legs.course),
            first=first,
            last=np.minimum(first + legs.length / pace, end[:, None]),
        )


class IntruderBeyond(NamedTuple):
    """An intruder after its turn; a record, or columns ``[K]``."""

    x: Array  # moved back along the line to time 0, m
    y: Array
    vx: Array  # m/s
    vy: Array
    position_std: Array
    velocity_std: Array
    age: Array
    begin: Array  # of the window
    end: Array


class ScalarContinuation(NamedTuple):
    """The route of one request beyond its goal, as compiled code takes it, and the intruders that
    exist.
    """

    legs: Array  # records of RouteLegs, [L]
    next_x: float
    next_y: float
    points: Array  # [P]
    intruders: Array  # records of IntruderBeyond, [K]
    sigmas: float
    until: float


def scalar_continuation(continuation: RouteContinuation, row: int) -> ScalarContinuation:
    """Return the route of the request numbered ``row``."""
    traffic, straight = take(
        take((continuation.traffic, continuation.straight), row), continuation.traffic.mask[row]
    )
    always = np.full(traffic.age.shape, np.inf)
    spread = traffic.position_std, traffic.velocity_std, traffic.age
    window = (-always, always) if traffic.window is None else traffic.window
    intruders = IntruderBeyond(straight.x, straight.y, *velocity(straight, np), *spread, *window)
    return ScalarContinuation(
        legs=records(take(continuation.legs, row)._asdict()),
        next_x=float(continuation.next_x[row]),
        next_y=float(continuation.next_y[row]),
        points=continuation.points[row],
        intruders=records(intruders._asdict()),
        sigmas=float(continuation.sigmas),
        until=float(continuation.until),
    )


def no_continuation() -> ScalarContinuation:
    """Return a route that nobody asks for."""
    none = np.zeros(0)
    legs, intruders = (
        records(dict.fromkeys(kind._fields, none)) for kind in (RouteLegs, IntruderBeyond)
    )
    return ScalarContinuation(legs, 0.0, 0.0, none, intruders, 0.0, 0.0)


@scalar
def continuation_clear(
    own: VehicleState[Air],
    goal: tuple[float, float],
    required: Float[Array, " K"],
    time: float,
    continuation: ScalarContinuation,
    task: DirectTask,
) -> bool:
    """Return :meth:`RouteContinuation.clear` of one state in plain floats; required ``[K]``."""
    lines = continuation_lines(own, goal, time, continuation, task)
    for k in range(len(required)):
        if not lines_clear(lines, continuation.intruders[k], required[k], continuation.sigmas):
            return False
    return True


@scalar
def continuation_lines(
    own: VehicleState[Air],
    goal: tuple[float, float],
    time: float,
    continuation: ScalarContinuation,
    task: DirectTask,
) -> Float[Array, "L+2 6"]:
    """Return the flight beyond the goal of one state in plain floats, as lines: where each begins
    (m, m), the velocity (m/s, m/s), from when and until when (s, s).
    """
    lines = np.empty((len(continuation.legs) + 2, 6))
    at_goal, course, speed = arrival(own, goal, time, task, FLOATS)
    state: VehicleState[Air] = VehicleState(goal[0], goal[1], course, speed)
    way = direct(state, (continuation.next_x, continuation.next_y), at_goal, task, FLOATS)
    x, y = scalar_arc_end(state, way.side * way.turn, speed * way.turning)
    turned, turning = at_goal + way.turning, max(way.turning, 1e-9)
    chord = (x - state.x) / turning, (y - state.y) / turning
    _write_line(lines[0], (state.x, state.y), chord, at_goal, turned)
    at_next = turned + (way.straight + task.radius) / speed
    velocity = speed * math.cos(way.course), speed * math.sin(way.course)
    _write_line(lines[1], (x, y), velocity, turned, at_next)
    end = math.inf
    for length in continuation.points:
        reached = at_next + length / speed
        if continuation.until <= reached < end:
            end = reached
    for number in range(len(continuation.legs)):
        leg = continuation.legs[number]
        first = at_next + leg.begin / speed
        last = min(first + leg.length / speed, end)
        velocity = speed * math.cos(leg.course), speed * math.sin(leg.course)
        _write_line(lines[number + 2], (leg.x, leg.y), velocity, first, last)
    return lines


@scalar
def _write_line(
    line: Array,
    place: tuple[float, float],
    velocity: tuple[float, float],
    first: float,
    last: float,
) -> None:
    line[0], line[1] = place
    line[2], line[3] = velocity
    line[4], line[5] = first, last


@scalar
def lines_clear(
    lines: Float[Array, "L+2 6"], intruder: IntruderBeyond, required: float, sigmas: float
) -> bool:
    """Return whether flights along lines (:func:`continuation_lines`) keep clear of an intruder
    from which a distance is required before uncertainty grows, m.
    """
    for number in range(len(lines)):
        line = lines[number]
        begin = line[4]
        first, last = max(begin, intruder.begin), min(line[5], intruder.end)
        if not last > first:
            continue
        x, y = (
            intruder.x + intruder.vx * begin - line[0],
            intruder.y + intruder.vy * begin - line[1],
        )
        vx, vy = intruder.vx - line[2], intruder.vy - line[3]
        nearest = -(x * vx + y * vy) / max(vx * vx + vy * vy, 1e-9)
        nearest = min(max(nearest, first - begin), last - begin)
        x, y = x + vx * nearest, y + vy * nearest
        needed = required + growth_beyond(intruder, last, sigmas)
        if x * x + y * y < needed * abs(needed):
            return False
    return True


@scalar
def growth_beyond(intruder: IntruderBeyond, time: float, sigmas: float) -> float:
    """Return by how much the distance that is required from an intruder grows until a time,
    m.
    """
    if not intruder.velocity_std > 0.0:
        return 0.0
    position_std, velocity_std, age = intruder.position_std, intruder.velocity_std, intruder.age
    grown = scalar_uncertainty(position_std, velocity_std, age, time)
    return sigmas * (grown - scalar_uncertainty(position_std, velocity_std, age, 0.0))


class _Lines(NamedTuple):
    """Flights along straight lines, ``[R, L]``."""

    x: Array  # where they begin, m
    y: Array
    vx: Array  # m/s
    vy: Array
    first: Array  # s
    last: Array  # s; not flown where it is not later


class _Passing(NamedTuple):
    """How flights pass intruders, ``[R, L, k]``, or what broadcasts."""

    square: Array  # of the least distance, m^2
    first: Array  # s
    last: Array  # s; not passed where it is not later


def route_continuation(
    request: Request, goal: Int[Array, " N"], options: Options[Narrowed], *, ordered: bool = True
) -> RouteContinuation:
    """Return the routes of requests beyond the points numbered ``goal``, ``[N]``, with the order of
    a crowd where that is asked for.

    Points that drift are where they would be met by flying straight to them.
    """
    rows = np.arange(goal.size)
    after = np.minimum(goal + 1, request.points - 1)
    own, drift = column((request.own, request.drift))
    route_x, route_y = aim_point(
        own, (request.route_x, request.route_y), drift, options.finished_by, np
    )
    routes = [
        _legs_of(route_x[row, first:last], route_y[row, first:last])
        for row, (first, last) in enumerate(zip(after, request.points, strict=True))
    ]
    most = max(len(legs) for legs, _ in routes)
    legs = RouteLegs(*np.zeros((len(RouteLegs._fields), goal.size, most)))
    points = np.full(route_x.shape, np.inf)
    for row, (route_legs, along) in enumerate(routes):
        for number, leg in enumerate(route_legs):
            scatter(legs, (row, number), leg)
        points[row, : len(along)] = along
    traffic = request.traffic
    turned = predict(traffic, traffic.turn_time)
    vx, vy = velocity(turned, np)
    straight = turned._replace(
        x=turned.x - vx * traffic.turn_time, y=turned.y - vy * traffic.turn_time
    )
    route = RouteContinuation(
        legs=legs,
        next_x=route_x[rows, after],
        next_y=route_y[rows, after],
        points=points,
        traffic=traffic,
        straight=straight,
        order=None,
        sigmas=options.requirement.sigmas,
        until=options.finished_by,
    )
    if not ordered or traffic.mask.shape[-1] <= CROWD:
        return route
    to = route_x[rows, goal], route_y[rows, goal]
    return route._replace(order=route.nearest_first(request.own, to, task_of(options)))


def _legs_of(x: Array, y: Array) -> tuple[list[RouteLegs], Array]:
    """Return the legs of a route, those on one line as one, and the lengths to its points."""
    lengths = np.hypot(np.diff(x), np.diff(y))
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    courses = np.arctan2(np.diff(y), np.diff(x))
    legs: list[RouteLegs] = []
    for number, (course, length) in enumerate(zip(courses, lengths, strict=True)):
        if legs and abs(math.remainder(course - legs[-1].course, math.tau)) < _STRAIGHT:
            legs[-1] = legs[-1]._replace(length=legs[-1].length + length)
        else:
            legs.append(RouteLegs(x[number], y[number], course, along[number], length))
    return legs, along
