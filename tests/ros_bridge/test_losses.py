"""Traffic of a whole sky arrives whole, and what is lost is told."""

import json
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.ros_bridge.graph import MISSING, NODE, Client, Process, domain, running_beside

pytest.importorskip("rclpy", reason=MISSING)

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rlcas_msgs.msg import AircraftState

from ros_bridge.core.reports import Report
from ros_bridge.nodes.runner import Runner
from ros_bridge.nodes.translator import Translator
from ros_bridge.transport import qos
from ros_bridge.transport.losses import Losses


@given(st.lists(st.booleans(), min_size=2, max_size=50))
def test_what_does_not_come_between_two_messages_is_lost(came: list[bool]):
    losses = Losses()
    for number, arrives in enumerate([True, *came, True]):
        losses.note("traffic", b"1", number if arrives else None, 0.0)
        losses.note("traffic", b"2", number, 0.0)  # of another publisher none is missing
    assert losses.counts["traffic"] == came.count(False)
    assert (f"{came.count(False)} messages of traffic were lost" in losses.problem(1.0)) == (
        not all(came)
    )
    assert losses.problem(60.0) == ""


def test_a_whole_sky_at_once_is_passed_on_whole():
    names = {f"{number:06x}" for number in range(1, 802)}
    with running_beside(Translator, traffic_source="nav_sat_fix", traffic_id="n1") as (
        node,
        client,
    ):
        states = client.hear_traffic()
        client.spin(lambda: node.count_subscribers(f"{NODE}/input/traffic_array"))
        client.idle(0.5)
        for name in sorted(names):
            node._pass("traffic", Report(name, client.now(), 47.0, 8.0, 60.0, 0.0))
        client.spin(lambda: {state.id for state in states} == names)
    assert len(states) == len(names)


@pytest.mark.slow
def test_every_aircraft_of_a_document_is_known_to_the_runner(tmp_path: Path):
    count = 801
    document = tmp_path / "aircraft.json"

    def write(now: float) -> None:
        rows = [
            {"hex": f"{0x400000 + n:06x}", "lat": 46.0 + n * 1e-3, "lon": 8.0, "gs": 0.0}
            | {"track": 0.0, "seen_pos": 0.0, "alt_geom": 9_000}
            for n in range(count)
        ]
        part = tmp_path / "part"
        part.write_text(json.dumps({"now": now, "aircraft": rows}), encoding="utf-8")
        part.rename(document)

    write(1.0)
    with domain() as number:
        for module, parameter in (("runner", "separation:=1000.0"), ("translator", "own_id:=own")):
            arguments = ["--ros-args", "-p", parameter]
            arguments += ["-p", f"adsb:={document.as_uri()}"] if module == "translator" else []
            Process(f"ros_bridge.{module}", number, *arguments)
        client = Client(number)
        try:
            health = client.hear(DiagnosticArray, "/diagnostics", qos.EVENTS)

            def complete() -> dict[str, str] | None:
                write(time.time())
                client.idle(1.0)
                values = [
                    {pair.key: pair.value for pair in entry.status[0].values}
                    for entry in health
                    if entry.status[0].name == NODE
                ]
                return next((entry for entry in values if entry["intruders"] == str(count)), None)

            values = client.spin(complete)
        finally:
            client.close()
    assert not [key for key in values if key.startswith("lost of")]


def test_lost_reports_are_an_error_in_the_diagnostics():
    with running_beside(Runner, diagnostics_period=0.2) as (node, client):
        node.trigger_configure()
        node.trigger_activate()
        health = client.hear(DiagnosticArray, "/diagnostics", qos.EVENTS)
        topic = f"{NODE}/input/traffic"
        small = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
        client.say(AircraftState, topic, AircraftState(id="0"), small)
        client.idle(0.3)
        # More than the runner's queue holds, while it is busy.
        for number in range(5_000):
            client.say(AircraftState, topic, AircraftState(id=str(number)), small)
        status = client.spin(
            lambda: next(
                (
                    message.status[0]
                    for message in health
                    if "were lost" in message.status[0].message
                ),
                None,
            )
        )
    assert status.level == DiagnosticStatus.ERROR
    values = {pair.key: pair.value for pair in status.values}
    assert int(values["lost of ~/input/traffic"]) > 0
