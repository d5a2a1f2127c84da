"""A family of escapes: turn, fly straight until the way to the goal is clear, turn onto the goal.

By Pontryagin's principle the control that maximises the distance at a closest approach turns at
full rate onto one course and holds it, at extremal acceleration with at most one switch. A second
turn at the switch serves delayed starts, manoeuvring intruders and several of them.
"""

from typing import NamedTuple

import numpy as np

from agents.manoeuvres.direct_to_goal import arc_end
from envs.arrays import Array, ArrayModule
from envs.compiled import scalar
from envs.encounters import Encounter
from envs.frames import Air
from envs.intruder import start, step
from envs.kinematics import Limits, VehicleState, advance, commands, velocity
from envs.outcome import Rules
from envs.relative import bearing, distance, leg_separation
from envs.trees import column, take

REGARDLESS = -1e9
"""Slack, m, with which the way to the goal always counts as clear."""


class Manoeuvre(NamedTuple):
    """Parameters of one escape; fields ``[...]``, float64."""

    turn: Array  # heading change at full rate from the start, rad, positive to the left
    throttle: Array  # acceleration at first, in [-1, 1] of the limits
    # time, s, at which the second turn is added to what is left of the first, and the throttle
    # changes
    switch: Array
    turn_after: Array  # second turn, rad
    throttle_after: Array  # acceleration from the switch on, in [-1, 1]
    resume: Array  # earliest time at which the aircraft turns onto the goal, s
    # what the way to the goal keeps beyond the separation, m, from the traffic's straight courses
    slack: Array
    # acceleration on the way to the goal, in [-1, 1]; full wherever time gets short
    throttle_home: Array


class Flight(NamedTuple):
    """An escape in progress; fields ``[...]``."""

    own: VehicleState[Air]
    to_turn: Array  # what is left of the turn, rad
    switched: Array  # whether the second part has begun, bool
    returning: Array  # whether the aircraft is on the way to the goal, bool


class Counting(NamedTuple):
    """How intruders count; fields ``[..., K]``."""

    mask: Array  # which of them exist, bool
    # of the distance to each: the rules' separation over its own; None: 1 of all
    distance_scale: Array


def steps(rules: Rules) -> int:
    """Return the number of steps after which an encounter times out."""
    return int(np.ceil(rules.t_max / rules.dt - 0.5))


def tracks(encounter: Encounter, count: int, rules: Rules) -> VehicleState[Air]:
    """Fly the intruders alone (they react to nothing); return their states about the steps,
    ``[count + 1, ..., K]``.
    """
    flown = start(encounter.intruders, np)
    states = [flown.vehicle]
    for index in range(count):
        flown = step(flown, encounter.intent, index * rules.dt, rules.dt, np)
        states.append(flown.vehicle)
    return VehicleState(*(np.stack(field) for field in zip(*states, strict=True)))


def count_in(encounter: Encounter, rules: Rules) -> Counting:
    """Return how the intruders of encounters ``[N]`` count."""
    own = encounter.separation
    return Counting(encounter.mask, None if own is None else rules.separation / own)


def takeoff(own: VehicleState[Air], manoeuvre: Manoeuvre) -> Flight:
    """Return the escapes at their beginning, ``[M]``."""
    never = np.zeros(np.shape(own.x), dtype=bool)
    return Flight(own, manoeuvre.turn, never, never)


def choose_action(
    flight: Flight,
    manoeuvre: Manoeuvre,
    time: float,
    goal: tuple[Array, Array],
    traffic: VehicleState[Air],
    counting: Counting,
    rules: Rules,
    limits: Limits,
) -> tuple[tuple[Array, Array], Flight]:
    """Return the action of one step of the escapes, ``[M]`` twice in [-1, 1], and the escapes after
    it, not yet moved.

    The time is that of the step's beginning, s; the goal's position ``[M]`` twice, m; traffic and
    counting ``[M, K]``.
    """
    own = flight.own
    returning = flight.returning.copy()
    asking = np.flatnonzero(~returning & (time >= manoeuvre.resume))
    if asking.size:
        states, to, slack = take((own, goal, manoeuvre.slack), asking)
        others, how = take((traffic, counting), asking)
        returning[asking] = _way_back_clear(states, to, others, how, slack, rules, limits)
    full_turn = limits.yaw_rate_max * rules.dt
    away = steer_away(flight, manoeuvre, time, full_turn, np)
    goal_turn, goal_throttle = _to_goal(own, goal, time, manoeuvre.throttle_home, rules, limits)
    turn = np.where(returning, goal_turn, away.turn)
    throttle = np.where(returning, goal_throttle, away.throttle)
    after = Flight(own, away.to_turn - away.turn, away.switched, returning)
    return (throttle, turn / full_turn), after


def fly(
    flight: Flight,
    manoeuvre: Manoeuvre,
    time: float,
    goal: tuple[Array, Array],
    traffic: VehicleState[Air],
    counting: Counting,
    rules: Rules,
    limits: Limits,
) -> Flight:
    """Fly one step of the escapes; arguments as of :func:`choose_action`."""
    action, after = choose_action(flight, manoeuvre, time, goal, traffic, counting, rules, limits)
    return after._replace(
        own=advance(flight.own, *commands(action, limits, np), rules.dt, limits, np)
    )


class EscapeStep(NamedTuple):
    """What one step of escapes brought; fields ``[M]``."""

    flight: Flight  # after it
    separation: Array
    """Smallest distance to any intruder during it, m; inf without intruders. The distance to an
    intruder with a separation of its own is scaled by the rules' separation over that."""
    to_goal: Array  # distance to the goal after it, m


def fly_step(
    flight: Flight,
    manoeuvre: Manoeuvre,
    time: float,
    goal: tuple[Array, Array],
    traffic: tuple[VehicleState[Air], VehicleState[Air]],
    counting: Counting,
    rules: Rules,
    limits: Limits,
) -> EscapeStep:
    """Fly one step of the escapes and measure it; traffic before and after it, ``[M, K]`` each, the
    other arguments as of :func:`choose_action`.
    """
    before, after = traffic
    moved = fly(flight, manoeuvre, time, goal, before, counting, rules, limits)
    apart = leg_separation(column(flight.own), column(moved.own), before, after, rules.dt, np)
    apart = apart if counting.distance_scale is None else apart * counting.distance_scale
    separation = np.min(np.where(counting.mask, apart, np.inf), axis=-1)
    to_goal = distance(goal[0] - moved.own.x, goal[1] - moved.own.y, np)
    return EscapeStep(moved, separation, to_goal)


class Away(NamedTuple):
    """Commands of one step away from the route; fields ``[M]``."""

    turn: Array  # of the step, rad
    throttle: Array  # in [-1, 1]
    to_turn: Array  # what is left of the turn before the step, rad
    switched: Array  # whether the second part has begun, bool


@scalar
def steer_away(
    flight: Flight, manoeuvre: Manoeuvre, time: float, full_turn: Array, xp: ArrayModule
) -> Away:
    """Return the commands of the step away that begins at a time, s, and turns by ``full_turn``,
    rad, at most.
    """
    switched = time >= manoeuvre.switch
    switches = xp.logical_and(switched, xp.logical_not(flight.switched))
    to_turn = flight.to_turn + xp.where(switches, manoeuvre.turn_after, 0.0)
    throttle = xp.where(switched, manoeuvre.throttle_after, manoeuvre.throttle)
    return Away(xp.clip(to_turn, -full_turn, full_turn), throttle, to_turn, switched)


def _to_goal(
    own: VehicleState[Air],
    goal: tuple[Array, Array],
    time: float,
    throttle: Array,
    rules: Rules,
    limits: Limits,
) -> tuple[Array, Array]:
    """Return the turn (rad) and the throttle of a step on the way to the goal, ``[M]`` each."""
    to_goal = bearing(own, *goal, np)
    far = distance(goal[0] - own.x, goal[1] - own.y, np)
    full_turn = limits.yaw_rate_max * rules.dt
    # A goal inside the turning circle cannot be turned onto: fly straight until the circle has left
    # it behind.
    radius = own.speed / limits.yaw_rate_max
    from_centre = distance(far * np.cos(to_goal), np.abs(far * np.sin(to_goal)) - radius, np)
    turn = np.where(
        from_centre < radius - 0.5 * rules.goal_radius, 0.0, np.clip(to_goal, -full_turn, full_turn)
    )
    time_left = rules.t_max - time - np.abs(to_goal) / limits.yaw_rate_max
    late = far > 0.9 * own.speed * np.maximum(time_left, rules.dt)
    return turn, np.where(late, 1.0, throttle)


def _way_back_clear(
    own: VehicleState[Air],
    goal: tuple[Array, Array],
    traffic: VehicleState[Air],
    counting: Counting,
    slack: Array,
    rules: Rules,
    limits: Limits,
) -> Array:
    """Return whether the traffic's straight courses are clear half-way through the turn onto the
    goal and after it.
    """
    to_goal = bearing(own, *goal, np)
    turning = np.abs(to_goal) / limits.yaw_rate_max
    traffic_vx, traffic_vy = velocity(traffic, np)
    required = (rules.separation + slack)[:, None]
    required = required if counting.distance_scale is None else required / counting.distance_scale

    half_x, half_y = arc_end(own, 0.5 * to_goal, own.speed * 0.5 * turning)
    seconds = 0.5 * turning[:, None]
    rx, ry = (
        traffic.x + traffic_vx * seconds - half_x[:, None],
        traffic.y + traffic_vy * seconds - half_y[:, None],
    )
    half_way_clear = distance(rx, ry, np) >= required

    x, y = arc_end(own, to_goal, own.speed * turning)
    rx, ry = rx + traffic_vx * seconds, ry + traffic_vy * seconds
    rx, ry = rx + (half_x - x)[:, None], ry + (half_y - y)[:, None]
    course = own.heading + to_goal
    vx, vy = (
        traffic_vx - (own.speed * np.cos(course))[:, None],
        traffic_vy - (own.speed * np.sin(course))[:, None],
    )
    # The encounter ends at the goal: what would come closer only beyond it does not count.
    flight = np.maximum(distance(goal[0] - x, goal[1] - y, np) - rules.goal_radius, 0.0) / own.speed
    closest = np.clip(
        -(rx * vx + ry * vy) / np.maximum(vx * vx + vy * vy, 1e-9), 0.0, flight[:, None]
    )
    after_clear = distance(rx + vx * closest, ry + vy * closest, np) >= required
    return np.all((half_way_clear & after_clear) | ~counting.mask, axis=-1)
