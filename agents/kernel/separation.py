"""Distances between a plan's curves and the intruders: the validator's own arithmetic.

Nothing here is shared with the modules that make plans, nor with their prediction of the intruders.
"""

from typing import NamedTuple

import numpy as np

from agents.kernel.traffic import Requirement, Traffic
from envs.arrays import Array
from envs.trees import column, map_leaves
from envs.waypoints import ARCS, Legs

FINE = 32
"""Parts into which an arc of a leg is cut where it matters: 0.06 s of a leg of 20 s, 4 mm of
uncertainty.
"""

CLOSE = 1e-3
"""How much of the margin may be missing, m: a start inside it must keep its own distance exactly,
and the bound of a part that begins there may be smaller by the part's sagitta."""

ROUNDING = 1e-6
"""How much of the separation itself may be missing, m."""

LONGEST = 16_384.0
"""Time of a plan's last waypoint at most, s: so far the rounding of positions is bounded
(proofs/Rounding.g).
"""

# Gauss-Legendre's rule of four points over [0, 1], [4, 1, 1]: the nodes lead.
_NODES, _FACTORS = (part[:, None, None] for part in np.polynomial.legendre.leggauss(4))
_SHARES, _WEIGHTS = 0.5 * (1.0 + _NODES), 0.5 * _FACTORS
_SAME_PLACE = 1e-6  # m by which an intruder may leave its report's flight for rounding's sake
_STRAIGHT = 1e-30  # rad/s of a turn that is none


def same_flight(reports: Traffic, age: Array, traffic: Traffic) -> Array:
    """Return whether intruders as of the request fly on as their reports say, which are of some
    age then, s; bool ``[N, K]``.

    They are looked at where they stand, half-way through the turn, at its end and long after it:
    two arcs of one rate through the same points are the same, two straight lines too.
    """
    said, used = (map_leaves(np.ravel, given) for given in (reports, traffic))
    turn = used.turn_time[:, None]
    times = np.concatenate([turn * np.array([0.0, 0.5, 1.0]), turn + 500.0], axis=1)
    there, here = (
        _positions(column(said), times + np.ravel(age)[:, None]),
        _positions(column(used), times),
    )
    near = np.hypot(there[0] - here[0], there[1] - here[1]).max(axis=1) <= _SAME_PLACE
    alike = (used.turn_time == 0.0) | (said.turn_rate == used.turn_rate)
    return (near & alike & (said.mask == used.mask)).reshape(np.shape(age))


def chords(
    begin: Array,
    length: Array,
    start: tuple[Array, Array],
    end: tuple[Array, Array],
    traffic: Traffic,
    relative_acceleration: Array,
) -> tuple[Array, Array]:
    """Return a lower bound and an attained value of the distance from intruders ``[n, K]``, m,
    ``[n, A, K]``.

    The parts begin at some times and last some seconds, ``[n, A]``, between own positions, m,
    ``[n, A]`` each; ``relative_acceleration`` is the largest one, m/s^2, and broadcasts against
    ``[n, A, K]``.
    """
    # Beginnings and ends in one array, [2, n, A] and [2, n, A, K]: half the calls, the same bits.
    own_x, own_y, times = np.stack([(*start, begin), (*end, begin + length)], axis=1)
    x, y = _positions(map_leaves(lambda field: field[:, None], traffic), times[..., None])
    (x0, x1), (y0, y1) = x, y = x - own_x[..., None], y - own_y[..., None]
    dx, dy = x1 - x0, y1 - y0
    s = np.clip(-(x0 * dx + y0 * dy) / np.maximum(dx * dx + dy * dy, 1e-12), 0.0, 1.0)
    first, last = np.sqrt(x * x + y * y)
    near_x, near_y = x0 + s * dx, y0 + s * dy
    near = np.sqrt(near_x * near_x + near_y * near_y)
    # A share s of the part from its beginning, the motion leaves the chord by at most
    # 4 sagitta s (1 - s). Where the chord is nearest at an end, from which the range opens by at
    # least g s, the distance is smaller than there by at most (4 sagitta - g)^2 / (16 sagitta).
    sagitta = np.maximum(relative_acceleration * (0.125 * length[..., None] ** 2), 1e-12)
    opening = np.where(s <= 0.0, (x0 * dx + y0 * dy) / np.maximum(first, 1e-9), 0.0)
    opening = np.where(s >= 1.0, -(x1 * dx + y1 * dy) / np.maximum(last, 1e-9), opening)
    loss = np.maximum(4.0 * sagitta - np.maximum(opening, 0.0), 0.0) ** 2 / (16.0 * sagitta)
    return near - loss, np.minimum(first, last)


def distances(time: Array, x: Array, y: Array, traffic: Traffic) -> Array:
    """Return the distances of intruders ``[n, K]`` from places at times, m, ``[n, A, K]``."""
    other_x, other_y = _positions(
        map_leaves(lambda field: field[:, None], traffic), time[..., None]
    )
    return np.hypot(other_x - x[..., None], other_y - y[..., None])


def _positions(traffic: Traffic, time: Array) -> tuple[Array, Array]:
    """Return the positions of intruders ``[...]`` at times that broadcast, m: they turn, then fly
    straight.
    """
    state = traffic.state
    x, y = (
        start + state.speed * part(state.heading) * time
        for start, part in ((state.x, np.cos), (state.y, np.sin))
    )
    # Only turning ones are treated apart, so that the rounding of one does not depend on the
    # others.
    turning = (np.abs(traffic.turn_rate) > _STRAIGHT) & (traffic.turn_time > 0.0)
    if turning.any():
        turns = np.nonzero(np.broadcast_to(turning, x.shape))
        one = map_leaves(lambda field: np.broadcast_to(field, x.shape)[turns], traffic)
        x[turns], y[turns] = _positions_of_turning(one, np.broadcast_to(time, x.shape)[turns])
    return x, y


def _positions_of_turning(one: Traffic, time: Array) -> tuple[Array, Array]:
    turning = np.minimum(time, one.turn_time)
    # A turn's chord points half-way through it. Differences of sines would lose 0.1 mm in turns of
    # 1e-9 rad/s.
    half = 0.5 * one.turn_rate * turning
    chord = 2.0 * one.state.speed * np.sin(half) / one.turn_rate
    middle, after = one.state.heading + half, one.state.heading + 2.0 * half
    straight = one.state.speed * (time - turning)
    x = one.state.x + chord * np.cos(middle) + straight * np.cos(after)
    y = one.state.y + chord * np.sin(middle) + straight * np.sin(after)
    return x, y


def growth(traffic: Traffic, time: Array, requirement: Requirement) -> Array:
    """Return what uncertainty adds to the required distance by a time since the request, m, ``[n,
    A, K]``.
    """
    if not traffic.velocity_std.any():
        return np.zeros((1, 1, 1))
    std, drift, age = (
        field[:, None] for field in (traffic.position_std, traffic.velocity_std, traffic.age)
    )
    first = np.hypot(std, drift * age)
    return requirement.sigmas * (np.hypot(std, drift * (age + time[..., None])) - first)


class Arcs(NamedTuple):
    """Arcs of constant controls, each from its beginning on; fields ``[m, 1]``."""

    x: Array  # m
    y: Array
    heading: Array  # rad
    speed: Array  # m/s
    yaw_rate: Array  # rad/s
    acceleration: Array  # m/s^2


def arcs_of(curves: Legs) -> Arcs:
    """Return the arcs of legs, ``[..., ARCS]``."""
    return Arcs(
        curves.x, curves.y, curves.heading, curves.speed, curves.yaw_rate, curves.acceleration
    )


def along(arcs: Arcs, part: Array) -> tuple[Array, Array]:
    """Return positions on arcs ``[m, 1]`` after 0 to :data:`FINE` parts of some seconds, m,
    ``[m, FINE + 1]`` each: Gauss-Legendre's rule.
    """
    x, y, heading, speed, yaw_rate, acceleration = arcs
    time = np.arange(FINE + 1) * part
    # Velocities as complex numbers: the course at a node of the rule turns by the same from part to
    # part, and turning it takes less than half the time of another sine and cosine. The error grows
    # to some 1e-14.
    start, turn = np.cos(heading) + 1j * np.sin(heading), yaw_rate * (_SHARES * part)
    turns = np.broadcast_to(np.cos(turn) + 1j * np.sin(turn), (len(_SHARES), len(time), FINE))
    starts = np.broadcast_to(start, (len(_SHARES), len(time), 1))
    courses = np.multiply.accumulate(np.concatenate([starts, turns], axis=2), axis=2)
    moved = np.add.reduce((speed + acceleration * (_SHARES * time)) * _WEIGHTS * courses, axis=0)
    return x + moved.real * time, y + moved.imag * time


def position_error_bound(curves: Legs) -> Array:
    """Return the error of positions on each leg by Gauss-Legendre's rule, m, ``[..., L]``.

    Proven in proofs/Quadrature.v (``position_error_bound_sound``): below 1 nm on legs of 20 s,
    1 micrometre on those of a minute.
    """
    half = 0.5 * curves.duration[..., None] / ARCS
    turn, gain = np.abs(curves.yaw_rate * half), np.abs(curves.acceleration) * half
    quickest = np.maximum(curves.speed, curves.speed + 2.0 * half * curves.acceleration)
    square = turn * turn
    each = (
        2.0
        / 9.0
        * half
        * (quickest * turn / 40320.0 + gain / 5040.0)
        * (square * square * square * turn)
    )
    return np.sum(each, axis=-1)
