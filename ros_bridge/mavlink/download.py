"""A mission or fence that is downloaded message by message, while everything else goes on."""

from dataclasses import dataclass, replace
from typing import Any

from ros_bridge.mavlink.mission import Item, item

AGAIN = 1.0
"""After which what has not been answered is asked again, s."""


@dataclass(frozen=True)
class Download:
    """What has come so far; never changed in place."""

    kind: int  # MAV_MISSION_TYPE
    count: int | None = None  # None: not known yet
    items: tuple[Item, ...] = ()
    request_time: float = float("-inf")  # when, s

    @property
    def complete(self) -> bool:
        """Whether all has come."""
        return self.count is not None and len(self.items) >= self.count


def due(download: Download, seconds: float) -> bool:
    """Return whether something is to be asked: the number of items, or the next one."""
    return not download.complete and not 0.0 <= seconds - download.request_time < AGAIN


def note_question(download: Download, seconds: float) -> Download:
    """Return the download after a question."""
    return replace(download, request_time=seconds)


def accept(download: Download, message: Any) -> Download:
    """Return the download after a message: an answer is taken in, and the next question is due.

    An item that is none raises :class:`ros_bridge.core.fields.FieldError`.
    """
    kind = message.get_type()
    if download.complete or getattr(message, "mission_type", 0) != download.kind:
        return download
    if kind == "MISSION_COUNT" and download.count is None:
        return replace(download, count=int(message.count), request_time=float("-inf"))
    if kind == "MISSION_ITEM_INT" and download.count and message.seq == len(download.items):
        items = (*download.items, item(message))
        return replace(download, items=items, request_time=float("-inf"))
    return download
