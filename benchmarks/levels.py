"""Plans among aircraft that climb and descend: ``python -m benchmarks.levels [--requests 200]``.

Each request has one to four intruders that cross the straight flight within two separations of it,
level, climbing or descending; their altitudes at the crossing are uniform within 2400 m of the
ownship's. It is planned twice: with the altitudes, so that an intruder counts while it may be
level, and with those alone that leave an intruder out for the whole plan, as if the others were
level all the time. A turn is needless where the straight flight would have kept every intruder
either the separation or the vertical separation away, by samples in three dimensions.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from agents.planner import Intruder, Options, plan
from agents.planner.answer import Apart, Plan
from agents.planner.request.request import Altitude
from agents.policy.inference import Policy
from benchmarks.measure import (
    deadline_option,
    percentiles_ms,
    policy_in_flight,
    report,
    request_options,
    show,
    usual_options,
)
from benchmarks.questions import Question, Timed, time_plan
from commands.command import Parser, run_cli
from envs.aircraft import Aircraft
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.waypoints import RoutePoint

_PATIENT = 2.0  # s of computation
_CLIMB = 12.0  # m/s at most, of intruders
_APART = 1_200.0  # m, vertically, at the crossing at most
_STRAIGHT = 0.1  # separations of cost below which a plan does not turn
_STEP = 1.0  # s between samples
OWN_ALTITUDE = Altitude(3_000.0, "msl", 0.0)


class Planned(NamedTuple):
    """One request, planned."""

    windows: Timed
    """Each intruder counts while it may be level."""
    all_horizon: Timed
    """Each intruder that may be level at some time counts all the time."""
    solved: bool
    """Whether any of both is SAFE, or a plan with more time."""
    straight_is_clear: bool


def main() -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    request_options(parser, 200)
    deadline_option(parser)
    options = parser.parse_args()
    policy = policy_in_flight(options.policy)
    usual = usual_options(policy, options.deadline)
    with threadpool_limits(1):
        every = [
            ask(question(options.seed + number, policy.aircraft), policy, usual)
            for number in range(options.requests)
        ]
    summary: dict[str, Any] = {
        "benchmark": "levels",
        "requests": options.requests,
        "deadline_ms": 1e3 * usual.deadline_s,
        **figures(every, _STRAIGHT * policy.aircraft.separation),
    }
    show(summary)
    report(summary, ("numpy",))


def question(seed: int, aircraft: Aircraft, apart: float = _APART) -> Question:
    """Return a request of some number, with intruders up to so far above and below, m, at the
    crossing.
    """
    rng, unit = np.random.default_rng([seed, 53]), aircraft.separation
    fastest = aircraft.limits.speed_max
    own: VehicleState[Ground] = VehicleState(0.0, 0.0, 0.0, 0.8 * fastest)
    unit_time = unit / fastest  # 10 s for the paper's aircraft
    intruders = []
    for _ in range(int(rng.integers(1, 5))):
        when = unit_time * rng.uniform(5.0, 30.0)
        course, speed = rng.uniform(-math.pi, math.pi), fastest * rng.uniform(0.4, 1.1)
        x = own.speed * when + unit * rng.uniform(-1.5, 1.5) - speed * when * math.cos(course)
        y = unit * rng.uniform(-1.5, 1.5) - speed * when * math.sin(course)
        if math.hypot(x, y) < 2.0 * unit:
            continue
        climb = float(rng.choice([0.0, 1.0]) * rng.uniform(-_CLIMB, _CLIMB))
        height = OWN_ALTITUDE.value + rng.uniform(-apart, apart) - climb * when
        altitude = Altitude(float(height), "msl", climb, error=30.0)
        intruders.append(Intruder(VehicleState(x, y, course, speed), altitude=altitude))
    route = [RoutePoint(i, (12.0 + 5.0 * i) * unit, 0.0) for i in range(9)]
    return Question(own, intruders, route)


def ask(request: Question, policy: Policy, usual: Options) -> Planned:
    """Plan a request both ways, and with more time where neither solves it."""
    # Makes the tables of the process too, and says who is out.
    first = plan(*request, policy, usual, own_altitude=OWN_ALTITUDE)
    level = request._replace(intruders=_level_or_out(request.intruders, first))
    windows = time_plan(request, policy, usual, own_altitude=OWN_ALTITUDE)
    all_horizon = time_plan(level, policy, usual, own_altitude=OWN_ALTITUDE)
    solved = windows.answer.safe or all_horizon.answer.safe
    if not solved:
        patient = replace(usual, deadline_s=_PATIENT)
        solved = plan(*request, policy, patient, own_altitude=OWN_ALTITUDE).safe
    return Planned(windows, all_horizon, solved, straight_is_clear(request, usual, usual.last_free))


def _level_or_out(
    intruders: Sequence[VehicleState[Ground] | Intruder[Ground]], answer: Plan
) -> list[Intruder[Ground]]:
    """Return the intruders without altitudes, but for those that an answer leaves out as above or
    below.
    """
    apart = {
        exclusion.number for exclusion in answer.excluded if exclusion.apart is Apart.VERTICALLY
    }
    return [
        intruder if number in apart else replace(intruder, altitude=None)
        for number, intruder in enumerate(intruders)
        if isinstance(intruder, Intruder)
    ]


def straight_is_clear(request: Question, options: Options, until: float) -> bool:
    """Return whether the straight flight keeps every intruder away, horizontally or vertically,
    until some time, s.
    """
    times = np.arange(0.0, until, _STEP)
    for intruder in request.intruders:
        assert isinstance(intruder, Intruder)
        state, level = intruder.state, intruder.altitude
        assert level is not None and level.vertical_speed is not None
        x = state.x + state.speed * times * math.cos(state.heading) - request.own.speed * times
        y = state.y + state.speed * times * math.sin(state.heading)
        above = level.value + level.vertical_speed * times - OWN_ALTITUDE.value
        close = np.hypot(x, y) < options.requirement.separation + options.requirement.margin
        if (close & (np.abs(above) < options.vertical_filter + level.error)).any():
            return False
    return True


def figures(every: Sequence[Planned], straight_cost: float) -> dict[str, Any]:
    """Return the figures of the requests; a plan turns where it costs more than ``straight_cost``,
    m.
    """
    solved = sum(request.solved for request in every)
    clear = [request for request in every if request.straight_is_clear]
    summary: dict[str, Any] = {"solved": solved, "straight_flight_is_clear": len(clear)}
    for name in ("windows", "all_horizon"):
        timed: list[Timed] = [getattr(request, name) for request in every]
        in_clear: list[Timed] = [getattr(request, name) for request in clear]
        safe = sum(timing.answer.safe for timing in timed)
        summary[name.replace("_", " ")] = {
            "safe": safe,
            "safe_of_solved": safe / solved if solved else None,
            "needless_turns": sum(_turns(timing.answer, straight_cost) for timing in in_clear),
            **percentiles_ms("cpu", [timing.seconds for timing in timed], ("median", "p99")),
        }
    return summary


def _turns(answer: Plan, straight_cost: float) -> bool:
    return not answer.safe or answer.cost > straight_cost


if __name__ == "__main__":
    run_cli(main)
