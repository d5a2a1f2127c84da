"""What the benchmarks of the planner ask it, and how long it computes for an answer."""

import time
from collections.abc import Sequence
from typing import NamedTuple

from agents.planner import Intruder, Options, plan
from agents.planner.answer import Plan
from agents.planner.request.request import Altitude
from agents.policy.inference import Policy
from envs.areas import Area
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.waypoints import RoutePoint
from envs.wind import Wind

__all__ = ["Question", "Timed", "time_plan"]


class Question(NamedTuple):
    """What ``plan`` is asked."""

    own: VehicleState[Ground]
    intruders: list[VehicleState[Ground]] | list[Intruder[Ground]]
    route: list[RoutePoint]

    @property
    def states(self) -> list[VehicleState[Ground]]:
        """Of the intruders."""
        return [
            intruder.state if isinstance(intruder, Intruder) else intruder
            for intruder in self.intruders
        ]


class Timed(NamedTuple):
    """An answer, and the processor time of the thread that it took."""

    answer: Plan
    seconds: float


def time_plan(
    question: Question,
    policy: Policy,
    options: Options,
    *,
    own_altitude: Altitude | None = None,
    wind: Wind | None = None,
    areas: Sequence[Area] = (),
) -> Timed:
    """Plan a question once.

    What else the machine does lengthens the processor time of a thread less than the time by the
    clock; the planner counts its deadline by it too.
    """
    began = time.thread_time()
    answer = plan(*question, policy, options, own_altitude=own_altitude, wind=wind, areas=areas)
    return Timed(answer, time.thread_time() - began)
