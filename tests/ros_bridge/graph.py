"""A real graph for tests: nodes in processes of their own or in this one, a client, DDS on
loopback, a domain apart.
"""

import contextlib
import gc
import math
import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import pytest

MISSING = "ROS 2 and rlcas_msgs are not installed; to have them: make ros"
pytest.importorskip("rclpy", reason=MISSING)
pytest.importorskip("rlcas_msgs", reason=MISSING)

# The parser of interfaces brings a library that imports a deprecated module of Python's, when the
# first node is made.
with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)
    import rosidl_generator_py  # noqa: F401

import rclpy  # noqa: E402
from rclpy.context import Context  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rlcas_msgs.msg import (  # noqa: E402
    AircraftState,
    GeoReference,
    TrafficAlert,
    TrafficArray,
    Trajectory,
    Waypoint,
)

from ros_bridge.transport import qos  # noqa: E402
from ros_bridge.transport.children import FLAG, free_domain  # noqa: E402
from ros_bridge.transport.messages import time_message  # noqa: E402
from tests.ros_bridge.scenes import FRAME  # noqa: E402
from tests.ros_bridge.scenes import aircraft as plain_aircraft  # noqa: E402
from tests.ros_bridge.scenes import route_points as plain_points  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent.parent
PATIENCE = 60.0  # s; discovery alone may take 3 s, and a busy machine takes longer
AGAIN = 4.0  # s
NODE = "/rlcas_runner"


@contextlib.contextmanager
def domain() -> Generator[int]:
    """Reserve a domain id until the block ends; what still runs on it is killed: the next to have
    it would hear it.
    """
    # Nodes of earlier tests in this process hold ports until they are collected.
    gc.collect()
    with free_domain() as number:
        try:
            yield number
        finally:
            for process in Process.started.pop(number, []):
                process.kill()


class Process:
    """A node in a process of its own, which ends with its domain at the latest, and a node of ours
    with this process, however that ends.
    """

    started: ClassVar[dict[int, list["Process"]]] = {}

    def __init__(self, module: str, number: int, *arguments: str) -> None:
        environment = os.environ | {
            "ROS_DOMAIN_ID": str(number),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        flags = [FLAG] if module.startswith("ros_bridge.") else []
        reading, self._held = os.pipe()  # not one of Popen's, which `stop` would close too early
        self.popen = subprocess.Popen(
            [sys.executable, "-m", module, *flags, *arguments],
            cwd=ROOT,
            env=environment,
            stdin=reading,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        os.close(reading)
        Process.started.setdefault(number, []).append(self)

    def kill(self) -> None:
        """End it, if it has not ended."""
        self.popen.kill()
        with self.popen:  # closes its pipe, and waits
            pass
        os.close(self._held)

    def stop(self, signal_sent: signal.Signals = signal.SIGINT) -> tuple[int, str]:
        """Return exit code and output."""
        if self.popen.poll() is None:
            self.popen.send_signal(signal_sent)
        output, _ = self.popen.communicate(timeout=PATIENCE)
        return self.popen.returncode, output


class Client:
    """Whatever talks to the node under test."""

    def __init__(self, number: int) -> None:
        self.context = Context()
        rclpy.init(context=self.context, domain_id=number, args=[])
        self.node = Node("client", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self._publishers: dict[str, Any] = {}

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)

    def now(self) -> int:
        return self.node.get_clock().now().nanoseconds

    def spin(self, until: Callable[[], Any], patience: float = PATIENCE) -> Any:
        """Spin until something is true and return it; fail when patience ends."""
        end = time.monotonic() + patience
        while not (result := until()):
            assert time.monotonic() < end, "nothing came in time"
            self.executor.spin_once(timeout_sec=0.02)
        return result

    def idle(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)

    def say(self, kind: type, topic: str, message: Any, quality: Any) -> None:
        """Publish once somebody listens."""
        if topic not in self._publishers:
            self._publishers[topic] = self.node.create_publisher(kind, topic, quality)
        publisher = self._publishers[topic]
        self.spin(lambda: publisher.get_subscription_count() > 0)
        publisher.publish(message)

    def hear(self, kind: type, topic: str, quality: Any) -> list[Any]:
        """Return a list that grows with what is heard."""
        messages: list[Any] = []
        self.node.create_subscription(kind, topic, messages.append, quality)
        return messages

    def hear_traffic(self) -> list[AircraftState]:
        """Return a list that grows with the states of all arrays of traffic."""
        states: list[AircraftState] = []
        topic = f"{NODE}/input/traffic_array"
        self.node.create_subscription(
            TrafficArray, topic, lambda message: states.extend(message.states), qos.TRAFFIC_ARRAY
        )
        return states

    def call(self, kind: type, service: str, request: Any, once: bool = False) -> Any:
        """Return the answer of a service, asked again after a while without one unless it is to be
        asked once.

        A server that has not found its client yet has nowhere to send its answer to.
        """
        client = self.node.create_client(kind, service)
        futures: list[Any] = []
        last = -math.inf

        def poll_once() -> Any:
            nonlocal last
            if time.monotonic() - last > AGAIN and not (once and futures):
                futures.append(client.call_async(request))
                last = time.monotonic()
            return next((future for future in futures if future.done()), None)

        try:
            self.spin(client.service_is_ready)
            return self.spin(poll_once).result()
        finally:
            self.node.destroy_client(client)


@contextlib.contextmanager
def running_beside(kind: Any, **values: Any) -> Iterator[tuple[Any, Client]]:
    """Run a node beside a client, in one executor."""
    with domain() as number:
        client = Client(number)
        overrides = [Parameter(name, value=value) for name, value in values.items()]
        try:
            node = kind(context=client.context, parameter_overrides=overrides)
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


def as_message(kind: type, plain: SimpleNamespace) -> Any:
    """Return a message with the fields of a plain object."""
    message = kind()
    for name, value in vars(plain).items():
        if isinstance(value, SimpleNamespace):
            for inner, part in vars(value).items():
                if isinstance(part, SimpleNamespace):
                    for last, leaf in vars(part).items():
                        setattr(getattr(getattr(message, name), inner), last, leaf)
                else:
                    setattr(getattr(message, name), inner, part)
        else:
            setattr(message, name, value)
    return message


def aircraft(
    time: int, x: float, y: float, heading: float, speed: float, **changes: Any
) -> AircraftState:
    return as_message(AircraftState, plain_aircraft(x, y, heading, speed, time=time, **changes))


def route(**fields: Any) -> Trajectory:
    points = [as_message(Waypoint, point) for point in plain_points(**fields)]
    return Trajectory(status=Trajectory.STATUS_ROUTE, waypoints=points)


def reference(time: int, **fields: Any) -> GeoReference:
    message = GeoReference(latitude=FRAME.latitude, longitude=FRAME.longitude, **fields)
    message.header.stamp = time_message(time)
    return message


def alert(time: int, *ids: str, level: int = TrafficAlert.LEVEL_CORRECTIVE) -> TrafficAlert:
    message = TrafficAlert(level=level, intruder_ids=list(ids))
    message.header.stamp = time_message(time)
    return message


class World:
    """A runner with everything it needs, and its inputs. An aircraft that is reported again has
    flown on meanwhile.
    """

    def __init__(self, client: Client, node: str = NODE) -> None:
        self.client, self.node = client, node
        self._since: dict[str, tuple[Any, int]] = {}

    def _state(
        self, x: float, y: float, heading: float, speed: float, climb: float = 0.0, **more: Any
    ) -> AircraftState:
        time, name = more.pop("time", None) or self.client.now(), more.get("id", "4b1a2c")
        start = x, y, heading, speed
        previous, since = self._since.get(name, (None, time))
        if previous != start:
            self._since[name] = start, (since := time)
        way = speed * (time - since) / 1e9
        message = aircraft(
            time, x + way * math.cos(heading), y + way * math.sin(heading), heading, speed, **more
        )
        message.altitude += climb * (time - since) / 1e9
        message.velocity.z = climb
        return message

    def ownship(
        self, x: float = 0.0, y: float = 0.0, heading: float = 0.0, speed: float = 75.0, **more: Any
    ) -> None:
        message = self._state(x, y, heading, speed, **({"id": "own"} | more))
        self.client.say(AircraftState, f"{self.node}/input/ownship", message, qos.SENSOR)

    def intruder(
        self, x: float, y: float, heading: float, speed: float = 75.0, **more: Any
    ) -> None:
        message = self._state(x, y, heading, speed, **more)
        self.client.say(AircraftState, f"{self.node}/input/traffic", message, qos.TRAFFIC)

    def begin_anew(self) -> list[str]:
        """Let every aircraft begin where it is reported next; return the names of the others."""
        intruders = [name for name in self._since if name != "own"]
        self._since.clear()
        return intruders

    def alert(self, *ids: str, **more: Any) -> None:
        message = alert(more.pop("time", None) or self.client.now(), *ids, **more)
        self.client.say(TrafficAlert, f"{self.node}/input/alerts", message, qos.EVENTS)

    def route(self, message: Trajectory | None = None, **more: Any) -> None:
        self.client.say(
            Trajectory, f"{self.node}/input/route", message or route(**more), qos.LATCHED
        )

    def reference(self, **more: Any) -> None:
        message = reference(self.client.now(), **more)
        self.client.say(GeoReference, f"{self.node}/input/geo_reference", message, qos.LATCHED)
