"""Convex polygons given by their supports, and what is left of them outside a disc or beside a
line.

A polygon is {x : n_k . x <= h_k} for the fan of
:data:`agents.resolvability.reachable_bound.DIRECTIONS`; fields of supports are ``[M, D]``, m.
Supports are *consistent*: those of some convex set, so that every side touches it and neighbouring
sides meet in the polygon's corners. Sums, largest values and the results here are consistent again.
"""

import math

import numpy as np

from agents.resolvability.reachable_bound import DIRECTIONS
from envs.arrays import Array

ROUNDING = 1e-6
"""Added to all supports that are computed from corners, m: far more than the arithmetic errs by."""

_NORMAL_X, _NORMAL_Y = np.cos(DIRECTIONS), np.sin(DIRECTIONS)
_COSINE, _SINE = math.cos(DIRECTIONS[1]), math.sin(DIRECTIONS[1])


def outside(supports: Array, x: float, y: float, radius: float) -> tuple[Array, Array]:
    """Shrink polygons, by their supports ``[M, D]``, to the convex hull of what they have outside a
    disc, all m.

    A point of a polygon on the disc's edge can be moved both ways along its tangent without
    entering the disc. So the hull's corners are the polygon's corners outside the disc and the
    points where its sides cross the disc's edge. A polygon inside the union of two discs is so
    emptied by the one after the other. Returned is also whether anything is left, bool ``[M]``
    (supports of what is empty stay).
    """
    corner_x, corner_y = corners(supports)
    corner_x, corner_y = corner_x - x, corner_y - y
    beyond = corner_x * corner_x + corner_y * corner_y - radius * radius
    gone = beyond <= 0.0
    nonempty = ~gone.all(axis=1)
    rows = np.flatnonzero(gone.any(axis=1) & nonempty)
    if not rows.size:
        return supports, nonempty
    corner_x, corner_y, beyond, gone = corner_x[rows], corner_y[rows], beyond[rows], gone[rows]
    side_x, side_y = _next(corner_x) - corner_x, _next(corner_y) - corner_y
    crosses = gone != _next(gone)
    # |corner + part side| = radius; the disc is left by the larger root and entered by the smaller.
    square = np.where(crosses, side_x * side_x + side_y * side_y, 1.0)
    half = corner_x * side_x + corner_y * side_y
    root = np.sqrt(np.maximum(half * half - square * beyond, 0.0))
    part = np.clip(np.where(gone, root - half, -root - half) / square, 0.0, 1.0)
    shrunk = supports.copy()
    shrunk[rows] = (
        _hull(corner_x, corner_y, ~gone, side_x, side_y, part, crosses)
        + x * _NORMAL_X
        + y * _NORMAL_Y
    )
    return shrunk, nonempty


def beside(supports: Array, direction: Array, place: Array) -> Array:
    """Return the supports of the parts of polygons with n_k . x <= place, k being the direction, m,
    ``[M, D]``.

    Some of each polygon must lie on that side.
    """
    corner_x, corner_y = corners(supports)
    beyond = corner_x * _NORMAL_X[direction] + corner_y * _NORMAL_Y[direction] - place[:, None]
    gone = beyond > 0.0
    crosses = gone != _next(gone)
    part = np.clip(beyond / np.where(crosses, beyond - _next(beyond), 1.0), 0.0, 1.0)
    side_x, side_y = _next(corner_x) - corner_x, _next(corner_y) - corner_y
    return _hull(corner_x, corner_y, ~gone, side_x, side_y, part, crosses)


def corners(supports: Array) -> tuple[Array, Array]:
    """Return x and y of the corners between each side and the next, ``[M, D]``."""
    along = (_next(supports) - supports * _COSINE) / _SINE
    return _NORMAL_X * supports - _NORMAL_Y * along, _NORMAL_Y * supports + _NORMAL_X * along


def _hull(
    corner_x: Array,
    corner_y: Array,
    corners: Array,
    side_x: Array,
    side_y: Array,
    part: Array,
    crosses: Array,
) -> Array:
    """Return the supports of the corners kept and of the points at ``part`` of the sides that
    cross, ``[M, D]``.
    """
    x = np.concatenate([corner_x, corner_x + part * side_x], axis=1)
    y = np.concatenate([corner_y, corner_y + part * side_y], axis=1)
    barred = np.where(np.concatenate([corners, crosses], axis=1), 0.0, -np.inf)
    along = [
        np.max(x * nx + y * ny + barred, axis=1)
        for nx, ny in zip(_NORMAL_X, _NORMAL_Y, strict=True)
    ]
    return np.stack(along, axis=1) + ROUNDING


def _next(sides: Array) -> Array:
    return np.roll(sides, -1, axis=1)
