"""What a hyper-parameter search sees of a training while it runs: its evaluations, and requests to stop."""

import signal
import time
from collections.abc import Callable, Mapping
from typing import Any

from rlcas_jax.progress import Reporter

__all__ = ["Watch"]


class Watch(Reporter):
    """Shows a training's progress, lets the pruner see its evaluations and ends it when the time is up.

    A request to stop ends the training between two updates; the sweep hears of it here, because it may come in the
    training's last update or in one that is pruned.
    """

    def __init__(self, *, quiet: bool, deadline: float | None) -> None:
        """Prepare; ``deadline`` is a moment of the monotonic clock, s."""
        super().__init__(quiet=quiet)
        self.evaluated: Callable[[Mapping[str, float]], None] | None = None
        self.stopping = False
        self._deadline = deadline
        self._listening = False

    def start(self, total_steps: int, step: int = 0) -> None:
        """Begin with a training."""
        super().start(total_steps, step)
        self._listening = False

    def update(self, row: Mapping[str, float]) -> None:
        """Take the figures of an update."""
        super().update(row)
        if not self._listening:
            self._listening = True
            for number in (signal.SIGINT, signal.SIGTERM):
                self._listen(number)
        if self.late() and not self.stopping:
            signal.raise_signal(signal.SIGINT)  # the training stops as it does by Ctrl-C: after the update, saved
        if "eval_success" in row and self.evaluated is not None:
            self.evaluated(row)

    def late(self) -> bool:
        """Return whether the time is up."""
        return self._deadline is not None and time.monotonic() >= self._deadline

    def _listen(self, number: int) -> None:
        """Take note of a signal before the training's own handler, which removes itself at its end, gets it."""
        handler = signal.getsignal(number)

        def heard(number: int, frame: Any) -> None:
            self.stopping = True
            if callable(handler):
                handler(number, frame)

        signal.signal(number, heard)
