"""A link to an autopilot that can be cut, go deaf, or lose messages."""

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial

Keep = Callable[[int], bool]
"""Whether a message passes, by its number."""


class Relay:
    """Passes on what comes over TCP, both ways, to one client.

    Args:
        port: of the autopilot on this host.
        keep: asked for every message; None: all pass.
    """

    def __init__(self, port: int, keep: Keep | None = None) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"tcp:127.0.0.1:{self._listener.getsockname()[1]}"
        self._port, self._keep = port, keep
        self._ends: list[socket.socket] = []
        self._lost: tuple[socket.socket, ...] = ()  # ends of which nothing passes
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        with suppress(OSError):
            ours, _ = self._listener.accept()
            theirs = socket.create_connection(("127.0.0.1", self._port))
            self._ends = [ours, theirs]
            for a, b in ((ours, theirs), (theirs, ours)):
                b.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                threading.Thread(target=self._copy, args=(a, b), daemon=True).start()

    def _copy(self, a: socket.socket, b: socket.socket) -> None:
        waiting = b""
        with suppress(OSError):
            for data in iter(partial(a.recv, 65_536), b""):
                if a in self._lost:
                    continue
                if self._keep is None:
                    b.sendall(data)
                    continue
                messages = list(frames(waiting + data))
                passed = [frame for number, frame in messages if number < 0 or self._keep(number)]
                waiting = (waiting + data)[sum(len(frame) for _, frame in messages) :]
                b.sendall(b"".join(passed))

    def lose(self, *, to_program: bool, to_autopilot: bool) -> None:
        """Lose from now on what is sent to the program, to the autopilot, or both."""
        ours, theirs = self._ends
        self._lost = (theirs,) * to_program + (ours,) * to_autopilot

    def mend(self) -> None:
        """Let everything pass again."""
        self._lost = ()

    def cut(self) -> None:
        """Cut it, for good."""
        self._listener.close()
        for end in self._ends:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()


def frames(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the whole messages of both versions that data begins with, each with its number; -1
    for a byte that begins none.
    """
    at = 0
    while at < len(data):
        version = data[at]
        if version not in (0xFD, 0xFE):
            yield -1, data[at : at + 1]
            at += 1
            continue
        head = 10 if version == 0xFD else 6
        if len(data) < at + head:
            return
        signed = 13 if version == 0xFD and data[at + 2] & 1 else 0
        end = at + head + data[at + 1] + 2 + signed
        if len(data) < end:
            return
        identifier = data[at + 7 : at + 10] if version == 0xFD else data[at + 5 : at + 6]
        yield int.from_bytes(identifier, "little"), data[at:end]
        at = end
