"""Processes that fly chunks side by side.

Threads would be simpler, but a step of a chunk is hundreds of short array operations, and two
threads spend much of their time waiting for the interpreter's lock (measured: 1.2 times the speed
of one, against 1.9 with processes). A worker ends by itself when its parent has gone, so that none
outlives one that was killed.
"""

import multiprocessing
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import wait as wait_for_any
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from agents.policy.inference import Policy
from eval.runner.payload import Chunk, Payload, Work, WorkerError, fly, pack, unpack

_ENDING = 10.0  # s that a process without its parent has to end by itself


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def fly_chunks(
    task: Work, work: Any, workers: int, chunks: Iterable[Chunk], stopped: Callable[[], bool]
) -> Iterator[tuple[Chunk, dict[str, np.ndarray]]]:
    """Fly chunks of some work, which may name the file of a policy, and yield the table of each in
    any order.

    With one worker everything happens in this process. ``stopped`` is asked before each chunk: once
    it is true, none is begun and those in the air are finished.

    ``InputError``: the policy cannot be loaded, or an encounter cannot be drawn; ``WorkerError``: a
    worker has failed.
    """
    waiting = deque(chunks)
    if workers == 1 or len(waiting) <= 1:
        # One thread in every case, because BLAS rounds differently with several.
        with threadpool_limits(1):
            policy = Policy.load(work.policy) if task.names_policy else None
            prepared = task.prepare(work, policy)
            while waiting and not stopped():
                chunk = waiting.popleft()
                yield chunk, task.columns(prepared, *chunk)
        return
    size = min(workers, len(waiting))
    sha256 = Policy.load(work.policy).sha256 if task.names_policy else None
    packed = pack("run", task, work, sha256)
    with processes(size, _begin, packed) as pool:
        air: dict[Future[dict[str, np.ndarray]], Chunk] = {}
        while True:
            while len(air) < size and waiting and not stopped():
                chunk = waiting.popleft()
                air[pool.submit(_columns, *chunk)] = chunk
            if not air:
                return
            for future in wait(air, return_when=FIRST_COMPLETED).done:
                chunk = air.pop(future)
                try:
                    table = future.result()
                except BrokenProcessPool:
                    raise WorkerError(
                        "a worker process has ended unexpectedly (killed, or out of memory)"
                    ) from None
                yield chunk, table


@contextmanager
def processes(
    size: int, begin: Callable[..., object], *arguments: Any
) -> Generator[ProcessPoolExecutor, None, None]:
    """Give processes that begin with a call of ``begin``; Ctrl-C does not reach them. On leaving
    they end, at once (SIGTERM) where an error or an interrupt ends the run, or this process is
    killed.
    """
    before = set(multiprocessing.active_children())
    # A fresh interpreter each: a fork would copy the locks of whatever threads numpy has started.
    pool = ProcessPoolExecutor(
        size, multiprocessing.get_context("spawn"), _begin_beside, (begin, *arguments)
    )
    try:
        with _ignore_interrupts():
            for _ in range(size):
                pool.submit(os.getpid)  # a process is started with each of the first calls
        yield pool
    except BaseException:
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _begin_beside(begin: Callable[..., object], *arguments: Any) -> None:
    """Begin a process, which ends without its parent: by SIGTERM, and at last at once."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        wait_for_any([parent.sentinel])
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(_ENDING)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    begin(*arguments)


@contextmanager
def _ignore_interrupts() -> Generator[None, None, None]:
    """Let processes that are started inside ignore Ctrl-C, which a terminal sends to all of them.

    What ignores a signal hands that down, so that there is no moment at which a young worker would
    die of it.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may change how signals are met
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


_payloads: list[Payload] = []  # of a worker's process: the one that it works for


def _begin(data: bytes) -> None:
    _payloads.append(unpack(data))


def _columns(first: int, count: int) -> dict[str, np.ndarray]:
    return fly(_payloads[0], first, count)
