"""Geographic positions to a local frame: WGS 84 to east, north and up of a reference point."""

import math
from typing import Any

import numpy as np

__all__ = ["local"]

_SEMI_MAJOR, _FLATTENING = 6_378_137.0, 1.0 / 298.257223563
_SQUARE = _FLATTENING * (2.0 - _FLATTENING)


def local(latitude: Any, longitude: Any, reference: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return east and north of a reference point, m, on the plane that touches the ellipsoid there.

    Exact up to the projection onto the plane, which shortens 50 km by 0.5 m. Heights are not taken into account.

    Args:
        latitude, longitude: rad, ``[...]``.
        reference: latitude and longitude of the origin, rad.
    """
    x, y, z = _geocentric(np.asarray(latitude), np.asarray(longitude))
    x0, y0, z0 = _geocentric(*map(np.asarray, reference))
    dx, dy, dz = x - x0, y - y0, z - z0
    sine, cosine = math.sin(reference[0]), math.cos(reference[0])
    sine_east, cosine_east = math.sin(reference[1]), math.cos(reference[1])
    east = cosine_east * dy - sine_east * dx
    north = cosine * dz - sine * (cosine_east * dx + sine_east * dy)
    return east, north


def _geocentric(latitude: np.ndarray, longitude: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    sine, cosine = np.sin(latitude), np.cos(latitude)
    normal = _SEMI_MAJOR / np.sqrt(1.0 - _SQUARE * sine * sine)
    return (
        normal * cosine * np.cos(longitude),
        normal * cosine * np.sin(longitude),
        normal * (1.0 - _SQUARE) * sine,
    )
