"""Waypoints, and the one curve between two of them that planner, validator and follower share.

Position alone says too little: flown histories of 20 s between the same two points differ by up to
208 m. A waypoint therefore carries heading, ground speed and time, and the leg between two is the
gentlest motion that meets all of them: constant yaw rate and acceleration on each of :data:`ARCS`
equal parts of its duration, with the least sum of squares of both. On recorded flights of the
policy the curve leaves the path between the waypoints by 1.4 m (median of the maxima), 13 m (95 %).

Waypoints are over the ground. In a wind the leg is that curve in the air mass, between the same
waypoints as the air mass sees them, carried along by the wind: :func:`plan_states` takes waypoints
into the air mass and :func:`at` a place on its legs back.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from envs.angles import wrap
from envs.kinematics import VehicleState
from envs.wind import Wind, over_ground, through_air

ARCS = 10
"""Arcs of a leg."""

CLOSED = 1e-3
"""A leg that misses its end by more than this, m, does not exist (the waypoints contradict each
other).
"""

_TURN, _SPEED = 0.02**2, 0.2**2  # weights: 0.02 rad/s and 0.2 m/s^2 count alike
_EACH = np.array([_TURN, _SPEED])[:, None, None]
_ITERATIONS, _EXACT = 12, 5e-4
# Gauss-Legendre's rule on [0, 1]: good to 1e-9 m on an arc of a leg of 20 s, to 1e-6 m on one that
# turns by 1 rad.
_NODES = 0.5 + 0.5 * np.polynomial.legendre.leggauss(4)[0]
_WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(4)[1]
_QUARTER = np.array([-1.0, 1.0])[
    :, None, None
]  # with x and y exchanged, a quarter turn to the left


@dataclass(frozen=True, slots=True)
class Waypoint:
    """A point of a plan, SI units and radians."""

    index: int  # unique among the plan's waypoints and the route's points
    x: float  # east, m
    y: float  # north, m
    # direction of the velocity over the ground, rad counter-clockwise from east, in [-pi, pi)
    heading: float
    speed: float  # ground speed, m/s
    time: float  # s after the request


@dataclass(frozen=True, slots=True)
class RoutePoint:
    """A point of the route that the aircraft had filed, m."""

    index: int
    x: float  # east, m
    y: float  # north, m


class PlanStates(NamedTuple):
    """States with their times as arrays: where legs begin and end; fields ``[..., W]``, SI
    units.
    """

    x: Any
    y: Any
    heading: Any
    speed: Any
    time: Any  # s, increasing along the last axis


class Legs(NamedTuple):
    """Curves between consecutive plan states, SI units and radians; fields ``[...]``, those of arcs
    ``[..., ARCS]``.
    """

    time: Any  # at the beginning, s
    duration: Any  # s
    miss: Any  # distance between the end of the curve and the plan state, m (see CLOSED)
    x: Any  # at the beginning of each arc, m
    y: Any
    heading: Any  # there, rad, not wrapped, so that differences are turns
    speed: Any  # there, m/s
    yaw_rate: Any  # of each arc, rad/s
    acceleration: Any  # of each arc, m/s^2


def plan_states(
    own: VehicleState,
    waypoints: Sequence[Waypoint],
    time: float = 0.0,
    wind: Wind | None = None,
) -> PlanStates:
    """Return the state at the request and the waypoints after it as arrays, ``[1 +
    len(waypoints)]``; in a wind as the air mass sees them that lies over the ground at time 0.
    """
    first = [(float(own.x), float(own.y), float(own.heading), float(own.speed), time)]
    rest = [(point.x, point.y, point.heading, point.speed, point.time) for point in waypoints]
    found = PlanStates(*np.array(first + rest, dtype=float).T)
    return found if wind is None else in_air(found, wind)


def in_air(plan_states: PlanStates, wind: Wind) -> PlanStates:
    """Return plan states over the ground as the air mass sees them, ``[..., W]``."""
    return PlanStates(
        *through_air(VehicleState(*plan_states[:4]), wind, plan_states.time), plan_states.time
    )


def on_ground(plan_states: PlanStates, wind: Wind) -> PlanStates:
    """Return plan states in the air mass as the ground sees them, ``[..., W]``."""
    return PlanStates(
        *over_ground(VehicleState(*plan_states[:4]), wind, plan_states.time), plan_states.time
    )


def leg(a: Waypoint, b: Waypoint, wind: Wind | None = None) -> Legs:
    """Return the curve between two waypoints, fields without leading axes; in a wind, in the air
    mass.
    """
    own = VehicleState(a.x, a.y, a.heading, a.speed)
    return Legs(*(field[0] for field in legs(plan_states(own, [b], a.time, wind))))


def legs(plan_states: PlanStates) -> Legs:
    """Return the curves between consecutive plan states.

    The controls follow from Gauss-Newton steps on the end position, whose minimum-norm solution is
    known in closed form; heading and speed at the end are met exactly. Each leg is solved by
    itself: results do not depend on what else is in the arrays. Plan states ``[..., W]``, float64,
    finite, times increasing, give legs ``[..., W - 1]``.
    """
    # In one piece, and in place: all plans pass here, and parts with names would hand on as many
    # arrays as they have lines.
    shape = np.shape(plan_states.time)
    start, end = (
        np.stack([np.asarray(field)[..., part].reshape(-1) for field in plan_states])
        for part in (slice(-1), slice(1, None))
    )
    step = (end[4] - start[4]) / ARCS
    # The controls, yaw rate and acceleration, have an axis of their own, and so have x and y of
    # places: half the calls. [2, M] and [2, M, ARCS].
    change = np.stack([wrap(end[2] - start[2], np), end[3] - start[3]])
    mean = (change / (ARCS * step))[..., None]
    controls, target = np.repeat(mean, ARCS, axis=-1), end[:2] - start[:2]
    place, motion = np.zeros((2, 2, step.size, ARCS))  # motion: heading and speed
    miss, left = np.zeros(step.size), np.arange(step.size)
    for iteration in range(_ITERATIONS + 1):
        part = left if left.size < step.size else slice(None)  # a view while nothing is finished
        h, control = step[part, None], controls[:, part]
        moving = start[2:4, part, None] + _before(control * h)
        flown = _arc(*moving, *control, h)
        ends = flown.cumsum(axis=-1)
        off = target[:, part] - ends[..., -1]
        missed = np.hypot(*off)
        place[:, part], motion[:, part], miss[part] = ends - flown, moving, missed
        # Written so that what is not finite stays unfinished, and shows in its miss.
        going_on = ~(missed <= _EXACT)
        if iteration == _ITERATIONS or not going_on.any():
            break
        if not going_on.all():
            left, h, control = left[going_on], h[going_on], control[:, going_on]
            flown, ends, off = flown[:, going_on], ends[:, going_on], off[:, going_on]
        # What a change of each arc's yaw rate does to the end position is a rotation of the rest of
        # the leg; of its acceleration, a push along the rest. Less their means, because the sums of
        # both controls are fixed. [2, 2, M, ARCS]: of each control on x and y.
        rest = ends[..., -1:] - ends + 0.5 * flown
        pushed = _from_here(flown / np.maximum(np.hypot(*flown), 1e-9) * h * h)
        effect = _centre(np.stack([rest[::-1] * _QUARTER * h, pushed]))
        of_turn, of_push = (effect * effect).sum(axis=-1)
        a11, a22 = _TURN * of_turn + _SPEED * of_push
        of_turn, of_push = (effect[:, 0] * effect[:, 1]).sum(axis=-1)
        a12 = _TURN * of_turn + _SPEED * of_push
        of_turn, of_push = (effect * control[:, None]).sum(axis=-1)
        b1, b2 = of_turn + of_push + off
        determinant = np.maximum(a11 * a22 - a12 * a12, 1e-12)
        m1 = ((a22 * b1 - a12 * b2) / determinant)[:, None]
        m2 = ((a11 * b2 - a12 * b1) / determinant)[:, None]
        controls[:, left] = mean[:, left] + _EACH * (effect[:, 0] * m1 + effect[:, 1] * m2)

    def by_leg(field: Any) -> Any:
        return field.reshape(*shape[:-1], shape[-1] - 1, *field.shape[1:])

    fields = start[4], ARCS * step, miss, *(start[:2, :, None] + place), *motion, *controls
    return Legs(*map(by_leg, fields))


def at(legs: Legs, time: Any, wind: Wind | None = None) -> VehicleState:
    """Return the state on legs ``[..., L]`` at a time (s), ``[...]``; their first and last arc go
    on beyond them. With the wind whose air mass the legs are in, the state is over the ground.
    """
    begun = np.sum(np.asarray(time)[..., None] >= legs.time[..., 1:], axis=-1)
    number = np.broadcast_to(begun, np.shape(legs.time)[:-1])[..., None]
    began, duration = (
        np.take_along_axis(field, number, -1)[..., 0] for field in (legs.time, legs.duration)
    )
    seconds = time - began
    arc = np.clip(np.floor(seconds / duration * ARCS), 0, ARCS - 1).astype(np.intp)
    flat = number[..., 0] * ARCS + arc
    arcs = (field.reshape(*field.shape[:-2], -1) for field in legs[3:])
    x, y, psi, v, omega, accel = (
        np.take_along_axis(field, flat[..., None], -1)[..., 0] for field in arcs
    )
    t = seconds - arc * (duration / ARCS)
    dx, dy = _arc(psi, v, omega, accel, t)
    state = VehicleState(x + dx, y + dy, wrap(psi + omega * t, np), v + accel * t)
    return state if wind is None else over_ground(state, wind, time)


def _arc(heading: Any, speed: Any, yaw_rate: Any, acceleration: Any, duration: Any) -> Any:
    """Return the displacement of an arc, m, ``[2, ...]``: its velocity integrated by
    Gauss-Legendre's rule.
    """
    # The nodes lead, so that the sum over them is the same whatever the other axes hold.
    seconds = np.multiply.outer(_NODES, duration)
    psi = yaw_rate * seconds + heading
    covered = (acceleration * seconds + speed) * np.multiply.outer(_WEIGHTS, duration)
    return np.add.reduce(covered * np.stack([np.cos(psi), np.sin(psi)]), axis=1)


def _before(parts: Any) -> Any:
    """Return the sum of the parts before each, ``[..., ARCS]``."""
    return parts.cumsum(axis=-1) - parts


def _from_here(parts: Any) -> Any:
    """Return the sum of the parts after each and half of itself, ``[..., ARCS]``."""
    return parts.sum(axis=-1, keepdims=True) - parts.cumsum(axis=-1) + 0.5 * parts


def _centre(effect: Any) -> Any:
    return effect - effect.sum(axis=-1, keepdims=True) * (1.0 / ARCS)
