"""An MCAP file that is whole at every moment, whatever its messages come from; nothing here imports
ROS.

What is added takes the place of the end of the file, with a new end behind it, in one write. A
writer that is killed leaves all but its last second.
"""

import itertools
import struct
import time
from collections import Counter
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

from mcap.writer import Writer

__all__ = ["GrowingFile", "McapFile", "RecordingError"]

_SETTLE = 1.0  # s of real time at most until a message is in the file
_END = struct.pack("<BQI", 0x0F, 4, 0) + struct.pack("<BQQQI", 0x02, 20, 0, 0, 0) + b"\x89MCAP0\r\n"
"""Records DataEnd and Footer, without a summary, and the magic number: how an MCAP file ends at the
least.
"""

_GAP = 1_000_000_000  # ns between two encounters, whose clocks begin anew


class RecordingError(ValueError):
    """A recording that cannot be made; the message says why."""


class GrowingFile:
    """A new file that ends as an MCAP file must after each :meth:`flush`; what comes in between
    waits in memory.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = path.open("xb", buffering=0)
        self._length = 0  # without the end
        self._waiting: list[bytes] = []

    def tell(self) -> int:
        """Return where the next byte comes to stand."""
        return self._length + sum(map(len, self._waiting))

    def write(self, data: bytes) -> int:
        """Take in bytes."""
        self._waiting.append(bytes(data))
        return len(data)

    def flush(self) -> None:
        """Write what waits, and an end, or raise OSError; the file then ends where it ended
        before.
        """
        if self._waiting:
            self._put(b"".join(self._waiting), _END)

    def close(self, *, finished: bool) -> None:
        """Close the file; what waits is written first, with an end of its own, if the writer has
        finished.
        """
        try:
            if finished:
                self._put(b"".join(self._waiting), b"")
        finally:
            self._file.close()

    def _put(self, data: bytes, end: bytes) -> None:
        self._waiting.clear()
        content, written = data + end, 0
        try:
            self._file.seek(self._length)
            while written < len(content):
                written += self._file.write(content[written:])
            self._file.truncate()
        except OSError as error:
            self._file.truncate(self._length)
            if self._length:
                # There is room for the old end, because it stood there before.
                self._file.seek(self._length)
                self._file.write(_END)
            raise OSError(error.errno, error.strerror, str(self.path)) from error
        self._length += len(data)


class McapFile:
    """Messages of ROS in a file; :class:`RecordingError` or OSError where it cannot be written.

    Args:
        path: of the file, which must not exist yet.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._file = GrowingFile(path)
        except OSError as error:
            problem = (
                "exists already"
                if isinstance(error, FileExistsError)
                else f"cannot be written: {error.strerror}"
            )
            raise RecordingError(f"{path} {problem}") from error
        self.path = path  # of the file; another one once the recording has failed
        self._writer: Writer | None = Writer(cast(Any, self._file))  # it writes, tells and flushes
        self._latest, self._shift = 0, 0
        self._settled = time.monotonic()
        self._counts: Counter[int] = Counter()
        self._schemas: dict[str, int] = {}
        with self._guard() as writer:
            writer.start(profile="ros2", library="rlcas-toolkit")

    def channel(self, topic: str, kind: str, definition: str) -> int:
        """Return the number of a new channel.

        Args:
            topic: its whole name.
            kind: of its messages, such as ``std_msgs/msg/Header``.
            definition: of the kind and its parts.
        """
        with self._guard() as writer:
            if kind not in self._schemas:
                self._schemas[kind] = writer.register_schema(kind, "ros2msg", definition.encode())
            return writer.register_channel(topic, "cdr", self._schemas[kind])

    def write(self, channel: int, data: bytes, stamp: int) -> None:
        """Add a serialized message at a time, ns; where the time steps back the recording goes on a
        second later.
        """
        if self._writer is None:
            return
        stamp += self._shift
        if stamp < self._latest:
            self._shift += self._latest + _GAP - stamp
            stamp = self._latest + _GAP
        self._latest = stamp
        number = self._counts[channel]
        self._counts[channel] += 1
        self._writer.add_message(
            channel, log_time=stamp, publish_time=stamp, sequence=number, data=bytes(data)
        )
        if time.monotonic() - self._settled > _SETTLE:
            self.flush()

    def flush(self) -> None:
        """Bring what has been added into the file, or raise OSError."""
        self._settled = time.monotonic()
        with self._guard() as writer:
            writer.flush()

    def close(self) -> None:
        """Finish the file, or raise OSError."""
        if self._writer is not None:
            with self._guard() as writer:
                writer.finish()
                self._file.close(finished=True)
            self._writer = None

    @contextmanager
    def _guard(self) -> Generator[Writer]:
        """End the recording where it cannot be written: it keeps what it holds, under a name that
        says so.
        """
        assert self._writer is not None
        try:
            yield self._writer
        except OSError:
            self._writer = None
            self._file.close(finished=False)
            if self.path.stat().st_size == 0:
                self.path.unlink()
                raise
            names = (
                f"{self.path.stem}.partial{number or ''}{self.path.suffix}"
                for number in itertools.count()
            )
            self.path = self.path.replace(
                next(path for path in map(self.path.with_name, names) if not path.exists())
            )
            raise
