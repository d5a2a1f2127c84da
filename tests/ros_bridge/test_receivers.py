"""Receivers as programs meet them: real sockets, several at once, the ROS node, the MAVLink
program's options and the display.
"""

import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import pytest

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from commands.command import InputError
from ros_bridge.core.feeds.base_station import BaseStation
from ros_bridge.core.feeds.gdl90 import Datagram, Gdl90
from ros_bridge.core.feeds.traffic import Traffic
from ros_bridge.core.fields import SECOND, FieldError
from ros_bridge.core.reports import Report
from ros_bridge.mavlink.options import options_of
from ros_bridge.transport.receivers import (
    EXAMPLES,
    FORMATS,
    LiveReports,
    check_ports,
    check_sources,
)
from tests.ros_bridge.test_adsb_live import eventually, line
from tests.ros_bridge.test_flarm import gga, pflaa, rmc
from tests.ros_bridge.test_gdl90 import aircraft, framed, heartbeat


def free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextmanager
def listening(*sources: str, own: str = "", shows_own: bool = False) -> Iterator[LiveReports]:
    live = LiveReports(check_sources(",".join(sources)), own, time.time_ns, shows_own=shows_own)
    live.start()
    try:
        yield live
    finally:
        live.stop()


def taken(live: LiveReports, send: Callable[[], Any], count: int) -> list[Report | FieldError]:
    """Return what comes while something is sent again and again."""
    outcomes: list[Report | FieldError] = []

    def holds() -> bool:
        send()
        outcomes.extend(outcome for outcome, _ in live.take())
        return len(outcomes) >= count

    eventually(holds, 20.0)
    return outcomes


def test_a_list_of_sources_is_read_and_a_wrong_one_refused() -> None:
    text = "tcp://h:1, http://h/data?a=1,2,gdl90://:4000,flarm://h"
    assert check_sources(text) == ("tcp://h:1", "http://h/data?a=1,2", "gdl90://:4000", "flarm://h")
    assert check_sources("") == ()
    assert set(FORMATS) == {"tcp", "http", "https", "file", "gdl90", "flarm"}
    assert "gdl90://0.0.0.0:4000" in EXAMPLES and "flarm://HOST:2000" in EXAMPLES
    for wrong in (
        "flarm://",
        "gdl90://h:0",
        "gdl90://h/x",
        "flarm:h:2000",
        "tcp://h,udp://h:1",
        "tcp://h,i",
    ):
        with pytest.raises(ValueError, match=r"^adsb is .*expected tcp://HOST:30003"):
            check_sources(wrong)
    with pytest.raises(ValueError, match=r"^adsb names tcp://h twice"):
        check_sources("tcp://h,tcp://h")


def test_a_port_that_is_taken_is_said_at_once() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        source = f"gdl90://127.0.0.1:{listener.getsockname()[1]}"
        for refused in (check_ports, lambda sources: LiveReports(sources, "", time.time_ns)):
            with pytest.raises(ValueError, match="cannot be listened at: Address already in use"):
                refused([source])
    check_ports([source])


@pytest.mark.slow
def test_datagrams_over_udp_become_reports() -> None:
    port = free_udp_port()
    with (
        listening(f"gdl90://127.0.0.1:{port}") as live,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device,
    ):
        assert "has not answered yet" in live.take_problem()

        def send() -> None:
            second = int(time.time()) % 86_400
            content = framed(heartbeat(second), aircraft(10, address=0x4B0001), aircraft())
            device.sendto(content, ("127.0.0.1", port))
            device.sendto(b"\x7e\x14\x7e", ("127.0.0.1", port))

        outcomes = taken(live, send, 4)
        assert {outcome.identifier for outcome in outcomes if isinstance(outcome, Report)} == {
            "4b1234"
        }
        assert any(
            isinstance(outcome, FieldError) and outcome.field == "message" for outcome in outcomes
        )
        assert live.take_problem() == ""


@pytest.mark.slow
def test_sentences_over_tcp_become_reports_and_again_after_a_new_connection() -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        listening(f"flarm://127.0.0.1:{server.getsockname()[1]}") as live,
    ):
        for _ in range(2):
            connection, _ = server.accept()
            with connection:
                text = f"{rmc()}\n{gga()}\n{pflaa()}\n".encode()
                outcomes = taken(live, partial(connection.sendall, text), 1)
                assert isinstance(outcomes[0], Report) and outcomes[0].identifier == "flarm:dd8f12"


@pytest.mark.slow
def test_an_aircraft_has_the_same_name_in_all_feeds() -> None:
    port = free_udp_port()
    with (
        socket.create_server(("127.0.0.1", 0)) as lines,
        socket.create_server(("127.0.0.1", 0)) as flarm,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device,
        listening(
            f"tcp://127.0.0.1:{lines.getsockname()[1]}",
            f"gdl90://127.0.0.1:{port}",
            f"flarm://127.0.0.1:{flarm.getsockname()[1]}",
        ) as live,
    ):
        first, second = lines.accept()[0], flarm.accept()[0]
        with first, second:
            moving = line(4, 0.5, gs=120, track=90) + "\n" + line(3, 0.6, lat=47.1, lon=8.2) + "\n"
            first.sendall(moving.encode())
            text = f"{rmc()}\n{gga()}\n{pflaa(kind=1, id='4B1234')}\n"
            second.sendall(text.encode())
            device.sendto(framed(heartbeat(7), aircraft()), ("127.0.0.1", port))
            outcomes = taken(live, lambda: None, 3)
        assert [getattr(outcome, "identifier", outcome) for outcome in outcomes] == ["4b1234"] * 3


def test_the_ownship_of_one_feed_is_no_traffic_in_another() -> None:
    first, own = Traffic(""), aircraft(10, address=0x4B0001, latitude=47.1, longitude=8.2)
    second = Traffic("", companion=first)
    list(Gdl90(first).reports_of(Datagram("h:1", framed(heartbeat(7), own)), 100 * SECOND))
    reader = BaseStation(second)
    for text, time_ns in (
        (line(4, 0.5, "4B0001", gs=120, track=90), 100 * SECOND),
        (line(3, 0.6, "4B0001", lat=47.1, lon=8.2, alt=5000), 101 * SECOND),
    ):
        assert list(reader.reports_of(text, time_ns)) == []
    assert second.counts == {"own echo": 1}


def test_the_mavlink_program_refuses_what_it_could_not_listen_at() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        source = f"gdl90://127.0.0.1:{listener.getsockname()[1]}"
        with pytest.raises(InputError, match=r"--adsb gdl90://.*Address already in use"):
            options_of(["--connect", "udp:0.0.0.0:14550", "--adsb", source])


@pytest.mark.slow
def test_the_display_shows_what_a_device_sends_and_its_ownship() -> None:
    pytest.importorskip("websockets", reason="websockets is not installed")
    from tests.ros_bridge.test_display_live import aircraft as shown
    from tests.ros_bridge.test_display_live import health, watching

    port = free_udp_port()
    command = [sys.executable, "-m", "ros_bridge.display", "--port", "0"]
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device,
        subprocess.Popen(
            [*command, "--adsb", f"gdl90://127.0.0.1:{port}"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        ) as process,
    ):
        try:
            assert process.stdout is not None
            with watching(process.stdout.readline()) as await_picture:

                def both_drawn(picture: Any) -> Any:
                    second = int(time.time()) % 86_400
                    own = aircraft(10, address=0x4B0001, latitude=47.05)
                    beacon = aircraft(type=5)
                    content = framed(heartbeat(second), own, aircraft(), beacon)
                    device.sendto(content, ("127.0.0.1", port))
                    left_out = health(picture, "traffic left out")
                    is_drawn = picture["own"] and shown(picture, "4b1234") and left_out
                    return picture if is_drawn else None

                picture = await_picture(both_drawn)
                assert picture["own"]["id"] == "4b0001"
                assert [intruder["id"] for intruder in picture["traffic"]] == ["4b1234"]
                assert picture["traffic"][0]["relative_altitude"] == 0.0
                assert "ground station" in health(picture, "traffic left out")["text"]
        finally:
            process.send_signal(signal.SIGINT)
            _, errors = process.communicate(timeout=60.0)
        assert process.returncode == 0 and errors == ""


@pytest.mark.slow
def test_a_translator_passes_on_what_a_device_sends() -> None:
    graph = pytest.importorskip("tests.ros_bridge.graph")
    from diagnostic_msgs.msg import DiagnosticArray
    from rlcas_msgs.msg import AircraftState

    from ros_bridge.nodes.translator import Translator
    from ros_bridge.transport import qos

    port = free_udp_port()
    source = f"gdl90://127.0.0.1:{port}"
    with (
        graph.running_beside(Translator, adsb=source, diagnostics_period=0.2) as (_, client),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device,
    ):
        with pytest.raises(ValueError, match="Address already in use"):  # noqa: SIM117
            with graph.running_beside(Translator, adsb=source):
                pass
        states = client.hear_traffic()
        health = client.hear(DiagnosticArray, "/diagnostics", qos.EVENTS)

        def send() -> Any:
            content = framed(heartbeat(int(time.time()) % 86_400), aircraft(), aircraft(type=5))
            device.sendto(content, ("127.0.0.1", port))
            time.sleep(0.1)
            return states

        client.spin(send)
        assert states[-1].id == "4b1234" and states[-1].valid & AircraftState.VALID_VELOCITY
        assert states[-1].altitude_reference == AircraftState.ALTITUDE_PRESSURE
        client.spin(
            lambda: health and "ground station, left out" in str(health[-1].status[0].values)
        )
