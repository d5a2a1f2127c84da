"""Messages that were published and did not come.

Each publisher of DDS numbers its messages, and a gap in the numbers is a loss, wherever it
happened: on the way, in a socket's buffer or in the queue of a subscriber that was too slow. (The
event of a lost message, which DDS has too, says nothing of the last.) Where a DDS tells no numbers
nothing is counted.
"""

from collections import Counter
from collections.abc import Callable
from typing import Any

_MOST = 1024  # publishers that are remembered
_RECENT = 10.0  # s for which a loss is told


class Losses:
    """Counts what is lost, by topic; times are s of a clock that never steps back."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._due: dict[tuple[str, bytes], int] = {}
        self._last: dict[str, float] = {}

    def note(self, topic: str, publisher: bytes, number: int | None, time: float) -> None:
        """Note a message of a publisher's number that arrives."""
        if number is None:
            return
        key = topic, publisher
        due = self._due.pop(key, number)
        if number > due:
            self.counts[topic] += number - due
            self._last[topic] = time
        self._due[key] = max(due, number + 1)
        if len(self._due) > _MOST:
            del self._due[next(iter(self._due))]

    def problem(self, time: float) -> str:
        """Return what has been lost of late, a sentence; "": nothing."""
        return "; ".join(
            f"{self.counts[topic]} messages of {topic} were lost, the last {time - last:.0f} s ago"
            for topic, last in sorted(self._last.items())
            if time - last <= _RECENT
        )

    def counting(
        self, topic: str, callback: Callable[[Any], object], clock: Callable[[], float]
    ) -> Callable[[Any, Any], None]:
        """Return a subscription's callback that counts what is lost before it calls another."""

        def count(message: Any, info: Any) -> None:
            publisher = bytes((info["publisher_gid"] or {}).get("data", b""))
            self.note(topic, publisher, info["publication_sequence_number"], clock())
            callback(message)

        return count
