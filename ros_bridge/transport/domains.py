"""A DDS domain that is not used otherwise on this machine."""

import contextlib
import socket
from collections.abc import Generator

__all__ = ["free_domain"]

_FIRST, _END = 20, 200
_PORT = 23_000  # a port that stands for a domain, kept while it is used


@contextlib.contextmanager
def free_domain() -> Generator[int]:
    """Reserve a domain id until the block ends.

    Raises:
        RuntimeError: none is free.
    """
    for number in range(_FIRST, _END):
        with socket.socket() as lock:
            try:
                lock.bind(("127.0.0.1", _PORT + number))
            except OSError:
                continue
            yield number
            return
    raise RuntimeError(f"none of the domains {_FIRST} to {_END - 1} is free")
