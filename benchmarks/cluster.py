"""What a Dask cluster costs: ``python -m benchmarks.cluster [--encounters N]``.

Start-up of a local cluster; time that a chunk takes beside its flying, by chunks whose tables are
there already; and the same encounters flown by one and two workers of a cluster, by one and two
processes of ``--workers``, and their ratio. Needs the extra ``cluster``.
"""

import time
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from distributed import LocalCluster

from agents.policy.inference import Policy
from benchmarks.measure import report
from envs.aircraft import PAPER
from envs.edge.command import Parser, run_cli
from envs.encounters import scenario
from eval.flights.chunks import Evaluation, Pilot, columns
from eval.runner.cluster import Cluster, connect_scheduler
from eval.runner.payload import DECISIVE, Chunk, Work
from eval.runner.workers import fly_chunks


class Nothing(NamedTuple):
    """Work that is done already."""

    policy: None


def idle(work: Nothing, policy: Policy) -> np.random.Generator:
    """Return a crew that does not fly."""
    return np.random.default_rng(0)


def make_table(crew: np.random.Generator, first: int, count: int) -> dict[str, np.ndarray]:
    """Return a table of the usual size, 30 columns of numbers and 5 of words."""
    words = np.array(["reached", "violation", "timeout"], dtype=object)[crew.integers(0, 3, count)]
    return {f"number_{i}": crew.random(count) for i in range(30)} | {
        f"word_{i}": words for i in range(5)
    }


@contextmanager
def local(workers: int) -> Generator[tuple[Cluster, float], None, None]:
    """Give a cluster of processes of this machine and the time that it took to start, s."""
    begun = time.perf_counter()
    # Its types know only the dashboard's address, and only the asynchronous cluster.
    settings: Any = {"dashboard_address": None, "host": "127.0.0.1"}
    made: Any = LocalCluster(n_workers=workers, threads_per_worker=1, **settings)
    with made, connect_scheduler(made.scheduler_address, DECISIVE) as cluster:
        while cluster.size() < workers:
            time.sleep(0.05)
        yield cluster, time.perf_counter() - begun


def main() -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    parser.add_argument(
        "--encounters", type=int, default=10_000, help="encounters of a measurement (default 10000)"
    )
    parser.add_argument(
        "--chunk", type=int, default=1_250, help="encounters of a chunk (default 1250)"
    )
    parser.add_argument(
        "--chunks", type=int, default=200, help="chunks that are not flown (default 200)"
    )
    options = parser.parse_args()

    policy = Policy.load()
    evaluation = Evaluation(None, scenario("circle", PAPER), None, 0, policy.aircraft)
    firsts = range(0, options.encounters, options.chunk)
    chunks = [Chunk(first, min(options.chunk, options.encounters - first)) for first in firsts]
    empty = [Chunk(first, 1_250) for first in range(options.chunks)]
    found: dict[str, Any] = {"encounters": options.encounters, "chunk": options.chunk}
    for workers in (1, 2):
        with local(workers) as (cluster, start_s):
            flown = cluster.fly(
                Work(Pilot, columns), evaluation, policy.sha256, chunks, lambda: False
            )
            next(flown)  # the first imports the toolkit
            begun = time.perf_counter()
            list(flown)
            found[f"cluster_of_{workers}"] = {
                "start_s": start_s,
                "wall_s_after_first": time.perf_counter() - begun,
            }
            nothing = cluster.fly(
                Work(idle, make_table), Nothing(None), policy.sha256, empty, lambda: False
            )
            next(nothing)
            begun, busy = time.perf_counter(), time.process_time()
            list(nothing)
            each, here = (
                now / (len(empty) - 1)
                for now in (time.perf_counter() - begun, time.process_time() - busy)
            )
            # The scheduler of a local cluster lives in this process.
            more = {
                "overhead_ms_per_chunk": 1e3 * each,
                "driver_and_scheduler_cpu_ms_per_chunk": 1e3 * here,
            }
            found[f"cluster_of_{workers}"] |= more
        flown = fly_chunks(Work(Pilot, columns), evaluation, workers, chunks, lambda: False)
        next(flown)
        begun = time.perf_counter()
        list(flown)
        found[f"processes_{workers}"] = {"wall_s_after_first": time.perf_counter() - begun}
    for kind in ("cluster_of", "processes"):
        one, two = (found[f"{kind}_{n}"]["wall_s_after_first"] for n in (1, 2))
        found[f"{kind}_speed_up"] = one / two
    report(found, ("numpy", "distributed"))


if __name__ == "__main__":
    run_cli(main)
