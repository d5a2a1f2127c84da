"""The server: four files and a WebSocket, on one port, for readers only.

Live, every client gets the newest picture; one that reads slowly misses pictures, and its queue
holds two at most. Of a recording, a client asks for the picture of a time, ``{"time": 12.5}`` in s,
and gets the next one when it has asked again. A client that sends anything else is told so and
disconnected. Whoever opens the WebSocket from another page is refused, and so are names of this
host that are not its own, because a page of the network might use them to read the traffic.
"""

import asyncio
import errno
import ipaddress
import itertools
import json
import logging
import math
import socket
import time
from collections import deque
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache, partial
from http import HTTPStatus
from importlib.resources import files
from typing import Any, Protocol, cast
from urllib.parse import urlsplit

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from commands.json_text import parse_json
from ros_bridge.core.failures import Failures
from ros_bridge.display.connections import Connections
from ros_bridge.display.document import VERSION, Document, to_json
from ros_bridge.display.draw import draw, empty
from ros_bridge.display.picture import HealthLine, Picture
from ros_bridge.display.scene import DisplayScene

__all__ = ["DisplayServer", "LiveSource", "Recording", "bind_socket", "run_server"]

_FILES = {
    "/": ("ros_bridge.display", "page/index.html", "text/html"),
    "/display.js": ("ros_bridge.display", "page/display.js", "text/javascript"),
    "/display.css": ("ros_bridge.display", "page/display.css", "text/css"),
    "/airmap.js": ("commands", "airmap.js", "text/javascript"),
}
_MOST_CLIENTS = 32
_QUEUE = 2  # pictures that wait for a client
_LARGEST = 1_024  # bytes of a client's message
_SHORTEST, _LONGEST = 0.05, 0.5  # s from one picture to the next: after a change; without one
_AGAIN = 10.0  # s between two lines that say the same of clients
_RUN_OUT = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
_REFUSED = 1008  # close code: policy violation


class Recording(Protocol):
    """What can be looked at again."""

    name: str
    length: float  # s
    marks: list[tuple[float, int]]  # when the highest alert level changes, s, and to what

    def player(self) -> Callable[[float], Picture]:
        """Return what gives the picture of a time, s from the beginning; best asked forwards."""
        ...


class LiveSource:
    """The scene of a live source, which may be fed from any thread.

    Args:
        clock: the source's time, ns.
        centre: of the map where the ownship is unknown, degrees.
        separation: that is kept from others, m; None: as the source says.
    """

    def __init__(
        self,
        clock: Callable[[], int] = time.time_ns,
        centre: tuple[float, float] | None = None,
        separation: float | None = None,
    ) -> None:
        self.scene = DisplayScene(separation=separation)
        self.clock = clock
        self._centre = centre
        self._loop: asyncio.AbstractEventLoop | None = None
        self._changed = asyncio.Event()
        self._failures = Failures(_ignore)

    def begin(self, say: Callable[[str], object]) -> None:
        """Take what is fed from now on into the running event loop; ``say`` takes a sentence."""
        self._loop = asyncio.get_running_loop()
        self._failures = Failures(say)

    def feed(self, change: Callable[[DisplayScene], DisplayScene]) -> None:
        """Change the scene by a pure function; before the server runs, at once."""
        if self._loop is None:
            self._change(change)
        elif not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._change, change)

    def _change(self, change: Callable[[DisplayScene], DisplayScene]) -> None:
        self._replace_by("what was received", change)
        self._changed.set()

    def _replace_by(self, name: str, change: Callable[[DisplayScene], DisplayScene]) -> None:
        """Replace the scene; where that fails, the one before stays, and grows old."""

        def attempt() -> None:
            self.scene = change(self.scene)

        self._failures.attempt(name, attempt)

    async def wait(self) -> None:
        """Wait for the next change, at most so often and at least so rarely."""
        await asyncio.sleep(_SHORTEST)
        try:
            async with asyncio.timeout(_LONGEST - _SHORTEST):
                await self._changed.wait()
        except TimeoutError:
            pass
        self._changed.clear()
        self._replace_by("the time", lambda scene: scene.at(self.clock()))

    def text(self, number: int) -> str:
        """Return the picture of now as it is sent. An error of our own is told in it; where there
        is no picture for it, without a map.
        """
        try:
            picture_text = self._text(draw(self.scene, self.clock(), self._centre), number)
        except Exception as error:
            self._failures.note("the picture", error)
            return self._text(empty(DisplayScene(), self.clock()), number)
        self._failures.clear("the picture")
        return picture_text

    def _text(self, picture: Picture, number: int) -> str:
        return _text(to_json(self._tell_failures(picture)) | {"number": number})

    def _tell_failures(self, picture: Picture) -> Picture:
        failure_lines = [HealthLine("display", 2, text, None) for text in self._failures.problems()]
        return replace(picture, health=[*failure_lines, *picture.health])


def _ignore(_: str) -> None:
    """Say nothing: nobody listens yet."""


class _Client:
    """A connection and the pictures that wait for it."""

    def __init__(self, connection: ServerConnection) -> None:
        self.connection = connection
        self.dropped = 0
        self._waiting: deque[str] = deque()
        self._some = asyncio.Event()

    def offer(self, text: str) -> None:
        """Let a picture wait; the oldest goes where too many do."""
        if len(self._waiting) == _QUEUE:
            self._waiting.popleft()
            self.dropped += 1
        self._waiting.append(text)
        self._some.set()

    async def send_all(self) -> None:
        """Send pictures until the connection is closed."""
        while True:
            await self._some.wait()
            self._some.clear()
            while self._waiting:
                await self.connection.send(self._waiting.popleft())


class DisplayServer:
    """Serves one source to its clients."""

    def __init__(
        self, source: LiveSource | Recording, name: str, say: Callable[[str], None]
    ) -> None:
        self.connections = Connections()
        self._source, self._name, self._say = source, name, say
        self._clients: set[_Client] = set()
        self._dropped = 0

    async def serve(self, listener: socket.socket, on_begin: Callable[[], object]) -> None:
        """Serve the source at a bound socket, and begin what feeds it, until cancelled;
        ``on_begin`` is called once clients are waited for.
        """
        async with asyncio.TaskGroup() as group:
            if isinstance(self._source, LiveSource):
                self._source.begin(self._say)
                group.create_task(self.broadcast())
            group.create_task(run_server(self, listener, self._say))
            on_begin()

    async def broadcast(self) -> None:
        """Send pictures of a live source until cancelled."""
        assert isinstance(self._source, LiveSource)
        for number in itertools.count():
            await self._source.wait()
            if self._clients:
                text = self._source.text(number)
                for client in self._clients:
                    client.offer(text)

    async def handle(self, connection: ServerConnection) -> None:
        """Serve one client until it leaves."""
        self.connections.end(connection)  # it is a client now
        client = _Client(connection)
        self._clients.add(client)
        try:
            await connection.send(_text(self._hello()))
            if isinstance(self._source, LiveSource):
                await self._live(client)
            else:
                await self._replay(client, self._source)
        except ConnectionClosed as ended:
            received = ended.rcvd
            if received is None and ended.sent is not None and ended.sent.code != _REFUSED:
                reason = ended.sent.reason or "no answer"
                self._say(f"{_peer(connection)} was disconnected: {reason}")
        finally:
            self._clients.discard(client)
            self._dropped += client.dropped

    def missed_pictures(self) -> int:
        """Return how many pictures clients were too slow for."""
        return self._dropped + sum(client.dropped for client in self._clients)

    def full(self) -> bool:
        """Return whether no client more is taken."""
        return len(self._clients) >= _MOST_CLIENTS

    def _hello(self) -> Document:
        live = isinstance(self._source, LiveSource)
        hello: Document = {"type": "hello", "version": VERSION, "source": self._name, "live": live}
        if not isinstance(self._source, LiveSource):
            hello |= {"length": self._source.length, "marks": self._source.marks}
        return hello

    async def _live(self, client: _Client) -> None:
        sending = asyncio.create_task(client.send_all())
        try:
            async for message in client.connection:
                await self._refuse(client.connection, message, "nothing: this display is read only")
                return
        finally:
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)

    async def _replay(self, client: _Client, recording: Recording) -> None:
        player = recording.player()
        async for message in client.connection:
            moment = _time_of(message)
            if moment is None:
                await self._refuse(client.connection, message, 'a time, such as {"time": 12.5}')
                return
            moment = min(max(moment, 0.0), recording.length)
            document = to_json(player(moment))
            await client.connection.send(_text(document | {"at": round(moment, 3)}))

    async def _refuse(self, connection: ServerConnection, message: Any, expected: str) -> None:
        self._say(f"{_peer(connection)} sent {message!r:.60}, expected {expected}; disconnected")
        await connection.close(_REFUSED, f"expected {expected}")


@contextmanager
def _quiet(say: Callable[[str], None]) -> Generator[logging.Logger]:
    """Yield a logger that says in a line what the library would log with a traceback."""
    logger = logging.getLogger("ros_bridge.display.server")
    logger.propagate, handler = False, _OneLine(say)
    logger.setLevel(logging.INFO)
    logger.addHandler(handler)
    try:
        yield logger
    finally:
        logger.removeHandler(handler)


class _OneLine(logging.Handler):
    def __init__(self, say: Callable[[str], None]) -> None:
        super().__init__()
        self._say = say
        self._said: dict[str, float] = {}  # when a line was said last, s

    def emit(self, record: logging.LogRecord) -> None:
        """Say what went wrong; what is usual, such as that a file was sent, is not said."""
        status = record.args[0] if isinstance(record.args, tuple) and record.args else 0
        refused = isinstance(status, int) and status >= HTTPStatus.BAD_REQUEST
        if record.levelno < logging.WARNING and not refused:
            return
        problem = record.exc_info[1] if record.exc_info else None
        root = problem
        while root is not None and root.__cause__ is not None:
            root = root.__cause__
        cause = "" if root is None else f": {str(root) or type(root).__name__}"
        text, moment = f"a client: {record.getMessage()}{cause}", time.monotonic()
        self._said = {
            said_text: said_at
            for said_text, said_at in self._said.items()
            if moment - said_at < _AGAIN
        }
        if text not in self._said:
            self._said[text] = moment
            self._say(text)


def bind_socket(host: str, port: int) -> socket.socket:
    """Return a socket that is bound to an address, or raise OSError; port 0 takes a free one."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        listener.listen()
    except OSError:
        listener.close()
        raise
    return listener


async def run_server(
    display: DisplayServer, listener: socket.socket, say: Callable[[str], None]
) -> None:
    """Serve at a bound socket until cancelled; ``say`` is told about clients, a sentence."""

    def answer(connection: ServerConnection, request: Request) -> Response | None:
        return _answer(display, request)

    with _quiet(say) as logger:
        server = await serve(
            display.handle,
            sock=listener,
            process_request=answer,
            compression=None,
            max_size=_LARGEST,
            max_queue=4,
            open_timeout=5.0,
            close_timeout=2.0,
            server_header=None,
            logger=logger,
            create_connection=cast("type[ServerConnection]", display.connections.make),
        )
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(partial(_handle_exception, logger))
        try:
            await server.serve_forever()
        finally:
            server.close()
            await server.wait_closed()


def _handle_exception(
    logger: logging.Logger, loop: asyncio.AbstractEventLoop, context: dict[str, Any]
) -> None:
    """Say in a line that no connection can be taken, as where files have run out; the loop tries
    again after a second. Anything else is reported as it is by default.
    """
    problem = context.get("exception")
    if isinstance(problem, OSError) and problem.errno in _RUN_OUT:
        logger.warning("no connection can be taken", exc_info=problem)
    else:
        loop.default_exception_handler(context)


def _answer(display: DisplayServer, request: Request) -> Response | None:
    """Return a file or a refusal; None where the WebSocket may be opened."""
    try:
        host = request.headers.get("Host", "")
        origin = request.headers.get("Origin")
        asks_socket = "upgrade" in request.headers.get("Connection", "").lower()
    except LookupError:
        return _refusal(HTTPStatus.BAD_REQUEST, "a header stands twice, expected it once")
    if not _ours(host):
        return _refusal(
            HTTPStatus.FORBIDDEN, "the Host is another one's; expected this one's address or name"
        )
    path = request.path.partition("?")[0]
    if asks_socket:
        return _socket_refusal(display, path, host, origin)
    if path not in _FILES:
        return _refusal(HTTPStatus.NOT_FOUND, "there is no such file")
    return _file_response(path, host)


def _socket_refusal(
    display: DisplayServer, path: str, host: str, origin: str | None
) -> Response | None:
    """Return why a WebSocket may not be opened; None: it may."""
    if path != "/pictures":
        return _refusal(HTTPStatus.NOT_FOUND, "there is no such WebSocket; expected /pictures")
    if origin is not None and urlsplit(origin).netloc != host:
        return _refusal(HTTPStatus.FORBIDDEN, "another page may not open this WebSocket")
    if display.full():
        problem = f"{_MOST_CLIENTS} clients are there already"
        return _refusal(HTTPStatus.SERVICE_UNAVAILABLE, problem)
    return None


def _file_response(path: str, host: str) -> Response:
    """Return one of our files, for a page that may load nothing of others."""
    content, kind = _file(path)
    headers = Headers(
        {
            "Content-Type": f"{kind}; charset=utf-8",
            "Content-Length": str(len(content)),
            "Content-Security-Policy": (
                "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
                f"connect-src 'self' ws://{host}; base-uri 'none'; form-action 'none'; "
                "frame-ancestors 'none'"
            ),
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Cache-Control": "no-store",
            "Connection": "close",
        }
    )
    return Response(200, "OK", headers, content)


def _refusal(status: HTTPStatus, sentence: str) -> Response:
    body = f"{sentence}\n".encode()
    headers = Headers(
        {
            "Content-Type": "text/plain; charset=utf-8",
            "Content-Length": str(len(body)),
            "Connection": "close",
        }
    )
    return Response(status.value, status.phrase, headers, body)


def _ours(host: str) -> bool:
    """Return whether a Host header names this machine: by an address, which no page can forge, or
    by its own name.
    """
    try:
        name = urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return False
    try:
        ipaddress.ip_address(name)
    except ValueError:
        own_name = socket.gethostname().lower()
        return name in ("localhost", own_name, f"{own_name}.local")
    return True


@cache
def _file(path: str) -> tuple[bytes, str]:
    package, name, kind = _FILES[path]
    return (files(package) / name).read_bytes(), kind


def _time_of(message: Any) -> float | None:
    """Return the time that a client asks for, s; None where it asks for something else."""
    try:
        request = parse_json(message)
        value = request["time"] if set(request) == {"time"} else None
    except (ValueError, TypeError, KeyError, RecursionError):
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def _text(document: Document) -> str:
    return json.dumps(document, separators=(",", ":"), allow_nan=False)


def _peer(connection: ServerConnection) -> str:
    address = connection.remote_address
    return f"{address[0]}:{address[1]}" if address else "a client"
