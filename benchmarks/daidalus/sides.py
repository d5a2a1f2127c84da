"""What both sides say of one scenario."""

from typing import NamedTuple

from agents.assurance.bands import Bands
from agents.kernel.traffic import Traffic
from benchmarks.daidalus.program import Second
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import VehicleState


class Flight(NamedTuple):
    """One scenario as both sides see it: ownship ``[T]``, intruders ``[T, K]``."""

    time: Array  # s, [T]
    own: VehicleState[Air]
    traffic: Traffic
    names: list[str]


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
