"""Random aircraft of a family.

Aircraft of a seed are drawn by number, so that number 3 is the same however many are drawn. Drawn
uniformly: the greatest speed, the time that it takes for one separation, and what makes aircraft
unlike: least speed, both accelerations and the turn circle, in units of separation and greatest
speed.
"""

import math

from agents.config.world import AircraftConfig
from envs.draws import uniforms

FAMILY = {
    "speed_max": (25.0, 240.0),  # m/s
    # Separation at the greatest speed, s; alike aircraft differ in nothing by it.
    "time_unit": (8.0, 40.0),
    "speed_min": (0.4, 0.75),  # of the greatest
    "acceleration_min": (0.03, 0.4),  # of speed_max^2 / separation, as a deceleration
    "acceleration_max": (0.03, 0.4),
    "turn_radius": (0.3, 2.5),  # of the circle at the greatest speed, separations
}
"""Ranges of what is drawn for each aircraft."""

_STREAM = 0x6661_6D69  # keeps the draws apart from those of encounters with the same seed


def draw_aircraft(seed: int, number: int) -> AircraftConfig:
    """Return an aircraft of a seed by its number."""
    draws = uniforms(seed, number, 1, (len(FAMILY),), stream=_STREAM)[0]
    drawn = {
        name: low + (high - low) * float(draw)
        for (name, (low, high)), draw in zip(FAMILY.items(), draws, strict=True)
    }
    # Rounded, so that the file says the same aircraft.
    fastest = _round(drawn["speed_max"])
    separation = _round(drawn["speed_max"] * drawn["time_unit"])
    unit = fastest * fastest / separation
    turn_radius = drawn["turn_radius"] * separation
    return AircraftConfig(
        speed_min_mps=_round(drawn["speed_min"] * fastest),
        speed_max_mps=fastest,
        acceleration_min_mps2=_round(-drawn["acceleration_min"] * unit),
        acceleration_max_mps2=_round(drawn["acceleration_max"] * unit),
        yaw_rate_max_deg_s=_round(math.degrees(fastest / turn_radius)),
        separation_m=separation,
    )


def _round(value: float) -> float:
    return float(f"{value:.5g}")
