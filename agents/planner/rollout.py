"""The policy flown ahead in the surrogate: from the request until the way back to the route is
clear, or it is back.

The same functions of the core twice: over plain floats for one request, where arrays of one element
would cost ten times their arithmetic, and over arrays for many. The policy sees the intruders, as
predicted, at every time step; where there are more than it was trained with, the most critical
ones, chosen every few steps. Then also the direct way to the goal is looked at; once it is clear
of all, the policy has done its work.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from agents.manoeuvres.direct_to_goal import EVERY, Task, clear
from agents.planner.beyond import CROWD, Beyond, beyond
from agents.planner.budget import Budget
from agents.planner.options import Options, task_of
from agents.planner.request import Request
from agents.planner.traffic import Traffic, predicted, required
from agents.policy.inference import Policy
from envs.backend import FLOATS
from envs.kinematics import VehicleState, advance, commands
from envs.relative import distance
from envs.trees import column, mapped, scatter, take

_SHARE = 0.3  # of the computation, for a policy that finds no way back among many
# time steps for which the intruders are predicted at once; most flights take fewer
_AHEAD = 13 * EVERY


class Rollout(NamedTuple):
    """Where manoeuvres lead; fields ``[N]``, those of knots ``[N, S]``."""

    knots: (
        VehicleState  # at each waypoint's time, the first at the request, [N, S]; nan after the end
    )
    # where the way back is clear, or the goal within the radius; nan where neither was in time
    end: VehicleState
    time: Any  # when that is, s; nan where it was not
    direct: Any  # whether the goal still lies ahead, on the direct way, bool
    path: Any  # length flown until the end, m
    turn_sign: Any  # of the last turn: 1 left, -1 right, 0 none
    reversals: Any  # how often the turn changed side


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
    required_range = required(traffic, request.own, options.requirement) + options.slack
    crowd = traffic.mask.shape[-1] > CROWD
    if floats:
        given = (
            take((request.own, traffic, (goal_x, goal_y), required_range), row) for row in rows
        )
        rests = [
            beyond(take(request, rows[[row]]), goal[[row]], options) if crowd else None
            for row in rows
        ]
        each = [
            _roll_one(*one, policy, options, budget or Budget(), rest)
            for one, rest in zip(given, rests, strict=True)
        ]
        return mapped(lambda *fields: np.concatenate(fields), *each)
    task, limits, dt, spacing = (
        task_of(options),
        options.manoeuvre,
        options.aircraft.dt,
        options.spacing,
    )
    rest = beyond(request, goal, options) if crowd else None
    steps = int(task.until / dt + 1e-9)
    result = _empty(count, steps // spacing + 1)
    state = VehicleState(*(np.array(field, dtype=float) for field in request.own))
    path, turn_sign, reversals = np.zeros(count), np.zeros(count), np.zeros(count)
    chosen = np.zeros((count, min(policy.most, traffic.mask.shape[-1])), dtype=int)
    for step in range(steps + 1):
        time = step * dt
        if step % spacing == 0:
            scatter(result.knots, (rows, step // spacing), state)
        seen = predicted(traffic, time)
        arrived = distance(goal_x - state.x, goal_y - state.y, np) <= task.radius
        ended = arrived
        if options.direct and step % EVERY == 0:
            to = goal_x, goal_y
            clear_of_all = _all_clear(state, to, seen, traffic.mask, required_range, time, task)
            if rest is not None:
                some = np.flatnonzero(clear_of_all)
                least = np.where(traffic.mask, required_range, -np.inf)
                clear_of_all[some] = rest.clear(
                    *take((state, to, least), some), rows[some], np.full(some.size, time), task
                )
            ended = ended | clear_of_all
        if ended.any():
            landed = take(
                (state, np.full(rows.size, time), ~arrived, path, turn_sign, reversals), ended
            )
            scatter(result[1:], rows[ended], landed)
            (
                rows,
                goal_x,
                goal_y,
                traffic,
                seen,
                required_range,
                state,
                path,
                turn_sign,
                reversals,
                chosen,
            ) = take(
                (
                    rows,
                    goal_x,
                    goal_y,
                    traffic,
                    seen,
                    required_range,
                    state,
                    path,
                    turn_sign,
                    reversals,
                    chosen,
                ),
                ~ended,
            )
        if rows.size == 0 or step == steps:
            break
        looked_at = seen, traffic.mask
        if traffic.mask.shape[-1] > policy.most:
            if step % EVERY == 0:
                chosen = policy.most_critical(state, seen, traffic.mask)
            looked_at = mapped(
                lambda field, at=chosen: np.take_along_axis(field, at, axis=-1), looked_at
            )
        action = policy.command(state, *looked_at, goal_x, goal_y)
        acceleration, yaw_rate = commands((action[:, 0], action[:, 1]), limits, np)
        moved = advance(state, acceleration, yaw_rate, dt, limits, np)
        path += 0.5 * dt * (state.speed + moved.speed)
        turning = np.where(
            np.abs(yaw_rate) >= 0.1 * limits.yaw_rate_max, np.sign(yaw_rate), turn_sign
        )
        reversals += turning * turn_sign < 0.0
        turn_sign, state = turning, moved
    return result


def _roll_one(
    own: VehicleState,
    traffic: Traffic,
    goal: Any,
    required_range: Any,
    policy: Policy,
    options: Options,
    budget: Budget,
    rest: Beyond | None,
) -> Rollout:
    """Roll one request in plain floats, against intruders ``[K]``; fields ``[1]`` and ``[1,
    S]``.
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
    flown, knots = list[list[VehicleState]](), list[VehicleState]()
    far, every = required_range.tolist(), predicted(traffic, np.zeros((1, 1)))
    state, (goal_x, goal_y) = VehicleState(*map(float, own)), map(float, goal)
    many, present = len(far) > policy.most, np.ones(len(far), dtype=bool)
    share = 1.0 if rest is None else _SHARE
    path, turn_sign, reversals = 0.0, 0.0, 0
    square, threshold = task.radius * task.radius, 0.1 * limits.yaw_rate_max
    for step in range(steps + 1):
        if step % _AHEAD == 0:
            every = predicted(traffic, np.arange(step, step + _AHEAD)[:, None] * dt)
        if step % EVERY == 0:
            first = step % _AHEAD
            ahead = take(every, slice(first, first + EVERY))
            if many:
                chosen = policy.most_critical(state, take(ahead, 0), present)
                ahead, far = take(ahead, (slice(None), chosen)), required_range[chosen].tolist()
            flown = _in_floats(ahead)
        seen = flown[step % EVERY]
        if step % spacing == 0:
            knots.append(state)
        dx, dy = goal_x - state.x, goal_y - state.y
        arrived = dx * dx + dy * dy <= square
        # Without intruders nothing is in the way, but the goal may be inside the turning circle.
        if arrived or (
            options.direct
            and step % EVERY == 0
            and all(
                clear(state, (goal_x, goal_y), other, least, step * dt, task, FLOATS)
                for other, least in zip(seen or [state], far or [-math.inf], strict=True)
            )
            and (
                not many
                or _clear_of_others(
                    state,
                    (goal_x, goal_y),
                    take(every, step % _AHEAD),
                    required_range,
                    step * dt,
                    task,
                    rest,
                )
            )
        ):
            scatter(result[1:], 0, (state, step * dt, not arrived, path, turn_sign, reversals))
            break
        if step == steps or (step % EVERY == 0 and budget.ends("policy", share)):
            break
        action = policy.command_one(state, seen, goal_x, goal_y)
        acceleration, yaw_rate = commands(action, limits, FLOATS)
        moved = advance(state, acceleration, yaw_rate, dt, limits, FLOATS)
        path += 0.5 * dt * (state.speed + moved.speed)
        if abs(yaw_rate) >= threshold:
            reversals += yaw_rate * turn_sign < 0.0
            turn_sign = 1.0 if yaw_rate > 0.0 else -1.0
        state = moved
    scatter(result.knots, (0, slice(len(knots))), VehicleState(*zip(*knots, strict=True)))
    return result


def _clear_of_others(
    state: VehicleState,
    goal: tuple[float, float],
    others: VehicleState,
    required_range: Any,
    time: float,
    task: Task,
    rest: Beyond | None,
) -> bool:
    """Return whether the direct way is clear of many intruders ``[K]``, and the route beyond it."""
    if not np.all(clear(state, goal, others, required_range, time, task, np)):
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


def _all_clear(
    state: VehicleState,
    goal: tuple[Any, Any],
    seen: VehicleState,
    mask: Any,
    required_range: Any,
    time: float,
    task: Task,
) -> Any:
    """Return whether the direct way is clear of all intruders, ``[N]``."""
    if mask.shape[-1] == 0:
        return clear(state, goal, state, -np.inf, time, task, np)
    required_range = np.where(mask, required_range, -np.inf)
    return np.all(clear(*column((state, goal)), seen, required_range, time, task, np), axis=-1)


def _empty(count: int, points: int) -> Rollout:
    knots, end = (
        VehicleState(*np.full((4, count, points), np.nan)),
        VehicleState(*np.full((4, count), np.nan)),
    )
    time, path, turn_sign, reversals = np.full((4, count), np.nan)
    return Rollout(knots, end, time, np.zeros(count, dtype=bool), path, turn_sign, reversals)
