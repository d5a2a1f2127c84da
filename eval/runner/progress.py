"""How far an evaluation has come: encounters, encounters a second, success."""

import time
from typing import Self

from agents.config.progress import Progress, spaced

__all__ = ["Encounters"]


class Encounters(Progress):
    """A context in which finished encounters are counted and shown."""

    def __init__(self, total: int, before: int = 0) -> None:
        """Prepare for the encounters of a run, some of which were stored before."""
        super().__init__(total, "encounters")
        self._before, self._flown, self._reached = before, 0, 0
        self._begun = time.perf_counter()

    def __enter__(self) -> Self:
        self.start(self._before, "flying")
        if self._before:
            self.note(f"{self._done(self._before)} are stored already")
        return self

    def advance(self, flown: int, reached: int) -> None:
        """Count encounters that were flown now, and how many of them reached their goal."""
        self._flown, self._reached = self._flown + flown, self._reached + reached
        rate = self._flown / max(time.perf_counter() - self._begun, 1e-9)
        figures = f"{spaced(round(rate))} encounters/s, success {100.0 * self._reached / self._flown:.1f} %"
        self.show(self._before + self._flown, figures, rate)
