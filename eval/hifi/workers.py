"""Processes that fly flights side by side, a fresh interpreter each with a JSBSim of its own.

JSBSim holds the interpreter's lock while it runs, so that threads would wait for each other. A worker ends when its
parent is gone, however that went.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import connection

import numpy as np
from threadpoolctl import threadpool_limits

from eval.hifi.flights import Campaign, LoadedCampaign
from eval.hifi.rows import columns
from eval.runner.workers import Chunk, WorkerError

__all__ = ["fly_flights"]

Table = dict[str, np.ndarray]

_crew: list[LoadedCampaign] = []  # of a worker


def fly_flights(
    campaign: Campaign, chunks: Iterable[Chunk], workers: int, stopped: Callable[[], bool]
) -> Iterator[tuple[Chunk, Table]]:
    """Fly chunks of flights and yield the table of each as it gets ready, in any order.

    Args:
        campaign: what is flown.
        chunks: to fly.
        workers: processes; with 1 everything happens in this one.
        stopped: asked before each chunk; once it is true, none is begun and those in the air are finished.

    Raises:
        EncounterError: an encounter cannot be drawn.
        WorkerError: a worker has ended unexpectedly.
    """
    waiting = list(chunks)[::-1]
    if workers == 1 or len(waiting) <= 1:
        with threadpool_limits(1):
            loaded = LoadedCampaign(campaign)
            while waiting and not stopped():
                chunk = waiting.pop()
                yield chunk, columns(loaded, *chunk)
        return
    context = multiprocessing.get_context("spawn")
    size = min(workers, len(waiting))
    with ProcessPoolExecutor(size, mp_context=context, initializer=_begin, initargs=(campaign,)) as pool:
        busy: dict[Future[Table], Chunk] = {}
        try:
            while True:
                while waiting and len(busy) < size and not stopped():
                    chunk = waiting.pop()
                    busy[pool.submit(_work, chunk)] = chunk
                if not busy:
                    return
                for done in wait(busy, return_when=FIRST_COMPLETED).done:
                    yield busy.pop(done), done.result()
        except BrokenProcessPool:
            raise WorkerError("a worker process has ended unexpectedly (killed, or out of memory)") from None
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _begin(campaign: Campaign) -> None:
    """Prepare a worker: Ctrl-C is the parent's affair, and without a parent there is nothing to do."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    parent = multiprocessing.parent_process()
    if parent is not None:

        def watch() -> None:
            connection.wait([parent.sentinel])
            os._exit(1)

        threading.Thread(target=watch, daemon=True).start()
    threadpool_limits(1)
    _crew.append(LoadedCampaign(campaign))


def _work(chunk: Chunk) -> Table:
    return columns(_crew[0], *chunk)
