"""How an ownship climbs and descends: along the profile of a plan, or level.

A profile is lines between corners, but no climb changes at once: its change about a corner begins
before it and ends as long after it (:mod:`envs.profile`). Feed-forward of that, and feedback of the
altitude, within what the aircraft can do.
"""

from typing import NamedTuple

import numpy as np

from envs.aircraft import Vertical
from envs.profile import Profile, first_corner

_GAIN = 0.5  # climb per error of altitude, 1/s


class Height(NamedTuple):
    """Where an aircraft is up and down."""

    altitude: float  # m
    climb: float  # m/s, positive upwards


def flown(profile: Profile, acceleration: float, time: float) -> Height:
    """Return where a profile is flown at a time, s after its request, with climbs that change at an
    acceleration, m/s^2.
    """
    altitude, climb = float(profile.at(np.float64(time))), float(profile.climbs[0])
    for corner in profile.corners():
        half = first_corner(corner.change, acceleration)
        since = min(max(time - corner.time + half, 0.0), 2.0 * half)
        climb += corner.change * since / (2.0 * half)
        # A parabola, less what the lines have of it; nothing after the change.
        risen = since * since / (4.0 * half) - max(since - half, 0.0)
        altitude += corner.change * risen
    return Height(altitude, climb)


def follow(
    height: Height, profile: Profile | None, time: float, vertical: Vertical, period: float
) -> Height:
    """Return where an aircraft is a period, s, later that follows a profile from a time on, s after
    its request, or levels off where there is none.
    """
    climb = 0.0
    if profile is not None:
        planned = flown(profile, vertical.acceleration, time + period)
        off = planned.altitude - (height.altitude + height.climb * period)
        climb = planned.climb + _GAIN * off
    climb = min(max(climb, -vertical.descent_max), vertical.climb_max)
    most = vertical.acceleration * period
    climb = min(max(climb, height.climb - most), height.climb + most)
    altitude = height.altitude + 0.5 * (height.climb + climb) * period
    return Height(altitude, climb)
