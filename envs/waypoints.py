"""Waypoints, and the one curve between two of them that planner, validator and follower share.

Position alone says too little: flown histories of 20 s between the same two points differ by up to 208 m. A waypoint
therefore carries heading, ground speed and time, and the leg between two is the gentlest motion that meets all of
them: constant yaw rate and acceleration on each of :data:`ARCS` equal parts of its duration, with the least sum of
squares of both. On recorded flights of the policy the curve leaves the path between the waypoints by 1.4 m (median
of the maxima), 13 m (95 %).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from envs.angles import wrap
from envs.kinematics import VehicleState

ARCS = 10
"""Arcs of a leg."""

CLOSED = 1e-3
"""A leg that misses its end by more than this, m, does not exist (the waypoints contradict each other)."""

_TURN_SCALE, _SPEED_SCALE = 0.02, 0.2  # rad/s and m/s^2 that count alike in the sum of squares
_ITERATIONS, _EXACT = 12, 5e-4
# Gauss-Legendre's rule on [0, 1]: good to 1e-9 m on an arc of a leg of 20 s, to 1e-6 m on one that turns by 1 rad.
_NODES = 0.5 + 0.5 * np.polynomial.legendre.leggauss(4)[0]
_WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(4)[1]


@dataclass(frozen=True, slots=True)
class Waypoint:
    """A point of a plan, SI units and radians."""

    index: int  # unique among the plan's waypoints and the route's points
    x: float  # east, m
    y: float  # north, m
    heading: float  # direction of the velocity over the ground, rad counter-clockwise from east, in [-pi, pi)
    speed: float  # ground speed, m/s
    time: float  # s after the request


@dataclass(frozen=True, slots=True)
class RoutePoint:
    """A point of the route that the aircraft had filed, m."""

    index: int
    x: float  # east, m
    y: float  # north, m


class Knots(NamedTuple):
    """States with their times as arrays: where legs begin and end; fields ``[..., W]``, SI units."""

    x: Any
    y: Any
    heading: Any
    speed: Any
    time: Any  # s, increasing along the last axis


class Legs(NamedTuple):
    """Curves between consecutive knots, SI units and radians; fields ``[...]``, those of arcs ``[..., ARCS]``."""

    time: Any  # at the beginning, s
    duration: Any  # s
    miss: Any  # distance between the end of the curve and the knot, m (see CLOSED)
    x: Any  # at the beginning of each arc, m
    y: Any
    heading: Any  # there, rad, not wrapped, so that differences are turns
    speed: Any  # there, m/s
    yaw_rate: Any  # of each arc, rad/s
    acceleration: Any  # of each arc, m/s^2


def knots(own: VehicleState, waypoints: Sequence[Waypoint], time: float = 0.0) -> Knots:
    """Return the state at the request and the waypoints after it as arrays, ``[1 + len(waypoints)]``."""
    first = [(float(own.x), float(own.y), float(own.heading), float(own.speed), time)]
    rest = [(point.x, point.y, point.heading, point.speed, point.time) for point in waypoints]
    return Knots(*np.array(first + rest, dtype=float).T)


def leg(a: Waypoint, b: Waypoint) -> Legs:
    """Return the curve between two waypoints, fields without leading axes."""
    own = VehicleState(a.x, a.y, a.heading, a.speed)
    return Legs(*(field[0] for field in legs(knots(own, [b], a.time))))


def legs(knots: Knots) -> Legs:
    """Return the curves between consecutive knots.

    The controls follow from Gauss-Newton steps on the end position, whose minimum-norm solution is known in closed
    form; heading and speed at the end are met exactly. Each leg is solved by itself: results do not depend on
    what else is in the arrays. Knots ``[..., W]``, float64, finite, times increasing, give legs ``[..., W - 1]``.
    """
    shape = np.shape(knots.time)
    start = [np.asarray(field)[..., :-1].reshape(-1) for field in knots]
    end = [np.asarray(field)[..., 1:].reshape(-1) for field in knots]
    step = (end[4] - start[4]) / ARCS
    turn, gain = wrap(end[2] - start[2], np), end[3] - start[3]
    yaw_rate = np.repeat((turn / (ARCS * step))[:, None], ARCS, axis=1)
    acceleration = np.repeat((gain / (ARCS * step))[:, None], ARCS, axis=1)
    target_x, target_y = end[0] - start[0], end[1] - start[1]

    x, y, heading, speed, miss = (np.zeros((step.size, ARCS)) for _ in range(5))
    miss = miss[:, 0]
    left = np.arange(step.size)
    for iteration in range(_ITERATIONS + 1):
        part = left if left.size < step.size else slice(None)  # a view while nothing is finished
        h, psi0, v0 = step[part, None], start[2][part, None], start[3][part, None]
        mean_turn, mean_gain = turn[part, None] / (ARCS * h), gain[part, None] / (ARCS * h)
        omega, accel = yaw_rate[part], acceleration[part]
        psi, v = psi0 + _before(omega * h), v0 + _before(accel * h)
        dx, dy = _arc(psi, v, omega, accel, h)
        px, py = np.cumsum(dx, axis=1), np.cumsum(dy, axis=1)
        off_x, off_y = target_x[part] - px[:, -1], target_y[part] - py[:, -1]
        off = np.hypot(off_x, off_y)
        x[part], y[part], heading[part], speed[part], miss[part] = px - dx, py - dy, psi, v, off
        # Written so that what is not finite stays unfinished, and shows in its miss.
        going_on = ~(off <= _EXACT)
        if iteration == _ITERATIONS or not going_on.any():
            break
        if not going_on.all():
            left = left[going_on]
            h, mean_turn, mean_gain = h[going_on], mean_turn[going_on], mean_gain[going_on]
            omega, accel, dx, dy = omega[going_on], accel[going_on], dx[going_on], dy[going_on]
            px, py, off_x, off_y = px[going_on], py[going_on], off_x[going_on], off_y[going_on]
        # What a change of each arc's yaw rate does to the end position is a rotation of the rest of the leg; of its
        # acceleration, a push along the rest. Less their means, because the sums of both controls are fixed.
        turn_x = _centred(-(py[:, -1:] - py + 0.5 * dy) * h)
        turn_y = _centred((px[:, -1:] - px + 0.5 * dx) * h)
        length = np.maximum(np.hypot(dx, dy), 1e-9)
        along_x, along_y = dx / length * h * h, dy / length * h * h
        push_x, push_y = _centred(_from_here(along_x)), _centred(_from_here(along_y))
        wt, wa = _TURN_SCALE**2, _SPEED_SCALE**2
        a11 = wt * np.sum(turn_x * turn_x, axis=1) + wa * np.sum(push_x * push_x, axis=1)
        a12 = wt * np.sum(turn_x * turn_y, axis=1) + wa * np.sum(push_x * push_y, axis=1)
        a22 = wt * np.sum(turn_y * turn_y, axis=1) + wa * np.sum(push_y * push_y, axis=1)
        b1 = np.sum(turn_x * omega, axis=1) + np.sum(push_x * accel, axis=1) + off_x
        b2 = np.sum(turn_y * omega, axis=1) + np.sum(push_y * accel, axis=1) + off_y
        determinant = np.maximum(a11 * a22 - a12 * a12, 1e-12)
        m1 = ((a22 * b1 - a12 * b2) / determinant)[:, None]
        m2 = ((a11 * b2 - a12 * b1) / determinant)[:, None]
        yaw_rate[left] = mean_turn + wt * (turn_x * m1 + turn_y * m2)
        acceleration[left] = mean_gain + wa * (push_x * m1 + push_y * m2)

    def shaped(field: Any) -> Any:
        return field.reshape(*shape[:-1], shape[-1] - 1, *field.shape[1:])

    fields = (start[4], ARCS * step, miss, start[0][:, None] + x, start[1][:, None] + y, heading, speed)
    return Legs(*(shaped(field) for field in (*fields, yaw_rate, acceleration)))


def at(legs: Legs, time: Any) -> VehicleState:
    """Return the state on legs ``[..., L]`` at a time (s), ``[...]``; their first and last arc go on beyond them."""
    begun = np.sum(np.asarray(time)[..., None] >= legs.time[..., 1:], axis=-1)
    number = np.broadcast_to(begun, np.shape(legs.time)[:-1])[..., None]
    began, duration = (np.take_along_axis(field, number, -1)[..., 0] for field in (legs.time, legs.duration))
    seconds = time - began
    arc = np.clip(np.floor(seconds / duration * ARCS), 0, ARCS - 1).astype(np.intp)
    flat = number[..., 0] * ARCS + arc
    arcs = (field.reshape(*field.shape[:-2], -1) for field in legs[3:])
    x, y, psi, v, omega, accel = (np.take_along_axis(field, flat[..., None], -1)[..., 0] for field in arcs)
    t = seconds - arc * (duration / ARCS)
    dx, dy = _arc(psi, v, omega, accel, t)
    return VehicleState(x + dx, y + dy, wrap(psi + omega * t, np), v + accel * t)


def _arc(heading: Any, speed: Any, yaw_rate: Any, acceleration: Any, duration: Any) -> tuple[Any, Any]:
    """Return the displacement of an arc, m: its velocity integrated by Gauss-Legendre's rule."""
    # The nodes lead, so that the sum over them is the same whatever the other axes hold.
    seconds = np.multiply.outer(_NODES, duration)
    psi = yaw_rate * seconds + heading
    covered = (acceleration * seconds + speed) * np.multiply.outer(_WEIGHTS, duration)
    return np.add.reduce(covered * np.cos(psi), axis=0), np.add.reduce(covered * np.sin(psi), axis=0)


def _before(parts: Any) -> Any:
    """Return the sum of the parts before each, ``[M, ARCS]``."""
    return np.cumsum(parts, axis=1) - parts


def _from_here(parts: Any) -> Any:
    """Return the sum of the parts after each and half of itself, ``[M, ARCS]``."""
    return np.sum(parts, axis=1, keepdims=True) - np.cumsum(parts, axis=1) + 0.5 * parts


def _centred(effect: Any) -> Any:
    return effect - np.sum(effect, axis=1, keepdims=True) * (1.0 / ARCS)
