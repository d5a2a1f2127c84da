"""Reports of aircraft: a whole state as it was reported, or the little that an unusable message
still holds.
"""

from dataclasses import dataclass
from typing import NamedTuple

from agents.planner.request import Altitude
from envs.formats.local_frame import carried, distance
from ros_bridge.core.fields import SECOND

FASTEST = 400.0
"""Ground speed that no aircraft exceeds, m/s."""


class Sighting(NamedTuple):
    """Which aircraft a message that cannot be used is about, and where it was, as far as that is
    known.
    """

    identifier: str
    time: int | None = None  # ns
    place: tuple[float, float] | None = None  # latitude and longitude, degrees
    altitude: Altitude | None = None


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
    position_std: float = 0.0  # one sigma per axis, m
    velocity_std: float = 0.0  # m/s
    true_airspeed: float | None = None  # m/s; None: unknown
    wind: tuple[float, float] | None = (
        None  # velocity of the air, true east and north, m/s; None: unknown
    )

    @property
    def place(self) -> tuple[float, float]:
        """Latitude and longitude, degrees."""
        return self.latitude, self.longitude

    @property
    def sighting(self) -> Sighting:
        """What is left of it where it cannot be used."""
        return Sighting(self.identifier, self.time, self.place, self.altitude)

    def off(self, place: tuple[float, float], time: int) -> float:
        """Return how far a place is from where the aircraft is to be expected at a time (ns),
        straight ahead, m.
        """
        seconds = (time - self.time) / SECOND
        return distance(*carried(*self.place, self.east, self.north, seconds), *place)
