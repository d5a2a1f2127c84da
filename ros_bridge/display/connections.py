"""The connections that a server holds, so that idle ones keep nobody out and run no files out."""

import asyncio
from typing import Any

from websockets.asyncio.server import ServerConnection

_MOST = 32  # that have not opened a WebSocket yet


class Connections:
    """Those that have not opened a WebSocket yet: of too many the oldest is cut off."""

    def __init__(self) -> None:
        self._idle: dict[ServerConnection, asyncio.BaseTransport] = {}

    def make(self, *positional: Any, **named: Any) -> ServerConnection:
        """Return a new connection, as websockets makes it."""
        return _Connection(self, *positional, **named)

    def begin(self, connection: ServerConnection, transport: asyncio.BaseTransport) -> None:
        """Hold a connection that has just been made."""
        self._idle[connection] = transport
        if len(self._idle) > _MOST:
            oldest = self._idle.pop(next(iter(self._idle)))
            oldest.close()

    def end(self, connection: ServerConnection) -> None:
        """Let go of a connection that has opened its WebSocket, or is lost."""
        self._idle.pop(connection, None)


class _Connection(ServerConnection):
    """A connection that says when it begins and ends."""

    def __init__(self, connections: Connections, *positional: Any, **named: Any) -> None:
        super().__init__(*positional, **named)
        self._connections = connections

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take over what carries it."""
        super().connection_made(transport)
        self._connections.begin(self, transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """Take note that it has ended."""
        self._connections.end(self)
        super().connection_lost(exc)
