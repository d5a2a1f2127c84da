"""Latency of the planner: ``python -m benchmarks.planner [--policy FILE] [--requests 2000]``.

The whole of ``agents.planner.plan``, from states and route to the validated answer, one request
after the other on one core, over random circle encounters; those that the policy solves and those
that need the fallback apart. Beside it, in turns with it, the floor: 380 times the matrix-vector
products of the network in float32 and the tanh between them, preallocated, features excluded.
``_cpu_`` figures count the processor's time alone, which other work on the machine does not
lengthen so much.
"""

import os
import time
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from agents.planner.answer import Source
from agents.planner.planner import plan
from agents.planner.request import Request
from agents.policy.inference import Policy
from benchmarks.measure import layers, report, request_options, show
from envs.aircraft import PAPER
from envs.edge.command import Parser, run_cli
from envs.encounters import Encounter, scenario
from envs.kinematics import VehicleState
from envs.starts import encounters_of_seed
from envs.trees import take
from envs.waypoints import RoutePoint
from eval.flights.plan_flight import request_of

FLOOR_STEPS = 380


def floor(policy: Policy) -> Any:
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


def question(
    encounters: Encounter, request: Request, number: int
) -> tuple[VehicleState, list[VehicleState], list[RoutePoint]]:
    """Return what ``plan`` is asked at the start of one of the encounters: ownship, intruders,
    route.
    """
    row = take(request, number)
    own = VehicleState(*(float(field) for field in row.own))
    members = np.flatnonzero(encounters.mask[number])
    others = [VehicleState(*(float(field[k]) for field in row.traffic.state)) for k in members]
    points = zip(row.route_x.tolist(), row.route_y.tolist(), strict=True)
    return own, others, [RoutePoint(i, x, y) for i, (x, y) in enumerate(points)]


def main() -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    request_options(parser, 2_000)
    parser.add_argument("--scenario", default="circle", help="of the encounters (default circle)")
    options = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    policy = Policy.load(options.policy)
    encounters = encounters_of_seed(
        scenario(options.scenario, PAPER), options.seed, 0, options.requests
    )
    request = request_of(encounters, PAPER)
    bare = floor(policy)
    times: dict[str, list[float]] = {"policy": [], "fallback": [], "unresolved": []}
    busy: dict[str, list[float]] = {kind: [] for kind in times}
    floors: list[float] = []
    with threadpool_limits(1):
        for number in range(-20, options.requests):
            own, others, route = question(encounters, request, max(number, 0))
            began = time.perf_counter()
            bare()
            middle, busy_before = time.perf_counter(), time.process_time()
            answer = plan(own, others, route, policy)
            after, busy_after = time.perf_counter(), time.process_time()
            if number >= 0:
                floors.append(middle - began)
                kind = (
                    "unresolved"
                    if not answer.safe
                    else "policy"
                    if answer.source is Source.POLICY
                    else "fallback"
                )
                times[kind].append(after - middle)
                busy[kind].append(busy_after - busy_before)
    base = float(np.median(floors))
    figures: dict[str, Any] = {
        "benchmark": "planner",
        "requests": options.requests,
        "floor_median_ms": 1e3 * base,
    }
    for kind, values in times.items():
        figures[f"{kind}_requests"] = len(values)
        if values:
            for name, share in (("median", 50.0), ("p99", 99.0), ("p99_9", 99.9), ("max", 100.0)):
                figures[f"{kind}_{name}_ms"] = 1e3 * float(np.percentile(values, share))
                figures[f"{kind}_cpu_{name}_ms"] = 1e3 * float(np.percentile(busy[kind], share))
    figures["policy_median_over_floor"] = (
        float(np.median(times["policy"])) / base if times["policy"] else None
    )
    show(figures)
    report(figures, ("numpy",))


if __name__ == "__main__":
    run_cli(main)
