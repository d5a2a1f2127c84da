"""What both sides say of one scenario."""

from typing import NamedTuple

import numpy as np

from agents.assurance.bands import Bands
from agents.kernel.traffic import Traffic
from benchmarks.daidalus.program import Second
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.traffic.tracks import Track


class Flight(NamedTuple):
    """One scenario as both sides see it: ownship ``[T]``, intruders ``[T, K]``."""

    time: Array  # s, [T]
    own: VehicleState[Air]
    traffic: Traffic
    names: list[str]
    altitude: Array  # of the ownship, m, [T]
    climb: Array  # m/s, [T]
    above: Array  # of intruders above the ownship, m, [T, K]
    rate: Array  # climbs of intruders, m/s, [T, K]


class Ours(NamedTuple):
    """What we say of one scenario."""

    headings: Bands  # [T, B]
    speeds: Bands
    loss: Array  # s, [T, K]
    level: Array  # shown, [T, K]


class Sides(NamedTuple):
    """One scenario by both."""

    flight: Flight
    ours: Ours
    seconds: list[Second | None]  # what the program says at each time of the flight
    program_s: float  # wall time of the program
    ours_s: float


def flight_of(ownship: Track, others: list[Track]) -> Flight:
    """Return a scenario by the ownship's times; an intruder counts where it has a row of that
    time.
    """
    shape = ownship.time.size, len(others)
    rows = np.zeros((6, *shape))
    mask = np.zeros(shape, dtype=bool)
    for k, intruder in enumerate(others):
        place = np.clip(
            np.searchsorted(intruder.time, ownship.time - 1e-6), 0, intruder.time.size - 1
        )
        mask[:, k] = np.abs(intruder.time[place] - ownship.time) < 1e-6
        rows[:, :, k] = np.stack([*_state(intruder), intruder.altitude, intruder.vertical_rate])[
            :, place
        ]
    state: VehicleState[Air] = VehicleState(*rows[:4])
    return Flight(
        ownship.time,
        _state(ownship),
        Traffic.straight(state, mask),
        [intruder.name for intruder in others],
        ownship.altitude,
        ownship.vertical_rate,
        rows[4] - ownship.altitude[:, None],
        rows[5],
    )


def _state(track: Track) -> VehicleState[Air]:
    course, speed = np.arctan2(track.vy, track.vx), np.hypot(track.vx, track.vy)
    return VehicleState(track.x, track.y, course, speed)
