"""Nodes in this process, for tests that look inside them; a context and a domain of their own."""

import contextlib
from collections.abc import Iterator
from typing import Any

import pytest

from tests.ros_bridge.graph import MISSING, PATIENCE, Client, domain

pytest.importorskip("rclpy", reason=MISSING)

from rclpy.parameter import Parameter


@contextlib.contextmanager
def beside(kind: Any, **values: Any) -> Iterator[tuple[Any, Client]]:
    """Run a node beside a client, in one executor."""
    with domain() as number:
        client = Client(number)
        given = [Parameter(name, value=value) for name, value in values.items()]
        try:
            node = kind(context=client.context, parameter_overrides=given)
            client.executor.add_node(node)
            try:
                yield node, client
            finally:
                client.executor.remove_node(node)
                node.destroy_node()
        finally:
            client.close()


def eventually(client: Client, future: Any) -> Any:
    """Return what a call brings."""
    client.spin(future.done, PATIENCE)
    return future.result()
