"""The display's server beside clients that say nothing, and where files have run out."""

import errno
import gc
import os
import resource
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from urllib.request import urlopen

import pytest

pytest.importorskip("websockets", reason="websockets is not installed")

from ros_bridge.display.server import LiveSource
from tests.ros_bridge.displays import serving


def eventually(holds: Callable[[], bool], patience: float = 20.0) -> None:
    end = time.monotonic() + patience
    while not holds():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.02)


def is_closed(connection: socket.socket) -> bool:
    try:
        return connection.recv(1) == b""
    except BlockingIOError:
        return False
    except ConnectionResetError:
        return True


def test_idle_connections_keep_nobody_out() -> None:
    """Of those that say nothing the oldest are cut off."""
    with serving(LiveSource()) as server, ExitStack() as stack:
        idle = [
            stack.enter_context(socket.create_connection(("127.0.0.1", server.port)))
            for _ in range(60)
        ]
        for connection in idle:
            connection.setblocking(False)
        eventually(lambda: all(map(is_closed, idle[:28])))
        assert not any(map(is_closed, idle[40:]))
        with urlopen(server.url, timeout=5.0) as answer:
            assert answer.status == 200


@contextmanager
def no_more_files() -> Iterator[None]:
    """Let no file be opened any more, for a while."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    gc.collect()  # what waits for it would be closed meanwhile, and leave room
    descriptors = [os.open(os.devnull, os.O_RDONLY)]
    resource.setrlimit(resource.RLIMIT_NOFILE, (descriptors[0], before[1]))
    try:
        with pytest.raises(OSError, match="Too many open files"):
            while True:
                descriptors.append(os.open(os.devnull, os.O_RDONLY))
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
        for number in descriptors:
            os.close(number)


@pytest.mark.slow
def test_where_files_have_run_out_one_line_says_so_and_it_goes_on(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with ExitStack() as stack:
        server = stack.enter_context(serving(LiveSource()))
        with urlopen(server.url, timeout=5.0) as answer:
            answer.read()
        clients = [stack.enter_context(socket.socket()) for _ in range(3)]
        with no_more_files():
            for client in clients:
                client.settimeout(20.0)
                client.connect(("127.0.0.1", server.port))
            eventually(lambda: bool(server.said))
            time.sleep(1.5)  # it has tried again
        for client in clients:
            client.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
            assert client.recv(15) == b"HTTP/1.1 200 OK"
        lines = [line for line in server.said if "no connection can be taken" in line]
        assert 1 <= len(lines) <= 3, server.said  # again after 10 s
        assert str(errno.EMFILE) in lines[0]
    assert "Traceback" not in "".join(capfd.readouterr())
