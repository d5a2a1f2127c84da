"""A signal that comes while a node's process still starts ends it as one that comes later does,
with exit code 0.

Nothing but the standard library is imported here, so that it holds from the first import on.
"""

import os
import signal
import threading
from typing import Any

_STARTED = threading.Event()


def end_in_order_from_now_on() -> None:
    """Have SIGINT and SIGTERM end this process at once, until :func:`note_start`."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _end)


def note_start() -> None:
    """Leave signals to ROS, which has its handlers by now."""
    _STARTED.set()


def _end(number: int, frame: Any) -> None:
    if not _STARTED.is_set():
        os._exit(0)  # nothing is there yet that would have to be left in order
    if number == signal.SIGINT:
        raise KeyboardInterrupt
