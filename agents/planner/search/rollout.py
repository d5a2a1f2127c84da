"""The policy flown ahead in the surrogate: from the request until the way back to the route is
clear, or it is back.

The loop stands here twice: over arrays for many requests, and over plain floats for one, because
arrays of one element cost ten times their arithmetic. The policy sees the intruders, as predicted,
at every time step; where there are more than it was trained with, it sees the most critical ones,
which are chosen every few steps. In those steps the direct route to the goal is looked at too; once
it is clear of all, the policy has done its work.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from agents.kernel.traffic import Traffic, Window, predict, requirement_of
from agents.manoeuvres.direct_to_goal import EVERY, DirectTask, clear, direct, keeps_clear
from agents.planner.request.observation import distance_scales, visible
from agents.planner.request.options import Narrowed, Options, task_of
from agents.planner.request.request import Request, drift_points
from agents.planner.search import policy_flight
from agents.planner.search.budget import Budget
from agents.planner.search.continuation import (
    CROWD,
    RouteContinuation,
    no_continuation,
    route_continuation,
    scalar_continuation,
)
from agents.planner.search.policy_flight import FLY, Flight
from agents.policy.decision import Decider
from agents.policy.inference import NOT_FINITE, Policy
from envs.arrays import Array, Int
from envs.backend import FLOATS
from envs.frames import Air
from envs.kinematics import VehicleState, advance, commands
from envs.relative import distance
from envs.trees import column, contiguous, map_leaves, scatter, take
from envs.wind import aim_point

_SHARE = 0.6  # of the computation, for a policy that finds no way back
_SHARE_IN_CROWD = 0.3  # the same where much is about
# time steps for which the intruders are predicted at once; most flights take fewer
_AHEAD = 13 * EVERY


class Rollout(NamedTuple):
    """Where manoeuvres lead; fields ``[N]``, those of plan states ``[N, S]``."""

    # at each waypoint's time, the first at the request, [N, S]; nan after the end
    plan_states: VehicleState[Air]
    # where the way back is clear, or the goal within the radius; nan where neither was in time
    end: VehicleState[Air]
    time: Array  # when that is, s; nan where it was not
    direct: Array  # whether the goal still lies ahead, on the direct route, bool
    path: Array  # length flown until the end, m
    turn_sign: Array  # of the last turn: 1 left, -1 right, 0 none
    reversals: Array  # how often the turn changed side


class _Underway(NamedTuple):
    """Manoeuvres that have not ended, ``[M]``."""

    rows: Array  # their numbers in the request
    goal: tuple[Array, Array]  # at the request, m
    drift: tuple[Array, Array] | None  # of the goal, m/s; None: it stands still
    traffic: Traffic
    required_range: Array  # from each intruder, m, [M, K]
    flight: Flight
    chosen: Array  # numbers of the intruders that the policy sees among many
    distance_scale: Array  # at which the policy counts their distances, [M, K]; None: whole


def much_about(request: Request) -> bool:
    """Return whether requests are among areas or a crowd, where a way to one point takes so long to
    find that there is no time for all ways of finding it.
    """
    return request.areas is not None or request.traffic.mask.shape[-1] > CROWD


def policy_time_over(request: Request, budget: Budget) -> bool:
    """Return whether the policy's share of the computation is over."""
    return budget.ends("policy", _SHARE_IN_CROWD if much_about(request) else _SHARE)


def roll(
    request: Request,
    goal: Int[Array, " N"],
    policy: Policy,
    options: Options[Narrowed],
    budget: Budget | None = None,
    *,
    floats: bool = False,
) -> Rollout:
    """Roll the policy ahead to the points of the route numbered ``goal``, ``[N]``.

    With ``floats`` one request after the other, in plain floats, until the budget ends: faster for
    fewer than about a hundred.
    """
    rows, traffic = np.arange(goal.size), request.traffic
    to = request.route_x[rows, goal], request.route_y[rows, goal]
    required_range = requirement_of(traffic, request.own, options.requirement) + options.slack
    if floats:
        return _roll_each(request, goal, to, required_range, policy, options, budget or Budget())
    crowd = traffic.mask.shape[-1] > CROWD
    continuation = route_continuation(request, goal, options) if crowd else None
    task, dt, spacing = task_of(options), options.aircraft.dt, options.spacing
    steps = int(task.until / dt + 1e-9)
    result = _empty(rows.size, steps // spacing + 1)
    underway = _begin(request, to, required_range, policy, options)
    for step in range(steps + 1):
        time, flight = step * dt, underway.flight
        if step % spacing == 0:
            scatter(result.plan_states, (underway.rows, step // spacing), flight.state)
        others = predict(underway.traffic, time)
        place = drift_points(underway.goal, underway.drift, time)
        away = distance(place[0] - flight.state.x, place[1] - flight.state.y, np)
        arrived = away <= task.radius
        ended, aim = arrived, aim_point(flight.state, place, underway.drift, task.until - time, np)
        if options.direct and step % EVERY == 0:
            ended = ended | _continuation_clear(underway, aim, others, continuation, time, task)
        if ended.any():
            _note_end(result, underway.rows[ended], take(flight, ended), time, ~arrived[ended])
            underway, others, aim = take((underway, others, aim), ~ended)
        if underway.rows.size == 0 or step == steps:
            break
        if traffic.mask.shape[-1] > policy.most and step % EVERY == 0:
            present = _present(underway, time)
            chosen = policy.most_critical(
                underway.flight.state, others, present, underway.distance_scale
            )
            underway = underway._replace(chosen=chosen)
        underway = underway._replace(flight=_fly(underway, others, aim, time, policy, options))
    return result


def _begin(
    request: Request,
    goal: tuple[Array, Array],
    required_range: Array,
    policy: Policy,
    options: Options[Narrowed],
) -> _Underway:
    """Return the manoeuvres of requests ``[N]`` at their beginning."""
    traffic, count = request.traffic, request.points.size
    state: VehicleState[Air] = VehicleState(
        *(np.array(field, dtype=float) for field in request.own)
    )
    path, turn_sign, reversals = np.zeros((3, count))
    return _Underway(
        rows=np.arange(count),
        goal=goal,
        drift=request.drift,
        traffic=traffic,
        required_range=required_range,
        flight=Flight(state, path, turn_sign, reversals),
        chosen=np.zeros((count, min(policy.most, traffic.mask.shape[-1])), dtype=int),
        distance_scale=distance_scales(traffic, options.requirement),
    )


def _present(underway: _Underway, time: float) -> Array:
    """Return which intruders the policy sees at a time, bool ``[M, K]``."""
    return underway.traffic.mask & visible(underway.traffic.window, time)


def _fly(
    underway: _Underway,
    traffic: VehicleState[Air],
    aim: tuple[Array, Array],
    time: float,
    policy: Policy,
    options: Options[Narrowed],
) -> Flight:
    """Return the flights after one time step of the policy's."""
    limits, dt, before = options.manoeuvre, options.aircraft.dt, underway.flight
    others, mask, distance_scale = traffic, _present(underway, time), underway.distance_scale
    if underway.traffic.mask.shape[-1] > policy.most:
        others, mask, distance_scale = map_leaves(
            lambda field: np.take_along_axis(field, underway.chosen, axis=-1),
            (others, mask, distance_scale),
        )
    action = policy.command(before.state, others, mask, *aim, distance_scale)
    acceleration, yaw_rate = commands((action[:, 0], action[:, 1]), limits, np)
    moved = advance(before.state, acceleration, yaw_rate, dt, limits, np)
    turns = np.abs(yaw_rate) >= policy_flight.TURNS * limits.yaw_rate_max
    turn_sign = np.where(turns, np.sign(yaw_rate), before.turn_sign)
    reverses = turn_sign * before.turn_sign < 0.0
    return Flight(
        moved,
        before.path + 0.5 * dt * (before.state.speed + moved.speed),
        turn_sign,
        before.reversals + np.where(reverses, 1.0, 0.0),
    )


def _note_end(result: Rollout, rows: Array, flight: Flight, time: float, direct: Array) -> None:
    """Write where and when flights ``[M]`` of the manoeuvres numbered ``rows`` ended."""
    scatter(result.end, rows, flight.state)
    result.time[rows], result.direct[rows] = time, direct
    result.path[rows], result.turn_sign[rows] = flight.path, flight.turn_sign
    result.reversals[rows] = flight.reversals


def _roll_each(
    request: Request,
    goal: Array,
    to: tuple[Array, Array],
    required_range: Array,
    policy: Policy,
    options: Options[Narrowed],
    budget: Budget,
) -> Rollout:
    """Roll requests ``[N]`` one after the other in plain floats, to points ``to``, m."""
    crowd = request.traffic.mask.shape[-1] > CROWD
    ends, rollouts = partial(policy_time_over, request, budget), list[Rollout]()
    if FLY.ready and policy.decider is not None:
        for row in range(goal.size):
            case = request, row, int(goal[row]), required_range[row]
            rollouts.append(_roll_compiled(*case, policy, policy.decider, options, ends))
    else:
        for row in range(goal.size):
            fields = request.own, request.traffic, to, request.drift
            own, traffic, place, drift = take(fields, row)
            single = slice(row, row + 1)
            continuation = (
                route_continuation(take(request, single), goal[single], options) if crowd else None
            )
            ahead = _TrafficAhead(traffic, required_range[row], continuation, policy, options)
            target = _Target(map_leaves(float, place), map_leaves(float, drift))
            rollouts.append(_roll_one(map_leaves(float, own), ahead, target, policy, options, ends))
    return (
        rollouts[0]
        if len(rollouts) == 1
        else map_leaves(lambda *rows: np.concatenate(rows), *rollouts)
    )


def _roll_compiled(
    request: Request,
    row: int,
    goal: int,
    required_range: Array,
    policy: Policy,
    decider: Decider,
    options: Options[Narrowed],
    ends: Callable[[], bool],
) -> Rollout:
    """Roll the request numbered ``row`` to a point of its route by compiled code, some steps at a
    time until the computation ends; fields ``[1]`` and ``[1, S]``.
    """
    own, traffic, drift = take((request.own, request.traffic, request.drift), row)
    mask = traffic.mask
    crowd = mask.size > CROWD
    continuation = no_continuation()
    if crowd:
        single = slice(row, row + 1)
        continuation = scalar_continuation(
            route_continuation(take(request, single), np.array([goal]), options, ordered=False), 0
        )
    present, required = take((traffic, required_range), mask)
    window, none, distance_scale = (
        present.window,
        np.zeros(0),
        distance_scales(present, options.requirement),
    )
    intruders = contiguous(
        policy_flight.Intruders(
            present.state,
            present.turn_rate,
            present.turn_time,
            required,
            np.ones(required.size) if distance_scale is None else distance_scale,
            none if window is None else window.begin,
            none if window is None else window.end,
        )
    )
    to = float(request.route_x[row, goal]), float(request.route_y[row, goal])
    east, north = (0.0, 0.0) if drift is None else map(float, drift)
    target = policy_flight.Target(*to, east, north, drift is not None)
    course = policy_flight.course(options, policy, crowd=crowd)
    steps = course.steps
    plan_states = np.full((4, steps // course.spacing + 1), np.nan)
    flight, stands, step = policy_flight.begin(own), policy_flight.UNDER_WAY, 0
    while stands == policy_flight.UNDER_WAY and not (step and ends()):
        last = min(step + policy_flight.AT_ONCE, steps + 1)
        stands, step, flight = FLY(
            flight, (step, last), intruders, target, continuation, course, decider, plan_states
        )
    if stands == policy_flight.NOT_FINITE:
        raise ValueError(NOT_FINITE)
    result = _empty(1, plan_states.shape[1])
    for field, values in zip(result.plan_states, plan_states, strict=True):
        field[0] = values
    if stands in (policy_flight.ARRIVED, policy_flight.DIRECT):
        direct = stands == policy_flight.DIRECT
        _note_end(result, 0, flight, step * course.dt, direct)
    return result


class _Target(NamedTuple):
    """A goal in plain floats."""

    place: tuple[float, float]  # at the request, m
    drift: tuple[float, float] | None  # m/s; None: it stands still

    def place_after(self, steps: int, dt: float) -> tuple[float, float]:
        """Return where it is after some time steps of ``dt`` s, m."""
        if self.drift is None:
            return self.place
        (x, y), (east, north) = self.place, self.drift
        return x + east * steps * dt, y + north * steps * dt


def _roll_one(
    own: VehicleState[Air],
    ahead: "_TrafficAhead",
    target: _Target,
    policy: Policy,
    options: Options[Narrowed],
    ends: Callable[[], bool],
) -> Rollout:
    """Roll one request in plain floats until the computation ends; fields ``[1]`` and ``[1, S]``.

    The scalar implementation of :func:`roll`.
    """
    task, limits, dt = task_of(options), options.manoeuvre, options.aircraft.dt
    steps, spacing = int(task.until / dt + 1e-9), options.spacing
    result = _empty(1, steps // spacing + 1)
    state, path, turn_sign, reversals = own, 0.0, 0.0, 0
    plan_states: list[VehicleState[Air]] = []
    square, threshold = task.radius * task.radius, policy_flight.TURNS * limits.yaw_rate_max
    for step in range(steps + 1):
        time, asks = step * dt, step % EVERY == 0
        if asks:
            ahead.look(step, state)
        if step % spacing == 0:
            plan_states.append(state)
        place = aim = target.place_after(step, dt)
        if target.drift is not None:
            aim = aim_point(state, place, target.drift, task.until - time, FLOATS)
        dx, dy = place[0] - state.x, place[1] - state.y
        arrived = dx * dx + dy * dy <= square
        if arrived or (options.direct and asks and ahead.way_back(state, aim, step)):
            flight = Flight(state, path, turn_sign, reversals)
            _note_end(result, 0, flight, time, not arrived)
            break
        if step == steps or (asks and ends()):
            break
        action = policy.command_one(state, ahead.intruders_at(step), *aim, ahead.distance_scale)
        acceleration, yaw_rate = commands(action, limits, FLOATS)
        moved = advance(state, acceleration, yaw_rate, dt, limits, FLOATS)
        path += 0.5 * dt * (state.speed + moved.speed)
        if abs(yaw_rate) >= threshold:
            reversals += 1 if yaw_rate * turn_sign < 0.0 else 0
            turn_sign = 1.0 if yaw_rate > 0.0 else -1.0
        state = moved
    reached = VehicleState(*zip(*plan_states, strict=True))
    scatter(result.plan_states, (0, slice(len(plan_states))), reached)
    return result


class _TrafficAhead:
    """The intruders of one request as they will be, in plain floats."""

    def __init__(
        self,
        traffic: Traffic,
        required_range: Array,
        continuation: RouteContinuation | None,
        policy: Policy,
        options: Options[Narrowed],
    ) -> None:
        """Take intruders ``[K]``, what is required from each, m, and among many the route beyond
        the goal.
        """
        self._traffic, self._required = take((traffic, required_range), traffic.mask)
        self._continuation, self._policy, self._task = continuation, policy, task_of(options)
        self._dt, self._window = options.aircraft.dt, self._traffic.window
        self._every_scale = distance_scales(self._traffic, options.requirement)
        count = len(self._required)
        self._many, self._every_number = count > policy.most, np.arange(count)
        self._all = np.ones(count, dtype=bool)
        # Whether it is chosen anew every few time steps which of them are looked at.
        self._chooses = self._many or self._window is not None
        self._block = self._predict(0)  # of many time steps, [T, K]
        # Of those that are looked at: states at some time steps, what is required, their distance
        # scales.
        self._flown: list[list[VehicleState[Air]]] = []
        self._far: list[float] = self._required.tolist()
        self.distance_scale = None if self._every_scale is None else self._every_scale.tolist()

    def look(self, step: int, state: VehicleState[Air]) -> None:
        """Predict the intruders for many time steps, and choose what is looked at for the next
        few.
        """
        first = step % _AHEAD
        if first == 0 and step > 0:
            self._block = self._predict(step)
        if self._chooses:
            ahead = take(self._block, slice(first, first + EVERY))
            chosen = self._choose(take(ahead, 0), state, step * self._dt)
            self._flown = _in_floats(take(ahead, (slice(None), chosen)))
            self._far = self._required[chosen].tolist()
            if self._every_scale is not None:
                self.distance_scale = self._every_scale[chosen].tolist()
        elif first == 0:
            self._flown = _in_floats(self._block)

    def _predict(self, step: int) -> VehicleState[Air]:
        """Return the intruders at many time steps from one on, ``[T, K]``."""
        return predict(self._traffic, np.arange(step, step + _AHEAD)[:, None] * self._dt)

    def _choose(self, others: VehicleState[Air], state: VehicleState[Air], time: float) -> Array:
        """Return the numbers of the intruders that the policy looks at."""
        visible_now = self._all & visible(self._window, time)
        chosen = self._every_number
        if self._many:
            chosen = self._policy.most_critical(state, others, visible_now, self._every_scale)
        return chosen[visible_now[chosen]]

    def intruders_at(self, step: int) -> list[VehicleState[Air]]:
        """Return the intruders that are looked at, as they are at a time step."""
        return self._flown[step % len(self._flown)]

    def way_back(self, state: VehicleState[Air], aim: tuple[float, float], step: int) -> bool:
        """Return whether the direct route is clear of all intruders."""
        time, task = step * self._dt, self._task
        if self._window is None:
            way = direct(state, aim, time, task, FLOATS)
            # Without intruders, too, the goal may be inside the turning circle.
            if not way.possible:
                return False
            for other, least in zip(self.intruders_at(step), self._far, strict=True):
                if not keeps_clear(state, way, other, least, time, task, FLOATS):
                    return False
            if not self._many:
                return True
        others = take(self._block, step % _AHEAD)
        return _clear_of_others(
            state, aim, others, self._required, self._window, time, task, self._continuation
        )


def _clear_of_others(
    state: VehicleState[Air],
    goal: tuple[float, float],
    others: VehicleState[Air],
    required_range: Array,
    window: Window | None,
    time: float,
    task: DirectTask,
    continuation: RouteContinuation | None,
) -> bool:
    """Return whether the direct route is clear of intruders ``[K]``, and among many the route
    beyond it.
    """
    if not np.all(clear(state, goal, others, required_range, time, task, np, window)):
        return False
    if continuation is None:
        return True
    own: VehicleState[Air] = VehicleState(*(np.array([value]) for value in state))
    to = np.array([goal[0]]), np.array([goal[1]])
    least = np.full(continuation.traffic.mask.shape, -np.inf)
    least[continuation.traffic.mask] = required_range
    return bool(continuation.clear(own, to, least, np.array([0]), np.array([time]), task)[0])


def _in_floats(tracks: VehicleState[Air]) -> list[list[VehicleState[Air]]]:
    """Return states ``[T, K]`` as plain floats, a list for each time."""
    fields = [field.tolist() for field in tracks]
    state: Any = VehicleState  # in the frame of the tracks
    return [list(map(state, *row)) for row in zip(*fields, strict=True)]


def _continuation_clear(
    underway: _Underway,
    aim: tuple[Array, Array],
    others: VehicleState[Air],
    continuation: RouteContinuation | None,
    time: float,
    task: DirectTask,
) -> Array:
    """Return whether the direct route is clear of all intruders ``[M, K]``, and among many the
    route beyond it, bool ``[M]``.
    """
    mask, required_range = underway.traffic.mask, underway.required_range
    free = _all_clear(
        underway.flight.state, aim, others, underway.traffic, required_range, time, task
    )
    if continuation is not None:
        departing = np.flatnonzero(free)
        least = np.where(mask, required_range, -np.inf)
        times = np.full(departing.size, time)
        departures = take((underway.flight.state, aim, least), departing)
        free[departing] = continuation.clear(*departures, underway.rows[departing], times, task)
    return free


def _all_clear(
    state: VehicleState[Air],
    goal: tuple[Array, Array],
    others: VehicleState[Air],
    traffic: Traffic,
    required_range: Array,
    time: float,
    task: DirectTask,
) -> Array:
    """Return whether the direct route is clear of all intruders, ``[N]``."""
    mask, own = traffic.mask, column((state, goal))
    if mask.shape[-1] == 0:
        return clear(state, goal, state, -np.inf, time, task, np)
    required_range = np.where(mask, required_range, -np.inf)
    each_clear = clear(*own, others, required_range, time, task, np, traffic.window)
    return np.all(each_clear, axis=-1)


def _empty(count: int, points: int) -> Rollout:
    """Return that no manoeuvre has ended, ``[count]``, with places for plan states."""
    time, path, turn_sign, reversals = np.full((4, count), np.nan)
    return Rollout(
        plan_states=VehicleState(*np.full((4, count, points), np.nan)),
        end=VehicleState(*np.full((4, count), np.nan)),
        time=time,
        direct=np.zeros(count, dtype=bool),
        path=path,
        turn_sign=turn_sign,
        reversals=reversals,
    )
