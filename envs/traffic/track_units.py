"""Units and ranges of numbers in files of tracks, in SI units and radians."""

import math
from collections.abc import Mapping
from typing import NamedTuple

from envs.traffic.tracks import TrackError

FOOT, NAUTICAL_MILE = 0.3048, 1_852.0
KNOT = NAUTICAL_MILE / 3_600.0

FAMILIES: Mapping[str, Mapping[str, float]] = {
    "length": {"m": 1.0, "km": 1_000.0, "ft": FOOT, **dict.fromkeys(("nmi", "nm"), NAUTICAL_MILE)},
    "speed": {
        **dict.fromkeys(("m/s", "mps"), 1.0),
        **dict.fromkeys(("km/h", "kph"), 1.0 / 3.6),
        **dict.fromkeys(("kn", "kt", "kts", "knot", "knots", "nmi/h"), KNOT),
        "nmi/s": NAUTICAL_MILE,
        **dict.fromkeys(("ft/s", "fps"), FOOT),
        **dict.fromkeys(("fpm", "ft/min"), FOOT / 60.0),
    },
    "angle": {**dict.fromkeys(("deg", "degree", "degrees"), math.radians(1.0)), "rad": 1.0},
    "time": {
        **dict.fromkeys(("s", "sec"), 1.0),
        "ms": 1e-3,
        "min": 60.0,
        **dict.fromkeys(("h", "hr"), 3_600.0),
    },
    "none": {"none": 1.0, "unitless": 1.0, "-": 1.0},
}
"""Units by what they measure, in lower case, with their SI value."""

DEGREES = " (are these degrees?)"  # hint for an angle out of range


def si(unit: str, family: str) -> float | None:
    """Return the SI value of one unit, None where the family has no such unit."""
    return FAMILIES[family].get(unit.strip().lower())


class Range(NamedTuple):
    """What a number may be, in the file's unit, both ends included, and the SI value of one such
    unit.
    """

    low: float
    high: float
    scale: float = 1.0
    hint: str = ""

    def si(self, value: float, where: str, *, repair: bool = False) -> float:
        """Return a number in SI units: nan where it is nan and, for repair, where it is out of
        range.

        Raises:
            TrackError: it is out of range; the message begins with ``where``.
        """
        if value == value and not self.low <= value <= self.high:  # noqa: PLR0124  nan is for the check of the rows
            if repair:
                return math.nan
            shown = f"{value:g}" if abs(value) <= 1e300 else repr(value)[:40]
            raise TrackError(
                f"{where}: {shown}, expected {self.low:.6g} to {self.high:.6g}{self.hint}"
            )
        return float(value) * self.scale
