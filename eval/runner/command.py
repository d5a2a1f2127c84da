"""The frame of the commands that fly many encounters: workers, the run's folder, chunks,
interrupts, files.
"""

import argparse
import json
import math
import os
import signal
import sys
import time
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, NamedTuple, Self, TypeAlias

from agents.config.keys import help_text
from agents.config.load import ConfigError
from commands.command import require
from commands.files import check_space, write_file
from commands.folder_lock import lock
from commands.installation import versions
from commands.progress import Progress, group_digits
from eval.config import ChunksConfig, MonteCarloConfig, PolicyConfig
from eval.flights.aircraft import describe, lines_about
from eval.runner.options import default_folder, load_config, named_policy
from eval.runner.outputs import SCHEMA_VERSION, RunFolder, check_unused
from eval.runner.payload import DECISIVE, Chunk, Work, WorkerError
from eval.runner.workers import cores, fly_chunks

if TYPE_CHECKING:
    from eval.runner.cluster import Cluster

Fly: TypeAlias = Callable[
    [list[Chunk], Callable[[], bool]], Iterable[tuple[Chunk, Mapping[str, Any]]]
]
"""(chunks, whether to stop) -> chunks with their columns, in any order."""

_ROW_BYTES, _PART_BYTES = 500, 64_000
"""What a row and a part take on the disk, generously."""


class Resolved(NamedTuple):
    """What a configuration names, ready to be flown."""

    work: Any  # all that the flights follow from
    config: Any  # a ChunksConfig, resolved but for its chunks
    packages: tuple[str, ...] = ()  # that rows depend on
    row_bytes: int = _ROW_BYTES
    """What a row takes on the disk, generously: it stands in a part and in the joined table."""


class FlownNow(NamedTuple):
    """What a call has flown of a run."""

    flown: int
    wall_s: float


class Command(NamedTuple):
    """What a command does in its own way; ``work`` is all that its flights follow from."""

    name: str  # python -m eval.NAME
    unit: str  # what is counted, such as encounters
    folder: type[RunFolder]
    keys: Mapping[str, str]  # of the configuration by the name of their option
    prefix: str  # as of eval.runner.options.load_config
    resolve: Callable[[Any, argparse.Namespace], Resolved]  # of a configuration and the options
    prepare: Callable[[Any, Any], Any]
    columns: Callable[
        [Any, int, int], dict[str, Any]
    ]  # with ``prepare``: of :class:`eval.runner.payload.Work`
    summarise: Callable[[Mapping[str, Any], Resolved, FlownNow], dict[str, Any]]
    """(table, what was resolved, what was flown now) -> what summary.json holds."""
    draw: Callable[[Path, Mapping[str, Any], Resolved, Mapping[str, Any]], Sequence[Path]]
    """(folder, table, what was resolved, summary) -> files of the figures."""
    show: Callable[[Mapping[str, Any]], None]  # prints a summary
    outcome: Callable[[Any], str] = lambda _: "outcome"
    """(work) -> the column whose share of goals reached is shown as it flies."""
    names_policy: bool = True  # as of :class:`eval.runner.payload.Work`


class Finished(NamedTuple):
    """A run whose files are all written."""

    summary: Mapping[str, Any]
    files: Sequence[str]  # names in the run's folder
    flown: int  # how many were flown now
    wall_s: float


class UnfinishedError(Exception):
    """A run without its whole table: what was flown is kept; the message says why."""

    def __init__(self, message: str, status: int) -> None:
        super().__init__(message)
        self.status = status  # of the exit


def run(command: Command, options: argparse.Namespace) -> int:
    """Fly what the options of a command ask for and return the exit status; bad input raises
    ``InputError``.
    """
    if options.help_keys:
        print(help_text(command.folder.model))
        return 0
    config = load_config(command.folder.model, options, command.keys, command.prefix)
    resolved = command.resolve(config, options)
    folder = options.out or default_folder(command.name)
    try:
        with _cluster_of(options, (*DECISIVE, *resolved.packages)) as cluster:
            finished = fly(command, resolved, folder, resume=options.resume, cluster=cluster)
    except UnfinishedError as end:
        print(
            f"{end}Go on with: python -m eval.{command.name} --resume --out {folder}",
            file=sys.stderr,
        )
        return end.status
    command.show(finished.summary)
    print("\n".join(lines_about(finished.summary)))
    flown, wall_s = finished.flown, finished.wall_s
    if flown:
        print(f"{wall_s:.1f} s, {flown / wall_s:.1f} {command.unit}/s")
    print(f"files: {folder}: {', '.join(finished.files)}")
    return 0


def fly(
    command: Command,
    resolved: Resolved,
    run_folder: Path,
    *,
    resume: bool = False,
    cluster: "Cluster | None" = None,
) -> Finished:
    """Fly a run, or what is missing of it, and write its files into a folder.

    Raises:
        InputError: the folder is in use, holds another run, or has no room.
        UnfinishedError: it was interrupted, or a worker or the disk failed.
    """
    begun = time.perf_counter()
    config: ChunksConfig = resolved.config
    packages = (*DECISIVE, *resolved.packages)
    task = Work(command.prepare, command.columns, packages, command.names_policy)
    workers = config.workers or cores() if cluster is None else cluster.size()
    chunk = config.chunk_for(config.default_count, workers)
    config = config.model_copy(update={"chunk": chunk})
    folder = command.folder(run_folder, config)
    fly_all = partial(fly_chunks, task, resolved.work, workers)
    if cluster is not None:
        sha256 = config.policy_sha256 if isinstance(config, PolicyConfig) else None
        fly_all = partial(cluster.fly, task, resolved.work, sha256)
    if not resume:
        check_unused(folder.path)
        count, parts = config.default_count, math.ceil(config.default_count / chunk)
        needed = count * resolved.row_bytes + parts * _PART_BYTES
        check_space(folder.path, needed, f"{count} rows")
    with lock(folder.path):
        folder.begin(resume=resume)
        table, flown = _whole_table(folder, config, fly_all, command.outcome(resolved.work))
        flown_now = FlownNow(flown, time.perf_counter() - begun)
        resolved = resolved._replace(config=config)
        summary = command.summarise(table, resolved, flown_now)
        write_file(
            folder.path / "summary.json", json.dumps(summary, indent=2, allow_nan=False) + "\n"
        )
        figures = command.draw(folder.path, table, resolved, summary)
    written = {"summary.json", folder.table, "config.yaml", *(path.name for path in figures)}
    return Finished(summary, sorted(written), *flown_now)


def summary_of_policy(
    unit: str, flights: Mapping[str, Any], resolved: Resolved, flown: FlownNow
) -> dict[str, Any]:
    """Return what summary.json says of the flights of one policy.

    Args:
        unit: what is counted, such as encounters.
        flights: what the command itself says of them.
    """
    config: MonteCarloConfig = resolved.config
    shared = ("seed", "scenario", "changes", "mode", "policy_sha256")
    return {
        "schema_version": SCHEMA_VERSION,
        unit: config.default_count,
        **{name: getattr(config, name) for name in shared},
        **describe(resolved.work.aircraft, named_policy(config)),
        "confidence": config.confidence,
        **flights,
        "wall_s": flown.wall_s,
        f"{unit}_flown_now": flown.flown,
        f"{unit}_per_s": flown.flown / flown.wall_s if flown.flown else None,
        "versions": versions("numpy", "safetensors", "pyarrow", "scipy", *resolved.packages),
    }


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
            self.note(f"{self._completed(self._before)} are stored already")
        return self

    def advance(self, flown: int, reached: int) -> None:
        """Count encounters that were flown now, and how many of them reached their goal."""
        self._flown, self._reached = self._flown + flown, self._reached + reached
        rate = self._flown / max(time.perf_counter() - self._begun, 1e-9)
        figures = (
            f"{group_digits(round(rate))} encounters/s, success "
            f"{100.0 * self._reached / self._flown:.1f} %"
        )
        self.show(self._before + self._flown, figures)


def _cluster_of(
    options: argparse.Namespace, packages: tuple[str, ...]
) -> "AbstractContextManager[Cluster] | nullcontext[None]":
    """Return the context of the cluster that ``--scheduler`` names; of none, and nothing of Dask,
    without it.
    """
    if options.scheduler is None:
        return nullcontext()
    if options.workers is not None:
        raise ConfigError(
            "--workers and --scheduler: expected one of them, because a cluster has its own workers"
        )
    require("--scheduler", "distributed")
    from eval.runner.cluster import connect_scheduler

    return connect_scheduler(options.scheduler, packages)


def _whole_table(
    folder: RunFolder, config: ChunksConfig, fly: Fly, outcome: str
) -> tuple[Mapping[str, Any], int]:
    """Fly what is missing of a run; return its whole table, and how many encounters were
    flown now. The column ``outcome`` tells which reached their goal.
    """
    assert config.chunk is not None  # it is resolved
    total, size, stored, flown = config.default_count, config.chunk, folder.stored(), 0
    missing = [
        Chunk(first, min(size, total - first))
        for first in range(0, total, size)
        if first not in stored
    ]
    before = total - sum(chunk.size for chunk in missing)
    try:
        with _stop_on_interrupt() as stopped, Encounters(total, before) as progress:
            for chunk, columns in fly(missing, lambda: bool(stopped)):
                folder.store(chunk.first, columns)
                flown += chunk.size
                progress.advance(chunk.size, int((columns[outcome] == "reached").sum()))
        if before + flown == total:
            return folder.finish(), flown
    except WorkerError as problem:
        raise UnfinishedError(f"error: {problem}\n", 1) from None
    except OSError as problem:
        why = f"{folder.path}: what was flown cannot be stored: {problem.strerror or problem}"
        raise UnfinishedError(f"error: {why}\n", 1) from None
    raise UnfinishedError("interrupted; finished chunks are kept. ", 130)


@contextmanager
def _stop_on_interrupt() -> Generator[list[int], None, None]:
    """Give a list that a first Ctrl-C (or SIGTERM) makes non-empty; a second one interrupts at
    once.
    """
    received: list[int] = []

    def note(number: int, _: FrameType | None) -> None:
        if received:
            raise KeyboardInterrupt
        received.append(number)
        # Not print(): the signal may have interrupted one.
        os.write(
            sys.stderr.fileno(), b"\nfinishing the chunks in the air (Ctrl-C again stops at once)\n"
        )

    try:
        before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    except ValueError:  # not in the main thread, where Ctrl-C arrives
        before = {}
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
