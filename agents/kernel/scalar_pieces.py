"""Pieces of one trajectory in plain numbers, for compiled code: what
:mod:`agents.kernel.trajectory` computes for many by numpy.
"""

import math

import numpy as np

from agents.kernel.trajectory import FINE, SHARES, WEIGHTS, Pieces, Trajectory
from envs.arrays import Array, Float, Record, Shaped
from envs.compiled import scalar
from envs.scalar_legs import ARCS, scalar_displacement

PIECE = np.dtype([(name, float) for name in Pieces._fields[2:]])
"""A piece: the numbers of :class:`agents.kernel.trajectory.Pieces` after its row and leg."""


@scalar
def write_arcs(flown: Trajectory, row: int, arcs: Shaped[Array, "L ARCS"]) -> None:
    """Write what is left of the arcs of a trajectory at time 0, ``[L, ARCS]``."""
    curves = flown.legs
    for leg in range(len(arcs)):
        step = curves.duration[row, leg] / ARCS
        for number in range(ARCS):
            arc = arcs[leg, number]
            arc.begin = curves.time[row, leg] + number * step
            arc.end = arc.begin + step
            arc.x0, arc.y0 = curves.x[row, leg, number], curves.y[row, leg, number]
            if number < ARCS - 1:
                arc.x1, arc.y1 = curves.x[row, leg, number + 1], curves.y[row, leg, number + 1]
            else:
                arc.x1, arc.y1 = flown.states.x[row, leg + 1], flown.states.y[row, leg + 1]
            arc.heading, arc.speed = (
                curves.heading[row, leg, number],
                curves.speed[row, leg, number],
            )
            arc.yaw_rate = curves.yaw_rate[row, leg, number]
            arc.acceleration = curves.acceleration[row, leg, number]
            arc.bend = flown.bend[row, leg, number]
            arc.error_begin = arc.error = flown.error[row, leg]
            arc.part = step / FINE
            _leave_out_past(arc)


@scalar
def write_whole_legs(flown: Trajectory, row: int, wholes: Shaped[Array, " L"]) -> None:
    """Write what is left of the legs of a trajectory at time 0, ``[L]``, as pieces of uniform
    motion.
    """
    states, curves = flown.states, flown.legs
    for leg in range(len(wholes)):
        whole = wholes[leg]
        whole.begin, whole.end = states.time[row, leg], states.time[row, leg + 1]
        lasts = max(whole.end - whole.begin, 1e-9)
        whole.x0, whole.y0 = states.x[row, leg], states.y[row, leg]
        whole.x1, whole.y1 = states.x[row, leg + 1], states.y[row, leg + 1]
        whole.heading, whole.speed = curves.heading[row, leg, 0], curves.speed[row, leg, 0]
        whole.yaw_rate = curves.yaw_rate[row, leg, 0]
        whole.acceleration = curves.acceleration[row, leg, 0]
        whole.bend = 8.0 * flown.sagitta[row, leg] / lasts**2
        whole.error_begin, whole.error = flown.error_begin[row, leg], flown.error[row, leg]
        whole.part = lasts / (ARCS * FINE)
        _leave_out_past(whole)


@scalar
def _leave_out_past(piece: Record) -> None:
    """Let a piece that began before time 0 begin where it is then."""
    if piece.begin < 0.0 and piece.end > 0.0:
        past = -piece.begin
        east, north = scalar_displacement(
            piece.heading, piece.speed, piece.yaw_rate, piece.acceleration, past
        )
        piece.begin = 0.0
        piece.x0 += east
        piece.y0 += north
        piece.heading += piece.yaw_rate * past
        piece.speed += piece.acceleration * past
        piece.error_begin = piece.error


@scalar
def write_parts(
    arc: Record, x: Float[np.ndarray, " PARTS"], y: Float[np.ndarray, " PARTS"]
) -> None:
    """Write where the parts of an arc begin and end, m, ``[FINE + 1]`` each, as
    :func:`agents.kernel.trajectory.along` does.
    """
    part = (arc.end - arc.begin) / FINE
    x[:], y[:] = 0.0, 0.0
    for node in range(len(SHARES)):
        share, weight = SHARES[node, 0, 0], WEIGHTS[node, 0, 0]
        turn = arc.yaw_rate * (share * part)
        turn_x, turn_y = math.cos(turn), math.sin(turn)
        course_x, course_y = math.cos(arc.heading), math.sin(arc.heading)
        for i in range(FINE + 1):
            covered = (arc.speed + arc.acceleration * (share * (i * part))) * weight
            x[i] += covered * course_x
            y[i] += covered * course_y
            course_x, course_y = (
                course_x * turn_x - course_y * turn_y,
                course_x * turn_y + course_y * turn_x,
            )
    for i in range(FINE + 1):
        x[i] = arc.x0 + x[i] * (i * part)
        y[i] = arc.y0 + y[i] * (i * part)
