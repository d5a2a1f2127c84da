"""What planner and monitor are told of an aircraft of the traffic."""

from typing import NamedTuple

from agents.planner.request.reports import Intruder
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.wind import Wind
from ros_bridge.core.categories import Categories
from ros_bridge.core.motion import Turns, expected_turn
from ros_bridge.core.reach import level
from ros_bridge.core.reports import Report, Unknown


class Assumptions(NamedTuple):
    """What reports do not say."""

    unknown: Unknown  # standard deviations
    turns: Turns
    categories: Categories  # separations by emitter category
    climb: float  # greatest vertical speed where none is known, m/s
    undulation: float | None  # of the geoid above the ellipsoid, m; None: unknown


def intruder_of(
    report: Report, state: VehicleState[Ground], age: float, wind: Wind, assumed: Assumptions
) -> Intruder[Ground]:
    """Return a report of an age, s, with its state in a frame and the wind there.

    Planner and monitor advance it over its age; only the altitude's reference is settled here.
    """
    position_std, velocity_std = report.spread(assumed.unknown)
    turn = expected_turn(report, state, wind, assumed.turns)
    return Intruder(
        state,
        age=age,
        turn_rate=turn.rate,
        turn_time=turn.time,
        turn_std=turn.std,
        position_std=position_std,
        velocity_std=velocity_std,
        altitude=level(report.height(assumed.climb), 0, assumed.undulation, assumed.climb),
        separation=assumed.categories.separations.get(report.category),
        vertical_separation=assumed.categories.vertical.get(report.category),
    )
