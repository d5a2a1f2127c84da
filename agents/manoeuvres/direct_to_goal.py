"""The direct route back: one turn onto the goal, a straight line to it, and whether that keeps
clear of the traffic.
"""

import math
from typing import NamedTuple

import numpy as np

from envs.angles import atan2, sincos, wrap
from envs.arrays import Array, ArrayModule
from envs.compiled import scalar
from envs.frames import Air, F
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


def arc_end(state: VehicleState[F], arc: Array, length: Array) -> tuple[Array, Array]:
    """Return where arcs from a state end that turn by ``arc``, rad, on a length, m; numpy,
    ``[...]`` each.
    """
    # sin(x)/x by numpy is safe at 0; the chord of an arc points half-way through its turn.
    chord, middle = length * np.sinc(arc / (2.0 * math.pi)), state.heading + 0.5 * arc
    return state.x + chord * np.cos(middle), state.y + chord * np.sin(middle)


@scalar
def end_speed(
    length: Array, speed: Array, seconds: Array, limits: Limits, xp: ArrayModule
) -> tuple[Array, Array]:
    """Return the speed to cover a length (m) in some seconds, m/s, and whether that is possible,
    ``[...]``.

    The present speed where it is enough; else, accelerating at once by as much as the limits allow.
    """
    gain, time = limits.acceleration_max, xp.maximum(seconds, 0.0)
    missing = length - speed * time
    square = gain * gain * time * time - 2.0 * gain * missing
    more = gain * time - xp.sqrt(xp.maximum(square, 0.0))
    hurry = missing > 0.0
    final_speed = xp.where(hurry, speed + more, speed)
    enough = xp.logical_and(square >= 0.0, final_speed <= limits.speed_max)
    return final_speed, xp.logical_and(seconds >= 0.0, xp.logical_or(xp.logical_not(hurry), enough))


@scalar
def scalar_arc_end(state: VehicleState[F], arc: float, length: float) -> tuple[float, float]:
    """Return :func:`arc_end` of one arc of plain floats, m."""
    half = 0.5 * arc
    chord = length * (math.sin(half) / half if half != 0.0 else 1.0)
    middle = state.heading + half
    return state.x + chord * math.cos(middle), state.y + chord * math.sin(middle)


class Turn(NamedTuple):
    """A turn towards a point, and the straight line from its end to the point; fields ``[...]``."""

    side: Array  # 1 left, -1 right
    angle: Array  # rad, 0 or more
    length: Array  # of the straight line, m
    course: Array  # of the straight line, rad, not wrapped
    possible: Array  # bool


@scalar
def turn_onto(
    own: VehicleState[Air], point: tuple[Array, Array], radius: Array, xp: ArrayModule
) -> Turn:
    """Return the turns with some radius, m, after which points, m, lie straight ahead, ``[...]``,
    as good as :mod:`envs.angles` has them: to choose by.

    A point inside the turning circle, or behind a turn of more than half a circle, has none.
    """
    sine, cosine = sincos(own.heading, xp)
    sides = _sides(own, point, radius, sine, cosine, xp)
    course = atan2(sides.y, sides.x, xp) + sides.side * atan2(radius, sides.length, xp)
    return _turn(own, sides, course, xp)


@scalar
def turn_exactly_onto(
    own: VehicleState[Air], point: tuple[Array, Array], radius: Array, xp: ArrayModule
) -> Turn:
    """Return :func:`turn_onto` by numpy's own trigonometry: for what is flown; numpy or floats."""
    sides = _sides(own, point, radius, np.sin(own.heading), np.cos(own.heading), xp)
    course = np.arctan2(sides.y, sides.x) + sides.side * np.arctan2(radius, sides.length)
    return _turn(own, sides, course, xp)


class _Sides(NamedTuple):
    """Points as the centre of the turn onto them sees them; fields ``[...]``."""

    side: Array  # of the turn, 1 left, -1 right
    x: Array  # from the centre, m
    y: Array
    square: Array  # of the tangent's length, m^2; negative inside the circle
    length: Array  # of the tangent, m


@scalar
def _sides(
    own: VehicleState[Air],
    point: tuple[Array, Array],
    radius: Array,
    sine: Array,
    cosine: Array,
    xp: ArrayModule,
) -> _Sides:
    dx, dy = point[0] - own.x, point[1] - own.y
    side = xp.where(dy * cosine - dx * sine >= 0.0, 1.0, -1.0)
    from_x, from_y = dx + side * radius * sine, dy - side * radius * cosine
    square = from_x * from_x + from_y * from_y - radius * radius
    return _Sides(side, from_x, from_y, square, xp.sqrt(xp.maximum(square, 0.0)))


@scalar
def _turn(own: VehicleState[Air], sides: _Sides, course: Array, xp: ArrayModule) -> Turn:
    angle = wrap(sides.side * (course - own.heading), xp)
    # A point straight ahead must not become a full circle by rounding; one to be turned to by more
    # than half a circle is behind.
    possible = xp.logical_and(sides.square > 0.0, angle > -1e-6)
    return Turn(sides.side, xp.maximum(angle, 0.0), sides.length, course, possible)


class DirectRoute(NamedTuple):
    """One turn onto the goal and the straight line to its disc; fields ``[...]``."""

    side: Array  # of the turn, 1 left
    circle: Array  # its radius, m
    turn: Array  # rad, 0 or more
    turning: Array  # s
    course: Array  # of the straight line, rad
    straight: Array  # its length, m
    speed: Array  # at its end, m/s
    possible: Array  # whether there is such a way in time, bool


@scalar
def direct(
    own: VehicleState[Air],
    goal: tuple[Array, Array],
    time: Array,
    task: DirectTask,
    xp: ArrayModule,
) -> DirectRoute:
    """Return the direct route to a goal, m, from states at some times, s, ``[...]``.

    A goal that cannot be turned onto (:func:`turn_onto`), or that is too far for the time left, has
    no such way.
    """
    circle = own.speed * (1.0 / task.turn_rate)
    turn = turn_onto(own, goal, circle, xp)
    turning = turn.angle * (1.0 / task.turn_rate)
    straight = xp.maximum(turn.length - task.radius, 0.0)
    final_speed, in_time = end_speed(
        straight, own.speed, task.until - time - turning, task.limits, xp
    )
    possible = xp.logical_and(turn.possible, in_time)
    course = wrap(turn.course, xp)
    return DirectRoute(
        turn.side, circle, turn.angle, turning, course, straight, final_speed, possible
    )


@scalar
def arrival(
    own: VehicleState[Air],
    goal: tuple[Array, Array],
    time: Array,
    task: DirectTask,
    xp: ArrayModule,
) -> tuple[Array, Array, Array]:
    """Return when the direct route passes over the goal, s, on which course, rad, and how fast,
    m/s, ``[...]``.
    """
    way = direct(own, goal, time, task, xp)
    rise = (way.speed - own.speed) * (1.0 / task.limits.acceleration_max)
    level = way.straight + task.radius - 0.5 * (own.speed + way.speed) * rise
    return time + way.turning + rise + level / way.speed, way.course, way.speed


@scalar
def clear(
    own: VehicleState[Air],
    goal: tuple[Array, Array],
    other: VehicleState[Air],
    required: Array,
    time: Array,
    task: DirectTask,
    xp: ArrayModule,
    window: tuple[Array, Array] | None = None,
) -> Array:
    """Return whether turning onto the goal now and flying there keeps clear of an intruder that
    flies straight on, while it counts: in a window of times, s; None: always.

    A goal without a direct route (:func:`direct`) is not clear. All ``[...]``; goal and required
    separation in m, time in s.
    """
    way = direct(own, goal, time, task, xp)
    return keeps_clear(own, way, other, required, time, task, xp, window)


@scalar
def keeps_clear(
    own: VehicleState[Air],
    way: DirectRoute,
    other: VehicleState[Air],
    required: Array,
    time: Array,
    task: DirectTask,
    xp: ArrayModule,
    window: tuple[Array, Array] | None = None,
) -> Array:
    """Return what :func:`clear` does for a direct route that is known.

    The turn is judged on the chords of its quarters, less what the arcs can leave them by, the
    straight line until the goal's disc.
    """
    other_vx, other_vy = velocity(other, xp)
    x, y = other.x - own.x, other.y - own.y
    possible = way.possible
    seconds = way.turning * (1.0 / _PARTS)
    sagitta = own.speed * task.turn_rate * seconds * seconds * 0.125
    least_square = (required + sagitta) * xp.abs(required + sagitta)
    chords = _chords(own, way, xp)
    ahead_x, ahead_y = chords.x, chords.y
    for number in range(_PARTS):
        step_x, step_y = other_vx * seconds - ahead_x, other_vy * seconds - ahead_y
        begin = time + number * seconds
        near = _nearest_while_it_counts(x, y, step_x, step_y, begin, seconds, window, xp)
        possible = xp.logical_and(possible, near >= least_square)
        x, y = x + step_x, y + step_y
        ahead_x, ahead_y = (
            ahead_x * chords.cosine - ahead_y * chords.sine,
            ahead_y * chords.cosine + ahead_x * chords.sine,
        )

    # In a hurry the speed changes on the way; the mean one is good enough to choose by.
    lasts = way.straight / (0.5 * (own.speed + way.speed))
    sine, cosine = sincos(way.course, xp)
    step_x, step_y = (
        other_vx * lasts - way.straight * cosine,
        other_vy * lasts - way.straight * sine,
    )
    turned = time + way.turning
    near = _nearest_while_it_counts(x, y, step_x, step_y, turned, lasts, window, xp)
    return xp.logical_and(possible, near >= required * xp.abs(required))


class _Chords(NamedTuple):
    """The chords of the quarters of a direct route's turn; fields ``[...]``."""

    x: Array  # of the first one, east, m
    y: Array  # north
    cosine: Array  # of the angle from one to the next
    sine: Array


@scalar
def _chords(own: VehicleState[Air], way: DirectRoute, xp: ArrayModule) -> _Chords:
    sine, cosine = sincos(own.heading, xp)
    half_sine, half_cosine = sincos(0.5 * (way.turn * (1.0 / _PARTS)), xp)
    length = 2.0 * way.circle * half_sine
    # The first chord points half a part to the side, each of the others a part further.
    aside = way.side * half_sine
    ahead_x, ahead_y = cosine * half_cosine - sine * aside, sine * half_cosine + cosine * aside
    part_sine = way.side * 2.0 * half_sine * half_cosine
    return _Chords(length * ahead_x, length * ahead_y, 1.0 - 2.0 * half_sine * half_sine, part_sine)


@scalar
def _nearest_while_it_counts(
    x: Array,
    y: Array,
    step_x: Array,
    step_y: Array,
    begin: Array,
    lasts: Array,
    window: tuple[Array, Array] | None,
    xp: ArrayModule,
) -> Array:
    """Return the squared distance from the origin to the part of a step that lies in a window, m^2;
    inf: none does.

    The step leads from (x, y) along (step_x, step_y), m, begins at a time and lasts so long, s.
    """
    if window is None:
        return _nearest(x, y, step_x, step_y, 0.0, 1.0, xp)
    length = xp.maximum(lasts, 1e-9)
    low = xp.clip((window[0] - begin) / length, 0.0, 1.0)
    high = xp.clip((window[1] - begin) / length, 0.0, 1.0)
    inside = xp.logical_and(window[0] <= begin + lasts, begin <= window[1])
    return xp.where(inside, _nearest(x, y, step_x, step_y, low, high, xp), math.inf)


@scalar
def _nearest(
    x: Array,
    y: Array,
    step_x: Array,
    step_y: Array,
    low: Array,
    high: Array,
    xp: ArrayModule,
) -> Array:
    """Return the squared distance from the origin to the line from (x, y) along a step, from one
    share of it to another, m^2.
    """
    s = xp.clip(
        -(x * step_x + y * step_y) / xp.maximum(step_x * step_x + step_y * step_y, 1e-9), low, high
    )
    x, y = x + s * step_x, y + s * step_y
    return x * x + y * y
