"""Standard deviations of reports from the codes that transponders and receivers send."""

import math
from typing import Any

from ros_bridge.core.reports import USUAL

__all__ = ["EPU", "EPV", "RECENT_STD", "coarse_velocity_std", "sigma"]

_TO_SIGMA = 2.448  # radius of 95 % of a circular normal distribution, in standard deviations
# Category 0 says that the accuracy is worse than that of 1, or unknown: it is no better than 1.
EPU = (18_520, 18_520, 7_408, 3_704, 1_852, 926, 555.6, 185.2, 92.6, 30, 10, 3)
"""Within which 95 % of positions are, m, by NACp."""

EPV = (10, 10, 3, 1, 0.3)
"""Within which 95 % of velocities are, m/s, by NACv."""

RECENT_STD = 1.0 / math.sqrt(3.0)
"""Root mean square of an age between 0 and 1 s, s: of what is cut off a whole second, and of a
position that was received in the second before it was passed on.
"""


def sigma(radii: tuple[float, ...], code: Any) -> float | None:
    """Return the standard deviation per axis that a category of accuracy means; None: unknown."""
    has_radius = isinstance(code, int) and 0 <= code < len(radii)
    return radii[code] / _TO_SIGMA if has_radius else None


def coarse_velocity_std(speed: float, step: float) -> float | None:
    """Return the standard deviation of a velocity of unknown accuracy whose track comes in steps;
    None where the usual one for what is unknown is as large as what the steps add.

    Receivers round a track or cut it off, so that it is up to a step away either way.

    Args:
        speed: m/s.
        step: rad.
    """
    rounding = speed * step / math.sqrt(3.0)
    usual = USUAL.velocity_std
    return None if rounding <= usual else math.hypot(rounding, usual)
