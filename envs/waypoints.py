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
from typing import Any, Generic, NamedTuple, overload

import numpy as np

from envs.angles import wrap
from envs.arrays import Array
from envs.frames import Air, F, Ground
from envs.kinematics import VehicleState
from envs.scalar_legs import ARCS, EXACT, ITERATIONS, NODES, SOLVE_LEGS, SPEED, TURN, WEIGHTS
from envs.trees import map_leaves
from envs.wind import NO_WIND, Wind, over_ground, through_air

CLOSED = 1e-3
"""A leg that misses its end by more than this, m, does not exist (the waypoints contradict each
other).
"""

_EACH = np.array([TURN, SPEED])[:, None, None]
_LEGS = 40  # of a call of compiled code, which may last 1 ms
# Times x and y exchanged: a quarter turn to the left.
_QUARTER = np.array([-1.0, 1.0])[:, None, None]


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
    # height in the reference of the ownship's altitude, m; None: the plan is one in the plane
    altitude: float | None = None
    # of the leg that begins here, m/s, positive upwards; None with the altitude
    climb: float | None = None


@dataclass(frozen=True, slots=True)
class RoutePoint:
    """A point of the route that the aircraft had filed, m."""

    index: int
    x: float  # east, m
    y: float  # north, m
    altitude: float | None = None  # to be kept, as of the ownship's altitude, m; None: not given


class PlanStates(NamedTuple, Generic[F]):
    """States of a frame with their times, where legs begin and end; fields ``[..., W]``."""

    x: Array  # m
    y: Array
    heading: Array  # rad
    speed: Array  # m/s
    time: Array  # s, increasing along the last axis


class Legs(NamedTuple, Generic[F]):
    """Curves between consecutive plan states, in their frame; fields ``[...]``, those of arcs
    ``[..., ARCS]``.
    """

    time: Array  # at the beginning, s
    duration: Array  # s
    miss: Array  # distance between the end of the curve and the plan state, m (see CLOSED)
    x: Array  # at the beginning of each arc, m
    y: Array
    heading: Array  # there, rad, not wrapped, so that differences are turns
    speed: Array  # there, m/s
    yaw_rate: Array  # of each arc, rad/s
    acceleration: Array  # of each arc, m/s^2


class _Arc(NamedTuple):
    """The beginning of an arc, and its controls; fields ``[...]`` as those of :class:`Legs`."""

    x: Array
    y: Array
    heading: Array
    speed: Array
    yaw_rate: Array
    acceleration: Array


def plan_states(
    own: VehicleState[Ground],
    waypoints: Sequence[Waypoint],
    time: float = 0.0,
    wind: Wind | None = None,
) -> PlanStates[Air]:
    """Return the state at the request and the waypoints after it as arrays, ``[1 +
    len(waypoints)]``.

    The time of the request is in s. In a wind they are as the air mass sees them that lies over the
    ground at time 0.
    """
    rows = [
        (float(own.x), float(own.y), float(own.heading), float(own.speed), time),
        *((point.x, point.y, point.heading, point.speed, point.time) for point in waypoints),
    ]
    return in_air(PlanStates(*np.array(rows, dtype=float).T), NO_WIND if wind is None else wind)


def in_air(plan_states: PlanStates[Ground], wind: Wind) -> PlanStates[Air]:
    """Return plan states over the ground as the air mass sees them, ``[..., W]``."""
    return PlanStates(
        *through_air(VehicleState(*plan_states[:4]), wind, plan_states.time), plan_states.time
    )


def on_ground(plan_states: PlanStates[Air], wind: Wind) -> PlanStates[Ground]:
    """Return plan states in the air mass as the ground sees them, ``[..., W]``."""
    return PlanStates(
        *over_ground(VehicleState(*plan_states[:4]), wind, plan_states.time), plan_states.time
    )


def legs(plan_states: PlanStates[F]) -> Legs[F]:
    """Return the curves between consecutive plan states.

    The controls follow from Gauss-Newton steps on the end position, whose minimum-norm solution is
    known in closed form; heading and speed at the end are met exactly. Each leg is solved by
    itself: results do not depend on what else is in the arrays. Plan states ``[..., W]``, float64,
    finite, times increasing, give legs ``[..., W - 1]``.
    """
    shape = np.shape(plan_states.time)
    if SOLVE_LEGS.ready:
        return _compiled_legs(plan_states, shape)
    # All M legs in one row: x, y, heading, speed and time of both ends, [5, M] each.
    start, end = (
        np.stack([np.asarray(field)[..., part].reshape(-1) for field in plan_states])
        for part in (slice(-1), slice(1, None))
    )
    step = (end[4] - start[4]) / ARCS
    target = end[:2] - start[:2]
    # Yaw rate and acceleration of each arc, [2, M, ARCS]: x and y, and both controls, stand in one
    # array, which halves the calls.
    change = np.stack([wrap(end[2] - start[2], np), end[3] - start[3]])
    mean = (change / (ARCS * step))[..., None]
    controls = np.repeat(mean, ARCS, axis=-1)
    place, motion = np.zeros((2, 2, step.size, ARCS))  # motion: heading and speed
    miss, unsolved = np.zeros(step.size), np.arange(step.size)
    for iteration in range(ITERATIONS + 1):
        part = (
            unsolved if unsolved.size < step.size else slice(None)
        )  # a view while nothing is finished
        seconds, control = step[part, None], controls[:, part]
        moving = start[2:4, part, None] + _before(control * seconds)
        arcs = displacement(*moving, *control, seconds)
        ends = arcs.cumsum(axis=-1)
        off = target[:, part] - ends[..., -1]
        distance = np.hypot(*off)
        place[:, part], motion[:, part], miss[part] = ends - arcs, moving, distance
        # Written so that what is not finite stays unfinished, and shows in its miss.
        going_on = ~(distance <= EXACT)
        if iteration == ITERATIONS or not going_on.any():
            break
        if not going_on.all():
            unsolved, seconds, control = unsolved[going_on], seconds[going_on], control[:, going_on]
            arcs, ends, off = arcs[:, going_on], ends[:, going_on], off[:, going_on]
        controls[:, unsolved] = mean[:, unsolved] + _correction(control, seconds, arcs, ends, off)

    def by_leg(field: Array) -> Array:
        return field.reshape(*shape[:-1], shape[-1] - 1, *field.shape[1:])

    x, y = start[:2, :, None] + place
    return Legs(*map(by_leg, (start[4], ARCS * step, miss, x, y, *motion, *controls)))


def _compiled_legs(plan_states: PlanStates[F], shape: tuple[int, ...]) -> Legs[F]:
    """Return :func:`legs` by compiled code."""
    states = np.array(plan_states, dtype=float).reshape(5, -1, shape[-1])
    rows, count = states.shape[1], shape[-1] - 1
    of_legs, of_arcs = np.empty((3, rows, count)), np.empty((6, rows, count, ARCS))
    together = max(_LEGS // max(count, 1), 1)
    for first in range(0, rows, together):
        SOLVE_LEGS(states, first, min(first + together, rows), of_legs, of_arcs)
    outer = *shape[:-1], count
    return Legs(*of_legs.reshape(3, *outer), *of_arcs.reshape(6, *outer, ARCS))


def _correction(control: Array, seconds: Array, arcs: Array, ends: Array, off: Array) -> Array:
    """Return the controls, less their means, by which legs come nearer to their ends,
    ``[2, M, ARCS]``.

    Args:
        control: yaw rate and acceleration of each arc, ``[2, M, ARCS]``.
        seconds: duration of an arc, ``[M, 1]``.
        arcs: displacement of each, m, ``[2, M, ARCS]``.
        ends: where each ends, from the leg's beginning, m, ``[2, M, ARCS]``.
        off: from the last end to where the leg is to end, m, ``[2, M]``.
    """
    # What a change of each arc's yaw rate does to the end position is a rotation of the rest of the
    # leg; of its acceleration, a push along the rest. Less their means, because the sums of both
    # controls are fixed. [2, 2, M, ARCS]: of each control on x and y.
    remaining = ends[..., -1:] - ends + 0.5 * arcs
    pushed = _from_here(arcs / np.maximum(np.hypot(*arcs), 1e-9) * seconds * seconds)
    effect = _centre(np.stack([remaining[::-1] * _QUARTER * seconds, pushed]))
    # Of all controls that reach the end, those of least weighted norm: effect times the multipliers
    # m of A m = b, with A symmetric.
    of_turn, of_push = (effect * effect).sum(axis=-1)
    a11, a22 = TURN * of_turn + SPEED * of_push
    of_turn, of_push = (effect[:, 0] * effect[:, 1]).sum(axis=-1)
    a12 = TURN * of_turn + SPEED * of_push
    of_turn, of_push = (effect * control[:, None]).sum(axis=-1)
    b1, b2 = of_turn + of_push + off
    determinant = np.maximum(a11 * a22 - a12 * a12, 1e-12)
    m1 = ((a22 * b1 - a12 * b2) / determinant)[:, None]
    m2 = ((a11 * b2 - a12 * b1) / determinant)[:, None]
    return _EACH * (effect[:, 0] * m1 + effect[:, 1] * m2)


def repeat(legs: Legs[F], count: int) -> Legs[F]:
    """Return the legs of one plan, ``[L]``, as so many rows, ``[count, L]``: :func:`at` takes a row
    for each time.
    """
    return map_leaves(lambda field: np.broadcast_to(field, (count, *np.shape(field))), legs)


@overload
def at(legs: Legs[F], time: Array, wind: None = None) -> VehicleState[F]: ...
@overload
def at(legs: Legs[Air], time: Array, wind: Wind) -> VehicleState[Ground]: ...
@overload
def at(legs: Legs[Air], time: Array, wind: Wind | None) -> VehicleState[Any]: ...
def at(legs: Legs[Any], time: Array, wind: Wind | None = None) -> VehicleState[Any]:
    """Return the state on legs ``[..., L]`` at a time (s), ``[...]``, which may have axes before
    those of the legs; before and after the legs their first and last arc go on.

    With the wind whose air mass the legs are in, the state is over the ground.
    """
    leg = np.sum(np.asarray(time)[..., None] >= legs.time[..., 1:], axis=-1)  # all but the first
    *batch_shape, count = np.shape(legs.time)
    shape = np.broadcast_shapes(np.shape(time), tuple(batch_shape))
    number = np.broadcast_to(leg, shape)[..., None]
    full_shape = *shape, count
    began = np.take_along_axis(np.broadcast_to(legs.time, full_shape), number, -1)[..., 0]
    duration = np.take_along_axis(np.broadcast_to(legs.duration, full_shape), number, -1)[..., 0]
    seconds = time - began
    arc = np.clip(np.floor(seconds / duration * ARCS), 0, ARCS - 1).astype(np.intp)
    flat = number[..., 0] * ARCS + arc
    flattened = (field.reshape(*batch_shape, count * ARCS) for field in legs[3:])
    arcs = (np.broadcast_to(field, (*shape, count * ARCS)) for field in flattened)
    piece = _Arc(*(np.take_along_axis(field, flat[..., None], -1)[..., 0] for field in arcs))
    t = seconds - arc * (duration / ARCS)
    dx, dy = displacement(piece.heading, piece.speed, piece.yaw_rate, piece.acceleration, t)
    state: VehicleState[Air] = VehicleState(
        piece.x + dx,
        piece.y + dy,
        wrap(piece.heading + piece.yaw_rate * t, np),
        piece.speed + piece.acceleration * t,
    )
    return state if wind is None else over_ground(state, wind, time)


def displacement(
    heading: Array, speed: Array, yaw_rate: Array, acceleration: Array, duration: Array
) -> Array:
    """Return the displacement of an arc, m, ``[2, ...]``: its velocity integrated by
    Gauss-Legendre's rule.
    """
    # The nodes lead, so that the sum over them is the same whatever the other axes hold.
    seconds = np.multiply.outer(NODES, duration)
    psi = yaw_rate * seconds + heading
    covered = (acceleration * seconds + speed) * np.multiply.outer(WEIGHTS, duration)
    return np.add.reduce(covered * np.stack([np.cos(psi), np.sin(psi)]), axis=1)


def _before(parts: Array) -> Array:
    """Return the sum of the parts before each, ``[..., ARCS]``."""
    return parts.cumsum(axis=-1) - parts


def _from_here(parts: Array) -> Array:
    """Return the sum of the parts after each and half of itself, ``[..., ARCS]``."""
    return parts.sum(axis=-1, keepdims=True) - parts.cumsum(axis=-1) + 0.5 * parts


def _centre(effect: Array) -> Array:
    """Return effects less their means, ``[..., ARCS]``."""
    return effect - effect.sum(axis=-1, keepdims=True) * (1.0 / ARCS)
