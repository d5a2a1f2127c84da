"""Manoeuvres of the fallback in the air: many at once, until the direct way to the goal is clear.

They fly several strides at once in a few calls on arrays: a call costs more than strides flown
beyond an end.
"""

from typing import Any, NamedTuple

import numpy as np

from agents.manoeuvres.direct_to_goal import EVERY, DirectTask, clear
from agents.manoeuvres.escape_manoeuvre import Manoeuvre, fly_away, takeoff
from agents.planner import areas_ahead
from agents.planner.beyond import CROWD, Beyond, beyond
from agents.planner.budget import Budget
from agents.planner.options import Options, task_of
from agents.planner.request import Request, drift_points
from agents.planner.rollout import Rollout
from agents.planner.traffic import Window, predict, requirement_of, uncertainty, within_window
from envs.angles import wrap
from envs.kinematics import Limits, VehicleState
from envs.relative import distance, leg_separation
from envs.trees import column, map_leaves, scatter, take
from envs.wind import aim_point

_AT_ONCE = 6  # strides flown at once at first
_LATER = 18  # strides from turning back until uncertainty has grown to what the way back keeps
_NEAREST = 80  # intruders of a crowd that the way back is set against
_PAIRS = (
    8_192  # strides times manoeuvres times intruders at once: more do not stay in a core's cache
)


def stride_of(options: Options) -> float:
    """Return the time step of the search, s: a part of the time between waypoints."""
    return EVERY * options.aircraft.dt


class ManoeuvreFlights(NamedTuple):
    """Manoeuvres flown until the way back is clear; fields ``[M]``."""

    rollout: Rollout
    clearance: (
        Any  # smallest distance to any intruder less the required one, until then, m; an estimate
    )


class Effort(NamedTuple):
    """When manoeuvres are given up."""

    least: float  # below this clearance, m
    enough: int  # once so many of a request's manoeuvres have ended well, the others are
    longest: float = np.inf  # latest time at which a manoeuvre may turn back, s
    budget: Budget = Budget()  # ends the flight of all


def fly_out(
    request: Request, goal: Any, which: Any, manoeuvre: Manoeuvre, options: Options, effort: Effort
) -> ManoeuvreFlights:
    """Fly manoeuvres ``[M]`` of requests ``which`` until the direct way to the goal, a number
    ``[N]``, is clear.
    """
    least, enough, longest, budget = effort
    task, stride, smoothing = task_of(options), stride_of(options), options.smoothing
    last = int(min(task.until, longest) / stride + 1e-9)
    number = np.arange(goal.size)
    goal_x, goal_y = request.route_x[number, goal], request.route_y[number, goal]
    scene = _scene(request, goal, options, last)
    landed = _Landed(which.size, last)
    rows, of, arrivals, first = np.arange(which.size), which, np.zeros(goal.size, dtype=int), 0
    flight, closest = takeoff(take(request.own, of), manoeuvre), np.full(which.size, np.inf)
    while rows.size and first <= last and not budget.ends("fallback"):
        # As many strides as before, because the direct way is mostly clear soon.
        most = _PAIRS // max(rows.size * scene.required.shape[-1], 1)
        count = min(max(min(max(first, _AT_ONCE), most), 1), last + 1 - first)
        strides = np.arange(first, first + count)
        flown, flight = fly_away(flight, manoeuvre, first, count, stride, task.limits)
        clearance = scene.clearance(flown, first, of)
        if request.areas is not None:
            times = np.arange(first, first + count + 1) * stride
            amid = request.areas.value, request.own, flown, times, of, options.requirement.margin
            clearance = np.minimum(clearance, areas_ahead.clearance(*amid))
        # At the beginning of each stride, and after the last.
        nearest = np.minimum.accumulate(np.concatenate([closest[None], clearance]), axis=0)
        closest, nearest = nearest[-1], nearest[:-1]
        hopeful = nearest >= least
        returning = hopeful & (strides[:, None] * stride >= manoeuvre.resume)
        at, asking = np.nonzero(returning)
        there, owner = strides[at], of[asking]
        from_there = take(flown, (at, asking))
        drift = take(request.drift, owner)
        to = drift_points((goal_x[owner], goal_y[owner]), drift, there * stride)
        aim = aim_point(from_there, to, drift, task.until, np)
        clear_way = scene.way_back(from_there, aim, there, owner, manoeuvre.slack[asking], task)
        if request.areas is not None and clear_way.any():
            rows_of = np.flatnonzero(clear_way)
            from_there, aim, time = take((from_there, aim, there * stride), rows_of)
            clear_way[rows_of] = areas_ahead.way_clear(
                request.areas.value,
                request.own,
                from_there,
                aim,
                time,
                owner[rows_of],
                options.requirement.margin,
                task,
            )
        returning[at, asking] = clear_way

        end, ended = _first(returning | ~hopeful)
        each = np.arange(rows.size)
        returned = ended & returning[end, each] & (nearest[end, each] >= max(least, smoothing))
        # A manoeuvre that is under way for longer than so many others costs more than they.
        well = np.zeros((count, goal.size), dtype=int)
        np.add.at(well, (end[returned], of[returned]), 1)
        well = arrivals + np.cumsum(well, axis=0)
        full, enough_there = _first(well >= enough)
        arrivals = well[-1]
        over = np.minimum(np.where(ended, end, count), np.where(enough_there, full, count)[of])
        on = over == count
        over = np.minimum(over, count - 1)
        done = ~on & returning[over, each]
        landed.note(rows, strides, flown, over, done, nearest[over, each])
        if not on.all():
            rows, of, manoeuvre, flight, closest = take((rows, of, manoeuvre, flight, closest), on)
        first += count
    return ManoeuvreFlights(
        landed.rollout(task.limits, stride, options.spacing // EVERY), landed.clearance
    )


def _first(happens: Any) -> tuple[Any, Any]:
    """Return in which row something ``[S, M]`` happens first, 0 where it does not, and whether it
    does, ``[M]``.
    """
    return np.argmax(happens, axis=0), happens.any(axis=0)


class _Scene(NamedTuple):
    """Intruders at each stride (s), ``[S, N, K]``; the separation required at first (-inf: absent),
    its growth, m.
    """

    others: VehicleState
    required: Any
    stride: float
    growth: Any
    order: Any  # numbers of the intruders, those nearest to the straight flight to the goal first
    enough: float  # clearance, m, beyond which more is not told where there are many intruders
    rest: Beyond | None  # of the routes, where there are many intruders
    window: Window | None  # when each counts, [N, K]; None: always
    counted: Any  # whether each may in each stride, bool, [S, N, K]; None: always

    def way_back(
        self,
        own: VehicleState,
        to: tuple[Any, Any],
        there: Any,
        owner: Any,
        slack: Any,
        task: DirectTask,
    ) -> Any:
        """Return whether the direct way to the goal keeps clear of all intruders, bool ``[R]``,
        from states at some strides of flights of requests ``owner``.

        A few intruders block most ways: the others, and the route beyond the goal, are looked at
        where those do not.
        """
        found, many = np.ones(there.size, dtype=bool), self.required.shape[-1]
        last = len(self.others.x) - 2
        # The validator looks at all: the search may be wrong about those far from the flight.
        for some in [slice(0, CROWD), slice(CROWD, _NEAREST)] if many > CROWD else [slice(many)]:
            rows = np.flatnonzero(found)
            at, of = there[rows, None], owner[rows, None]
            each = self.order[owner[rows], some]
            required = self.required[of, each] + slack[rows, None]
            if self.growth is not None:
                required = required + self.growth[np.minimum(at + _LATER, last), of, each]
            state, goal = column(take((own, to), rows))
            seen = take(self.others, (at, of, each))
            time = at * self.stride
            window = take(self.window, (of, each))
            kept = clear(state, goal, seen, required, time, task, np, window)
            found[rows] = np.all(kept, axis=-1)
            rows = rows[found[rows]]
            if self.rest is not None and some.start == 0 and rows.size:
                found[rows] = self._clear_beyond(*take((own, to, there, owner, slack), rows), task)
        return found

    def _clear_beyond(
        self,
        own: VehicleState,
        to: tuple[Any, Any],
        there: Any,
        owner: Any,
        slack: Any,
        task: DirectTask,
    ) -> Any:
        """Return whether the route beyond the goal is clear after direct ways, bool ``[R]``."""
        assert self.rest is not None
        required = self.required[owner] + slack[:, None]
        return self.rest.clear(own, to, required, owner, there * self.stride, task)

    def clearance(self, flown: VehicleState, first: int, of: Any) -> Any:
        """Return the least distance less the required one in each stride of flights, m,
        ``[S, M]``.
        """
        if self.required.shape[-1] > CROWD:
            return self._clearance_of_near(flown, first, of)
        count = len(flown.x) - 1
        # The intruders of a single request are seen by all of its manoeuvres.
        of = slice(None) if len(self.required) == 1 else of
        own, seen = (
            take(flown, (..., None)),
            take(self.others, (slice(first, first + count + 1), of)),
        )
        before, after = take((own, seen), slice(-1)), take((own, seen), slice(1, None))
        clearance = (
            leg_separation(before[0], after[0], before[1], after[1], self.stride, np)
            - self.required[of]
        )
        if self.growth is not None:
            clearance = clearance - self.growth[first : first + count, of]
        if self.counted is not None:
            clearance = np.where(self.counted[first : first + count, of], clearance, np.inf)
        return np.min(clearance, axis=-1, initial=np.inf)

    def _clearance_of_near(self, flown: VehicleState, first: int, of: Any) -> Any:
        """Return the same, but at most :attr:`enough`, from those intruders alone that can come so
        near in these strides.
        """
        count = len(flown.x) - 1
        others = take(self.others, (first, of))
        away = distance(others.x - flown.x[0][:, None], others.y - flown.y[0][:, None], np)
        quickest = flown.speed.max(axis=0)[:, None] + others.speed
        growth = 0.0 if self.growth is None else self.growth[first + count - 1, of]
        near = away - count * self.stride * quickest - self.required[of] - growth <= self.enough
        flight, k = np.nonzero(near & (self.required[of] > -np.inf))
        found = np.full((count, of.size), self.enough)
        if flight.size == 0:
            return found
        owner, steps = of[flight], slice(first, first + count + 1)
        own, seen = take(flown, (slice(None), flight)), take(self.others, (steps, owner, k))
        before, after = take((own, seen), slice(-1)), take((own, seen), slice(1, None))
        clearance = (
            leg_separation(before[0], after[0], before[1], after[1], self.stride, np)
            - self.required[owner, k]
        )
        if self.growth is not None:
            clearance = clearance - self.growth[first : first + count, owner, k]
        if self.counted is not None:
            clearance = np.where(self.counted[first : first + count, owner, k], clearance, np.inf)
        begins = np.flatnonzero(np.diff(flight, prepend=-1))
        least = np.minimum.reduceat(clearance, begins, axis=1)
        found[:, flight[begins]] = np.minimum(least, self.enough)
        return found


def _scene(request: Request, goal: Any, options: Options, last: int) -> _Scene:
    """Return the intruders of requests ``[N]`` up to the end of a stride."""
    traffic, stride, growth = request.traffic, stride_of(options), None
    times = np.arange(last + 2)[:, None, None] * stride
    if traffic.velocity_std.any():
        growth = options.requirement.sigmas * (
            uncertainty(traffic, times[1:]) - uncertainty(traffic, 0.0)
        )
    required_range = np.where(
        traffic.mask, requirement_of(traffic, request.own, options.requirement), -np.inf
    )
    others = predict(traffic, times)
    number = np.arange(goal.size)
    to = request.route_x[number, goal], request.route_y[number, goal]
    to = aim_point(request.own, to, request.drift, task_of(options).until, np)
    counts = None if traffic.window is None else within_window(traffic, times[:-1], times[1:])
    order = _order(request.own, to, others, required_range, times, counts)
    rest = beyond(request, goal, options) if required_range.shape[-1] > CROWD else None
    return _Scene(
        others,
        required_range,
        stride,
        growth,
        order,
        options.aircraft.separation,
        rest,
        traffic.window,
        counts,
    )


def _order(
    own: VehicleState,
    goal: tuple[Any, Any],
    others: VehicleState,
    required_range: Any,
    times: Any,
    counts: Any,
) -> Any:
    """Return the numbers of intruders by how near they come to the straight flight to the goal
    while they count, ``[N, K]``.
    """
    if required_range.shape[-1] <= CROWD:
        return np.broadcast_to(np.arange(required_range.shape[-1]), required_range.shape)
    x, y, speed = own.x[:, None], own.y[:, None], own.speed[:, None]
    dx, dy = goal[0][:, None] - x, goal[1][:, None] - y
    share = np.minimum(speed * times / np.maximum(distance(dx, dy, np), 1e-9), 1.0)
    away = distance(others.x - x - share * dx, others.y - y - share * dy, np)
    if counts is not None:
        away[:-1] = np.where(counts, away[:-1], 1e9)
    return np.argsort(away.min(axis=0) - required_range, axis=-1, kind="stable")


class _Landed:
    """Where manoeuvres have been and ended."""

    def __init__(self, count: int, last: int) -> None:
        self._states = VehicleState(*np.full((4, last + 1, count), np.nan))
        self._end, self._done = np.full(count, last), np.zeros(count, dtype=bool)
        self.clearance = np.full(count, np.inf)

    def note(
        self, rows: Any, strides: Any, flown: VehicleState, over: Any, done: Any, nearest: Any
    ) -> None:
        """Note strides, the last of them in which each is in the air, whether it turned back there,
        its clearance.
        """
        scatter(self._states, (slice(strides[0], strides[-1] + 1), rows), take(flown, slice(-1)))
        self._end[rows], self._done[rows], self.clearance[rows] = strides[over], done, nearest

    def rollout(self, limits: Limits, stride: float, spacing: int) -> Rollout:
        """Return the manoeuvres, with plan states every so many strides; all of them are direct."""
        strides, rows, end = (
            np.arange(len(self._states.x))[:, None],
            np.arange(self._end.size),
            self._end,
        )
        none, speed = np.zeros((1, rows.size)), self._states.speed
        turned = wrap(np.diff(self._states.heading, axis=0), np)
        turning = (np.abs(turned) > 0.1 * limits.yaw_rate_max * stride) & (strides[1:] <= end)
        sign = np.concatenate([none, np.where(turning, np.sign(turned), 0.0)])
        side = np.take_along_axis(
            sign, np.maximum.accumulate(np.where(sign != 0.0, strides, 0), axis=0), axis=0
        )
        reversals = np.sum(sign[1:] * side[:-1] < 0.0, axis=0)
        path = np.concatenate([none, np.cumsum(0.5 * stride * (speed[:-1] + speed[1:]), axis=0)])
        found = take((self._states, path), (end, rows))
        found = map_leaves(
            lambda values: np.where(self._done, values, np.nan),
            (*found, side[-1], reversals, end * stride),
        )
        ends, path, side, reversals, time = found
        some, flown = slice(None, None, spacing), strides <= end
        plan_states = map_leaves(
            lambda field: np.where(flown[some], field[some], np.nan).T, self._states
        )
        return Rollout(plan_states, ends, time, self._done, path, side, reversals)
