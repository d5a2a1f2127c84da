"""The start of a node's process, as ``python -m ros_bridge.NAME`` and as the command
``rlcas-NAME``.

A signal that comes while it still starts ends it as one that comes later does, with exit code 0; so
nothing but the standard library is imported before.
"""

import gc
import os
import signal
import threading
from typing import Any, NoReturn

_STARTED = threading.Event()


def run_node(module: str) -> NoReturn:
    """Run a node's ``main``, in a module of ``ros_bridge.nodes``, and exit with its status."""
    end_in_order_from_now_on()
    # Whatever is imported stays; looking for what does not takes an eighth of the time.
    gc.disable()
    from commands.command import run_cli

    run_cli(f"ros_bridge.nodes.{module}:main")


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
