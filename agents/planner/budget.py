"""How much computation a search has left, and what it had to leave out."""

import math
import time

__all__ = ["Budget"]

_FINISH = 0.005  # s of the computation that are kept for the block in progress and for writing the answer


class Budget:
    """Computation of this thread until a deadline; asked between blocks of a search that take a few milliseconds.

    What other threads and processes compute does not count, so that a busy machine costs no plans.

    Args:
        seconds: s; inf: no deadline, and no clock is read.
    """

    def __init__(self, seconds: float = math.inf) -> None:
        self._until = math.inf if seconds == math.inf else time.thread_time() + max(seconds - _FINISH, 0.0)
        self.skipped: list[str] = []
        """What was not searched, or not to its end."""

    @property
    def now(self) -> float:
        """Computation of this thread so far, s; 0 without a deadline."""
        return 0.0 if self._until == math.inf else time.thread_time()

    def over(self, ahead: float = 0.0) -> bool:
        """Return whether the deadline is past, or would be after as much computation more, s."""
        return self._until < math.inf and time.thread_time() + ahead > self._until

    def ends(self, what: str, ahead: float = 0.0) -> bool:
        """Return the same, and note what is left out where it is."""
        if not self.over(ahead):
            return False
        if what not in self.skipped:
            self.skipped.append(what)
        return True
