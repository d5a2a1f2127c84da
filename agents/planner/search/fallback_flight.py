"""Manoeuvres of the fallback in the air: against the predicted traffic and the areas of a request,
until the direct route to the goal is clear.
"""

from typing import NamedTuple

import numpy as np

from agents.kernel.areas import required_distances
from agents.kernel.traffic import predict, requirement_of, uncertainty, within_window
from agents.manoeuvres.direct_to_goal import EVERY, clear
from agents.manoeuvres.escape_manoeuvre import Manoeuvre
from agents.manoeuvres.simulator import Departure, Effort, Finished, fly_until_clear
from agents.planner.request.options import Narrowed, Options, task_of
from agents.planner.request.request import Request, drift_points
from agents.planner.search import areas_ahead
from agents.planner.search.compiled_flight import FLY_ON, LATER, TURNS, fly_one_out
from agents.planner.search.continuation import CROWD, route_continuation
from agents.planner.search.rollout import Rollout
from envs.angles import wrap
from envs.arrays import Array, Int
from envs.frames import Air
from envs.kinematics import Limits, VehicleState
from envs.relative import distance, leg_separation
from envs.trees import column, map_leaves, take
from envs.wind import aim_point

_NEAREST = 80  # intruders of a crowd that the way back is set against
_MANY = 32  # of a crowd, of which few are near in the strides that are flown at once


def stride_of(options: Options[Narrowed]) -> float:
    """Return the time step of the search, s: a part of the time between waypoints."""
    return EVERY * options.aircraft.dt


class ManoeuvreFlights(NamedTuple):
    """Manoeuvres flown until the way back is clear; fields ``[M]``."""

    rollout: Rollout
    # smallest distance to any intruder less the required one, until then, m; an estimate
    clearance: Array


def fly_out(
    request: Request,
    goal: Int[Array, " N"],
    owner: Int[Array, " M"],
    manoeuvre: Manoeuvre,
    options: Options[Narrowed],
    effort: Effort,
) -> ManoeuvreFlights:
    """Fly manoeuvres ``[M]`` of requests numbered ``owner`` until the direct route to the goal, a
    number ``[N]``, is clear; those of a single request compiled, where that is prepared.
    """
    task, stride, spacing = task_of(options), stride_of(options), options.spacing // EVERY
    last = int(min(task.until, effort.longest) / stride + 1e-9)
    if FLY_ON.ready and goal.size == 1:
        return ManoeuvreFlights(
            *fly_one_out(request, goal, manoeuvre, options, effort, stride, last, spacing)
        )
    around = _RequestSurroundings(request, goal, options, last)
    finished = fly_until_clear(
        request.own, owner, manoeuvre, around, effort, stride, task.until, task.limits
    )
    rollout = _rollout(finished, task.limits, stride, spacing)
    return ManoeuvreFlights(rollout, finished.clearance)


class _RequestSurroundings:
    """What manoeuvres of requests ``[N]`` are tested against
    (:class:`agents.manoeuvres.simulator.Surroundings`): their intruders ``[N, K]`` at each stride,
    the route beyond the goal, and the areas.
    """

    def __init__(
        self, request: Request, goal: Array, options: Options[Narrowed], last: int
    ) -> None:
        """Predict the intruders up to the end of the stride numbered ``last``."""
        traffic, number = request.traffic, np.arange(goal.size)
        self._request, self._task, self._stride = request, task_of(options), stride_of(options)
        self._areas = () if request.areas is None else request.areas.value
        own, margin = request.own, options.requirement.margin
        # From each area, m, [N].
        self._off = [required_distances(area, own.x, own.y, margin) for area in self._areas]
        self._goal = request.route_x[number, goal], request.route_y[number, goal]
        times = np.arange(last + 2)[:, None, None] * self._stride
        # By how much the required distance grows until the end of each stride, m, [S, N, K].
        self._growth = None
        if traffic.velocity_std.any():
            self._growth = options.requirement.sigmas * (
                uncertainty(traffic, times[1:]) - uncertainty(traffic, 0.0)
            )
        # At the request, m; -inf of absent intruders.
        self._required = np.where(
            traffic.mask, requirement_of(traffic, request.own, options.requirement), -np.inf
        )
        self._others = predict(traffic, times)
        # Which may count in each stride, bool, [S, N, K]; None: all of them always.
        self._counted = None
        if traffic.window is not None:
            self._counted = within_window(traffic, times[:-1], times[1:])
        # Clearance, m, beyond which more is not told where there are many intruders.
        self._enough = options.aircraft.separation
        self._order = self._nearest_first(times) if self.intruders > CROWD else None
        self._continuation = route_continuation(request, goal, options)

    @property
    def intruders(self) -> int:
        """About how many each flight is set against."""
        return min(self._required.shape[-1], _MANY)

    def way_back(self, departure: Departure) -> Array:
        """Return whether the direct route to the goal keeps clear, bool ``[R]``."""
        time, drift = departure.stride * self._stride, take(self._request.drift, departure.owner)
        place = drift_points(take(self._goal, departure.owner), drift, time)
        aim = aim_point(departure.own, place, drift, self._task.until, np)
        free = self._clear_of_traffic(departure, aim)
        if self._areas and free.any():
            rows = np.flatnonzero(free)
            own, to, when, owner = take((departure.own, aim, time, departure.owner), rows)
            free[rows] = areas_ahead.way_clear(
                self._areas, self._off, own, to, when, owner, self._task
            )
        return free

    def _clear_of_traffic(self, departure: Departure, aim: tuple[Array, Array]) -> Array:
        """Return whether direct routes keep clear of all intruders, bool ``[R]``.

        The nearest intruders block most ways: the route beyond the goal, and the others of a crowd,
        are looked at where those do not.
        """
        if self._order is None:
            free = self._clear_of_some(departure, aim, np.arange(self.intruders)[None])
        else:
            free = self._clear_of_some(departure, aim, self._order[departure.owner, :CROWD])
        rows = np.flatnonzero(free)
        if rows.size:
            free[rows] = self._continuation_clear(*take((departure, aim), rows))
        if self._order is not None:
            # The validator looks at all: the search may be wrong about those far from the flight.
            rows = np.flatnonzero(free)
            remaining, to = take((departure, aim), rows)
            next_ones = self._order[remaining.owner, CROWD:_NEAREST]
            free[rows] = self._clear_of_some(remaining, to, next_ones)
        return free

    def _clear_of_some(
        self, departure: Departure, aim: tuple[Array, Array], numbers: Array
    ) -> Array:
        """Return whether direct routes keep clear of the intruders with these ``numbers``,
        bool ``[R]``; numbers ``[R, k]``.
        """
        at, of, slack = column((departure.stride, departure.owner, departure.slack))
        required = self._required[of, numbers] + slack
        if self._growth is not None:
            last = len(self._growth) - 1
            required = required + self._growth[np.minimum(at + LATER, last), of, numbers]
        own, goal = column((departure.own, aim))
        others = take(self._others, (at, of, numbers))
        window = take(self._request.traffic.window, (of, numbers))
        time = at * self._stride
        each_clear = clear(own, goal, others, required, time, self._task, np, window)
        return np.all(each_clear, axis=-1)

    def _continuation_clear(self, departure: Departure, aim: tuple[Array, Array]) -> Array:
        """Return whether the route beyond the goal is clear after direct routes, bool ``[R]``."""
        required = self._required[departure.owner] + departure.slack[:, None]
        time = departure.stride * self._stride
        return self._continuation.clear(
            departure.own, aim, required, departure.owner, time, self._task
        )

    def clearance(self, flown: VehicleState[Air], first: int, owner: Array) -> Array:
        """Return the least distance less the required one in each stride of flights, m,
        ``[S, M]``, to intruders and areas.
        """
        if self._order is None:
            clearance = self._clearance_of_all(flown, first, owner)
        else:
            clearance = self._clearance_of_near(flown, first, owner)
        if not self._areas:
            return clearance
        times = np.arange(first, first + len(flown.x)) * self._stride
        of_areas = areas_ahead.clearance(self._areas, self._off, flown, times, owner)
        return np.minimum(clearance, of_areas)

    def _clearance_of_all(self, flown: VehicleState[Air], first: int, owner: Array) -> Array:
        """Return the least clearance from any intruder, m, ``[S, M]``."""
        count = len(flown.x) - 1
        # The intruders of a single request are seen by all of its manoeuvres.
        of = slice(None) if len(self._required) == 1 else owner
        own, others = (
            take(flown, (..., None)),
            take(self._others, (slice(first, first + count + 1), of)),
        )
        clearance = self._stride_separation(own, others) - self._required[of]
        if self._growth is not None:
            clearance = clearance - self._growth[first : first + count, of]
        if self._counted is not None:
            clearance = np.where(self._counted[first : first + count, of], clearance, np.inf)
        return np.min(clearance, axis=-1, initial=np.inf)

    def _clearance_of_near(self, flown: VehicleState[Air], first: int, owner: Array) -> Array:
        """Return the same, but at most what is enough, from those intruders alone that can come so
        near in these strides.
        """
        count = len(flown.x) - 1
        # The intruders of a single request are seen by all of its manoeuvres.
        others = take(self._others, (first, slice(None) if len(self._required) == 1 else owner))
        away = distance(others.x - flown.x[0][:, None], others.y - flown.y[0][:, None], np)
        quickest = flown.speed.max(axis=0)[:, None] + others.speed
        required = self._required[owner]
        growth = 0.0 if self._growth is None else self._growth[first + count - 1, owner]
        near = away - count * self._stride * quickest - required - growth <= self._enough
        flight, k = np.nonzero(near & (required > -np.inf))
        clearances = np.full((count, owner.size), self._enough)
        if flight.size == 0:
            return clearances
        of, strides = owner[flight], slice(first, first + count)
        own = take(flown, (slice(None), flight))
        tracks = take(self._others, (slice(first, first + count + 1), of, k))
        clearance = self._stride_separation(own, tracks) - self._required[of, k]
        if self._growth is not None:
            clearance = clearance - self._growth[strides, of, k]
        if self._counted is not None:
            clearance = np.where(self._counted[strides, of, k], clearance, np.inf)
        begins = np.flatnonzero(np.diff(flight, prepend=-1))
        least = np.minimum.reduceat(clearance, begins, axis=1)
        clearances[:, flight[begins]] = np.minimum(least, self._enough)
        return clearances

    def _stride_separation(self, own: VehicleState[Air], others: VehicleState[Air]) -> Array:
        """Return the smallest distances in each stride between states at their ends, m."""
        before, after = take((own, others), slice(-1)), take((own, others), slice(1, None))
        return leg_separation(before[0], after[0], before[1], after[1], self._stride, np)

    def _nearest_first(self, times: Array) -> Array:
        """Return the numbers of intruders by how near they come to the straight flight to the goal
        while they count, ``[N, K]``.
        """
        own = self._request.own
        goal = aim_point(own, self._goal, self._request.drift, self._task.until, np)
        x, y, speed = own.x[:, None], own.y[:, None], own.speed[:, None]
        dx, dy = goal[0][:, None] - x, goal[1][:, None] - y
        share = np.minimum(speed * times / np.maximum(distance(dx, dy, np), 1e-9), 1.0)
        others = self._others
        away = distance(others.x - x - share * dx, others.y - y - share * dy, np)
        if self._counted is not None:
            away[:-1] = np.where(self._counted, away[:-1], 1e9)
        return np.argsort(away.min(axis=0) - self._required, axis=-1, kind="stable")


def _rollout(finished: Finished, limits: Limits, stride: float, spacing: int) -> Rollout:
    """Return manoeuvres with plan states every so many strides; all of them are direct."""
    states, end, returned = finished.states, finished.end, finished.returned
    strides, rows = np.arange(len(states.x))[:, None], np.arange(end.size)
    none, speed = np.zeros((1, rows.size)), states.speed
    turned = wrap(np.diff(states.heading, axis=0), np)
    turning = (np.abs(turned) > TURNS * limits.yaw_rate_max * stride) & (strides[1:] <= end)
    sign = np.concatenate([none, np.where(turning, np.sign(turned), 0.0)])
    latest_turn = np.maximum.accumulate(np.where(sign != 0.0, strides, 0), axis=0)
    side = np.take_along_axis(sign, latest_turn, axis=0)
    reversals = np.sum(sign[1:] * side[:-1] < 0.0, axis=0)
    path = np.concatenate([none, np.cumsum(0.5 * stride * (speed[:-1] + speed[1:]), axis=0)])
    published, flown = slice(None, None, spacing), strides <= end
    plan_states = map_leaves(
        lambda field: np.where(flown[published], field[published], np.nan).T, states
    )

    def where_returned(values: Array) -> Array:
        return np.where(returned, values, np.nan)

    return Rollout(
        plan_states,
        end=map_leaves(where_returned, take(states, (end, rows))),
        time=where_returned(end * stride),
        direct=returned,
        path=where_returned(path[end, rows]),
        turn_sign=where_returned(side[-1]),
        reversals=where_returned(reversals),
    )
