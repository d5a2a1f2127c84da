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


class Asked(NamedTuple):
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
    given = parser.parse_args()
    policy = policy_in_flight(given.policy)
    usual = usual_options(policy, given.deadline)
    with threadpool_limits(1):
        every = [
            ask(question(given.seed + number, policy.aircraft), policy, usual)
            for number in range(given.requests)
        ]
    found: dict[str, Any] = {
        "benchmark": "levels",
        "requests": given.requests,
        "deadline_ms": 1e3 * usual.deadline_s,
        **figures(every, _STRAIGHT * policy.aircraft.separation),
    }
    show(found)
    report(found, ("numpy",))


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


def ask(asked: Question, policy: Policy, usual: Options) -> Asked:
    """Plan a request both ways, and with more time where neither solves it."""
    # Makes the tables of the process too, and says who is out.
    first = plan(*asked, policy, usual, own_altitude=OWN_ALTITUDE)
    level = asked._replace(intruders=_level_or_out(asked.intruders, first))
    windows = time_plan(asked, policy, usual, own_altitude=OWN_ALTITUDE)
    all_horizon = time_plan(level, policy, usual, own_altitude=OWN_ALTITUDE)
    solved = windows.answer.safe or all_horizon.answer.safe
    if not solved:
        patient = replace(usual, deadline_s=_PATIENT)
        solved = plan(*asked, policy, patient, own_altitude=OWN_ALTITUDE).safe
    return Asked(windows, all_horizon, solved, straight_is_clear(asked, usual, usual.last_free))


def _level_or_out(
    intruders: Sequence[VehicleState[Ground] | Intruder[Ground]], answer: Plan
) -> list[Intruder[Ground]]:
    """Return the intruders without altitudes, but for those that an answer leaves out as above or
    below.
    """
    out = {one.number for one in answer.excluded if one.apart is Apart.VERTICALLY}
    return [
        one if number in out else replace(one, altitude=None)
        for number, one in enumerate(intruders)
        if isinstance(one, Intruder)
    ]


def straight_is_clear(asked: Question, options: Options, until: float) -> bool:
    """Return whether the straight flight keeps every intruder away, horizontally or vertically,
    until some time, s.
    """
    times = np.arange(0.0, until, _STEP)
    for one in asked.intruders:
        assert isinstance(one, Intruder)
        other, level = one.state, one.altitude
        assert level is not None and level.vertical_speed is not None
        x = other.x + other.speed * times * math.cos(other.heading) - asked.own.speed * times
        y = other.y + other.speed * times * math.sin(other.heading)
        above = level.value + level.vertical_speed * times - OWN_ALTITUDE.value
        close = np.hypot(x, y) < options.requirement.separation + options.requirement.margin
        if (close & (np.abs(above) < options.vertical_filter + level.error)).any():
            return False
    return True


def figures(every: Sequence[Asked], straight_cost: float) -> dict[str, Any]:
    """Return the figures of the requests; a plan turns where it costs more than ``straight_cost``,
    m.
    """
    solved = sum(one.solved for one in every)
    clear = [one for one in every if one.straight_is_clear]
    found: dict[str, Any] = {"solved": solved, "straight_flight_is_clear": len(clear)}
    for name in ("windows", "all_horizon"):
        timed: list[Timed] = [getattr(one, name) for one in every]
        in_clear: list[Timed] = [getattr(one, name) for one in clear]
        safe = sum(one.answer.safe for one in timed)
        found[name.replace("_", " ")] = {
            "safe": safe,
            "safe_of_solved": safe / solved if solved else None,
            "needless_turns": sum(_turns(one.answer, straight_cost) for one in in_clear),
            **percentiles_ms("cpu", [one.seconds for one in timed], ("median", "p99")),
        }
    return found


def _turns(answer: Plan, straight_cost: float) -> bool:
    return not answer.safe or answer.cost > straight_cost


if __name__ == "__main__":
    run_cli(main)
