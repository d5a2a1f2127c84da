"""An aircraft as readsb's fields tell of it: of ``aircraft.json``, and of the lines of BaseStation
put together.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from agents.planner.request.request import Altitude
from envs.traffic.track_units import FOOT, KNOT
from ros_bridge.core.categories import number_of
from ros_bridge.core.feeds.accuracy import EPU, EPV, sigma
from ros_bridge.core.feeds.traffic import Target
from ros_bridge.core.fields import FieldError, attempt, callsign, number, place
from ros_bridge.core.reports import FASTEST

__all__ = ["ADDRESS", "APART", "RowTarget", "first_known"]

ADDRESS = re.compile(r"~?[0-9a-f]{6}")
"""Of an aircraft, after ``~`` where it is none of ICAO's."""

APART = 3.0
"""Between a position and the velocity or altitude of another line that go with it, s."""

_CLIMBS = ("geom_rate", "baro_rate", "vert_rate")  # names of rates of climb, the best first


@dataclass(frozen=True)
class RowTarget(Target):
    """The parts of a row, each checked when it is read; its name is the address."""

    row: Mapping[str, Any]
    """Its fields as readsb names them, values as they came, and ``velocity_age``, s before the
    position.
    """

    def is_grounded(self) -> bool:
        """Return whether a field for the altitude says so."""
        return "ground" in (self.row.get("alt_baro"), self.row.get("altitude"))

    def is_by_radar(self) -> bool:
        """Return whether the position is of TIS-B."""
        row = self.row
        return str(row.get("type")).startswith("tisb") or "lat" in str(row.get("tisb"))

    def has_place(self) -> bool:
        """Return whether it has latitude and longitude."""
        row = self.row
        return first_known(row, "lat") is not None and first_known(row, "lon") is not None

    def place(self) -> tuple[float, float]:
        """Return latitude and longitude, degrees."""
        return place(self.field, self.row["lat"], self.row["lon"])

    def speed(self) -> float | None:
        """Return the speed over the ground, m/s; None: unknown, or too old for the position."""
        speed = self._beside_position("gs", "speed")
        return None if speed is None else number("", speed, 0.0, math.inf, "kt") * KNOT

    def velocity(self) -> tuple[float, float]:
        """Return true east and north, m/s."""
        speed, track = first_known(self.row, "gs", "speed"), first_known(self.row, "track")
        for name, value in (("speed", speed), ("track", track)):
            if value is None:
                raise FieldError(
                    f"{self.field}.{name}",
                    "has not been received, expected one beside the position",
                )
        self._velocity_age()
        speed = number(f"{self.field}.speed", speed, 0.0, FASTEST / KNOT, "kt") * KNOT
        track = math.radians(number(f"{self.field}.track", track, -360.0, 360.0, "degrees"))
        return speed * math.sin(track), speed * math.cos(track)

    def climb(self) -> float | None:
        """Return the vertical speed, m/s; None: unknown, or too old for the position."""
        climb = self._beside_position(*_CLIMBS)
        if climb is None:
            return None
        return number("", climb, -math.inf, math.inf, "") * FOOT / 60

    def altitude(self, reference: str | None) -> Altitude | None:
        """Return the altitude of a reference, or else above the ellipsoid, or else by pressure;
        None: unknown.
        """
        name = f"{self.field}.altitude"
        values = {
            "wgs84": first_known(self.row, "alt_geom"),
            "pressure": first_known(self.row, "alt_baro", "altitude"),
        }
        values = {above: value for above, value in values.items() if value != "ground"}
        climb = first_known(self.row, *_CLIMBS)
        if climb is not None:
            climb = number(name, climb, -20_000, 20_000, "ft/min") * FOOT / 60
        for above in sorted(values, key=lambda above: (above != reference, above != "wgs84")):
            if values[above] is not None:
                value = number(name, values[above], -3_000, 98_000, "ft")
                return Altitude(value * FOOT, above, climb)
        return None

    def position_std(self) -> float | None:
        """Return one sigma of the position per axis, m, by its NACp."""
        return sigma(EPU, self.row.get("nac_p"))

    def velocity_std(self) -> float | None:
        """Return one sigma of the velocity per axis, m/s, by its NACv."""
        return sigma(EPV, self.row.get("nac_v"))

    def category(self) -> int:
        """Return the emitter category."""
        return number_of(self.row.get("category"))

    def callsign(self) -> str:
        """Return the callsign."""
        return callsign(self.row.get("flight"))

    def _beside_position(self, *names: str) -> Any:
        """Return the first of some fields that is there, if it goes with the position."""
        is_old = isinstance(attempt(self._velocity_age), FieldError)
        return None if is_old else first_known(self.row, *names)

    def _velocity_age(self) -> float:
        """Return how much older the velocity is than the position, s, or raise
        :class:`FieldError` where they do not go together.
        """
        age = self.row.get("velocity_age", 0.0)
        return number(f"{self.field}.velocity_age", age, -APART, APART, "s")


def first_known(row: Mapping[str, Any], *names: str) -> Any:
    """Return the first of some fields that is there; dump1090-mutability has other names than
    readsb for some.
    """
    return next((row[name] for name in names if row.get(name) not in (None, "")), None)
