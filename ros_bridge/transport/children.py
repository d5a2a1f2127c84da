"""Nodes as child processes that end with their parent, however that ends, and a DDS domain for them
alone.

A child reads its standard input, which only its parent can write to. The system closes it when the
parent is gone, killed by SIGKILL too, on every platform; the child then ends in order.
"""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Generator, Iterable

FLAG = "--end-with-parent"
"""Argument of a node that ends when its standard input is closed."""

_FIRST, _END = 20, 200  # domains
_PORT = 23_000  # a port that stands for a domain, kept while it is used
_IN_ORDER = 10.0  # s in which a child without a parent must end in order
_PATIENCE = 15.0  # s in which a child must end once it is asked to


def start_node(module: str, *arguments: str) -> "subprocess.Popen[bytes]":
    """Start a node of ours, ``python -m module``, as a child that ends with this process."""
    return subprocess.Popen([sys.executable, "-m", module, FLAG, *arguments], stdin=subprocess.PIPE)


def stop(children: "Iterable[subprocess.Popen[bytes]]") -> None:
    """End children, and wait until they have ended; one that does not is killed."""
    children = list(children)
    for child in children:
        child.terminate()
    end = time.monotonic() + _PATIENCE
    for child in children:
        try:
            child.wait(max(end - time.monotonic(), 0.1))
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
        if child.stdin is not None:
            child.stdin.close()


def end_with_parent() -> None:
    """Have this process end in order when its standard input is closed; at once if that takes too
    long.
    """
    threading.Thread(target=_watch, name="parent", daemon=True).start()


def _watch() -> None:
    while os.read(sys.stdin.fileno(), 1024):
        pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_IN_ORDER)
    os._exit(1)


@contextlib.contextmanager
def free_domain() -> Generator[int]:
    """Reserve a domain id until the block ends; raise RuntimeError where none is free."""
    for number in range(_FIRST, _END):
        with socket.socket() as lock:
            try:
                lock.bind(("127.0.0.1", _PORT + number))
            except OSError:
                continue
            yield number
            return
    raise RuntimeError(f"none of the domains {_FIRST} to {_END - 1} is free")
