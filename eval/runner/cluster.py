"""An existing Dask cluster that flies chunks: ``--scheduler tcp://HOST:PORT``
(docs/howto/evaluation.md).

Dask hands chunks to workers, and again to others where a worker dies. What is decided here: how
many chunks are under way, so that no more than those are ever held; that workers fit the run; and
what a chunk is that workers die of.
"""

import asyncio
import logging
import re
import sys
import time
import uuid
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import CancelledError
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
from distributed import Client, Future, KilledWorker
from distributed.comm.core import connect

from agents.config.load import ConfigError
from commands.command import InputError
from commands.installation import versions
from eval.runner.payload import Chunk, Work, WorkerError, differences, fly, pack, unpack

_ANSWER_S = 5.0  # time in which a scheduler must answer
_PATIENCE_S = 2.0  # time after which the number of workers is asked for again
# chunks under way for each worker: one in the air, one waiting there, so that none waits for the
# network
_AHEAD = 2
_ADDRESS = re.compile(
    r"(?:(?:tcp|tls|ws|wss)://)?(?:\[[0-9A-Fa-f:.%]+\]|[^\s:/\[\]]+):(?P<port>[0-9]{1,5})"
)


class Cluster:
    """Workers that a scheduler knows."""

    def __init__(self, client: Client, address: str) -> None:
        """Take a client that is connected; :func:`connect_scheduler` makes one."""
        self._client, self._address = client, address
        self._counted_at, self._size = 0.0, 0

    def size(self) -> int:
        """Return the number of workers, as of the last two seconds; ``WorkerError``: the scheduler
        has gone.
        """
        if time.monotonic() - self._counted_at >= _PATIENCE_S:
            try:
                workers: Any = self._client.nthreads()
                size = len(workers)
            except (OSError, CancelledError):
                raise self._lost_error() from None
            if size == 0 and self._size > 0:
                self._note("has no worker left: waiting for one (Ctrl-C stops)")
            self._counted_at, self._size = time.monotonic(), size
        return self._size

    def wait_for_a_worker(self) -> None:
        """Return as soon as there is one; a batch system may take its time."""
        if self.size() == 0:
            self._note("has no worker yet: waiting for one (Ctrl-C stops)")
        while self.size() == 0:
            time.sleep(0.2)

    def check(self, expected: Mapping[str, str]) -> None:
        """Refuse workers whose packages differ from those expected."""
        # Workers come and go meanwhile; those that have gone need not fit.
        answers: Any = self._client.run(versions, *expected, on_error="return")
        for worker, answer in sorted(answers.items()):
            unlike = differences(expected, answer) if isinstance(answer, dict) else ""
            unlike = f"no toolkit ({answer})" if isinstance(answer, ImportError) else unlike
            if unlike:
                where = f"--scheduler {self._address}: worker {worker}"
                raise ConfigError(f"{where} has {unlike}, expected the same versions everywhere")

    def fly(
        self,
        task: Work,
        work: Any,
        sha256: str | None,
        chunks: Iterable[Chunk],
        stopped: Callable[[], bool],
    ) -> Iterator[tuple[Chunk, dict[str, np.ndarray]]]:
        """Fly chunks and yield the table of each as it gets ready, in any order; arguments as of
        :func:`fly_chunks`.

        ``WorkerError`` also: the scheduler has gone, a worker does not fit, or several died of a
        chunk.
        """
        name = uuid.uuid4().hex
        # A task and not scattered data: what a task has made is made again when the worker that
        # holds it dies.
        payload = self._client.submit(unpack, pack(name, task, work, sha256), key=f"payload-{name}")
        waiting = deque(chunks)
        air: dict[Any, tuple[Future, Chunk]] = {}
        landed: SimpleQueue[Future] = SimpleQueue()

        try:
            while True:
                while waiting and len(air) < _AHEAD * max(self.size(), 1) and not stopped():
                    chunk = waiting.popleft()
                    # The first part of a key names the group of tasks, by which the scheduler
                    # spreads them evenly.
                    future = self._client.submit(
                        fly, payload, *chunk, key=(f"chunks-{name}", chunk.first)
                    )
                    air[future.key] = future, chunk
                    future.add_done_callback(landed.put)
                if not air:
                    break
                future = self._next(landed, stopped)
                if future is None:
                    return
                _, chunk = air.pop(future.key)
                yield chunk, self._table(future, chunk)
        finally:
            for future, _ in air.values():
                future.cancel()

    def _next(self, landed: SimpleQueue[Future], stopped: Callable[[], bool]) -> Future | None:
        """Return a chunk that has ended, None where none can end because no worker is left."""
        while True:
            try:
                return landed.get(timeout=_PATIENCE_S)
            except Empty:
                if self.size() == 0 and stopped():
                    return None

    def _table(self, future: Future, chunk: Chunk) -> dict[str, np.ndarray]:
        try:
            return future.result()
        except (InputError, WorkerError):
            raise
        except KilledWorker:
            part = f"{chunk.first}..{chunk.first + chunk.size - 1}"
            raise WorkerError(
                f"several workers have died that had encounters {part} to fly (out of memory?)"
            ) from None
        except (OSError, CancelledError):
            raise self._lost_error() from None
        except Exception as problem:
            raise WorkerError(f"a worker has failed: {type(problem).__name__}: {problem}") from None

    def _lost_error(self) -> WorkerError:
        return WorkerError(
            f"the scheduler at {self._address} has gone (killed, or the network is down)"
        )

    def _note(self, text: str) -> None:
        print(f"note: the cluster at {self._address} {text}", file=sys.stderr, flush=True)


@contextmanager
def connect_scheduler(address: str, packages: tuple[str, ...]) -> Generator[Cluster, None, None]:
    """Connect with a scheduler at ``HOST:PORT`` or ``tcp://HOST:PORT``, wait for a worker, and give
    the cluster.

    Also ``tls`` and ``ws``, set up as Dask's configuration says. The packages must have one version
    everywhere.
    """
    match = _ADDRESS.fullmatch(address)
    if match is None or not 0 < int(match["port"]) < 65_536:
        raise ConfigError(
            f"--scheduler: {address!r} is no address; expected tcp://HOST:PORT, such as "
            "tcp://node7:8786"
        )
    address = address if "://" in address else f"tcp://{address}"
    # What matters is said here in a sentence; its own notices are about sockets and coroutines.
    for name in ("distributed", "distributed.client", "tornado.application"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    _greet(address)
    try:
        client = Client(address, timeout=_ANSWER_S, set_as_default=False)
    except (OSError, ImportError, TimeoutError, ValueError) as problem:
        raise ConfigError(f"--scheduler {address}: {problem}") from None
    with client:
        cluster = Cluster(client, address)
        cluster.wait_for_a_worker()
        versions_here = versions(*packages)
        cluster.check({name: versions_here[name] for name in packages})
        yield cluster


def _greet(address: str) -> None:
    """Ask the scheduler for its identity, because a client would wait for ever if nothing
    answers.
    """
    from distributed.security import Security

    async def ask() -> Any:
        comm = await connect(address, timeout=_ANSWER_S, **Security().get_connection_args("client"))
        try:
            await comm.write({"op": "identity", "reply": True})
            return await comm.read()
        finally:
            comm.abort()

    try:
        answer = asyncio.run(asyncio.wait_for(ask(), _ANSWER_S))
        kind = answer.get("type")
    # A stranger's bytes can break the reading of them in any way.
    except Exception:
        expected = "expected the address that dask scheduler prints when it starts"
        raise ConfigError(
            f"--scheduler {address}: no Dask scheduler answers within {_ANSWER_S:g} s, {expected}"
        ) from None
    if kind != "Scheduler":
        raise ConfigError(
            f"--scheduler {address}: is the address of a {kind}, expected that of a Dask scheduler"
        )
