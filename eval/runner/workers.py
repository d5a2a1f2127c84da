"""Processes that fly chunks side by side.

Threads would be simpler, but a step of a chunk is hundreds of short array operations, and two threads spend much of
their time waiting for the interpreter's lock (measured: 1.2 times the speed of one, against 1.9 with processes).
A worker ends by itself when its pipe closes or its parent has gone, so that none outlives one that was killed.
"""

import multiprocessing
import os
import signal
import threading
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from agents.policy.inference import Policy
from envs.encounters import EncounterError

__all__ = ["DECISIVE", "Chunk", "RunError", "Task", "WorkerError", "cores", "fly_chunks"]

DECISIVE = ("rlcas-toolkit", "numpy")
"""Packages that must have one version everywhere, because rows depend on it."""


class Chunk(NamedTuple):
    """Consecutive encounters."""

    first: int
    size: int


class Task(NamedTuple):
    """How chunks of one kind of evaluation are flown; its functions are found again by their names in a worker."""

    prepare: Callable[[Any, Policy], Any]
    """(what is flown, the policy) -> what the next function flies with."""
    columns: Callable[[Any, int, int], dict[str, np.ndarray]]
    """(what was prepared, first encounter, how many) -> table of the chunk."""
    packages: tuple[str, ...] = DECISIVE
    """On whose versions the rows depend."""


class RunError(RuntimeError):
    """A run cannot go on, though its input is good; the message says why. What is stored remains."""


class WorkerError(RunError):
    """A worker has failed; the message says how."""


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def fly_chunks(
    task: Task, work: Any, workers: int, chunks: Iterable[Chunk], stopped: Callable[[], bool]
) -> Iterator[tuple[Chunk, dict[str, np.ndarray]]]:
    """Fly chunks and yield the table of each as it gets ready, in any order.

    Args:
        task: for this kind of work.
        work: what is flown, with the path of its policy.
        workers: processes; with 1 everything happens in this one.
        chunks: to fly.
        stopped: asked before each chunk; once it is true, none is begun and those in the air are finished.

    Raises:
        EncounterError: an encounter cannot be drawn.
        WorkerError: a worker has failed.
    """
    waiting = deque(chunks)
    if workers == 1 or len(waiting) <= 1:
        # One thread in every case, because BLAS rounds differently with several.
        with threadpool_limits(1):
            prepared = task.prepare(work, Policy.load(work.policy))
            while waiting and not stopped():
                chunk = waiting.popleft()
                yield chunk, task.columns(prepared, *chunk)
        return
    with _processes(task, work, min(workers, len(waiting))) as pipes:
        busy: dict[Connection, Chunk] = {}
        idle = list(pipes)
        while True:
            while idle and waiting and not stopped():
                connection = idle.pop()
                busy[connection] = waiting.popleft()
                _send(connection, busy[connection])
            if not busy:
                return
            for connection in wait(list(busy)):
                assert isinstance(connection, Connection)
                table = _receive(connection)
                idle.append(connection)
                yield busy.pop(connection), table


@contextmanager
def _processes(task: Task, work: Any, size: int) -> Generator[list[Connection], None, None]:
    """Start workers and give their pipes; on leaving they end."""
    # A fresh interpreter each: a fork would copy the locks of whatever threads numpy has started.
    context = multiprocessing.get_context("spawn")
    processes, pipes = [], []
    with _interrupts_ignored():
        for _ in range(size):
            ours, theirs = context.Pipe()
            process = context.Process(target=_serve, args=(theirs, task, work), daemon=True)
            process.start()
            theirs.close()
            processes.append(process)
            pipes.append(ours)
    try:
        yield pipes
    except BaseException:
        for process in processes:
            process.terminate()
        raise
    finally:
        for pipe in pipes:
            pipe.close()
        for process in processes:
            process.join()


@contextmanager
def _interrupts_ignored() -> Generator[None, None, None]:
    """Let processes that are started inside ignore Ctrl-C, which a terminal sends to all of them.

    What ignores a signal hands that down, so that there is no moment at which a young worker would die of it.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may change how signals are met
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _serve(connection: Connection, task: Task, work: Any) -> None:
    """Work on the chunks that come through the pipe until it closes; without the parent, end at once."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    with threadpool_limits(1):
        prepared: Any = None
        while True:
            try:
                chunk: Chunk = connection.recv()
            except EOFError:
                return
            answer: Any
            try:
                prepared = prepared or task.prepare(work, Policy.load(work.policy))
                answer = task.columns(prepared, *chunk)
            except EncounterError as problem:
                answer = problem
            except Exception:
                answer = WorkerError(traceback.format_exc())
            try:
                connection.send(answer)
            except OSError:
                return


def _send(connection: Connection, chunk: Chunk) -> None:
    try:
        connection.send(chunk)
    except OSError:
        raise WorkerError("a worker process has ended unexpectedly") from None


def _receive(connection: Connection) -> dict[str, np.ndarray]:
    try:
        answer = connection.recv()
    except (EOFError, OSError):
        raise WorkerError("a worker process has ended unexpectedly (killed, or out of memory)") from None
    if isinstance(answer, Exception):
        raise answer
    return answer
