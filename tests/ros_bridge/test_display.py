"""The picture of a display, and the server that gives it to whoever asks, well or badly."""

import http.client
import json
import math
import re
import socket
import time
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("websockets", reason="websockets is not installed")

from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from agents.assurance.thresholds import Cause
from commands.command import InputError
from envs.formats.local_frame import LocalFrame, distance, fly_straight
from ros_bridge.core.categories import BY_CATEGORY
from ros_bridge.core.fields import FieldError, Sighting
from ros_bridge.core.freshness import USUAL_FRESHNESS, Freshness
from ros_bridge.core.reports import Report
from ros_bridge.display.document import VERSION, to_json
from ros_bridge.display.recording import read
from ros_bridge.display.run import main
from ros_bridge.display.scene import INPUTS, DisplayScene, take, take_report
from ros_bridge.display.server import LiveSource
from tests.ros_bridge.displays import (
    NOW,
    PREFIX,
    SECOND,
    area,
    areas,
    climbing_plan,
    guidance,
    known_scene,
    level_aircraft,
    page_document,
    plan,
    serving,
    status,
    up_and_down,
)
from tests.ros_bridge.scenes import aircraft, alert, geo_reference, stamp

STATUS, GUIDANCE = "rlcas_monitor/output/status", "rlcas_monitor/output/guidance"
PLAN, BACKUP = "rlcas_runner/output/trajectory", "rlcas_monitor/output/backup"


def after(seconds: float) -> int:
    return NOW + round(seconds * SECOND)


# The picture.


@given(st.floats(-30e3, 30e3), st.floats(-30e3, 30e3), st.floats(-3.1, 3.1), st.floats(0.0, 20.0))
def test_aircraft_are_drawn_where_they_are_to_be_expected(x, y, heading, seconds):
    message = aircraft(x, y, heading, 80.0)
    picture = page_document(known_scene(message), after(seconds))
    intruder = picture["traffic"][0]
    place = LocalFrame(*picture["origin"]).geodetic(intruder["x"], intruder["y"])
    velocity = message.velocity
    expected = fly_straight(message.latitude, message.longitude, velocity.x, velocity.y, seconds)
    assert distance(float(place.latitude), float(place.longitude), *expected) < 3.0
    track = math.degrees(math.atan2(velocity.x, velocity.y)) % 360.0
    assert abs((intruder["track_deg"] - track + 180.0) % 360.0 - 180.0) < 0.2
    assert intruder["age"] == pytest.approx(seconds, abs=0.01)


def test_how_sure_a_position_is_grows_with_the_age_of_its_report_and_is_unknown_without_it():
    spread = {"position_std": 30.0, "velocity_std": 3.0}
    for seconds, expected in ((0.0, 60.0), (10.0, 2.0 * math.hypot(30.0, 30.0))):
        scene = known_scene(aircraft(5_000.0, 0.0, 0.0, 80.0, **spread))
        assert page_document(scene, after(seconds))["traffic"][0]["accuracy"] == pytest.approx(
            expected, abs=0.1
        )
    unknown = known_scene(aircraft(5_000.0, 0.0, 0.0, 80.0, valid=0x05))
    assert page_document(unknown, NOW)["traffic"][0]["accuracy"] is None


def test_what_is_old_is_marked_and_then_forgotten():
    scene, usual = known_scene(aircraft(5_000.0, 0.0, 0.0, 80.0)), USUAL_FRESHNESS
    states = [
        [entry["state"] for entry in page_document(scene, after(age))["traffic"]]
        for age in (0.0, usual.intruder - 0.1, usual.intruder + 0.1, usual.silence + 0.1)
    ]
    assert states == [["fresh"], ["coasting"], ["stale"], []]
    assert page_document(scene, after(usual.own + 0.1))["own"]["state"] == "stale"
    lines = page_document(scene, after(usual.own + 0.1))["health"]
    assert next(entry for entry in lines if entry["name"] == "ownship")["level"] == 2


def test_no_aircraft_is_forgotten_that_a_node_still_plans_for():
    """What nodes say of how long things count goes, and of two nodes what is longer."""
    scene = known_scene(aircraft(5_000.0, 0.0, 0.0, 80.0))
    for name, fresh in (("runner", Freshness(silence=600.0)), ("monitor", USUAL_FRESHNESS)):
        pairs = [SimpleNamespace(key=key, value=text) for key, text in fresh.texts().items()]
        status = SimpleNamespace(level=b"\0", name=name, message="", values=pairs)
        scene = take(scene, "/diagnostics", SimpleNamespace(status=[status]), NOW)
    assert [intruder["state"] for intruder in page_document(scene, after(599.0))["traffic"]] == [
        "stale"
    ]
    assert page_document(scene, after(601.0))["traffic"] == []


def test_an_aircraft_is_shown_by_its_callsign():
    scene = known_scene(aircraft(5_000.0, 0.0, 0.0, 80.0, callsign="swr12k "))
    assert page_document(scene, NOW)["traffic"][0]["callsign"] == "SWR12K"


def test_a_clock_that_steps_back_begins_anew():
    scene = known_scene(aircraft(5_000.0, 0.0, 0.0, 80.0))
    assert page_document(scene, after(-0.4))["traffic"]
    assert not page_document(scene, after(-1.0))["traffic"]


def test_heights_are_compared_only_where_they_are_comparable():
    def level(value: float, reference: int) -> dict[str, Any]:
        return {"altitude": value, "altitude_reference": reference, "valid": 0xC5 | 2}

    own = aircraft(0.0, 0.0, 0.0, 80.0, id="own", **level(1_000.0, 1))
    for height, reference, above in ((1_300.0, 1, 300.0), (1_300.0, 2, None), (900.0, 1, -100.0)):
        scene = known_scene(aircraft(5_000.0, 0.0, 0.0, 80.0, **level(height, reference)), own=own)
        assert page_document(scene, NOW)["traffic"][0]["relative_altitude"] == above


def test_alerts_of_the_monitor_and_of_others_are_joined():
    scene = known_scene(aircraft(5_000.0, 0.0, 0.0, 80.0), aircraft(0.0, 9e3, 0.0, 80.0, id="b"))
    levels = {"intruder_ids": ["4b1a2c"], "intruder_level": [1], "intruder_loss": [40.0]}
    scene = take(scene, GUIDANCE, guidance(**levels), NOW)
    scene = take(scene, f"{PREFIX}alerts", alert("b", level=3), NOW)
    picture = page_document(scene, after(2.0))
    assert [
        (drawn_alert["id"], drawn_alert["level"], drawn_alert["loss"])
        for drawn_alert in picture["alerts"]
    ] == [
        ("b", 3, None),
        ("4b1a2c", 1, 38.0),
    ]
    assert page_document(scene, after(20.0))["alerts"] == []


@pytest.mark.parametrize("side", [1, -1])
def test_advice_turns_to_the_nearer_free_side(side: int):
    """The ownship flies east, track 90: number 18. Mirrored bands give mirrored advice."""
    closed = [(18 + side * n) % 72 for n in range(-8, 5)]
    bands = guidance()
    bands.track_region = [2 if n in closed else 0 for n in range(72)]
    bands.intruder_ids, bands.intruder_level, bands.intruder_loss = ["4b1a2c"], [2], [30.0]
    scene = take(known_scene(aircraft(5_000.0, 0.0, 0.0, 80.0)), GUIDANCE, bands, NOW)
    advice = page_document(scene, NOW)["advice"]
    assert advice["do"] == "free" and advice["turn"] == ("right" if side > 0 else "left")
    assert advice["track_deg"] == 90.0 + side * 25.0


def test_advice_is_what_the_monitor_says_is_to_be_flown():
    scene = known_scene(aircraft(5_000.0, 0.0, 0.0, 80.0))
    scene = take(take(scene, PLAN, plan(), NOW), STATUS, status(1), NOW)
    picture = page_document(scene, NOW)
    assert picture["advice"]["do"] == "plan" and picture["advice"]["turn"] == "left"
    assert picture["backup"] is None
    scene = take(take(scene, BACKUP, plan(5, north=-3_000.0), NOW), STATUS, status(2), NOW)
    picture = page_document(scene, NOW)
    assert picture["advice"]["do"] == "backup" and picture["advice"]["turn"] == "right"
    scene = take(scene, PLAN, SimpleNamespace(status=3), NOW)
    assert page_document(scene, NOW)["plan"] is None


@given(
    st.floats(-3.1, 3.1),
    st.floats(0.0, 25.0),
    st.floats(0.0, 359.0),
    st.floats(30.0, 110.0),
)
def test_own_plan_and_advice_are_in_one_frame(wind_to, wind_speed, track, speed):
    """Through the air where the wind is known; an aircraft that is on its plan holds what it has."""
    wind = wind_speed * math.cos(wind_to), wind_speed * math.sin(wind_to)
    own = Report(
        "own",
        NOW,
        47.0,
        8.0,
        speed * math.sin(math.radians(track)),
        speed * math.cos(math.radians(track)),
        wind=wind,
    )
    scene = take_report(DisplayScene(separation=1_000.0), own, NOW, own=True)
    flown = plan()
    for waypoint in (flown.start, *flown.waypoints):
        waypoint.track_deg, waypoint.ground_speed = track, speed
    picture = page_document(take(take(scene, PLAN, flown, NOW), STATUS, status(1), NOW), NOW)
    assert picture["frame"] == "air" and picture["wind"] == pytest.approx(wind, abs=0.06)
    air, advice = picture["own"]["air"], picture["advice"]
    assert picture["plan"]["points"][0]["air"] == air
    assert (advice["speed"], advice["track_deg"]) == (air["speed"], air["track_deg"])
    assert air["speed"] == pytest.approx(
        math.hypot(own.east - wind[0], own.north - wind[1]), abs=0.1
    )
    assert advice["turn"] == "hold" and advice["then"] is None


@pytest.mark.parametrize(
    ("passed", "turn", "following"), [(0.0, "hold", ("left", 30.0, 40.0)), (45.0, "left", None)]
)
def test_what_follows_is_told_from_what_is_flown(passed: float, turn: str, following: Any):
    """East for two legs, then a turn to the left that begins at the second waypoint."""
    flown = plan()
    first = flown.waypoints[0]
    tracks = ((1, 20.0, 90.0), (2, 40.0, 90.0), (3, 60.0, 30.0), (4, 80.0, 30.0))
    flown.waypoints = [
        SimpleNamespace(
            **vars(first)
            | {"index": n, "track_deg": to, "time_of_arrival": stamp(after(t - passed))}
        )
        for n, t, to in tracks
    ]
    flown.header.stamp = flown.start.time_of_arrival = stamp(after(-passed))
    scene = take(take(known_scene(), PLAN, flown, NOW), STATUS, status(1), NOW)
    advice = page_document(scene, NOW)["advice"]
    assert advice["turn"] == turn
    follows = advice["then"]
    assert following == (follows and (follows["turn"], follows["track_deg"], follows["in"]))


def test_a_plan_that_nobody_flies_is_advice():
    scene = take(known_scene(aircraft(5_000.0, 0.0, 0.0, 80.0)), PLAN, plan(), NOW)
    picture = page_document(take(scene, STATUS, status(0, state=1), NOW), NOW)
    assert picture["advice"]["do"] == "advised" and picture["advice"]["turn"] == "left"
    denied = page_document(take(scene, STATUS, status(0, state=3), NOW), NOW)
    assert denied["advice"]["do"] == "own route"


def test_a_remark_is_no_reason():
    causes = Cause.SEPARATION | Cause.OUTSIDE_RANGE
    message = status(1, causes=int(causes), reasons=["too near", "an unusual speed"])
    monitor = page_document(take(known_scene(), STATUS, message, NOW), NOW)["monitor"]
    assert (monitor["reasons"], monitor["remarks"]) == (["too near"], ["an unusual speed"])


@pytest.mark.parametrize(
    ("away", "level", "near"), [(9e3, 0, True), (12e3, 0, False), (9e3, 2, False)]
)
def test_near_traffic_without_an_alert_is_proximate(away: float, level: int, near: bool):
    """Nearer than ten separations of 1000 m; a height that nobody knows counts as the same."""
    levels = {"intruder_ids": ["4b1a2c"], "intruder_level": [level], "intruder_loss": [40.0]}
    scene = known_scene(aircraft(away, 0.0, 0.0, 80.0))
    picture = page_document(take(scene, GUIDANCE, guidance(**levels), NOW), NOW)
    assert picture["traffic"][0]["proximate"] is near


def test_where_nothing_is_free_the_way_out_is_said():
    bands = guidance(range(72), region=3, recovery=30)
    bands.intruder_ids, bands.intruder_level, bands.intruder_loss = ["4b1a2c"], [3], [9.0]
    scene = take(known_scene(aircraft(5_000.0, 0.0, 0.0, 80.0)), GUIDANCE, bands, NOW)
    advice = page_document(scene, after(2.0))["advice"]
    assert advice["do"] == "recovery" and advice["track_deg"] == 150.0
    assert advice["after"] == 10.0 and advice["shortfall"] == 250.0


def solid_scene(*traffic: Any, climb: float = 0.0, reference: int = 2) -> DisplayScene:
    """Return what is known of an ownship 500 m above the sea that may climb and descend."""
    own = level_aircraft(0.0, 0.0, 0.0, 80.0, climb=climb, id="own")
    scene = take(known_scene(*traffic, own=own), PLAN, climbing_plan(reference), NOW)
    return take(scene, GUIDANCE, guidance(**up_and_down(range(3, 7), reference=reference)), NOW)


def test_a_plan_that_climbs_says_how_far_and_what_comes_then():
    scene = take(solid_scene(), STATUS, status(1), NOW)
    picture = page_document(scene, NOW)
    began = picture["plan"]["began"]
    assert [(moment - began, height) for moment, height in picture["plan"]["profile"]] == [
        (0.0, 500.0),
        (20.0, 550.0),
        (40.0, 600.0),
        (60.0, 600.0),
        (80.0, 600.0),
        (120.0, 500.0),
    ]
    advice = picture["advice"]
    assert (advice["climb"], advice["altitude"]) == (2.5, 600.0)
    following = advice["then"]
    assert (following["in"], following["climb"], following["altitude"]) == (40.0, 0.0, 600.0)
    message = status(1, header=SimpleNamespace(stamp=stamp(after(50.0))))
    later = page_document(take(scene, STATUS, message, after(50.0)), after(50.0))["advice"]
    assert (later["climb"], later["altitude"]) == (0.0, 600.0)
    assert (later["then"]["in"], later["then"]["climb"]) == (30.0, -2.5)
    assert later["then"]["altitude"] == 500.0
    flat = page_document(take(take(known_scene(), PLAN, plan(), NOW), STATUS, status(1), NOW), NOW)
    assert flat["plan"]["profile"] is None and "climb" not in flat["advice"]


def test_altitudes_are_drawn_above_what_the_ownships_is():
    """The plan and the bands are above the ellipsoid, the ownship above the sea."""
    scene = solid_scene(reference=1)
    unknown = page_document(scene, NOW)
    assert unknown["plan"]["profile"] is None and "altitude" not in unknown["bands"]
    assert unknown["bands"]["vertical_speed"] == [float(n - 5) for n in range(11)]
    origin = geo_reference(geoid_undulation_valid=True, geoid_undulation=48.0)
    picture = page_document(take(scene, f"{PREFIX}geo_reference", origin, NOW), NOW)
    assert picture["own"]["altitude"] == 500.0 and picture["own"]["reference"] == "msl"
    assert picture["plan"]["profile"][0][1] == picture["plan"]["profile"][-1][1] == 452.0
    assert picture["plan"]["points"][0]["altitude"] == 502.0
    assert picture["bands"]["altitude"][0] == -48.0
    assert list(picture["bands"]["altitude_region"]) == [0, 0, 0, 2, 2, 2, 2, 0, 0, 0, 0]


def test_altitudes_go_on_to_the_time_of_the_picture():
    traffic = level_aircraft(5_000.0, 0.0, 0.0, 80.0, height=800.0, climb=-2.0)
    picture = page_document(
        known_scene(traffic, own=level_aircraft(0.0, 0.0, 0.0, 80.0, id="own")), after(4.0)
    )
    (intruder,) = picture["traffic"]
    assert intruder["altitude"] == 792.0 and intruder["relative_altitude"] == 292.0


def test_a_backup_levels_off_where_the_ownship_may_climb():
    scene = take(take(solid_scene(climb=2.0), BACKUP, plan(5), NOW), STATUS, status(2), NOW)
    advice = page_document(scene, NOW)["advice"]
    assert advice["do"] == "backup" and (advice["climb"], advice["altitude"]) == (0.0, None)
    flat = take(take(known_scene(), BACKUP, plan(5), NOW), STATUS, status(2), NOW)
    assert "climb" not in page_document(flat, NOW)["advice"]


def test_a_backup_that_climbs_says_how_far():
    message = climbing_plan()
    message.status = 5
    scene = take(take(solid_scene(), BACKUP, message, NOW), STATUS, status(2), NOW)
    picture = page_document(scene, NOW)
    assert picture["backup"]["profile"][-1][1] == 500.0
    advice = picture["advice"]
    assert advice["do"] == "backup" and (advice["climb"], advice["altitude"]) == (2.5, 600.0)


def test_where_no_direction_is_free_a_free_climb_is():
    bands = guidance(range(72), region=3, recovery=30, **up_and_down(range(3, 7), region=3))
    bands.intruder_ids, bands.intruder_level, bands.intruder_loss = ["4b1a2c"], [3], [9.0]
    intruder = level_aircraft(5_000.0, 0.0, 0.0, 80.0)
    own = level_aircraft(0.0, 0.0, 0.0, 80.0, climb=0.5, id="own")
    advice = page_document(take(known_scene(intruder, own=own), GUIDANCE, bands, NOW), NOW)[
        "advice"
    ]
    assert advice["do"] == "free" and advice["turn"] == "hold" and advice["climb"] == 2.0
    bands.vertical_speed_region = [3] * 11
    advice = page_document(take(known_scene(intruder, own=own), GUIDANCE, bands, NOW), NOW)[
        "advice"
    ]
    assert advice["do"] == "recovery" and "climb" not in advice


def test_the_error_of_the_altitude_is_shown_where_it_is_measured():
    def error_of(**more: float) -> float | None:
        scene = take(known_scene(), STATUS, status(1, **more), NOW)
        return page_document(scene, NOW)["monitor"]["altitude_error"]

    assert error_of() is None
    assert error_of(altitude_error=0.0, altitude_error_limit=-1.0) is None
    assert error_of(altitude_error=-3.54, altitude_error_limit=25.0) == -3.5


def test_a_turn_is_drawn_as_long_as_its_course_is_known():
    """Circles of 6 deg/s, reported with and without an error of 3 m/s."""
    drawn = []
    for velocity_std in (0.0, 3.0):
        scene = known_scene()
        for second in range(6):
            now, angle = after(second), 0.1 * second
            x, y = 800.0 * math.sin(angle), 800.0 * (1.0 - math.cos(angle))
            flying = aircraft(
                x + 5_000.0, y, angle, 80.0, time=now, velocity_std=velocity_std, position_std=9.0
            )
            scene = take(scene, f"{PREFIX}traffic", flying, now)
        drawn.append(page_document(scene, after(5.0))["traffic"][0])
    exact, noisy = drawn
    assert exact["turn_deg"] > 5.0 and exact["turn_s"] == 15.0
    assert noisy["turn_deg"] > 3.0 and 0.0 < noisy["turn_s"] < 15.0


def test_a_plan_is_drawn_through_its_waypoints_and_over_its_times():
    drawn = page_document(take(known_scene(), PLAN, plan(), NOW), after(10.0))["plan"]
    line, point = drawn["line"], drawn["points"][0]
    assert line[-1][:2] == pytest.approx([point["x"], point["y"]], abs=0.2)
    times = [time for *_, time in line]
    assert times == sorted(times) and times[0] == pytest.approx(NOW / SECOND, abs=0.01)
    assert point["in"] == pytest.approx(62.5 - 10.0, abs=0.1)


@given(
    st.lists(
        st.tuples(
            st.sampled_from([1e-6, 0.1, 20.0, 1e8]),
            st.floats(-90.0, 90.0),
            st.floats(-180.0, 180.0),
            st.sampled_from([0.0, 80.0, 400.0]),
        ),
        min_size=1,
        max_size=4,
    )
)
def test_a_plan_that_nobody_can_fly_is_drawn_all_the_same(steps):
    """At any places and times, within a bounded number of points."""
    message, first, time = plan(), vars(plan().waypoints[0]), 0.0
    message.waypoints = []
    for number, (seconds, latitude, longitude, speed) in enumerate(steps):
        time += seconds
        more = {
            "index": number + 1,
            "latitude": latitude,
            "longitude": longitude,
            "ground_speed": speed,
            "time_of_arrival": stamp(NOW + round(time * SECOND) + number + 1),
        }
        message.waypoints.append(SimpleNamespace(**(first | more)))
    picture = page_document(take(known_scene(), PLAN, message, NOW), NOW)
    assert json.dumps(picture, allow_nan=False)
    assert len(picture["plan"]["points"]) == len(steps) and 2 <= len(picture["plan"]["line"]) <= 500


@pytest.mark.parametrize(
    ("name", "message", "says"),
    [
        (STATUS, status(separation=math.nan), "status.separation is nan"),
        (STATUS, status(state=9), "status.state is 9, expected an integer from 0 to 4"),
        (STATUS, SimpleNamespace(state=0), "status has no field header, expected rlcas_msgs"),
        (GUIDANCE, guidance(track_loss=[1.0]), "guidance.track_deg and its regions, losses"),
        (GUIDANCE, guidance(recovery=72), "guidance.recovery is 72"),
        (GUIDANCE, guidance(speed_region=[0, 0, 9]), "guidance.speed_region is 9"),
        (PLAN, SimpleNamespace(status=2), "trajectory.status is 2, expected 1"),
    ],
)
def test_a_message_that_cannot_be_used_is_named_and_changes_nothing(name, message, says):
    scene = take(take(known_scene(), STATUS, status(), NOW), GUIDANCE, guidance(), NOW)
    before = page_document(scene, NOW)
    picture = page_document(take(scene, name, message, NOW), NOW)
    texts = [entry["text"] for entry in picture["health"] if entry["level"] == 2]
    assert len(texts) == 1 and texts[0].startswith(says)
    differing = {key for key in before if before[key] != picture[key]}
    assert differing == {"health"}
    good = status() if name == STATUS else guidance() if name == GUIDANCE else plan()
    healed = page_document(take(take(scene, name, message, NOW), name, good, NOW), NOW)
    assert not [entry for entry in healed["health"] if entry["level"] == 2]


def test_a_receivers_reports_make_a_picture_without_ros():
    scene = take_report(DisplayScene(), Report("own", NOW, 47.0, 8.0, 60.0, 0.0), NOW, own=True)
    scene = take_report(scene, Report("4b1a2c", NOW, 47.1, 8.0, 0.0, -60.0), NOW)
    wrong = FieldError("adsb 4b0000.speed", "has not been received")
    wrong.sighting = Sighting("4b0000", NOW, (47.2, 8.0))
    scene = take_report(scene, wrong, NOW)
    picture = page_document(scene, NOW)
    assert [intruder["id"] for intruder in picture["traffic"]] == ["4b1a2c"]
    assert picture["traffic"][0]["y"] - picture["own"]["y"] == pytest.approx(11_119.0, abs=20.0)


@given(st.lists(st.sampled_from(sorted(INPUTS)), max_size=6), st.floats(0.0, 100.0))
def test_every_picture_is_plain_json(names: list[str], seconds: float):
    scene = known_scene(aircraft(5_000.0, 0.0, 0.0, 80.0, id="<b>'\"&"))
    for name in names:
        scene = take(scene, name, SimpleNamespace(), NOW)  # a message without any field
    text = json.dumps(page_document(scene, after(seconds)), allow_nan=False)
    assert json.loads(text)["version"] == VERSION


def test_names_of_the_inputs_are_those_of_the_graph():
    topics = pytest.importorskip("ros_bridge.transport.topics", reason="rclpy is not installed")
    for topic in topics.EVERY:
        if topic not in (topics.PATH, topics.MARKERS):
            package = topic.kind.__module__.split(".")[0]
            assert INPUTS[topic.name].kind == f"{package}/msg/{topic.kind.__name__}"


# The server.


def live(*traffic: Any) -> LiveSource:
    source = LiveSource(clock=lambda: NOW)
    source.scene = known_scene(*traffic)
    return source


def open_client(port: int, **more: Any) -> Any:
    return connect(f"ws://127.0.0.1:{port}/pictures", compression=None, **more)


def pictures(client: Any, count: int) -> list[dict[str, Any]]:
    return [json.loads(client.recv(timeout=10.0)) for _ in range(count)]


@pytest.mark.slow
def test_an_error_of_our_own_is_told_in_the_picture(monkeypatch: pytest.MonkeyPatch):
    """A picture that cannot be made is empty, not stale; the next one is whole again."""

    def fail(*_: Any) -> Any:
        raise ValueError("operands could not be broadcast together")

    source = live(aircraft(5_000.0, 0.0, 0.0, 80.0))
    with serving(source) as server, open_client(server.port) as client:
        _, first = pictures(client, 2)
        assert first["own"] and first["traffic"]
        with monkeypatch.context() as broken:
            broken.setattr("ros_bridge.display.server.draw", fail)
            pictures(client, 3)
            [failed] = pictures(client, 1)
        assert failed["own"] is None and failed["traffic"] == [] and failed["monitor"] is None
        assert failed["health"][0]["name"] == "display" and failed["health"][0]["level"] == 2
        assert "ValueError: operands" in failed["health"][0]["text"]
        source.feed(fail)
        pictures(client, 3)
        [picture] = pictures(client, 1)
        assert picture["traffic"]
        assert any("what was received failed" in entry["text"] for entry in picture["health"])


@pytest.mark.slow
def test_twenty_clients_get_pictures_and_what_one_sends_is_refused():
    source = live(aircraft(5_000.0, 0.0, 0.0, 80.0))
    with serving(source) as server, ExitStack() as stack:
        clients = [stack.enter_context(open_client(server.port)) for _ in range(20)]
        for client in clients:
            hello, first = pictures(client, 2)
            assert hello["type"] == "hello" and hello["live"]
            assert first["traffic"][0]["id"] == "4b1a2c"
        for sent, code in (("fly left", 1008), (b"\x00\xff", 1008), ("x" * 100_000, 1009)):
            client = clients.pop()
            client.send(sent)
            with pytest.raises(ConnectionClosed) as caught:
                pictures(client, 99)
            assert caught.value.rcvd.code == code
        assert any(
            "sent 'fly left', expected nothing: this display is read" in line
            for line in server.said
        )
        assert len([line for line in server.said if "expected nothing" in line]) == 2
        for client in clients:
            assert pictures(client, 2)


@pytest.mark.slow
def test_a_client_that_does_not_read_loses_pictures_and_nobody_else_does():
    crowd = [
        aircraft(500.0 * n, 9_000.0, 0.0, 80.0, id=f"{n:03d}-{'x' * 50}") for n in range(-100, 100)
    ]
    source = live(*crowd)
    with serving(source) as server:
        slow = socket.create_connection(("127.0.0.1", server.port))
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_096)
        slow.sendall(
            f"GET /pictures HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nUpgrade: websocket\r\n"
            "Connection: Upgrade\r\nSec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n"
            "Sec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        with open_client(server.port, max_size=None) as quick:
            received = 0
            while server.display.missed_pictures() < 5:  # the buffers of the system come first
                source.feed(lambda scene: scene)
                received += len(pictures(quick, 1))
                assert received < 2_000, "no picture was dropped"
        slow.close()


def test_only_four_files_are_served_and_only_to_this_machines_names():
    cases = [
        ("/", {}, 200),
        ("/airmap.js", {}, 200),
        ("/display.js?x=1", {}, 200),
        ("/../server.py", {}, 404),
        ("/page/index.html", {}, 404),
        ("/", {"Host": "evil.example"}, 403),
        ("/", {"Host": "[junk"}, 403),
        ("/", {"Host": "localhost:1"}, 200),
    ]
    with serving(live()) as server:
        for path, headers, code in cases:
            connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10.0)
            connection.request("GET", path, headers=headers)
            answer = connection.getresponse()
            assert answer.status == code, path
            assert answer.read()
            if code == 200:
                policy = answer.headers["Content-Security-Policy"]
                assert policy.startswith("default-src 'none'; script-src 'self';")
            connection.close()


def test_another_page_may_not_read_the_traffic():
    with serving(live()) as server:
        for origin in ("http://evil.example", "null", f"http://127.0.0.1:{server.port + 1}"):
            with pytest.raises(InvalidStatus) as caught, open_client(server.port, origin=origin):
                pass
            assert caught.value.response.status_code == 403
        with open_client(server.port, origin=server.url[:-1]) as client:
            assert pictures(client, 2)


def test_junk_instead_of_http_leaves_a_line_and_the_server():
    with serving(live()) as server:
        for junk in (b"\x16\x03\x01\x00\xff" * 40, b"GET / HTTP/1.1\r\n" + b"a" * 100_000, b""):
            with socket.create_connection(("127.0.0.1", server.port)) as item:
                item.sendall(junk)
        with open_client(server.port) as client:
            assert pictures(client, 2)
        end = time.monotonic() + 10.0
        while not server.said and time.monotonic() < end:
            time.sleep(0.05)
        assert server.said and all("\n" not in item for item in server.said)


# Recordings.


def encounter(folder: Path, **more: Any) -> Path:
    """Write an encounter of two aircraft that meet, 60 s, with bands that close after 20 s."""
    steps, count = 61, 72
    late = [step >= 20 for step in range(steps)]
    document = {
        "format": "rlcas-encounter",
        "version": 1,
        "name": "head_on 3",
        "dt": 1.0,
        "separation": 1_000.0,
        "goal_radius": 500.0,
        "goal": [8_000.0, 0.0],
        "own": {"x": [80.0 * n for n in range(steps)], "y": [0.0] * steps},
        "intruders": [{"x": [9_000.0 - 80.0 * n for n in range(steps)], "y": [100.0] * steps}],
        "plan": {"x": [0.0, 8_000.0], "y": [0.0, 0.0], "time": [0.0, 100.0]},
        "bands": {
            "look_ahead": 120.0,
            "track_deg": [5.0 * n for n in range(count)],
            "track_region": [[2 * is_late] * count for is_late in late],
            "speed": [50.0, 100.0],
            "speed_region": [[2 * is_late] * 2 for is_late in late],
            "level": [[2 * is_late] for is_late in late],
            "loss": [[40.0 if is_late else None] for is_late in late],
            "recovery": [[-1, None, 0.0] for _ in late],
        },
    }
    path = folder / "encounter.json"
    path.write_text(json.dumps(document | more), encoding="utf-8")
    return path


def test_an_encounter_is_shown_at_the_time_that_a_client_asks_for(tmp_path: Path):
    recording = read(encounter(tmp_path))
    assert recording.length == 60.0 and recording.marks == [(20.0, 2)]
    with serving(recording) as server, open_client(server.port) as client:
        hello = pictures(client, 1)[0]
        assert not hello["live"] and hello["length"] == 60.0
        for requested, shown_time, level in (
            (10.5, 10.5, 0),
            (59.0, 59.0, 2),
            (1e9, 60.0, 2),
            (-5, 0.0, 0),
        ):
            client.send(json.dumps({"time": requested}))
            picture = pictures(client, 1)[0]
            assert picture["at"] == shown_time and picture["own"]["x"] == pytest.approx(
                80.0 * shown_time
            )
            assert (
                max((drawn_alert["level"] for drawn_alert in picture["alerts"]), default=0) == level
            )
        client.send('{"time": true}')
        with pytest.raises(ConnectionClosed):
            pictures(client, 1)
        assert "expected a time" in server.said[0]


def test_an_encounter_in_a_wind_is_shown_with_its_speed_through_the_air(tmp_path: Path):
    calm = to_json(read(encounter(tmp_path)).player()(5.0))
    windy = to_json(read(encounter(tmp_path, wind=[20.0, 0.0])).player()(5.0))
    assert calm["wind"] is None and windy["wind"] == [20.0, 0.0]
    assert [picture["own"]["air"]["speed"] for picture in (calm, windy)] == [80.0, 60.0]
    assert windy["own"]["speed"] == 80.0 and windy["own"]["air"]["track_deg"] == 90.0
    with pytest.raises(InputError, match="is no whole encounter"):
        read(encounter(tmp_path, wind=[20.0]))


def test_an_encounters_intruder_has_its_own_separation(tmp_path: Path):
    path = encounter(tmp_path)
    assert to_json(read(path).player()(5.0))["traffic"][0]["separation"] is None
    document = json.loads(path.read_text(encoding="utf-8"))
    for separation in (2_500.0, math.nan):
        document["intruders"][0]["separation"] = separation
        path.write_text(json.dumps(document), encoding="utf-8")
        if math.isfinite(separation):
            assert to_json(read(path).player()(5.0))["traffic"][0]["separation"] == separation
    with pytest.raises(InputError, match="is no whole encounter"):
        read(path)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("{", "is no encounter"),
        ('{"format": "rlcas-encounter", "version": 2}', "is no encounter"),
        ('{"format": "rlcas-encounter", "version": 1}', "is no whole encounter"),
        ("[1]", "is no encounter"),
    ],
)
def test_a_file_that_is_no_encounter_is_refused_in_a_sentence(tmp_path: Path, content, says):
    path = tmp_path / "x.json"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=says):
        read(path)


@pytest.mark.parametrize(
    "wrong",
    [
        {"separation": math.nan},
        {"dt": 1e308},
        {"goal": [0.0, 10**400]},
        {"areas": [{"name": "a", "velocity": [1e308, 0.0], "rings": [], "clearance": math.inf}]},
        {"bands": {"level": [[2]], "track_region": [[0], None]}},
    ],
)
def test_an_encounter_that_no_page_can_draw_is_refused_when_it_is_read(tmp_path: Path, wrong: dict):
    with pytest.raises(InputError, match="is no whole encounter"):
        read(encounter(tmp_path, **wrong))


def test_a_file_that_is_no_recording_is_refused_in_a_sentence(tmp_path: Path):
    pytest.importorskip("mcap.reader", reason="mcap is not installed; to have it: make ros")
    pytest.importorskip("mcap_ros2.decoder", reason="mcap-ros2-support is not installed")
    path = tmp_path / "x.mcap"
    for content in (b"", b"no recording", b"\x89MCAP0\r\n" + b"\x00" * 50):
        path.write_bytes(content)
        with pytest.raises(InputError, match="is no whole MCAP file"):
            read(path)


def record_graph(path: Path) -> None:
    writer = pytest.importorskip("mcap_ros2.writer", reason="mcap-ros2-support is not installed")
    with path.open("wb") as stream:
        mcap = writer.Writer(stream)
        text = mcap.register_msgdef("std_msgs/msg/String", "string data")
        clock = mcap.register_msgdef(
            "rosgraph_msgs/msg/Clock",
            "builtin_interfaces/Time clock\n" + "=" * 80 + "\nMSG: builtin_interfaces/Time\n"
            "int32 sec\nuint32 nanosec",
        )
        for n in range(3):
            times = {"log_time": n * SECOND, "publish_time": n * SECOND}
            tick = {"clock": {"sec": 1_000 + n, "nanosec": 0}}
            mcap.write_message(topic="/clock", schema=clock, message=tick, **times)
            for topic in ("/chatter", "/rlcas_runner/input/ownship"):
                mcap.write_message(topic=topic, schema=text, message={"data": "<b>"}, **times)
        mcap.finish()


def test_a_cut_recording_shows_what_is_whole_and_says_where_it_ends(tmp_path: Path):
    path = tmp_path / "x.mcap"
    growing = pytest.importorskip("ros_bridge.transport.mcap_file", reason="mcap is not installed")
    mcap = growing.McapFile(path)
    definition = "builtin_interfaces/Time clock\n" + "=" * 80
    definition += "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec"
    channel = mcap.channel("/clock", "rosgraph_msgs/msg/Clock", definition)
    lengths = []
    for second in range(4):
        data = b"\x00\x01\x00\x00" + (1_000 + second).to_bytes(4, "little") + bytes(4)
        mcap.write(channel, data, second * SECOND)
        mcap.flush()
        lengths.append(path.stat().st_size)
    mcap.close()
    assert read(path).length == 3.0
    assert read(path).cut == ""
    content = path.read_bytes()
    for size, seconds in zip(lengths, range(4), strict=True):
        path.write_bytes(content[:size])  # no end as it belongs there
        recording = read(path)
        assert recording.length == float(seconds)
        if seconds < 3:
            assert recording.cut == f"x.mcap is cut or damaged {seconds:.1f} s after its start"
            health = to_json(recording.player()(recording.length))["health"]
            assert recording.cut in [entry["text"] for entry in health]


def test_a_damaged_recording_is_refused_in_a_sentence_or_shown(tmp_path: Path):
    path = tmp_path / "x.mcap"
    record_graph(path)
    content = path.read_bytes()
    for place in range(0, len(content), 7):
        for damaged in (
            content[:place],
            content[:place] + b"\xff" + content[place + 1 :],
            content[:place] + b"\x00" + content[place:],
        ):
            path.write_bytes(damaged)
            try:
                recording = read(path)
            except InputError as error:
                assert len(str(error).splitlines()) == 1
            else:
                recording.player()(recording.length)


def test_unknown_topics_and_bytes_of_a_recording_are_named(tmp_path: Path):
    path = tmp_path / "x.mcap"
    record_graph(path)
    recording = read(path)
    texts = {entry["name"]: entry["text"] for entry in to_json(recording.player()(2.0))["health"]}
    assert texts["/chatter"] == "std_msgs/msg/String is not shown"
    assert texts["/rlcas_runner/input/ownship"] == "std_msgs/msg/String is not shown"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["/nowhere.mcap"], "does not exist"),
        (["--adsb", "ftp://x"], "expected tcp://HOST:30003"),
        (["--adsb", "tcp://x:1", "flight.mcap"], "are both given"),
        (["--own", "4b1a2c"], "--own goes with --adsb"),
        (["--centre", "91,0"], "expected latitude and longitude"),
        (["--port", "70000"], "expected a port"),
        (["--separation", "nan"], "expected metres"),
        (["flight.mcap", "--ros-args"], "goes with the ROS graph only"),
    ],
)
def test_bad_arguments_are_refused_in_a_sentence(arguments: list[str], says: str):
    with pytest.raises(InputError, match=re.escape(says)):
        main(arguments)


def test_a_port_that_is_taken_is_refused(tmp_path: Path):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = str(listener.getsockname()[1])
        with pytest.raises(InputError, match=f"--port {port} cannot be used"):
            main([str(encounter(tmp_path)), "--port", port])


def test_stamps_are_not_made_up():
    """A report without a time is refused as everywhere."""
    message = aircraft(5_000.0, 0.0, 0.0, 80.0)
    message.header.stamp = stamp(0)
    picture = page_document(known_scene(message), NOW)
    assert picture["traffic"] == []


def test_in_a_wind_bands_are_compared_with_the_direction_through_the_air():
    """Over the ground it flies east at 80 m/s; in 80 m/s of southerly wind it points south-east."""
    own = aircraft(
        0.0, 0.0, 0.0, 80.0, id="own", valid=0xC5 | 32, wind=SimpleNamespace(x=0.0, y=80.0, z=0.0)
    )
    bands = guidance(range(18, 28))  # tracks 90 to 135: what it points at is closed
    bands.intruder_ids, bands.intruder_level, bands.intruder_loss = ["4b1a2c"], [2], [30.0]
    scene = take(known_scene(aircraft(5_000.0, 0.0, 0.0, 80.0), own=own), GUIDANCE, bands, NOW)
    picture = page_document(scene, NOW)
    assert picture["own"]["air"]["track_deg"] == pytest.approx(135.0, abs=0.1)
    assert picture["advice"]["turn"] == "right" and picture["advice"]["track_deg"] == 140.0


def test_aircraft_have_the_separation_of_their_category():
    def diagnostics(text: str) -> Any:
        values = [SimpleNamespace(key=BY_CATEGORY, value=text)]
        node = SimpleNamespace(level=b"\0", name="runner", message="ready", values=values)
        return SimpleNamespace(status=[node])

    heavy = aircraft(5_000.0, 0.0, 0.0, 80.0, id="a", category=5)
    scene = known_scene(heavy, aircraft(0.0, 5_000.0, 0.0, 80.0, id="b"))
    scene = take(scene, "/diagnostics", diagnostics("A5:2500,B6:300"), NOW)
    assert [entry["separation"] for entry in page_document(scene, NOW)["traffic"]] == [
        2_500.0,
        None,
    ]
    wrong = page_document(take(scene, "/diagnostics", diagnostics("A5:no"), NOW), NOW)
    assert [entry["separation"] for entry in wrong["traffic"]] == [2_500.0, None]
    assert any("holds 'A5:no', expected" in entry["text"] for entry in wrong["health"])
    assert (
        page_document(take(scene, "/diagnostics", diagnostics(""), NOW), NOW)["traffic"][0][
            "separation"
        ]
        is None
    )


def test_areas_move_to_the_time_of_the_picture_and_say_when_they_hold():
    circle = area(valid=2 | 8, radius=2_000.0)  # ceiling, until
    message = areas(circle)
    scene = take(known_scene(), f"{PREFIX}areas", message, NOW)
    before, later = (page_document(scene, after(seconds))["areas"][0] for seconds in (0.0, 30.0))
    assert before["name"] == "<i>storm" and before["keep"] == "out"
    assert before["floor"] is None and before["ceiling"] == [3_000.0, "msl"]
    moved = [b - a for a, b in zip(before["circle"], later["circle"], strict=True)]
    assert moved == pytest.approx([300.0, 0.0, 150.0], abs=0.2)
    assert later["valid"] and not page_document(scene, after(61.0))["areas"][0]["valid"]
    circle.radius = math.nan
    picture = page_document(take(scene, f"{PREFIX}areas", message, NOW), NOW)
    assert "areas.areas[0].radius is nan" in next(
        entry["text"] for entry in picture["health"] if entry["name"] == "areas"
    )
    assert picture["areas"] == page_document(scene, NOW)["areas"]


def test_a_polygon_says_by_how_much_it_has_grown():
    ring = [(2_000.0, 0.0), (4_000.0, 0.0), (4_000.0, 3_000.0)]
    scene = take(known_scene(), f"{PREFIX}areas", areas(area(ring, growth=-2.0)), NOW)
    before, later = (page_document(scene, after(seconds))["areas"][0] for seconds in (0.0, 30.0))
    assert (before["grown"], later["grown"], later["growth"]) == (0.0, -60.0, -2.0)
    moved = np.subtract(later["rings"], before["rings"])
    np.testing.assert_allclose(moved, np.broadcast_to((300.0, 0.0), moved.shape), atol=0.2)
