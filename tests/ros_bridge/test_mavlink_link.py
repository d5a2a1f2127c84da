"""The MAVLink program's link: whose messages count, who is answered, and a clock that begins anew.

Over real sockets, with pymavlink's own messages.
"""

import argparse
import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, ClassVar

import pytest

pytest.importorskip("pymavlink", reason="the extra mavlink is not installed")
pytest.importorskip("websockets", reason="websockets is not installed")

from pymavlink.dialects.v20 import ardupilotmega as dialect

from ros_bridge.core.fields import SECOND
from ros_bridge.core.nearest import MOST
from ros_bridge.display.scene import DisplayScene
from ros_bridge.mavlink import looking
from ros_bridge.mavlink.adapter import SceneAdapter
from ros_bridge.mavlink.intake import Reading, Received, take
from ros_bridge.mavlink.link import COMPONENT, Link
from ros_bridge.mavlink.messages import Mode
from ros_bridge.mavlink.options import options_of
from ros_bridge.mavlink.program import Program
from ros_bridge.mavlink.state import RECOVERED
from ros_bridge.mavlink.udp import SILENT
from tests.ros_bridge.displays import page_document
from tests.ros_bridge.test_mavlink import PARAMETERS


def test_of_ever_new_addresses_the_nearest_are_kept_and_the_others_counted() -> None:
    names = 2 * MOST
    received = take(Received(), position(600.0), 600 * SECOND, Reading({}))
    for number in range(1, names + 1):
        north = 0.01 if number == 1 else 1.0  # degrees
        message = dialect.MAVLink_adsb_vehicle_message(
            number, round(1e7 * (47.4 + north)), 85_000_000, 1, 0, 0, 2_000, 0, b"", 1, 0, 15, 0
        )
        received = take(received, message, 600 * SECOND, Reading({}))
    traffic_kept = received.situation.traffic
    assert "000001" in traffic_kept
    assert MOST <= len(traffic_kept) <= 1.25 * MOST
    assert sum(received.left_out.values()) == names - len(traffic_kept)


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free_socket:
        free_socket.bind(("127.0.0.1", 0))
        return free_socket.getsockname()[1]


@pytest.fixture(autouse=True)
def hang_up() -> Iterator[None]:
    """Close the ports of all senders of a test."""
    yield
    while Sender.all:
        Sender.all.pop().socket.close()


class Sender:
    """Somebody at a port of their own, under a system and component."""

    all: ClassVar[list["Sender"]] = []

    def __init__(self, port: int, system: int = 1, component: int = 1) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.all.append(self)
        self.socket.connect(("127.0.0.1", port))
        self.socket.setblocking(False)
        self._packer = dialect.MAVLink(None, system, component)
        self._reader = dialect.MAVLink(None)

    def send(self, *messages: Any) -> None:
        for message in messages:
            self.socket.send(message.pack(self._packer))

    def heard(self) -> list[Any]:
        """Return what has come since the last time."""
        messages: list[Any] = []
        while True:
            try:
                messages += self._reader.parse_buffer(self.socket.recv(4_096)) or ()
            except BlockingIOError:
                return messages


def heartbeat(mode: int = Mode.AUTO) -> Any:
    return dialect.MAVLink_heartbeat_message(1, 3, 0x80, mode, 4, 3)


def position(seconds: float) -> Any:
    boot = round(1e3 * seconds)
    return dialect.MAVLink_global_position_int_message(
        boot, 474_000_000, 85_000_000, 600_000, 100_000, 2_000, 0, 0, 0
    )


def receive(link: Link) -> list[Any]:
    return [message for message, _ in link.receive(time.monotonic() + 0.1)]


@pytest.fixture
def beside() -> Iterator[tuple[Link, Sender, Callable[..., Sender]]]:
    """Yield a link that has found its autopilot, the autopilot, and who makes others."""
    port = free_port()
    link = Link(f"udp:127.0.0.1:{port}", system=245)
    autopilot = Sender(port)
    autopilot.send(heartbeat())
    link.find(5.0)
    with closing(link):
        yield link, autopilot, lambda *numbers: Sender(port, *numbers)


def test_nobody_is_answered_but_who_sent_the_autopilots_messages(beside: Any) -> None:
    link, autopilot, sender_of = beside
    strangers = [sender_of(), sender_of(7, 1), *(sender_of(1, 1) for _ in range(200))]
    for item in strangers[:1] + strangers[2:]:
        item.socket.send(b"x")
    strangers[1].send(heartbeat())
    receive(link)
    autopilot.heard()
    link.set_mode(Mode.GUIDED)
    assert [item.get_type() for item in autopilot.heard()] == ["COMMAND_LONG"]
    assert [item.heard() for item in strangers] == [[] for _ in strangers]
    assert len(link._connection.clients) == 1


def test_before_an_autopilot_is_heard_nobody_is_answered() -> None:
    port = free_port()
    with closing(Link(f"udp:127.0.0.1:{port}")) as link:
        stranger = Sender(port, 7, 1)
        stranger.socket.send(b"x")
        receive(link)
        link.beat()
        assert stranger.heard() == []


def test_half_a_message_of_a_stranger_swallows_none_of_the_autopilots(beside: Any) -> None:
    link, autopilot, sender_of = beside
    sender_of().socket.send(bytes([0xFD, 0xFF]) + bytes(100))
    autopilot.send(position(600.0))
    assert [message.get_type() for message in receive(link)] == ["GLOBAL_POSITION_INT"]


def test_who_takes_the_autopilots_numbers_is_not_listened_to_until_it_is_silent(
    beside: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    link, autopilot, sender_of = beside
    liar = sender_of(1, 1)
    liar.send(position(9.0))
    assert receive(link) == []
    assert link.foreign == 1
    # After a silence it may have another address, as where a router is started again.
    clock = time.monotonic
    monkeypatch.setattr("ros_bridge.mavlink.udp.time.monotonic", lambda: clock() + SILENT + 1.0)
    liar.send(heartbeat())
    assert [message.get_type() for message in receive(link)] == ["HEARTBEAT"]
    link.beat()
    assert len(liar.heard()) == 1
    assert autopilot.heard() == []


@pytest.mark.parametrize("component", [COMPONENT, 240, 154])
def test_another_component_moves_neither_clock_nor_state(beside: Any, component: int) -> None:
    """A companion computer, a bridge or a gimbal of the autopilot's own system."""
    link, autopilot, sender_of = beside
    autopilot.send(position(600.0))
    receive(link)
    before, heard = link.clock.now(time.monotonic()), link.heard
    alien = sender_of(1, component)
    alien.send(
        dialect.MAVLink_system_time_message(0, 0),
        dialect.MAVLink_system_time_message(0, 4_000_000_000),
        position(600.0),
        heartbeat(Mode.RTL),
        dialect.MAVLink_mission_current_message(7),
        dialect.MAVLink_param_value_message(b"AVD_ENABLE", 1.0, 9, 1, 0),
        dialect.MAVLink_mission_count_message(245, COMPONENT, 0, 0),
    )
    assert receive(link) == []
    assert 0 <= link.clock.now(time.monotonic()) - before < SECOND
    assert link.clock.begun == 1
    assert link.heard == heard  # nor is its life the autopilot's


class Autopilot(threading.Thread):
    """Answers a program's questions, with parameters and an empty mission and fence."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.sender, self.stopped = Sender(port), threading.Event()

    def run(self) -> None:
        while not self.stopped.wait(0.005):
            self.sender.send(heartbeat())
            for message in self.sender.heard():
                kind = message.get_type()
                if kind == "PARAM_REQUEST_LIST":
                    for number, (name, value) in enumerate(PARAMETERS.items()):
                        self.sender.send(
                            dialect.MAVLink_param_value_message(
                                name.encode(), value, 9, len(PARAMETERS), number
                            )
                        )
                elif kind == "MISSION_REQUEST_LIST":
                    self.sender.send(
                        dialect.MAVLink_mission_count_message(245, 191, 0, message.mission_type)
                    )


@contextmanager
def flying(*more: str) -> Iterator[tuple[Program, Sender, Link]]:
    """Yield a program beside a simulation, with more options, its autopilot, which is silent from
    then on, and their link.
    """
    port = free_port()
    options: argparse.Namespace = options_of(
        [*f"--connect udp:127.0.0.1:{port} --separation 200 --simulated --quiet".split(), *more]
    )
    autopilot = Autopilot(port)
    with closing(Link(options.connect, simulated=True)) as link:
        autopilot.start()
        running = Program(link, options)
        autopilot.stopped.set()
        autopilot.join()
        yield running, autopilot.sender, link
        running.close()


@pytest.fixture
def program() -> Iterator[tuple[Program, Sender, Link]]:
    """Yield a program without more options, as :func:`flying` does."""
    with flying() as running:
        yield running


def texts(autopilot: Sender) -> str:
    """Return the texts that have come since the last time, joined."""
    return "".join(
        message.text for message in autopilot.heard() if message.get_type() == "STATUSTEXT"
    )


@pytest.mark.slow
def test_what_is_left_out_of_the_traffic_is_told_and_shown(tmp_path: Path) -> None:
    """A surface vehicle of the autopilot's, and what another receiver sends: an aircraft on the
    ground and something without a name.
    """
    document = tmp_path / "aircraft.json"
    taxiing = {"hex": "4b1234", "lat": 47.4, "lon": 8.5, "alt_baro": "ground", "gs": 9}
    vehicle = dialect.MAVLink_adsb_vehicle_message(
        0xABC123, 474_100_000, 85_000_000, 1, 400_000, 0, 500, 0, b"A", 17, 0, 0x8F, 0
    )
    with flying("--adsb", document.as_uri()) as (running, autopilot, _):
        end, heard = time.monotonic() + 20.0, ""
        expected = ("surface vehicle on the ground", "traffic: on the ground", "holds 5")
        while not all(text in heard for text in expected):
            assert time.monotonic() < end, heard
            now = time.time()
            document.write_text(json.dumps({"now": now, "aircraft": [5, taxiing]}), "utf-8")
            autopilot.send(heartbeat(), position(600.0 + now % 1_000.0), vehicle)
            running.turn(0.05)
            heard += texts(autopilot)
        scene = SceneAdapter(running.setup.rules, lambda change: None).after(
            DisplayScene(), running.view
        )
        (line,) = (
            entry
            for entry in page_document(scene, running.view.time)["health"]
            if "left" in entry["name"]
        )
        assert "on the ground" in line["text"]


def test_where_the_autopilot_begins_anew_nothing_hangs_on_its_old_clock(program: Any) -> None:
    """Late once, an hour after the autopilot's start, and then it starts again."""
    running, autopilot, _ = program
    adsb = dialect.MAVLink_adsb_vehicle_message(
        0xABC123, 474_100_000, 85_000_000, 1, 600_000, 0, 2_000, 0, b"A", 1, 0, 0x0F, 0
    )
    autopilot.send(heartbeat(), position(3_600.0), adsb)
    running.turn()
    autopilot.send(position(3_603.0), position(3_603.0))
    running.turn()
    assert list(running.view.received.situation.traffic) == ["abc123"]
    assert not running.state.pace.keeps_up(3_603 * SECOND)
    autopilot.heard()
    autopilot.send(position(5.0))
    running.turn()
    received = running.view.received
    assert received.situation.own.fault is None
    assert received.situation.own.age(running.view.time) < 1.0
    assert not received.situation.traffic
    messages = autopilot.heard()
    assert any(m.get_type() == "STATUSTEXT" and "begun anew" in m.text for m in messages)
    kinds = {message.get_type() for message in messages}
    assert "COMMAND_LONG" in kinds  # for its messages
    for tenth in range(1, round(10 * (RECOVERED + 1.0))):
        autopilot.send(position(5.0 + 0.1 * tenth), heartbeat())
        running.turn(0.005)
    assert running.state.pace.keeps_up(running.view.time)


@pytest.mark.parametrize("speed", [1.0, 6.0])
def test_a_program_that_is_late_says_how_fast_the_simulation_runs(
    program: Any, speed: float
) -> None:
    running, autopilot, link = program
    for second in (3_600.0, 3_603.0):
        autopilot.send(position(second))
        link.clock.speed = speed
        running.turn()
    heard = texts(autopilot)
    assert "late by 3.0 s" in heard
    assert ("6.0 times real time" in heard) == (speed > 2.0)


def fail(*_: Any, **__: Any) -> Any:
    raise ValueError("operands could not be broadcast together")


def test_a_display_that_fails_is_told_and_ends_nothing(program: Any) -> None:
    running, autopilot, _ = program
    views: list[Any] = []
    running.viewers += [fail, views.append]
    for second in range(1, 4):
        autopilot.send(heartbeat(), position(float(second)))
        running.turn()
    assert len(views) >= 2
    heard = texts(autopilot)
    assert heard.count("display failed") == 1
    assert running.state.pace.keeps_up(running.view.time)


def test_a_judgement_that_fails_is_told_and_promises_nothing(
    program: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    running, autopilot, _ = program
    autopilot.send(heartbeat(), position(1.0))
    running.turn()
    with monkeypatch.context() as broken:
        broken.setattr(looking, "course", fail)
        for second in (2.0, 3.0, 4.0):
            autopilot.send(heartbeat(), position(second))
            running.turn()
        assert not running.state.pace.keeps_up(running.view.time)
        judged = running.view.judgement
        assert judged.plan is None and judged.supervision.assessment is None
        assert judged.problem.startswith("judgement failed: ValueError")
        assert "separation not assured" in texts(autopilot)
    autopilot.send(heartbeat(), position(5.0))
    running.turn()
    assert not running.view.judgement.problem.startswith("judgement failed")
