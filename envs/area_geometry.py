"""Distances of points and of curves to what an area forbids, batched.

The signed distance is positive where the area allows flight. Between two points it differs by no
more than they are apart. For a part of a curve there is a lower bound: where the part stays within
a sagitta of the chord between its ends, its signed distance is nowhere less than the chord's, less
the sagitta. A chord that meets no edge stays on the side on which it begins. (Theorems
``keeps_near``, ``chord_keeps_sound`` and ``side_carried`` of proofs/Signed.v.) An area that moves
is looked at from its own frame, in which it stands still.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from envs.areas import Area, Circle, Keep, Polygon
from envs.arrays import Array

DEGENERATE = 1e-12
"""Squares of lengths below this, m^2, count as this (proofs/Bound.v, ``TINY``)."""

_CHUNK = 100_000  # pairs of a part and an edge that are looked at together, in the cache


class Edges(NamedTuple):
    """Edges of a polygon, the inside on their left; fields ``[E]``."""

    x: Array  # where they begin, m
    y: Array
    dx: Array  # to where they end, m
    dy: Array


class Box(NamedTuple):
    """The rectangle around a shape, m."""

    west: float
    east: float
    south: float
    north: float


class Parts(NamedTuple):
    """Chords of parts of curves, in an area's own frame; fields ``[M]``, m."""

    x0: Array  # where they begin
    y0: Array
    x1: Array  # where they end
    y1: Array

    @property
    def length(self) -> Array:
        """Of the chords, m."""
        return np.hypot(self.x1 - self.x0, self.y1 - self.y0)


class Distances(NamedTuple):
    """Of parts from what an area forbids, as it is at the request; fields ``[M]``, m."""

    bound: Array  # no point of the chord has a smaller signed distance
    begin: Array  # signed distance of the beginning
    end: Array  # signed distance of the end


@lru_cache(maxsize=256)
def edges(polygon: Polygon) -> Edges:
    """Return the edges of a polygon."""
    rings = [np.array(ring) for ring in polygon.rings]
    begin = np.concatenate(rings)
    end = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    return Edges(*begin.T, *(end - begin).T)


@lru_cache(maxsize=256)
def box(shape: Polygon | Circle) -> Box:
    """Return the rectangle around a shape."""
    if isinstance(shape, Circle):
        r = shape.radius
        return Box(shape.x - r, shape.x + r, shape.y - r, shape.y + r)
    x, y = np.array(shape.outer).T
    return Box(*map(float, (x.min(), x.max(), y.min(), y.max())))


def own_frame(area: Area, x: Array, y: Array, time: Array) -> tuple[Array, Array]:
    """Return places (m) at times since the request (s) in the frame in which the area stands still,
    ``[...]`` each.
    """
    return x - area.velocity[0] * time, y - area.velocity[1] * time


def gain(area: Area) -> float:
    """Return by how much signed distances grow with time because the area does, m/s."""
    return area.growth if area.keep is Keep.IN else -area.growth


def signed_distance(area: Area, x: Array, y: Array, time: Array = 0.0) -> Array:
    """Return the distance of places from what the area forbids at times since the request, m,
    ``[...]``; negative where they are inside of it.

    It is exact while the area does not grow, and outside of one that grows; elsewhere what is
    forbidden is at least so far away.
    """
    x, y, time = np.broadcast_arrays(*(np.asarray(value, dtype=float) for value in (x, y, time)))
    at_x, at_y = own_frame(area, x, y, time)
    standing_distance = _signed_distances(area, at_x.ravel(), at_y.ravel()).reshape(x.shape)
    return standing_distance + gain(area) * time


def _signed_distances(area: Area, x: Array, y: Array) -> Array:
    """Return signed distances of places ``[M]`` in the area's own frame, without growth."""
    sign = -1.0 if area.keep is Keep.IN else 1.0
    if isinstance(area.shape, Circle):
        return sign * (np.hypot(x - area.shape.x, y - area.shape.y) - area.shape.radius)
    lines = edges(area.shape)
    distances = np.empty(x.shape)
    for rows in _chunks(x.size, lines.x.size):
        nearest = _to_edges(lines, x[rows], y[rows])
        distances[rows] = np.where(inside(lines, x[rows], y[rows]), -nearest, nearest)
    return sign * distances


def chord_distances(area: Area, parts: Parts, enough: Array = np.inf) -> Distances:
    """Return a lower bound of the signed distance on each chord, and that of its ends.

    A part of a curve that stays within a sagitta of its chord has a signed distance of at least the
    bound less the sagitta. Parts that follow one another should stand in their order: on which side
    of the edges they are is then found once for all of them.

    Args:
        enough: bounds that need not be better, m, ``[M]``: where the distances of the ends and the
            chord's length show as much, nothing more is computed.
    """
    if isinstance(area.shape, Circle):
        return _of_circle(area, area.shape, parts)
    lines = edges(area.shape)
    enough = np.broadcast_to(enough, parts.x0.shape)
    whole = Distances(*(np.empty(parts.x0.shape) for _ in Distances._fields))
    for rows in _chunks(parts.x0.size, lines.x.size):
        distances = _of_polygon(area, lines, Parts(*(field[rows] for field in parts)), enough[rows])
        for into, values in zip(whole, distances, strict=True):
            into[rows] = values
    return whole


def box_distance(area: Area, parts: Parts) -> Array:
    """Return a lower bound of the distance of chords from the rectangle around an area to be kept
    out of, m, ``[...]``; 0 where they may meet it.
    """
    around = box(area.shape)
    east = np.maximum(
        around.west - np.maximum(parts.x0, parts.x1), np.minimum(parts.x0, parts.x1) - around.east
    )
    north = np.maximum(
        around.south - np.maximum(parts.y0, parts.y1), np.minimum(parts.y0, parts.y1) - around.north
    )
    return np.hypot(np.maximum(east, 0.0), np.maximum(north, 0.0))


def inside(lines: Edges, x: Array, y: Array) -> Array:
    """Return whether places ``[M]`` are inside.

    The angles under which the edges are seen add up to one turn inside and to none outside; the sum
    cannot change without touching an edge (proofs/Area.v, ``winding_constant``).
    """
    return np.abs(winding(lines, x, y)) > np.pi


def winding(lines: Edges, x: Array, y: Array) -> Array:
    """Return the sum of the angles under which the edges are seen from places ``[M]``, rad."""
    ax, ay = lines.x - x[:, None], lines.y - y[:, None]
    bx, by = ax + lines.dx, ay + lines.dy
    return np.arctan2(ax * by - ay * bx, ax * bx + ay * by).sum(axis=1)


def _of_circle(area: Area, disc: Circle, parts: Parts) -> Distances:
    """Return the distances of parts ``[M]`` where the area is a disc."""
    x0, y0, x1, y1 = parts.x0 - disc.x, parts.y0 - disc.y, parts.x1 - disc.x, parts.y1 - disc.y
    begin, end = np.hypot(x0, y0), np.hypot(x1, y1)
    if area.keep is Keep.IN:  # the farthest point of a chord is one of its ends
        return Distances(
            disc.radius - np.maximum(begin, end), disc.radius - begin, disc.radius - end
        )
    nearest = np.sqrt(_squares(x0, y0, x1 - x0, y1 - y0))
    return Distances(nearest - disc.radius, begin - disc.radius, end - disc.radius)


def _of_polygon(area: Area, lines: Edges, parts: Parts, enough: Array) -> Distances:
    """Return the distances of parts ``[M]`` where the area is a polygon with these edges."""
    follows = np.append((parts.x1[:-1] == parts.x0[1:]) & (parts.y1[:-1] == parts.y0[1:]), False)
    begin = _to_edges(lines, parts.x0, parts.y0)
    end = np.roll(begin, -1)
    end[~follows] = _to_edges(lines, parts.x1[~follows], parts.y1[~follows])
    length = parts.length
    # Along a chord a distance falls by a metre a metre at most.
    least = 0.5 * (begin + end - length)
    apart = least.copy()
    near = np.flatnonzero(~(least > np.maximum(enough, 0.0)))
    if near.size:
        nearby = Parts(*(field[near] for field in parts))
        apart[near] = np.minimum(np.minimum(begin, end)[near], _to_chords(lines, nearby))
    meets = ~(apart > 0.0)
    first, last = _sides(lines, parts, meets, follows)
    if area.keep is Keep.IN:
        first, last = ~first, ~last
    begin, end = np.where(first, -begin, begin), np.where(last, -end, end)
    crossed = 0.5 * (begin + end - length)
    return Distances(np.where(meets | first, crossed, apart), begin, end)


def _sides(lines: Edges, parts: Parts, meets: Array, follows: Array) -> tuple[Array, Array]:
    """Return whether chords ``[M]`` begin and whether they end inside.

    Args:
        meets: which may meet an edge, bool ``[M]``.
        follows: at whose end the next one begins, bool ``[M]``.
    """
    # A chord that meets no edge ends on the side on which it begins, and the next one begins there.
    continues = np.append(False, (follows & ~meets)[:-1])
    heads = np.flatnonzero(~continues)
    first = inside(lines, parts.x0[heads], parts.y0[heads])[np.cumsum(~continues) - 1]
    last = first.copy()
    last[meets] = inside(lines, parts.x1[meets], parts.y1[meets])
    return first, last


def _to_edges(lines: Edges, x: Array, y: Array) -> Array:
    """Return the distances of places ``[M]`` from the nearest edge, m."""
    squares = _squares(lines.x - x[:, None], lines.y - y[:, None], lines.dx, lines.dy)
    return np.sqrt(squares.min(axis=1))


def _to_chords(lines: Edges, parts: Parts) -> Array:
    """Return the distances of chords from the nearest corner, m, ``[M]``; 0 where an edge crosses
    the chord.

    Together with the distances of the chord's ends from the edges that is the distance between
    chord and edges (proofs/Area.v, ``edge_distance_sound``).
    """
    x, y = parts.x0[:, None] - lines.x, parts.y0[:, None] - lines.y
    dx, dy = (parts.x1 - parts.x0)[:, None], (parts.y1 - parts.y0)[:, None]
    nearest = np.sqrt(_squares(x, y, dx, dy).min(axis=1))
    begin = lines.dx * y - lines.dy * x
    end = lines.dx * (y + dy) - lines.dy * (x + dx)
    corner = dy * x - dx * y
    next_corner = corner + dx * lines.dy - dy * lines.dx
    return np.where(((begin * end < 0.0) & (corner * next_corner < 0.0)).any(axis=1), 0.0, nearest)


def _squares(x: Array, y: Array, dx: Array, dy: Array) -> Array:
    """Return the squared distances of the origin from segments from (x, y) to (x + dx, y + dy),
    m^2, ``[...]``.
    """
    share = (x * dx + y * dy) / -np.maximum(dx * dx + dy * dy, DEGENERATE)
    share = np.minimum(np.maximum(share, 0.0), 1.0)
    x, y = x + share * dx, y + share * dy
    return x * x + y * y


def _chunks(parts: int, lines: int) -> list[slice]:
    """Return slices of so many parts that fit into the cache with all edges."""
    size = max(_CHUNK // lines, 1)
    return [slice(start, start + size) for start in range(0, parts, size)]
