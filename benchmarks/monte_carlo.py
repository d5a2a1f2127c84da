"""Speed of the evaluation: ``python -m benchmarks.monte_carlo [--policy FILE]``.

Encounters a second for a whole evaluation of circle encounters (draw, fly with and without the
policy, judge, table, start of the processes included), and how far that is from the limit that
matrix products set: the time that the policy's products alone would take as matrix products, at the
rate measured in the same run by as many processes.
"""

import math
import multiprocessing
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from agents.policy.inference import Policy
from agents.resolvability.classify import classify
from benchmarks.measure import layers, report, seconds
from commands.command import Parser, run_cli, whole
from envs.aircraft import PAPER
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from eval.config import MonteCarloConfig
from eval.flights.chunks import Evaluation, ReadyEvaluation, columns
from eval.flights.simulate import Unmitigated, fly
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


def stages(pilot: ReadyEvaluation, count: int) -> dict[str, float]:
    """Return the time of each stage of a chunk in one process, s."""
    aircraft = pilot.evaluation.aircraft
    laps = [time.perf_counter()]
    starts = encounters_of_seed(scenario("circle", PAPER), 0, 0, count)
    laps.append(time.perf_counter())
    by_policy = fly(starts, pilot.resolver, aircraft)
    laps.append(time.perf_counter())
    direct = fly(starts, Unmitigated(aircraft), aircraft)
    laps.append(time.perf_counter())
    solved = (by_policy.outcome == 1) | (direct.outcome == 1)
    classify(starts, aircraft.rules(), aircraft.limits, solved=solved)
    laps.append(time.perf_counter())
    names = "draw_s", "policy_flights_s", "baseline_flights_s", "resolvability_s"
    return dict(zip(names, np.diff(laps).tolist(), strict=True))


class _Run(NamedTuple):
    """One whole evaluation."""

    wall_s: float
    flown_s: float
    """Simulated, all encounters together."""


def _evaluate(evaluation: Evaluation, workers: int, chunks: list[Chunk]) -> _Run:
    began = time.perf_counter()
    work = Work(ReadyEvaluation, columns)
    tables = [table for _, table in fly_chunks(work, evaluation, workers, chunks, lambda: False)]
    wall = time.perf_counter() - began
    return _Run(wall, sum(math.fsum(table["duration_s"]) for table in tables))


def _gemm_rate(shapes: list[tuple[int, ...]], workers: int) -> float:
    """Return the float32 rate of the matrix products by so many processes together, FLOP/s."""
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        return sum(pool.map(gemm_flops_per_s, [shapes] * workers, chunksize=1))


def main() -> None:
    """Measure and print."""
    options = _parser().parse_args()
    policy = Policy.load(options.policy)
    backend = MonteCarloConfig(backend=options.backend).backend_for(policy, options.encounters)
    evaluation = Evaluation(
        options.policy, scenario("circle", PAPER), None, 0, policy.aircraft, backend=backend
    )
    size = MonteCarloConfig(backend=backend).chunk_for(options.encounters, options.workers)
    firsts = range(0, options.encounters, size)
    chunks = [Chunk(first, min(size, options.encounters - first)) for first in firsts]
    runs = [_evaluate(evaluation, options.workers, chunks) for _ in range(options.repeats)]
    gemm_rate = _gemm_rate(layers(policy), options.workers)
    with threadpool_limits(1):
        split = stages(ReadyEvaluation.load(evaluation), chunks[0].size)
    report(
        {
            "encounters": options.encounters,
            "workers": options.workers,
            "backend": backend,
            **figures(runs, options.encounters, evaluation.aircraft.dt, layers(policy), gemm_rate),
            "one_chunk_in_one_process": {"encounters": chunks[0].size} | split,
        },
        ("numpy",),
    )


def _parser() -> Parser:
    parser = Parser(description=__doc__)
    add = parser.add_argument
    add("--policy", type=Path, help="policy file (default: the one that ships)")
    help_text = "encounters of a measurement (default 10000)"
    add("--encounters", type=whole(1), default=10_000, help=help_text)
    add("--repeats", type=whole(1), default=3, help="measurements (default 3)")
    help_text = "processes (default: one for every core)"
    add("--workers", type=whole(1), default=cores(), help=help_text)
    help_text = "what computes the decisions (default auto, as in eval.monte_carlo)"
    add("--backend", choices=("auto", "numpy", "jax"), default="auto", help=help_text)
    return parser


def figures(
    runs: Sequence[_Run],
    encounters: int,
    dt: float,
    shapes: list[tuple[int, ...]],
    gemm_rate: float,
) -> dict[str, Any]:
    """Return how fast evaluations were, and how far from the limit of the matrix products.

    Args:
        runs: the same evaluation, repeated.
        encounters: of each.
        dt: time step, in which the policy acts once, s.
        shapes: of the network's layers.
        gemm_rate: of their products, FLOP/s.
    """
    walls = [run.wall_s for run in runs]
    evaluations = runs[-1].flown_s / dt
    limit_s = evaluations * flops(shapes) / gemm_rate
    return {
        "wall_s": min(walls),
        "wall_s_all": walls,
        "encounters_per_s": encounters / min(walls),
        "policy_evaluations": evaluations,
        "policy_evaluations_per_s": evaluations / min(walls),
        "flop_per_evaluation": flops(shapes),
        "gemm_gflop_per_s": gemm_rate / 1e9,
        "gemm_limit_s": limit_s,
        "share_of_gemm_limit": limit_s / min(walls),
    }


if __name__ == "__main__":
    run_cli(main)
