"""Reports of aircraft: a whole state as it was reported."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

from agents.planner.request.request import Altitude
from envs.formats.local_frame import distance, fly_straight
from ros_bridge.core.fields import SECOND, Sighting

FASTEST = 400.0
"""Ground speed that no aircraft exceeds, m/s."""

WIND_STD = 0.01
"""One sigma of a reported wind's components, of the aircraft's greatest speed."""

UNKNOWN_WIND_STD = 0.05
"""One sigma of an unknown wind's components about calm, of the aircraft's greatest speed."""


class Unknown(NamedTuple):
    """What is taken for the standard deviations that reports lack, per axis."""

    position_std: float = 378.0  # m: NACp 5, 95 % within 926 m
    velocity_std: float = 1.23  # m/s: NACv 2, 95 % within 3 m/s
    wind_std: float = 5.0  # m/s, of the wind about calm: UNKNOWN_WIND_STD of 100 m/s
    reported_wind_std: float = 1.0  # m/s, of a wind that is reported: WIND_STD of 100 m/s


USUAL = Unknown()
"""The defaults of the nodes' parameters."""

EXACT = Unknown(0.0, 0.0, 0.0, 0.0)
"""For judgements in which noise that nobody declared must excuse nothing."""


@dataclass(frozen=True, slots=True)
class Report:
    """A state of an aircraft as reported, checked by :mod:`ros_bridge.core.conversions`."""

    identifier: str
    time: int  # at which it held, ns
    latitude: float  # degrees, WGS-84
    longitude: float
    east: float  # velocity over the ground, true east, m/s
    north: float
    altitude: Altitude | None = None  # None: unknown
    position_std: float | None = None  # one sigma per axis, m; None: unknown
    velocity_std: float | None = None  # m/s; None: unknown
    time_std: float = 0.0  # one sigma of the time, s
    true_airspeed: float | None = None  # m/s; None: unknown
    wind: tuple[float, float] | None = (
        None  # velocity of the air, true east and north, m/s; None: unknown
    )
    category: int = 0  # emitter category (:mod:`ros_bridge.core.categories`); 0: unknown
    callsign: str = ""  # "": unknown
    # What the aircraft's reports up to this one show: the least of the two standard deviations, m
    # and m/s, and its turn, rad/s, positive to the left, with one sigma of it.
    shown_std: tuple[float, float] = (0.0, 0.0)
    turn_rate: float = 0.0
    turn_std: float = 0.0

    @property
    def place(self) -> tuple[float, float]:
        """Latitude and longitude, degrees."""
        return self.latitude, self.longitude

    @property
    def sighting(self) -> Sighting:
        """What is left of it where it cannot be used."""
        return Sighting(self.identifier, self.time, self.place, self.altitude)

    @property
    def speed(self) -> float:
        """Over the ground, m/s."""
        return math.hypot(self.east, self.north)

    def height(self, unknown_climb: float) -> Altitude | None:
        """Return the altitude with what the time's error adds to its own: a rounded time is off by
        the square root of 3 standard deviations at most.
        """
        if self.altitude is None or self.time_std == 0.0:
            return self.altitude
        climb = self.altitude.vertical_speed
        rate = unknown_climb if climb is None else abs(climb)
        error = self.altitude.error + rate * math.sqrt(3.0) * self.time_std
        return replace(self.altitude, error=error)

    def spread(self, unknown: Unknown) -> tuple[float, float]:
        """Return one sigma of position, m, and velocity, m/s, per axis; the time's error moves the
        position.
        """
        position = unknown.position_std if self.position_std is None else self.position_std
        velocity = unknown.velocity_std if self.velocity_std is None else self.velocity_std
        position = math.hypot(position, self.speed * self.time_std)
        return max(position, self.shown_std[0]), max(velocity, self.shown_std[1])

    def off(self, place: tuple[float, float], time: int) -> float:
        """Return how far a place is from where the aircraft is to be expected at a time (ns),
        straight ahead, m.
        """
        seconds = (time - self.time) / SECOND
        return distance(*fly_straight(*self.place, self.east, self.north, seconds), *place)
