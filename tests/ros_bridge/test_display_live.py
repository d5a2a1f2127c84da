"""The display as a process, fed by a real ROS graph and by a receiver of ADS-B."""

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

pytest.importorskip("websockets", reason="websockets is not installed")

from websockets.sync.client import connect

from tests.ros_bridge.test_adsb_live import line


@contextmanager
def watching(url: str) -> Iterator[Callable[[Callable[[Any], Any]], Any]]:
    """Yield what waits for a picture of which something holds, and returns that."""
    with connect(f"ws{url.strip()[4:]}pictures", compression=None) as client:
        assert json.loads(client.recv(timeout=30.0))["type"] == "hello"

        def wait_for_picture(holds: Callable[[Any], Any]) -> Any:
            end = time.monotonic() + 60.0
            while time.monotonic() < end:
                held_value = holds(json.loads(client.recv(timeout=30.0)))
                if held_value:
                    return held_value
            raise AssertionError("no such picture came")

        yield wait_for_picture


def aircraft(picture: Any, name: str) -> Any:
    return next((intruder for intruder in picture["traffic"] if intruder["id"] == name), None)


def health(picture: Any, name: str) -> Any:
    return next((entry for entry in picture["health"] if entry["name"] == name), None)


def test_what_nodes_say_on_a_real_graph_is_shown():
    graph = pytest.importorskip("tests.ros_bridge.graph")
    from rlcas_msgs.msg import AssuranceStatus, Trajectory

    from ros_bridge.transport import qos
    from ros_bridge.transport.messages import time_message

    with graph.domain() as number:
        process = graph.Process("ros_bridge.display", number, "--port", "0")
        client = graph.Client(number)
        try:
            with watching(process.popen.stdout.readline()) as await_picture:
                world = graph.World(client)

                def both_drawn(picture: Any) -> Any:
                    world.ownship(id="own")  # again: the first may come before all are matched
                    world.intruder(5_000.0, 0.0, 3.0, 75.0)
                    return picture if picture["own"] and picture["traffic"] else None

                picture_drawn = await_picture(both_drawn)
                assert picture_drawn["own"]["speed"] == 75.0
                assert aircraft(picture_drawn, "4b1a2c")["x"] - picture_drawn["own"][
                    "x"
                ] == pytest.approx(5_000.0, abs=500.0)
                # What a node of another version, or a broken one, says.
                status = AssuranceStatus(state=9)
                status.header.stamp = time_message(client.now())
                topic = "rlcas_monitor/output/status"
                client.say(AssuranceStatus, topic, status, qos.LATCHED)
                entry = await_picture(lambda picture: health(picture, "monitor"))
                assert entry["level"] == 2 and "status.state is 9" in entry["text"]
                client.say(Trajectory, f"{graph.NODE}/output/trajectory", Trajectory(), qos.LATCHED)
                await_picture(lambda picture: (health(picture, "plan") or {}).get("level") == 2)
            code, output = process.stop(signal.SIGTERM)
            assert code == 0 and "Traceback" not in output, output
        finally:
            client.close()


@pytest.mark.slow
def test_a_receiver_alone_makes_a_picture():
    with socket.create_server(("127.0.0.1", 0)) as server:
        source = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        command = [sys.executable, "-m", "ros_bridge.display", "--port", "0", "--adsb", source]
        with subprocess.Popen(
            [*command, "--own", "4B0001"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as process:
            try:
                assert process.stdout is not None
                with watching(process.stdout.readline()) as await_picture:
                    connection, _ = server.accept()
                    with connection:
                        for address, latitude in (("4B0001", 47.0), ("4B0002", 47.1)):
                            for text in (
                                line(4, 0.5, address, gs=100, track=90),
                                line(3, 0.6, address, lat=latitude, lon=8.0, alt=5000),
                            ):
                                connection.sendall(f"{text}\n".encode())
                        connection.sendall(b"<script>\n")
                        picture_drawn = await_picture(
                            lambda picture: picture if aircraft(picture, "4b0002") else None
                        )
                        assert [intruder["id"] for intruder in picture_drawn["traffic"]] == [
                            "4b0002"
                        ]
                        assert picture_drawn["own"]["id"] == "4b0001"
                        assert picture_drawn["traffic"][0]["relative_altitude"] == 0.0
                        await_picture(lambda picture: "<script>" in str(health(picture, "traffic")))
                    lost = await_picture(
                        lambda picture: (
                            (health(picture, "receiver") or {}).get("level") == 2
                            and health(picture, "receiver")
                        )
                    )
                    assert "closed the connection" in lost["text"] or "cannot" in lost["text"]
            finally:
                process.send_signal(signal.SIGINT)
                _, errors = process.communicate(timeout=60.0)
            assert process.returncode == 0 and errors == ""


@pytest.mark.slow
@pytest.mark.parametrize("climbs", [False, True])
def test_the_demo_shows_its_plan_and_bands_while_it_flies(climbs: bool):
    pytest.importorskip("tests.ros_bridge.graph")
    command = [sys.executable, "-m", "ros_bridge.demo", "--scenarios", "head_on", "--display"]
    command += ["--aircraft", "uas", "--maneuvers", "vertical"] if climbs else []
    with subprocess.Popen([*command, "--rate", "20"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        with watching(process.stdout.readline()) as await_picture:
            # There are bands before the first plan.
            picture_drawn = await_picture(
                lambda picture: (
                    picture if picture["bands"] and picture["monitor"]["fly"] == "plan" else None
                )
            )
            assert ("vertical_speed" in picture_drawn["bands"]) == climbs
            assert (picture_drawn["plan"]["profile"] is not None) == climbs
            assert ("climb" in picture_drawn["advice"]) == climbs
            assert (picture_drawn["monitor"]["altitude_error"] is not None) == climbs
            assert picture_drawn["separation"] == (610.0 if climbs else 1_000.0)
            assert picture_drawn["plan"] and picture_drawn["advice"]["do"] == "plan"
            assert {entry["name"] for entry in picture_drawn["health"]} >= {
                "/rlcas_runner",
                "/rlcas_monitor",
            }
        output, _ = process.communicate(timeout=300.0)
        assert process.returncode == 0 and "SAFE" in output, output
