"""How much computation a search has left, and what it had to leave out."""

import math
import time

_FINISH = 0.003  # s of the computation that are kept for writing the answer
_BLOCK = 0.001  # s that a block is taken to last at least: a call of compiled code


class Budget:
    """Computation of this thread until a deadline; asked between blocks of a search that take a few
    milliseconds.

    The longest block so far is taken to be as long as the next, and not begun where that would be
    too late. The check of the request, before the first question, takes time but is no block of the
    search. What other threads and processes compute does not count, so that a busy machine costs no
    plans.

    Args:
        seconds: s; inf: no deadline, and no clock is read.
    """

    def __init__(self, seconds: float = math.inf) -> None:
        self.endless = seconds == math.inf
        """Whether there is no deadline."""
        self._began = 0.0 if self.endless else time.thread_time()
        self._seconds, self._longest = max(seconds - _FINISH, 0.0), _BLOCK
        self._last_time = math.inf  # no block has begun
        self.skipped: list[str] = []
        """What was not searched, or not to its end."""

    def ends(self, work: str, share: float = 1.0) -> bool:
        """Return whether another block, as long as the longest so far, would end too late; note
        what it leaves out. What may take a share of the time alone ends when that is over.
        """
        if self.endless:
            return False
        time_now = time.thread_time()
        self._longest, self._last_time = max(self._longest, time_now - self._last_time), time_now
        late = time_now + self._longest > self._began + share * self._seconds
        if late and work not in self.skipped:
            self.skipped.append(work)
        return late
