"""The altitude that a plan climbs and descends through: lines between corners.

Altitude is linear between two waypoints. A climb cannot change at once: its change by r at an
acceleration a begins r / (2 a) before the corner, ends as long after it, and leaves the lines by at
most r^2 / (8 a) (proofs/Climb.v). So the first leg has a corner of its own: from the request on the
ownship keeps its climb until r / (2 a), and flies from there on a line to the first waypoint.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from envs.arrays import Array
from envs.waypoints import Waypoint

STEADY = 1e-9
"""A change of climb that is none, m/s."""


_AT_ONCE = 1e-4
"""A first corner before this, s, is none: the aircraft leaves its line by less than 1e-8 m for each
m/s^2."""


class Corner(NamedTuple):
    """Where a climb changes."""

    time: float  # s after the request
    change: float  # of the climb, m/s, positive upwards


class Profile(NamedTuple):
    """Altitude over time; fields ``[C]``, C >= 2. The first and the last line go on beyond the
    ends.
    """

    time: Array  # of the corners and both ends, ascending, s after the request
    altitude: Array  # there, m

    @property
    def climbs(self) -> Array:
        """Climbs between the corners, m/s, ``[C - 1]``."""
        return np.diff(self.altitude) / np.diff(self.time)

    def at(self, time: Array) -> Array:
        """Return the altitude at times, s, ``[...]``, m."""
        line = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, self.time.size - 2)
        return self.altitude[line] + self.climbs[line] * (time - self.time[line])

    def since(self, time: float) -> "Profile":
        """Return the same with times from another moment on, s."""
        return self._replace(time=self.time - time)

    def corners(self) -> Iterator[Corner]:
        """Yield where the climb changes, in order of time."""
        changes = np.diff(self.climbs)
        for time, change in zip(self.time[1:-1].tolist(), changes.tolist(), strict=True):
            if abs(change) > STEADY:
                yield Corner(time, change)


class Height(NamedTuple):
    """Where an aircraft is up and down; floats, or arrays of one shape."""

    altitude: Array  # m
    climb: Array  # m/s, positive upwards


def level(altitude: float) -> Profile:
    """Return level flight at an altitude, m."""
    return Profile(np.array([0.0, 1.0]), np.full(2, altitude))


def levelling(height: Height, acceleration: float) -> Profile:
    """Return the profile of an aircraft that levels off at once, with an acceleration, m/s^2."""
    altitude, climb = height
    corner = first_corner(climb, acceleration)
    reached = altitude + rise_to_level(climb, acceleration)
    return Profile(
        np.array([-1.0, corner, corner + 1.0]), np.array([altitude - climb, reached, reached])
    )


def height_flown(profile: Profile, acceleration: float, time: Array) -> Height:
    """Return where a profile is flown at times, s after its request, ``[...]``, with climbs that
    change at an acceleration, m/s^2: round its corners.
    """
    altitude, climb = profile.at(time), profile.climbs[0] + np.zeros(np.shape(time))
    for corner in profile.corners():
        half = first_corner(corner.change, acceleration)
        since = np.clip(time - corner.time + half, 0.0, 2.0 * half)
        climb = climb + corner.change * since / (2.0 * half)
        # A parabola, less what the lines have of it; nothing after the change.
        risen = since * since / (4.0 * half) - np.maximum(since - half, 0.0)
        altitude = altitude + corner.change * risen
    return Height(altitude, climb)


def first_corner(change: float, acceleration: float) -> float:
    """Return when the climb's first corner is, s after the request, where the climb changes by so
    much, m/s, at an acceleration, m/s^2.
    """
    return 0.5 * abs(change) / acceleration


def rise_to_level(climb: float, acceleration: float) -> float:
    """Return how much higher an aircraft is that levels off at once from a climb, m/s, at an
    acceleration, m/s^2; negative from a descent, m.
    """
    return climb * first_corner(climb, acceleration)


def corner_error(change: float, acceleration: float) -> float:
    """Return by how much a change of climb, m/s, leaves the lines of a profile at most, m, at an
    acceleration, m/s^2.
    """
    return 0.125 * change * change / acceleration


def largest_change(error: float, acceleration: float) -> float:
    """Return the change of climb, m/s, that leaves the lines of a profile by an error, m, at most,
    at an acceleration, m/s^2.
    """
    return math.sqrt(8.0 * acceleration * error)


def first_change(rise: float, climb: float, time: float, acceleration: float) -> float:
    """Return by how much the climb changes after the request, m/s, so that the aircraft has risen
    by so much, m, when a time, s, is over; nan where the acceleration, m/s^2, does not suffice.

    The climb is that at the request, m/s. With r the change, ``|rise - climb T| = r (T - r / 2a)``.
    """
    missing = rise - climb * time
    root = time * time - 2.0 * abs(missing) / acceleration
    if root < 0.0:
        return math.nan
    return math.copysign(acceleration * (time - math.sqrt(root)), missing)


def climbing(
    altitude: float,
    climb: float,
    times: Sequence[float],
    altitudes: Sequence[float],
    *,
    acceleration: float,
) -> Profile:
    """Return the profile from an altitude, m, and a climb, m/s, at the request through altitudes,
    m, at ascending times, s after the request.

    Raises:
        ValueError: the first altitude cannot be reached in its time.
    """
    change = first_change(altitudes[0] - altitude, climb, times[0], acceleration)
    if math.isnan(change):
        problem = f"an altitude of {altitudes[0]:g} m cannot be reached in {times[0]:g} s"
        raise ValueError(f"{problem} with {acceleration:g} m/s^2 from {altitude:g} m")
    corner = first_corner(change, acceleration)
    if corner <= _AT_ONCE:
        time, heights = [0.0, *times], [altitude, *altitudes]
    else:
        time = [0.0, corner, *times]
        heights = [altitude, altitude + climb * corner, *altitudes]
    return Profile(np.array(time), np.array(heights))


def profile_of(
    altitude: float, climb: float, waypoints: Sequence[Waypoint], acceleration: float
) -> Profile | None:
    """Return the profile that waypoints are flown on, from an altitude, m, and a climb, m/s, at the
    request; None where they have none: the plan is one in the plane.

    Raises:
        ValueError: some waypoints have altitudes and others not, or the first cannot be reached.
    """
    heights = [point.altitude for point in waypoints if point.altitude is not None]
    if not heights:
        return None
    if len(heights) < len(waypoints):
        raise ValueError(f"{len(heights)} of {len(waypoints)} waypoints have altitudes")
    times = [point.time for point in waypoints]
    return climbing(altitude, climb, times, heights, acceleration=acceleration)


def on_profile(points: Sequence[Waypoint], profile: Profile) -> tuple[Waypoint, ...]:
    """Return two waypoints or more with the altitudes of a profile, whose corners after the first
    waypoint are at waypoints.
    """
    times = np.array([point.time for point in points])
    altitudes = profile.at(times)
    # The last leg goes on as it was.
    climbs = np.diff(altitudes) / np.diff(times)
    levels = zip(altitudes.tolist(), [*climbs.tolist(), float(climbs[-1])], strict=True)
    return tuple(
        replace(point, altitude=altitude, climb=climb)
        for point, (altitude, climb) in zip(points, levels, strict=True)
    )
