"""Dynamic programming on a grid: how much separation from one straight intruder can be kept, from
every state.

The frame moves with the intruder, its x axis along the intruder's course, so that the state is the
ownship's position, heading and speed there, and nothing depends on time. The value of a state is
the largest separation that any control history keeps from then on. With u held over a time step it
obeys

    V = max over u of min{ closest approach during the step under u, V after the step }

(as the step shrinks, the Hamilton-Jacobi equation min{ distance - V, max over u of grad V . f } =
0). It is iterated from above until it stays. A turn at full rate and the strongest acceleration
change heading and speed by one node a step, so that position alone is interpolated, bilinearly.
That overestimates where V is convex; holding u over a step underestimates. Both errors vanish with
the grid, which ``eval.boundary`` measures by halving it.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates

from envs.angles import wrap
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import Limits, VehicleState, advance
from envs.relative import leg_separation

CAP = 1.4  # values above this many separations are cut off: they say nothing about the boundary
# Turns right, none, left; strongest deceleration and acceleration (their mixture stands for all
# between).
_CONTROLS = tuple((turn, thrust) for turn in (-1, 0, 1) for thrust in (0, 1))
_TOLERANCE = 2e-5  # separations; no value near the separation changes by more in the last sweep
_MOST_SWEEPS = 100


class Grid(NamedTuple):
    """Nodes of the state; the other half of the headings is the mirror image."""

    x: Array  # ownship minus intruder along the intruder's course, m, [X]
    y: Array  # the same to the left of it, m, [Y]; symmetric about 0
    heading: Array  # own heading minus the intruder's, rad from 0 to pi, [P]
    speed: Array  # own speed, m/s, [S]
    dt: float  # time step, s


class Solution(NamedTuple):
    """A value function and what it is the value of."""

    grid: Grid
    value: Array  # largest separation that can be kept, m, [P, S, X, Y], float32
    limits: Limits
    intruder_speed: float  # m/s
    separation: float  # m
    sweeps: int
    change: float  # largest change in the last sweep of a value below 1.1 separations, m


def make_grid(
    limits: Limits, intruder_speed: float, separation: float, dt: float, cell: float
) -> Grid:
    """Return a grid that contains all states from which the separation (m) from an intruder (m/s)
    cannot be kept.

    A time step ``dt``, s, that is no whole part of a half turn raises ``ValueError``; nodes are a
    ``cell``, m, apart.
    """
    half_turn = math.pi / (limits.yaw_rate_max * dt)
    if abs(half_turn - round(half_turn)) > 1e-6:
        raise ValueError(
            f"dt is {dt:g} s; expected a whole part of a half turn of {half_turn * dt:g} s"
        )
    fast = _time_aside(limits.speed_max, limits.yaw_rate_max, separation)
    slow = _time_aside(limits.speed_min, limits.yaw_rate_max, separation)
    clear = 1.1 * separation + max(limits.speed_max * fast, limits.speed_min * slow)
    ahead = clear + intruder_speed * slow
    first = -math.ceil(clear / cell)
    x = cell * np.arange(first, math.ceil(ahead / cell) + 1)
    y = cell * np.arange(first, -first + 1)
    heading = np.linspace(0.0, math.pi, round(half_turn) + 1)
    span = limits.speed_max - limits.speed_min
    speeds = max(round(span / (limits.acceleration_max * dt)), 1) + 1 if span else 1
    return Grid(x, y, heading, np.linspace(limits.speed_min, limits.speed_max, speeds), dt)


def solve(grid: Grid, limits: Limits, intruder_speed: float, separation: float) -> Solution:
    """Iterate the value until it stays; arguments as of :func:`make_grid`.

    Beyond the edge of the grid the separation counts as kept: right if by :func:`edge_value` no
    lost state touches it.
    """
    cap = np.float32(CAP * separation)
    cell = float(grid.x[1] - grid.x[0])
    steps = [_step(grid, limits, intruder_speed, separation, *control) for control in _CONTROLS]
    margin = 2 + int(max(np.max(np.abs(step.shift)) for step in steps) / cell)
    inner = slice(margin, -margin)
    shape = (grid.heading.size, grid.speed.size, grid.x.size + 2 * margin, grid.y.size + 2 * margin)
    value = np.full(shape, cap, np.float32)
    value[..., inner, inner] = np.minimum(cap, np.hypot(grid.x[:, None], grid.y))
    sweeps, change = 0, math.inf
    while change > _TOLERANCE * separation and sweeps < _MOST_SWEEPS:
        sweeps, change = sweeps + 1, 0.0
        # In place: the iteration falls towards the same value from above, whatever the order.
        for index in np.ndindex(shape[:2]):
            old, new = value[index][inner, inner], _backup(value, index, steps, cell, margin)
            change = float(np.max(old - new, where=new < 1.1 * separation, initial=change))
            old[:] = new
    return Solution(
        grid, value[..., inner, inner], limits, intruder_speed, separation, sweeps, change
    )


def value_at(solution: Solution, x: Array, y: Array, heading: float, speed: float) -> Array:
    """Return the value at states between the nodes, m, ``[...]``, by one more time step from there.

    That keeps the ridge sharp on which two ways out are equally good; interpolating the value
    itself would raise it. The place is ownship minus intruder in the intruder's frame, m; the
    heading (own minus the intruder's, rad in [-pi, pi)) and the speed (own, m/s, within the limits)
    lose nothing by interpolation on a node.
    """
    grid, limits = solution.grid, solution.limits
    own: VehicleState[Air] = VehicleState(
        np.asarray(x, float), np.asarray(y, float), heading, speed
    )
    best = 0.0 * (own.x + own.y)
    intruder, gone = _intruder(best, solution.intruder_speed, grid.dt)
    for turn, thrust in _CONTROLS:
        acceleration = (limits.acceleration_min, limits.acceleration_max)[thrust]
        after = advance(own, acceleration, turn * limits.yaw_rate_max, grid.dt, limits, np)
        near = leg_separation(own, after, intruder, gone, grid.dt, np)
        later = _interpolate(
            solution, after.x - gone.x, after.y, float(after.heading), float(after.speed)
        )
        best = np.maximum(best, np.minimum(near, later))
    return np.minimum(best, CAP * solution.separation)


def edge_value(solution: Solution) -> float:
    """Return the smallest value on the edge of the grid, m."""
    value = solution.value
    return float(min(value[..., [0, -1], :].min(), value[..., [0, -1]].min()))


class _Step(NamedTuple):
    """One control held for one time step, from every heading and speed; ``turn`` in nodes of
    heading.
    """

    turn: int
    shift: Array  # relative displacement, m, [P, S, 2]
    # node of speed at or below the new speed, [S], and the part of the way from there to the next,
    # [S]
    low: Array
    part: Array
    # closest approach during the step from the nodes of a box around the intruder, m, [P, S, B, C],
    # float32
    near: Array
    box: tuple[slice, slice]


def _step(
    grid: Grid, limits: Limits, intruder_speed: float, separation: float, turn: int, thrust: int
) -> _Step:
    acceleration = (limits.acceleration_min, limits.acceleration_max)[thrust]
    heading, speed = np.meshgrid(wrap(grid.heading, np), grid.speed, indexing="ij")
    own: VehicleState[Air] = VehicleState(0.0 * speed, 0.0 * speed, heading, speed)
    moved = advance(own, acceleration, turn * limits.yaw_rate_max, grid.dt, limits, np)
    shift = np.stack([moved.x - intruder_speed * grid.dt, moved.y], axis=-1)
    low, part = zip(*(_place(new_speed, grid.speed) for new_speed in moved.speed[0]), strict=True)

    inside = [np.flatnonzero(np.abs(axis) <= CAP * separation) for axis in (grid.x, grid.y)]
    x, y = grid.x[inside[0], None], grid.y[None, inside[1]]
    near = np.empty((*speed.shape, x.size, y.size), np.float32)
    intruder, gone = _intruder(0.0 * (x + y), intruder_speed, grid.dt)
    for index in np.ndindex(speed.shape):
        begun: VehicleState[Air] = VehicleState(x, y, heading[index], speed[index])
        ended: VehicleState[Air] = VehicleState(
            x + moved.x[index], y + moved.y[index], moved.heading[index], moved.speed[index]
        )
        near[index] = leg_separation(begun, ended, intruder, gone, grid.dt, np)
    box = (slice(inside[0][0], inside[0][-1] + 1), slice(inside[1][0], inside[1][-1] + 1))
    return _Step(turn, shift, low, part, near, box)


def _intruder(zero: Array, speed: float, dt: float) -> tuple[VehicleState[Air], VehicleState[Air]]:
    intruder: VehicleState[Air] = VehicleState(zero, zero, zero, zero + speed)
    return intruder, intruder._replace(x=zero + speed * dt)


def _backup(
    value: Array, index: tuple[int, ...], steps: list[_Step], cell: float, margin: int
) -> Array:
    """Return new values of one heading and speed, ``[X, Y]``, from values with a margin, ``[P, S,
    X', Y']``.
    """
    heading, speed = index
    columns, rows = (size - 2 * margin for size in value.shape[2:])
    best = np.zeros((columns, rows), np.float32)
    for step in steps:
        mirrored, after = _fold(heading + step.turn, value.shape[0])
        low, part = step.low[speed], step.part[speed]
        dx, dy = step.shift[index] / cell
        i, k = margin + math.floor(dx), margin + math.floor(dy)
        tables = value[after, low : low + 2, :, :: -1 if mirrored else 1]
        tables = tables[:, i : i + columns + 1, k : k + rows + 1]
        later = _between(tables, part) if part else tables[0]
        later = _between((later[:-1], later[1:]), dx % 1.0)
        later = _between((later[:, :-1], later[:, 1:]), dy % 1.0)
        np.minimum(later[step.box], step.near[index], out=later[step.box])
        np.maximum(best, later, out=best)
    return best


def _interpolate(solution: Solution, x: Array, y: Array, heading: float, speed: float) -> Array:
    """Return the value interpolated in all of the state, m, ``[...]``; the cap beyond the grid."""
    grid, zero = solution.grid, 0.0 * x
    nodes = ((abs(heading), grid.heading), (speed, grid.speed))
    indices = [zero + np.interp(where, axis, np.arange(axis.size)) for where, axis in nodes]
    cell = grid.x[1] - grid.x[0]
    places = [
        *indices,
        (x - grid.x[0]) / cell,
        (math.copysign(1.0, heading) * y - grid.y[0]) / cell,
    ]
    return map_coordinates(solution.value, places, order=1, cval=CAP * solution.separation)


def _place(where: float, nodes: Array) -> tuple[int, float]:
    """Return the node at or below a place and the part of the way from it to the next, 0 if it is
    on the node.
    """
    place = float(np.interp(where, nodes, np.arange(nodes.size)))
    place = round(place) if abs(place - round(place)) < 1e-5 else place
    return int(place), float(place - int(place))


def _between(pair: Array, part: float) -> Array:
    low, high = pair
    return low + np.float32(part) * (high - low)


def _fold(index: int, count: int) -> tuple[bool, int]:
    """Return whether a heading of the full circle is a mirror image, and of which in [0, pi]."""
    return not 0 <= index < count, (count - 1) - abs((count - 1) - abs(index))


def _time_aside(speed: float, yaw_rate: float, separation: float) -> float:
    """Return how long it takes at a speed, m/s, to move aside by the separation, m, in a turn at
    full rate, rad/s, and straight on, s.
    """
    radius = speed / yaw_rate
    turning = math.acos(max(1.0 - separation / radius, 0.0)) / yaw_rate
    return turning + max(separation - radius, 0.0) / speed
