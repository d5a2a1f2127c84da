"""The missions: each follows from the seed and its number alone.

A small unmanned aircraft flies two or three legs among fences, intruders that fly straight over the
ground, and a steady wind. What cannot stand (a fence at the start, an intruder within the
separation) is drawn again.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely

from agents.config.world import AircraftConfig
from envs.aircraft import Aircraft
from envs.areas import Area, Keep, Place, Polygon
from envs.frames import Air, Ground
from envs.kinematics import VehicleState
from envs.wind import Wind, over_ground

CRUISE = 25.0
"""Airspeed of the mission, m/s."""

CLEARANCE = 50.0
"""That both sides keep from fences, m; a fence is violated within its edge only."""

MOST_INTRUDERS, MOST_FENCES = 4, 3
STRONGEST = 10.0
"""Of the winds, m/s."""

_LEGS = 2, 3
_LEG = 2_500.0, 4_000.0  # m
_BEND = math.radians(60.0)  # between two legs at most
_KEEP_IN_SHARE = 0.5  # of missions with a fence: the first fence is one to be kept in
_KEEP_IN = 1_500.0, 2_500.0  # from the mission to the edge of a fence to be kept in, m
_SIZE = 150.0, 600.0  # from the middle of a fence to its corners, m
_CORNERS = 3, 8
_ASIDE = 600.0  # of a fence's middle from the mission at most, m
_FREE = 800.0, 350.0  # from fences to start and end, and to the waypoints between, at least, m
_BETWEEN = 400.0  # between two fences at least, m
_MEETS = 0.15, 0.95  # where an intruder passes, shares of the mission
_SPEED = 15.0, 45.0  # of intruders over the ground, m/s
_MISS = 1.0  # by which an intruder misses the mission at most, separations
_APART = 2.5  # from an intruder to the start at the beginning, separations at least
_TRIES = 1_000


class Mission(NamedTuple):
    """One mission; places in m east and north of its start, times in s."""

    number: int
    waypoints: tuple[Place, ...]  # the start, then those to be flown to
    wind: Wind
    fences: tuple[Area, ...]
    intruders: tuple[
        VehicleState[Ground], ...
    ]  # over the ground at the start; they fly straight on

    @property
    def length(self) -> float:
        """From waypoint to waypoint, m."""
        return float(np.hypot(*np.diff(np.array(self.waypoints), axis=0).T).sum())

    @property
    def start(self) -> VehicleState[Ground]:
        """Over the ground: at cruise in the direction of the first leg, through the air."""
        (x, y), (to_x, to_y) = self.waypoints[:2]
        air: VehicleState[Air] = VehicleState(x, y, math.atan2(to_y - y, to_x - x), CRUISE)
        return VehicleState(*map(float, over_ground(air, self.wind, 0.0)))

    @property
    def limit(self) -> float:
        """When a flight that has not arrived ends, s."""
        return 120.0 + 2.0 * self.length / (CRUISE - float(self.wind.speed))


def aircraft() -> Aircraft:
    """Return the aircraft of all missions, the small UAS that ships."""
    return AircraftConfig.of_file(Path("uas")).aircraft()


def mission(seed: int, number: int, separation: float) -> Mission:
    """Return a mission with 0 to 4 intruders, 0 to 3 fences and 0 to 10 m/s of wind.

    Args:
        separation: of the aircraft, m.
    """
    draw = np.random.default_rng([seed, number])
    speed, course = draw.uniform(0.0, STRONGEST), draw.uniform(-math.pi, math.pi)
    wind = Wind(float(speed * math.cos(course)), float(speed * math.sin(course)))
    waypoints = _waypoints(draw)
    fences = _fences(draw, waypoints, int(draw.integers(MOST_FENCES + 1)))
    bare = Mission(number, waypoints, wind, fences, ())
    count = int(draw.integers(MOST_INTRUDERS + 1))
    intruders = tuple(_intruder(draw, bare, separation) for _ in range(count))
    return bare._replace(intruders=intruders)


def outline(fence: Area) -> shapely.Polygon:
    """Return the polygon of a fence as shapely has it."""
    assert isinstance(fence.shape, Polygon), "fences are polygons"
    return shapely.Polygon(fence.shape.outer)


def _waypoints(draw: np.random.Generator) -> tuple[Place, ...]:
    points, course = [(0.0, 0.0)], draw.uniform(-math.pi, math.pi)
    for _ in range(draw.integers(_LEGS[0], _LEGS[1] + 1)):
        (x, y), length = points[-1], draw.uniform(*_LEG)
        points.append((float(x + length * math.cos(course)), float(y + length * math.sin(course))))
        course += draw.uniform(-_BEND, _BEND)
    return tuple(points)


def _fences(
    draw: np.random.Generator, waypoints: tuple[Place, ...], count: int
) -> tuple[Area, ...]:
    line, fences = shapely.LineString(waypoints), list[Area]()
    if count and draw.random() < _KEEP_IN_SHARE:
        hull = line.buffer(draw.uniform(*_KEEP_IN), quad_segs=2).convex_hull
        fences.append(_area(hull, Keep.IN, 0))
    for _ in range(_TRIES):
        if len(fences) == count:
            break
        shape = _convex_shape(draw, line)
        if _stands(shape, waypoints, fences):
            fences.append(_area(shape, Keep.OUT, len(fences)))
    return tuple(fences)


def _convex_shape(
    draw: np.random.Generator, line: shapely.LineString
) -> shapely.geometry.base.BaseGeometry:
    """Return a convex polygon beside or across the mission; what has no area is less than that."""
    middle = line.interpolate(draw.uniform(0.0, 1.0), normalized=True)
    x, y = np.array([middle.x, middle.y]) + draw.uniform(-_ASIDE, _ASIDE, 2)
    corners = int(draw.integers(_CORNERS[0], _CORNERS[1] + 1))
    angle = np.sort(draw.uniform(0.0, 2.0 * math.pi, corners))
    far = draw.uniform(*_SIZE)
    places = np.stack([x + far * np.cos(angle), y + far * np.sin(angle)], axis=-1)
    return shapely.MultiPoint(places).convex_hull


def _stands(
    shape: shapely.geometry.base.BaseGeometry, waypoints: tuple[Place, ...], others: list[Area]
) -> bool:
    """Return whether a fence leaves room for the waypoints and between it and the others."""
    if shape.area < 0.25 * _SIZE[0] ** 2:
        return False
    points = [shapely.Point(place) for place in waypoints]
    free = [_FREE[1 if 0 < n < len(points) - 1 else 0] for n in range(len(points))]
    if any(shape.distance(point) < far for point, far in zip(points, free, strict=True)):
        return False
    return all(outline(fence).boundary.distance(shape) >= _BETWEEN for fence in others)


def _area(shape: shapely.geometry.base.BaseGeometry, keep: Keep, number: int) -> Area:
    assert isinstance(shape, shapely.Polygon)
    ring = tuple((float(x), float(y)) for x, y in shape.exterior.coords[:-1])
    return Area(Polygon(ring), keep=keep, clearance=CLEARANCE, name=f"fence {number}")


def _intruder(draw: np.random.Generator, bare: Mission, separation: float) -> VehicleState[Ground]:
    """Return an intruder that passes near where the mission is at some time."""
    places = np.array(bare.waypoints)
    times = _times(bare)
    while True:
        when = float(draw.uniform(*_MEETS) * times[-1])
        x, y = (float(np.interp(when, times, axis)) for axis in places.T)
        course, speed = draw.uniform(-math.pi, math.pi), draw.uniform(*_SPEED)
        aside = draw.uniform(-_MISS, _MISS) * separation
        x += -aside * math.sin(course) - speed * when * math.cos(course)
        y += aside * math.cos(course) - speed * when * math.sin(course)
        if math.hypot(x, y) >= _APART * separation:
            return VehicleState(float(x), float(y), float(course), float(speed))


def _times(bare: Mission) -> np.ndarray:
    """Return when the mission is at its waypoints if nothing is in its way, s."""
    legs = np.diff(np.array(bare.waypoints), axis=0)
    length = np.hypot(*legs.T)
    ahead = legs / length[:, None]
    wind = np.array([bare.wind.east, bare.wind.north])
    along, across = ahead @ wind, ahead[:, 0] * wind[1] - ahead[:, 1] * wind[0]
    speed = np.sqrt(CRUISE**2 - across**2) + along
    return np.concatenate([[0.0], np.cumsum(length / speed)])
