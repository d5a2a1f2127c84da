"""What the MAVLink program knows, as a picture: from pymavlink's own messages, without a
simulation."""

import argparse
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

pytest.importorskip("pymavlink", reason="the extra mavlink is not installed")
pytest.importorskip("websockets", reason="websockets is not installed")

from pymavlink.dialects.v20 import ardupilotmega as dialect

from commands.command import InputError
from envs.formats.areas.geodetic import GeodeticArea
from envs.formats.local_frame import LocalFrame
from ros_bridge.core.aircraft import load_policy
from ros_bridge.core.categories import Categories
from ros_bridge.core.fields import SECOND
from ros_bridge.core.reports import Report, Unknown
from ros_bridge.core.situation import Situation
from ros_bridge.display.document import to_json
from ros_bridge.display.scene import DisplayScene, take_report
from ros_bridge.display.server import LiveSource
from ros_bridge.mavlink import mission
from ros_bridge.mavlink.adapter import SceneAdapter, show
from ros_bridge.mavlink.control import Control
from ros_bridge.mavlink.course import Course
from ros_bridge.mavlink.intake import Reading, Received, take
from ros_bridge.mavlink.judging import Judgement, Question, Rules, answer, rules
from ros_bridge.mavlink.mission import Item
from ros_bridge.mavlink.options import options_of
from ros_bridge.mavlink.plan_file import geojson, kml
from ros_bridge.mavlink.vehicle import vehicle_of
from ros_bridge.mavlink.view import View
from tests.ros_bridge.displays import page_document
from tests.ros_bridge.test_mavlink import PARAMETERS

HOME = LocalFrame(47.4, 8.5)
READING = Reading({1: "msl"})
SPEED = 22.0  # m/s, of the ownship, which flies east
PLACES = ((1, 0.0), (2, 5_000.0), (3, 9_000.0))  # numbers of items, and m east
ITEMS = tuple(
    Item(number, 16, float(at.latitude), float(at.longitude), 100.0)
    for number, at in ((number, HOME.geodetic(x, 0.0)) for number, x in PLACES)
)


@pytest.fixture(scope="module")
def followed() -> Rules:
    """Return the rules of a small aircraft."""
    aircraft = vehicle_of(PARAMETERS, 200.0).aircraft
    return rules(
        aircraft,
        load_policy("").for_aircraft(aircraft),
        margin=25.0,
        vertical=600.0,
        unknown=Unknown(5.0, 0.2, 1.0, 0.2),
        deadline=20.0,
    )


def received(seconds: float, *, wind: float = 0.0, crossing: bool = True) -> Received:
    """Return what is known on the mission, of a fence that is a circle, and of an aircraft that
    comes from the right.
    """
    fence = (GeodeticArea("fence item 1", centre=(47.42, 8.53), radius=300.0, name="fence 1"),)
    heard = Received(Situation(fixed_areas=fence))
    now = round((10.0 + seconds) * SECOND)
    boot = now // 1_000_000
    fields = {"heading": 0, "hor_velocity": 2_000, "ver_velocity": 0, "callsign": b"ABC"}
    messages = [
        dialect.MAVLink_heartbeat_message(1, 3, 0x80, 10, 4, 3),
        dialect.MAVLink_wind_message(270.0, wind, 0.0),
        dialect.MAVLink_mission_current_message(2),
        dialect.MAVLink_global_position_int_message(
            boot, *_place(SPEED * seconds, 0.0), 600_000, 100_000, 0, round(100 * SPEED), 0, 9_000
        ),
    ]
    if crossing:
        place = _place(SPEED * 40.0, -20.0 * (40.0 - seconds))
        messages.append(
            dialect.MAVLink_adsb_vehicle_message(
                0xABC123, *place, 1, 600_000, **fields, emitter_type=1, tslc=0, flags=0x8F, squawk=0
            )
        )
    for message in messages:
        heard = take(heard, message, now, READING)
    return heard


def _place(x: float, y: float) -> tuple[int, int]:
    at = HOME.geodetic(x, y)
    return round(1e7 * float(at.latitude)), round(1e7 * float(at.longitude))


def view(heard: Received, judgement: Judgement) -> View:
    """Return what the program knows, while it only advises."""
    assert heard.situation.own.last is not None
    return View(heard.situation.own.last.time, heard, judgement, Control(), ITEMS)


def judge(heard: Received, followed: Rules) -> Judgement:
    """Return what the program makes of it."""
    assert heard.situation.own.last is not None
    route = mission.route(ITEMS[0].place, mission.remaining_items(ITEMS, heard.current), 800.0)
    fresh, now = Judgement(followed.begin()), heard.situation.own.last.time
    course = Course(route, (route,))
    return answer(Question(fresh, heard.situation, course, now, flown=False), followed)


@pytest.mark.parametrize("aside", [0.0, 600.0])
def test_a_fence_across_the_mission_is_flown_round_and_back(followed: Rules, aside: float) -> None:
    """Without traffic; beside the mission it is none of its business."""
    at = HOME.geodetic(SPEED * 30.0, aside)
    fence = (
        GeodeticArea("f", centre=(float(at.latitude), float(at.longitude)), radius=150.0, name="f"),
    )
    heard = received(5.0, crossing=False)
    heard = replace(heard, situation=replace(heard.situation, fixed_areas=fence))
    judgement = judge(heard, followed)
    if aside:
        assert judgement.conflict is None and judgement.problem == ""
        return
    assert judgement.conflict is not None and judgement.conflict.name == "f"
    distance_kept = 150.0 + followed.settings.options.requirement.margin
    assert judgement.conflict.time == pytest.approx(25.0 - distance_kept / SPEED, abs=1.0)
    assert judgement.safe and judgement.rejoin is not None
    published = judgement.supervision.published_plan
    assert published is not None and published.points[-1].time >= judgement.rejoin.time
    # It is handed back at a point of the mission, not at one round the fence.
    assert judgement.rejoin.point is not None
    time_to_rejoin = (judgement.rejoin.time - published.began) / SECOND
    assert (
        time_to_rejoin
        > judgement.conflict.time + 300.0 / followed.settings.options.limits.speed_max
    )


def test_a_conflict_on_the_mission_is_shown_with_its_plan_bands_and_fence(followed: Rules) -> None:
    heard = received(5.0)
    judgement = judge(heard, followed)
    assert judgement.safe and judgement.conflict is not None
    seen_view = view(heard, judgement)
    adapter = SceneAdapter(followed, LiveSource().feed)
    scene = adapter.after(DisplayScene(), seen_view)
    picture = page_document(scene, seen_view.time)
    assert picture["plan"]["revision"] == 1
    assert picture["advice"]["do"] == "advised"
    assert any("on the mission" in why for why in picture["monitor"]["reasons"])
    east = picture["bands"]["track_deg"].index(90.0)
    assert picture["bands"]["track_region"][east] > 0
    assert [entry["id"] for entry in picture["alerts"]] == ["abc123"]
    assert picture["alerts"][0]["loss"] == pytest.approx(judgement.conflict.time, abs=2.0)
    assert [area["name"] for area in picture["areas"]] == ["fence 1"]
    assert adapter.after(scene, seen_view).areas is scene.areas, "the fence is placed once"
    bare = replace(heard, situation=replace(heard.situation, fixed_areas=()))
    assert adapter.after(scene, view(bare, judgement)).areas is None
    assert len(picture["route"]) == 3
    assert {entry["name"]: entry["text"] for entry in picture["health"]}[
        "autopilot"
    ] == "AUTO, armed"


def test_in_a_wind_bands_are_those_of_the_air_that_is_flown_in(followed: Rules) -> None:
    adapter = SceneAdapter(followed, LiveSource().feed)
    scene = DisplayScene()
    for seconds, wind in ((0.0, 0.0), (2.0, 8.0)):
        seen_view = view(
            received(seconds, wind=wind), judge(received(seconds, crossing=False), followed)
        )
        scene = adapter.after(scene, seen_view)
        picture = page_document(scene, seen_view.time)
        assert picture["wind"] == ([0.0, 0.0] if wind == 0.0 else [8.0, 0.0])
        # The ownship flies 22 m/s over the ground: as fast as that less the tail wind.
        assert picture["own"]["air"]["speed"] == pytest.approx(SPEED - wind, abs=0.1)
        assert picture["bands"] is not None


def test_without_traffic_nothing_is_closed_and_the_mission_is_flown(followed: Rules) -> None:
    heard = received(0.0, crossing=False)
    seen_view = view(heard, judge(heard, followed))
    picture = page_document(
        SceneAdapter(followed, LiveSource().feed).after(DisplayScene(), seen_view), seen_view.time
    )
    assert picture["plan"] is None and picture["alerts"] == []
    assert not any(picture["bands"]["track_region"])
    assert picture["advice"] == {"do": "own route"}


@pytest.mark.parametrize("address", ["8642", "host:", "127.0.0.1:99999", "127.0.0.1:x"])
def test_an_address_that_cannot_be_is_refused_in_a_sentence(address: str, followed: Rules) -> None:
    with pytest.raises(InputError, match="expected HOST:PORT"):
        show(address, "a test", followed, lambda: 0, lambda _: None)


def test_the_display_is_asked_for_by_an_option() -> None:
    def parse(*more: str) -> argparse.Namespace:
        return options_of(["--connect", "udp:127.0.0.1:14550", *more])

    assert parse().display is None
    assert parse("--display").display == "127.0.0.1:8642"
    assert parse("--display", "0.0.0.0:80").display == "0.0.0.0:80"


def test_a_recording_without_ros_shows_what_the_display_showed(
    followed: Rules, tmp_path: Path
) -> None:
    pytest.importorskip("mcap_ros2", reason="the extra display is not installed")
    from ros_bridge.display.recording import GraphRecording
    from ros_bridge.display.scene_recording import RecordingError, SceneRecorder

    file, live = tmp_path / "flight.mcap", LiveSource()
    recorder = SceneRecorder(file)
    light = replace(followed.settings, categories=Categories({1: 400.0}))
    followed = followed._replace(settings=light)
    adapters = [SceneAdapter(followed, feed) for feed in (recorder.feed, live.feed)]
    pictures = []
    for seconds in (0.0, 5.0, 5.5):
        heard = received(seconds, wind=3.0)
        seen_view = view(heard, judge(heard, followed))
        for adapter in adapters:
            adapter(seen_view)
        pictures.append(page_document(live.scene, seen_view.time))
    assert [intruder["separation"] for intruder in pictures[-1]["traffic"]] == [400.0]
    recorder.close()
    again = GraphRecording(file).player()
    for at, before in zip((0.0, 5.0, 5.5), pictures, strict=True):
        after = to_json(again(at))
        fields = (
            "own",
            "traffic",
            "separation",
            "wind",
            "plan",
            "areas",
            "bands",
            "alerts",
            "route",
        )
        for name in (*fields, "monitor", "advice", "time"):
            assert after[name] == before[name], name
    with pytest.raises(RecordingError, match="exists already"):
        SceneRecorder(file)


def test_a_plan_is_a_line_for_ground_stations_and_for_map_programs(followed: Rules) -> None:
    published = judge(received(5.0), followed).supervision.published_plan
    assert published is not None
    expected = [
        [plan_point.longitude, plan_point.latitude]
        for plan_point in (published.start, *published.points)
    ]
    assert json.loads(geojson(published))["geometry"]["coordinates"] == expected
    coordinates = ElementTree.fromstring(kml(published)).findtext(".//{*}LineString/{*}coordinates")
    assert coordinates is not None
    places = [[float(number) for number in place.split(",")] for place in coordinates.split()]
    np.testing.assert_allclose(places, expected, rtol=0.0, atol=1e-7)


@pytest.mark.parametrize("longitude", [179.99, -179.99])
def test_a_plan_over_the_antimeridian_is_cut_there(followed: Rules, longitude: float) -> None:
    published = judge(received(5.0), followed).supervision.published_plan
    assert published is not None

    def moved(item: Any) -> Any:
        east = longitude + (item.longitude - published.start.longitude)
        return replace(item, longitude=math.remainder(east, 360.0))

    turned = published._replace(
        start=moved(published.start), points=tuple(moved(item) for item in published.points)
    )
    places = [[item.longitude, item.latitude] for item in (turned.start, *turned.points)]
    shape = json.loads(geojson(turned))["geometry"]
    lines = [shape["coordinates"]] if shape["type"] == "LineString" else shape["coordinates"]
    assert (len(lines) > 1) == (longitude > 0.0)
    kml_lines = [
        [[float(number) for number in place.split(",")] for place in (item.text or "").split()]
        for item in ElementTree.fromstring(kml(turned)).iterfind(".//{*}coordinates")
    ]
    for both_lines in (lines, kml_lines):
        for line in both_lines:
            assert np.abs(np.diff(np.array(line)[:, 0])).max() < 1.0
        inner = [place for line in both_lines for place in line if abs(place[0]) < 180.0]
        np.testing.assert_allclose(inner, places, rtol=0.0, atol=1e-7)


@pytest.mark.parametrize("latitude", [0.0, -45.0, 70.0])
def test_the_map_is_the_same_on_both_sides_of_the_antimeridian(latitude: float) -> None:
    for longitude in (179.9999, -179.9999, 180.0):
        own = Report("ownship", SECOND, latitude, longitude, 20.0, 0.0)
        origin = page_document(take_report(DisplayScene(), own, SECOND, own=True), SECOND)[
            "origin"
        ][1]
        assert -180.0 <= origin <= 180.0
        assert abs(math.remainder(longitude - origin, 360.0)) < 0.5


@pytest.mark.filterwarnings("ignore:module 'sre_.*' is deprecated")  # of ROS's parser
def test_messages_of_a_recording_are_those_of_the_graph() -> None:
    pytest.importorskip("rclpy", reason="ROS is not installed")
    from rclpy.serialization import deserialize_message
    from rlcas_msgs.msg import AircraftState

    from ros_bridge.core import message_fields
    from ros_bridge.display import scene_messages
    from ros_bridge.display.scene import INPUTS
    from ros_bridge.display.scene_recording import encoder
    from ros_bridge.transport.messages import aircraft_message
    from ros_bridge.transport.recording import definition

    for item in INPUTS.values():
        ours, theirs = scene_messages.definition(item.kind), definition(item.kind)
        assert _fields(ours) == _fields(theirs)
    kind = "rlcas_msgs/msg/AircraftState"
    encode = encoder(kind, scene_messages.definition(kind))
    tracks = received(3.0, wind=2.0).situation
    for track in (tracks.own, *tracks.traffic.values()):
        assert track.last is not None
        for item in (track.last, track.last.sighting):
            read = deserialize_message(encode(message_fields.aircraft(item)), AircraftState)
            assert read == aircraft_message(item)


def _fields(definition: str) -> dict[str, list[list[str]]]:
    """Return types and names of the fields of each part of a definition, without constants."""
    fields_of: dict[str, list[list[str]]] = {"": []}
    name = ""
    for line in definition.splitlines():
        words = line.partition("#")[0].split()
        if words[:1] == ["MSG:"]:
            name = words[1]
            fields_of[name] = []
        elif len(words) > 1 and "=" not in line.partition("#")[0]:
            fields_of[name].append(words[:2])
    # The definitions of ROS leave out what every reader knows.
    fields_of.pop("builtin_interfaces/Time", None)
    return fields_of
