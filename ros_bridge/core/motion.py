"""The kinematics of reports: their states and winds in a local frame, and how they are carried to
now.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple, Self

from agents.assurance.thresholds import Thresholds
from agents.kernel.traffic import Traffic, predict
from envs.angles import wrap
from envs.arrays import Array, Float
from envs.backend import FLOATS
from envs.formats.local_frame import LocalFrame
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.tracking.tracker import lasting, plausible_turn
from envs.wind import NO_WIND, Wind, over_ground, through_air, turn_through_air
from ros_bridge.core.reports import Report, Unknown

__all__ = [
    "ExpectedTurn",
    "Turns",
    "all_to_local",
    "carry_on",
    "expected_turn",
    "ownship_wind",
    "to_local",
    "turn_of",
    "wind_in",
]


def to_local(frame: LocalFrame, report: Report) -> VehicleState[Ground]:
    """Return a reported state in the local frame."""
    (state,) = all_to_local(frame, [report])
    return state


def all_to_local(frame: LocalFrame, reports: Sequence[Report]) -> list[VehicleState[Ground]]:
    """Return reported states in the local frame: of a hundred aircraft several times faster
    together than one by one.
    """
    place = frame.place([it.latitude for it in reports], [it.longitude for it in reports])
    fields = zip(reports, *(field.tolist() for field in place), strict=True)
    return [
        VehicleState(
            x,
            y,
            float(wrap(math.atan2(report.north, report.east) + convergence, FLOATS)),
            math.hypot(report.east, report.north),
        )
        for report, x, y, convergence in fields
    ]


class Turns(NamedTuple):
    """How the turns of aircraft are expected to go on."""

    lasts: float  # for how long after a report at most, s
    least: float  # turn rate that counts as a turn, rad/s
    most: float  # that an aircraft is believed to have, rad/s

    @classmethod
    def of(cls, thresholds: Thresholds) -> Self:
        """Return what a monitor with thresholds expects."""
        return cls(thresholds.turn_time, thresholds.turn_rate_min, thresholds.turn_rate_max)


def turn_of(report: Report, turns: Turns) -> float:
    """Return the turn rate of an aircraft over the ground that counts, rad/s."""
    return plausible_turn(report.turn_rate, turns.least, turns.most, FLOATS)


class ExpectedTurn(NamedTuple):
    """A turn through the air that an aircraft is expected to go on with; all 0 where it is none."""

    rate: float  # rad/s
    std: float  # one sigma of the rate, rad/s
    time: float  # for which it goes on after the report, s


def expected_turn(
    report: Report, state: VehicleState[Ground], wind: Wind, turns: Turns
) -> ExpectedTurn:
    """Return the turn through the air that an aircraft of the traffic is expected to go on with."""
    rate = turn_of(report, turns)
    std = report.turn_std if rate else 0.0
    time = lasting(rate, std, turns.lasts, FLOATS)
    return ExpectedTurn(turn_through_air(state, rate, wind), std, time)


def carry_on(
    state: VehicleState[Ground],
    rate: Float[Array, "..."],
    turn_time: Float[Array, "..."],
    seconds: Float[Array, "..."],
    wind: Wind,
) -> VehicleState[Ground]:
    """Return states over the ground some seconds later, ``[...]``.

    They go on with a turn through the air, rad/s, for a time, s, then straight on, as the planner
    predicts its traffic.
    """
    turning = Traffic.straight(through_air(state, wind, 0.0))
    turning = turning._replace(turn_rate=rate, turn_time=turn_time)
    return over_ground(predict(turning, seconds), wind, seconds)


def wind_in(
    frame: LocalFrame,
    latitude: float,
    longitude: float,
    blows: tuple[float, float],
    std: float = 0.0,
) -> Wind | None:
    """Return the wind at a place in a frame from its components east and north there and one sigma
    of both, m/s; None: still air.
    """
    if blows == (0.0, 0.0):
        return Wind(std=std) if std > 0.0 else None
    east, north = blows
    turn = float(frame.place(latitude, longitude).convergence)
    cosine, sine = math.cos(turn), math.sin(turn)
    return Wind(east * cosine - north * sine, north * cosine + east * sine, std)


def ownship_wind(frame: LocalFrame, report: Report, unknown: Unknown) -> Wind:
    """Return the wind that the ownship reports, in a frame; where it reports none, one that may
    blow from anywhere.
    """
    if report.wind is None:
        return Wind(std=unknown.wind_std)
    place = report.latitude, report.longitude
    return wind_in(frame, *place, report.wind, unknown.reported_wind_std) or NO_WIND
