"""Plans among many aircraft: ``python -m benchmarks.traffic [--intruders 100] [--radius 30]``.

Random traffic: places uniform in a disc about the ownship but for two separations about it,
courses uniform, speeds those of the encounters; known exactly or within standard deviations, in a
wind from a random direction, with areas on the way. Each request is planned with several deadlines
and, where none of them solves it, with five seconds; what counts is the share SAFE of those that
any of these solves, with its exact 95 % interval. Times are the processor's for the thread, which
other work on the machine does not lengthen so much.
"""

import gc
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from agents.planner import Intruder, Options, prepare
from agents.planner.answer import Source
from agents.policy.inference import Policy
from benchmarks.measure import deadlines_option, percentiles_ms, report, request_options, show
from benchmarks.questions import Question, Timed, time_plan
from commands.command import ConfigError, Parser, real, run_cli, whole
from envs.aircraft import Aircraft
from envs.areas import Area
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.random_areas import random_areas
from envs.waypoints import RoutePoint
from envs.wind import Wind
from eval.stats.intervals import clopper_pearson

_APART = 2.0  # separations from the ownship at the request
_SPEEDS = 0.5, 1.0  # of the intruders, in the ownship's greatest
_PATIENT = 5.0  # s of computation
_POINTS = 9  # of a route


class Sky(NamedTuple):
    """What is about each request."""

    position_std: float  # of the intruders' positions, m
    velocity_std: float  # m/s
    wind: float  # its speed, m/s
    areas: int  # on the way to the next point


class Planned(NamedTuple):
    """One request, planned."""

    timed: list[Timed]
    """With each deadline."""
    solved: bool
    """Whether one of these, or five seconds, gave a SAFE plan."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    options = _parser().parse_args(arguments)
    policy = Policy.load(options.policy)
    usual = Options.for_aircraft(policy.aircraft)
    limits = [replace(usual, deadline_s=1e-3 * ms) for ms in sorted(options.deadlines)]
    radius, inner = 1e3 * options.radius, _APART * policy.aircraft.separation
    if radius <= inner:
        raise ConfigError(
            f"--radius is {options.radius:g} km; expected more than {1e-3 * inner:g} km, within "
            "which no aircraft begins"
        )
    compiled = not options.interpreted and prepare()
    sky = Sky(options.position_std, options.velocity_std, options.wind, options.areas)
    with threadpool_limits(1):
        # The first plan of a process makes tables.
        _ask(options.seed, question(options.seed, 3, radius, policy.aircraft), sky, policy, limits)
        # As the ROS nodes do: a search for garbage in all that was imported takes 80 ms.
        gc.freeze()
        every = []
        for number in range(options.seed, options.seed + options.requests):
            request = question(number, options.intruders, radius, policy.aircraft)
            every.append(_ask(number, request, sky, policy, limits))
    summary: dict[str, Any] = {
        "benchmark": "traffic",
        "compiled": compiled,
        "intruders": options.intruders,
        "radius_km": options.radius,
        **sky._asdict(),
        "requests": options.requests,
        **figures(every, sorted(options.deadlines)),
    }
    show(summary)
    report(summary, ("numpy", "numba") if compiled else ("numpy",))


def _parser() -> Parser:
    parser = Parser(description=__doc__)
    request_options(parser, 100)
    parser.add_argument(
        "--intruders", type=whole(1), default=100, help="other aircraft (default 100)"
    )
    help_text = "radius of the disc, km (default 30)"
    parser.add_argument("--radius", type=real(1.0, 1_000.0, "km"), default=30.0, help=help_text)
    for name, highest, unit, help_text in (
        ("position-std", 1e3, "m", "standard deviation of the intruders' positions, per axis"),
        ("velocity-std", 50.0, "m/s", "standard deviation of their velocities, per axis"),
        ("wind", 30.0, "m/s", "speed of the wind, from a random direction"),
    ):
        text = f"{help_text}, {unit} (default 0)"
        parser.add_argument(f"--{name}", type=real(0.0, highest, unit), default=0.0, help=text)
    help_text = "areas on the way to the next point (default 0)"
    parser.add_argument("--areas", type=whole(0), default=0, help=help_text)
    help_text = "without compiled code, though numba is installed"
    parser.add_argument("--interpreted", action="store_true", help=help_text)
    deadlines_option(parser, [50.0])
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
    return Question(own, [VehicleState(*state) for state in others], route)


def _ask(
    number: int, request: Question, sky: Sky, policy: Policy, limits: Sequence[Options]
) -> Planned:
    """Plan a request with each of some options, and with five seconds where none of these solves
    it.
    """
    if sky.position_std or sky.velocity_std:
        reports = [
            Intruder(state, position_std=sky.position_std, velocity_std=sky.velocity_std)
            for state in request.states
        ]
        request = request._replace(intruders=reports)
    wind, areas = _around(number, request, sky, policy.aircraft)
    timed = [time_plan(request, policy, limit, wind=wind, areas=areas) for limit in limits]
    solved = any(answered.answer.safe for answered in timed)
    if not solved:
        patient = replace(limits[0], deadline_s=_PATIENT)
        solved = time_plan(request, policy, patient, wind=wind, areas=areas).answer.safe
    return Planned(timed, solved)


def _around(
    number: int, request: Question, sky: Sky, aircraft: Aircraft
) -> tuple[Wind | None, tuple[Area, ...]]:
    """Return the wind of a request, and the areas on the way to its next point."""
    wind = None
    if sky.wind:
        course = np.random.default_rng([number, 1]).uniform(-math.pi, math.pi)
        wind = Wind(sky.wind * math.cos(course), sky.wind * math.sin(course))
    goal = request.route[0].x, request.route[0].y
    areas = random_areas(number, 0, sky.areas, request.own, goal, aircraft) if sky.areas else ()
    return wind, areas


def figures(every: Sequence[Planned], deadlines: Sequence[float]) -> dict[str, Any]:
    """Return what the deadlines, ms, solve of that which can be solved."""
    solved = sum(request.solved for request in every)
    summary: dict[str, Any] = {"solved": solved}
    for number, ms in enumerate(deadlines):
        timed = [request.timed[number] for request in every]
        sources = [answered.answer.source for answered in timed if answered.answer.safe]
        low, high = clopper_pearson(len(sources), solved)
        figures_of_deadline = {
            "safe": len(sources),
            "safe_of_solved": len(sources) / solved if solved else None,
            "low": low,
            "high": high,
            "by_policy": sources.count(Source.POLICY),
            "by_fallback": sources.count(Source.FALLBACK),
        }
        summary |= {f"{name}_{ms:g}_ms": value for name, value in figures_of_deadline.items()}
        seconds = [answered.seconds for answered in timed]
        summary |= percentiles_ms(f"cpu_{ms:g}_ms", seconds, ("median", "p99", "max"))
    return summary


if __name__ == "__main__":
    run_cli(main)
