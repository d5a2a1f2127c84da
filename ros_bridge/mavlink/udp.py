"""A UDP port that listens: everybody is read, and nobody but the autopilot's side is answered.

pymavlink's own one sends all that it sends to whoever has sent it a byte, for ever, and reads what
different senders send as one stream, so that a stranger's half a message swallows the autopilot's.
"""

import select
import socket
import time
from collections import OrderedDict, deque
from typing import Any

SILENT = 5.0
"""For how long the autopilot's side must have been silent before it may have another address, s."""

_LARGEST = 65_535  # bytes of a datagram
_SENDERS = 32  # whose halves of messages are remembered

Address = tuple[str, int]


class Listener:
    """A port on which messages arrive, with the part of pymavlink's connections that is used.

    Attributes:
        mav: packs and sends messages to who is answered.
        clients: who is answered; empty until :meth:`answer`, and one at most.
        sender: of the message that was returned last.

    Args:
        address: host and port that are listened at.
        dialect: pymavlink's, as a module.
        system: our own number; with ``component``.
    """

    def __init__(self, address: Address, dialect: Any, system: int, component: int) -> None:
        self.port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self.port.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self.port.bind(address)
        except OSError:
            self.port.close()
            raise
        self.port.setblocking(False)
        self.mav = dialect.MAVLink(self, srcSystem=system, srcComponent=component)
        self.clients: set[Address] = set()
        self.sender: Address | None = None
        self._dialect = dialect
        self._parsers: OrderedDict[Address, Any] = OrderedDict()
        self._waiting: deque[tuple[Any, Address]] = deque()
        self._heard = 0.0  # when who is answered sent last, s

    def answer(self) -> bool:
        """Note that the message that was returned last is the autopilot's, and answer its sender
        from now on; return False, and change nothing, where another sender of such messages is
        answered and has not been silent.
        """
        moment = time.monotonic()
        assert self.sender is not None
        if self.sender not in self.clients:
            if self.clients and moment - self._heard <= SILENT:
                return False
            self.clients = {self.sender}
        self._heard = moment
        return True

    def write(self, data: bytes) -> None:
        """Send to who is answered; what cannot be sent is lost, as on any link."""
        for address in self.clients:
            self.port.sendto(data, address)

    def recv_match(self, *, blocking: bool = False, timeout: float = 0.0) -> Any:
        """Return the next message, waiting for it so long, s, if at all; None: none has come."""
        until = time.monotonic() + timeout
        while not self._waiting:
            remaining = until - time.monotonic() if blocking else 0.0
            if not select.select([self.port], [], [], max(remaining, 0.0))[0]:
                return None
            self._read()
        message, self.sender = self._waiting.popleft()
        return message

    def _read(self) -> None:
        try:
            data, sender = self.port.recvfrom(_LARGEST)
        except (BlockingIOError, ConnectionRefusedError):  # the latter: nobody is there to answer
            return
        messages = self._parser(sender).parse_buffer(data) or ()
        self._waiting.extend((message, sender) for message in messages)

    def _parser(self, sender: Address) -> Any:
        """Return what puts a sender's datagrams together; of many the latest are remembered, and
        always that of who is answered.
        """
        parser = self._parsers.pop(sender, None)
        if parser is None:
            parser = self._dialect.MAVLink(None)
            parser.robust_parsing = True
        self._parsers[sender] = parser
        if len(self._parsers) > _SENDERS:
            del self._parsers[
                next(address for address in self._parsers if address not in self.clients)
            ]
        return parser

    def close(self) -> None:
        """Close the port."""
        self.port.close()
