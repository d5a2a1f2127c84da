# pyright: reportMissingImports=false
"""The local frame: positions on the WGS-84 ellipsoid as metres east and north of an origin, and back.

The frame is the azimuthal equidistant map about its origin: a point stands at its geodesic distance, in the direction
in which the geodesic leaves the origin. Distances from the origin are exact, and between any two points within 57 km
of it good to 0.6 m (within 60 km to 0.69 m); a tangent plane would sink 282 m under the ellipsoid there, so altitudes
stay altitudes and never enter the frame. Away from the origin the map's north is not true north: the angle between
them, the convergence, turns velocities and headings at the point where they are measured (0.58 degrees 60 km east of
an origin at 47 degrees latitude, tens of degrees near a pole).
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from pyproj import Geod

__all__ = ["ACCURATE", "REACH", "Geodetic", "LocalFrame", "Place", "carried", "displacement", "distance"]

ACCURATE = 100_000.0
"""Distance from the origin, m, up to which ownship and route are accepted."""

REACH = 300_000.0
"""Distance from the origin, m, beyond which an intruder cannot meet an ownship within ACCURATE of it in 400 s."""


class Place(NamedTuple):
    """A point of the frame; fields ``[...]``."""

    x: Any
    """East, m."""
    y: Any
    """North, m."""
    convergence: Any
    """Direction of the map's north, rad clockwise from true north."""


@cache
def _wgs84() -> "Geod":
    """Return the ellipsoid; imported on first use, because it takes a tenth of a node's start."""
    from pyproj import Geod

    return Geod(ellps="WGS84")


class Geodetic(NamedTuple):
    """A point on the ellipsoid; fields ``[...]``."""

    latitude: Any
    """Degrees."""
    longitude: Any
    """Degrees, in [-180, 180)."""
    convergence: Any
    """Direction of the map's north, rad clockwise from true north."""


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """The frame about an origin, WGS-84 degrees."""

    latitude: float
    longitude: float

    def place(self, latitude: Any, longitude: Any) -> Place:
        """Return where a point is in the frame.

        Args:
            latitude: degrees, ``[...]``.
            longitude: degrees, ``[...]``; 360 degrees more or less make no difference.
        """
        latitude, longitude = np.asarray(latitude, dtype=float), np.asarray(longitude, dtype=float)
        start = np.full(latitude.shape, self.longitude), np.full(latitude.shape, self.latitude)
        out, back, length = _wgs84().inv(*start, longitude, latitude)
        out, length = np.radians(out), np.asarray(length)
        arrival = np.radians(back) + math.pi
        return Place(length * np.sin(out), length * np.cos(out), _turn(arrival - out, length))

    def geodetic(self, x: Any, y: Any) -> Geodetic:
        """Return the point on the ellipsoid; the inverse of :meth:`place`.

        Args:
            x: m, ``[...]``.
            y: m, ``[...]``.
        """
        x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
        out, length = np.arctan2(x, y), np.hypot(x, y)
        start = np.full(x.shape, self.longitude), np.full(x.shape, self.latitude)
        longitude, latitude, back = _wgs84().fwd(*start, np.degrees(out), length)
        arrival = np.radians(back) + math.pi
        longitude = np.remainder(np.asarray(longitude) + 180.0, 360.0) - 180.0
        return Geodetic(np.asarray(latitude), longitude, _turn(arrival - out, length))

    def velocity(self, latitude: Any, longitude: Any, east: Any, north: Any) -> tuple[Any, Any]:
        """Return a velocity given by its true east and north components at a point as components in the frame, m/s."""
        turn = self.place(latitude, longitude).convergence
        cosine, sine = np.cos(turn), np.sin(turn)
        return east * cosine - north * sine, east * sine + north * cosine


def distance(latitude_a: float, longitude_a: float, latitude_b: float, longitude_b: float) -> float:
    """Return the length of the geodesic between two points, m."""
    return float(_wgs84().inv(longitude_a, latitude_a, longitude_b, latitude_b)[2])


def displacement(latitude_a: float, longitude_a: float, latitude_b: float, longitude_b: float) -> tuple[float, float]:
    """Return the way from one point to another, true east and north at the first, m."""
    out, _, length = _wgs84().inv(longitude_a, latitude_a, longitude_b, latitude_b)
    return length * math.sin(math.radians(out)), length * math.cos(math.radians(out))


def carried(latitude: float, longitude: float, east: float, north: float, seconds: float) -> tuple[float, float]:
    """Return latitude and longitude, degrees, after flying straight ahead for some seconds at a velocity in m/s."""
    track = math.degrees(math.atan2(east, north))
    longitude, latitude, _ = _wgs84().fwd(longitude, latitude, track, math.hypot(east, north) * seconds)
    return float(latitude), float(longitude)


def _turn(angle: Any, length: Any) -> Any:
    """Return the convergence in [-pi, pi); none at the origin, where the geodesic has no direction."""
    wrapped = np.remainder(angle + math.pi, 2.0 * math.pi) - math.pi
    return np.where(np.asarray(length) > 1e-6, wrapped, 0.0)
