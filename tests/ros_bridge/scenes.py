"""Messages as plain objects, for what needs no ROS; their fields are those of ``rlcas_msgs``."""

import math
from types import SimpleNamespace
from typing import Any

from ros_bridge.core.geodesy import LocalFrame

__all__ = [
    "FRAME",
    "NOW",
    "SECOND",
    "aircraft",
    "alert",
    "geo_reference",
    "point",
    "published",
    "route_points",
    "stamp",
]

SECOND = 1_000_000_000
NOW = 1_700_000_000 * SECOND + 250_000_000
FRAME = LocalFrame(47.0, 8.0)


def stamp(time: int) -> SimpleNamespace:
    return SimpleNamespace(sec=time // SECOND, nanosec=time % SECOND)


def aircraft(x: float, y: float, heading: float, speed: float, *, frame: LocalFrame = FRAME, **more: Any) -> Any:
    """Return an AircraftState of a place and a velocity in the local frame."""
    at = frame.geodetic(x, y)
    true = heading - float(at.convergence)
    fields = {
        "header": SimpleNamespace(stamp=stamp(more.pop("time", NOW))),
        "id": "4b1a2c",
        "valid": 0x05,
        "latitude": float(at.latitude),
        "longitude": float(at.longitude),
        "altitude": 0.0,
        "altitude_reference": 0,
        "velocity": SimpleNamespace(x=speed * math.cos(true), y=speed * math.sin(true), z=0.0),
        "true_airspeed": 0.0,
        "wind": SimpleNamespace(x=0.0, y=0.0, z=0.0),
        "position_std": 0.0,
        "velocity_std": 0.0,
    }
    return SimpleNamespace(**(fields | more))


def geo_reference(frame: LocalFrame = FRAME, **more: Any) -> Any:
    fields = {
        "header": SimpleNamespace(stamp=stamp(NOW)),
        "latitude": frame.latitude,
        "longitude": frame.longitude,
        "geoid_undulation_valid": False,
        "geoid_undulation": 0.0,
    }
    return SimpleNamespace(**(fields | more))


def alert(*ids: str, level: int = 2, time: int = NOW) -> Any:
    return SimpleNamespace(header=SimpleNamespace(stamp=stamp(time)), level=level, intruder_ids=list(ids))


def point(index: int, latitude: float, longitude: float, **more: Any) -> Any:
    fields = {
        "index": index,
        "origin": 0,
        "valid": 0,
        "latitude": latitude,
        "longitude": longitude,
        "altitude": 0.0,
        "altitude_reference": 0,
        "track_deg": 0.0,
        "ground_speed": 0.0,
        "time_of_arrival": stamp(0),
    }
    return SimpleNamespace(**(fields | more))


def route_points(*, frame: LocalFrame = FRAME, spacing: float = 5_000.0, count: int = 10, first: int = 7) -> list[Any]:
    """Return a straight route eastwards through the origin's north, beginning ahead of it."""
    at = frame.geodetic([spacing * (number + 1) for number in range(count)], [0.0] * count)
    return [
        point(first + number, latitude, longitude)
        for number, (latitude, longitude) in enumerate(zip(at.latitude.tolist(), at.longitude.tolist(), strict=True))
    ]


def published(points: list[Any], status: int = 4) -> Any:
    return SimpleNamespace(status=status, waypoints=points)
