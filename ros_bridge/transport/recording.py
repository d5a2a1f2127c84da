# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""A recording of the graph as an MCAP file, which ``ros2 bag``, Foxglove and other readers open.

Messages are written as they came over the wire; their definitions stand in the file, so that a reader needs nothing
of ours. A recorder that is killed leaves all but its last second; ``mcap recover`` then puts an end to the file.
"""

import os
import sys
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Path as PathMessage
from rclpy.node import Node
from rlcas_msgs.msg import AircraftState, AssuranceStatus, GeoReference, TrafficAlert, Trajectory
from rosgraph_msgs.msg import Clock
from visualization_msgs.msg import MarkerArray

from ros_bridge.transport import qos

_RUNNER, _MONITOR = "rlcas_runner", "rlcas_monitor"
TOPICS = (
    (Clock, "/clock", qos.CLOCK),
    (AircraftState, f"{_RUNNER}/input/ownship", qos.SENSOR),
    (AircraftState, f"{_RUNNER}/input/traffic", qos.TRAFFIC),
    (TrafficAlert, f"{_RUNNER}/input/alerts", qos.EVENTS),
    (Trajectory, f"{_RUNNER}/input/route", qos.LATCHED),
    (GeoReference, f"{_RUNNER}/input/geo_reference", qos.LATCHED),
    (Trajectory, f"{_RUNNER}/output/trajectory", qos.LATCHED),
    (Trajectory, f"{_RUNNER}/output/advisory", qos.EVENTS),
    (PathMessage, f"{_RUNNER}/output/path", qos.LATCHED),
    (MarkerArray, f"{_RUNNER}/output/markers", qos.LATCHED),
    (AssuranceStatus, f"{_MONITOR}/output/status", qos.LATCHED),
    (Trajectory, f"{_MONITOR}/output/backup", qos.LATCHED),
    (DiagnosticArray, "/diagnostics", qos.EVENTS),
)
"""What is recorded: type, name and quality of service."""

_SETTLE = 1.0  # s of real time at most until a message is in the file
_GAP = 1_000_000_000  # ns between two encounters, whose clocks begin anew


class RecordingError(ValueError):
    """A recording that cannot be made; the message says why."""


class Recorder:
    """Records until it is closed.

    Args:
        node: that subscribes.
        path: of the file, which must not exist yet.
        now: the time to be written beside each message, ns; where it steps back the recording goes on a second later.

    Raises:
        RecordingError: the file cannot be made, or what writes it is not installed.
        OSError: the file cannot be written.
    """

    def __init__(self, node: Node, path: Path, now: Callable[[], int]) -> None:
        try:
            from mcap.writer import Writer
        except ModuleNotFoundError as error:
            raise RecordingError(f"recording needs {error.name}, which is not installed (make ros)") from error
        try:
            self._file = path.open("xb", buffering=0)
        except OSError as error:
            what = "exists already" if isinstance(error, FileExistsError) else f"cannot be written: {error.strerror}"
            raise RecordingError(f"{path} {what}") from error
        self._path, self._now, self._latest, self._shift = path, now, 0, 0
        self._settled = time.monotonic()
        self._writer: Writer | None = (writer := Writer(self._file))
        with self._guarded():
            writer.start(profile="ros2", library="rlcas-toolkit")
            names = dict.fromkeys(_name(kind) for kind, _, _ in TOPICS)
            schemas = {name: writer.register_schema(name, "ros2msg", definition(name).encode()) for name in names}
            for kind, topic, quality in TOPICS:
                channel = writer.register_channel(node.resolve_topic_name(topic), "cdr", schemas[_name(kind)])
                node.create_subscription(kind, topic, partial(self._write, channel), quality, raw=True)
            writer.flush()

    def _write(self, channel: int, data: Any) -> None:
        if self._writer is None:
            return
        now = self._now() + self._shift
        if now < self._latest:
            self._shift += self._latest + _GAP - now
            now = self._latest + _GAP
        self._latest = now
        with self._guarded():
            self._writer.add_message(channel, log_time=now, publish_time=now, data=bytes(data))
            if time.monotonic() - self._settled > _SETTLE:
                self._settled = time.monotonic()
                self._writer.flush()

    def close(self) -> None:
        """Finish the file.

        Raises:
            OSError: it cannot be written.
        """
        if self._writer is not None:
            with self._guarded():
                self._writer.finish()
                self._file.close()
            self._writer = None

    @contextmanager
    def _guarded(self) -> Generator[None]:
        """End the recording where it cannot be written, with an error that names the file."""
        try:
            yield
        except OSError as error:
            self._writer = None
            raise OSError(error.errno, error.strerror, str(self._path)) from error


def definition(name: str) -> str:
    """Return a message's definition, such as of ``std_msgs/msg/Header``, followed by those of all that it consists of.

    Raises:
        RecordingError: it is not installed.
    """
    order = list(dict.fromkeys([name, *_parts(name)]))
    texts = [_text(name), *(f"MSG: {_short(one)}\n{_text(one)}" for one in order[1:])]
    return f"\n{'=' * 80}\n".join(texts)


def _parts(name: str) -> Iterator[str]:
    """Yield the messages that a message consists of, at all depths."""
    from rosidl_adapter.parser import parse_message_string

    package, _, kind = name.split("/")
    for field in parse_message_string(package, kind, _text(name)).fields:
        if field.type.pkg_name:
            part = f"{field.type.pkg_name}/msg/{field.type.type}"
            yield part
            yield from _parts(part)


def _text(name: str) -> str:
    package, folder, kind = name.split("/")
    prefixes = [sys.prefix, *os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)]
    for prefix in filter(None, prefixes):
        file = Path(prefix) / "share" / package / folder / f"{kind}.msg"
        if file.is_file():
            return file.read_text(encoding="utf-8")
    raise RecordingError(f"the definition of {name} is in none of {prefixes}")


def _short(name: str) -> str:
    package, _, kind = name.split("/")
    return f"{package}/{kind}"


def _name(kind: Any) -> str:
    return f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
