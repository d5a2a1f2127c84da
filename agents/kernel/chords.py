"""Motion relative to an intruder as chords, and what they tell of the distance and of what is
required; the formulas over ``xp`` are for arrays and for compiled code.

Where two aircraft move on curves, the relative motion leaves the chord between two times h apart by
at most a h^2 / 8, a being the largest relative acceleration (proofs/Bound.v, proofs/Safe.v).
"""

import math
from typing import NamedTuple

import numpy as np

from agents.kernel.traffic import Traffic, positions
from agents.kernel.trajectory import Pieces
from envs.arrays import Array, ArrayModule, Float
from envs.compiled import scalar
from envs.relative import distance
from envs.trees import map_leaves

SECANT = 0.02
"""m by which a secant may be more than what is required."""

BOUND_ERROR = 0.01
"""m by which bounds that leave legs out may be off: tolerance and rounding."""


class Chord(NamedTuple):
    """Pieces of motion relative to an intruder each, as their chords; fields ``[M, P]``."""

    distance: Array  # a lower bound of it, m
    attained: Array  # the smaller distance of both ends, m
    sagitta: Array  # by how much the motion may leave the chord, m
    x: Array  # where the chord begins, m
    y: Array
    dx: Array  # from there to its end, m
    dy: Array
    share: Array  # of the chord at which it is nearest, 0 to 1


def chords(pieces: Pieces, traffic: Traffic) -> Chord:
    """Return pieces ``[M, P]`` relative to an intruder each, ``[M, 1]``, with what is known of the
    distance.
    """
    # Beginnings and ends in one array, [2, M, P]: half the calls, the same bits.
    times = np.stack([pieces.begin, pieces.end])
    x, y = positions(map_leaves(lambda field: field[None], traffic), times)
    x0, x1 = x - np.stack([pieces.x0, pieces.x1])
    y0, y1 = y - np.stack([pieces.y0, pieces.y1])
    turn = np.where(traffic.turn_time > 0.0, np.abs(traffic.state.speed * traffic.turn_rate), 0.0)
    sagitta = largest_sagitta(pieces.bend + turn, pieces.end - pieces.begin, np)
    return chord_of(x0, y0, x1, y1, sagitta, pieces.error, np)


@scalar
def largest_sagitta(
    acceleration: Float[Array, "..."], lasts: Float[Array, "..."], xp: ArrayModule
) -> Float[Array, "..."]:
    """Return by how much motion may leave its chord, m, of a greatest acceleration, m/s^2, that
    lasts so long, s.
    """
    return xp.maximum(acceleration * (0.125 * lasts**2), 1e-12)


@scalar
def chord_of(
    x0: Float[Array, "..."],
    y0: Float[Array, "..."],
    x1: Float[Array, "..."],
    y1: Float[Array, "..."],
    sagitta: Float[Array, "..."],
    error: Float[Array, "..."],
    xp: ArrayModule,
) -> Chord:
    """Return the chord from one relative position to another, m, of motion that may leave it by its
    sagitta, m; positions may be off by ``error``, m; all ``[...]``.
    """
    dx, dy = x1 - x0, y1 - y0
    s = xp.clip(-(x0 * dx + y0 * dy) / xp.maximum(dx * dx + dy * dy, 1e-12), 0.0, 1.0)
    first, last = distance(x0, y0, xp), distance(x1, y1, xp)
    near = distance(x0 + s * dx, y0 + s * dy, xp)
    # A share s of the piece from its beginning, the motion leaves the chord by at most
    # 4 sagitta s (1 - s). Where the chord is nearest at an end, from which the range opens by at
    # least g s, the distance is smaller than there by at most (4 sagitta - g)^2 / (16 sagitta).
    opening = xp.where(s <= 0.0, (x0 * dx + y0 * dy) / xp.maximum(first, 1e-9), 0.0)
    opening = xp.where(s >= 1.0, -(x1 * dx + y1 * dy) / xp.maximum(last, 1e-9), opening)
    loss = xp.maximum(4.0 * sagitta - xp.maximum(opening, 0.0), 0.0) ** 2 / (16.0 * sagitta)
    return Chord(near - loss - error, xp.minimum(first, last), sagitta, x0, y0, dx, dy, s)


@scalar
def least_margin(
    chord: Chord, begin: Float[Array, "..."], end: Float[Array, "..."], xp: ArrayModule
) -> Float[Array, "..."]:
    """Return the smallest distance on chords less what is required, m, which changes evenly from
    one value to another, the second the greater one.
    """
    grows, square = end - begin, xp.maximum(chord.dx * chord.dx + chord.dy * chord.dy, 1e-12)
    nearest = -(chord.x * chord.dx + chord.y * chord.dy) / square
    passing = distance(chord.x + nearest * chord.dx, chord.y + nearest * chord.dy, xp)
    # Nearest to what is required: where the range opens as fast as that grows.
    faster = square > grows * grows
    after = passing * grows / xp.sqrt(square * xp.where(faster, square - grows * grows, 1.0))
    share = xp.clip(xp.where(faster, nearest + after, 1.0), 0.0, 1.0)
    away = distance(chord.x + share * chord.dx, chord.y + share * chord.dy, xp)
    return away - (begin + share * grows)


@scalar
def shares_lost(
    chord: Chord, begin: Float[Array, "..."], end: Float[Array, "..."], xp: ArrayModule
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Return from which share of chords to which less than the required distance is left, which
    changes as for :func:`least_margin`; of chords on which it is; ``[...]`` each.
    """
    grows = end - begin
    a = chord.dx * chord.dx + chord.dy * chord.dy - grows * grows
    b = chord.x * chord.dx + chord.y * chord.dy - begin * grows
    c = chord.x * chord.x + chord.y * chord.y - begin * begin
    root = xp.sqrt(xp.maximum(b * b - a * c, 0.0))
    enters = xp.where(c < 0.0, 0.0, c / xp.where(root > b, root - b, math.inf))
    leaves = xp.where(a > 0.0, (root - b) / xp.where(a > 0.0, a, 1.0), 1.0)
    return xp.clip(enters, 0.0, 1.0), xp.clip(leaves, 0.0, 1.0)
