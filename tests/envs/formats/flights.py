"""Reports of aircraft that fly along geodesics, for tests: positions and courses are those of the ellipsoid."""

import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import Geod

from envs.traffic.track_units import FOOT, KNOT

__all__ = ["WGS84", "flight", "reports_file"]

WGS84 = Geod(ellps="WGS84")


def flight(
    name: str,
    latitude: float,
    longitude: float,
    track: float,
    *,
    speed: float = 80.0,
    altitude: Any = 3_000.0,
    climb: float = 0.0,
    seconds: int = 240,
    begin: float = 1_600_000_000.0,
    step: float = 1.0,
) -> list[dict[str, Any]]:
    """Return a report a second: degrees, m/s, ft, m/s; a flight that climbs begins at the altitude."""
    reports = []
    for after in np.arange(0.0, seconds + 0.5 * step, step):
        x, y, back = WGS84.fwd(longitude, latitude, track, speed * after)
        reports.append(
            {
                "icao24": name,
                "timestamp": 1_000.0 * (begin + after),
                "latitude": y,
                "longitude": x,
                "altitude": altitude(after) if callable(altitude) else altitude + climb * after / FOOT,
                "groundspeed": speed / KNOT,
                "track": (back + 180.0) % 360.0,
                "vertical_rate": climb * 60.0 / FOOT,
            }
        )
    return reports


def reports_file(folder: Path, *flights: list[dict[str, Any]], name: str = "adsb.json") -> Path:
    """Write reports of several flights, one after the other."""
    path = folder / name
    data = json.dumps([report for each in flights for report in each]).encode()
    path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    return path
