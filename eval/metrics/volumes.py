"""Volumes around an aircraft that another must not enter, by standard: loss, time to loss, severity, alerts.

Everything is judged on relative states: position and velocity of the intruder less the ownship's. The surrogate flies
in one plane; where no altitudes are given both aircraft are taken to be co-altitude, the worst case, so that a rate of
losses is one *given* that the altitudes do not separate.
"""

import math
from typing import NamedTuple

import numpy as np

from envs.traffic.track_units import FOOT, NAUTICAL_MILE

__all__ = [
    "ALERTS",
    "VOLUMES",
    "Alert",
    "Relative",
    "Volume",
    "alerted",
    "cylinder",
    "lead_times",
    "lost",
    "severity",
    "time_to_loss",
]


class Volume(NamedTuple):
    """A volume; with ``tau`` 0 a cylinder around the aircraft."""

    name: str
    horizontal: float
    """Radius and largest horizontal miss distance (DMOD = HMD), m."""
    vertical: float
    """Half height, m."""
    tau: float = 0.0
    """Modified tau within which a predicted miss below ``horizontal`` counts, s."""
    source: str = ""


VOLUMES: dict[str, Volume] = {
    volume.name: volume
    for volume in (
        Volume("nmac", 500.0 * FOOT, 100.0 * FOOT, source="near mid-air collision, RTCA DO-365"),
        Volume("do365_en_route", 0.66 * NAUTICAL_MILE, 450.0 * FOOT, 35.0, "well clear, RTCA DO-365 phase 1"),
        Volume("do365_terminal", 1_500.0 * FOOT, 450.0 * FOOT, source="well clear in a terminal area, RTCA DO-365"),
        Volume("do365_non_cooperative", 2_200.0 * FOOT, 450.0 * FOOT, source="well clear, RTCA DO-365"),
        Volume("f3442", 2_000.0 * FOOT, 250.0 * FOOT, source="well clear of a small UAS, ASTM F3442"),
    )
}
"""The standards' volumes by name."""


class Alert(NamedTuple):
    """An alert level: a volume whose loss is predicted within a time."""

    volume: Volume
    seconds: float


_EN_ROUTE = VOLUMES["do365_en_route"]
ALERTS: dict[str, Alert] = {
    "preventive": Alert(_EN_ROUTE._replace(vertical=700.0 * FOOT), 55.0),
    "corrective": Alert(_EN_ROUTE, 55.0),
    "warning": Alert(_EN_ROUTE, 25.0),
}
"""The alert levels en route of DO-365. Predicted on straight courses; the standard leaves the prediction open."""


class Relative(NamedTuple):
    """The intruder less the ownship; fields ``[...]``."""

    x: np.ndarray
    """m."""
    y: np.ndarray
    vx: np.ndarray
    """m/s."""
    vy: np.ndarray
    z: np.ndarray | float = 0.0
    """m; 0: co-altitude is assumed."""
    vz: np.ndarray | float = 0.0
    """m/s."""


def cylinder(horizontal: float, vertical: float = math.inf) -> Volume:
    """Return a cylinder of one's own, radius and half height in m.

    Raises:
        ValueError: one of them is not positive.
    """
    if not (horizontal > 0.0 and vertical > 0.0):
        raise ValueError(f"cylinder of {horizontal:g} m and {vertical:g} m, expected positive lengths")
    return Volume(f"cylinder_{horizontal:g}m", horizontal, vertical, source="chosen")


def time_to_loss(volume: Volume, seen: Relative) -> np.ndarray:
    """Return the time until the volume is lost on straight courses, s, ``[...]``: 0 if it is, inf if it never will be.

    Modified tau is (r^2 - D^2) / (-r r'). It is at most T where r^2 - D^2 + T r r' <= 0, which along a straight
    course is a quadratic in time; the earlier root is the entry.
    """
    square_speed = np.maximum(seen.vx**2 + seen.vy**2, 1e-12)
    closing = seen.x * seen.vx + seen.y * seen.vy
    square = seen.x**2 + seen.y**2
    cpa = np.maximum(-closing / square_speed, 0.0)
    miss = (seen.x + seen.vx * cpa) ** 2 + (seen.y + seen.vy * cpa) ** 2
    limit = volume.horizontal**2
    inside = square <= limit

    linear = 2.0 * closing + volume.tau * square_speed
    constant = square + volume.tau * closing - limit
    root = np.sqrt(np.maximum(linear**2 - 4.0 * square_speed * constant, 0.0))
    entry = np.maximum((-linear - root) / (2.0 * square_speed), 0.0)
    possible = inside | ((closing < 0.0) & (miss <= limit))
    entry = np.where(inside, 0.0, entry)
    # The circle is left half a chord after the point where the course comes nearest to its middle.
    unbounded = -closing / square_speed
    nearest = np.maximum(square - closing**2 / square_speed, 0.0)
    leaving = unbounded + np.sqrt(np.maximum(limit - nearest, 0.0) / square_speed)

    above, below = _vertical(volume, seen)
    start, end = np.maximum(entry, above), np.minimum(leaving, below)
    return np.where(possible & (start <= end + 1e-9), start, np.inf)


def lost(volume: Volume, seen: Relative) -> np.ndarray:
    """Return whether the volume is lost at this moment, bool ``[...]``."""
    return time_to_loss(volume, seen) <= 0.0


def severity(volume: Volume, seen: Relative) -> np.ndarray:
    """Return the severity of the loss at this moment in [0, 1], ``[...]``: 0 well clear, 1 a collision.

    Penetrations of range, of the predicted horizontal miss and of the vertical distance, joined by the
    Fernandez-Guasti norm a (+) b = sqrt(a^2 + (1 - a^2) b^2) (RTCA SC-228, closed-loop metrics; DO-365 appendix L).
    """
    square_speed = np.maximum(seen.vx**2 + seen.vy**2, 1e-12)
    closing = seen.x * seen.vx + seen.y * seen.vy
    apart = np.hypot(seen.x, seen.y)
    cpa = np.maximum(-closing / square_speed, 0.0)
    miss = np.hypot(seen.x + seen.vx * cpa, seen.y + seen.vy * cpa)
    rate = volume.tau * closing / np.maximum(apart, 1e-9)
    reach = 0.5 * (np.sqrt(rate**2 + 4.0 * volume.horizontal**2) - rate)
    parts = (
        apart / np.maximum(reach, volume.horizontal),
        miss / volume.horizontal,
        np.abs(seen.z) / volume.vertical + 0.0 * apart,
    )
    ranged, missed, height = (np.minimum(part, 1.0) for part in parts)
    return 1.0 - _joined(_joined(ranged, missed), height)


def alerted(level: Alert, seen: Relative) -> np.ndarray:
    """Return whether the level's alert is on, bool ``[...]``."""
    return time_to_loss(level.volume, seen) <= level.seconds


def lead_times(alert: np.ndarray, loss: np.ndarray, dt: float) -> np.ndarray:
    """Return how long before the first loss the first alert came, s, ``[N]``: nan without a loss, 0 without an alert.

    Args:
        alert, loss: bool ``[T, N]``.
        dt: between the rows, s.
    """
    first_loss = np.where(loss.any(axis=0), np.argmax(loss, axis=0), -1)
    first_alert = np.where(alert.any(axis=0), np.argmax(alert, axis=0), len(alert))
    return np.where(first_loss < 0, np.nan, dt * np.maximum(first_loss - first_alert, 0))


def _vertical(volume: Volume, seen: Relative) -> tuple[np.ndarray, np.ndarray]:
    """Return from when until when the heights are within the volume, s; (inf, -inf) if never."""
    z, vz = np.asarray(seen.z, np.float64), np.asarray(seen.vz, np.float64)
    level = np.abs(vz) < 1e-9
    rate = np.where(level, 1.0, vz)
    one, other = (-volume.vertical - z) / rate, (volume.vertical - z) / rate
    within = np.abs(z) <= volume.vertical
    start = np.where(level, np.where(within, 0.0, np.inf), np.maximum(np.minimum(one, other), 0.0))
    end = np.where(level, np.where(within, np.inf, -np.inf), np.maximum(one, other))
    return start, end


def _joined(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.sqrt(a**2 + (1.0 - a**2) * b**2)
