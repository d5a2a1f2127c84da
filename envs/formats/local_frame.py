"""Geographic positions on the WGS-84 ellipsoid as metres east and north of an origin, and back.

The map is azimuthal equidistant about the origin: a point lies at its geodesic distance, in the
direction in which the geodesic leaves the origin. Distances from the origin are exact, and between
any two points within 57 km of it good to 0.6 m (within 60 km to 0.69 m); a tangent plane would sink
282 m under the ellipsoid there, so altitudes stay altitudes and never enter the map. Away from the
origin the map's north is not true north: the angle between them, the convergence, turns velocities
and headings at the point where they are measured (0.58 degrees 60 km east of an origin at 47
degrees latitude, tens of degrees near a pole).
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from envs.angles import wrap
from envs.arrays import Array

if TYPE_CHECKING:
    from pyproj import Geod, Transformer


@cache
def wgs84() -> "Geod":
    """Return the ellipsoid; imported on first use, because it takes a tenth of a node's start."""
    from pyproj import Geod

    return Geod(ellps="WGS84")


@cache
def _cartesian() -> "Transformer":
    from pyproj import Transformer

    return Transformer.from_pipeline("+proj=cart +ellps=WGS84")


class Place(NamedTuple):
    """Points of the map; fields ``[...]``."""

    x: np.ndarray  # east, m
    y: np.ndarray  # north, m
    convergence: np.ndarray  # direction of the map's north, rad clockwise from true north

    def velocity(self, east: np.ndarray, north: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return velocities, given by true east and north at the points, along the map's x
        and y.
        """
        cosine, sine = np.cos(self.convergence), np.sin(self.convergence)
        return east * cosine - north * sine, east * sine + north * cosine


class Geodetic(NamedTuple):
    """Points on the ellipsoid; fields ``[...]``."""

    latitude: np.ndarray  # degrees
    longitude: np.ndarray  # degrees, in [-180, 180)
    convergence: np.ndarray  # as of Place


def local(latitude: Array, longitude: Array, reference: tuple[float, float]) -> Place:
    """Return where latitudes and longitudes, rad, ``[...]``, are on the map about those of a
    reference, rad.
    """
    latitude, longitude = np.asarray(latitude, np.float64), np.asarray(longitude, np.float64)
    start = np.full(latitude.shape, reference[1]), np.full(latitude.shape, reference[0])
    azimuth, back_azimuth, length = map(
        np.asarray, wgs84().inv(*start, longitude, latitude, radians=True)
    )
    convergence = np.where(length > 1e-6, wrap(back_azimuth + np.pi - azimuth, np), 0.0)
    return Place(length * np.sin(azimuth), length * np.cos(azimuth), convergence)


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """The map about an origin, degrees."""

    latitude: float
    longitude: float

    def place(self, latitude: Array, longitude: Array) -> Place:
        """Return where points, degrees, ``[...]``, are on the map; 360 degrees of longitude more or
        less make no difference.
        """
        origin = math.radians(self.latitude), math.radians(self.longitude)
        return local(np.radians(latitude), np.radians(longitude), origin)

    def geodetic(self, x: Array, y: Array) -> Geodetic:
        """Return the points of the ellipsoid at x and y, m, ``[...]``: the inverse of
        :meth:`place`.
        """
        x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
        azimuth, length = np.arctan2(x, y), np.hypot(x, y)
        start = np.full(x.shape, self.longitude), np.full(x.shape, self.latitude)
        longitude, latitude, back_azimuth = wgs84().fwd(*start, np.degrees(azimuth), length)
        longitude = np.remainder(np.asarray(longitude) + 180.0, 360.0) - 180.0
        # At the origin the geodesic has no direction.
        turn = np.where(length > 1e-6, wrap(np.radians(back_azimuth) + math.pi - azimuth, np), 0.0)
        return Geodetic(np.asarray(latitude), longitude, turn)


def distance(latitude_a: float, longitude_a: float, latitude_b: float, longitude_b: float) -> float:
    """Return the length of the geodesic between two points, degrees, m."""
    return float(wgs84().inv(longitude_a, latitude_a, longitude_b, latitude_b)[2])


def displacement(
    latitude_a: float, longitude_a: float, latitude_b: float, longitude_b: float
) -> tuple[float, float]:
    """Return the way from one point to another, both in degrees, as true east and north at the
    first, m.
    """
    azimuth, _, length = wgs84().inv(longitude_a, latitude_a, longitude_b, latitude_b)
    return length * math.sin(math.radians(azimuth)), length * math.cos(math.radians(azimuth))


def fly_straight(
    latitude: float, longitude: float, east: float, north: float, seconds: float
) -> tuple[float, float]:
    """Return latitude and longitude, degrees, after flying straight ahead for some seconds at a
    velocity in m/s.
    """
    track = math.degrees(math.atan2(east, north))
    longitude, latitude, _ = wgs84().fwd(
        longitude, latitude, track, math.hypot(east, north) * seconds
    )
    return float(latitude), float(longitude)


def geocentric(
    latitude: np.ndarray, longitude: np.ndarray, altitude: np.ndarray | float = 0.0
) -> np.ndarray:
    """Return points (rad, m above the ellipsoid) in Cartesian coordinates about the Earth's centre,
    m, ``[..., 3]``.
    """
    return np.stack(
        _cartesian().transform(longitude, latitude, np.full_like(latitude, altitude), radians=True),
        axis=-1,
    )
