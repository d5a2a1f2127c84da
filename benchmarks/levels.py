"""Plans among aircraft that climb and descend: ``python -m benchmarks.levels [--requests 200]``.

Each request has one to four intruders that cross the straight flight within two separations of it,
level, climbing or descending; their altitudes at the crossing are uniform within 2400 m of the
ownship's. It is planned twice: with the altitudes, so that an intruder counts while it may be
level, and with those alone that leave an intruder out for the whole plan, as if the others were
level all the time. A turn is needless where the straight flight would have kept every intruder
either the separation or the vertical separation away, by samples in three dimensions.
"""

import math
import time
from collections import Counter
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from agents.planner import Options, plan
from agents.planner.answer import Apart
from agents.planner.request import Altitude, Intruder
from agents.policy.inference import Policy
from benchmarks.measure import deadline_option, report, request_options, show, usual_options
from envs.aircraft import Aircraft
from envs.edge.command import Parser, run_cli
from envs.kinematics import VehicleState
from envs.waypoints import RoutePoint

_PATIENT = 2.0  # s of computation
_CLIMB = 12.0  # m/s at most, of intruders
_APART = 1_200.0  # m, vertically, at the crossing at most
_STRAIGHT = 0.1  # separations of cost below which a plan does not turn
_STEP = 1.0  # s between samples
OWN_ALTITUDE = Altitude(3_000.0, "msl", 0.0)


class Question(NamedTuple):
    """What ``plan`` is asked."""

    own: VehicleState
    intruders: list[Intruder]
    route: list[RoutePoint]


def question(seed: int, aircraft: Aircraft) -> Question:
    """Return a request of some number."""
    rng, unit = np.random.default_rng([seed, 53]), aircraft.separation
    fastest = aircraft.limits.speed_max
    own = VehicleState(0.0, 0.0, 0.0, 0.8 * fastest)
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
        height = OWN_ALTITUDE.value + rng.uniform(-_APART, _APART) - climb * when
        altitude = Altitude(float(height), "msl", climb, error=30.0)
        intruders.append(Intruder(VehicleState(x, y, course, speed), altitude=altitude))
    route = [RoutePoint(i, (12.0 + 5.0 * i) * unit, 0.0) for i in range(9)]
    return Question(own, intruders, route)


def straight_is_clear(asked: Question, options: Options, until: float) -> bool:
    """Return whether the straight flight keeps every intruder away, horizontally or vertically."""
    times = np.arange(0.0, until, _STEP)
    for one in asked.intruders:
        other, level = one.state, one.altitude
        assert level is not None and level.vertical_speed is not None
        x = other.x + other.speed * times * math.cos(other.heading) - asked.own.speed * times
        y = other.y + other.speed * times * math.sin(other.heading)
        above = level.value + level.vertical_speed * times - OWN_ALTITUDE.value
        close = np.hypot(x, y) < options.requirement.separation + options.requirement.margin
        if (close & (np.abs(above) < options.vertical_filter + level.error)).any():
            return False
    return True


def main() -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    request_options(parser, 200)
    deadline_option(parser)
    given = parser.parse_args()
    policy = Policy.load(given.policy)
    usual = usual_options(policy, given.deadline)
    patient = replace(usual, deadline_s=_PATIENT)
    needless: Counter[str] = Counter()
    safe: Counter[str] = Counter()
    busy: dict[str, list[float]] = {"windows": [], "all horizon": []}
    solved = clear = 0
    with threadpool_limits(1):
        for number in range(given.requests):
            asked = question(given.seed + number, policy.aircraft)
            known = plan(*asked, policy, usual, own_altitude=OWN_ALTITUDE)  # warm, and who is out
            out = {one.number for one in known.excluded if one.apart is Apart.VERTICALLY}
            level = [
                one if number in out else replace(one, altitude=None)
                for number, one in enumerate(asked.intruders)
            ]
            straight = straight_is_clear(asked, usual, usual.last_free)
            clear += straight
            any_safe = False
            for name, each in (
                ("windows", asked),
                ("all horizon", asked._replace(intruders=level)),
            ):
                began = time.thread_time()
                answer = plan(*each, policy, usual, own_altitude=OWN_ALTITUDE)
                busy[name].append(time.thread_time() - began)
                safe[name] += answer.safe
                turns = not answer.safe or answer.cost > _STRAIGHT * policy.aircraft.separation
                needless[name] += straight and turns
                any_safe |= answer.safe
            if not any_safe:
                any_safe = plan(*asked, policy, patient, own_altitude=OWN_ALTITUDE).safe
            solved += any_safe
    figures: dict[str, Any] = {
        "benchmark": "levels",
        "requests": given.requests,
        "deadline_ms": 1e3 * usual.deadline_s,
        "solved": solved,
        "straight_flight_is_clear": clear,
    }
    for name, spent in busy.items():
        figures[name] = {
            "safe": safe[name],
            "safe_of_solved": safe[name] / solved if solved else None,
            "needless_turns": needless[name],
            "cpu_median_ms": 1e3 * float(np.median(spent)),
            "cpu_p99_ms": 1e3 * float(np.percentile(spent, 99.0)),
        }
    show(figures)
    report(figures, ("numpy",))


if __name__ == "__main__":
    run_cli(main)
