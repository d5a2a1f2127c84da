"""Thrust of a governed turboprop: momentum theory of the disc, its losses, and a flat-rated engine.

A power P turned into thrust T by an ideal disc of area A satisfies 2 rho A v (V + v)^2 = P with T =
2 rho A v (V + v) (Rankine and Froude). What the blades lose is one factor on P. The slipstream,
faster than the flight by 2 v, adds to the drag of what it washes: that is taken from the thrust. At
idle the blades' own drag takes more than the engine gives: thrust is negative.
"""

import math

import numpy as np

from envs.arrays import Array
from envs.c208.facts import Variant, value

DENSITY_0 = 1.225  # of the standard atmosphere at sea level, kg/m^3
HORSEPOWER = 745.7  # W

SPEEDS = np.array([0.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0, 100.0, 115.0, 130.0])
"""True airspeeds of the tables, m/s."""

DENSITIES = np.array([0.40, 0.55, 0.70, 0.80, 0.90, 0.98, 1.08, 1.16, 1.225, 1.35])
"""Air densities of the tables, kg/m^3."""

_SLOWEST = 35.0
"""Below this speed the blades rest on their low-pitch stop and their drag stops growing, m/s."""


def density_at(altitude: float) -> float:
    """Return the density of the standard atmosphere at an altitude (m) below 11 km, kg/m^3."""
    return DENSITY_0 * (1.0 - 0.0065 * altitude / 288.15) ** 4.25588


def thrust(power: Array, speed: Array, density: Array) -> Array:
    """Return the installed thrust (N) of a shaft power (W) at a true airspeed (m/s) in air of a
    density (kg/m^3); arrays broadcast.
    """
    diameter = value("propeller_diameter") * 0.0254
    area = 0.25 * math.pi * diameter**2
    power = value("propeller_losses") * np.asarray(power, dtype=float)
    # Newton's steps on the induced velocity from above: the left side is convex, so that they
    # cannot overshoot.
    induced = np.cbrt(power / (2.0 * density * area)) + 0.0 * np.asarray(speed)
    for _ in range(30):
        excess = 2.0 * density * area * induced * (speed + induced) ** 2 - power
        slope = 2.0 * density * area * (speed + induced) * (speed + 3.0 * induced)
        induced = induced - excess / slope
    scrubbing = 0.5 * density * value("washed_area") * 4.0 * induced * (speed + induced)
    return 2.0 * density * area * induced * (speed + induced) - scrubbing


def maximum_thrust(variant: Variant, speed: Array, density: Array) -> Array:
    """Return the thrust at full throttle, N, at a true airspeed (m/s) in air of a density (kg/m^3).

    The power is the rated one, or what thinner air leaves of the thermodynamic one.
    """
    power = np.minimum(
        variant.rated_power, variant.thermodynamic_power * np.asarray(density) / DENSITY_0
    )
    return thrust(power * HORSEPOWER, speed, density)


def idle_thrust(variant: Variant, speed: Array, density: Array) -> Array:
    """Return the thrust at flight idle, N, at a true airspeed (m/s) in air of a density (kg/m^3).

    The propeller turns at its governed speed. The thrust is negative: the blades' drag is greater
    than what the engine gives.
    """
    diameter, turns = value("propeller_diameter") * 0.0254, value("propeller_speed") / 60.0
    profile = value("profile_power") * np.asarray(density) * turns**3 * diameter**5
    idle = value("idle_power") * variant.rated_power * HORSEPOWER * np.asarray(density) / DENSITY_0
    return (idle - profile) / np.maximum(speed, _SLOWEST)


def tables(variant: Variant) -> tuple[np.ndarray, np.ndarray]:
    """Return idle and maximum thrust at :data:`SPEEDS` and :data:`DENSITIES`, N, ``[12, 10]``
    each.
    """
    speed, density = SPEEDS[:, None], DENSITIES[None, :]
    return idle_thrust(variant, speed, density), maximum_thrust(variant, speed, density)


class Curve:
    """A function of one number by its values ``y`` at increasing ``x``, ``[N]``; faster than
    numpy's for one.

    It is tabulated at 241 equal steps from ``low``, x[0] by default, to x[-1], and constant beyond
    them.
    """

    def __init__(self, x: np.ndarray, y: np.ndarray, low: float | None = None) -> None:
        grid = np.linspace(x[0] if low is None else low, x[-1], 241)
        self._low, self._last = float(grid[0]), 239
        self._scale = 240 / (float(grid[-1]) - self._low)
        self._values = np.interp(grid, x, y).tolist()

    def __call__(self, x: float) -> float:
        """Return the function's value."""
        place = (x - self._low) * self._scale
        index = 0 if place < 0.0 else self._last if place >= self._last + 1 else int(place)
        share = place - index
        share = 0.0 if share < 0.0 else 1.0 if share > 1.0 else share
        first = self._values[index]
        return first + share * (self._values[index + 1] - first)
