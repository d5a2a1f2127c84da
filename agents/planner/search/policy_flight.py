"""The policy flown ahead for one request, in plain floats and loops: what is compiled
(:mod:`envs.compiled`).

Without numba :mod:`agents.planner.search.rollout` does the same, with lists and some numpy.
"""

import math
from typing import NamedTuple

import numpy as np

from agents.kernel.traffic import predict_one
from agents.manoeuvres.direct_to_goal import EVERY, DirectTask, direct, keeps_clear
from agents.planner.request.options import Narrowed, Options, plain_task
from agents.planner.search.continuation import (
    ScalarContinuation,
    continuation_clear,
    no_continuation,
)
from agents.policy import decision
from agents.policy.decision import Decider, decide
from agents.policy.inference import Policy
from envs.arrays import Array, Float
from envs.backend import FLOATS
from envs.compiled import Entry, scalar
from envs.frames import Air
from envs.kinematics import Limits, VehicleState, advance, commands
from envs.observation import criticality_of
from envs.relative import at_distance_scale
from envs.wind import aim_point

TURNS = 0.1
"""Of the greatest turn rate, from which on a flight counts as turning."""

AT_ONCE = 4 * EVERY
"""Time steps flown at once: less than a millisecond."""

UNDER_WAY, ARRIVED, DIRECT, OUT_OF_TIME, NOT_FINITE = range(5)
"""How a flight stands: it goes on; it is within the goal's radius; the direct route to the goal is
clear; there is no time left; the policy gave no number.
"""


class Intruders(NamedTuple):
    """The intruders of one request that exist; arrays ``[K]``."""

    state: VehicleState[Air]  # at the request
    turn_rate: Array  # rad/s
    turn_time: Array  # s
    required: Array  # distance, m
    distance_scale: Array  # at which the policy counts their distances; 1: whole
    begin: Array  # of the windows in which they count, s; empty: all count always
    end: Array


class Target(NamedTuple):
    """The goal of one request."""

    x: float  # at the request, m
    y: float
    east: float  # its drift, m/s
    north: float
    drifts: bool


class Course(NamedTuple):
    """How the policy is flown; plain numbers."""

    task: DirectTask
    dt: float  # s
    steps: int  # at which the time is over
    spacing: int  # steps between plan states
    direct: bool  # whether the direct route is taken where it is clear
    most: int  # intruders that the policy looks at
    separation: float  # m
    time_unit: float  # s
    crowd: bool  # whether the route beyond the goal must be clear too


class Flight(NamedTuple):
    """How far flights have come; fields ``[M]``, or plain numbers."""

    state: VehicleState[Air]
    path: Array  # length flown, m
    turn_sign: Array  # of the last turn: 1 left, -1 right, 0 none
    reversals: Array  # how often the turn changed side


def begin(own: VehicleState[Air]) -> Flight:
    """Return the flight at the request."""
    state: VehicleState[Air] = VehicleState(*map(float, own))
    return Flight(state, 0.0, 0.0, 0.0)


def course(options: Options[Narrowed], policy: Policy, *, crowd: bool) -> Course:
    """Return how a policy is flown, alone or in a crowd."""
    task, aircraft = plain_task(options), options.aircraft
    return Course(
        task=task,
        dt=float(aircraft.dt),
        steps=int(task.until / aircraft.dt + 1e-9),
        spacing=int(options.spacing),
        direct=bool(options.direct),
        most=int(policy.most),
        separation=float(policy.aircraft.separation),
        time_unit=float(policy.aircraft.time_unit),
        crowd=crowd,
    )


@scalar
def fly(
    flight: Flight,
    steps: tuple[int, int],
    intruders: Intruders,
    target: Target,
    continuation: ScalarContinuation,
    course: Course,
    decider: Decider,
    plan_states: Float[Array, "4 S"],
) -> tuple[int, int, Flight]:
    """Fly from one time step, a multiple of :data:`EVERY`, to another at most.

    Args:
        flight: at the first step.
        steps: number of the first step, and of that before which to stop.
        intruders: of the request.
        target: that is flown to.
        continuation: the route beyond it.
        course: how the policy is flown.
        decider: the policy.
        plan_states: where states are written at each waypoint's time.

    Returns:
        How the flight stands then, at which step, and how far it has come.
    """
    state, path, turn_sign, reversals = flight
    task, limits, dt = course.task, course.task.limits, course.dt
    looked_at = np.empty(0, np.int64)
    for step in range(steps[0], steps[1]):
        time, asks = step * dt, step % EVERY == 0
        if asks:
            looked_at = _look(state, time, intruders, course)
        if step % course.spacing == 0:
            _write(plan_states, step // course.spacing, state)
        place = target.x + target.east * time, target.y + target.north * time
        aim = place
        if target.drifts:
            drift = target.east, target.north
            aim = aim_point(state, place, drift, task.until - time, FLOATS)
        dx, dy = place[0] - state.x, place[1] - state.y
        if dx * dx + dy * dy <= task.radius * task.radius:
            return ARRIVED, step, Flight(state, path, turn_sign, reversals)
        if asks and course.direct and _way_clear(state, aim, time, intruders, continuation, course):
            return DIRECT, step, Flight(state, path, turn_sign, reversals)
        if step == course.steps:
            return OUT_OF_TIME, step, Flight(state, path, turn_sign, reversals)
        others, distance_scale = _states_of(looked_at, time, intruders)
        throttle, steering = decide(state, others, distance_scale, aim[0], aim[1], decider)
        if not (math.isfinite(throttle) and math.isfinite(steering)):
            return NOT_FINITE, step, Flight(state, path, turn_sign, reversals)
        acceleration, yaw_rate = commands((throttle, steering), limits, FLOATS)
        moved = advance(state, acceleration, yaw_rate, dt, limits, FLOATS)
        path += 0.5 * dt * (state.speed + moved.speed)
        if abs(yaw_rate) >= TURNS * limits.yaw_rate_max:
            if yaw_rate * turn_sign < 0.0:
                reversals += 1.0
            turn_sign = 1.0 if yaw_rate > 0.0 else -1.0
        state = moved
    return UNDER_WAY, steps[1], Flight(state, path, turn_sign, reversals)


@scalar
def _write(plan_states: Array, number: int, state: VehicleState[Air]) -> None:
    for field in range(4):
        plan_states[field, number] = state[field]


@scalar
def _predicted(k: int, time: float, intruders: Intruders) -> VehicleState[Air]:
    """Return an intruder some seconds after the request."""
    state = intruders.state
    reported: VehicleState[Air] = VehicleState(
        state.x[k], state.y[k], state.heading[k], state.speed[k]
    )
    return predict_one(reported, intruders.turn_rate[k], intruders.turn_time[k], time)


@scalar
def _look(own: VehicleState[Air], time: float, intruders: Intruders, course: Course) -> Array:
    """Return the numbers of the intruders that the policy looks at: the most urgent of those that
    count at a time.
    """
    count = len(intruders.required)
    rank, present = np.empty(count), 0
    for k in range(count):
        rank[k] = math.inf
        if len(intruders.begin) == 0 or intruders.begin[k] <= time <= intruders.end[k]:
            present += 1
            other = at_distance_scale(
                own, _predicted(k, time, intruders), intruders.distance_scale[k]
            )
            rank[k] = criticality_of(own, other, course.separation, course.time_unit, FLOATS)
    if count <= course.most:  # in their own order
        return np.nonzero(rank < math.inf)[0]
    return np.argsort(rank, kind="mergesort")[: min(present, course.most)]


@scalar
def _states_of(
    looked_at: Array, time: float, intruders: Intruders
) -> tuple[VehicleState[Air], Array]:
    """Return the intruders that are looked at as they are at a time, and their distance
    scales.
    """
    count = len(looked_at)
    x, y, heading, speed, distance_scale = np.empty((5, count))
    for i in range(count):
        other = _predicted(looked_at[i], time, intruders)
        x[i], y[i], heading[i], speed[i] = other.x, other.y, other.heading, other.speed
        distance_scale[i] = intruders.distance_scale[looked_at[i]]
    return VehicleState(x, y, heading, speed), distance_scale


@scalar
def _way_clear(
    own: VehicleState[Air],
    aim: tuple[float, float],
    time: float,
    intruders: Intruders,
    continuation: ScalarContinuation,
    course: Course,
) -> bool:
    """Return whether the direct route is clear of all intruders, and among many the route beyond
    it.
    """
    task = course.task
    way = direct(own, aim, time, task, FLOATS)
    if not way.possible:  # without intruders, too, the goal may be inside the turning circle
        return False
    for k in range(len(intruders.required)):
        other, required = _predicted(k, time, intruders), intruders.required[k]
        if len(intruders.begin) > 0:
            window = intruders.begin[k], intruders.end[k]
            clear = keeps_clear(own, way, other, required, time, task, FLOATS, window)
        else:
            clear = keeps_clear(own, way, other, required, time, task, FLOATS, None)
        if not clear:
            return False
    if not course.crowd:
        return True
    return continuation_clear(own, aim, intruders.required, time, continuation, task)


def _examples() -> list[tuple[object, ...]]:
    zero = np.zeros(1)
    own: VehicleState[Air] = VehicleState(0.0, 0.0, 0.0, 1.0)
    state: VehicleState[Air] = VehicleState(zero, zero, zero, zero)
    limits = Limits(1.0, 2.0, -1.0, 1.0, 1.0)
    course = Course(DirectTask(limits, 1.0, 1.0, 1.0), 1.0, 1, 1, True, 1, 1.0, 1.0, False)
    return [
        (
            Flight(own, 0.0, 0.0, 0.0),
            (0, 1),
            Intruders(state, zero, zero, zero, zero, zero, zero),
            Target(0.0, 0.0, 0.0, 0.0, False),
            no_continuation(),
            course,
            decision.example(),
            np.zeros((4, 1)),
        )
    ]


FLY = Entry(fly, _examples)
"""Compiled :func:`fly`."""
