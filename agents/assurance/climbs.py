"""What plans meet on their profiles.

On a profile an intruder may count in several times, between which it is above or below, and stands
once for each of them: a single time that holds all of them would call each pass above a loss.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agents.kernel.levels import Altitude, Line, lines
from agents.kernel.traffic import Traffic, Window
from agents.planner.judge.profile import flyable_profile
from agents.planner.request.options import L, Options
from agents.planner.request.reports import Intruder, times_of
from envs.arrays import Array, Shaped
from envs.frames import F
from envs.profile import Height, Profile, height_flown
from envs.trees import map_leaves
from envs.waypoints import Waypoint


class Met(NamedTuple):
    """What some flights meet by their altitudes, ``[N]``."""

    # each time in which an intruder counts, s from now, [N, K, T]; one that ends before it begins
    # is none
    window: Window
    areas: Array  # those that may be met: tuples of kernel.areas.ActiveArea, object [N]

    @property
    def times(self) -> int:
        """For how many times there is room, T."""
        return self.window.begin.shape[-1]

    @property
    def all_times(self) -> Window:
        """From the first time to the last, s from now, ``[N, K]``."""
        return Window(self.window.begin.min(axis=-1), self.window.end.max(axis=-1))

    def columns(self, traffic: Traffic) -> Traffic:
        """Return intruders ``[N, K]`` once for each of their times, ``[N, K * T]``."""
        count, others = traffic.mask.shape
        begin, end = (field.reshape(count, others * self.times) for field in self.window)
        spread = map_leaves(self.repeat, traffic._replace(window=None))
        return spread._replace(mask=spread.mask & (begin <= end), window=Window(begin, end))

    def repeat(self, values: Shaped[Array, "N K"]) -> Shaped[Array, "N K*T"]:
        """Return values of intruders ``[N, K]`` once for each of their times."""
        return np.repeat(values, self.times, axis=-1)


class BackupMeets(NamedTuple):
    """What backups of one sense meet by their altitudes; fields ``[N]``."""

    met: Met
    possible: Array  # whether floor, ceiling and what is known of the altitude allow them, bool
    # share of the vertical separation kept from each at backup.sample_times, 0: none, [N, K, S]
    share: Array


class OnProfile(NamedTuple):
    """How plans that climb or descend are flown; fields ``[N]``."""

    error: Array  # of the altitude against the plan's, m, positive above; nan: it is unknown
    allowed: Array  # m
    met: Met


class Climb(NamedTuple):
    """The altitude of a plan that climbs or descends, or of a backup."""

    profile: Profile  # its times on the monitor's clock, s
    reference: str

    def error(self, own: Altitude | None, time: float) -> float:
        """Return by how much the ownship is above the plan at a time, s, m; nan where its altitude
        is unknown or of another reference.
        """
        if own is None or own.reference != self.reference:
            return np.nan
        return own.value - float(self.profile.at(np.array(time)))

    def since(self, time: float) -> "Climb":
        """Return the same with times from another moment on, s."""
        return self._replace(profile=self.profile.since(time))

    def at(self, time: float, options: Options[L]) -> Height:
        """Return where it is flown at a time, s, round its corners: plain floats."""
        height = height_flown(self.profile, options.vertical.acceleration, np.array(time))
        return Height(float(height.altitude), float(height.climb))

    def flight(self, own: Altitude | None, time: float, options: Options[L]) -> tuple[Line, ...]:
        """Return the altitude of the rest of the plan at a time, s; none where that of the ownship
        is unknown or of another reference. The present distance from the plan may last.
        """
        error = abs(self.error(own, time))
        if own is None or np.isnan(error):
            return ()
        return lines(self.profile.since(time), own, max(options.vertical_margin, error))


def climb_of(
    waypoints: Sequence[Waypoint], own: Altitude | None, time: float, options: Options[L]
) -> Climb | None:
    """Return the altitude of a plan requested at a time, s, with the ownship's by then; None where
    the plan is one in the plane.

    Raises:
        ValueError: it cannot be flown, or cannot be judged by these options and this altitude.
    """
    if all(point.altitude is None for point in waypoints):
        return None
    if not options.climbs:
        raise ValueError("the plan climbs, which its options do not allow")
    if own is None or own.vertical_speed is None:
        raise ValueError(
            "the plan climbs, but altitude or vertical speed at the request is unknown"
        )
    for level in (options.floor, options.ceiling):
        if level is not None and level.reference != own.reference:
            problem = f"the plan climbs from an altitude of {own.reference}"
            raise ValueError(f"{problem}, but floor or ceiling is of {level.reference}")
    return Climb(flyable_profile(waypoints, own, options).since(-time), own.reference)


def times_met(
    reports: Sequence[Intruder[F]], flight: Sequence[Line], options: Options[L]
) -> Window:
    """Return each time in which intruders count on a flight, s from now, ``[1, K, T]``."""
    times = [times_of(report, flight, options) for report in reports]
    most = max([1, *map(len, times)])
    begin = np.full((1, len(times), most), np.inf)
    end = -begin
    for place, of_report in enumerate(times):
        for number, (first, last) in enumerate(of_report):
            begin[0, place, number], end[0, place, number] = first, last
    return Window(begin, end)
