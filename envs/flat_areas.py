"""Areas in arrays of numbers, and the distances of chords to them in plain floats: what compiled
code takes of :mod:`envs.area_geometry`, by the same rules.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from envs.area_geometry import DEGENERATE, Edges, box, edges, gain
from envs.areas import Area, Circle, Keep
from envs.arrays import Array, Record
from envs.backend import FLOATS
from envs.compiled import records, scalar
from envs.relative import distance


class FlatArea(NamedTuple):
    """An area and what is kept from it; a record, or columns ``[A]``."""

    sign: Array  # 1 of an area to be kept out of, -1 of one to be kept in
    x: Array  # centre of a circle, m
    y: Array
    radius: Array
    west: Array  # the rectangle around it, m
    east: Array
    south: Array
    north: Array
    vx: Array  # m/s
    vy: Array
    gain: Array  # by which signed distances grow with time, m/s
    first_edge: Array  # of a polygon
    end_edge: Array  # the one after its last; of a circle the first
    begin: Array  # from when it counts, s
    end: Array
    required: Array  # signed distance, m


def flat(areas: Sequence[Area], begin: Array, end: Array, required: Array) -> tuple[Array, Array]:
    """Return areas as records of :class:`FlatArea`, ``[A]``, and the edges of all polygons as
    records of :class:`envs.area_geometry.Edges`, ``[E]``.
    """
    no_edges = Edges(*np.zeros((4, 0)))
    lines = [no_edges if isinstance(area.shape, Circle) else edges(area.shape) for area in areas]
    last = np.cumsum([0, *(line.x.size for line in lines)])
    columns = np.reshape([_numbers(area) for area in areas], (-1, 11)).T
    flat_areas = FlatArea(
        *columns,
        first_edge=last[:-1],
        end_edge=last[1:],
        begin=begin,
        end=end,
        required=required,
    )
    joined = Edges(*(np.concatenate(field) for field in zip(no_edges, *lines, strict=True)))
    return records(flat_areas._asdict()), records(joined._asdict())


def _numbers(area: Area) -> tuple[float, ...]:
    """Return the first fields of :class:`FlatArea`."""
    shape, sign = area.shape, -1.0 if area.keep is Keep.IN else 1.0
    circle = (shape.x, shape.y, shape.radius) if isinstance(shape, Circle) else (0.0, 0.0, 0.0)
    return sign, *circle, *box(shape), *area.velocity, gain(area)


@scalar
def scalar_box_distance(area: FlatArea, x: float, y: float) -> float:
    """Return the distance of a place in an area's own frame from the rectangle around it, m."""
    east = max(area.west - x, x - area.east, 0.0)
    north = max(area.south - y, y - area.north, 0.0)
    return math.sqrt(east * east + north * north)


@scalar
def box_distance_of_chord(area: FlatArea, x0: float, y0: float, x1: float, y1: float) -> float:
    """Return :func:`envs.area_geometry.box_distance` of a chord in an area's own frame, m."""
    east = max(area.west - max(x0, x1), min(x0, x1) - area.east, 0.0)
    north = max(area.south - max(y0, y1), min(y0, y1) - area.north, 0.0)
    return math.sqrt(east * east + north * north)


SIDE = np.dtype([("x", float), ("y", float), ("inside", bool)])
"""A place in an area's own frame, m, and whether it is inside the polygon."""


@scalar
def chord_bound(
    area: FlatArea, lines: Array, x0: float, y0: float, x1: float, y1: float, enough: float
) -> float:
    """Return the bound that :func:`envs.area_geometry.chord_distances` gives of a chord in an
    area's own frame, m, for a search: on which side of a polygon's edges it is, rays tell.
    """
    if area.first_edge == area.end_edge:
        return _circle_distances(area, x0, y0, x1, y1)[0]
    begin, end, apart = _edge_distances(area, lines, (x0, y0, x1, y1), enough)
    begins_inside = ends_inside = _ray_leaves(area, lines, x0, y0)
    if not apart > 0.0:
        ends_inside = _ray_leaves(area, lines, x1, y1)
    length = distance(x1 - x0, y1 - y0, FLOATS)
    return _signed(area, begin, end, apart, length, begins_inside, ends_inside)[0]


@scalar
def scalar_chord_distances(
    area: FlatArea,
    lines: Array,
    x0: float,
    y0: float,
    x1: float,
    y1: float,
    enough: float,
    side: Record,
) -> tuple[float, float, float]:
    """Return :func:`envs.area_geometry.chord_distances` of a chord in an area's own frame, m.

    On which side of a polygon's edges it is, the winding tells as there, since this decides whether
    plans are safe: the proof is of the winding (proofs/Area.v, ``winding_constant``). It takes
    several times as long as rays do. On which ``side`` a chord ends, a :data:`SIDE`, the next one
    is told.
    """
    if area.first_edge == area.end_edge:
        return _circle_distances(area, x0, y0, x1, y1)
    begin, end, apart = _edge_distances(area, lines, (x0, y0, x1, y1), enough)
    begins_inside = side.inside
    if not (side.x == x0 and side.y == y0):
        begins_inside = _winds(area, lines, x0, y0)
    # A chord that meets no edge ends on the side on which it begins.
    ends_inside = begins_inside if apart > 0.0 else _winds(area, lines, x1, y1)
    side.x, side.y, side.inside = x1, y1, ends_inside
    length = distance(x1 - x0, y1 - y0, FLOATS)
    return _signed(area, begin, end, apart, length, begins_inside, ends_inside)


@scalar
def _edge_distances(
    area: FlatArea, lines: Array, chord: tuple[float, float, float, float], enough: float
) -> tuple[float, float, float]:
    """Return the distances of the ends of a chord from the edges of a polygon, and a lower bound of
    that of the chord, m; not above 0 where it may meet one.
    """
    x0, y0, x1, y1 = chord
    if math.isnan(x0 + y0 + x1 + y1):  # smallest numbers would leave it out
        return math.nan, math.nan, math.nan
    begin, end = math.inf, math.inf
    for e in range(int(area.first_edge), int(area.end_edge)):
        line = lines[e]
        begin = min(begin, _square(line.x - x0, line.y - y0, line.dx, line.dy))
        end = min(end, _square(line.x - x1, line.y - y1, line.dx, line.dy))
    begin, end = math.sqrt(begin), math.sqrt(end)
    dx, dy = x1 - x0, y1 - y0
    # Along a chord a distance falls by a metre a metre at most.
    apart = 0.5 * (begin + end - distance(dx, dy, FLOATS))
    if not apart > max(enough, 0.0):
        apart = min(begin, end, _corner_distance(area, lines, x0, y0, dx, dy))
    return begin, end, apart


@scalar
def _signed(
    area: FlatArea,
    begin: float,
    end: float,
    apart: float,
    length: float,
    begins_inside: bool,
    ends_inside: bool,
) -> tuple[float, float, float]:
    """Return the bound of a chord so long, and the signed distances of its ends, m."""
    inwards = area.sign < 0.0
    first = begin if begins_inside == inwards else -begin
    last = end if ends_inside == inwards else -end
    if apart > 0.0 and begins_inside == inwards:
        return apart, first, last
    return 0.5 * (first + last - length), first, last


@scalar
def _circle_distances(
    area: FlatArea, x0: float, y0: float, x1: float, y1: float
) -> tuple[float, float, float]:
    """Return the bound of a chord where the area is a disc, and the signed distances of its ends,
    m.
    """
    x0, y0, x1, y1 = x0 - area.x, y0 - area.y, x1 - area.x, y1 - area.y
    begin, end = math.sqrt(x0 * x0 + y0 * y0), math.sqrt(x1 * x1 + y1 * y1)
    if area.sign < 0.0:  # the farthest point of a chord is one of its ends
        return area.radius - max(begin, end), area.radius - begin, area.radius - end
    nearest = math.sqrt(_square(x0, y0, x1 - x0, y1 - y0))
    return nearest - area.radius, begin - area.radius, end - area.radius


@scalar
def _corner_distance(
    area: FlatArea, lines: Array, x0: float, y0: float, dx: float, dy: float
) -> float:
    """Return the distance of a chord, from a place along (dx, dy), from the nearest corner of a
    polygon, m; 0 where an edge crosses it.
    """
    nearest = math.inf
    for e in range(int(area.first_edge), int(area.end_edge)):
        line = lines[e]
        x, y = x0 - line.x, y0 - line.y
        begin = line.dx * y - line.dy * x
        end = line.dx * (y + dy) - line.dy * (x + dx)
        corner = dy * x - dx * y
        next_corner = corner + dx * line.dy - dy * line.dx
        if begin * end < 0.0 and corner * next_corner < 0.0:
            return 0.0
        nearest = min(nearest, _square(x, y, dx, dy))
    return math.sqrt(nearest)


@scalar
def _winds(area: FlatArea, lines: Array, x: float, y: float) -> bool:
    """Return :func:`envs.area_geometry.inside` of a place; nothing winds about one beyond the
    rectangle.
    """
    if scalar_box_distance(area, x, y) > 0.0:
        return False
    winding = 0.0
    for e in range(int(area.first_edge), int(area.end_edge)):
        line = lines[e]
        ax, ay = line.x - x, line.y - y
        bx, by = ax + line.dx, ay + line.dy
        winding += math.atan2(ax * by - ay * bx, ax * bx + ay * by)
    return abs(winding) > math.pi


@scalar
def _ray_leaves(area: FlatArea, lines: Array, x: float, y: float) -> bool:
    """Return whether a place lies inside a polygon: a ray from it to the east crosses an odd number
    of edges.
    """
    odd = False
    for e in range(int(area.first_edge), int(area.end_edge)):
        line = lines[e]
        south = line.y - y
        north = south + line.dy
        if (south > 0.0) != (north > 0.0):
            turn = (line.x - x) * line.dy - south * line.dx
            odd = odd != ((turn > 0.0) == (north > south))
    return odd


@scalar
def _square(x: float, y: float, dx: float, dy: float) -> float:
    """Return the squared distance of the origin from the segment from (x, y) along (dx, dy),
    m^2.
    """
    share = (x * dx + y * dy) / -max(dx * dx + dy * dy, DEGENERATE)
    share = min(max(share, 0.0), 1.0)
    x, y = x + share * dx, y + share * dy
    return x * x + y * y
