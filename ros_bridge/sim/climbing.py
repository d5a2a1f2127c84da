"""How an ownship climbs and descends: along the profile of a plan, or level.

Feed-forward of the profile as it is flown (:mod:`envs.profile`), and feedback of the altitude,
within what the aircraft can do.
"""

from envs.aircraft import Vertical
from envs.profile import Height, Profile, height_flown

_GAIN = 0.5  # climb per error of altitude, 1/s


def follow(
    height: Height, profile: Profile | None, time: float, vertical: Vertical, period: float
) -> Height:
    """Return where an aircraft is a period, s, later that follows a profile from a time on, s after
    its request, or levels off where there is none.
    """
    climb = 0.0
    if profile is not None:
        planned = height_flown(profile, vertical.acceleration, time + period)
        off = planned.altitude - (height.altitude + height.climb * period)
        climb = planned.climb + _GAIN * off
    climb = min(max(climb, -vertical.descent_max), vertical.climb_max)
    most = vertical.acceleration * period
    climb = min(max(climb, height.climb - most), height.climb + most)
    altitude = height.altitude + 0.5 * (height.climb + climb) * period
    return Height(altitude, climb)
