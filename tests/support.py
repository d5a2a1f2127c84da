"""Helpers of several rooms' tests: backends and states, flights with trajectories, reports, and
recorded encounters.
"""

import gzip
import json
import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import strategies as st
from pyproj import Geod

from envs.backend import FLOATS
from envs.encounters import Encounter, Scenario
from envs.kinematics import VehicleState
from envs.surrogate import redraw_pool
from envs.traffic.track_units import FOOT, KNOT

__all__ = [
    "ARRAY_BACKENDS",
    "BACKENDS",
    "WGS84",
    "Backend",
    "accelerations",
    "angle_between",
    "case",
    "flight",
    "headings",
    "mirror_state",
    "move_state",
    "pool_of",
    "random_states",
    "recorded_path",
    "reports_file",
    "speeds",
    "stack_states",
    "states",
    "vehicle",
    "yaw_rates",
]


def pool_of(scenarios: list[Scenario], weights: list[float], rows: int, count: int) -> Encounter:
    """Return a pool of starts ``[rows, count]`` of a mixture, drawn as trainings draw it."""
    draw = jax.jit(lambda key: redraw_pool(key, scenarios, weights, rows, count))
    return draw(jax.random.key(0))


def recorded_path(name: str) -> Path:
    """Return the path of a file or folder of recorded data, or skip the test."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    path = Path(os.environ.get("RLCAS_DATA") or default) / name
    if not path.exists():
        pytest.skip(f"{name} is not part of the project: set RLCAS_DATA to a folder that has it")
    return path


def case(name: str) -> Path:
    """Return the path of a synthetic case beside the recorded data, or skip the test."""
    path = recorded_path(".").parent / "cases" / name
    if not path.exists():
        pytest.skip(f"{name} is not part of the project: put it beside the folder of RLCAS_DATA")
    return path


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
    """Return a report a second: degrees, m/s, ft, m/s; a flight that climbs begins at the
    altitude.
    """
    reports = []
    for seconds_after in np.arange(0.0, seconds + 0.5 * step, step):
        x, y, back = WGS84.fwd(longitude, latitude, track, speed * seconds_after)
        reports.append(
            {
                "icao24": name,
                "timestamp": 1_000.0 * (begin + seconds_after),
                "latitude": y,
                "longitude": x,
                "altitude": altitude(seconds_after)
                if callable(altitude)
                else altitude + climb * seconds_after / FOOT,
                "groundspeed": speed / KNOT,
                "track": (back + 180.0) % 360.0,
                "vertical_rate": climb * 60.0 / FOOT,
            }
        )
    return reports


def reports_file(folder: Path, *flights: list[dict[str, Any]], name: str = "adsb.json") -> Path:
    """Write reports of several flights, one after the other."""
    path = folder / name
    data = json.dumps([report for reports in flights for report in reports]).encode()
    path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    return path


@dataclass(frozen=True)
class Backend:
    """One array namespace at one precision."""

    name: str
    xp: Any
    dtype: Any

    def apply(self, function: Callable[..., Any], *columns: Any) -> tuple[np.ndarray, ...]:
        """Return ``function(*columns)``, a tuple of arrays ``[N]``, computed in this backend, as
        float64.

        Plain floats are evaluated one element at a time.
        """
        rows = np.broadcast_arrays(*(np.asarray(column, self.dtype) for column in columns))
        if self.xp is FLOATS:
            results_of_rows = [function(*map(float, row)) for row in zip(*rows, strict=True)]
            return tuple(
                np.array(column, np.float64) for column in zip(*results_of_rows, strict=True)
            )
        results = function(*(self.xp.asarray(row) for row in rows))
        for result in results:
            assert result.dtype in (self.dtype, bool), f"{self.name}: a result is {result.dtype}"
        return tuple(np.asarray(result, np.float64) for result in results)

    def round_values(self, values: Any) -> np.ndarray:
        """Return float64 values that this backend represents exactly."""
        return np.asarray(values, self.dtype).astype(np.float64)


ARRAY_BACKENDS = (
    Backend("numpy64", np, np.float64),
    Backend("numpy32", np, np.float32),
    Backend("jax32", jnp, np.float32),
)
BACKENDS = (*ARRAY_BACKENDS, Backend("floats", FLOATS, np.float64))
headings = st.floats(-math.pi, math.pi, exclude_max=True)
speeds = st.floats(50.0, 100.0)
accelerations = st.floats(-0.5, 0.5)
yaw_rates = st.floats(-math.radians(3.0), math.radians(3.0))
_positions = st.floats(-10_000.0, 10_000.0)


@st.composite
def states(draw: st.DrawFn) -> VehicleState:
    """Draw a vehicle within 10 km of the origin and the surrogate's speeds, as float64 scalars."""
    return VehicleState(
        *(np.float64(draw(part)) for part in (_positions, _positions, headings, speeds))
    )


def random_states(
    generator: np.random.Generator, *shape: int, extent: float = 10_000.0
) -> VehicleState:
    """Return vehicles ``shape`` within ``extent`` of the origin and the surrogate's speeds."""
    return VehicleState(
        generator.uniform(-extent, extent, shape),
        generator.uniform(-extent, extent, shape),
        generator.uniform(-math.pi, math.pi, shape),
        generator.uniform(50.0, 100.0, shape),
    )


def vehicle(x: float, y: float, heading: float, speed: float) -> VehicleState:
    """Return one vehicle as a batch ``[1]``."""
    return VehicleState(*(np.array([value], np.float64) for value in (x, y, heading, speed)))


def stack_states(*vehicles: VehicleState) -> VehicleState:
    """Return vehicles ``[...]`` side by side, ``[..., K]``."""
    return VehicleState(*(np.stack(fields, axis=-1) for fields in zip(*vehicles, strict=True)))


def mirror_state(state: VehicleState) -> VehicleState:
    """Return the state reflected at the east axis."""
    heading = np.where(state.heading == -math.pi, state.heading, -state.heading)
    return VehicleState(state.x, -state.y, heading, state.speed)


def move_state(
    state: VehicleState, angle: float, east: float = 0.0, north: float = 0.0
) -> VehicleState:
    """Return the state rotated about the origin by an angle (rad) and then shifted (m)."""
    cosine, sine = math.cos(angle), math.sin(angle)
    heading = np.remainder(state.heading + angle + math.pi, 2.0 * math.pi) - math.pi
    return VehicleState(
        state.x * cosine - state.y * sine + east,
        state.x * sine + state.y * cosine + north,
        heading,
        state.speed,
    )


def angle_between(a: Any, b: Any) -> np.ndarray:
    """Return the size of the smallest turn from one angle to the other, rad."""
    return np.abs(np.angle(np.exp(1j * (np.asarray(a, np.float64) - np.asarray(b, np.float64)))))
