"""A recording of the graph as an MCAP file, which ``ros2 bag``, Foxglove and other readers open.

Messages are written as they came over the wire; their definitions stand in the file, so that a
reader needs nothing of ours (:mod:`ros_bridge.transport.mcap_file`).
"""

import os
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

from rclpy.node import Node
from rosidl_adapter.parser import parse_message_file

from ros_bridge.transport import topics
from ros_bridge.transport.mcap_file import McapFile, RecordingError

__all__ = ["Recorder", "RecordingError", "definition"]


class Recorder:
    """Records what a node hears until it is closed; :class:`RecordingError` or OSError where it
    cannot.

    Args:
        node: that subscribes.
        path: of the file, which must not exist yet.
        now: the time to be written beside each message, ns.
    """

    def __init__(self, node: Node, path: Path, clock: Callable[[], int]) -> None:
        self._file, self._clock = McapFile(path), clock
        channels = []
        for topic in topics.EVERY:
            kind = f"{topic.kind.__module__.split('.')[0]}/msg/{topic.kind.__name__}"
            name = node.resolve_topic_name(topic.name)
            channels.append((topic, self._file.channel(name, kind, definition(kind))))
        self._file.flush()
        for topic, channel in channels:
            topic.undemanding.subscribe(node, partial(self._write, channel), raw=True)

    def _write(self, channel: int, data: bytes) -> None:
        self._file.write(channel, data, self._clock())

    def close(self) -> None:
        """Finish the file, or raise OSError."""
        self._file.close()


def definition(name: str) -> str:
    """Return the definition of a message (``std_msgs/msg/Header``) and its parts, or raise
    :class:`RecordingError`.
    """
    texts: dict[str, str] = {}
    waiting = [name]
    while waiting:
        message = waiting.pop(0)
        package, folder, kind = message.split("/")
        if message in texts:
            continue
        file = _file(package, folder, kind)
        texts[message] = file.read_text(encoding="utf-8")
        types = [field.type for field in parse_message_file(package, str(file)).fields]
        waiting += [f"{part.pkg_name}/msg/{part.type}" for part in types if part.pkg_name]
    parts = (
        f"MSG: {message.replace('/msg/', '/')}\n{text}"
        for message, text in texts.items()
        if message != name
    )
    return f"\n{'=' * 80}\n".join([texts[name], *parts])


def _file(package: str, folder: str, kind: str) -> Path:
    prefixes = [
        sys.prefix,
        *filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)),
    ]
    for prefix in prefixes:
        file = Path(prefix) / "share" / package / folder / f"{kind}.msg"
        if file.is_file():
            return file
    raise RecordingError(f"the definition of {package}/{folder}/{kind} is in none of {prefixes}")
