"""Units of recorded tracks: what files call them, and what one of each is in SI units and radians."""

import math
from collections.abc import Mapping

__all__ = ["FAMILIES", "FOOT", "KNOT", "NAUTICAL_MILE", "si"]

FOOT, NAUTICAL_MILE = 0.3048, 1_852.0
KNOT = NAUTICAL_MILE / 3_600.0

FAMILIES: Mapping[str, Mapping[str, float]] = {
    "length": {"m": 1.0, "km": 1_000.0, "ft": FOOT, "nmi": NAUTICAL_MILE, "nm": NAUTICAL_MILE},
    "speed": {
        "m/s": 1.0,
        "mps": 1.0,
        "km/h": 1.0 / 3.6,
        "kph": 1.0 / 3.6,
        "kn": KNOT,
        "kt": KNOT,
        "kts": KNOT,
        "knot": KNOT,
        "knots": KNOT,
        "nmi/s": NAUTICAL_MILE,
        "nmi/h": KNOT,
        "ft/s": FOOT,
        "fps": FOOT,
        "fpm": FOOT / 60.0,
        "ft/min": FOOT / 60.0,
    },
    "angle": {"deg": math.radians(1.0), "degree": math.radians(1.0), "degrees": math.radians(1.0), "rad": 1.0},
    "time": {"s": 1.0, "sec": 1.0, "ms": 1e-3, "min": 60.0, "h": 3_600.0, "hr": 3_600.0},
    "none": {"none": 1.0, "unitless": 1.0, "-": 1.0},
}
"""Units by what they measure, in lower case, with their SI value."""


def si(unit: str, family: str) -> float | None:
    """Return the SI value of one unit, None where the family has no such unit."""
    return FAMILIES[family].get(unit.strip().lower())
