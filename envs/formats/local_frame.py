"""Geographic positions on the WGS-84 ellipsoid as metres east and north of a reference point.

The map is azimuthal equidistant about the reference, as in the ROS bridge: a point lies at its geodesic distance, in
the direction in which the geodesic leaves the reference. Heights do not enter. Away from the reference the map's north
is not true north; the angle between them, the convergence, turns velocities at the point where they were measured.
"""

from typing import Any, NamedTuple

import numpy as np
from pyproj import Geod, Transformer

from envs.angles import wrap

__all__ = ["WGS84", "Place", "geocentric", "local"]

WGS84 = Geod(ellps="WGS84")

_TO_CARTESIAN = Transformer.from_pipeline("+proj=cart +ellps=WGS84")


class Place(NamedTuple):
    """Points of the map; fields ``[...]``."""

    x: np.ndarray  # east, m
    y: np.ndarray  # north, m
    convergence: np.ndarray  # direction of the map's north, rad clockwise from true north

    def velocity(self, east: np.ndarray, north: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return velocities, given by true east and north at the points, along the map's x and y."""
        cosine, sine = np.cos(self.convergence), np.sin(self.convergence)
        return east * cosine - north * sine, east * sine + north * cosine


def local(latitude: Any, longitude: Any, reference: tuple[float, float]) -> Place:
    """Return where latitudes and longitudes ``[...]`` are on the map about those of a reference, rad."""
    latitude, longitude = np.asarray(latitude, np.float64), np.asarray(longitude, np.float64)
    start = np.full(latitude.shape, reference[1]), np.full(latitude.shape, reference[0])
    out, back, length = map(np.asarray, WGS84.inv(*start, longitude, latitude, radians=True))
    convergence = np.where(length > 1e-6, wrap(back + np.pi - out, np), 0.0)
    return Place(length * np.sin(out), length * np.cos(out), convergence)


def geocentric(latitude: np.ndarray, longitude: np.ndarray) -> np.ndarray:
    """Return points of the ellipsoid in Cartesian coordinates about the Earth's centre, m, ``[..., 3]``."""
    return np.stack(_TO_CARTESIAN.transform(longitude, latitude, np.zeros_like(latitude), radians=True), axis=-1)
