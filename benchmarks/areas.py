"""Plans among areas and intruders: ``python -m benchmarks.areas [--requests 100]``.

One to three random areas (:mod:`envs.random_areas`) and one to four intruders a request, of the
scenario ``multi``. Each request is planned with several deadlines and with ten seconds; what counts
is the share SAFE of those that ten seconds solve. Times are the processor's for the thread, as the
planner counts its deadline.
"""

import time
from collections import Counter
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from agents.planner import Options, plan
from agents.policy.inference import Policy
from benchmarks.measure import report, request_options, show
from envs.aircraft import Aircraft
from envs.areas import Area
from envs.edge.command import Parser, run_cli
from envs.encounters import scenario
from envs.kinematics import VehicleState
from envs.random_areas import random_areas
from envs.starts import encounters_of_seed
from envs.waypoints import RoutePoint

_PATIENT = 10.0  # s of computation
_INTRUDERS, _AREAS = 4, 3  # at most
_BEYOND = 5.0  # separations between points of the route beyond the goal
_POINTS = 10


class Question(NamedTuple):
    """What ``plan`` is asked."""

    own: VehicleState
    intruders: list[VehicleState]
    route: list[RoutePoint]
    areas: tuple[Area, ...]


def questions(seed: int, count: int, aircraft: Aircraft) -> list[Question]:
    """Return requests with one to four intruders and one to three areas each."""
    found = []
    starts = encounters_of_seed(scenario("multi", aircraft), seed, 0, count)
    for n in range(count):
        own = VehicleState(*(float(field[n]) for field in starts.own))
        members = np.flatnonzero(starts.mask[n])[: 1 + n % _INTRUDERS]
        others = [
            VehicleState(*(float(field[n, k]) for field in starts.intruders)) for k in members
        ]
        goal = float(starts.goal_x[n]), float(starts.goal_y[n])
        areas = random_areas(seed, n, 1 + (n // _INTRUDERS) % _AREAS, own, goal, aircraft)
        ahead = np.subtract(goal, (own.x, own.y))
        ahead = ahead / max(float(np.hypot(*ahead)), 1e-9) * _BEYOND * aircraft.separation
        places = [(goal[0] + i * ahead[0], goal[1] + i * ahead[1]) for i in range(_POINTS)]
        route = [RoutePoint(i, float(x), float(y)) for i, (x, y) in enumerate(places)]
        found.append(Question(own, others, route, areas))
    return found


def main() -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    request_options(parser, 100)
    parser.add_argument(
        "--deadlines",
        type=float,
        nargs="+",
        metavar="MS",
        default=[50.0, 150.0, 500.0],
        help="of computation (default: 50 150 500)",
    )
    given = parser.parse_args()
    policy = Policy.load(given.policy)
    usual = Options.for_aircraft(policy.aircraft)
    ways = {ms: replace(usual, deadline_s=1e-3 * ms) for ms in sorted(given.deadlines)}
    ways[1e3 * _PATIENT] = replace(usual, deadline_s=_PATIENT)
    safe: dict[float, int] = dict.fromkeys(ways, 0)
    busy: list[float] = []
    reasons = Counter[str]()
    asked = questions(given.seed, given.requests, policy.aircraft)
    with threadpool_limits(1):
        _plan(asked[0], policy, usual)  # warm
        for one in asked:
            solved, answer = False, None
            for ms, options in ways.items():
                if not solved:  # what a shorter deadline solved is solved
                    began = time.thread_time()
                    answer = _plan(one, policy, options)
                    if ms == min(ways):
                        busy.append(time.thread_time() - began)
                    solved = answer.safe
                safe[ms] += solved
            if answer is not None and not answer.safe:
                reasons.update({reason.kind.value for reason in answer.reasons})
    solved = safe[1e3 * _PATIENT]
    figures: dict[str, Any] = {
        "benchmark": "areas",
        "requests": given.requests,
        "solved": solved,
        "unsolved_reasons": dict(reasons),
        **{
            f"safe_of_solved_{ms:g}_ms": count / solved if solved else None
            for ms, count in safe.items()
        },
        "cpu_median_ms": 1e3 * float(np.median(busy)),
        "cpu_p99_ms": 1e3 * float(np.percentile(busy, 99.0)),
    }
    show(figures)
    report(figures, ("numpy",))


def _plan(one: Question, policy: Policy, options: Options) -> Any:
    return plan(one.own, one.intruders, one.route, policy, options, areas=one.areas)


if __name__ == "__main__":
    run_cli(main)
