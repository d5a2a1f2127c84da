"""Areas of the ellipsoid on the plane of a local frame.

What is too wide, or has too many points, is reduced on the safe side: of an area to be kept out of
what lies near counts, and a ring that is thinned adds to the clearance by how much it is off.
"""

import math
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from datetime import datetime
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from envs.areas import (
    LARGEST_RADIUS,
    MOST_POINTS,
    Area,
    AreaError,
    Circle,
    Keep,
    Place,
    Polygon,
    RingError,
    check_simple,
    signed_size,
)
from envs.arrays import Array
from envs.formats.areas.geodetic import OFF, GeodeticArea
from envs.formats.areas.reduction import Box, clip, hull, thin
from envs.formats.local_frame import LocalFrame, distance, wgs84

WITHIN = 100_000.0
"""Distance from the frame's origin beyond which areas to be kept out of are left out, m."""

_WIDE = 60_000.0  # m: what is wider is clipped
_MOST = 100_000  # points of a ring in the local frame
_DEGREE = 111_000.0  # m, about, of latitude
_LEAST_DEGREE = 110_500.0  # m: no degree of latitude is shorter
_LARGEST = 1_000_000.0  # m of a radius
_SIDES = 360  # of the polygon in place of a large circle

Rings = tuple[tuple[Place, ...], ...]
Shape = Polygon | Circle


class Shapes(NamedTuple):
    """Where an area is in a local frame."""

    shapes: tuple[Shape, ...]  # none: it lies too far from the origin
    added: float = 0.0  # to the clearance, m
    change: str = ""  # what was done to it; empty: nothing


class Placement(NamedTuple):
    """The areas of a local frame."""

    areas: tuple[Area, ...]
    changes: tuple[str, ...]  # sentences: which areas were clipped or thinned
    far: tuple[GeodeticArea, ...]  # those that were left out


def to_plane(
    stated: Iterable[GeodeticArea], frame: LocalFrame, time: datetime | None, within: float
) -> Placement:
    """Return areas in a local frame at the time of the request; those to be kept out of that lie
    farther than ``within`` (m) from the origin are left out.

    Raises:
        AreaError: one of them cannot be used.
    """
    areas, changes, far = list[Area](), list[str](), list[GeodeticArea]()
    for area in stated:
        with error_place(area.where):
            placed = _place(area, frame, within)
            areas += (_area(area, shape, placed.added, time) for shape in placed.shapes)
        if placed.change:
            changes.append(f"{area.where}: {placed.change}")
        if not placed.shapes:
            far.append(area)
    return Placement(tuple(areas), tuple(changes), tuple(far))


def far_away(far: Sequence[GeodeticArea], frame: LocalFrame, within: float) -> str:
    """Return a sentence on areas that were left out, with the distance of the nearest."""
    nearest = min(_distance(area, frame) for area in far)
    says = (
        f"{len(far)} {'area lies' if len(far) == 1 else 'areas lie'} more than {within / 1e3:.0f} "
        f"km from the origin ({frame.latitude:.4f}, {frame.longitude:.4f}), the nearest "
        f"{nearest / 1e3:.0f} km"
    )
    exchanged = min(
        (_distance(area, frame) for area in map(_exchange, far) if area), default=nearest
    )
    if exchanged <= within < nearest:
        says += f"; with latitude and longitude exchanged it would be {exchanged / 1e3:.0f} km"
    return says


@contextmanager
def error_place(where: str) -> Generator[None]:
    """Say in an error of an area where it stands."""
    try:
        yield
    except AreaError as problem:
        raise AreaError(f"{where}: {problem}") from None


def _distance(area: GeodeticArea, frame: LocalFrame) -> float:
    """Return the distance of an area's nearest point that the file states from the origin, m."""
    places = [area.centre] if area.centre is not None else sum(area.rings, ())
    origin = frame.latitude, frame.longitude
    return max(min(distance(*origin, *place) for place in places) - area.radius, 0.0)


def _exchange(area: GeodeticArea) -> GeodeticArea | None:
    """Return an area with latitude and longitude exchanged; None where that cannot be."""
    places = [area.centre] if area.centre is not None else sum(area.rings, ())
    if any(abs(longitude) > 90.0 for _, longitude in places):
        return None
    turned = tuple((longitude, latitude) for latitude, longitude in places)
    return area._replace(rings=(turned,), centre=None if area.centre is None else turned[0])


def _area(area: GeodeticArea, shape: Shape, added: float, time: datetime | None) -> Area:
    """Return an area that has a shape in the local frame."""
    fields = dict(area.more)
    if time is not None and area.period.begin is not None:
        fields["valid_from"] = (area.period.begin - time).total_seconds()
    if time is not None and area.period.end is not None:
        fields["valid_until"] = (area.period.end - time).total_seconds()
    if added:
        fields["clearance"] = fields.get("clearance", 0.0) + added
    return Area(shape, area.keep, floor=area.floor, ceiling=area.ceiling, name=area.name, **fields)


def _place(area: GeodeticArea, frame: LocalFrame, within: float) -> Shapes:
    stands = not area.more.get("growth") and not any(area.more.get("velocity", ()))
    if area.centre is not None and area.radius <= LARGEST_RADIUS:
        centre = frame.place(*map(np.array, area.centre))
        x, y = float(centre.x), float(centre.y)
        if area.keep is Keep.OUT and math.hypot(x, y) - area.radius > within:
            return Shapes(())
        return Shapes((Circle(x, y, area.radius),))
    rings = (
        area.rings if area.centre is None else (_ring_about(area.centre, area.radius, area.keep),)
    )
    return _place_polygon(rings, area.keep, frame, within, stands)


@lru_cache(maxsize=1024)
def _place_polygon(
    rings: Rings, keep: Keep, frame: LocalFrame, within: float, stands: bool
) -> Shapes:
    """Return where a polygon is; kept, since those of a file are placed with every request."""
    degrees = [_unwrap(np.array(ring, dtype=float)) for ring in rings]
    middle = degrees[0][:, 1].mean()
    for hole in degrees[1:]:  # which may be stated on the other side of the antimeridian
        hole[:, 1] += 360.0 * round(float(middle - hole[:, 1].mean()) / 360.0)
    width = _width(degrees[0])
    if width <= _WIDE or not stands:
        plane = [_on_plane(ring, frame) for ring in degrees]
        if keep is Keep.OUT and _rectangle_distance(plane[0]) > within:
            return Shapes(())
        return _polygon(plane, rings, keep)
    for n, ring in enumerate(degrees):
        _check_as_stated(n, ring)
    pieces = _clip_around(degrees, frame, min(within, WITHIN))
    if keep is Keep.IN and len(pieces) != 1:
        raise AreaError(
            f"is {width / 1e3:.0f} km wide and has {len(pieces)} parts within "
            f"{min(within, WITHIN) / 1e3:.0f} km of the origin, expected one to be kept in"
        )
    if not pieces:
        return Shapes(())
    placed = [_polygon([_on_plane(ring, frame) for ring in piece], None, keep) for piece in pieces]
    changes = [part.change for part in placed if part.change]
    if sum(_size(piece) for piece in pieces) < 0.999 * _size(degrees):
        reach = min(within, WITHIN) / 1e3
        changes.insert(0, f"is {width / 1e3:.0f} km wide: what lies within {reach:.0f} km counts")
    return Shapes(
        tuple(shape for part in placed for shape in part.shapes),
        max(part.added for part in placed),
        "; ".join(changes),
    )


def _size(rings: Sequence[Array]) -> float:
    """Return the size of a polygon, the outer ring first."""
    outer, *holes = (abs(signed_size(ring)) for ring in rings)
    return outer - sum(holes)


def _polygon(plane: list[Array], rings: Rings | None, keep: Keep) -> Shapes:
    """Return the polygon of rings on the plane, of fewer points where they are too many.

    Args:
        plane: the rings, m.
        rings: as the file states them, for an error; None: they have been checked.
        keep: on which side flight is allowed.
    """
    count = sum(map(len, plane))
    if count <= MOST_POINTS:
        try:
            return Shapes((Polygon(*_tuples(plane)),))
        except RingError:
            for n, ring in enumerate(rings or ()):
                _check_as_stated(n, _unwrap(np.array(ring, dtype=float)))
            raise
    for n, ring in enumerate(rings or ()):
        _check_as_stated(n, _unwrap(np.array(ring, dtype=float)))
    # Without its holes, and as its hull, an area to be kept out of is larger.
    larger = [plane[:1], [hull(plane[0])]] if keep is Keep.OUT else []
    for outline in (plane, *larger):
        if 3 * len(outline) > MOST_POINTS:
            continue
        thinned, off = thin(outline, MOST_POINTS, OFF)
        try:
            shape = Polygon(*_tuples(thinned))
        except AreaError:
            continue
        remaining = sum(map(len, thinned))
        lost = " without its holes" if len(outline) < len(plane) else ""
        change = (
            f"has {count} points, of which {remaining} are kept{lost}; {off:g} m more are kept "
            f"from it"
        )
        return Shapes((shape,), off, change)
    raise AreaError(f"has {count} points, expected {MOST_POINTS} at most, or a ring to be thinned")


def _tuples(rings: Sequence[Array]) -> tuple[tuple[Place, ...], tuple[tuple[Place, ...], ...]]:
    outer, *holes = (tuple(map(tuple, ring.tolist())) for ring in rings)
    return outer, tuple(holes)


def _unwrap(ring: Array) -> Array:
    """Return a ring of latitudes and longitudes ``[P, 2]`` whose longitudes do not jump: edges go
    the shorter way round, but where that leaves nothing inside, as they are stated.
    """
    latitude, longitude = ring.T
    way = np.unwrap(longitude, period=360.0)
    unwrapped = np.stack([latitude, way], axis=1)
    if np.ptp(longitude) >= 360.0 and abs(signed_size(unwrapped)) < 1e-9:
        return ring
    if abs(way[-1] - way[0]) > 180.0:
        raise AreaError("goes round a pole, expected a ring that does not")
    return unwrapped


def _width(ring: Array) -> float:
    """Return about how wide a ring of latitudes and longitudes is, m."""
    north, east = np.ptp(ring, axis=0)
    widest = math.cos(math.radians(np.abs(ring[:, 0]).min()))
    if ring[:, 0].min() < 0.0 < ring[:, 0].max():
        widest = 1.0
    return _DEGREE * max(float(north), float(east) * widest)


def _rectangle_distance(ring: Array) -> float:
    """Return the distance of the origin from the rectangle around a ring, m."""
    return float(np.hypot(*np.maximum(np.maximum(ring.min(axis=0), -ring.max(axis=0)), 0.0)))


def _clip_around(rings: list[Array], frame: LocalFrame, within: float) -> list[list[Array]]:
    """Return what is left of a polygon of latitudes and longitudes about the origin: all of it that
    lies within a distance, m.
    """
    outer, *holes = (
        ring if (signed_size(ring) > 0.0) == (n == 0) else ring[::-1]
        for n, ring in enumerate(rings)
    )
    half = within / _LEAST_DEGREE
    low, high = (max(min(frame.latitude + d, 90.0), -90.0) for d in (-half, half))
    narrowest = math.cos(math.radians(max(abs(low), abs(high))))
    wide = min(half / max(narrowest, 1e-6), 180.0)
    box: Box = (low, high), (frame.longitude - wide, frame.longitude + wide)
    pieces = []
    # Where the file has the polygon is a matter of whole turns.
    turn = 360.0 * round((frame.longitude - float(outer[:, 1].mean())) / 360.0)
    for shift in (turn - 360.0, turn, turn + 360.0):
        try:
            pieces += clip([ring + np.array((0.0, shift)) for ring in (outer, *holes)], box)
        except ValueError as problem:
            raise RingError(str(problem)) from None
    return pieces


def _check_as_stated(number: int, ring: Array) -> None:
    """Refuse a ring that crosses itself as the file states it, by the numbers of its points: in
    the local frame there are more.
    """
    numbers = [k for k in range(len(ring)) if (ring[k] != ring[k - 1]).any()]
    latitude, longitude = ring[numbers].T
    # About metres; what is straight in degrees is straight in them.
    x = longitude * math.cos(math.radians(latitude[0])) * _DEGREE
    points = tuple(zip(x.tolist(), (latitude * _DEGREE).tolist(), strict=True))
    check_simple("outer" if number == 0 else f"holes[{number - 1}]", points, numbers)


def _on_plane(ring: Array, frame: LocalFrame) -> Array:
    """Return a ring of latitudes and longitudes in a local frame, m, ``[P, 2]``.

    Its edges are straight in degrees; points are added where they are not straight in the frame.
    """
    ends = np.roll(ring, -1, axis=0)
    corners, middle = frame.place(*ring.T), frame.place(*(0.5 * (ring + ends)).T)
    off = np.hypot(
        middle.x - 0.5 * (corners.x + np.roll(corners.x, -1)),
        middle.y - 0.5 * (corners.y + np.roll(corners.y, -1)),
    )
    # Of n parts of an edge each leaves the line by an n-th of an n-th.
    parts = np.maximum(np.ceil(np.sqrt(off / OFF)), 1.0).astype(int)
    if parts.sum() > _MOST:
        raise AreaError(f"needs {parts.sum()} points in the local frame, expected {_MOST} at most")
    points = np.concatenate(
        [
            a + (np.arange(count) / count)[:, None] * (b - a)
            for a, b, count in zip(ring, ends, parts, strict=True)
        ]
    )
    fine = frame.place(*points.T)
    return np.stack([fine.x, fine.y], axis=1)


def _ring_about(centre: Place, radius: float, keep: Keep) -> tuple[Place, ...]:
    """Return a ring about a circle that is too large for a plane, inside of it where it is to be
    kept in.
    """
    if radius > _LARGEST:
        raise AreaError(f"radius is {radius:g} m, expected 0 to {_LARGEST:g} m")
    outwards = keep is Keep.OUT

    def at(distance: float) -> Array:
        bearing = np.arange(_SIDES) * 360.0 / _SIDES
        start = np.full(_SIDES, centre[1]), np.full(_SIDES, centre[0])
        longitude, latitude, _ = wgs84().fwd(*start, bearing, np.full(_SIDES, distance))
        return _unwrap(np.stack([latitude, longitude], axis=1))

    ring = at(radius)
    ends = np.roll(ring, -1, axis=0)
    off = [distance(*centre, *place) for place in (*ring, *(0.5 * (ring + ends)))]
    fitting = radius * radius / (min(off) if outwards else max(off))
    ring = at(fitting + OFF if outwards else fitting - OFF)
    return tuple(map(tuple, ring.tolist()))
