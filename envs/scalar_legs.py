"""The legs of few plans in plain floats and loops: what is compiled (:mod:`envs.compiled`) of
:func:`envs.waypoints.legs`, which gives the same by numpy, and says why it is computed so.
"""

import math

import numpy as np

from envs.angles import wrap
from envs.arrays import Array
from envs.backend import FLOATS
from envs.compiled import Arguments, Entry, scalar

ARCS = 10
"""Arcs of a leg."""

TURN, SPEED = 0.02**2, 0.2**2
"""Weights: 0.02 rad/s and 0.2 m/s^2 count alike."""

ITERATIONS, EXACT = 12, 5e-4
"""Steps towards the end at most, and how near to it is enough, m."""

# Gauss-Legendre's rule on [0, 1]: good to 1e-9 m on an arc of a leg of 20 s, to 1e-6 m on one that
# turns by 1 rad.
NODES = 0.5 + 0.5 * np.polynomial.legendre.leggauss(4)[0]
WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(4)[1]


def solve_legs(
    states: np.ndarray, first: int, end: int, of_legs: np.ndarray, of_arcs: np.ndarray
) -> None:
    """Write the legs of some plans.

    Args:
        states: plan states: x, y, heading, speed and time, ``[5, N, W]``.
        first: number of the first plan that is looked at.
        end: number after that of the last.
        of_legs: time, duration and miss of each leg, ``[3, N, W - 1]``.
        of_arcs: x, y, heading, speed, yaw rate and acceleration of each arc, ``[6, N, W - 1,
            ARCS]``.
    """
    moved, ends, effect = np.empty((2, ARCS)), np.empty((2, ARCS)), np.empty((2, 2, ARCS))
    for row in range(first, end):
        for leg in range(of_legs.shape[2]):
            start, target = states[:, row, leg], states[:, row, leg + 1]
            arcs = of_arcs[:, row, leg]
            duration = target[4] - start[4]
            miss = _solve_leg(start, target, arcs, moved, ends, effect)
            of_legs[0, row, leg] = start[4]
            of_legs[1, row, leg] = ARCS * (duration / ARCS)
            of_legs[2, row, leg] = miss


@scalar
def _solve_leg(
    start: np.ndarray,
    target: np.ndarray,
    arcs: np.ndarray,
    moved: np.ndarray,
    ends: np.ndarray,
    effect: np.ndarray,
) -> float:
    """Write the arcs of a leg, ``[6, ARCS]``, from one plan state to another, ``[5]`` each, and
    return by how much it misses its end, m.

    Work is done in displacements of arcs and where they end, ``[2, ARCS]`` each, and in their
    effects on the end, ``[2, 2, ARCS]``.
    """
    step = (target[4] - start[4]) / ARCS
    lasts = ARCS * step if step != 0.0 else math.nan  # compiled code does not divide by 0
    turn = wrap(target[2] - start[2], FLOATS) / lasts
    gain = (target[3] - start[3]) / lasts
    yaw_rate, acceleration = arcs[4], arcs[5]
    yaw_rate[:], acceleration[:] = turn, gain
    miss = math.inf
    for iteration in range(ITERATIONS + 1):
        _fly(start, step, arcs, moved, ends)
        off_x = (target[0] - start[0]) - ends[0, ARCS - 1]
        off_y = (target[1] - start[1]) - ends[1, ARCS - 1]
        miss = math.hypot(off_x, off_y)
        if iteration == ITERATIONS or miss <= EXACT:
            break
        _write_effects(step, moved, ends, effect)
        of_x, of_y = _multipliers(yaw_rate, acceleration, effect, off_x, off_y)
        for arc in range(ARCS):
            yaw_rate[arc] = turn + TURN * (effect[0, 0, arc] * of_x + effect[0, 1, arc] * of_y)
            acceleration[arc] = gain + SPEED * (effect[1, 0, arc] * of_x + effect[1, 1, arc] * of_y)
    return miss


@scalar
def _fly(
    start: np.ndarray, step: float, arcs: np.ndarray, moved: np.ndarray, ends: np.ndarray
) -> None:
    """Write where arcs begin, of which controls and duration are known, how far each leads, and
    where from the leg's beginning it ends.
    """
    turned = gained = x = y = 0.0
    for arc in range(ARCS):
        turn, gain = arcs[4, arc] * step, arcs[5, arc] * step
        turned, gained = turned + turn, gained + gain
        heading, speed = start[2] + (turned - turn), start[3] + (gained - gain)
        dx, dy = scalar_displacement(heading, speed, arcs[4, arc], arcs[5, arc], step)
        x, y = x + dx, y + dy
        arcs[0, arc], arcs[1, arc] = start[0] + (x - dx), start[1] + (y - dy)
        arcs[2, arc], arcs[3, arc] = heading, speed
        moved[0, arc], moved[1, arc], ends[0, arc], ends[1, arc] = dx, dy, x, y


@scalar
def scalar_displacement(
    heading: float, speed: float, yaw_rate: float, acceleration: float, duration: float
) -> tuple[float, float]:
    """Return :func:`envs.waypoints.displacement` of one arc in plain floats, m."""
    x = y = 0.0
    for node in range(len(NODES)):
        seconds = NODES[node] * duration
        psi = yaw_rate * seconds + heading
        covered = (acceleration * seconds + speed) * (WEIGHTS[node] * duration)
        x += covered * math.cos(psi)
        y += covered * math.sin(psi)
    return x, y


@scalar
def _write_effects(step: float, moved: np.ndarray, ends: np.ndarray, effect: np.ndarray) -> None:
    """Write what a change of each arc's yaw rate and of its acceleration does to the end, less the
    means.
    """
    for axis in range(2):
        pushed = effect[1, axis]
        for arc in range(ARCS):
            length = math.hypot(moved[0, arc], moved[1, arc])
            pushed[arc] = moved[axis, arc] / max(length, 1e-9) * step * step
        whole, so_far = sum_of_arcs(pushed), 0.0
        for arc in range(ARCS):
            part = pushed[arc]
            so_far += part
            pushed[arc] = whole - so_far + 0.5 * part
    for arc in range(ARCS):
        rest_x = ends[0, ARCS - 1] - ends[0, arc] + 0.5 * moved[0, arc]
        rest_y = ends[1, ARCS - 1] - ends[1, arc] + 0.5 * moved[1, arc]
        effect[0, 0, arc], effect[0, 1, arc] = -rest_y * step, rest_x * step
    for control in range(2):
        for axis in range(2):
            row = effect[control, axis]
            mean = sum_of_arcs(row) * (1.0 / ARCS)
            for arc in range(ARCS):
                row[arc] -= mean


@scalar
def _multipliers(
    yaw_rate: np.ndarray,
    acceleration: np.ndarray,
    effect: np.ndarray,
    off_x: float,
    off_y: float,
) -> tuple[float, float]:
    """Return by how much the effects on x and on y are taken, of which the least controls are made
    that reach the end, which is missed by (off_x, off_y), m.
    """
    turn_x, turn_y, push_x, push_y = effect[0, 0], effect[0, 1], effect[1, 0], effect[1, 1]
    a11 = TURN * sum_of_arcs(turn_x * turn_x) + SPEED * sum_of_arcs(push_x * push_x)
    a22 = TURN * sum_of_arcs(turn_y * turn_y) + SPEED * sum_of_arcs(push_y * push_y)
    a12 = TURN * sum_of_arcs(turn_x * turn_y) + SPEED * sum_of_arcs(push_x * push_y)
    b1 = sum_of_arcs(turn_x * yaw_rate) + sum_of_arcs(push_x * acceleration) + off_x
    b2 = sum_of_arcs(turn_y * yaw_rate) + sum_of_arcs(push_y * acceleration) + off_y
    determinant = max(a11 * a22 - a12 * a12, 1e-12)
    return (a22 * b1 - a12 * b2) / determinant, (a11 * b2 - a12 * b1) / determinant


@scalar
def sum_of_arcs(parts: Array) -> float:
    """Return the sum of numbers ``[ARCS]``, added in numpy's order: the same bits."""
    total = ((parts[0] + parts[1]) + (parts[2] + parts[3])) + (
        (parts[4] + parts[5]) + (parts[6] + parts[7])
    )
    for arc in range(8, ARCS):
        total += parts[arc]
    return total


def _examples() -> list[Arguments]:
    return [(np.zeros((5, 1, 2)), 0, 1, np.zeros((3, 1, 1)), np.zeros((6, 1, 1, ARCS)))]


SOLVE_LEGS = Entry(solve_legs, _examples)
