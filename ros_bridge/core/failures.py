"""What failed for an error of our own: told, and kept from ending what goes on.

What only shows must never end what protects, and what protects must not stand still without a word.
Whoever attempts something notes what it raises; the failure is said once while it lasts, and stands
in the state of health until it has gone well again.
"""

import time
import traceback
from collections.abc import Callable
from typing import NamedTuple

TOLD = 10.0
"""For how long a failure is told at least, s, also where it went well since."""


class _Failure(NamedTuple):
    text: str
    at: float  # s of a clock that never steps back
    over: bool = False  # whether it has gone well since


class Failures:
    """What failed of late, by what was attempted; ``say`` takes a sentence."""

    def __init__(
        self, say: Callable[[str], object], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._say, self._clock = say, clock
        self._failed: dict[str, _Failure] = {}

    def attempt(self, name: str, work: Callable[[], object]) -> bool:
        """Do some work, and return whether it went well: what it raises is noted."""
        try:
            work()
        except Exception as error:
            self.note(name, error)
            return False
        self.clear(name)
        return True

    def note(self, name: str, error: Exception) -> None:
        """Note what an attempt raised."""
        previous = self._failed.get(name)
        text = f"{name} failed: {_sentence(error)}"
        if previous is None or not self._is_told(previous):
            self._say(text)
        self._failed[name] = _Failure(text, self._clock())

    def clear(self, name: str) -> None:
        """Note that an attempt went well."""
        previous = self._failed.get(name)
        if previous is not None:
            self._failed[name] = previous._replace(over=True)

    def forget(self) -> None:
        """Forget everything."""
        self._failed.clear()

    def problems(self) -> list[str]:
        """Return what has failed of late, a sentence each."""
        self._failed = {
            name: failure for name, failure in self._failed.items() if self._is_told(failure)
        }
        return [failure.text for failure in self._failed.values()]

    def _is_told(self, failure: _Failure) -> bool:
        return not failure.over or self._clock() - failure.at <= TOLD


def _sentence(error: Exception) -> str:
    """Return what an error says, and where it was raised."""
    calls = traceback.extract_tb(error.__traceback__)
    place = f" ({calls[-1].filename.rpartition('/')[2]}, line {calls[-1].lineno})" if calls else ""
    return f"{type(error).__name__}: {error}{place}"
