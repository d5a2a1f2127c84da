"""Mission and fence, downloaded again every now and then, because nobody tells of a change.

Pure: a :class:`Refresh` follows from the one before.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, NamedTuple

from ros_bridge.core.fields import FieldError
from ros_bridge.mavlink.download import Download, accept, due, note_question
from ros_bridge.mavlink.effects import AskItem, Thank
from ros_bridge.mavlink.link import FENCE, MISSION
from ros_bridge.mavlink.mission import Item

PERIOD = 5.0
"""After which both are downloaded again, s."""


class Downloaded(NamedTuple):
    """A mission or fence that has been downloaded."""

    kind: int  # MAV_MISSION_TYPE
    items: tuple[Item, ...]


@dataclass(frozen=True)
class Refresh:
    """Mission and fence, downloaded again every :data:`PERIOD`; times in s on the autopilot's
    clock.
    """

    running: Mapping[int, Download] = field(default_factory=lambda: MappingProxyType({}))
    """The downloads, by their MAV_MISSION_TYPE."""
    began: float = 0.0


class Refreshed(NamedTuple):
    """The state after a message or a question, what is to be sent, and what has come."""

    refresh: Refresh
    effects: tuple[AskItem | Thank, ...] = ()
    downloaded: Downloaded | None = None
    problem: FieldError | None = None  # the item that is none, for which a download has ended


def hasten(refresh: Refresh) -> Refresh:
    """Let both be downloaded at once."""
    return replace(refresh, began=-math.inf)


def ask(refresh: Refresh, time: float) -> Refreshed:
    """Ask for what is due."""
    running, began = dict(refresh.running), refresh.began
    if not 0.0 <= time - began < PERIOD and time:
        began = time
        for kind in (MISSION, FENCE):
            running.setdefault(kind, Download(kind))
    questions: list[AskItem] = []
    for kind, download in running.items():
        if due(download, time):
            number = None if download.count is None else len(download.items)
            questions.append(AskItem(kind, number))
            running[kind] = note_question(download, time)
    return Refreshed(Refresh(MappingProxyType(running), began), tuple(questions))


def take(refresh: Refresh, message: Any) -> Refreshed:
    """Take in a MISSION_COUNT or MISSION_ITEM_INT; an item that is none ends its download."""
    kind = getattr(message, "mission_type", MISSION)
    if kind not in refresh.running:
        return Refreshed(refresh)
    try:
        download = accept(refresh.running[kind], message)
    except FieldError as problem:
        return Refreshed(drop(refresh, kind), (Thank(kind),), problem=problem)
    if not download.complete:
        running = MappingProxyType({**refresh.running, kind: download})
        return Refreshed(replace(refresh, running=running))
    return Refreshed(drop(refresh, kind), (Thank(kind),), Downloaded(kind, download.items))


def drop(refresh: Refresh, kind: int) -> Refresh:
    """Give up a download; the next begins when it is due."""
    running = {
        running_kind: download
        for running_kind, download in refresh.running.items()
        if running_kind != kind
    }
    return replace(refresh, running=MappingProxyType(running))
