"""Plans among areas and intruders: ``python -m benchmarks.areas [--requests 100]``.

One to three random areas (:mod:`envs.random_areas`) and one to four intruders a request, of the
scenario ``multi``. Each request is planned with several deadlines and with ten seconds; what counts
is the share SAFE of those that ten seconds solve. With --ompl a sampling planner
(:mod:`benchmarks.sampling_planner`) has ten seconds for each request that ours does not solve, and
for every fifth of the others, which says what it is good for. Times are the processor's for the
thread, as the planner counts its deadline.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from agents.planner import Options, plan
from agents.policy.inference import Policy
from benchmarks.measure import (
    deadlines_option,
    percentiles_ms,
    policy_in_flight,
    report,
    request_options,
    show,
)
from benchmarks.questions import Question, time_plan
from benchmarks.sampling_planner import Task, is_right, require, solve
from commands.command import Parser, run_cli
from envs.aircraft import Aircraft
from envs.areas import Area
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.random_areas import random_areas
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.waypoints import RoutePoint

_PATIENT = 10.0  # s of computation
_EVERY = 5  # one in so many of the solved requests is tried by OMPL
_INTRUDERS, _AREAS = 4, 3  # at most
_BEYOND = 5.0  # separations between points of the route beyond the goal
_POINTS = 10


class AmongAreas(NamedTuple):
    """What ``plan`` is asked, and the areas about it."""

    request: Question
    areas: tuple[Area, ...]


def questions(seed: int, count: int, aircraft: Aircraft) -> list[AmongAreas]:
    """Return requests with one to four intruders and one to three areas each."""
    cases = []
    starts = encounters_of_seed(scenario("multi", aircraft), seed, 0, count)
    for n in range(count):
        own: VehicleState[Ground] = VehicleState(*(float(field[n]) for field in starts.own))
        members = np.flatnonzero(starts.mask[n])[: 1 + n % _INTRUDERS]
        others: list[VehicleState[Ground]] = [
            VehicleState(*(float(field[n, k]) for field in starts.intruders)) for k in members
        ]
        goal = float(starts.goal_x[n]), float(starts.goal_y[n])
        areas = random_areas(seed, n, 1 + (n // _INTRUDERS) % _AREAS, own, goal, aircraft)
        request = Question(own, others, _route(own, goal, _BEYOND * aircraft.separation))
        cases.append(AmongAreas(request, areas))
    return cases


def _route(
    own: VehicleState[Ground], goal: tuple[float, float], spacing: float
) -> list[RoutePoint]:
    """Return the goal and points beyond it, straight ahead from the ownship, ``spacing`` m
    apart.
    """
    ahead = np.subtract(goal, (own.x, own.y))
    ahead = ahead / max(float(np.hypot(*ahead)), 1e-9) * spacing
    places = [(goal[0] + i * ahead[0], goal[1] + i * ahead[1]) for i in range(_POINTS)]
    return [RoutePoint(i, float(x), float(y)) for i, (x, y) in enumerate(places)]


class Planned(NamedTuple):
    """One request, planned."""

    solved_in: float  # shortest deadline that solved it, ms; inf: none did
    busy: float  # computation of the answer with the shortest deadline, s
    reasons: frozenset[str]  # why it is not solved


class Sampled(NamedTuple):
    """One request that OMPL tried too."""

    ours: bool  # whether the planner has solved it
    ompl: bool  # whether OMPL has found a flight
    right: bool  # whether that is one


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    options = _parser().parse_args(arguments)
    if options.ompl:
        require()
    policy = policy_in_flight(options.policy)
    usual = Options.for_aircraft(policy.aircraft)
    deadlines = [*sorted(options.deadlines), 1e3 * _PATIENT]
    requests, tried = list[Planned](), list[Sampled]()
    with threadpool_limits(1):
        for number, case in enumerate(questions(options.seed, options.requests, policy.aircraft)):
            if not requests:  # the first plan of a process makes tables
                plan(*case.request, policy, usual, areas=case.areas)
            requests.append(_ask(case, policy, usual, deadlines))
            solved = math.isfinite(requests[-1].solved_in)
            if options.ompl and (not solved or number % _EVERY == 0):
                request = case.request
                task = Task(request.own, request.states, request.route, case.areas, usual)
                tried.append(_sample(task, number, ours=solved))
    measured = {"benchmark": "areas", "requests": options.requests, **figures(requests, deadlines)}
    if options.ompl:
        measured |= compare(requests, tried, deadlines)
    show(measured)
    report(measured, ("numpy", "ompl") if options.ompl else ("numpy",))


def _parser() -> Parser:
    parser = Parser(description=__doc__)
    request_options(parser, 100)
    deadlines_option(parser, [50.0, 150.0, 500.0])
    parser.add_argument("--ompl", action="store_true", help="ask a sampling planner of OMPL too")
    return parser


def _ask(case: AmongAreas, policy: Policy, usual: Options, deadlines: Sequence[float]) -> Planned:
    """Return how a request is planned with longer and longer deadlines, ms, until one solves it."""
    busy, reasons = math.nan, frozenset[str]()
    for ms in deadlines:
        options = replace(usual, deadline_s=1e-3 * ms)
        answer, seconds = time_plan(case.request, policy, options, areas=case.areas)
        if math.isnan(busy):
            busy = seconds
        if answer.safe:
            return Planned(ms, busy, frozenset())
        reasons = frozenset(reason.kind.value for reason in answer.reasons)
    return Planned(math.inf, busy, reasons)


def _sample(task: Task, number: int, *, ours: bool) -> Sampled:
    """Let OMPL try a request; ``ours``: whether the planner has solved it."""
    steps = solve(task, _PATIENT, number)
    return Sampled(ours, steps is not None, steps is not None and is_right(task, steps))


def figures(requests: Sequence[Planned], deadlines: Sequence[float]) -> dict[str, Any]:
    """Return what the deadlines, ms, solve of that which ours solves."""
    solved = sum(math.isfinite(request.solved_in) for request in requests)
    return {
        "solved": solved,
        "unsolved_reasons": dict(
            Counter(reason for request in requests for reason in request.reasons)
        ),
        **_shares("safe_of_solved", requests, deadlines, solved),
        **percentiles_ms("cpu", [request.busy for request in requests], ("median", "p99")),
    }


def compare(
    requests: Sequence[Planned], tried: Sequence[Sampled], deadlines: Sequence[float]
) -> dict[str, Any]:
    """Return what OMPL solves, and what the deadlines, ms, solve of that which any of both does."""
    ours, others = (
        [trial for trial in tried if trial.ours],
        [trial for trial in tried if not trial.ours],
    )
    theirs = sum(trial.right for trial in others)
    solved = sum(math.isfinite(request.solved_in) for request in requests) + theirs
    return {
        "ompl_tried_of_solved": len(ours),
        "ompl_solved_of_solved": sum(trial.right for trial in ours),
        "ompl_tried_of_unsolved": len(others),
        "ompl_solved_of_unsolved": theirs,
        "ompl_wrong": sum(trial.ompl and not trial.right for trial in tried),
        **_shares("safe_of_solved_by_any", requests, deadlines, solved),
    }


def _shares(
    name: str, requests: Sequence[Planned], deadlines: Sequence[float], solved: int
) -> dict[str, float | None]:
    """Return the share of the solved requests that each deadline, ms, solves."""
    return {
        f"{name}_{ms:g}_ms": sum(request.solved_in <= ms for request in requests) / solved
        if solved
        else None
        for ms in deadlines
    }


if __name__ == "__main__":
    run_cli(main)
