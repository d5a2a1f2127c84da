# pyright: reportMissingImports=false
"""The local frame: positions on the WGS-84 ellipsoid as metres east and north of an origin, and back.

The frame is the map of :mod:`envs.formats.local_frame`, azimuthal equidistant about its origin. Distances from the
origin are exact, and between any two points within 57 km of it good to 0.6 m (within 60 km to 0.69 m); a tangent plane
would sink 282 m under the ellipsoid there, so altitudes stay altitudes and never enter the frame. Away from the origin
the map's north is not true north: the angle between them, the convergence, turns velocities and headings at the point
where they are measured (0.58 degrees 60 km east of an origin at 47 degrees latitude, tens of degrees near a pole).
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from envs.angles import wrap

if TYPE_CHECKING:
    from pyproj import Geod

    from envs.formats.local_frame import Place

__all__ = ["ACCURATE", "Geodetic", "LocalFrame", "carried", "displacement", "distance"]

ACCURATE = 100_000.0
"""Distance from the origin, m, up to which ownship and route are accepted; it follows from the map's errors."""


def _wgs84() -> "Geod":
    """Return the ellipsoid; imported on first use, because it takes a tenth of a node's start."""
    from envs.formats.local_frame import WGS84

    return WGS84


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

    def place(self, latitude: Any, longitude: Any) -> "Place":
        """Return where a point is in the frame.

        Args:
            latitude: degrees, ``[...]``.
            longitude: degrees, ``[...]``; 360 degrees more or less make no difference.
        """
        from envs.formats.local_frame import local

        here = math.radians(self.latitude), math.radians(self.longitude)
        return local(np.radians(latitude), np.radians(longitude), here)

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
        longitude = np.remainder(np.asarray(longitude) + 180.0, 360.0) - 180.0
        # At the origin the geodesic has no direction.
        turn = np.where(length > 1e-6, wrap(np.radians(back) + math.pi - out, np), 0.0)
        return Geodetic(np.asarray(latitude), longitude, turn)


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
