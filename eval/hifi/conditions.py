"""What a flight of the true aircraft meets: loading, altitude, wind, turbulence and sensors, drawn by its number."""

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from envs import draws
from envs.c208.conditions import TURBULENCE, Conditions, Loading

__all__ = ["CONDITIONS", "Drawn", "Family", "drawn"]

_STREAM = 1 << 40  # of the draws; the lower ones belong to starts and to the sensors' noise by step


@dataclass(frozen=True)
class Family:
    """A family of conditions; pairs (low, high) are ranges of uniform draws."""

    weight_lb: tuple[float, float] | None = None
    """With fuel; None: the variant's greatest."""
    centre_of_gravity: tuple[float, float] = (0.32, 0.32)
    """Share of the mean chord."""
    inertia_factor: tuple[float, float] = (1.0, 1.0)
    drag_factor: tuple[float, float] = (1.0, 1.0)
    lift_slope_factor: tuple[float, float] = (1.0, 1.0)
    altitude_m: tuple[float, float] = (2500.0, 2500.0)
    wind_mps: tuple[float, float] = (0.0, 0.0)
    """Speed of the wind; it blows to any direction."""
    turbulence: tuple[str, ...] = ("none",)
    """One of these, each equally likely."""
    wind_error_mps: float = 0.0
    """One sigma per axis of the error with which the planner knows the wind."""
    position_std: float = 0.0
    """Noise of the intruders' reported positions, one sigma per axis, m."""
    velocity_std: float = 0.0
    """Noise of the intruders' reported velocities, one sigma per axis, m/s."""
    latency: tuple[float, float] = (0.0, 0.0)
    """Age of the intruders' reports, s."""
    own_position_std: float = 0.0
    """Slow error of the own navigation, one sigma per axis, m."""


_WIND = (0.0, 15.0)
_LOADED = Family(
    weight_lb=(6500.0, 8807.0),
    centre_of_gravity=(0.25, 0.38),
    inertia_factor=(0.7, 1.3),
    drag_factor=(0.92, 1.08),
    lift_slope_factor=(0.95, 1.05),
)
_NOISE: dict[str, Any] = {
    "position_std": 30.0,
    "velocity_std": 3.0,
    "latency": (1.0, 2.0),
    "own_position_std": 5.0,
}

CONDITIONS: dict[str, Family] = {
    "calm": Family(),
    "loaded": _LOADED,
    "wind": Family(wind_mps=_WIND),
    "light": Family(wind_mps=_WIND, turbulence=("light",)),
    "moderate": Family(wind_mps=_WIND, turbulence=("moderate",)),
    "mixed": replace(_LOADED, wind_mps=_WIND, turbulence=tuple(TURBULENCE), wind_error_mps=1.0, own_position_std=5.0),
    "noisy": replace(_LOADED, wind_mps=_WIND, turbulence=tuple(TURBULENCE), wind_error_mps=1.0, **_NOISE),
}
"""The families by name: each thing alone, then everything but the intruders' sensors, then everything."""


class Drawn(NamedTuple):
    """The conditions of one flight."""

    air: Conditions
    altitude: float
    """m above the sea."""
    believed_wind: tuple[float, float]
    """As the planner knows it, towards east and north, m/s."""
    latency: float
    """Of the intruders' reports, s."""


def drawn(family: Family, seed: int, number: int, takeoff_weight: float) -> Drawn:
    """Return the conditions of flight ``number`` of a seed.

    Args:
        family: what they are drawn from.
        seed: of the run.
        number: of the flight.
        takeoff_weight: lb, where the family leaves the weight open.
    """
    u = draws.uniforms(seed, number, 1, (12,), stream=_STREAM)[0].tolist()
    gauss = draws.normals(seed, number, 1, (2,), stream=_STREAM + 1)[0].tolist()
    wind, direction = _between(family.wind_mps, u[0]), 2.0 * math.pi * u[1]
    east, north = wind * math.cos(direction), wind * math.sin(direction)
    weights = (takeoff_weight, takeoff_weight) if family.weight_lb is None else family.weight_lb
    loading = Loading(
        weight=_between(weights, u[2]),
        centre_of_gravity=_between(family.centre_of_gravity, u[3]),
        inertia_factor=_between(family.inertia_factor, u[4]),
        drag_factor=_between(family.drag_factor, u[5]),
        lift_slope_factor=_between(family.lift_slope_factor, u[6]),
    )
    kinds = family.turbulence
    kind: Any = kinds[min(int(u[7] * len(kinds)), len(kinds) - 1)]
    conditions = Conditions(loading, east, north, kind, int(u[8] * 2**31))
    error = family.wind_error_mps
    believed = east + error * gauss[0], north + error * gauss[1]
    return Drawn(conditions, _between(family.altitude_m, u[9]), believed, _between(family.latency, u[10]))


def _between(bounds: tuple[float, float], draw: float) -> float:
    low, high = bounds
    return low + (high - low) * draw
