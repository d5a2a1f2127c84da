"""Whether the route beyond the goal is clear of traffic once a manoeuvre is back on it.

The way to the goal is often clear when the route behind it is not. So that a manoeuvre goes on
until both are, this estimates the rest of the plan: the ownship on the lines of
the route at constant speed, intruders straight on after their turns. The validator judges the plan.
"""

import math
from typing import NamedTuple

import numpy as np

from agents.kernel.traffic import Traffic, predict, uncertainty, uncertainty_of_one
from agents.manoeuvres.direct_to_goal import DirectTask, arc_end, arc_end_of_one, arrival, direct
from agents.planner.request.options import Narrowed, Options, task_of
from agents.planner.request.request import Request
from envs.arrays import Array
from envs.backend import FLOATS
from envs.compiled import scalar
from envs.frames import Air
from envs.kinematics import VehicleState, velocity
from envs.trees import column, map_leaves, scatter, take
from envs.wind import aim_point

CROWD = 16
"""Intruders beyond which a search looks at the nearest ones first, and the policy's rollout beyond
the goal.
"""

_STRAIGHT = 1e-6  # rad between two legs of a route that are one


class _RouteLegs(NamedTuple):
    """Straight legs of routes; fields ``[N, L]``, or numbers of one."""

    x: Array  # where each begins, m
    y: Array
    course: Array  # rad
    begin: Array  # length of the route from the point after the goal to there, m
    length: Array  # m; 0: none


class RouteBeyond(NamedTuple):
    """The routes of requests beyond their goals, and the intruders, ``[N, K]``."""

    legs: _RouteLegs
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
        goal: tuple[Array, Array],
        required: Array,
        owner: Array,
        time: Array,
        task: DirectTask,
    ) -> Array:
        """Return whether the route is clear after the direct route to the goal from states ``[R]``
        of requests ``owner`` at some times, s, bool ``[R]``.

        ``required`` is the separation before uncertainty grows, m, ``[R, K]``.
        """
        flown = self._flights(own, goal, owner, time, task)
        if self.order is None:
            return self._clear_of(flown, required, owner, np.arange(required.shape[-1])[None])
        # The nearest block most ways: the others are looked at where those do not.
        found = self._clear_of(flown, required, owner, self.order[owner, :CROWD])
        rows = np.flatnonzero(found)
        if rows.size:
            some, least, of = take((flown, required, owner), rows)
            found[rows] = self._clear_of(some, least, of, self.order[of, CROWD:])
        return found

    def _clear_of(self, flown: "_Lines", required: Array, owner: Array, each: Array) -> Array:
        """Return whether flights keep clear of the intruders numbered ``each``, ``[R, k]``, bool
        ``[R]``.
        """
        passing = self._pass(flown, owner, each)
        needed = required[np.arange(owner.size)[:, None], each][:, None]
        if self.traffic.velocity_std.any():
            seen = take(self.traffic, (owner[:, None, None], each[:, None]))
            growth = uncertainty(seen, passing.last) - uncertainty(seen, 0.0)
            needed = needed + self.sigmas * growth
        near = passing.square < needed * np.abs(needed)
        return ~(near & (passing.last > passing.first)).any(axis=(1, 2))

    def _pass(self, flown: "_Lines", owner: Array, each: Array) -> "_Passing":
        """Return how flights pass the intruders numbered ``each``, ``[R, k]``."""
        begin = first = flown.first[..., None]
        last = flown.last[..., None]
        number = owner[:, None, None], each[:, None]
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
        self, own: VehicleState[Air], goal: tuple[Array, Array], task: DirectTask
    ) -> Array:
        """Return the numbers of intruders by how near they come to the route beyond the goal after
        direct flights from the request on, ``[N, K]``.
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
        there: VehicleState[Air] = VehicleState(*goal, course, speed)
        to_next, at_next = self._to_next(there, at_goal, owner, task)
        rest = self._on_route(speed, at_next, owner)
        return map_leaves(lambda *both: np.concatenate(both, axis=-1), to_next, rest)

    def _to_next(
        self, there: VehicleState[Air], time: Array, owner: Array, task: DirectTask
    ) -> tuple["_Lines", Array]:
        """Return the turn onto the next point and the way there, ``[R, 2]``, from states at some
        times, and when the point is reached, s.
        """
        speed = there.speed
        way = direct(there, (self.next_x[owner], self.next_y[owner]), time, task, np)
        turned_x, turned_y = arc_end(there, way.side * way.turn, speed * way.turning)
        turned = time + way.turning
        at_next = turned + (way.straight + task.radius) / speed
        turning = np.maximum(way.turning, 1e-9)
        chord_vx, chord_vy = (turned_x - there.x) / turning, (turned_y - there.y) / turning
        vx, vy = speed * np.cos(way.course), speed * np.sin(way.course)
        lines = _Lines(
            x=np.stack([there.x, turned_x], axis=-1),
            y=np.stack([there.y, turned_y], axis=-1),
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


class RouteBeyondOfOne(NamedTuple):
    """The route of one request beyond its goal, as compiled code takes it, and the intruders that
    exist; fields ``[K]`` of those, or empty.
    """

    legs: _RouteLegs  # [L]
    next_x: float
    next_y: float
    points: Array  # [P]
    straight: VehicleState[Air]
    position_std: Array
    velocity_std: Array
    age: Array
    begin: Array  # of the windows; empty: all count always
    end: Array
    sigmas: float
    until: float


def of_one(beyond: RouteBeyond, row: int) -> RouteBeyondOfOne:
    """Return the route of the request numbered ``row``."""
    traffic = take(beyond.traffic, row)
    there, window, none = traffic.mask, traffic.window, np.zeros(0)
    return RouteBeyondOfOne(
        legs=map_leaves(np.copy, take(beyond.legs, row)),
        next_x=float(beyond.next_x[row]),
        next_y=float(beyond.next_y[row]),
        points=beyond.points[row].copy(),
        straight=take(take(beyond.straight, row), there),
        position_std=traffic.position_std[there],
        velocity_std=traffic.velocity_std[there],
        age=traffic.age[there],
        begin=none if window is None else window.begin[there],
        end=none if window is None else window.end[there],
        sigmas=float(beyond.sigmas),
        until=float(beyond.until),
    )


def no_route_beyond() -> RouteBeyondOfOne:
    """Return a route that nobody asks for."""
    none, legs = np.zeros(0), _RouteLegs(*np.zeros((len(_RouteLegs._fields), 0)))
    still: VehicleState[Air] = VehicleState(none, none, none, none)
    return RouteBeyondOfOne(legs, 0.0, 0.0, none, still, none, none, none, none, none, 0.0, 0.0)


@scalar
def clear_beyond(
    own: VehicleState[Air],
    goal: tuple[float, float],
    required: Array,
    time: float,
    beyond: RouteBeyondOfOne,
    task: DirectTask,
) -> bool:
    """Return :meth:`RouteBeyond.clear` of one state in plain floats; ``required`` is ``[K]``."""
    at_goal, course, speed = arrival(own, goal, time, task, FLOATS)
    there: VehicleState[Air] = VehicleState(goal[0], goal[1], course, speed)
    way = direct(there, (beyond.next_x, beyond.next_y), at_goal, task, FLOATS)
    x, y = arc_end_of_one(there, way.side * way.turn, speed * way.turning)
    turned, turning = at_goal + way.turning, max(way.turning, 1e-9)
    chord = (x - there.x) / turning, (y - there.y) / turning
    if not _line_clear((there.x, there.y), chord, at_goal, turned, required, beyond):
        return False
    at_next = turned + (way.straight + task.radius) / speed
    velocity = speed * math.cos(way.course), speed * math.sin(way.course)
    if not _line_clear((x, y), velocity, turned, at_next, required, beyond):
        return False
    end = math.inf
    for length in beyond.points:
        reached = at_next + length / speed
        if beyond.until <= reached < end:
            end = reached
    legs = beyond.legs
    for number in range(len(legs.x)):
        first = at_next + legs.begin[number] / speed
        last = min(first + legs.length[number] / speed, end)
        velocity = speed * math.cos(legs.course[number]), speed * math.sin(legs.course[number])
        begin = legs.x[number], legs.y[number]
        if not _line_clear(begin, velocity, first, last, required, beyond):
            return False
    return True


@scalar
def _line_clear(
    place: tuple[float, float],
    velocity: tuple[float, float],
    begin: float,
    end: float,
    required: Array,
    beyond: RouteBeyondOfOne,
) -> bool:
    """Return whether the flight along a line, from a time to another, keeps clear of all."""
    if not end > begin:
        return True
    for k in range(len(required)):
        first, last = begin, end
        if len(beyond.begin) > 0:
            first, last = max(first, beyond.begin[k]), min(last, beyond.end[k])
            if not last > first:
                continue
        speed, heading = beyond.straight.speed[k], beyond.straight.heading[k]
        vx, vy = speed * math.cos(heading), speed * math.sin(heading)
        x = beyond.straight.x[k] + vx * begin - place[0]
        y = beyond.straight.y[k] + vy * begin - place[1]
        vx, vy = vx - velocity[0], vy - velocity[1]
        nearest = -(x * vx + y * vy) / max(vx * vx + vy * vy, 1e-9)
        nearest = min(max(nearest, first - begin), last - begin)
        x, y = x + vx * nearest, y + vy * nearest
        needed = required[k]
        if beyond.velocity_std[k] > 0.0:
            std = beyond.position_std[k], beyond.velocity_std[k], beyond.age[k]
            grown = uncertainty_of_one(std[0], std[1], std[2], last)
            needed += beyond.sigmas * (grown - uncertainty_of_one(std[0], std[1], std[2], 0.0))
        if x * x + y * y < needed * abs(needed):
            return False
    return True


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


def route_beyond(request: Request, goal: Array, options: Options[Narrowed]) -> RouteBeyond:
    """Return the routes of requests beyond the points numbered ``goal``, ``[N]``.

    Points that drift are where they would be met by flying straight to them.
    """
    rows = np.arange(goal.size)
    after = np.minimum(goal + 1, request.points - 1)
    own, drift = column((request.own, request.drift))
    route_x, route_y = aim_point(
        own, (request.route_x, request.route_y), drift, options.finished_by, np
    )
    each = [
        _legs_of(route_x[row, first:last], route_y[row, first:last])
        for row, (first, last) in enumerate(zip(after, request.points, strict=True))
    ]
    most = max(len(legs) for legs, _ in each)
    legs = _RouteLegs(*np.zeros((len(_RouteLegs._fields), goal.size, most)))
    points = np.full(route_x.shape, np.inf)
    for row, (found, along) in enumerate(each):
        for number, leg in enumerate(found):
            scatter(legs, (row, number), leg)
        points[row, : len(along)] = along
    traffic = request.traffic
    turned = predict(traffic, traffic.turn_time)
    vx, vy = velocity(turned, np)
    straight = turned._replace(
        x=turned.x - vx * traffic.turn_time, y=turned.y - vy * traffic.turn_time
    )
    found = RouteBeyond(
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
    if traffic.mask.shape[-1] <= CROWD:
        return found
    to = route_x[rows, goal], route_y[rows, goal]
    return found._replace(order=found.nearest_first(request.own, to, task_of(options)))


def _legs_of(x: Array, y: Array) -> tuple[list[_RouteLegs], Array]:
    """Return the legs of a route, those on one line as one, and the lengths to its points."""
    lengths = np.hypot(np.diff(x), np.diff(y))
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    courses = np.arctan2(np.diff(y), np.diff(x))
    found: list[_RouteLegs] = []
    for number, (course, length) in enumerate(zip(courses, lengths, strict=True)):
        if found and abs(math.remainder(course - found[-1].course, math.tau)) < _STRAIGHT:
            found[-1] = found[-1]._replace(length=found[-1].length + length)
        else:
            found.append(_RouteLegs(x[number], y[number], course, along[number], length))
    return found, along
