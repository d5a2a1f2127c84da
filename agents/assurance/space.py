"""What a flight would meet from now on by its altitude, and which altitude is flown.

A plan that climbs or descends is flown on its profile, and a backup levels off at once, or climbs
or descends. Without either, or where the ownship has left the profile, its present climb is held.
A backup goes on from the profile that is flown, so that no gust moves it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from agents.assurance.areas import may_be_met
from agents.assurance.backup import Sense
from agents.assurance.backup_heights import backup_flight, backup_profile, backups_met
from agents.assurance.climbs import BackupMeets, Climb, Met, OnProfile, times_met
from agents.assurance.inputs import Inputs, no_areas
from agents.assurance.thresholds import Thresholds
from agents.kernel.levels import Altitude, Line, steady
from agents.planner.request.climbs import with_all_levels_of
from agents.planner.request.options import L, Options
from agents.planner.request.reports import Intruder
from envs.areas import Area
from envs.arrays import Array, Int, Shaped
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.trees import take


@dataclass(frozen=True, slots=True)
class Space:
    """Intruders and areas about an ownship at one time, from which on all times count."""

    own: VehicleState[Air]  # plain floats
    reports: Sequence[Intruder[Any]]  # by place; only ages, altitudes and separations count
    areas: Sequence[Area]  # all that there are, in the air mass of the ownship
    ends: float  # when the plan that is flown ends, s; nan: there is none
    thresholds: Thresholds[Any]
    flown: Climb | None = None
    """What is flown until now, its times from now; None: no profile is."""

    def find_met(self, flight: Sequence[Line]) -> Met:
        """Return what is met on a flight, ``[1]``; none: its altitude is unknown, which counts as
        level with all.
        """
        return Met(times_met(self.reports, flight, self.thresholds.options), self.areas_met(flight))

    def areas_met(self, flight: Sequence[Line]) -> Shaped[Array, "1"]:
        """Return the areas that plan or backup may meet on a flight, object ``[1]``."""
        met = no_areas(1)
        if self.areas:
            met[0] = may_be_met(self.areas, self.own, flight, self.ends, self.thresholds)
        return met

    def find_backups_met(
        self, own: Altitude | None, sense: Sense, rows: Int[Array, " M"]
    ) -> BackupMeets:
        """Return what backups of a sense from an altitude meet, ``[M]``: none of ``[1]``, or it."""
        begin = self.begin_backup(own)
        options = self.options_from(begin)
        flight = backup_flight(sense, begin, options)
        met = self.find_met(flight)
        return take(backups_met(sense, [flight], [self.reports], met, options), rows)

    def options_from(self, begin: Altitude | None) -> Options[Any]:
        """Return the options of backups from an altitude, with the floors and ceilings of the areas
        that must not be left.
        """
        options = self.thresholds.options
        if begin is None:
            return options
        return with_all_levels_of(self.areas, begin.reference, options)

    def begin_backup(self, own: Altitude | None) -> Altitude | None:
        """Return the altitude from which a backup begins now, or goes on: that of the profile that
        is flown, or the ownship's where it is off that by more than the vertical margin; None where
        the ownship's is unknown.
        """
        options = self.thresholds.options
        if own is None or self.flown is None or own.reference != self.flown.reference:
            return own
        height = self.flown.at(0.0, options)
        if not abs(own.value - height.altitude) <= options.vertical_margin:
            return own
        return replace(own, value=height.altitude, vertical_speed=height.climb, climb_error=0.0)

    def complete(self, inputs: Inputs, climb: Climb | None, own: Altitude | None) -> Inputs:
        """Return inputs ``[1]`` with what is met by their altitudes by backups and by the active
        plan; None: that one is in the plane.
        """
        inputs = inputs._replace(backups=partial(self.find_backups_met, own))
        if climb is None:
            return inputs
        time, options = float(inputs.time[0]), self.thresholds.options
        error = np.array([climb.error(own, time)])
        allowed = np.array([options.vertical_margin + (own.error if own else 0.0)])
        met = self.find_met(climb.flight(own, time, options))
        return inputs._replace(on_profile=OnProfile(error, allowed, met))


def climb_of_backup(
    sense: Sense, begin: Altitude | None, time: float, options: Options[L]
) -> Climb | None:
    """Return the altitude of a backup of a sense that begins from an altitude at a time, s; None
    where there is none, or the altitude is unknown.
    """
    profile = backup_profile(sense, begin, options)
    if begin is None or profile is None:
        return None
    return Climb(profile.since(-time), begin.reference)


def hold(own: Altitude | None, options: Options[L]) -> tuple[Line, ...]:
    """Return the altitude of an aircraft that holds its climb as well as it follows a profile; none
    where its altitude is unknown.
    """
    if own is None:
        return ()
    return steady(replace(own, error=own.error + options.vertical_margin, climb_error=0.0))
