"""The policy flown ahead in the surrogate: from the request until the way back to the route is clear, or it is back.

The same functions of the core twice: over plain floats for one request, where arrays of one element would cost ten
times their arithmetic, and over arrays for many. Intruders fly as predicted (:mod:`agents.planner.traffic`); the policy
sees the most critical of them, once a second. Every few seconds the direct way to the goal is looked at; once it is
clear, the policy has done its work (:mod:`agents.manoeuvres.direct_to_goal`).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from agents.manoeuvres.direct_to_goal import EVERY, Task, clear
from agents.planner.traffic import Traffic, predicted
from agents.policy.inference import Policy
from envs.aircraft import PAPER
from envs.angles import sincos, wrap
from envs.backend import FLOATS
from envs.kinematics import VehicleState, advance, commands
from envs.observation import criticality, most_critical, observe
from envs.relative import distance
from envs.trees import take

__all__ = ["SPACING", "STEP", "Rollout", "roll"]

STEP = 1.0
"""Between decisions, s."""

SPACING = 20
"""Steps between waypoints."""

_BEHIND = 20_000.0  # m


class Rollout(NamedTuple):
    """Where manoeuvres lead; fields ``[N]``, those of knots ``[N, S]``."""

    knots: VehicleState
    """Every 20 s, the first at the request, ``[N, S]``; nan after the end."""
    end: VehicleState
    """State at which the way back is clear, or the goal within the radius; nan where neither happened in time."""
    time: Any
    """When that is, s; nan where it was not."""
    direct: Any
    """Whether the goal still lies ahead, on the direct way, bool."""
    path: Any
    """Length flown until the end, m."""
    turn_sign: Any
    """Of the last turn: 1 left, -1 right, 0 none."""
    reversals: Any
    """How often the turn changed side."""


def roll(
    own: VehicleState,
    traffic: Traffic,
    goal: tuple[Any, Any],
    required: Any,
    policy: Policy,
    task: Task,
    *,
    floats: bool = False,
) -> Rollout:
    """Roll the policy ahead.

    Args:
        own: ``[N]``.
        traffic: ``[N, K]``.
        goal: its position, m, ``[N]`` each.
        required: separation from the intruders on the direct way, m, ``[N, K]``.
        policy: decides.
        task: limits and end.
        floats: roll a single request (N = 1) in plain floats.
    """
    if floats:
        start = VehicleState(*(float(field[0]) for field in own))
        return _roll_one(start, traffic, (float(goal[0][0]), float(goal[1][0])), required, policy, task)
    limits = task.limits
    count = np.size(own.x)
    steps = int(task.until / STEP)
    result = _empty(count, steps)
    state = VehicleState(*(np.array(field, dtype=float) for field in own))
    rows, goal_x, goal_y = np.arange(count), np.asarray(goal[0], float), np.asarray(goal[1], float)
    path, turn_sign, reversals = np.zeros(count), np.zeros(count), np.zeros(count)
    lonely = not traffic.mask.any(axis=-1).all()
    for step in range(steps + 1):
        if step % SPACING == 0:
            for field, value in zip(result.knots, state, strict=True):
                field[rows, step // SPACING] = value
        seen = predicted(traffic, step * STEP)
        arrived = distance(goal_x - state.x, goal_y - state.y, np) <= task.radius
        ended = arrived
        if task.direct and step % EVERY == 0:
            ended = ended | _all_clear(state, (goal_x, goal_y), seen, traffic.mask, required, step * STEP, task)
        if ended.any():
            done = rows[ended]
            for field, value in zip(result.end, state, strict=True):
                field[done] = value[ended]
            result.time[done], result.direct[done] = step * STEP, ~arrived[ended]
            for field, value in zip(result[4:], (path, turn_sign, reversals), strict=True):
                field[done] = value[ended]
            rows, goal_x, goal_y, traffic, seen, required, state, path, turn_sign, reversals = take(
                (rows, goal_x, goal_y, traffic, seen, required, state, path, turn_sign, reversals), ~ended
            )
        if rows.size == 0 or step == steps:
            break
        if lonely:
            seen = _or_absent(seen, traffic.mask, state)
        chosen = most_critical(state, seen, traffic.mask, PAPER, np)
        action = policy.rowwise(observe(state, chosen, goal_x, goal_y, PAPER, np).astype(np.float32)).astype(float)
        acceleration, yaw_rate = commands((action[:, 0], action[:, 1]), limits, np)
        moved = advance(state, acceleration, yaw_rate, STEP, limits, np)
        path += 0.5 * STEP * (state.speed + moved.speed)
        turning = np.where(np.abs(yaw_rate) >= 0.1 * limits.yaw_rate_max, np.sign(yaw_rate), turn_sign)
        reversals += turning * turn_sign < 0.0
        turn_sign, state = turning, moved
    return result


def _roll_one(
    own: VehicleState, traffic: Traffic, goal: tuple[float, float], required: Any, policy: Policy, task: Task
) -> Rollout:
    """Roll one request in plain floats: its state and goal, intruders ``[1, K]``; fields ``[1]`` and ``[1, S]``."""
    limits, steps = task.limits, int(task.until / STEP)
    result = _empty(1, steps)
    present = np.flatnonzero(traffic.mask[0])
    flown = _tracks(traffic, present, steps)
    alone = flown[0] if len(flown) == 1 else None
    required = required[0, present].tolist()
    state = VehicleState(*(float(field) for field in own))
    goal_x, goal_y = goal
    path, turn_sign, reversals = 0.0, 0.0, 0
    square = task.radius * task.radius
    threshold = 0.1 * limits.yaw_rate_max
    decide = policy.decide
    knots = []
    for step in range(steps + 1):
        if step % SPACING == 0:
            knots.append(state)
        dx, dy = goal_x - state.x, goal_y - state.y
        arrived = dx * dx + dy * dy <= square
        if arrived or (
            task.direct
            and step % EVERY == 0
            and all(
                clear(state, goal, track[step], far, step * STEP, task, FLOATS)
                for track, far in zip(flown, required, strict=True)
            )
            and (flown or clear(state, goal, _absent(state, FLOATS), 0.0, step * STEP, task, FLOATS))
        ):
            for field, value in zip(result.end, state, strict=True):
                field[0] = value
            result.time[0], result.direct[0] = step * STEP, not arrived
            result.path[0], result.turn_sign[0], result.reversals[0] = path, turn_sign, reversals
            break
        if step == steps:
            break
        other = alone[step] if alone is not None else _most_critical(state, [track[step] for track in flown])
        action = decide(observe(state, other, goal_x, goal_y, PAPER, FLOATS))
        acceleration, yaw_rate = commands(action, limits, FLOATS)
        moved = advance(state, acceleration, yaw_rate, STEP, limits, FLOATS)
        path += 0.5 * STEP * (state.speed + moved.speed)
        if abs(yaw_rate) >= threshold:
            reversals += yaw_rate * turn_sign < 0.0
            turn_sign = 1.0 if yaw_rate > 0.0 else -1.0
        state = moved
    for number, field in enumerate(result.knots):
        field[0, : len(knots)] = [knot[number] for knot in knots]
    return result


def _tracks(traffic: Traffic, present: Any, steps: int) -> list[list[VehicleState]]:
    """Return the predicted states of one request's intruders by second, in plain floats."""
    one = Traffic(
        VehicleState(*(field[0, present] for field in traffic.state)), *(field[0, present] for field in traffic[1:])
    )
    seen = predicted(one, np.arange(steps + 1)[:, None] * STEP)
    each = (zip(*(field[:, k].tolist() for field in seen), strict=True) for k in range(present.size))
    return [list(map(VehicleState._make, track)) for track in each]


def _all_clear(
    state: VehicleState, goal: tuple[Any, Any], seen: VehicleState, mask: Any, required: Any, time: float, task: Task
) -> Any:
    """Return whether the direct way is clear of all intruders, ``[N]``."""
    if mask.shape[-1] == 0:
        return clear(state, goal, _absent(state, np), 0.0, time, task, np)
    own = VehicleState(*(field[:, None] for field in state))
    to = (goal[0][:, None], goal[1][:, None])
    # Without intruders nothing is in the way, but the goal may be inside the turning circle.
    required = np.where(mask, required, -np.inf)
    return np.all(clear(own, to, seen, required, time, task, np), axis=-1)


def _empty(count: int, steps: int) -> Rollout:
    knots = VehicleState(*(np.full((count, steps // SPACING + 1), np.nan) for _ in range(4)))
    end = VehicleState(*(np.full(count, np.nan) for _ in range(4)))
    time, path, turn_sign, reversals = (np.full(count, np.nan) for _ in range(4))
    return Rollout(knots, end, time, np.zeros(count, dtype=bool), path, turn_sign, reversals)


def _absent(own: VehicleState, xp: Any) -> VehicleState:
    """Return an intruder without effect: as far behind as an observation can say, flying away."""
    sine, cosine = sincos(own.heading, xp)
    away = wrap(own.heading + math.pi, xp)
    return VehicleState(own.x - _BEHIND * cosine, own.y - _BEHIND * sine, away, own.speed * 0.0 + 50.0)


def _or_absent(seen: VehicleState, mask: Any, own: VehicleState) -> VehicleState:
    """Return the intruders ``[N, K]``, those of requests without any replaced."""
    empty = ~mask.any(axis=-1, keepdims=True)
    behind = _absent(own, np)
    return VehicleState(*(np.where(empty, alone[:, None], field) for field, alone in zip(seen, behind, strict=True)))


def _most_critical(own: VehicleState, others: list[VehicleState]) -> VehicleState:
    """Return the most urgent of several intruders; one without effect if there are none."""
    if not others:
        return _absent(own, FLOATS)
    return min(others, key=lambda other: criticality(own, other, PAPER, FLOATS))
