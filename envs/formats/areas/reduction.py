"""Polygons with less: what lies within a rectangle, and rings of fewer points.

A polygon is its rings, arrays ``[P, 2]`` of any unit, the outer ones counter-clockwise and the
holes clockwise; the first point is not repeated.
"""

from collections.abc import Sequence

import numpy as np

from envs.areas import is_inside, signed_size
from envs.arrays import Array

Box = tuple[tuple[float, float], tuple[float, float]]
"""Least and greatest of the first coordinate, and of the second."""

_APART = 1e-9  # nearer than this to a line no point may lie where it cuts


def clip(rings: Sequence[Array], box: Box) -> list[list[Array]]:
    """Return the polygons, each with its outer ring first, that are left of one in a rectangle."""
    pieces = list(rings)
    for axis, (low, high) in enumerate(box):
        for limit, sign in ((low, -1.0), (high, 1.0)):
            pieces = _cut(pieces, axis, limit, sign)
    outer = [[ring] for ring in pieces if signed_size(ring) > 0.0]
    for hole in (ring for ring in pieces if signed_size(ring) < 0.0):
        around = [piece for piece in outer if is_inside(piece[0], hole[0])]
        if not around:
            raise ValueError("a hole lies outside")
        around[0].append(hole)
    return outer


def _cut(rings: Sequence[Array], axis: int, limit: float, sign: float) -> list[Array]:
    """Return the rings of what lies below a limit along an axis, for a sign of -1 above it."""
    while any((np.abs(ring[:, axis] - limit) < _APART).any() for ring in rings):
        limit += 10.0 * sign * _APART
    remaining, chains = list[Array](), list[Array]()
    for ring in rings:
        inside = sign * (limit - ring[:, axis]) > 0.0
        if inside.all():
            remaining.append(ring)
        elif inside.any():
            chains += _chains(ring, inside, axis, limit)
    return remaining + _close(chains, 1 - axis)


def _chains(ring: Array, inside: Array, axis: int, limit: float) -> list[Array]:
    """Return the parts of a ring that are inside, each from the line to the line."""
    points, inside_twice = np.concatenate([ring, ring]), np.concatenate([inside, inside])
    chains = []
    for first in np.flatnonzero(inside & ~np.roll(inside, 1)):
        last = first + int(np.argmin(inside_twice[first:]))  # the next one outside
        before = points[first - 1 if first else len(ring) - 1]
        ends = [
            _crossing(before, points[first], axis, limit),
            _crossing(points[last - 1], points[last], axis, limit),
        ]
        chains.append(np.stack([ends[0], *points[first:last], ends[1]]))
    return chains


def _crossing(a: Array, b: Array, axis: int, limit: float) -> Array:
    point = a + (limit - a[axis]) / (b[axis] - a[axis]) * (b - a)
    point[axis] = limit
    return point


def _close(chains: Sequence[Array], along: int) -> list[Array]:
    """Return the rings that chains from a line to it make with the parts of the line between them:
    in their order along it, each second part is inside.
    """
    ends = [(chain[end][along], n, end) for n, chain in enumerate(chains) for end in (0, -1)]
    ends.sort(key=lambda crossing: crossing[0])
    partner = {
        crossing[1:]: partner_end[1:]
        for pair in zip(ends[::2], ends[1::2], strict=True)
        for crossing, partner_end in (pair, pair[::-1])
    }
    rings, waiting = list[Array](), set(range(len(chains)))
    while waiting:
        first = n = min(waiting)
        parts = []
        while n in waiting:
            waiting.remove(n)
            parts.append(chains[n])
            n, end = partner[n, -1]
            if end != 0:
                raise ValueError("the rings cross themselves or each other")
        if n != first:
            raise ValueError("the rings cross themselves or each other")
        rings.append(np.concatenate(parts))
    return rings


def thin(rings: Sequence[Array], most: int, least: float) -> tuple[list[Array], float]:
    """Return rings of at most so many points in all, and by how much they may leave the given ones.

    The points that are kept are those of Douglas and Peucker (1973). Each part that was left out
    lies within that distance of the edge in its place, so that a point farther from the new rings
    is on the same side of both.

    Args:
        rings: to be thinned.
        most: points.
        least: of the distances that are tried, each twice the one before.
    """
    distance = least
    while True:
        thinned = [ring[_kept_points(ring, distance)] for ring in rings]
        if sum(map(len, thinned)) <= most:
            return thinned, distance
        distance *= 2.0


def _kept_points(ring: Array, distance: float) -> Array:
    """Return which points of a ring are kept, in their order; three at least."""
    far = int(np.argmax(np.hypot(*(ring - ring[0]).T)))
    closed = np.concatenate([ring, ring[:1]])
    keep = np.zeros(len(closed), dtype=bool)
    keep[[0, far]] = True
    parts = [(0, far), (far, len(ring))]
    while parts:
        first, last = parts.pop()
        off = _off(closed[first + 1 : last], closed[first], closed[last])
        if off.size and off.max() > distance:
            middle = first + 1 + int(np.argmax(off))
            keep[middle] = True
            parts += [(first, middle), (middle, last)]
    if keep.sum() < 3:
        keep[int(np.argmax(_off(ring, ring[0], ring[far])))] = True
    return np.flatnonzero(keep[:-1])


def _off(points: Array, a: Array, b: Array) -> Array:
    """Return the distances of points ``[P, 2]`` from the segment from a to b."""
    edge = b - a
    share = np.clip((points - a) @ edge / max(float(edge @ edge), 1e-12), 0.0, 1.0)
    return np.hypot(*(points - a - share[:, None] * edge).T)


def hull(ring: Array) -> Array:
    """Return the convex hull of a ring, counter-clockwise."""
    points = sorted(set(map(tuple, ring.tolist())))
    return np.array(_chain(points)[:-1] + _chain(points[::-1])[:-1])


def _chain(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the part of the hull on the right of the way along sorted points."""
    chain = list[tuple[float, float]]()
    for point in points:
        while len(chain) > 1 and not _turns_left(chain[-2], chain[-1], point):
            chain.pop()
        chain.append(point)
    return chain


def _turns_left(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0
