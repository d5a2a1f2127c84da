"""Separations by emitter category: from parameters and messages to what the planner and the monitor
keep.
"""

import json
import math
import time
from dataclasses import replace
from types import SimpleNamespace

import pytest

from agents.planner.planner import plan
from agents.policy.inference import Policy
from ros_bridge.core.adapters import adsb_vehicle
from ros_bridge.core.assurance import activate, initial, step_monitor
from ros_bridge.core.categories import Categories, number_of, separations_of, text_of
from ros_bridge.core.conversions import aircraft as report_of
from ros_bridge.core.feeds.aircraft_json import AircraftJson
from ros_bridge.core.feeds.traffic import Traffic
from ros_bridge.core.fields import FieldError
from ros_bridge.core.reports import USUAL
from ros_bridge.core.tasks import task
from tests.ros_bridge.graph import MISSING, NODE, PATIENCE, Client, Process, World, domain
from tests.ros_bridge.scenes import NOW, SECOND, SETTINGS, THRESHOLDS, aircraft, situation_after
from tests.ros_bridge.test_assurance import publish_plan

HEAVY, DRONE = number_of("A5"), number_of("b6 ")
CATEGORIES = Categories({HEAVY: 2_500.0, DRONE: 400.0}, {DRONE: 150.0})


def test_categories_are_the_codes_of_mavlink() -> None:
    codes = {"A1": 1, "A5": 5, "A7": 7, "B1": 9, "B2": 10, "B6": 14, "B7": 15, "C1": 17, "C7": 23}
    assert {name: number_of(name) for name in codes} == codes
    assert [number_of(name) for name in ("A0", "D1", "A8", "", None, 5, "A55")] == [0] * 7


def test_separations_are_read_from_a_parameter() -> None:
    assert separations_of("x", " A5:2500, b6 : 400 ") == {HEAVY: 2_500.0, DRONE: 400.0}
    assert separations_of("x", "  ") == {}
    for separations in ({HEAVY: 2_500.0, DRONE: 400.5}, {}):
        assert separations_of("x", text_of(separations)) == separations


@pytest.mark.parametrize(
    "text", ["A5", "A5:0", "A5:-3", "A5:nan", "A5:inf", "A5:1e9", "Z9:500", "A0:500", "A5:1,A5:2"]
)
def test_what_is_no_separation_is_refused_in_one_sentence(text: str) -> None:
    with pytest.raises(ValueError, match=r"^category_separations .*, expected ") as refused:
        separations_of("category_separations", text)
    assert "\n" not in str(refused.value)


def test_messages_carry_the_category() -> None:
    assert report_of(aircraft(0.0, 0.0, 0.0, 75.0, category=HEAVY), "intruder").category == HEAVY
    with pytest.raises(FieldError, match="category"):
        report_of(aircraft(0.0, 0.0, 0.0, 75.0, category=200), "intruder")
    message = SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=0)),
        tslc=SimpleNamespace(sec=0),
        icao_address=0x4B1A2C,
        callsign="",
        emitter_type=DRONE,
        flags=1 | 4 | 8,
        latitude=47.0,
        longitude=8.0,
        heading=90.0,
        hor_velocity=20.0,
    )
    report = adsb_vehicle(message)
    assert report is not None and report.category == DRONE
    row = {"hex": "4b1a2c", "lat": 47.0, "lon": 8.0, "gs": 100, "track": 0, "seen_pos": 0.0}
    reader = AircraftJson(Traffic(""))
    documents = (
        json.dumps({"now": now, "aircraft": [row | {"category": "A5", "lat": 47.0 + 1e-3 * now}]})
        for now in (1_000.0, 1_001.0, 1_002.0)
    )
    read = [
        outcome
        for n, text in enumerate(documents)
        for outcome in reader.reports_of(text, (1_000 + n) * SECOND)
    ]
    assert read and all(
        not isinstance(outcome, FieldError) and outcome.category == HEAVY for outcome in read
    )


def test_the_task_keeps_from_each_what_its_category_asks_for() -> None:
    settings = replace(SETTINGS, categories=CATEGORIES)
    situation = situation_after(
        aircraft(9_000.0, 3_000.0, math.pi, 75.0, id="aaaaaa", category=HEAVY),
        aircraft(9_000.0, -3_000.0, math.pi, 75.0, id="bbbbbb", category=DRONE),
        aircraft(9_000.0, 9_000.0, math.pi, 75.0, id="cccccc", category=3),
    )
    requested = task(situation, NOW, settings)
    assert requested.identifiers == ("aaaaaa", "bbbbbb", "cccccc")
    assert [intruder.separation for intruder in requested.intruders] == [2_500.0, 400.0, None]
    assert [intruder.vertical_separation for intruder in requested.intruders] == [None, 150.0, None]
    assert [intruder.separation for intruder in task(situation, NOW, SETTINGS).intruders] == [
        None
    ] * 3
    answer = plan(
        requested.own, requested.intruders, requested.points, Policy.load(), requested.options
    )
    assert answer.safe and answer.certificate is not None
    rows = json.loads(answer.certificate)["intruders"]
    assert [row[9] for row in rows] == [2_500.0, 400.0, 1_000.0]


def test_the_monitor_keeps_them_too_and_knows_altitudes() -> None:
    levels = {"valid": 0xC5 | 0x02 | 0x08, "altitude": 1_000.0, "altitude_reference": 1}
    own = aircraft(0.0, 0.0, 0.0, 75.0, id="own", **levels)

    def crossing(height: float, category: int) -> SimpleNamespace:
        fields = levels | {"altitude": height, "category": category}
        return aircraft(6_000.0, -4_500.0, math.pi / 2.0, 75.0, **fields)

    situation = situation_after(crossing(1_000.0, HEAVY), own=own)
    supervision = activate(
        initial(THRESHOLDS, USUAL, CATEGORIES), situation, publish_plan(situation)
    )
    assessment = step_monitor(supervision, situation, NOW).assessment
    assert assessment is not None
    traffic = assessment.measured.traffic
    assert traffic.separation.tolist() == [[2_500.0]]
    assert traffic.window is not None
    # At the ownship's altitude, without a climb of either, it counts for good.
    assert traffic.window.begin[0, 0] <= 0.0 and traffic.window.end[0, 0] == math.inf
    # One that sinks away counts until it is 600 m below.
    sinking = crossing(900.0, 0)
    sinking.velocity.z = -5.0
    situation = situation_after(sinking, own=own)
    assessment = step_monitor(
        activate(initial(THRESHOLDS, USUAL, CATEGORIES), situation, publish_plan(situation)),
        situation,
        NOW,
    ).assessment
    assert assessment is not None
    window = assessment.measured.traffic.window
    assert window is not None and window.end[0, 0] == pytest.approx(100.0, abs=1e-3)


@pytest.mark.slow
def test_runner_and_monitor_keep_them_on_a_real_graph() -> None:
    pytest.importorskip("rclpy", reason=MISSING)
    from rlcas_msgs.msg import AssuranceStatus
    from rlcas_msgs.srv import GenerateTrajectory

    from ros_bridge.core.fields import Code
    from ros_bridge.transport import qos

    arguments = "--ros-args", "-p", "category_separations:='A5:2500'"
    with domain() as number:
        runner = Process("ros_bridge.runner", number, *arguments)
        monitor = Process("ros_bridge.monitor", number, *arguments)
        refused = Process(
            "ros_bridge.runner", number, "--ros-args", "-p", "category_separations:='A5:0'"
        )
        client = Client(number)
        world = World(client)
        says = client.hear(AssuranceStatus, "/rlcas_monitor/output/status", qos.LATCHED)
        end, answer = time.monotonic() + PATIENCE, None
        world.reference()
        world.route()
        while answer is None or answer.status != Code.SAFE or not answer.trajectory.intruder_ids:
            assert time.monotonic() < end, answer and answer.message
            world.ownship()
            world.intruder(8_000.0, -8_000.0, math.pi / 2.0, category=HEAVY)
            client.idle(0.1)
            answer = client.call(
                GenerateTrajectory,
                f"{NODE}/generate_trajectory",
                GenerateTrajectory.Request(reason=GenerateTrajectory.Request.REASON_MANUAL),
            )
        assert answer.trajectory.min_separation >= 2_500.0
        data = json.loads(bytes(answer.trajectory.certificate))
        assert [row[9] for row in data["intruders"]] == [2_500.0]
        client.spin(lambda: says)
        output, _ = refused.popen.communicate(timeout=PATIENCE)
        assert refused.popen.returncode != 0 and "category_separations holds 'A5:0'" in output
        assert "Traceback" not in output
        client.close()
        for process in (monitor, runner):
            process.stop()
