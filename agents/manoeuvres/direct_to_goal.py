"""The direct way back: one turn onto the goal, a straight line to it, and whether that keeps clear
of the traffic.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from envs.angles import atan2, sincos, wrap
from envs.kinematics import Limits, VehicleState, velocity

EVERY = 5
"""Time steps between the moments at which a manoeuvre asks whether the way back is clear."""

_PARTS = 4  # of the turn, each judged on its chord


class DirectTask(NamedTuple):
    """What manoeuvres are flown for and with; plain numbers."""

    limits: Limits  # of the ownship
    radius: float  # of the goal, m
    until: float  # latest time at the goal, s
    turn_rate: float  # of turns on the way back, rad/s


def arc_end(state: VehicleState, arc: Any, length: Any) -> tuple[Any, Any]:
    """Return where arcs from a state end that turn by ``arc``, rad, on a length, m; numpy,
    ``[...]`` each.
    """
    # sin(x)/x by numpy is safe at 0; the chord of an arc points half-way through its turn.
    chord, middle = length * np.sinc(arc / (2.0 * math.pi)), state.heading + 0.5 * arc
    return state.x + chord * np.cos(middle), state.y + chord * np.sin(middle)


def end_speed(length: Any, speed: Any, seconds: Any, limits: Limits, xp: Any) -> tuple[Any, Any]:
    """Return the speed to cover a length (m) in some seconds, m/s, and whether that is possible,
    ``[...]``.

    The present speed where it is enough; else, accelerating at once by as much as the limits allow.
    """
    gain, left = limits.acceleration_max, xp.maximum(seconds, 0.0)
    missing = length - speed * left
    square = gain * gain * left * left - 2.0 * gain * missing
    more = gain * left - xp.sqrt(xp.maximum(square, 0.0))
    hurry = missing > 0.0
    wanted = xp.where(hurry, speed + more, speed)
    enough = xp.logical_and(square >= 0.0, wanted <= limits.speed_max)
    return wanted, xp.logical_and(seconds >= 0.0, xp.logical_or(xp.logical_not(hurry), enough))


class Direct(NamedTuple):
    """One turn onto the goal and the straight line to its disc; fields ``[...]``."""

    side: Any  # of the turn, 1 left
    circle: Any  # its radius, m
    turn: Any  # rad, 0 or more
    turning: Any  # s
    course: Any  # of the straight line, rad
    straight: Any  # its length, m
    speed: Any  # at its end, m/s
    possible: Any  # whether there is such a way in time, bool


def direct(
    own: VehicleState, goal: tuple[Any, Any], time: Any, task: DirectTask, xp: Any
) -> Direct:
    """Return the direct way to a goal, m, from states at some times, s, ``[...]``.

    A goal inside the turning circle, behind a turn of more than half a circle, or too far for the
    time left has no such way.
    """
    sine, cosine = sincos(own.heading, xp)
    dx, dy = goal[0] - own.x, goal[1] - own.y
    side = xp.where(dy * cosine - dx * sine >= 0.0, 1.0, -1.0)
    circle = own.speed * (1.0 / task.turn_rate)
    from_x, from_y = dx + side * circle * sine, dy - side * circle * cosine
    square = from_x * from_x + from_y * from_y - circle * circle
    length = xp.sqrt(xp.maximum(square, 0.0))
    course = wrap(atan2(from_y, from_x, xp) + side * atan2(circle, length, xp), xp)
    turn = wrap(side * (course - own.heading), xp)
    # A goal straight ahead must not become a full circle by rounding; one to be turned to by more
    # than pi is behind.
    possible = xp.logical_and(square > 0.0, turn > -1e-6)
    turn = xp.maximum(turn, 0.0)

    turning = turn * (1.0 / task.turn_rate)
    straight = xp.maximum(length - task.radius, 0.0)
    wanted, in_time = end_speed(straight, own.speed, task.until - time - turning, task.limits, xp)
    return Direct(
        side, circle, turn, turning, course, straight, wanted, xp.logical_and(possible, in_time)
    )


def arrival(
    own: VehicleState, goal: tuple[Any, Any], time: Any, task: DirectTask, xp: Any
) -> tuple[Any, Any, Any]:
    """Return when the direct way passes over the goal, s, on which course, rad, and how fast, m/s,
    ``[...]``.
    """
    way = direct(own, goal, time, task, xp)
    rise = (way.speed - own.speed) * (1.0 / task.limits.acceleration_max)
    level = way.straight + task.radius - 0.5 * (own.speed + way.speed) * rise
    return time + way.turning + rise + level / way.speed, way.course, way.speed


def clear(
    own: VehicleState,
    goal: tuple[Any, Any],
    other: VehicleState,
    required: Any,
    time: Any,
    task: DirectTask,
    xp: Any,
    window: tuple[Any, Any] | None = None,
) -> Any:
    """Return whether turning onto the goal now and flying there keeps clear of an intruder that
    flies straight on, while it counts: in a window of times, s; None: always.

    The turn is judged on the chords of its quarters, less what the arcs can leave them by, the
    straight line until the goal's disc. A goal inside the turning circle, behind a turn of more
    than half a circle, or too far for the time left has no such way. All ``[...]``; goal and
    required separation in m, time in s.
    """
    side, circle, turn, turning, course, straight, wanted, possible = direct(
        own, goal, time, task, xp
    )
    sine, cosine = sincos(own.heading, xp)

    other_vx, other_vy = velocity(other, xp)
    x, y = other.x - own.x, other.y - own.y
    part = turn * (1.0 / _PARTS)
    seconds = turning * (1.0 / _PARTS)
    half_sine, half_cosine = sincos(0.5 * part, xp)
    chord = 2.0 * circle * half_sine
    sag = own.speed * task.turn_rate * seconds * seconds * 0.125
    least_square = (required + sag) * xp.abs(required + sag)
    # The first chord points half a part to the side, each of the others a part further.
    aside = side * half_sine
    ahead_x, ahead_y = cosine * half_cosine - sine * aside, sine * half_cosine + cosine * aside
    part_sine, part_cosine = side * 2.0 * half_sine * half_cosine, 1.0 - 2.0 * half_sine * half_sine
    for number in range(_PARTS):
        step_x, step_y = other_vx * seconds - chord * ahead_x, other_vy * seconds - chord * ahead_y
        if window is None:
            near = _nearest(x, y, step_x, step_y, xp)
        else:
            begin = time + number * seconds
            near = _nearest_within(x, y, step_x, step_y, begin, seconds, window, xp)
        possible = xp.logical_and(possible, near >= least_square)
        x, y = x + step_x, y + step_y
        ahead_x, ahead_y = (
            ahead_x * part_cosine - ahead_y * part_sine,
            ahead_y * part_cosine + ahead_x * part_sine,
        )

    # In a hurry the speed changes on the way; the mean one is good enough to choose by.
    flight = straight / (0.5 * (own.speed + wanted))
    course_sine, course_cosine = sincos(course, xp)
    step_x, step_y = (
        other_vx * flight - straight * course_cosine,
        other_vy * flight - straight * course_sine,
    )
    if window is None:
        near = _nearest(x, y, step_x, step_y, xp)
    else:
        near = _nearest_within(x, y, step_x, step_y, time + turning, flight, window, xp)
    return xp.logical_and(possible, near >= required * xp.abs(required))


def _nearest_within(
    x: Any,
    y: Any,
    step_x: Any,
    step_y: Any,
    begin: Any,
    lasts: Any,
    window: tuple[Any, Any],
    xp: Any,
) -> Any:
    """Return what :func:`_nearest` does for the part of a step that lies in a window; inf: none
    does.
    """
    length = xp.maximum(lasts, 1e-9)
    low, high = (xp.clip((when - begin) / length, 0.0, 1.0) for when in window)
    inside = xp.logical_and(window[0] <= begin + lasts, begin <= window[1])
    return xp.where(inside, _nearest(x, y, step_x, step_y, xp, low, high), xp.inf)


def _nearest(
    x: Any, y: Any, step_x: Any, step_y: Any, xp: Any, low: Any = 0.0, high: Any = 1.0
) -> Any:
    """Return the squared distance from the origin to the line from (x, y) along a step, from one
    share of it to another, m^2.
    """
    s = xp.clip(
        -(x * step_x + y * step_y) / xp.maximum(step_x * step_x + step_y * step_y, 1e-9), low, high
    )
    x, y = x + s * step_x, y + s * step_y
    return x * x + y * y
