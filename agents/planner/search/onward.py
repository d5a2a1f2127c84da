"""The legs of a plan after its manoeuvre: a turn onto a point and a straight line to it, in closed
form. Each function is over arrays or plain floats alike.
"""

import math
from typing import NamedTuple

import numpy as np

from agents.manoeuvres.direct_to_goal import (
    DirectTask,
    end_speed,
    scalar_arc_end,
    turn_exactly_onto,
)
from envs.arrays import Array, ArrayModule, Float
from envs.backend import FLOATS
from envs.compiled import scalar
from envs.frames import Air
from envs.kinematics import VehicleState

_SECANTS = 12  # of the search for when a drifting point is met
_SAME_PLACE = 1e-6  # m by which it may be missed


class Onward(NamedTuple):
    """What the next legs are made of; fields ``[L]``."""

    place: tuple[Array, Array]  # of the points at their ends, at the request, m
    begin: VehicleState[Air]
    began: Array  # s
    # which lead to the goal, where there may be a need to accelerate, bool
    direct: Array


class Leg(NamedTuple):
    """Legs: a turn at the task's rate, then straight on; fields ``[L]``."""

    x: Array  # of the points at their ends, m
    y: Array
    begin: VehicleState[Air]
    began: Array  # s
    arc: Array  # of the turn, rad, positive to the left
    length: Array  # of the straight part, m
    course: Array  # of the straight part, rad
    reached: Array  # whether the point can be reached so; else it is passed by, bool
    turned: Array  # time at which the straight part begins, s
    disc: Array  # how far before the point on the straight part its disc begins, m
    # at the end, m/s; it differs from that at the beginning on the way to the goal only
    speed: Array
    in_time: Array  # whether the goal can be reached in time, bool; true of all other points


@scalar
def leg_to(
    onward: Onward,
    drift: tuple[Array, Array] | None,
    when: Float[Array, "..."],
    task: DirectTask,
    xp: ArrayModule,
) -> Leg:
    """Return the legs to where the points are at some times, s, that drift, m/s; None: they stand
    still.
    """
    begin, began = onward.begin, onward.began
    x, y = onward.place
    disc = 0.0 * began + task.radius
    if drift is not None:
        x, y = x + drift[0] * when, y + drift[1] * when
    turn = turn_exactly_onto(begin, (x, y), begin.speed / task.turn_rate, xp)
    if drift is not None:
        disc = _disc(begin.speed, turn.course, drift, task.radius)
    arc = xp.where(turn.possible, turn.side * turn.angle, 0.0)
    turned = began + np.abs(arc) / task.turn_rate
    disc = xp.where(onward.direct, disc, turn.length)
    straight = xp.maximum(turn.length - disc, 0.0)
    speed, in_time = end_speed(straight, begin.speed, task.until - turned, task.limits, xp)
    return Leg(
        x,
        y,
        begin,
        began,
        arc,
        turn.length,
        turn.course,
        turn.possible,
        turned,
        disc,
        xp.where(onward.direct, speed, begin.speed),
        xp.logical_or(in_time, xp.logical_not(onward.direct)),
    )


@scalar
def _disc(speed: Array, course: Array, drift: tuple[Array, Array], radius: float) -> Array:
    """Return how far an aircraft flies through the air from the edge of a drifting point's disc to
    the point, m.
    """
    closing = np.hypot(speed * np.cos(course) - drift[0], speed * np.sin(course) - drift[1])
    return speed * radius / np.maximum(closing, 1e-3)


def legs_to_meet(
    onward: Onward, drift: tuple[Float[Array, " L"], Float[Array, " L"]], task: DirectTask
) -> Leg:
    """Return the legs ``[L]`` that end where drifting points are when they end: by secants on the
    time of that.

    A point that is not met so is not reached.
    """
    strength, time = np.hypot(*drift), onward.began
    before, legs = time, leg_to(onward, drift, time, task, np)
    late_before = end_of(legs, task) - before
    when = before + late_before
    for _ in range(_SECANTS):
        legs = leg_to(onward, drift, when, task, np)
        late = end_of(legs, task) - when
        # Legs that are found stay as they are, however many others are still searched.
        going_on = np.abs(late) * strength > _SAME_PLACE
        if not going_on.any():
            break
        slope = (late - late_before) / np.where(when == before, 1.0, when - before)
        # A slope that is not negative belongs to another turn or to a point that gets away.
        step = late / np.where(slope < -0.1, -slope, 1.0)
        before, late_before = when, late
        when = np.where(going_on, np.maximum(when + step, time), when)
    met = np.abs(end_of(legs, task) - when) * strength <= _SAME_PLACE
    return legs._replace(reached=legs.reached & met)


@scalar
def scalar_leg_to_meet(
    onward: Onward, drift: tuple[float, float], task: DirectTask
) -> tuple[Leg, bool]:
    """Return the leg of :func:`legs_to_meet` in plain floats, and whether the point is met."""
    strength, time = math.hypot(drift[0], drift[1]), onward.began
    before, leg = time, leg_to(onward, drift, time, task, FLOATS)
    late_before = end_of(leg, task) - before
    when = before + late_before
    for _ in range(_SECANTS):
        leg = leg_to(onward, drift, when, task, FLOATS)
        late = end_of(leg, task) - when
        if not abs(late) * strength > _SAME_PLACE:
            break
        slope = (late - late_before) / (1.0 if when == before else when - before)
        step = late / (-slope if slope < -0.1 else 1.0)
        before, late_before = when, late
        when = max(when + step, time)
    return leg, leg.reached and abs(end_of(leg, task) - when) * strength <= _SAME_PLACE


@scalar
def end_of(leg: Leg, task: DirectTask) -> Float[Array, " L"]:
    """Return when legs end, s."""
    return leg.turned + duration(leg.length, leg.begin.speed, leg.speed, task)


@scalar
def duration(
    length: Float[Array, "..."],
    speed: Float[Array, "..."],
    final: Float[Array, "..."],
    task: DirectTask,
) -> Float[Array, "..."]:
    """Return the time for a length, s: accelerating from a speed to another, then holding that."""
    rise = (final - speed) / task.limits.acceleration_max
    return rise + (length - 0.5 * (speed + final) * rise) / final


@scalar
def after_turn(leg: Leg, task: DirectTask) -> VehicleState[Air]:
    """Return the state of one leg, in plain floats, at the end of its turn."""
    length = leg.begin.speed * abs(leg.arc) / task.turn_rate
    x, y = scalar_arc_end(leg.begin, leg.arc, length)
    return VehicleState(x, y, leg.begin.heading + leg.arc, leg.begin.speed)
