"""Speed of the evaluation: ``python -m benchmarks.monte_carlo [--policy FILE]``.

Encounters a second for a whole evaluation of circle encounters (draw, fly with and without the
policy, judge, table, start of the processes included), and how far that is from the limit that
matrix products set: the time that the policy's products alone would take as matrix products, at the
rate measured in the same run by as many processes.
"""

import math
import multiprocessing
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from agents.policy.inference import Policy
from agents.resolvability.classify import classify
from benchmarks.measure import layers, report, seconds
from envs.aircraft import PAPER
from envs.edge.command import Parser, run_cli
from envs.encounters import scenario
from envs.starts import encounters_of_seed
from eval.config import MonteCarloConfig
from eval.flights.chunks import Evaluation, Pilot, columns
from eval.flights.simulate import Direct, fly
from eval.runner.payload import Chunk, Work
from eval.runner.workers import cores, fly_chunks

ROWS = 256
"""Of a matrix product of the limit."""


def gemm_flops_per_s(shapes: list[tuple[int, ...]]) -> float:
    """Return the float32 rate of the network's matrix products alone, one thread, large batches."""
    rng = np.random.default_rng(0)
    factors = [rng.standard_normal(shape).astype(np.float32) for shape in shapes]
    batches = [rng.standard_normal((ROWS, inputs)).astype(np.float32) for inputs, _ in shapes]
    rounds = 200

    def work() -> None:
        for _ in range(rounds):
            for batch, layer in zip(batches, factors, strict=True):
                batch @ layer  # pyright: ignore[reportUnusedExpression]

    with threadpool_limits(1):
        return rounds * ROWS * flops(shapes) / min(seconds(work, 7))


def flops(shapes: list[tuple[int, ...]]) -> int:
    """Return the floating-point operations of the products of one evaluation of the network."""
    return sum(2 * math.prod(shape) for shape in shapes)


def stages(pilot: Pilot, count: int) -> dict[str, float]:
    """Return the time of each stage of a chunk in one process, s."""
    aircraft = pilot.evaluation.aircraft
    times = {}
    begun = time.perf_counter()

    def lap(name: str) -> None:
        nonlocal begun
        now = time.perf_counter()
        times[name], begun = now - begun, now

    starts = encounters_of_seed(scenario("circle", PAPER), 0, 0, count)
    lap("draw_s")
    flown = fly(starts, pilot.resolver, aircraft)
    lap("policy_flights_s")
    bare = fly(starts, Direct(aircraft), aircraft)
    lap("baseline_flights_s")
    classify(
        starts, aircraft.rules(), aircraft.limits, solved=(flown.outcome == 1) | (bare.outcome == 1)
    )
    lap("resolvability_s")
    return times


class _Measured(NamedTuple):
    wall_s: float
    flown_s: float  # simulated, all encounters together


def _fly_all(evaluation: Evaluation, workers: int, chunks: list[Chunk]) -> _Measured:
    begun = time.perf_counter()
    work = Work(Pilot, columns)
    tables = [table for _, table in fly_chunks(work, evaluation, workers, chunks, lambda: False)]
    wall = time.perf_counter() - begun
    return _Measured(wall, sum(math.fsum(table["duration_s"]) for table in tables))


def main() -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    parser.add_argument("--policy", type=Path, help="policy file (default: the one that ships)")
    parser.add_argument(
        "--encounters", type=int, default=10_000, help="encounters of a measurement (default 10000)"
    )
    parser.add_argument("--repeats", type=int, default=3, help="measurements (default 3)")
    parser.add_argument(
        "--workers", type=int, default=cores(), help="processes (default: one for every core)"
    )
    text = "what computes the decisions (default auto, as in eval.monte_carlo)"
    parser.add_argument("--backend", choices=("auto", "numpy", "jax"), default="auto", help=text)
    options = parser.parse_args()

    policy = Policy.load(options.policy)
    backend = MonteCarloConfig(backend=options.backend).backend_for(policy, options.encounters)
    evaluation = Evaluation(
        options.policy, scenario("circle", PAPER), None, 0, policy.aircraft, backend=backend
    )
    size = MonteCarloConfig(backend=backend).chunk_for(options.encounters, options.workers)
    chunks = [
        Chunk(first, min(size, options.encounters - first))
        for first in range(0, options.encounters, size)
    ]
    flights = [_fly_all(evaluation, options.workers, chunks) for _ in range(options.repeats)]
    walls = [one.wall_s for one in flights]
    # The policy acts once a time step.
    evaluations = flights[-1].flown_s / evaluation.aircraft.dt

    shapes = layers(policy)
    with multiprocessing.get_context("spawn").Pool(options.workers) as pool:
        rates = pool.map(gemm_flops_per_s, [shapes] * options.workers, chunksize=1)
    limit_s = evaluations * flops(shapes) / sum(rates)
    with threadpool_limits(1):
        split = stages(Pilot.load(evaluation), min(size, options.encounters))
    report(
        {
            "encounters": options.encounters,
            "workers": options.workers,
            "backend": backend,
            "wall_s": min(walls),
            "wall_s_all": walls,
            "encounters_per_s": options.encounters / min(walls),
            "policy_evaluations": evaluations,
            "policy_evaluations_per_s": evaluations / min(walls),
            "flop_per_evaluation": flops(shapes),
            "gemm_gflop_per_s": sum(rates) / 1e9,
            "gemm_limit_s": limit_s,
            "share_of_gemm_limit": limit_s / min(walls),
            "one_chunk_in_one_process": {"encounters": min(size, options.encounters)} | split,
        },
        ("numpy",),
    )


if __name__ == "__main__":
    run_cli(main)
