"""Encounters in space: what planner and monitor are told of altitudes, how profiles are flown, and
what the flights were up and down.

Reports say the true altitude of an intruder, and its vertical speed since the report before.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from agents.assurance.backup import Sense
from agents.assurance.backup_heights import backup_flight, backups_met
from agents.assurance.climbs import BackupMeets, Climb, Met, OnProfile, times_met
from agents.assurance.inputs import no_areas
from agents.kernel.levels import Altitude, Line, steady
from agents.kernel.traffic import Traffic, Window
from agents.planner.request.options import L, Options
from agents.planner.request.reports import Intruder
from agents.planner.search.in_space import Climber
from envs.aircraft import Aircraft
from envs.altitudes import LEVEL, REFERENCE, Altitudes, as_reported, at_step, climb_at
from envs.arrays import Array, Int
from envs.encounters import Encounter, EncounterError
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.observation import criticality
from envs.profile import Height, height_flown
from envs.relative import relative_motion, step_separation
from envs.trees import column, take
from eval.flights.trajectories import FlownAltitudes, Trajectories

_NOWHERE: VehicleState[Air] = VehicleState(0.0, 0.0, 0.0, 0.0)
_LEVEL_FLIGHT = 0.05  # m/s; what is slower is no climb and no descent


def at_one_level(encounters: Encounter) -> Encounter:
    """Return encounters ``[N]`` in space; those without altitudes with everybody at one level."""
    if encounters.altitudes is not None:
        return encounters
    own = np.full(encounters.goal_x.shape, LEVEL)
    rows = np.full((*encounters.mask.shape, 2), LEVEL)
    return encounters._replace(altitudes=Altitudes(own, rows))


def reports(altitudes: Altitudes, step: int, dt: float) -> list[list[Intruder[Air]]]:
    """Return what reports say of the altitudes of intruders ``[M, K]`` after some time steps of
    dt, s; all else of them stands in arrays.
    """
    rows, errors = as_reported(altitudes).intruders, altitudes.stated_error
    heights = at_step(rows, np.float64(step)), climb_at(rows, np.float64(step), dt)
    errors = np.zeros(rows.shape[:-1]) if errors is None else errors
    return [
        [
            of_altitude(Altitude(value, REFERENCE, climb, error))
            for value, climb, error in zip(*fields, strict=True)
        ]
        for fields in zip(*(field.tolist() for field in (*heights, errors)), strict=True)
    ]


def of_altitude(altitude: Altitude) -> Intruder[Any]:
    """Return a report of which only the altitude counts."""
    return Intruder(_NOWHERE, altitude=altitude)


def own_altitudes(height: Height) -> list[Altitude]:
    """Return the own altitudes ``[M]``."""
    pairs = zip(height.altitude.tolist(), height.climb.tolist(), strict=True)
    return [Altitude(value, REFERENCE, climb) for value, climb in pairs]


def climbers(
    own: Sequence[Altitude], targets: np.ndarray, intruders: Sequence[Sequence[Intruder[Air]]]
) -> list[Climber]:
    """Return what the planner is told of altitudes, those of the routes being m, ``[M]``."""
    return [Climber(*fields) for fields in zip(own, targets.tolist(), intruders, strict=True)]


def check_levels(encounters: Encounter, numbers: np.ndarray, options: Options) -> None:
    """Refuse encounters ``[N]`` of some numbers whose ownship begins below the floor or above the
    ceiling of plans.

    Raises:
        EncounterError: one does; the message says which.
    """
    altitudes = encounters.altitudes
    if altitudes is None:
        return
    for key, level, side in (("floor_m", options.floor, -1.0), ("ceiling_m", options.ceiling, 1.0)):
        if level is None:
            continue
        beyond = np.flatnonzero(side * (altitudes.own - level.value) > 0.0)
        if beyond.size:
            value = altitudes.own[beyond[0]]
            raise EncounterError(
                f"planner.{key} is {level.value:g} m; expected one that the ownship of encounter "
                f"{int(numbers[beyond[0]])} begins within, at {value:g} m"
            )


def find_met_holding(
    own: Sequence[Altitude], intruders: Sequence[Sequence[Intruder[Air]]], options: Options[L]
) -> Met:
    """Return when intruders count while the own altitudes ``[M]`` go on changing as now."""
    return _find_met([steady(altitude) for altitude in own], intruders, options)


def who_counts(traffic: Traffic, window: Window) -> Traffic:
    """Return intruders ``[M, K]`` with the times in which they count; who never does is none."""
    return traffic._replace(mask=traffic.mask & (window.begin <= window.end), window=window)


def find_backups_met(
    own: Sequence[Altitude],
    intruders: Sequence[Sequence[Intruder[Air]]],
    options: Options[L],
    sense: Sense,
    rows: Int[Array, " M"],
) -> BackupMeets:
    """Return what backups of a sense meet from the own altitudes, of ownships by their numbers,
    ``[M]``.
    """
    flights = [backup_flight(sense, own[row], options) for row in rows.tolist()]
    reports_of = [intruders[row] for row in rows.tolist()]
    met = _find_met(flights, reports_of, options)
    return backups_met(sense, flights, reports_of, met, options)


def find_met_on_profiles(
    profiles: np.ndarray,
    own: Sequence[Altitude],
    intruders: Sequence[Sequence[Intruder[Air]]],
    time: float,
    options: Options[L],
) -> Met:
    """Return when intruders count on the rest of profiles from a time, s, on, at which the ownships
    ``[M]`` are at their altitudes.

    The profiles, object ``[M]``, have times after the start.
    """
    climbs = [Climb(profile, REFERENCE) for profile in profiles]
    flights = [
        climb.flight(altitude, time, options) for climb, altitude in zip(climbs, own, strict=True)
    ]
    return _find_met(flights, intruders, options)


def on_profiles(
    profiles: np.ndarray,
    own: Sequence[Altitude],
    intruders: Sequence[Sequence[Intruder[Air]]],
    time: float,
    options: Options[L],
) -> OnProfile:
    """Return how profiles ``[M]`` are flown at a time, s, and what they meet; arguments as of
    :func:`find_met_on_profiles`.
    """
    climbs = [Climb(profile, REFERENCE) for profile in profiles]
    error = [climb.error(altitude, time) for climb, altitude in zip(climbs, own, strict=True)]
    allowed = np.full(len(error), options.vertical_margin)
    return OnProfile(
        np.array(error), allowed, find_met_on_profiles(profiles, own, intruders, time, options)
    )


def _find_met(
    flights: Sequence[Sequence[Line]],
    intruders: Sequence[Sequence[Intruder[Air]]],
    options: Options[L],
) -> Met:
    """Return what flights ``[M]`` meet of their intruders ``[K]`` each."""
    windows = [
        times_met(reports, flight, options)
        for reports, flight in zip(intruders, flights, strict=True)
    ]
    most = max((window.begin.shape[-1] for window in windows), default=1)
    shape = len(windows), len(intruders[0]) if intruders else 0, most
    begin, end = np.full(shape, np.inf), np.full(shape, -np.inf)
    for row, window in enumerate(windows):
        count = window.begin.shape[-1]
        begin[row, :, :count], end[row, :, :count] = window.begin[0], window.end[0]
    return Met(Window(begin, end), no_areas(len(windows)))


def heights_at(profiles: np.ndarray, time: np.ndarray, acceleration: float) -> Height:
    """Return where profiles, object ``[M]``, whose times are s after the start, are flown at times,
    s, ``[P]``, with climbs that change at an acceleration, m/s^2: ``[P, M]``.
    """
    altitude, climb = np.zeros((2, time.size, len(profiles)))
    for n, profile in enumerate(profiles):
        altitude[:, n], climb[:, n] = height_flown(profile, acceleration, time)
    return Height(altitude, climb)


def altitude_deviation(altitudes: FlownAltitudes) -> np.ndarray:
    """Return the largest deviations of own altitudes ``[T + 1, N]`` from the first, m, ``[N]``; not
    a number where there was no flight.
    """
    return np.fmax.reduce(np.abs(altitudes.own - altitudes.own[:1]), axis=0)


def columns_in_space(
    encounters: Encounter, trajectories: Trajectories[Air], aircraft: Aircraft
) -> dict[str, np.ndarray]:
    """Return the columns of flights ``[N]`` in space; not a number where there was no flight."""
    own, altitudes = trajectories.own, trajectories.altitudes
    assert altitudes is not None
    wide: VehicleState[Air] = VehicleState(*(field[..., None] for field in own))
    motion = relative_motion(wide, trajectories.intruders, np)
    first, last = take(motion, slice(None, -1)), take(motion, slice(1, None))
    nearest = step_separation(first, last, aircraft.dt, np)
    above = altitudes.intruders - altitudes.own[..., None]
    above = above[:-1] + nearest.share * (above[1:] - above[:-1])
    # By step and intruder, one after the other.
    steps, count, places = nearest.distance.shape
    apart = np.where(encounters.mask & np.isfinite(nearest.distance), nearest.distance, np.inf)
    apart = np.moveaxis(apart, 1, 0).reshape(count, steps * places)
    closest = np.argmin(apart, axis=1)
    rows = np.arange(count)
    miss = apart[rows, closest]
    vertical = np.abs(np.moveaxis(above, 1, 0).reshape(count, -1)[rows, closest])
    climbs = np.diff(altitudes.own, axis=0) / aircraft.dt
    moves = np.abs(climbs) > _LEVEL_FLIGHT
    begins = moves & ~np.concatenate([np.zeros((1, count), bool), moves[:-1]])
    return {
        "horizontal_miss_m": np.where(np.isfinite(miss), miss, np.nan),
        "vertical_miss_m": np.where(np.isfinite(miss), vertical, np.nan),
        "altitude_deviation_m": altitude_deviation(altitudes),
        "climbs": np.count_nonzero(begins, axis=0).astype(np.int32),
    }


def conditions_in_space(encounters: Encounter, aircraft: Aircraft) -> dict[str, np.ndarray]:
    """Return the columns that say how encounters ``[N]`` in space begin up and down, of the most
    critical intruder.
    """
    altitudes = encounters.altitudes
    assert altitudes is not None
    urgency = criticality(column(encounters.own), encounters.intruders, aircraft, np)
    number = np.argmin(np.where(encounters.mask, urgency, np.inf), axis=1)
    rows = altitudes.intruders[np.arange(len(number)), number]
    return {
        "vertical_distance_m": rows[:, 0] - altitudes.own,
        "intruder_climb_m_s": (rows[:, 1] - rows[:, 0]) / aircraft.dt,
    }
