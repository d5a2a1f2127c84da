"""The guidance bands and alerts of a flight, at each of its times, as a pilot would have seen them.

Of the true states, with straight intruders: what noise or a turn that nobody can see would have
changed is not in them (docs/explanation/assurance.md).
"""

from typing import Any, NamedTuple

import numpy as np

from agents.assurance.alerts import Alerting, no_alerts, regions, update
from agents.assurance.bands import (
    HEADINGS,
    SPEEDS,
    heading_bands,
    losses_on_course,
    recovery,
    speed_bands,
)
from agents.assurance.inputs import no_areas
from agents.kernel.areas import ActiveArea
from agents.kernel.traffic import Traffic
from agents.planner.request.options import Options
from envs.angles import wrap
from envs.areas import Area, after
from envs.frames import Air, F
from envs.kinematics import VehicleState
from envs.trees import take
from envs.wind import Wind

TRACKS = np.arange(HEADINGS) * (360.0 / HEADINGS)
"""Directions, degrees clockwise from north, ascending."""


class FlightBands(NamedTuple):
    """What is shown at T times of a flight among K intruders."""

    speed: np.ndarray  # that are looked at, m/s, ascending, [S]
    tracks: np.ndarray  # regions of TRACKS, codes of Region, int8, [T, 72]
    speeds: np.ndarray  # regions of the speeds, [T, S]
    level: np.ndarray  # of each intruder, codes of Level, int8, [T, K]
    loss: np.ndarray  # of the separation on the present course, s; inf: none, [T, K]
    way_out: np.ndarray  # number of the direction that is the way out; -1: some is free, [T]
    opens: np.ndarray  # when that keeps the separation, s; inf: not within the look-ahead, [T]
    shortfall: np.ndarray  # m until then, [T]
    track_areas: np.ndarray  # number of the area that closes each of TRACKS; -1: none, [T, 72]
    speed_areas: np.ndarray  # the same of the speeds, [T, S]


def flight_bands(
    own: VehicleState[Air],
    intruders: VehicleState[Air],
    options: Options,
    areas: tuple[Area, ...] = (),
    separations: np.ndarray | None = None,
) -> FlightBands:
    """Return the bands of a flight.

    Args:
        own: ownship, ``[T]``, a time step apart.
        intruders: likewise, ``[T, K]``.
        options: of plans.
        areas: as the air mass sees them at the start.
        separations: what must be kept from each intruder, m, ``[K]``; None: the aircraft's.
    """
    aircraft, requirement, limits = options.aircraft, options.requirement, options.limits
    alerting = Alerting.for_aircraft(aircraft)
    traffic, ahead = Traffic.straight(intruders), alerting.look_ahead
    if separations is not None:
        required = np.broadcast_to(separations, traffic.mask.shape)
        traffic = traffic._replace(separation=required)
    headings = wrap(0.5 * np.pi - np.radians(TRACKS), np)
    speeds = np.linspace(limits.speed_min, limits.speed_max, SPEEDS)
    areas_ahead = _areas_then(areas, len(own.x), aircraft.dt, ahead)
    of_tracks = heading_bands(own, traffic, requirement, limits, ahead, headings, areas_ahead)
    of_speeds = speed_bands(own, traffic, requirement, limits, ahead, speeds, areas_ahead)
    loss = losses_on_course(own, traffic, requirement, ahead)
    way_out = recovery(of_tracks, aircraft.separation)
    return FlightBands(
        speed=speeds,
        tracks=regions(of_tracks, alerting, aircraft.separation),
        speeds=regions(of_speeds, alerting, aircraft.separation),
        level=_levels(loss, traffic.mask, aircraft.dt, alerting),
        loss=loss,
        way_out=way_out.index,
        opens=way_out.opens,
        shortfall=-way_out.clearance,
        track_areas=of_tracks.area,
        speed_areas=of_speeds.area,
    )


def _levels(loss: np.ndarray, mask: np.ndarray, dt: float, alerting: Alerting) -> np.ndarray:
    """Return the alert levels of a flight's intruders, codes of Level, int8, ``[T, K]``, from the
    times to their losses, s, and which exist, both ``[T, K]``.
    """
    shown, level = no_alerts(1, loss.shape[1], alerting), np.zeros(loss.shape, np.int8)
    for step in range(len(loss)):
        time = np.array([step * dt])
        shown = update(shown, time, loss[step : step + 1], mask[step : step + 1], alerting)
        level[step] = shown.level[0]
    return level


def _areas_then(areas: tuple[Area, ...], steps: int, dt: float, ahead: float) -> np.ndarray:
    """Return the areas that count at each of so many times, as they are then, object ``[T]``."""
    by_step = no_areas(steps)
    for step in range(steps if areas else 0):
        moved = (after(area, step * dt) for area in areas)
        by_step[step] = tuple(ActiveArea(n, area, 0.0, ahead) for n, area in enumerate(moved))
    return by_step


def bands_data(bands: FlightBands) -> dict[str, Any]:
    """Return the bands as the page reads them: runs of equal regions, row after row."""
    return {
        "speed": bands.speed.round(2).tolist(),
        "tracks": _runs(bands.tracks),
        "speeds": _runs(bands.speeds),
        "track_areas": _runs(bands.track_areas),
        "speed_areas": _runs(bands.speed_areas),
    }


def wind_data(wind: Wind) -> list[float]:
    """Return a wind as pages read it: towards east and north, m/s."""
    return [round(float(wind.east), 2), round(float(wind.north), 2)]


def encounter_data(bands: FlightBands, options: Options) -> dict[str, Any]:
    """Return the bands as an encounter's file has them (docs/reference/display.md)."""
    way_out = [
        [index, _finite(opens), round(shortfall, 1) if index >= 0 else 0.0]
        for index, opens, shortfall in zip(
            bands.way_out.tolist(), bands.opens.tolist(), bands.shortfall.tolist(), strict=True
        )
    ]
    return {
        "look_ahead": Alerting.for_aircraft(options.aircraft).look_ahead,
        "track_deg": TRACKS.tolist(),
        "track_region": bands.tracks.tolist(),
        "speed": bands.speed.round(2).tolist(),
        "speed_region": bands.speeds.tolist(),
        "track_area": bands.track_areas.tolist(),
        "speed_area": bands.speed_areas.tolist(),
        "level": bands.level.tolist(),
        "loss": [[_finite(time) for time in row] for row in bands.loss.tolist()],
        "recovery": way_out,
    }


def _runs(codes: np.ndarray) -> list[int]:
    """Return a code and how often it follows, and so on."""
    flat = codes.ravel()
    begins = np.flatnonzero(np.append(True, flat[1:] != flat[:-1]))
    counts = np.diff(np.append(begins, flat.size))
    return np.stack([flat[begins], counts], axis=-1).ravel().tolist()


def _finite(time: float) -> float | None:
    return round(time, 2) if np.isfinite(time) else None


def states(whole: VehicleState[F], count: int, row: int) -> VehicleState[F]:
    """Return the first states ``[count, ...]`` of one flight of those recorded ``[T, N, ...]``."""
    return take(whole, (slice(0, count), row))
