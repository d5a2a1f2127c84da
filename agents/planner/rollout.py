"""The policy flown ahead in the surrogate: from the request until the way back to the route is
clear, or it is back.

The same functions of the core twice: over plain floats for one request, where arrays of one element
would cost ten times their arithmetic, and over arrays for many. The policy sees the intruders, as
predicted, at every time step; where there are more than it was trained with, the most critical
ones, chosen every few steps. Then also the direct way to the goal is looked at; once it is clear
of all, the policy has done its work.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from agents.manoeuvres.direct_to_goal import EVERY, DirectTask, clear
from agents.planner.beyond import CROWD, Beyond, beyond
from agents.planner.budget import Budget
from agents.planner.options import Options, task_of
from agents.planner.request import Request, drift_points
from agents.planner.sight import shares, visible
from agents.planner.traffic import Traffic, Window, predict, requirement_of
from agents.policy.inference import Policy
from envs.backend import FLOATS
from envs.kinematics import VehicleState, advance, commands
from envs.relative import at_share, distance
from envs.trees import column, map_leaves, scatter, take
from envs.wind import aim_point

_SHARE = 0.3  # of the computation, for a policy that finds no way back among many or among areas
# time steps for which the intruders are predicted at once; most flights take fewer
_AHEAD = 13 * EVERY


class Rollout(NamedTuple):
    """Where manoeuvres lead; fields ``[N]``, those of plan states ``[N, S]``."""

    plan_states: (
        VehicleState  # at each waypoint's time, the first at the request, [N, S]; nan after the end
    )
    # where the way back is clear, or the goal within the radius; nan where neither was in time
    end: VehicleState
    time: Any  # when that is, s; nan where it was not
    direct: Any  # whether the goal still lies ahead, on the direct way, bool
    path: Any  # length flown until the end, m
    turn_sign: Any  # of the last turn: 1 left, -1 right, 0 none
    reversals: Any  # how often the turn changed side


class _Underway(NamedTuple):
    """Manoeuvres that have not ended, ``[M]``."""

    rows: Any  # their numbers in the request
    goal: tuple[Any, Any]  # at the request, m
    drift: tuple[Any, Any] | None  # of the goal, m/s; None: it stands still
    traffic: Traffic
    required_range: Any  # from each intruder, m, [M, K]
    state: VehicleState
    path: Any  # these three as of :class:`Rollout`
    turn_sign: Any
    reversals: Any
    chosen: Any  # numbers of the intruders that the policy sees among many
    share: Any  # of their distances, at which the policy sees them, [M, K]; None: all of it


def roll(
    request: Request,
    goal: Any,
    policy: Policy,
    options: Options,
    budget: Budget | None = None,
    *,
    floats: bool = False,
) -> Rollout:
    """Roll the policy ahead to the points of the route numbered ``goal``, ``[N]``.

    With ``floats`` one request after the other, in plain floats, until the budget ends: faster for
    fewer than about a hundred.
    """
    rows, traffic, count = np.arange(goal.size), request.traffic, goal.size
    goal_x, goal_y = request.route_x[rows, goal], request.route_y[rows, goal]
    required_range = requirement_of(traffic, request.own, options.requirement) + options.slack
    crowd = traffic.mask.shape[-1] > CROWD
    if floats:
        given = (
            take((request.own, traffic, ((goal_x, goal_y), request.drift), required_range), row)
            for row in rows
        )
        rests = [
            beyond(take(request, rows[[row]]), goal[[row]], options) if crowd else None
            for row in rows
        ]
        share = 1.0 if request.areas is None and not crowd else _SHARE
        ends = partial((budget or Budget()).ends, "policy", share)
        each = [
            _roll_one(*one, policy, options, ends, rest)
            for one, rest in zip(given, rests, strict=True)
        ]
        return map_leaves(lambda *fields: np.concatenate(fields), *each)
    task, limits, dt, spacing = (
        task_of(options),
        options.manoeuvre,
        options.aircraft.dt,
        options.spacing,
    )
    rest = beyond(request, goal, options) if crowd else None
    steps = int(task.until / dt + 1e-9)
    result = _empty(count, steps // spacing + 1)
    now = _Underway(
        rows=rows,
        goal=(goal_x, goal_y),
        drift=request.drift,
        traffic=traffic,
        required_range=required_range,
        state=VehicleState(*(np.array(field, dtype=float) for field in request.own)),
        path=np.zeros(count),
        turn_sign=np.zeros(count),
        reversals=np.zeros(count),
        chosen=np.zeros((count, min(policy.most, traffic.mask.shape[-1])), dtype=int),
        share=shares(traffic, options.requirement),
    )
    for step in range(steps + 1):
        time = step * dt
        if step % spacing == 0:
            scatter(result.plan_states, (now.rows, step // spacing), now.state)
        seen = predict(now.traffic, time)
        place = drift_points(now.goal, now.drift, time)
        arrived = distance(place[0] - now.state.x, place[1] - now.state.y, np) <= task.radius
        ended, aim = arrived, aim_point(now.state, place, now.drift, task.until - time, np)
        if options.direct and step % EVERY == 0:
            ended = ended | _clear_beyond(now, aim, seen, rest, time, task)
        if ended.any():
            times = np.full(now.rows.size, time)
            landed = now.state, times, ~arrived, now.path, now.turn_sign, now.reversals
            scatter(result[1:], now.rows[ended], take(landed, ended))
            now, seen, aim = take((now, seen, aim), ~ended)
        if now.rows.size == 0 or step == steps:
            break
        if now.share is not None:
            seen = at_share(column(now.state), seen, now.share)
        looked_at = seen, now.traffic.mask & visible(now.traffic.window, time)
        if traffic.mask.shape[-1] > policy.most:
            if step % EVERY == 0:
                now = now._replace(chosen=policy.most_critical(now.state, *looked_at))
            looked_at = map_leaves(
                lambda field, at=now.chosen: np.take_along_axis(field, at, axis=-1), looked_at
            )
        action = policy.command(now.state, *looked_at, *aim)
        acceleration, yaw_rate = commands((action[:, 0], action[:, 1]), limits, np)
        moved = advance(now.state, acceleration, yaw_rate, dt, limits, np)
        turns = np.abs(yaw_rate) >= 0.1 * limits.yaw_rate_max
        turning = np.where(turns, np.sign(yaw_rate), now.turn_sign)
        now = now._replace(
            state=moved,
            path=now.path + 0.5 * dt * (now.state.speed + moved.speed),
            turn_sign=turning,
            reversals=now.reversals + (turning * now.turn_sign < 0.0),
        )
    return result


def _roll_one(
    own: VehicleState,
    traffic: Traffic,
    goal: tuple[Any, Any],
    required_range: Any,
    policy: Policy,
    options: Options,
    ends: Callable[[], bool],
    rest: Beyond | None,
) -> Rollout:
    """Roll one request in plain floats, against intruders ``[K]``, until the computation ends;
    fields ``[1]`` and ``[1, S]``. The goal comes with its drift.
    """
    task, limits, dt, spacing = (
        task_of(options),
        options.manoeuvre,
        options.aircraft.dt,
        options.spacing,
    )
    steps = int(task.until / dt + 1e-9)
    result = _empty(1, steps // spacing + 1)
    traffic, required_range = take((traffic, required_range), traffic.mask)
    flown, plan_states = list[list[VehicleState]](), list[VehicleState]()
    far, every = required_range.tolist(), predict(traffic, np.zeros((1, 1)))
    at = shares(traffic, options.requirement)
    at_each, window = None if at is None else at.tolist(), traffic.window
    state, (begin, drift) = VehicleState(*map(float, own)), map_leaves(float, goal)
    (goal_x, goal_y), aim = begin, begin
    many, mask = len(far) > policy.most, np.ones(len(far), dtype=bool)
    path, turn_sign, reversals = 0.0, 0.0, 0
    square, threshold = task.radius * task.radius, 0.1 * limits.yaw_rate_max
    for step in range(steps + 1):
        if step % _AHEAD == 0:
            every = predict(traffic, np.arange(step, step + _AHEAD)[:, None] * dt)
        if step % EVERY == 0:
            first = step % _AHEAD
            ahead = take(every, slice(first, first + EVERY))
            if many or window is not None:
                first_seen = take(ahead, 0)
                if at is not None:
                    first_seen = at_share(state, first_seen, at)
                there = mask & visible(window, step * dt)
                chosen = np.arange(len(mask))
                if many:
                    chosen = policy.most_critical(state, first_seen, there)
                chosen = chosen[there[chosen]]
                ahead, far = take(ahead, (slice(None), chosen)), required_range[chosen].tolist()
                at_each = None if at is None else at[chosen].tolist()
            flown = _in_floats(ahead)
        seen = flown[step % EVERY]
        if step % spacing == 0:
            plan_states.append(state)
        if drift is not None:
            goal_x = begin[0] + drift[0] * step * dt
            goal_y = begin[1] + drift[1] * step * dt
            aim = aim_point(state, (goal_x, goal_y), drift, task.until - step * dt, FLOATS)
        dx, dy = goal_x - state.x, goal_y - state.y
        arrived = dx * dx + dy * dy <= square
        # Without intruders nothing is in the way, but the goal may be inside the turning circle.
        if arrived or (
            options.direct
            and step % EVERY == 0
            and (
                window is not None
                or all(
                    clear(state, aim, other, least, step * dt, task, FLOATS)
                    for other, least in zip(seen or [state], far or [-math.inf], strict=True)
                )
            )
            and (
                not (many or window is not None)
                or _clear_of_others(
                    state,
                    aim,
                    take(every, step % _AHEAD),
                    required_range,
                    window,
                    step * dt,
                    task,
                    rest,
                )
            )
        ):
            scatter(result[1:], 0, (state, step * dt, not arrived, path, turn_sign, reversals))
            break
        if step == steps or (step % EVERY == 0 and ends()):
            break
        if at_each is not None:
            seen = [at_share(state, *one) for one in zip(seen, at_each, strict=True)]
        action = policy.command_one(state, seen, *aim)
        acceleration, yaw_rate = commands(action, limits, FLOATS)
        moved = advance(state, acceleration, yaw_rate, dt, limits, FLOATS)
        path += 0.5 * dt * (state.speed + moved.speed)
        if abs(yaw_rate) >= threshold:
            reversals += yaw_rate * turn_sign < 0.0
            turn_sign = 1.0 if yaw_rate > 0.0 else -1.0
        state = moved
    scatter(
        result.plan_states,
        (0, slice(len(plan_states))),
        VehicleState(*zip(*plan_states, strict=True)),
    )
    return result


def _clear_of_others(
    state: VehicleState,
    goal: tuple[float, float],
    others: VehicleState,
    required_range: Any,
    window: Window | None,
    time: float,
    task: DirectTask,
    rest: Beyond | None,
) -> bool:
    """Return whether the direct way is clear of intruders ``[K]``, and among many the route beyond
    it.
    """
    if not np.all(clear(state, goal, others, required_range, time, task, np, window)):
        return False
    if rest is None:
        return True
    one = VehicleState(*(np.array([value]) for value in state))
    to = np.array([goal[0]]), np.array([goal[1]])
    least = np.full(rest.traffic.mask.shape, -np.inf)
    least[rest.traffic.mask] = required_range
    return bool(rest.clear(one, to, least, np.array([0]), np.array([time]), task)[0])


def _in_floats(tracks: VehicleState) -> list[list[VehicleState]]:
    """Return states ``[T, K]`` as plain floats, a list for each time."""
    fields = [field.tolist() for field in tracks]
    return [list(map(VehicleState, *each)) for each in zip(*fields, strict=True)]


def _clear_beyond(
    now: _Underway,
    aim: tuple[Any, Any],
    seen: VehicleState,
    rest: Beyond | None,
    time: float,
    task: DirectTask,
) -> Any:
    """Return whether the direct way is clear of all intruders ``[M, K]``, and among many the route
    beyond it, bool ``[M]``.
    """
    mask, required_range = now.traffic.mask, now.required_range
    found = _all_clear(now.state, aim, seen, now.traffic, required_range, time, task)
    if rest is not None:
        some = np.flatnonzero(found)
        least = np.where(mask, required_range, -np.inf)
        times = np.full(some.size, time)
        asked = take((now.state, aim, least), some)
        found[some] = rest.clear(*asked, now.rows[some], times, task)
    return found


def _all_clear(
    state: VehicleState,
    goal: tuple[Any, Any],
    seen: VehicleState,
    traffic: Traffic,
    required_range: Any,
    time: float,
    task: DirectTask,
) -> Any:
    """Return whether the direct way is clear of all intruders, ``[N]``."""
    mask, own = traffic.mask, column((state, goal))
    if mask.shape[-1] == 0:
        return clear(state, goal, state, -np.inf, time, task, np)
    required_range = np.where(mask, required_range, -np.inf)
    kept = clear(*own, seen, required_range, time, task, np, traffic.window)
    return np.all(kept, axis=-1)


def _empty(count: int, points: int) -> Rollout:
    plan_states, end = (
        VehicleState(*np.full((4, count, points), np.nan)),
        VehicleState(*np.full((4, count), np.nan)),
    )
    time, path, turn_sign, reversals = np.full((4, count), np.nan)
    return Rollout(plan_states, end, time, np.zeros(count, dtype=bool), path, turn_sign, reversals)
