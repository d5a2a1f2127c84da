"""Bands of vertical speed and of altitude beside DAIDALUS's, second by second."""

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from agents.assurance.alerts import Alerting
from agents.assurance.bands import Bands
from agents.assurance.vertical_bands import (
    Altitudes,
    altitude_bands,
    layers,
    vertical_speed_bands,
)
from agents.kernel.levels import Gap
from agents.kernel.traffic import Requirement
from benchmarks.daidalus.edges import Kind, Match, match_edges
from benchmarks.daidalus.program import Setting, bands, scenario_text
from benchmarks.daidalus.sides import Flight, flight_of
from envs.aircraft import PAPER, Vertical
from envs.traffic.tracks import Track

FOOT, FOOT_A_MINUTE = 0.3048, 0.3048 / 60.0  # m and m/s

Flights = tuple[Track, list[Track]]
"""The ownship, and the others."""


def fine(setting: Setting) -> Setting:
    """Return a setting with many vertical targets and few others, and a cylinder of 450 ft."""
    return setting._replace(
        height=450.0 * FOOT,
        step_deg=30.0,
        step_speed=0.2 * setting.speed_max,
        step_climb=50.0 * FOOT_A_MINUTE,
        step_altitude=25.0 * FOOT,
    )


def _moved(track: Track, up: float, climb: float) -> Track:
    """Return a track that is so much higher, ft, and climbs so much in every second, ft/min."""
    rate = np.full(track.time.size, climb * FOOT_A_MINUTE)
    return track._replace(altitude=track.altitude + up * FOOT, vertical_rate=rate)


def _others(up: Sequence[float], climb: Sequence[float]) -> Callable[[Flights], Flights]:
    """Return a change that moves the others, by turns."""

    def change(flights: Flights) -> Flights:
        own, others = flights
        return own, [
            _moved(intruder, up[number % len(up)], climb[number % len(climb)])
            for number, intruder in enumerate(others)
        ]

    return change


CHANGES: dict[str, Callable[[Flights], Flights]] = {
    "as they are": lambda flights: flights,
    "others 600 ft higher, lower": _others([600.0, -600.0], [0.0]),
    "others climb, descend, 800 ft/min": _others([-300.0, 500.0], [800.0, -800.0]),
    "ownship descends, 400 ft/min": lambda flights: (_moved(flights[0], 200.0, -400.0), flights[1]),
}
"""What is changed of every second of every scenario."""


class Compared(NamedTuple):
    """The edges of both sides in a scenario."""

    climbs: list[Match]
    altitudes: list[Match]


def compare_vertical(program: Path, flights: Flights, setting: Setting) -> Compared:
    """Compare both sides on a scenario."""
    alerting = Alerting.for_aircraft(PAPER)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "scenario.xyz").write_text(scenario_text(*flights))
        theirs = {second.time: second for second in bands(program, Path(folder), setting, alerting)}
    flight = flight_of(*flights)
    ours, compared = our_bands(flight, setting), Compared([], [])
    for row, time in enumerate(flight.time.tolist()):
        second = theirs.get(time)
        if second is None:
            continue
        for edges, intervals, mine, kind in zip(
            compared, (second.climbs, second.altitudes), ours, kinds(setting), strict=True
        ):
            edges.extend(match_edges(intervals, mine, row, kind))
    return compared


def kinds(setting: Setting) -> tuple[Kind, Kind]:
    """Return how vertical speeds and altitudes are compared."""
    return (
        Kind(False, 100.0 * FOOT_A_MINUTE, setting.step_climb, setting.look_ahead),
        Kind(False, 100.0 * FOOT, setting.step_altitude, setting.look_ahead),
    )


def our_bands(flight: Flight, setting: Setting) -> tuple[Bands, Bands]:
    """Return our bands of vertical speeds and of altitudes of a scenario."""
    look_ahead, still = setting.look_ahead, 0.0 * flight.above
    gap = Gap(flight.above, flight.rate, still + setting.height, still)
    altitudes = Altitudes("msl", flight.altitude, flight.climb, 0.0 * flight.climb, gap)
    requirement = Requirement(setting.separation)
    shut = layers(flight.own, flight.traffic, requirement, altitudes, look_ahead)
    speeds, slow = (
        Vertical(rate, rate, setting.vertical_acceleration, setting.height)
        for rate in (setting.climb, setting.vertical_rate)
    )
    steps = np.arange(round(2.0 * setting.climb / setting.step_climb) + 1)
    climbs = steps * setting.step_climb - setting.climb
    far = (setting.vertical_rate + np.abs(flight.climb).max()) * look_ahead
    lowest, highest = flight.altitude.min() - far, flight.altitude.max() + far
    heights = np.arange(max(lowest, 0.0), highest, setting.step_altitude)
    return (
        vertical_speed_bands(shut, altitudes, speeds, look_ahead, climbs),
        altitude_bands(shut, altitudes, slow, look_ahead, heights),
    )
