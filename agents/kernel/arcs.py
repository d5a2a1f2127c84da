"""Bounds of what the arcs of legs do between their ends: formulas over ``xp``, and a loop over all
of them for compiled code (:mod:`envs.compiled`), which gives what
:func:`agents.kernel.trajectory.trajectory` gives by numpy.
"""

import math

import numpy as np

from envs.arrays import Array, ArrayModule, Float
from envs.backend import FLOATS
from envs.compiled import Arguments, Entry, scalar
from envs.relative import distance
from envs.scalar_legs import ARCS, sum_of_arcs
from envs.waypoints import Legs, PlanStates


@scalar
def quickest(
    speed: Float[Array, "..."],
    acceleration: Float[Array, "..."],
    lasts: Float[Array, "..."],
    xp: ArrayModule,
) -> Float[Array, "..."]:
    """Return the greatest speed on arcs that begin with a speed, m/s, and last so long, s."""
    return xp.maximum(speed, speed + acceleration * lasts)


@scalar
def greatest_acceleration(
    speed: Float[Array, "..."],
    yaw_rate: Float[Array, "..."],
    acceleration: Float[Array, "..."],
    lasts: Float[Array, "..."],
    xp: ArrayModule,
) -> Float[Array, "..."]:
    """Return a bound of the acceleration on arcs, along and across, m/s^2."""
    return distance(acceleration, quickest(speed, acceleration, lasts, xp) * yaw_rate, xp)


@scalar
def quadrature_error(
    speed: Float[Array, "..."],
    yaw_rate: Float[Array, "..."],
    acceleration: Float[Array, "..."],
    lasts: Float[Array, "..."],
    xp: ArrayModule,
) -> Float[Array, "..."]:
    """Return the error of positions on arcs by Gauss-Legendre's rule, m.

    Proven in proofs/Quadrature.v (``position_error_bound_sound``).
    """
    half = 0.5 * lasts
    turn, gain = xp.abs(yaw_rate * half), xp.abs(acceleration) * half
    square = turn * turn
    return (
        2.0
        / 9.0
        * half
        * (quickest(speed, acceleration, lasts, xp) * turn / 40320.0 + gain / 5040.0)
        * (square * square * square * turn)
    )


def fill_bounds(
    states: PlanStates,
    curves: Legs,
    bend: Float[np.ndarray, "N L ARCS"],
    sagitta: Float[np.ndarray, "N L"],
    error: Float[np.ndarray, "N L"],
) -> None:
    """Write the bounds of :class:`agents.kernel.trajectory.Trajectory`; the arrays are contiguous.

    Raises:
        ValueError: the legs are not those of so many states.
    """
    rows, legs = sagitta.shape
    right = states.x.shape == (rows, legs + 1) and states.y.shape == (rows, legs + 1)
    if not (right and are_legs(curves, rows, legs)):
        raise ValueError("states and legs are not of the same shape")
    errors = np.empty(ARCS)
    for row in range(rows):
        for leg in range(legs):
            step = curves.duration[row, leg] / ARCS
            far = most = 0.0
            turns = False
            for arc in range(ARCS):
                yaw_rate, share = curves.yaw_rate[row, leg, arc], arc / ARCS
                speed, gain = curves.speed[row, leg, arc], curves.acceleration[row, leg, arc]
                turns = turns or yaw_rate != 0.0
                bend[row, leg, arc] = greatest_acceleration(speed, yaw_rate, gain, step, FLOATS)
                errors[arc] = quadrature_error(speed, yaw_rate, gain, step, FLOATS)
                even_x = states.x[row, leg] * (1.0 - share) + states.x[row, leg + 1] * share
                even_y = states.y[row, leg] * (1.0 - share) + states.y[row, leg + 1] * share
                x, y = curves.x[row, leg, arc] - even_x, curves.y[row, leg, arc] - even_y
                far, most = greater(x * x + y * y, far), greater(bend[row, leg, arc], most)
            sagitta[row, leg] = math.sqrt(far) + 0.125 * most * step**2
            error[row, leg] = curves.miss[row, leg] + (sum_of_arcs(errors) if turns else 0.0)


@scalar
def are_legs(curves: Legs, rows: int, legs: int) -> bool:
    """Return whether the arrays of so many legs of so many plans have the shapes that they must
    have: compiled code would notice nothing.
    """
    right = True
    for field in curves[:3]:
        right = right and field.shape == (rows, legs)
    for field in curves[3:]:
        right = right and field.shape == (rows, legs, ARCS)
    return right


@scalar
def greater(value: float, so_far: float) -> float:
    """Return the greater number; not a number where there is any."""
    return value if value > so_far or math.isnan(value) else so_far


def _examples() -> list[Arguments]:
    points, pairs, arcs = np.zeros((1, 2)), np.zeros((1, 1)), np.zeros((1, 1, ARCS))
    states = PlanStates(points, points, points, points, points)
    curves = Legs(pairs, pairs, pairs, arcs, arcs, arcs, arcs, arcs, arcs)
    return [(states, curves, arcs, pairs, pairs)]


FILL_BOUNDS = Entry(fill_bounds, _examples)
