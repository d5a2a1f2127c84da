"""What a Dask cluster costs: ``python -m benchmarks.cluster [--encounters N]``.

Start-up of a local cluster; time that a chunk takes beside its flying, by chunks whose tables are
there already; and the same encounters flown by one and two workers of a cluster, by one and two
processes of ``--workers``, and their ratio. Needs the extra ``cluster``.
"""

import time
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from distributed import LocalCluster

from agents.policy.inference import Policy
from benchmarks.measure import report
from commands.command import Parser, run_cli, whole
from envs.aircraft import PAPER
from envs.scenarios import scenario
from eval.flights.chunks import Evaluation, ReadyEvaluation, columns
from eval.runner.cluster import Cluster, connect_scheduler
from eval.runner.payload import DECISIVE, Chunk, Work
from eval.runner.workers import fly_chunks

_EMPTY_CHUNK = 1_250  # rows of a table that is not flown
_FLIGHTS = Work(ReadyEvaluation, columns)


def main() -> None:
    """Measure and print."""
    options = _parser().parse_args()
    policy = Policy.load()
    evaluation = Evaluation(None, scenario("circle", PAPER), None, 0, policy.aircraft)
    firsts = range(0, options.encounters, options.chunk)
    chunks = [Chunk(first, min(options.chunk, options.encounters - first)) for first in firsts]
    summary: dict[str, Any] = {"encounters": options.encounters, "chunk": options.chunk}
    for workers in (1, 2):
        summary[f"cluster_of_{workers}"] = measure_cluster(
            workers, evaluation, policy, chunks, options.chunks
        )
        flights = fly_chunks(_FLIGHTS, evaluation, workers, chunks, lambda: False)
        summary[f"processes_{workers}"] = {"wall_s_after_first": _time_after_first(flights).wall}
    for kind in ("cluster_of", "processes"):
        of_one, of_two = (summary[f"{kind}_{n}"]["wall_s_after_first"] for n in (1, 2))
        summary[f"{kind}_speed_up"] = of_one / of_two
    report(summary, ("numpy", "distributed"))


def _parser() -> Parser:
    parser = Parser(description=__doc__)
    add = parser.add_argument
    help_text = "encounters of a measurement (default 10000)"
    add("--encounters", type=whole(1), default=10_000, help=help_text)
    add("--chunk", type=whole(1), default=1_250, help="encounters of a chunk (default 1250)")
    add("--chunks", type=whole(1), default=200, help="chunks that are not flown (default 200)")
    return parser


def measure_cluster(
    workers: int, evaluation: Evaluation, policy: Policy, chunks: Sequence[Chunk], empty: int
) -> dict[str, float]:
    """Return what a cluster of so many workers takes.

    Args:
        workers: processes of the cluster.
        evaluation: that is flown.
        policy: that flies it.
        chunks: of the encounters.
        empty: chunks that are not flown.
    """
    blank = [Chunk(first, _EMPTY_CHUNK) for first in range(empty)]
    with start_local(workers) as (cluster, start_s):
        flights = cluster.fly(_FLIGHTS, evaluation, policy.sha256, chunks, lambda: False)
        flying = _time_after_first(flights)
        tables = cluster.fly(_NO_FLIGHTS, Nothing(None), policy.sha256, blank, lambda: False)
        passing = _time_after_first(tables)
    # The scheduler of a local cluster lives in this process.
    return {
        "start_s": start_s,
        "wall_s_after_first": flying.wall,
        "overhead_ms_per_chunk": 1e3 * passing.wall / (empty - 1),
        "driver_and_scheduler_cpu_ms_per_chunk": 1e3 * passing.processor / (empty - 1),
    }


class _Times(NamedTuple):
    wall: float  # s
    processor: float  # of this process, s


def _time_after_first(results: Iterator[Any]) -> _Times:
    """Return how long all results take after the first, for which the workers import the
    toolkit.
    """
    next(results)
    began, busy = time.perf_counter(), time.process_time()
    for _ in results:
        pass
    return _Times(time.perf_counter() - began, time.process_time() - busy)


class Nothing(NamedTuple):
    """Work that is done already."""

    policy: None


def idle_crew(work: Nothing, policy: Policy) -> np.random.Generator:
    """Return a crew that does not fly."""
    return np.random.default_rng(0)


def make_table(crew: np.random.Generator, first: int, count: int) -> dict[str, np.ndarray]:
    """Return a table of the usual size, 30 columns of numbers and 5 of words."""
    words = np.array(["reached", "violation", "timeout"], dtype=object)[crew.integers(0, 3, count)]
    return {f"number_{i}": crew.random(count) for i in range(30)} | {
        f"word_{i}": words for i in range(5)
    }


_NO_FLIGHTS = Work(idle_crew, make_table)


@contextmanager
def start_local(workers: int) -> Generator[tuple[Cluster, float], None, None]:
    """Give a cluster of processes of this machine and the time that it took to start, s."""
    began = time.perf_counter()
    # Its types know only the dashboard's address, and only the asynchronous cluster.
    settings: Any = {"dashboard_address": None, "host": "127.0.0.1"}
    started: Any = LocalCluster(n_workers=workers, threads_per_worker=1, **settings)
    with started, connect_scheduler(started.scheduler_address, DECISIVE) as cluster:
        while cluster.size() < workers:
            time.sleep(0.05)
        yield cluster, time.perf_counter() - began


if __name__ == "__main__":
    run_cli(main)
