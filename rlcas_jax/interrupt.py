"""Ctrl-C and SIGTERM in a training: answered at once, also while JAX compiles or a compiled program
runs.
"""

import os
import signal
import sys
import threading
from functools import partial
from types import FrameType
from typing import Any

INTERRUPTED = 130  # exit status
_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupt:
    """A context in which the first signal asks the program to stop, and the second one ends it.

    The program looks at ``requested`` where it can stop. A thread takes the signals: Python itself
    would answer only when the compiled call has returned, and an exception inside such a call can
    crash the process. Where nothing would be lost (:meth:`waits_for` None) the first signal ends
    the process already.
    """

    def __init__(self) -> None:
        """Prepare."""
        self.requested = False
        self._task: str | None = None
        self._before: list[tuple[int, Any]] = []

    def waits_for(self, task: str | None) -> None:
        """Say what a signal would have to wait for from now on; None: for nothing, as there is
        nothing to lose.
        """
        self._task = task

    def __enter__(self) -> "Interrupt":
        """Take over the signals; only possible in the main thread."""
        reader, self._writer = os.pipe()
        os.set_blocking(self._writer, False)
        self._before = [(number, signal.signal(number, _leave_to_thread)) for number in _SIGNALS]
        self._wakeup = signal.set_wakeup_fd(self._writer, warn_on_full_buffer=False)
        threading.Thread(target=self._listen, args=(reader,), daemon=True).start()
        return self

    def __exit__(self, *problem: object) -> None:
        """Give the signals back."""
        signal.set_wakeup_fd(self._wakeup)
        for number, handler in self._before:
            signal.signal(number, handler)
        os.close(self._writer)

    def _listen(self, reader: int) -> None:
        # A byte a signal, its number; nothing more once the writer is closed.
        for numbers in iter(partial(os.read, reader, 64), b""):
            for number in numbers:
                if number in _SIGNALS:
                    self._answer()
        os.close(reader)

    def _answer(self) -> None:
        task = self._task
        if self.requested or task is None:
            _say("interrupted; the last checkpoint is kept" if task else "interrupted")
            if sys.stderr.isatty():
                print(
                    "\x1b[?25h", end="", file=sys.stderr, flush=True
                )  # a live display hides the cursor
            os._exit(INTERRUPTED)
        self.requested = True
        _say(
            f"stopping: waits for {task}; Ctrl-C again ends at once, and the last checkpoint is "
            "kept"
        )


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _leave_to_thread(_number: int, _frame: FrameType | None) -> None:
    """Leave the signal to the thread."""
