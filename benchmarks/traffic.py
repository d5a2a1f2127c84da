"""Plans among many aircraft: ``python -m benchmarks.traffic [--intruders 100] [--radius 30]``.

Random traffic: places uniform in a disc about the ownship but for two separations about it,
courses uniform, speeds those of the encounters. Each request is planned with the usual deadline
and with five seconds; what counts is the share SAFE of those that five seconds solve. Times are
the processor's for the thread, which other work on the machine does not lengthen so much.
"""

import math
import time
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from agents.planner import plan
from agents.policy.inference import Policy
from benchmarks.measure import deadline_option, report, request_options, show, usual_options
from envs.aircraft import Aircraft
from envs.edge.command import Parser, run_cli
from envs.kinematics import VehicleState
from envs.waypoints import RoutePoint

_APART = 2.0  # separations from the ownship at the request
_SPEEDS = 0.5, 1.0  # of the intruders, in the ownship's greatest
_PATIENT = 5.0  # s of computation
_POINTS = 9  # of a route


class Question(NamedTuple):
    """What ``plan`` is asked."""

    own: VehicleState
    intruders: list[VehicleState]
    route: list[RoutePoint]


def question(seed: int, count: int, radius: float, aircraft: Aircraft) -> Question:
    """Return a request among ``count`` random aircraft within a radius, m."""
    rng, unit = np.random.default_rng(seed), aircraft.separation
    fastest = aircraft.limits.speed_max
    # Uniform over the area of the ring.
    away = np.sqrt(rng.uniform((_APART * unit) ** 2, radius**2, count))
    bearing, course = rng.uniform(-math.pi, math.pi, (2, count))
    speed = fastest * rng.uniform(*_SPEEDS, count)
    fields = away * np.cos(bearing), away * np.sin(bearing), course, speed
    own = VehicleState(0.0, 0.0, 0.0, 0.8 * fastest)
    route = [RoutePoint(i, (12.0 + 5.0 * i) * unit, 0.0) for i in range(_POINTS)]
    return Question(own, list(map(VehicleState, *(field.tolist() for field in fields))), route)


def main() -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    request_options(parser, 100)
    parser.add_argument("--intruders", type=int, default=100, help="aircraft (default 100)")
    parser.add_argument("--radius", type=float, default=30.0, help="of the disc, km (default 30)")
    deadline_option(parser)
    given = parser.parse_args()
    policy = Policy.load(given.policy)
    usual = usual_options(policy, given.deadline)
    ways = {"usual": usual, "patient": replace(usual, deadline_s=_PATIENT)}
    safe: dict[str, list[bool]] = {name: [] for name in ways}
    busy: dict[str, list[float]] = {name: [] for name in ways}
    sources: list[str] = []
    with threadpool_limits(1):
        plan(*question(given.seed, 3, 1e3 * given.radius, policy.aircraft), policy)  # warm
        for number in range(given.requests):
            asked = question(
                given.seed + number, given.intruders, 1e3 * given.radius, policy.aircraft
            )
            for name, options in ways.items():
                # What the usual deadline solved is solved.
                if name == "patient" and safe["usual"][-1]:
                    safe[name].append(True)
                    continue
                began = time.thread_time()
                answer = plan(*asked, policy, options)
                busy[name].append(time.thread_time() - began)
                safe[name].append(answer.safe)
                if name == "usual":
                    sources.append(answer.source.value if answer.safe else "unresolved")
    solved = sum(safe["patient"])
    figures: dict[str, Any] = {
        "benchmark": "traffic",
        "intruders": given.intruders,
        "radius_km": given.radius,
        "requests": given.requests,
        "deadline_ms": 1e3 * usual.deadline_s,
        "solved": solved,
        "safe": sum(safe["usual"]),
        "safe_of_solved": sum(safe["usual"]) / solved if solved else None,
        "by_policy": sources.count("policy"),
        "by_fallback": sources.count("fallback"),
        "cpu_median_ms": 1e3 * float(np.median(busy["usual"])),
        "cpu_p99_ms": 1e3 * float(np.percentile(busy["usual"], 99.0)),
    }
    show(figures)
    report(figures, ("numpy",))


if __name__ == "__main__":
    run_cli(main)
