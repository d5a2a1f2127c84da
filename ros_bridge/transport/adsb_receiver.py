"""The thread that listens to an ADS-B receiver: a TCP stream of lines, or a document that is
fetched every second.

It reconnects by itself, after 1, 2, 4 ... 30 s. What arrives waits in a queue for the thread of the
program, which takes it as reports (:class:`LiveReports`).
"""

import http.client
import queue
import socket
import threading
from collections.abc import Callable, Iterator
from urllib.parse import urlsplit
from urllib.request import urlopen

from ros_bridge.core import adsb_live
from ros_bridge.core.fields import SECOND, FieldError
from ros_bridge.core.freshness import USUAL_FRESHNESS
from ros_bridge.core.reports import Report

__all__ = ["LiveReports", "Receiver", "check_source"]

_PORT = 30_003
_PATIENCE = 70.0  # s; dump1090 sends an empty line every 60 s
_LONGEST = 4_096  # bytes of a line
_LARGEST = 16_000_000  # bytes of a document
_SLOWEST = 30.0  # s between two attempts
_BACKWARD = SECOND // 2  # ns; a clock that steps back by more begins anew


def check_source(text: str) -> str:
    """Return the source of ADS-B that a parameter names, or raise ValueError."""
    parts = urlsplit(text)
    try:
        usable = parts.port is None or parts.port > 0
    except ValueError:
        usable = False
    known = parts.scheme == "tcp" and parts.hostname and parts.path in ("", "/")
    known = (
        known
        or (parts.scheme in ("http", "https") and parts.hostname)
        or (parts.scheme == "file" and parts.path)
    )
    if not (usable and known):
        raise ValueError(
            f"adsb is {text!r}, expected tcp://HOST:30003, http://HOST/.../aircraft.json or "
            "file:///..."
        )
    return text


class Receiver(threading.Thread):
    """Listens to a checked source until it is stopped; the clock gives the node's time, ns."""

    def __init__(self, source: str, clock: Callable[[], int]) -> None:
        super().__init__(name="adsb", daemon=True)
        self.lines = source.startswith("tcp:")
        self.heard: queue.Queue[tuple[int, str] | None] = queue.Queue(10_000)
        """Arrival, ns, and a line or a document; None where a connection begins."""
        self.problem = "has not answered yet"
        """What is wrong with the connection, a sentence without its subject; "": nothing."""
        self._source, self._clock, self._stopped, self._again = (
            source,
            clock,
            threading.Event(),
            threading.Event(),
        )

    def restart(self) -> None:
        """Give the connection up and begin another one."""
        self._again.set()

    def stop(self) -> None:
        """End the thread, within a second or two."""
        self._stopped.set()

    def run(self) -> None:
        """Listen, and connect anew whenever that ends."""
        wait = 1.0
        while not self._stopped.is_set():
            self._again.clear()
            try:
                self._put(None)
                for text in self._lines() if self.lines else self._documents():
                    self.problem, wait = "", 1.0
                    self._put((self._clock(), text))
                    if self._stopped.is_set() or self._again.is_set():
                        break
                else:
                    self.problem = "has closed the connection"
            except (OSError, ValueError, http.client.HTTPException) as error:
                self.problem = f"cannot be read: {str(error) or type(error).__name__}"
            self._stopped.wait(wait)
            wait = min(2.0 * wait, _SLOWEST)

    def _put(self, item: tuple[int, str] | None) -> None:
        while not self._stopped.is_set():
            try:
                self.heard.put(item, timeout=1.0)
                return
            except queue.Full:
                continue

    def _lines(self) -> Iterator[str]:
        parts = urlsplit(self._source)
        with socket.create_connection(
            (parts.hostname or "", parts.port or _PORT), 5.0
        ) as connection:
            connection.settimeout(1.0)
            self.problem = ""
            rest, silent = b"", 0.0
            while not (self._stopped.is_set() or self._again.is_set()):
                try:
                    more = connection.recv(65_536)
                except TimeoutError:
                    silent += 1.0
                    if silent >= _PATIENCE:
                        raise TimeoutError(f"it has sent nothing for {_PATIENCE:g} s") from None
                    continue
                if not more:
                    return
                *lines, rest = (rest + more).split(b"\n")
                if len(rest) > _LONGEST:
                    raise ValueError(
                        f"it sends no lines but {rest[:20]!r}, expected BaseStation's (port "
                        f"{_PORT})"
                    )
                silent = 0.0
                yield from (line.decode("ascii", "replace") for line in lines)

    def _documents(self) -> Iterator[str]:
        while not self._stopped.is_set():
            with urlopen(self._source, timeout=5.0) as answer:
                content = answer.read(_LARGEST)
            yield content.decode("utf-8", "replace")
            self._stopped.wait(1.0)


class LiveReports:
    """A receiver's reports, taken whenever there is time for them.

    Args:
        source: a checked one.
        own: address of the ownship, hexadecimal; "": unknown.
        clock: gives the program's time, ns; from the receiver's thread too.
    """

    def __init__(self, source: str, own: str, clock: Callable[[], int]) -> None:
        self.traffic = adsb_live.Traffic(own)
        self._source, self._clock = source, clock
        self._receiver = Receiver(source, clock)
        kind = adsb_live.BaseStation if self._receiver.lines else adsb_live.AircraftJson
        self._reader = kind(self.traffic)
        self._heard = self._latest = clock()
        self._late = ""

    def start(self) -> None:
        """Begin to listen."""
        self._receiver.start()

    def stop(self) -> None:
        """Stop listening, within a second or two."""
        self._receiver.stop()
        self._receiver.join()

    def take(self) -> Iterator[tuple[Report | FieldError, int]]:
        """Yield what has come since the last time, without waiting: a report, or why one cannot be
        used, and when it arrived, ns. Where the clock has stepped back, what has come is dropped.
        """
        now = self._clock()
        if now < self._latest - _BACKWARD:
            self._begin_anew(now)
        self._latest = now
        for _ in range(self._receiver.heard.qsize()):
            item = self._receiver.heard.get_nowait()  # nothing else takes from it
            if item is None:
                self._reader.begin()
                continue
            self._heard, text = item
            try:
                for found in self._reader.reports_of(text, self._heard):
                    yield found, self._heard
            except TimeoutError as late:
                self._receiver.restart()
                self._late = str(late)

    def _begin_anew(self, now: int) -> None:
        """Forget all that hangs on the clock, which has stepped back to a time, ns."""
        for _ in range(self._receiver.heard.qsize()):
            self._receiver.heard.get_nowait()
        self._reader.begin_anew()
        self._heard = now

    def take_problem(self) -> str:
        """Return what is wrong with the receiver, a sentence, or what was since the last time; "":
        nothing.
        """
        silent = (self._clock() - self._heard) / SECOND
        quiet = f"has sent nothing for {silent:.0f} s" if silent > USUAL_FRESHNESS.receiver else ""
        problem, self._late = self._late or self._receiver.problem or quiet, ""
        return f"adsb {self._source} {problem}" if problem else ""
