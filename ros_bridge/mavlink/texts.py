"""What the program says: lines on its output, and texts to the ground station."""

import math
from typing import TextIO

from ros_bridge.core.fields import SECOND
from ros_bridge.mavlink.link import Link

AGAIN = 5.0
"""Between two texts of the same kind, s."""


class Texts:
    """Says things, each kind only so often.

    Args:
        link: to the autopilot, by which the ground station hears.
        out: where lines are written; None: nowhere.
    """

    def __init__(self, link: Link, out: TextIO | None) -> None:
        self._link, self._out = link, out
        self._told: dict[str, float] = {}  # when a kind was told last, s

    def log(self, text: str, now: int | None = None) -> None:
        """Write a line; where it cannot be written, as on a full disk, nothing stops for it."""
        if self._out is None:
            return
        moment = "" if now is None else f"{now / SECOND:8.2f} "
        try:
            print(f"{moment}{text}", file=self._out, flush=True)
        except OSError:
            self._out = None

    def send(self, text: str) -> None:
        """Send a text to the ground station."""
        self._link.say(f"RLCAS: {text}")

    def tell(
        self, kind: str, text: str, now: int, *, send: bool, more: str = "", again: float = AGAIN
    ) -> bool:
        """Log a text, and send it, unless one of its kind has just been; return whether it has."""
        seconds = now / SECOND
        if 0.0 <= seconds - self._told.get(kind, -math.inf) < again:
            return False
        self._told[kind] = seconds
        self.log(f"{text} ({more})" if more else text, now)
        if send:
            self.send(text)
        return True
