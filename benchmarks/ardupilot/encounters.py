"""The encounters: each follows from the seed and its number alone."""

import math

import numpy as np

from ros_bridge.mavlink.flight import BEGIN, Encounter, Intruder, place_of

CRUISE = 22.0
"""Airspeed of the mission, m/s."""

GOAL = 4_500.0
"""End of the mission, m east of home."""

_STRONGEST = 8.0  # m/s of wind
_APART = 600.0  # m between the mission's aircraft and an intruder at the beginning
_FASTEST_CLIMB = 5.0  # m/s
_FENCE = 1_200.0, 600.0  # m along the mission and across it


def encounter(seed: int, number: int, *, climbing: bool = False) -> Encounter:
    """Return an encounter of one to three aircraft, each of which turns in a third of the cases, in
    wind of 0 to 8 m/s, with a fence beside the mission in half of the cases; ``climbing``: each of
    them climbs or descends with 1 to 5 m/s.
    """
    draw = np.random.default_rng([seed, number])
    wind, wind_from = draw.uniform(0.0, _STRONGEST), draw.uniform(0.0, 360.0)
    speed = ground_speed(float(wind), float(wind_from))
    intruders = tuple(_intruder(draw, speed) for _ in range(draw.integers(1, 4)))
    fence = _fence(draw, BEGIN + 55.0 * speed) if draw.random() < 0.5 else ()
    if climbing:
        intruders = tuple(intruder._replace(climb=_climb(draw)) for intruder in intruders)
    return Encounter(
        number,
        intruders,
        float(wind),
        float(wind_from),
        fence=fence,
        cruise=speed,
        goal=GOAL,
    )


def ground_speed(wind: float, wind_from: float) -> float:
    """Return how fast the mission flies east in a wind, m/s, that comes from a direction, degrees
    clockwise from north.
    """
    towards = math.radians(270.0 - wind_from)
    across = wind * math.sin(towards)
    return math.sqrt(CRUISE**2 - across**2) + wind * math.cos(towards)


def _intruder(draw: np.random.Generator, speed: float) -> Intruder:
    while True:
        cpa = float(draw.uniform(45.0, 65.0))
        intruder = Intruder(
            float(draw.uniform(-math.pi, math.pi)),
            float(draw.uniform(15.0, 40.0)),
            cpa,
            float(draw.uniform(-150.0, 150.0)),
        )
        if draw.random() < 1.0 / 3.0:
            turn = math.radians(draw.uniform(30.0, 90.0)) * draw.choice((-1.0, 1.0))
            turn_at = cpa - float(draw.uniform(5.0, 25.0))
            intruder = intruder._replace(turn_at=turn_at, turn=float(turn))
        x, y, _ = place_of(intruder, 0.0, speed)
        if math.hypot(x - BEGIN, y) >= _APART:
            return intruder


def _climb(draw: np.random.Generator) -> float:
    """Return a climb or a descent, m/s."""
    return float(draw.uniform(1.0, _FASTEST_CLIMB) * draw.choice((-1.0, 1.0)))


def _fence(draw: np.random.Generator, middle: float) -> tuple[tuple[float, float], ...]:
    side, near = draw.choice((-1.0, 1.0)), draw.uniform(120.0, 300.0)
    length, depth = _FENCE
    west = float(middle + draw.uniform(-300.0, 300.0) - 0.5 * length)
    south, north = sorted((float(side * near), float(side * (near + depth))))
    east = west + length
    return (west, south), (east, south), (east, north), (west, north)
