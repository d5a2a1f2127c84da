"""Volumes around an aircraft that another must not enter, by standard: loss and severity; and what
a flight cost.

Everything is judged on relative states: position and velocity of the intruder minus the ownship's.
A volume is lost where its horizontal and its vertical part are, at the same time. Of flights in the
plane both aircraft are taken to be co-altitude, the worst case, so that a rate of losses is one
*given* that the altitudes do not separate.
"""

from typing import NamedTuple

import numpy as np

from envs.aircraft import Aircraft
from envs.encounters import Encounter
from envs.frames import F
from envs.kinematics import VehicleState
from envs.relative import distance, leg_separation_in_space
from envs.traffic.track_units import FOOT, NAUTICAL_MILE
from envs.trees import take
from eval.flights.simulate import Flights, path_excess
from eval.flights.trajectories import Trajectories


class Volume(NamedTuple):
    """A volume; with ``tau`` 0 a cylinder around the aircraft."""

    horizontal: float  # radius and largest horizontal miss distance (DMOD = HMD), m
    vertical: float  # half height, m
    tau: float = 0.0  # modified tau within which a predicted miss below horizontal counts, s
    source: str = ""


VOLUMES = {
    "nmac": Volume(500.0 * FOOT, 100.0 * FOOT, source="near mid-air collision, RTCA DO-365"),
    "do365_en_route": Volume(
        0.66 * NAUTICAL_MILE, 450.0 * FOOT, 35.0, "well clear, RTCA DO-365 phase 1"
    ),
    "do365_terminal": Volume(
        1_500.0 * FOOT, 450.0 * FOOT, source="well clear in a terminal area, RTCA DO-365"
    ),
    "do365_non_cooperative": Volume(2_200.0 * FOOT, 450.0 * FOOT, source="well clear, RTCA DO-365"),
    "f3442": Volume(2_000.0 * FOOT, 250.0 * FOOT, source="well clear of a small UAS, ASTM F3442"),
}
"""The standards' volumes by name."""


class Relative(NamedTuple):
    """The intruder minus the ownship; fields ``[...]``, m and m/s."""

    x: np.ndarray
    y: np.ndarray
    vx: np.ndarray
    vy: np.ndarray
    z: np.ndarray | float = 0.0  # up


def relative(flown: Trajectories[F]) -> Relative:
    """Return the intruders relative to the ownship, ``[T + 1, N, K]``; nan after an encounter's
    end.
    """
    own, other = flown.own, flown.intruders
    vx, vy = own.speed * np.cos(own.heading), own.speed * np.sin(own.heading)
    altitudes = flown.altitudes
    return Relative(
        other.x - own.x[..., None],
        other.y - own.y[..., None],
        other.speed * np.cos(other.heading) - vx[..., None],
        other.speed * np.sin(other.heading) - vy[..., None],
        0.0 if altitudes is None else altitudes.intruders - altitudes.own[..., None],
    )


def is_lost(volume: Volume, relative: Relative) -> np.ndarray:
    """Return whether the volume is lost at this moment, bool ``[...]``.

    Modified tau is (r^2 - D^2) / (-r r'), so that it is at most T where r^2 - D^2 + T r r' <= 0.
    """
    closing, miss = _approach(relative)
    square, limit = relative.x**2 + relative.y**2, volume.horizontal**2
    coming = (closing < 0.0) & (miss**2 <= limit) & (square + volume.tau * closing <= limit)
    return ((square <= limit) | coming) & (np.abs(relative.z) <= volume.vertical)


def severity(volume: Volume, relative: Relative) -> np.ndarray:
    """Return the severity of the loss at this moment in [0, 1], ``[...]``: 0 well clear, 1 a
    collision.

    Penetrations of range, of the predicted horizontal miss and of the vertical distance, joined by
    the Fernandez-Guasti norm a (+) b = sqrt(a^2 + (1 - a^2) b^2) (RTCA SC-228, closed-loop metrics;
    DO-365 appendix L).
    """
    closing, miss = _approach(relative)
    apart = np.hypot(relative.x, relative.y)
    rate = volume.tau * closing / np.maximum(apart, 1e-9)
    reach = 0.5 * (np.sqrt(rate**2 + 4.0 * volume.horizontal**2) - rate)
    ranged = np.minimum(apart / np.maximum(reach, volume.horizontal), 1.0)
    missed = np.minimum(miss / volume.horizontal, 1.0)
    plane = np.sqrt(ranged**2 + (1.0 - ranged**2) * missed**2)
    above = np.minimum(np.abs(relative.z) / volume.vertical, 1.0)
    return 1.0 - np.sqrt(plane**2 + (1.0 - plane**2) * above**2)


def losses(volume: Volume, flown: Trajectories[F], mask: np.ndarray, dt: float) -> np.ndarray:
    """Return whether flights lose a volume, bool ``[N]``; arguments as of :func:`first_loss`."""
    return np.isfinite(first_loss(volume, flown, mask, dt))


def first_loss(volume: Volume, flown: Trajectories[F], mask: np.ndarray, dt: float) -> np.ndarray:
    """Return when flights with time steps of dt, s, first lose a volume to any intruder that
    exists, mask ``[N, K]``: s, ``[N]``; inf: never.

    A cylinder is judged on the closest approach between the steps too, in space by the cylindrical
    distance, and is lost at the end of a step; a volume with tau at the steps.
    """
    if volume.tau == 0.0:
        apart = flown.separation
        if flown.altitudes is not None:
            apart = _cylindrical_distances(volume, flown, mask, dt)
        # After the end of a flight every comparison is with nan, and false.
        lost, first = apart < volume.horizontal, 1
    else:
        with np.errstate(invalid="ignore"):
            lost, first = np.any(is_lost(volume, relative(flown)) & mask, axis=2), 0
    step = np.argmax(lost, axis=0) + first
    return np.where(lost.any(axis=0), step * dt, np.inf)


def _cylindrical_distances(
    volume: Volume, flown: Trajectories[F], mask: np.ndarray, dt: float
) -> np.ndarray:
    """Return the smallest cylindrical distance to any intruder during each step, m, ``[T, N]``; not
    a number after the end.
    """
    own: VehicleState[F] = VehicleState(*(field[..., None] for field in flown.own))
    others, above = flown.intruders, np.asarray(relative(flown).z)
    before, after = slice(None, -1), slice(1, None)
    with np.errstate(invalid="ignore"):
        apart = leg_separation_in_space(
            (take(own, before), take(own, after)),
            (take(others, before), take(others, after)),
            (above[before], above[after]),
            volume.horizontal / volume.vertical,
            dt,
        )
    return np.fmin.reduce(np.where(mask, apart, np.nan), axis=-1)


def costs(
    starts: Encounter, flights: Flights, flown: Trajectories[F], aircraft: Aircraft
) -> dict[str, np.ndarray]:
    """Return what flights cost beside the straight way, ``[N]`` each.

    Returns:
        path_excess: (length flown + distance left to the goal) / straight distance - 1, at least 0;
            nan where the encounter begins at the goal (:func:`eval.flights.simulate.path_excess`).
        time_excess_s: time flown, and what is left at the last speed, minus the straight way's at
            the first speed, s.
        cross_track_m: largest distance from the straight line from start to goal, m.
    """
    own = starts.own
    dx, dy = starts.goal_x - own.x, starts.goal_y - own.y
    route = np.maximum(distance(dx, dy, np), 1.0)  # a start on the goal has none
    aside = np.abs((flown.own.x - own.x) * dy - (flown.own.y - own.y) * dx) / route
    last = np.nanmax(
        np.where(np.isfinite(flown.own.x), np.arange(len(flown.own.x))[:, None], -1), axis=0
    )
    final = np.maximum(flown.own.speed[last, np.arange(len(last))], 1e-3)
    return {
        "path_excess": path_excess(flights, route, aircraft),
        "time_excess_s": flights.duration
        + flights.goal_distance / final
        - route / np.maximum(own.speed, 1e-3),
        "cross_track_m": np.nanmax(aside, axis=0),
    }


def _approach(relative: Relative) -> tuple[np.ndarray, np.ndarray]:
    """Return r r', m^2/s, and the distance at the closest point of approach on straight
    courses, m.
    """
    closing = relative.x * relative.vx + relative.y * relative.vy
    cpa = np.maximum(-closing / np.maximum(relative.vx**2 + relative.vy**2, 1e-12), 0.0)
    return closing, np.hypot(relative.x + relative.vx * cpa, relative.y + relative.vy * cpa)
