"""What the commands that fly many encounters share: workers, the run's folder, chunks, interrupts, exit status."""

import argparse
import os
import signal
import sys
import time
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any, Self, TypeAlias

from agents.config.load import ConfigError
from agents.config.progress import Progress, spaced
from envs.edge.files import check_space

if TYPE_CHECKING:
    from eval.config import MonteCarloConfig
    from eval.runner.cluster import Cluster
    from eval.runner.outputs import RunFolder
    from eval.runner.workers import Chunk, Task


Fly: TypeAlias = "Callable[[list[Chunk], Callable[[], bool]], Iterable[tuple[Chunk, Mapping[str, Any]]]]"
"""(chunks, whether to stop) -> chunks with their columns, in any order."""

_ROW_BYTES, _PART_BYTES = 500, 64_000
"""What a row and a part take on the disk, generously: a row stands in a part and in the joined table."""


class Encounters(Progress):
    """A context in which finished encounters are counted and shown."""

    def __init__(self, total: int, before: int = 0) -> None:
        """Prepare for the encounters of a run, some of which were stored before."""
        super().__init__("encounters")
        self._total, self._before, self._flown, self._reached = total, before, 0, 0
        self._begun = time.perf_counter()

    def __enter__(self) -> Self:
        self.start(self._total, self._before, "flying")
        if self._before:
            self.note(f"{self._done(self._before)} are stored already")
        return self

    def advance(self, flown: int, reached: int) -> None:
        """Count encounters that were flown now, and how many of them reached their goal."""
        self._flown, self._reached = self._flown + flown, self._reached + reached
        rate = self._flown / max(time.perf_counter() - self._begun, 1e-9)
        figures = f"{spaced(round(rate))} encounters/s, success {100.0 * self._reached / self._flown:.1f} %"
        self.show(self._before + self._flown, figures, rate)


@contextmanager
def cluster_of(options: argparse.Namespace, packages: tuple[str, ...] = ()) -> "Generator[Cluster | None, None, None]":
    """Give the cluster that ``--scheduler`` names, connected; None without that option, where nothing of Dask is used.

    Every worker must have the same versions of the usual packages and of those given here.
    """
    if options.scheduler is None:
        yield None
        return
    if options.workers is not None:
        raise ConfigError("--workers and --scheduler: expected one of them, because a cluster has its own workers")
    try:
        from eval.runner.cluster import connected
    except ModuleNotFoundError as problem:
        if problem.name not in ("dask", "distributed"):
            raise
        raise ConfigError(
            f"--scheduler: {problem.name} is not installed, expected the extra cluster (pip install "
            "'rlcas-toolkit[cluster]')"
        ) from None
    from eval.runner.workers import DECISIVE

    with connected(options.scheduler, (*DECISIVE, *packages)) as cluster:
        yield cluster


def flown_on(cluster: "Cluster | None", workers: int, task: "Task", work: Any, sha256: str) -> Fly:
    """Return what flies chunks of a run: a cluster's workers, or processes of this machine where there is none."""
    if cluster is not None:
        return partial(cluster.fly, task, work, sha256)
    from eval.runner.workers import fly_chunks

    return partial(fly_chunks, task, work, workers)


@contextmanager
def run_in(folder: "RunFolder", config: "MonteCarloConfig", *, resume: bool) -> Generator[None, None, None]:
    """Begin a run in its folder, or go on with one, and hold the folder for this process alone until it ends."""
    from agents.config.folder_lock import locked
    from eval.runner.outputs import check_unused

    if not resume:
        check_unused(folder.path)
        _check_room(folder, config)
    with locked(folder.path):
        if resume:
            folder.resume()
        else:
            folder.create()
        yield


def _check_room(folder: "RunFolder", config: "MonteCarloConfig") -> None:
    """Refuse a run whose files the disk has no room for."""
    assert config.chunk is not None  # it is resolved
    needed = config.wanted * _ROW_BYTES + -(-config.wanted // config.chunk) * _PART_BYTES
    check_space(folder.path, needed, f"{config.wanted} rows")


class UnfinishedError(Exception):
    """A run without its whole table: what was flown is kept; the message says why and how to go on."""

    def __init__(self, message: str, status: int) -> None:
        super().__init__(message)
        self.status = status  # of the exit


def whole_table(
    folder: "RunFolder", config: "MonteCarloConfig", fly: "Fly", what: str, program: str
) -> tuple[Mapping[str, Any], int]:
    """Fly what is missing of a run; return its whole table, and how many encounters were flown now.

    Args:
        folder, config: of the run, as resolved.
        fly: (chunks, whether to stop) -> chunks with their columns, in any order.
        what: is in the air, for the message of an interrupt.
        program: that the run goes on with, such as ``python -m eval.monte_carlo``.

    Raises:
        UnfinishedError: the run was interrupted, a worker has ended, or nothing can be stored any more.
    """
    from eval.runner.workers import Chunk, RunError

    assert config.chunk is not None  # it is resolved
    resume = f"Go on with: {program} --resume --out {folder.path}"
    total, size, stored, flown = config.wanted, config.chunk, folder.done(), 0
    missing = [Chunk(first, min(size, total - first)) for first in range(0, total, size) if first not in stored]
    before = total - sum(chunk.size for chunk in missing)
    try:
        with _stop_on_interrupt(what) as stopped, Encounters(total, before) as progress:
            for chunk, columns in fly(missing, lambda: bool(stopped)):
                folder.store(chunk.first, columns)
                flown += chunk.size
                progress.advance(chunk.size, int((columns["outcome"] == "reached").sum()))
        if before + flown == total:
            return folder.finish(), flown
    except RunError as problem:
        raise UnfinishedError(f"error: {problem}\n{resume}", 1) from None
    except OSError as problem:
        why = f"{folder.path}: what was flown cannot be stored: {problem.strerror or problem}"
        raise UnfinishedError(f"error: {why}\n{resume}", 1) from None
    raise UnfinishedError(f"interrupted; finished chunks are kept. {resume}", 130)


def concluded(run: Callable[[argparse.Namespace], int], options: argparse.Namespace) -> int:
    """Return the exit status of a run, having said why it ended early if it did."""
    if options.resume and options.out is None:
        raise ConfigError("--resume: expected --out with the folder of the run")
    try:
        return run(options)
    except UnfinishedError as end:
        print(end, file=sys.stderr)
        return end.status


@contextmanager
def _stop_on_interrupt(what: str) -> Generator[list[int], None, None]:
    """Give a list that a first Ctrl-C (or SIGTERM) makes non-empty; a second one interrupts at once."""
    received: list[int] = []

    def note(number: int, _: Any) -> None:
        if received:
            raise KeyboardInterrupt
        received.append(number)
        # Not print(): the signal may have interrupted one.
        os.write(sys.stderr.fileno(), f"\nfinishing the {what} in the air (Ctrl-C again stops at once)\n".encode())

    try:
        before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    except ValueError:  # not in the main thread, where Ctrl-C arrives
        yield received
        return
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
