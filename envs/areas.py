"""Areas of the sky that must not be entered, or not be left: polygons with holes and circles.

An area stands in the plan's local frame (x east, y north, m) as it is at the request. It may move
and grow from there on, as a weather cell does, and counts for some time and some heights only. What
must hold is measured in :mod:`envs.area_geometry`.
"""

import copy
import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple, TypeVar

import numpy as np

from commands.command import InputError
from envs.wind import Wind

MOST_POINTS = 1_024
"""Points of an area at most, all rings together."""

WIDEST = 300_000.0
"""Extent of a polygon at most, m, in x and in y: more than a local frame is used for."""

LARGEST_RADIUS = 30_000.0
"""m: a larger circle of the ground is not one of the local frame to a few metres."""

_FARTHEST = 1e6  # coordinates beyond this, m, belong to no local frame
_THINNEST = 1e-6  # m: points no farther from a line than this are on it
_MOST_CLEARANCE = 60_000.0  # m
_FASTEST = 100.0  # m/s of an area that moves or grows

Place = tuple[float, float]
"""x east and y north, m."""

_T = TypeVar("_T")

Ring = tuple[Place, ...]
"""A closed line of straight edges; the first point is not repeated at the end."""


class AreaError(InputError):
    """An area that cannot be used; the message says which field, its value and what was
    expected.
    """


class RingError(AreaError):
    """A ring that crosses or touches itself, or that has no inside."""


class Keep(Enum):
    """On which side of an area flight is allowed."""

    OUT = "out"
    IN = "in"


class Level(NamedTuple):
    """A height, comparable only with others of the same reference."""

    value: float  # m
    reference: str  # such as "wgs84", "msl", "pressure", "ground"


@dataclass(frozen=True, slots=True)
class Polygon:
    """A polygon with straight edges.

    Rings may begin anywhere, go either way round, and repeat their first point at the end; they are
    kept counter-clockwise outside and clockwise around holes, so that the inside is on the left.
    """

    outer: Ring
    holes: tuple[Ring, ...] = ()

    def __post_init__(self) -> None:
        """Check the rings."""
        outer = _ring("outer", self.outer)
        holes = tuple(_ring(f"holes[{n}]", hole) for n, hole in enumerate(self.holes))
        count = len(outer) + sum(map(len, holes))
        if count > MOST_POINTS:
            raise AreaError(f"outer and holes have {count} points, expected {MOST_POINTS} at most")
        for axis, values in zip("xy", zip(*outer, strict=True), strict=True):
            extent = max(values) - min(values)
            if extent > WIDEST:
                raise AreaError(
                    f"outer is {extent / 1e3:.0f} km wide in {axis}, expected "
                    f"{WIDEST / 1e3:.0f} km at most: the local frame is flat"
                )
        check_simple("outer", outer)
        for n, hole in enumerate(holes):
            check_simple(f"holes[{n}]", hole)
            _check_within(f"holes[{n}]", hole, outer)
        for (n, first), (m, second) in itertools.combinations(enumerate(holes), 2):
            _check_apart(f"holes[{n}]", first, f"holes[{m}]", second)
        object.__setattr__(self, "outer", _turn(outer, left=True))
        object.__setattr__(self, "holes", tuple(_turn(hole, left=False) for hole in holes))

    @property
    def rings(self) -> tuple[Ring, ...]:
        """All rings, the outer one first."""
        return (self.outer, *self.holes)


@dataclass(frozen=True, slots=True)
class Circle:
    """A disc."""

    x: float
    """Of the centre, m."""
    y: float
    radius: float
    """m."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("x", "y"):
            object.__setattr__(
                self, name, _real(name, getattr(self, name), -_FARTHEST, _FARTHEST, "m")
            )
        radius = _real("radius", self.radius, 0.0, LARGEST_RADIUS, "m")
        if radius == 0.0:
            raise AreaError("radius is 0 m, expected more than 0 m")
        object.__setattr__(self, "radius", radius)


@dataclass(frozen=True, slots=True)
class Area:
    """An area to be kept out of, or in.

    A point is in the area ``t`` seconds after the request if it is in the shape moved by ``t``
    times the velocity, or not farther from it than ``t`` times the growth; where the growth is
    negative, if it is that deep inside.
    """

    shape: Polygon | Circle
    """At the request."""
    keep: Keep = Keep.OUT
    velocity: Place = (0.0, 0.0)
    """Over the ground, m/s east and north."""
    growth: float = 0.0
    """By how much it grows to all sides, m/s; negative: it shrinks."""
    floor: Level | None = None
    """Below it the area does not count; None: down to the ground. An area to be kept in counts at
    all heights.
    """
    ceiling: Level | None = None
    """Above it the area does not count; None: without limit."""
    valid_from: float = -math.inf
    """s after the request."""
    valid_until: float = math.inf
    """s after the request."""
    clearance: float = 0.0
    """What must be kept from the edge, m."""
    name: str = ""

    def __post_init__(self) -> None:
        """Check the fields."""
        if not isinstance(self.shape, (Polygon, Circle)):
            raise AreaError(f"shape is {type(self.shape).__name__}, expected a Polygon or a Circle")
        if not isinstance(self.keep, Keep):
            raise AreaError(f"keep is {self.keep!r:.60}, expected Keep.OUT or Keep.IN")
        if not isinstance(self.name, str):
            raise AreaError(f"name is {self.name!r:.60}, expected a text")
        if not isinstance(self.velocity, tuple) or len(self.velocity) != 2:
            raise AreaError(f"velocity is {self.velocity!r:.60}, expected east and north in m/s")
        velocity = tuple(
            _real(f"velocity[{n}]", component, -_FASTEST, _FASTEST, "m/s")
            for n, component in enumerate(self.velocity)
        )
        object.__setattr__(self, "velocity", velocity)
        growth = _real("growth", self.growth, -_FASTEST, _FASTEST, "m/s")
        object.__setattr__(self, "growth", growth)
        clearance = _real("clearance", self.clearance, 0.0, _MOST_CLEARANCE, "m")
        object.__setattr__(self, "clearance", clearance)
        self._check_heights()
        for name in ("valid_from", "valid_until"):
            value = _real(name, getattr(self, name), -math.inf, math.inf, "s")
            object.__setattr__(self, name, value)
        if not self.valid_from < self.valid_until:
            raise AreaError(
                f"valid_until is {self.valid_until:g} s, expected more than valid_from of "
                f"{self.valid_from:g} s"
            )

    def _check_heights(self) -> None:
        for name in ("floor", "ceiling"):
            level = getattr(self, name)
            if level is None:
                continue
            if not isinstance(level, Level):
                raise AreaError(f"{name} is {level!r:.60}, expected a Level or None")
            value = _real(f"{name}.value", level.value, -20_000.0, 100_000.0, "m")
            if not isinstance(level.reference, str) or not level.reference:
                raise AreaError(f"{name}.reference is {level.reference!r:.60}, expected a name")
            object.__setattr__(self, name, Level(value, level.reference))
        low, high = self.floor, self.ceiling
        if low and high and low.reference == high.reference and low.value >= high.value:
            raise AreaError(
                f"ceiling is {high.value:g} m, expected more than the floor of {low.value:g} m"
            )


def after(area: Area, seconds: float) -> Area:
    """Return an area as a request made some seconds later has it.

    What it has grown by then is added to the clearance, or taken from it down to 0.
    """
    grown = area.growth * seconds
    return _replace_fields(
        area,
        shape=_shift(area.shape, *(speed * seconds for speed in area.velocity)),
        clearance=max(area.clearance + (grown if area.keep is Keep.OUT else -grown), 0.0),
        valid_from=area.valid_from - seconds,
        valid_until=area.valid_until - seconds,
    )


def in_air(area: Area, wind: Wind, seconds: float = 0.0) -> Area:
    """Return an area over the ground as the air mass sees it, whose frame lay over the ground's
    some seconds before.
    """
    east, north = float(wind.east), float(wind.north)
    # In the air an area may be faster than one may be over the ground.
    velocity = area.velocity[0] - east, area.velocity[1] - north
    if seconds == 0.0:
        return _replace_fields(area, velocity=velocity)
    shape = _shift(area.shape, -east * seconds, -north * seconds)
    return _replace_fields(area, velocity=velocity, shape=shape)


def vertical_limits(
    areas: Iterable[Area], reference: str, floor: Level | None, ceiling: Level | None
) -> tuple[Level | None, Level | None]:
    """Return the highest floor and the lowest ceiling of those that are given and those of areas to
    be kept in, as far as they have a reference; None: there is none.
    """
    keep_in = [area for area in areas if area.keep is Keep.IN]
    floors, ceilings = (
        [level for level in levels if level is not None and level.reference == reference]
        for levels in (
            [floor, *(area.floor for area in keep_in)],
            [ceiling, *(area.ceiling for area in keep_in)],
        )
    )
    # Of one reference, tuples are compared by their first part, the value.
    return max(floors, default=None), min(ceilings, default=None)


def unknown_limits(areas: Iterable[Area], reference: str) -> list[tuple[int, str, Level]]:
    """Return the floors and ceilings of areas to be kept in that have another reference: the
    number of the area, the field's name and the level. How high they are nobody knows.
    """
    return [
        (number, name, level)
        for number, area in enumerate(areas)
        if area.keep is Keep.IN
        for name, level in (("floor", area.floor), ("ceiling", area.ceiling))
        if level is not None and level.reference != reference
    ]


def uncomparable_limits(
    areas: Iterable[Area], reference: str, floor: Level | None, ceiling: Level | None
) -> dict[str, Level]:
    """Return the floor and the ceiling, by these names, that are given or of areas to be kept in
    and have another reference; empty: there is none.
    """
    unknown = {
        name: level
        for name, level in (("floor", floor), ("ceiling", ceiling))
        if level is not None and level.reference != reference
    }
    return unknown | {name: level for _, name, level in unknown_limits(areas, reference)}


def _shift(shape: Polygon | Circle, dx: float, dy: float) -> Polygon | Circle:
    """Return a shape moved by dx and dy, m."""
    if isinstance(shape, Circle):
        return _replace_fields(shape, x=shape.x + dx, y=shape.y + dy)
    outer, *holes = (tuple((x + dx, y + dy) for x, y in ring) for ring in shape.rings)
    return _replace_fields(shape, outer=outer, holes=tuple(holes))


def _replace_fields(original: _T, **fields: object) -> _T:
    """Return an area or a shape with other fields, for which the checks of the old ones hold too.

    The checks take long, and areas move with every step of a monitor.
    """
    changed = copy.copy(original)
    for name, value in fields.items():
        object.__setattr__(changed, name, value)
    return changed


def _real(name: str, value: object, low: float, high: float, unit: str) -> float:
    """Return a number in [low, high] as a plain float."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(
        value, (int, float, np.integer, np.floating)
    ):
        raise AreaError(f"{name} is {value!r:.60}, expected a number")
    try:
        number = float(value)
    except OverflowError:
        raise AreaError(f"{name} is too large, expected {low:g} to {high:g} {unit}") from None
    if not low <= number <= high:  # not-a-number fails every comparison
        raise AreaError(f"{name} is {number:g} {unit}, expected {low:g} to {high:g} {unit}")
    return number


def _ring(name: str, points: object) -> Ring:
    """Return a ring without repeated points."""
    if isinstance(points, (str, bytes)) or not isinstance(points, (Sequence, np.ndarray)):
        raise AreaError(f"{name} is {type(points).__name__}, expected a sequence of points")
    if len(points) > MOST_POINTS + 1:  # before anything is computed for them
        raise AreaError(f"{name} has {len(points)} points, expected {MOST_POINTS} at most")
    places: list[Place] = []
    for n, point in enumerate(points):
        if not isinstance(point, (tuple, list, np.ndarray)) or len(point) != 2:
            raise AreaError(f"{name}[{n}] is {point!r:.60}, expected x and y in m")
        x, y = (
            _real(f"{name}[{n}].{axis}", value, -_FARTHEST, _FARTHEST, "m")
            for axis, value in zip("xy", point, strict=True)
        )
        if not places or (x, y) != places[-1]:
            places.append((x, y))
    if len(places) > 1 and places[0] == places[-1]:
        places.pop()
    if len(places) < 3:
        raise AreaError(f"{name} has {len(places)} different points, expected 3 or more")
    return tuple(places)


def _turn(ring: Ring, *, left: bool) -> Ring:
    """Return the ring so that its inside is on the left, or on the right."""
    return ring if (signed_size(ring) > 0.0) == left else (ring[0], *reversed(ring[1:]))


def signed_size(ring: Iterable[Place]) -> float:
    """Return the size of a ring's inside, m^2, negative where it goes round clockwise."""
    x, y = _centre(ring)
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _centre(ring: Iterable[Place]) -> tuple[np.ndarray, np.ndarray]:
    """Return x and y of a ring from its first point, where their products lose least."""
    points = np.array(list(ring), dtype=float)
    x, y = (points - points[0]).T
    return x, y


def check_simple(name: str, ring: Ring, numbers: Sequence[int] | None = None) -> None:
    """Refuse a ring that crosses or touches itself, or that has no inside, with a ``RingError``;
    ``numbers`` are what it calls its points, None: 0, 1 and so on.
    """
    x, y = _centre(ring)
    far = int(np.argmax(np.hypot(x, y)))
    across = np.abs(x[far] * y - y[far] * x) / np.hypot(x[far], y[far])
    if across.max() <= _THINNEST:
        raise RingError(f"{name} has its points on one line, expected an inside")
    count, points = len(ring), np.array(ring)
    for n in range(count):
        later = np.arange(n + 1, count)
        hit = _touch(points, n, points, later)
        # Neighbours share a point; they touch only where one leads back over the other.
        for m in {(n + 1) % count, (n - 1) % count} & set(later.tolist()):
            hit[m - n - 1] = _leads_back(ring, n, m)
        if hit.any():
            sides = n, int(later[np.argmax(hit)])
            first, second = sides if numbers is None else (numbers[k] for k in sides)
            raise RingError(
                f"{name} crosses or touches itself: its edge from point {first} and its edge from "
                f"point {second}, expected edges that meet at their ends only"
            )


def _check_within(name: str, hole: Ring, outer: Ring) -> None:
    """Refuse a hole that is not strictly inside the outer ring."""
    _check_not_touching(name, hole, "outer", outer)
    if not is_inside(outer, hole[0]):
        raise AreaError(f"{name} lies outside of outer, expected it inside")


def _check_apart(name: str, ring: Ring, other_name: str, other: Ring) -> None:
    """Refuse holes that overlap."""
    _check_not_touching(name, ring, other_name, other)
    if is_inside(ring, other[0]) or is_inside(other, ring[0]):
        raise AreaError(f"{name} and {other_name} lie one in the other, expected them apart")


def _check_not_touching(name: str, ring: Ring, other_name: str, other: Ring) -> None:
    points, other_points = np.array(ring), np.array(other)
    for n in range(len(ring)):
        if _touch(points, n, other_points, np.arange(len(other))).any():
            raise AreaError(f"{name} crosses or touches {other_name}, expected them apart")


def _touch(ring: np.ndarray, edge: int, other_ring: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Return which edges of another ring ``[E, 2]`` an edge of a ring meets, bool."""
    bx, by = ring[(edge + 1) % len(ring)] - ring[edge]
    points = other_ring - ring[edge]
    cx, cy = points[numbers].T
    dx, dy = points[(numbers + 1) % len(other_ring)].T
    # Both ends of each on different sides of the other, or on its line; and the boxes overlap,
    # which decides where all four are on one line.
    sides = (bx * cy - by * cx) * (bx * dy - by * dx) <= 0.0
    ex, ey = dx - cx, dy - cy
    sides &= (cx * ey - cy * ex) * ((cx - bx) * ey - (cy - by) * ex) <= 0.0
    boxes = (np.minimum(cx, dx) <= max(0.0, bx)) & (np.maximum(cx, dx) >= min(0.0, bx))
    boxes &= (np.minimum(cy, dy) <= max(0.0, by)) & (np.maximum(cy, dy) >= min(0.0, by))
    return sides & boxes


def _leads_back(ring: Ring, n: int, m: int) -> bool:
    """Return whether one of two neighbouring edges leads back over the other."""
    first, second = (n, m) if m == (n + 1) % len(ring) else (m, n)
    a, b, c = (np.array(ring[k % len(ring)]) for k in (first, second, second + 1))
    (ux, uy), (vx, vy) = b - a, c - b
    return bool(ux * vy - uy * vx == 0.0 and ux * vx + uy * vy < 0.0)


def is_inside(ring: Ring, place: Place) -> bool:
    """Return whether a point that is on no edge is inside a ring: a ray to the east crosses it an
    odd number of times.
    """
    x, y = (np.array(ring) - np.array(place)).T
    x1, y1 = np.roll(x, -1), np.roll(y, -1)
    crossing = (y > 0.0) != (y1 > 0.0)
    crosses_right = (x * y1 - x1 * y > 0.0) == (y1 > y)
    return bool(np.count_nonzero(crossing & crosses_right) % 2)
