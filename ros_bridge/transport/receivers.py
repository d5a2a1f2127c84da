"""The threads that listen to receivers of traffic, and the table of what they can send.

A source is an address whose scheme says format and transport (:data:`FORMATS`). A receiver connects
anew by itself, after 1, 2, 4 ... 30 s. What arrives waits in a queue for the thread of the program,
which takes it as reports (:class:`LiveReports`).
"""

import http.client
import queue
import re
import socket
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple
from urllib.parse import SplitResult, urlsplit
from urllib.request import urlopen

from ros_bridge.core.feeds.aircraft_json import AircraftJson
from ros_bridge.core.feeds.base_station import BaseStation
from ros_bridge.core.feeds.flarm import Flarm
from ros_bridge.core.feeds.gdl90 import Datagram, Gdl90
from ros_bridge.core.feeds.traffic import Traffic
from ros_bridge.core.fields import SECOND, FieldError
from ros_bridge.core.freshness import USUAL_FRESHNESS
from ros_bridge.core.reports import Report

__all__ = ["EXAMPLES", "FORMATS", "LiveReports", "Receiver", "check_ports", "check_sources"]

_PATIENCE = 70.0  # s; dump1090 sends an empty line every 60 s
_LONGEST = 4_096  # bytes of a line
_LARGEST = 16_000_000  # bytes of a document
_DATAGRAM = 4_096  # bytes; devices keep to the 1500 of a network
_SLOWEST = 30.0  # s between two attempts
_BACKWARD = SECOND // 2  # ns; a clock that steps back by more begins anew
_MOST_SOURCES = 8


class Format(NamedTuple):
    """What receivers send."""

    name: str
    reader: Callable[[Traffic], Any]  # of the module of that format
    transport: str  # "lines" and "datagrams" have a port, "documents" a path
    port: int  # the usual one; 0: none
    example: str


_DOCUMENT = Format("aircraft.json", AircraftJson, "documents", 0, "http://HOST/.../aircraft.json")
FORMATS = {
    "tcp": Format("BaseStation", BaseStation, "lines", 30_003, "tcp://HOST:30003"),
    "http": _DOCUMENT,
    "https": _DOCUMENT,
    "file": _DOCUMENT._replace(example="file:///..."),
    "gdl90": Format("GDL 90", Gdl90, "datagrams", 4_000, "gdl90://0.0.0.0:4000"),
    "flarm": Format("FLARM", Flarm, "lines", 2_000, "flarm://HOST:2000"),
}
"""The formats by the scheme of an address."""

EXAMPLES = ", ".join(dict.fromkeys(receiver_format.example for receiver_format in FORMATS.values()))
"""What addresses may look like."""


def check_sources(text: str) -> tuple[str, ...]:
    """Return the sources that a parameter names, with commas between them, or raise ValueError."""
    sources = tuple(part.strip() for part in re.split(r",(?=\s*\w+://)", text) if part.strip())
    for source in sources:
        parts = urlsplit(source)
        known_format = FORMATS.get(parts.scheme)
        if known_format is None or not _fits(known_format, parts):
            raise ValueError(f"adsb is {source!r}, expected {EXAMPLES}")
    repeated = [source for source, count in Counter(sources).items() if count > 1]
    if repeated or len(sources) > _MOST_SOURCES:
        names = f"{repeated[0]} twice" if repeated else f"{len(sources)} sources"
        raise ValueError(f"adsb names {names}, expected each once and {_MOST_SOURCES} at most")
    return sources


def check_ports(sources: Sequence[str]) -> None:
    """Raise ValueError where a source's port of this machine cannot be listened at."""
    for source in sources:
        if FORMATS[urlsplit(source).scheme].transport == "datagrams":
            _bind(source).close()


def _fits(known_format: Format, parts: SplitResult) -> bool:
    """Return whether an address has what its transport needs."""
    if re.search(r"[\s,]", parts.netloc):
        return False
    try:
        usable = parts.port is None or parts.port > 0
    except ValueError:
        return False
    if known_format.transport == "documents":
        return usable and bool(parts.path if parts.scheme == "file" else parts.hostname)
    unnamed = known_format.transport == "datagrams"  # every address of this machine has no name
    return usable and bool(parts.hostname or unnamed) and parts.path in ("", "/")


def _bind(source: str) -> socket.socket:
    """Return what listens for datagrams; ValueError: the port is taken, or the address not this
    machine's.
    """
    parts = urlsplit(source)
    host, port = parts.hostname or "", parts.port or FORMATS[parts.scheme].port
    listener = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM)
    try:
        listener.bind((host, port))
    except OSError as problem:
        listener.close()
        reason = problem.strerror or str(problem)
        raise ValueError(
            f"adsb {source}: port {port} cannot be listened at: {reason}; expected an address of "
            "this machine and a port that no other program has"
        ) from None
    return listener


class Receiver(threading.Thread):
    """Listens to a checked source until it is stopped; the clock gives the node's time, ns.

    Raises:
        ValueError: the source's port of this machine cannot be listened at.
    """

    def __init__(self, source: str, clock: Callable[[], int]) -> None:
        super().__init__(name="adsb", daemon=True)
        self.format = FORMATS[urlsplit(source).scheme]
        self.heard: queue.Queue[tuple[int, str | Datagram] | None] = queue.Queue(10_000)
        """Arrival, ns, and a line, a document or a datagram; None where a connection begins."""
        self.problem = "has not answered yet"
        """What is wrong with the connection, a sentence without its subject; "": nothing."""
        self._source, self._clock, self._stopped, self._again = (
            source,
            clock,
            threading.Event(),
            threading.Event(),
        )
        self._listener = _bind(source) if self.format.transport == "datagrams" else None

    def restart(self) -> None:
        """Give the connection up and begin another one."""
        self._again.set()

    def stop(self) -> None:
        """End the thread, within a second or two."""
        self._stopped.set()
        if self._listener is not None and not self.is_alive():
            self._listener.close()

    def run(self) -> None:
        """Listen, and connect anew whenever that ends."""
        wait = 1.0
        while not self._stopped.is_set():
            self._again.clear()
            try:
                self._put(None)
                for content in self._contents():
                    self.problem, wait = "", 1.0
                    self._put((self._clock(), content))
                    if self._stopped.is_set() or self._again.is_set():
                        break
                else:
                    self.problem = "has closed the connection"
            except (OSError, ValueError, http.client.HTTPException) as error:
                self.problem = f"cannot be read: {str(error) or type(error).__name__}"
            self._stopped.wait(wait)
            wait = min(2.0 * wait, _SLOWEST)
        if self._listener is not None:
            self._listener.close()

    def _put(self, item: tuple[int, str | Datagram] | None) -> None:
        while not self._stopped.is_set():
            try:
                self.heard.put(item, timeout=1.0)
                return
            except queue.Full:
                continue

    def _contents(self) -> Iterator[str | Datagram]:
        if self._listener is not None:
            return self._datagrams(self._listener)
        return self._lines() if self.format.transport == "lines" else self._documents()

    def _ends(self) -> bool:
        return self._stopped.is_set() or self._again.is_set()

    def _lines(self) -> Iterator[str]:
        parts = urlsplit(self._source)
        port = parts.port or self.format.port
        with socket.create_connection((parts.hostname or "", port), 5.0) as connection:
            connection.settimeout(1.0)
            self.problem = ""
            unfinished, silent = b"", 0.0
            while not self._ends():
                try:
                    more = connection.recv(65_536)
                except TimeoutError:
                    silent += 1.0
                    if silent >= _PATIENCE:
                        raise TimeoutError(f"it has sent nothing for {_PATIENCE:g} s") from None
                    continue
                if not more:
                    return
                *lines, unfinished = (unfinished + more).split(b"\n")
                if len(unfinished) > _LONGEST:
                    raise ValueError(
                        f"it sends no lines but {unfinished[:20]!r}, expected {self.format.name}'s "
                        f"(port {self.format.port})"
                    )
                silent = 0.0
                yield from (line.decode("ascii", "replace") for line in lines)

    def _datagrams(self, listener: socket.socket) -> Iterator[Datagram]:
        listener.settimeout(1.0)
        while not self._ends():
            try:
                content, sender = listener.recvfrom(_DATAGRAM)
            except TimeoutError:
                continue
            yield Datagram(f"{sender[0]}:{sender[1]}", content)

    def _documents(self) -> Iterator[str]:
        while not self._stopped.is_set():
            with urlopen(self._source, timeout=5.0) as answer:
                content = answer.read(_LARGEST)
            yield content.decode("utf-8", "replace")
            self._stopped.wait(1.0)


class _Feed:
    """One source: what listens to it, what reads it, and when it was heard."""

    def __init__(self, source: str, traffic: Traffic, clock: Callable[[], int]) -> None:
        self.receiver = Receiver(source, clock)
        self.traffic = traffic
        self._source, self._clock = source, clock
        self._reader = self.receiver.format.reader(traffic)
        self._heard = clock()
        self._late = ""

    def take(self) -> Iterator[tuple[Report | FieldError, int]]:
        """Yield what has come since the last time: a report, or why one cannot be used, and when it
        arrived, ns.
        """
        for _ in range(self.receiver.heard.qsize()):
            item = self.receiver.heard.get_nowait()  # nothing else takes from it
            if item is None:
                self._reader.begin()
                continue
            self._heard, content = item
            try:
                for report in self._reader.reports_of(content, self._heard):
                    yield report, self._heard
            except TimeoutError as late:
                self.receiver.restart()
                self._late = str(late)

    def begin_anew(self, stamp: int) -> None:
        """Forget all that hangs on the clock, which has stepped back to a time, ns."""
        for _ in range(self.receiver.heard.qsize()):
            self.receiver.heard.get_nowait()
        self._reader.begin_anew()
        self._heard = stamp

    def take_problem(self) -> str:
        """Return what is wrong with it, a sentence, or what was since the last time; "":
        nothing.
        """
        silent = (self._clock() - self._heard) / SECOND
        quiet = f"has sent nothing for {silent:.0f} s" if silent > USUAL_FRESHNESS.receiver else ""
        problem, self._late = self._late or self.receiver.problem or quiet, ""
        return f"adsb {self._source} {problem}" if problem else ""


class LiveReports:
    """Reports of receivers, taken whenever there is time for them.

    Args:
        sources: checked ones.
        own: address of the ownship, hexadecimal; "": unknown.
        clock: gives the program's time, ns; from the receivers' threads too.
        shows_own: whether the ownship's reports are wanted too.

    Raises:
        ValueError: a source's port of this machine cannot be listened at.
    """

    def __init__(
        self,
        sources: Sequence[str],
        own: str,
        clock: Callable[[], int],
        *,
        shows_own: bool = False,
    ) -> None:
        self._clock = clock
        self._feeds: list[_Feed] = []
        try:
            for source in sources:
                companion = self._feeds[0].traffic if self._feeds else None
                traffic = Traffic(own, shows_own=shows_own, companion=companion)
                self._feeds.append(_Feed(source, traffic, clock))
        except ValueError:
            self.stop()
            raise
        self._latest = clock()

    def start(self) -> None:
        """Begin to listen."""
        for feed in self._feeds:
            feed.receiver.start()

    def stop(self) -> None:
        """Stop listening, within a second or two."""
        for feed in self._feeds:
            feed.receiver.stop()
        for feed in self._feeds:
            if feed.receiver.is_alive():
                feed.receiver.join()

    def note_own(self, own: Report | None) -> None:
        """Say where the ownship is, as others know it."""
        for feed in self._feeds:
            feed.traffic.own = own

    def is_own(self, name: str) -> bool:
        """Return whether a name is the ownship's."""
        return any(feed.traffic.is_own(name) for feed in self._feeds[:1])

    @property
    def left_out(self) -> Counter[str]:
        """How many reports were not taken as traffic, by the reason."""
        return sum((feed.traffic.counts for feed in self._feeds), Counter[str]())

    @property
    def doubted(self) -> Counter[str]:
        """How many were, although a field forbids it."""
        return sum((feed.traffic.doubted for feed in self._feeds), Counter[str]())

    def take(self) -> Iterator[tuple[Report | FieldError, int]]:
        """Yield what has come since the last time, without waiting: a report, or why one cannot be
        used, and when it arrived, ns. Where the clock has stepped back, what has come is dropped.
        """
        stamp = self._clock()
        if stamp < self._latest - _BACKWARD:
            for feed in self._feeds:
                feed.begin_anew(stamp)
        self._latest = stamp
        for feed in self._feeds:
            yield from feed.take()

    def take_problem(self) -> str:
        """Return what is wrong with a receiver, a sentence, or what was since the last time; "":
        nothing.
        """
        return "; ".join(filter(None, [feed.take_problem() for feed in self._feeds]))
