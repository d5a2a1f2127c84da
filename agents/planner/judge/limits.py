"""Whether the legs of plans meet their ends and keep the limits of the flight, arc by arc."""

import math
from typing import Any

import numpy as np

from agents.kernel.arcs import are_legs, greater
from envs.arrays import Array, Bool
from envs.compiled import Arguments, Entry
from envs.kinematics import Limits
from envs.trees import contiguous
from envs.waypoints import ARCS, CLOSED, Legs

TOLERANCE = Limits(1e-6, 1e-6, 1e-6, 1e-6, 1e-9)
"""By how much limits may be passed for rounding's sake (m/s, m/s^2, rad/s)."""


def right_legs(
    curves: Legs[Any], limits: Limits
) -> tuple[Bool[Array, "N L"], Bool[Array, "N L"], Bool[Array, "N L"], Bool[Array, "N L"]]:
    """Return which legs end at their waypoints, and keep the limits of speed, of acceleration and
    of turn rate, bool ``[N, L]`` each.
    """
    if FILL_RIGHT_LEGS.ready:
        right = np.empty((4, *curves.miss.shape), dtype=bool)
        FILL_RIGHT_LEGS(contiguous(curves), Limits(*map(float, limits)), right)
        return right[0], right[1], right[2], right[3]
    # Comparisons ask for what is right, so that not-a-number is wrong. A plan beyond a speed limit
    # may stay there, but not go further, nor come back to it: the bounds follow the most moderate
    # speed so far, not that of the arc before, or else the tolerance would add up from arc to arc.
    speed = curves.speed
    after = speed + curves.acceleration * (curves.duration[..., None] / ARCS)
    count, leg_count, arcs = speed.shape
    so_far = speed.reshape(count, leg_count * arcs)
    lowest = np.minimum(limits.speed_min, np.maximum.accumulate(so_far, axis=-1))
    highest = np.maximum(limits.speed_max, np.minimum.accumulate(so_far, axis=-1))
    lowest, highest = lowest.reshape(speed.shape), highest.reshape(speed.shape)
    steady = (after >= lowest - TOLERANCE.speed_min) & (after <= highest + TOLERANCE.speed_max)
    # The bound on the own acceleration is one for flight forwards.
    steady &= (speed >= TOLERANCE.speed_min) & (after >= TOLERANCE.speed_min)
    gentle = (curves.acceleration >= limits.acceleration_min - TOLERANCE.acceleration_min) & (
        curves.acceleration <= limits.acceleration_max + TOLERANCE.acceleration_max
    )
    turning = np.abs(curves.yaw_rate) <= limits.yaw_rate_max + TOLERANCE.yaw_rate_max
    closed = curves.miss <= CLOSED
    return closed, steady.all(-1), gentle.all(-1), turning.all(-1)


def fill_right_legs(curves: Legs[Any], limits: Limits, right: Bool[np.ndarray, "4 N L"]) -> None:
    """Write what :func:`right_legs` returns, ``[4, N, L]``; arrays are contiguous, limits floats.

    Raises:
        ValueError: arrays are of different shapes.
    """
    _, rows, legs = right.shape
    if not are_legs(curves, rows, legs):
        raise ValueError("fields of legs are not of the same shape")
    for row in range(rows):
        fastest, slowest = -math.inf, -math.inf  # so far; the slowest is that of -speed
        for leg in range(legs):
            step = curves.duration[row, leg] / ARCS
            steady = gentle = turning = True
            for arc in range(ARCS):
                speed, gain = curves.speed[row, leg, arc], curves.acceleration[row, leg, arc]
                after = speed + gain * step
                fastest, slowest = greater(speed, fastest), greater(-speed, slowest)
                lowest = -greater(-fastest, -limits.speed_min)
                highest = greater(-slowest, limits.speed_max)
                steady = steady and (
                    lowest - TOLERANCE.speed_min <= after <= highest + TOLERANCE.speed_max
                    and speed >= TOLERANCE.speed_min
                    and after >= TOLERANCE.speed_min
                )
                least = limits.acceleration_min - TOLERANCE.acceleration_min
                gentle = gentle and least <= gain
                gentle = gentle and gain <= limits.acceleration_max + TOLERANCE.acceleration_max
                most = limits.yaw_rate_max + TOLERANCE.yaw_rate_max
                turning = turning and abs(curves.yaw_rate[row, leg, arc]) <= most
            right[0, row, leg] = curves.miss[row, leg] <= CLOSED
            right[1, row, leg], right[2, row, leg], right[3, row, leg] = steady, gentle, turning


def _examples() -> list[Arguments]:
    pairs, arcs = np.zeros((1, 1)), np.zeros((1, 1, ARCS))
    curves: Legs[Any] = Legs(pairs, pairs, pairs, arcs, arcs, arcs, arcs, arcs, arcs)
    return [(curves, Limits(*(0.0,) * 5), np.zeros((4, 1, 1), dtype=bool))]


FILL_RIGHT_LEGS = Entry(fill_right_legs, _examples)
