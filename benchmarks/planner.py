"""Latency of the planner: ``python -m benchmarks.planner [--policy FILE] [--requests 2000]``.

The whole of ``agents.planner.plan``, from states and route to the validated answer, one request
after the other on one core, over random circle encounters; those that the policy solves and those
that need the fallback apart. Beside it, in turns with it, the floor: 380 times the matrix-vector
products of the network in float32 and the tanh between them, preallocated, features excluded.
``_cpu_`` figures count the processor's time alone, which other work on the machine does not
lengthen so much.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from agents.planner.answer import Plan, Source
from agents.planner.planner import plan
from agents.planner.request.encounters import request_of
from agents.planner.request.request import Request
from agents.policy.inference import Policy
from benchmarks.measure import (
    hold_to_one_core,
    layers,
    percentiles_ms,
    policy_in_flight,
    report,
    request_options,
    show,
)
from benchmarks.questions import Question
from commands.command import Parser, run_cli
from envs.aircraft import PAPER
from envs.encounters import Encounter
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.trees import take
from envs.waypoints import RoutePoint

FLOOR_STEPS = 380
KINDS = "policy", "fallback", "unresolved"
_MARKS = "median", "p99", "p99_9", "max"
_WARM = 20  # requests at the beginning that are not counted


class Latency(NamedTuple):
    """What one request took, s."""

    kind: str
    """One of :data:`KINDS`: what made the plan."""
    wall: float
    processor: float
    floor: float
    """What the bare products took just before, by the clock."""


def main() -> None:
    """Measure and print."""
    options = _parser().parse_args()
    hold_to_one_core()
    policy = policy_in_flight(options.policy)
    encounters = encounters_of_seed(
        scenario(options.scenario, PAPER), options.seed, 0, options.requests
    )
    summary = figures(measure(encounters, policy), options.requests)
    show(summary)
    report(summary, ("numpy",))


def _parser() -> Parser:
    parser = Parser(description=__doc__)
    request_options(parser, 2_000)
    help_text = "scenario of the encounters (default circle)"
    parser.add_argument("--scenario", default="circle", help=help_text)
    return parser


def measure(encounters: Encounter, policy: Policy) -> list[Latency]:
    """Ask for a plan at the start of each encounter ``[N]``, the floor in turns with it."""
    request = request_of(encounters, PAPER)
    products = floor_products(policy)
    with threadpool_limits(1):
        for _ in range(_WARM):
            _measure_request(question(encounters, request, 0), policy, products)
        return [
            _measure_request(question(encounters, request, number), policy, products)
            for number in range(len(encounters.mask))
        ]


def _measure_request(request: Question, policy: Policy, products: Callable[[], None]) -> Latency:
    began = time.perf_counter()
    products()
    middle, busy_before = time.perf_counter(), time.process_time()
    answer = plan(*request, policy)
    after, busy_after = time.perf_counter(), time.process_time()
    return Latency(_kind(answer), after - middle, busy_after - busy_before, middle - began)


def _kind(answer: Plan) -> str:
    """Return which of :data:`KINDS` an answer is."""
    if not answer.safe:
        return "unresolved"
    return "policy" if answer.source is Source.POLICY else "fallback"


def floor_products(policy: Policy) -> Callable[[], None]:
    """Return the bare work of 380 evaluations of a network of the policy's size, to be called."""
    rng = np.random.default_rng(0)
    factors = [rng.standard_normal(shape).astype(np.float32) for shape in layers(policy)]
    vectors = [
        (np.ones(len(factor), np.float32), np.empty(factor.shape[1], np.float32))
        for factor in factors
    ]

    def work() -> None:
        for _ in range(FLOOR_STEPS):
            for factor, (x, y) in zip(factors, vectors, strict=True):
                np.dot(x, factor, out=y)
                if len(y) > 2:  # the head has no tanh
                    np.tanh(y, out=y)

    return work


def question(encounters: Encounter, request: Request, number: int) -> Question:
    """Return what ``plan`` is asked at the start of one of the encounters."""
    row = take(request, number)
    own: VehicleState[Ground] = VehicleState(*(float(field) for field in row.own))
    members = np.flatnonzero(encounters.mask[number])
    others: list[VehicleState[Ground]] = [
        VehicleState(*(float(field[k]) for field in row.traffic.state)) for k in members
    ]
    points = zip(row.route_x.tolist(), row.route_y.tolist(), strict=True)
    return Question(own, others, [RoutePoint(i, x, y) for i, (x, y) in enumerate(points)])


def figures(latencies: Sequence[Latency], requests: int) -> dict[str, Any]:
    """Return the figures of the requests, by kind of answer."""
    floor = float(np.median([latency.floor for latency in latencies]))
    summary: dict[str, Any] = {
        "benchmark": "planner",
        "requests": requests,
        "floor_median_ms": 1e3 * floor,
    }
    for kind in KINDS:
        same = [latency for latency in latencies if latency.kind == kind]
        summary[f"{kind}_requests"] = len(same)
        if same:
            summary |= percentiles_ms(kind, [latency.wall for latency in same], _MARKS)
            summary |= percentiles_ms(
                f"{kind}_cpu", [latency.processor for latency in same], _MARKS
            )
    by_policy = [latency.wall for latency in latencies if latency.kind == "policy"]
    summary["policy_median_over_floor"] = float(np.median(by_policy)) / floor if by_policy else None
    return summary


if __name__ == "__main__":
    run_cli(main)
