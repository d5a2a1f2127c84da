"""Areas as the policy sees them: intruders that stand still, or drift, with a separation of their
own.

A disc to be kept out of is seen as an intruder at its centre, whose separation is the radius, what
it has grown by, the clearance and the margin. A polygon is seen as the smallest discs about it: one
about the whole where that is not much larger than a separation, else one about each part of it, cut
across where it is longest. So a long fence is a row of intruders, of which the policy looks at
those that lie in its way, and they move as other intruders do. A nearest point of the edge would
jump along the edge, and a disc about all of a long polygon would hold the ownship.

Holes are not seen, and areas to be kept in are left out. What flies is judged by the areas as they
are (:mod:`agents.kernel.areas`).
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from random import Random
from typing import NamedTuple

import numpy as np

from agents.kernel.areas import ActiveArea
from envs.areas import Circle, Keep, Place, Polygon
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.scenarios.own_separations import LEAST

_LARGEST = 2.0  # separations: radius of a disc that is not cut further
_CUTS = 4  # times that a polygon is cut in two at most
_ROUNDING = 1e-9  # of the radius, and m: by which places on a disc's edge may lie outside of it


class Standing(NamedTuple):
    """What stands in the way, fields ``[..., S]``; what is none never counts."""

    x: Array  # at the request, m
    y: Array
    east: Array  # velocity, m/s
    north: Array
    separation: Array  # to be kept at the request, m
    growth: Array  # of it, m/s
    begin: Array  # from when it counts, s after the request
    end: Array  # until when


class StandingIntruders(NamedTuple):
    """What stands in the way, as intruders at some times; fields ``[..., S]``."""

    state: VehicleState[Air]
    mask: Array  # whether it counts, bool
    distance_scale: Array  # at how much of its distance it counts


class _Disc(NamedTuple):
    """A disc, m."""

    x: float
    y: float
    radius: float


def standing(areas: Sequence[ActiveArea], unit: float, margin: float) -> Standing:
    """Return what areas are to the policy, ``[S]``.

    Args:
        areas: that may be met, in the air mass.
        unit: the aircraft's separation, m.
        margin: to be kept beyond the clearance, m.
    """
    discs = list[Standing]()
    for active in areas:
        if active.area.keep is Keep.IN:
            continue
        for disc in _discs(active.area.shape, unit):
            stands = Standing(
                x=disc.x,
                y=disc.y,
                east=active.area.velocity[0],
                north=active.area.velocity[1],
                separation=disc.radius + active.area.clearance + margin,
                growth=active.area.growth,
                begin=active.begin,
                end=active.end,
            )
            discs.append(stands)
    return Standing(*np.array(discs, dtype=float).reshape(-1, len(Standing._fields)).T)


def as_intruders(standing: Standing, time: Array, unit: float) -> StandingIntruders:
    """Return what stands in the way as intruders at times, s, that broadcast; the unit is the
    aircraft's separation, m.

    Nothing counts as smaller than the smallest separation that policies are trained with.
    """
    needed = standing.separation + standing.growth * time
    mask = (standing.begin <= time) & (standing.end >= time) & (needed > 0.0)
    still = np.zeros(np.shape(needed))
    state: VehicleState[Air] = VehicleState(
        standing.x + standing.east * time,
        standing.y + standing.north * time,
        np.arctan2(standing.north, standing.east) + still,
        np.hypot(standing.east, standing.north) + still,
    )
    return StandingIntruders(state, mask, unit / np.maximum(needed, LEAST * unit))


def _discs(shape: Polygon | Circle, unit: float) -> tuple[_Disc, ...]:
    """Return the discs that a shape is seen as; the unit is the aircraft's separation, m."""
    if isinstance(shape, Circle):
        return (_Disc(shape.x, shape.y, shape.radius),)
    return _discs_about(shape.outer, _LARGEST * unit, _CUTS)


@lru_cache(maxsize=256)
def _discs_about(places: tuple[Place, ...], largest: float, cuts: int) -> tuple[_Disc, ...]:
    """Return the smallest disc about a polygon, or the discs about its parts where it would be
    larger than the largest radius, m; it is cut in two so many times at most.
    """
    disc = _smallest_disc(places)
    if disc.radius <= largest or cuts == 0:
        return (disc,)
    off = np.array(places) - np.mean(places, axis=0)
    along = np.linalg.eigh(off.T @ off).eigenvectors[:, -1]
    far = off @ along
    far = far - 0.5 * (far.min() + far.max())
    halves = (_half(places, far), _half(places, -far))
    return tuple(piece for half in halves for piece in _discs_about(half, largest, cuts - 1))


def _half(places: tuple[Place, ...], far: Array) -> tuple[Place, ...]:
    """Return the part of a polygon on one side of a line: how far from it the corners are, m,
    ``[E]``, is not negative there.
    """
    corners = list[Place]()
    for n, (x, y) in enumerate(places):
        (from_x, from_y), distance, before = places[n - 1], float(far[n]), float(far[n - 1])
        if distance * before < 0.0:
            share = distance / (distance - before)
            corners.append((x + share * (from_x - x), y + share * (from_y - y)))
        if distance >= 0.0:
            corners.append((x, y))
    return tuple(corners)


def _smallest_disc(places: Sequence[Place]) -> _Disc:
    """Return the smallest disc about places.

    A place outside of the disc about those before it is on the edge of the disc about all up to it;
    in a random order that is seldom (Welzl 1991).
    """
    order = list(places)
    Random(0).shuffle(order)
    disc = _Disc(*order[0], 0.0)
    for i, a in enumerate(order):
        if not _is_outside(a, disc):
            continue
        disc = _Disc(*a, 0.0)
        for j, b in enumerate(order[:i]):
            if not _is_outside(b, disc):
                continue
            disc = _through_two(a, b)
            for c in order[:j]:
                if _is_outside(c, disc):
                    disc = _through_three(a, b, c)
    return disc


def _is_outside(place: Place, disc: _Disc) -> bool:
    """Return whether a place is outside of a disc."""
    away = math.hypot(place[0] - disc.x, place[1] - disc.y)
    return away > disc.radius * (1.0 + _ROUNDING) + _ROUNDING


def _through_two(a: Place, b: Place) -> _Disc:
    """Return the disc with two places at the ends of a diameter."""
    radius = 0.5 * math.hypot(a[0] - b[0], a[1] - b[1])
    return _Disc(0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), radius)


def _through_three(a: Place, b: Place, c: Place) -> _Disc:
    """Return the disc with three places on its edge; of places on a line, the disc about the two
    that are farthest apart.
    """
    bx, by, cx, cy = b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]
    b_square, c_square = bx * bx + by * by, cx * cx + cy * cy
    twice = 2.0 * (bx * cy - by * cx)
    if abs(twice) <= _ROUNDING * math.sqrt(b_square * c_square):
        pairs = (_through_two(a, b), _through_two(a, c), _through_two(b, c))
        return max(pairs, key=lambda disc: disc.radius)
    x = (cy * b_square - by * c_square) / twice
    y = (bx * c_square - cx * b_square) / twice
    return _Disc(a[0] + x, a[1] + y, math.hypot(x, y))
