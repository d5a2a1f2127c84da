"""A search in space without a deadline, apart from the planner: which encounters a simple flight
resolves.

Each flight turns at a constant rate by some angle and goes on straight, changes its speed to
another one, and its climb to another, all from the request on and held. What is flown is sampled
densely: at every sample the intruder, which flies straight on and climbs evenly, is the horizontal
separation away or the vertical one. Nothing of the planner is used.
"""

import cmath
import itertools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from envs.aircraft import Aircraft, Vertical
from envs.kinematics import Limits

STEP = 0.1  # s between samples
DURATION = 120.0  # s that are looked at
RATES = (1.0, 0.5)  # of the greatest turn rate, climb and descent
TURNS = tuple(math.radians(angle) for angle in range(30, 181, 30))
SHARES = (0.0, 0.5, 1.0)  # of the range of speeds


class Motion(NamedTuple):
    """An aircraft at the request, which flies straight on and climbs evenly if nothing is done."""

    x: float  # m
    y: float
    z: float
    heading: float  # rad
    speed: float  # over the horizon, m/s
    climb: float  # m/s, positive upwards


class Choice(NamedTuple):
    """A flight: what it turns by, and to which speed and climb it changes."""

    turn: float  # rad, positive to the left
    turn_rate: float  # rad/s, above 0
    speed: float  # over the horizon, m/s
    climb: float  # m/s, positive upwards


def escapes(own: Motion, intruder: Motion, aircraft: Aircraft) -> list[Choice]:
    """Return the flights that keep one of both separations from an intruder at every sample.

    Raises:
        ValueError: the aircraft states no vertical limits.
    """
    vertical = aircraft.vertical
    if vertical is None:
        raise ValueError("the aircraft states no vertical limits, expected some")
    times = STEP * np.arange(round(DURATION / STEP) + 1)
    over_horizon = list(_over_horizon(own, aircraft.limits, vertical))
    away = _away(own, intruder, over_horizon, aircraft.limits, times)
    climbs = own.climb, 0.0, *(share * vertical.climb_max for share in RATES)
    climbs = *climbs, *(-share * vertical.descent_max for share in RATES)
    change = vertical.acceleration
    rise = _ramp(own.climb, np.array(climbs)[:, None], -change, change, times)
    above = own.z + _integral(rise) - intruder.z - intruder.climb * times
    level = np.abs(above) < vertical.separation
    choices = list[Choice]()
    for climb, while_level in zip(climbs, level, strict=True):
        clear = (away[:, while_level] >= aircraft.separation).all(axis=-1)
        choices += [Choice(*over_horizon[row], climb) for row in np.flatnonzero(clear).tolist()]
    return choices


def _over_horizon(
    own: Motion, limits: Limits, vertical: Vertical
) -> Iterator[tuple[float, float, float]]:
    """Yield turns, rad, turn rates, rad/s, and speeds, m/s, of all flights of an ownship."""
    turns = [(0.0, limits.yaw_rate_max)]
    for share, angle, side in itertools.product(RATES, TURNS, (1.0, -1.0)):
        turns.append((side * angle, share * limits.yaw_rate_max))
    # With the climb they stay within the greatest speed.
    slow = limits.speed_min
    fast = math.sqrt(limits.speed_max**2 - max(vertical.climb_max, vertical.descent_max) ** 2)
    speeds = min(own.speed, fast), *(slow + share * (fast - slow) for share in SHARES)
    for (turn, rate), speed in itertools.product(turns, speeds):
        yield turn, rate, speed


def _away(
    own: Motion,
    intruder: Motion,
    flights: Sequence[tuple[float, float, float]],
    limits: Limits,
    times: np.ndarray,
) -> np.ndarray:
    """Return how far the intruder is over the horizon on flights at some times, m, ``[F, T]``."""
    turn, turn_rate, speed = np.array(flights).T[:, :, None]
    heading = own.heading + np.copysign(np.minimum(turn_rate * times, np.abs(turn)), turn)
    pace = _ramp(own.speed, speed, limits.acceleration_min, limits.acceleration_max, times)
    place = complex(own.x, own.y) + _integral(pace * np.exp(1j * heading))
    velocity = intruder.speed * cmath.exp(1j * intruder.heading)
    return np.abs(place - complex(intruder.x, intruder.y) - velocity * times)


def _ramp(
    start: float, end: np.ndarray, least: float, most: float, times: np.ndarray
) -> np.ndarray:
    """Return what changes from a value to others ``[F, 1]``, at rates between two, and stays,
    ``[F, T]``.
    """
    rate = np.where(end >= start, most, least)
    changed = rate * times
    return start + np.where(np.abs(changed) < np.abs(end - start), changed, end - start)


def _integral(rate: np.ndarray) -> np.ndarray:
    """Return the integral of a rate ``[F, T]`` over the samples from the first one on."""
    parts = 0.5 * STEP * (rate[:, 1:] + rate[:, :-1])
    return np.concatenate([np.zeros((len(rate), 1)), np.cumsum(parts, axis=1)], axis=1)
