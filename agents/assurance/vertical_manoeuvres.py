"""Manoeuvres up and down as altitude over time: pieces in which the acceleration is constant.

A manoeuvre to a higher target climbs, at every moment, as fast as one to a lower target or faster.
So it is as high or higher at every moment, and all manoeuvres to the targets of an interval lie
between those to its ends.
"""

from typing import NamedTuple

import numpy as np

from envs.aircraft import Vertical
from envs.arrays import Array, Float


class Flight(NamedTuple):
    """Altitudes over time in P pieces; fields ``[..., P]``. A piece that begins after its end is
    none.
    """

    begin: Array  # s after the request
    end: Array
    altitude: Array  # at the beginning, above that of the request, m
    climb: Array  # at the beginning, m/s
    acceleration: Array  # m/s^2

    @property
    def reached(self) -> Float[Array, "..."]:
        """When the last piece begins, in which the target is held, s."""
        return self.begin[..., -1]

    def mirrored(self) -> "Flight":
        """Return the flight that descends where this one climbs."""
        return self._replace(
            altitude=-self.altitude, climb=-self.climb, acceleration=-self.acceleration
        )

    def reversed(self) -> "Flight":
        """Return the flight with time going backwards, of the negative times."""
        length = self.end - self.begin
        gained = self.acceleration * length
        return Flight(
            -self.end,
            -self.begin,
            self.altitude + (self.climb + 0.5 * gained) * length,
            -(self.climb + gained),
            self.acceleration,
        )


class Bound(NamedTuple):
    """An altitude that changes evenly; fields ``[...]``."""

    altitude: Array  # at the request, above the ownship's then, m; infinite: there is none
    climb: Array  # m/s

    def mirrored(self) -> "Bound":
        """Return the one that falls where this one rises."""
        return Bound(-self.altitude, -self.climb)

    def reversed(self) -> "Bound":
        """Return it with time going backwards."""
        return self._replace(climb=-self.climb)


class Times(NamedTuple):
    """From when and until when, s after the request; fields ``[...]``. What begins after its end is
    never.
    """

    begin: Array
    end: Array

    def reversed(self) -> "Times":
        """Return them with time going backwards."""
        return Times(-self.end, -self.begin)


def to_climb(
    target: Float[Array, "..."], climb: Float[Array, "..."], acceleration: float, until: float
) -> Flight:
    """Return flights that change their climb to a target and hold it until a time, s.

    Targets and climbs at the request, m/s, ``[...]``, broadcast; the acceleration is in m/s^2.
    """
    change = target - climb
    return _flight(climb, [(np.abs(change) / acceleration, np.sign(change) * acceleration)], until)


def to_altitude(
    rise: Float[Array, "..."], climb: Float[Array, "..."], vertical: Vertical, until: float
) -> Flight:
    """Return flights that rise or fall by so much, m, as soon as they can, level off and stay until
    a time, s.

    Rises and climbs at the request, m/s, ``[...]``, broadcast. An aircraft that cannot level off
    soon enough passes the target and comes back.
    """
    acceleration = vertical.acceleration
    upwards = rise >= 0.5 * climb * np.abs(climb) / acceleration
    side = np.where(upwards, 1.0, -1.0)
    fastest = np.where(upwards, vertical.climb_max, vertical.descent_max)
    rise, climb_there = side * rise, side * climb
    squared = acceleration * rise + 0.5 * climb_there * climb_there
    rate = np.minimum(np.sqrt(np.maximum(squared, 0.0)), fastest)
    change = rate - climb_there
    first, last = np.abs(change) / acceleration, rate / acceleration
    remaining = rise - 0.5 * (climb_there + rate) * first - 0.5 * rate * last
    held = np.maximum(remaining, 0.0) / np.where(rate > 0.0, rate, 1.0)
    parts = [
        (first, side * np.sign(change) * acceleration),
        (held, 0.0 * side),
        (last, -side * acceleration),
    ]
    return _flight(climb, parts, until)


def _flight(climb: Array, parts: list[tuple[Array, Array]], until: float) -> Flight:
    """Return flights from a climb, m/s, ``[...]``, whose climb changes for some times, s, with some
    accelerations, m/s^2, and is held then.
    """
    duration, acceleration = (
        np.stack(np.broadcast_arrays(*fields), axis=-1) for fields in zip(*parts, strict=True)
    )
    gained = acceleration * duration
    climbs = np.asarray(climb)[..., None] + _sums(gained)
    rises = (climbs[..., :-1] + 0.5 * gained) * duration
    begin = _sums(duration)
    end = np.concatenate([begin[..., 1:], np.full_like(begin[..., :1], until)], axis=-1)
    still = np.zeros_like(begin[..., :1])
    return Flight(
        begin,
        np.minimum(end, until),
        _sums(rises),
        climbs,
        np.concatenate([acceleration, still], axis=-1),
    )


def _sums(values: Array) -> Array:
    """Return the sums of the first 0 to P values ``[..., P]``, ``[..., P + 1]``."""
    none = np.zeros_like(values[..., :1])
    return np.concatenate([none, np.cumsum(values, axis=-1)], axis=-1)


def first_below(flight: Flight, bound: Bound, times: Times) -> Float[Array, "..."]:
    """Return when flights are at a bound or below it first within some times, s; inf:
    they stay above. Flights ``[..., P]`` broadcast against bounds and times ``[...]``.
    """
    start, stop, gap, climb = _above(flight, bound, times)
    acceleration = flight.acceleration
    with np.errstate(invalid="ignore", divide="ignore"):
        # The first root of gap + climb t + acceleration t^2 / 2; the square root of what is
        # negative is nan, and no time.
        root = np.sqrt(climb * climb - 2.0 * acceleration * gap)
        falling = 2.0 * gap / (root - climb)
        after_climb = np.where(acceleration < 0.0, -(climb + root) / acceleration, np.inf)
    later = np.where(climb > 0.0, after_climb, falling)
    time = np.where(gap <= 0.0, start, start + later)
    return np.where((start <= stop) & (time <= stop), time, np.inf).min(axis=-1)


def least_above(flight: Flight, bound: Bound, times: Times) -> Float[Array, "..."]:
    """Return by how much flights are above a bound within some times at least, m; inf
    where these are never. The arguments are those of :func:`first_below`.
    """
    start, stop, gap, climb = _above(flight, bound, times)
    # A piece is lowest at an end, or where its climb becomes one upwards.
    rising = np.where(flight.acceleration > 0.0, flight.acceleration, np.inf)
    length = np.maximum(stop - start, 0.0)
    lowest = np.clip(-climb / rising, 0.0, length)
    least = np.minimum.reduce(
        [gap + (climb + 0.5 * flight.acceleration * time) * time for time in (lowest, length)]
    )
    return np.where(start <= stop, np.minimum(least, gap), np.inf).min(axis=-1)


def _above(flight: Flight, bound: Bound, times: Times) -> tuple[Array, Array, Array, Array]:
    """Return from when until when each piece is within some times, s, and by how much it is above a
    bound when that begins, m, and climbs faster, m/s, ``[..., P]``.
    """
    altitude, rate = (field[..., None] for field in bound)
    start = np.maximum(flight.begin, times.begin[..., None])
    stop = np.minimum(flight.end, times.end[..., None])
    since = start - flight.begin
    gained = flight.acceleration * since
    height = flight.altitude + (flight.climb + 0.5 * gained) * since
    return start, stop, height - (altitude + rate * start), flight.climb + gained - rate
