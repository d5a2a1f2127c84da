"""Mission and fence, downloaded again every now and then, because nobody tells of a change."""

import math
from typing import Any, NamedTuple

from ros_bridge.core.fields import FieldError
from ros_bridge.mavlink.download import Download, accept, due, note_question
from ros_bridge.mavlink.link import FENCE, MISSION, Link
from ros_bridge.mavlink.mission import Item

PERIOD = 5.0
"""After which both are downloaded again, s."""


class Whole(NamedTuple):
    """A mission or fence that has come whole."""

    kind: int  # MAV_MISSION_TYPE
    items: tuple[Item, ...]


class Refresh:
    """Mission and fence, downloaded again every :data:`PERIOD`; times in s on the
    autopilot's clock.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._running: dict[int, Download] = {}
        self._began = 0.0

    def hasten(self) -> None:
        """Let both be downloaded at once."""
        self._began = -math.inf

    def ask(self, now: float) -> None:
        """Ask for what is due."""
        if not 0.0 <= now - self._began < PERIOD and now:
            self._began = now
            for kind in (MISSION, FENCE):
                self._running.setdefault(kind, Download(kind))
        for kind, download in self._running.items():
            if due(download, now):
                number = None if download.count is None else len(download.items)
                self._link.ask_item(kind, number)
                self._running[kind] = note_question(download, now)

    def take(self, message: Any) -> Whole | None:
        """Take in a MISSION_COUNT or MISSION_ITEM_INT, and return what is whole by it; None: not
        yet. An item that is none ends the download and raises
        :class:`ros_bridge.core.fields.FieldError`.
        """
        kind = getattr(message, "mission_type", MISSION)
        if kind not in self._running:
            return None
        try:
            download = self._running[kind] = accept(self._running[kind], message)
        except FieldError:
            self._end(kind)
            raise
        if not download.done:
            return None
        self._end(kind)
        return Whole(kind, download.items)

    def drop(self, kind: int) -> None:
        """Give up a download whose items are not there any more; the next begins when it is due."""
        self._running.pop(kind, None)

    def _end(self, kind: int) -> None:
        del self._running[kind]
        self._link.thank(kind)
