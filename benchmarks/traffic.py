"""Plans among many aircraft: ``python -m benchmarks.traffic [--intruders 100] [--radius 30]``.

Random traffic: places uniform in a disc about the ownship but for two separations about it,
courses uniform, speeds those of the encounters. Each request is planned with the usual deadline
and with five seconds; what counts is the share SAFE of those that five seconds solve. Times are
the processor's for the thread, which other work on the machine does not lengthen so much.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from agents.planner import Options, plan
from agents.planner.answer import Source
from agents.policy.inference import Policy
from benchmarks.measure import (
    deadline_option,
    percentiles_ms,
    report,
    request_options,
    show,
    usual_options,
)
from benchmarks.questions import Question, Timed, time_plan
from commands.command import ConfigError, Parser, real, run_cli, whole
from envs.aircraft import Aircraft
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.waypoints import RoutePoint

_APART = 2.0  # separations from the ownship at the request
_SPEEDS = 0.5, 1.0  # of the intruders, in the ownship's greatest
_PATIENT = 5.0  # s of computation
_POINTS = 9  # of a route


class Asked(NamedTuple):
    """One request, planned."""

    usual: Timed
    """With the usual deadline."""
    solved: bool
    """Whether that, or five seconds, gave a SAFE plan."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    given = _parser().parse_args(arguments)
    policy = Policy.load(given.policy)
    usual = usual_options(policy, given.deadline)
    radius, inner = 1e3 * given.radius, _APART * policy.aircraft.separation
    if radius <= inner:
        raise ConfigError(
            f"--radius is {given.radius:g} km; expected more than {1e-3 * inner:g} km, within "
            "which no aircraft begins"
        )
    with threadpool_limits(1):
        # The first plan of a process makes tables.
        plan(*question(given.seed, 3, radius, policy.aircraft), policy)
        every = [
            _ask(
                question(given.seed + number, given.intruders, radius, policy.aircraft),
                policy,
                usual,
            )
            for number in range(given.requests)
        ]
    found: dict[str, Any] = {
        "benchmark": "traffic",
        "intruders": given.intruders,
        "radius_km": given.radius,
        "requests": given.requests,
        "deadline_ms": 1e3 * usual.deadline_s,
        **figures(every),
    }
    show(found)
    report(found, ("numpy",))


def _parser() -> Parser:
    parser = Parser(description=__doc__)
    request_options(parser, 100)
    parser.add_argument(
        "--intruders", type=whole(1), default=100, help="other aircraft (default 100)"
    )
    what = "radius of the disc, km (default 30)"
    parser.add_argument("--radius", type=real(1.0, 1_000.0, "km"), default=30.0, help=what)
    deadline_option(parser)
    return parser


def question(seed: int, count: int, radius: float, aircraft: Aircraft) -> Question:
    """Return a request among ``count`` random aircraft within a radius, m."""
    rng, unit = np.random.default_rng(seed), aircraft.separation
    fastest = aircraft.limits.speed_max
    # Uniform over the area of the ring.
    away = np.sqrt(rng.uniform((_APART * unit) ** 2, radius**2, count))
    bearing, course = rng.uniform(-math.pi, math.pi, (2, count))
    speed = fastest * rng.uniform(*_SPEEDS, count)
    fields = away * np.cos(bearing), away * np.sin(bearing), course, speed
    own: VehicleState[Ground] = VehicleState(0.0, 0.0, 0.0, 0.8 * fastest)
    route = [RoutePoint(i, (12.0 + 5.0 * i) * unit, 0.0) for i in range(_POINTS)]
    others = zip(*(field.tolist() for field in fields), strict=True)
    return Question(own, [VehicleState(*one) for one in others], route)


def _ask(asked: Question, policy: Policy, usual: Options) -> Asked:
    """Plan a request with the usual deadline, and with five seconds where that does not solve
    it.
    """
    timed = time_plan(asked, policy, usual)
    solved = timed.answer.safe
    if not solved:
        solved = plan(*asked, policy, replace(usual, deadline_s=_PATIENT)).safe
    return Asked(timed, solved)


def figures(every: Sequence[Asked]) -> dict[str, Any]:
    """Return what the usual deadline solves of that which can be solved."""
    solved = sum(one.solved for one in every)
    safe = [one.usual.answer for one in every if one.usual.answer.safe]
    return {
        "solved": solved,
        "safe": len(safe),
        "safe_of_solved": len(safe) / solved if solved else None,
        "by_policy": sum(answer.source is Source.POLICY for answer in safe),
        "by_fallback": sum(answer.source is Source.FALLBACK for answer in safe),
        **percentiles_ms("cpu", [one.usual.seconds for one in every], ("median", "p99")),
    }


if __name__ == "__main__":
    run_cli(main)
