"""MAVLink's messages, missions and parameters as domain values, and who flies: with pymavlink's own
messages, packed and parsed in both versions of the protocol."""

import importlib
import itertools
import math
import os
import pty
import socket
import time
import tty
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("pymavlink", reason="the extra mavlink is not installed")

from agents.policy.inference import Policy
from commands.command import ConfigError, InputError
from envs.areas import Keep
from envs.formats.local_frame import distance
from ros_bridge.core.categories import Categories
from ros_bridge.core.conversions import Route
from ros_bridge.core.fields import SECOND, FieldError
from ros_bridge.core.reports import USUAL, Report, Unknown
from ros_bridge.core.situation import Situation
from ros_bridge.mavlink import demo, messages, mission, sitl, vehicle
from ros_bridge.mavlink.control import (
    CLEAR,
    CROSSING,
    Control,
    Observation,
    Order,
    Phase,
    Step,
    begin_anew,
    step,
)
from ros_bridge.mavlink.course import Course
from ros_bridge.mavlink.download import AGAIN, Download, accept, due, note_question
from ros_bridge.mavlink.intake import Reading, Received, failsafe_acted, take
from ros_bridge.mavlink.judging import Judgement, Question, Rules, answer, rules
from ros_bridge.mavlink.link import Clock, Link
from ros_bridge.mavlink.messages import Mode
from ros_bridge.mavlink.mission import SUB, Item
from ros_bridge.mavlink.options import options_of, rules_of
from ros_bridge.mavlink.program import main, separation_lines
from ros_bridge.mavlink.sitl import Sitl

READING = Reading({})
PARAMETERS = {
    "AIRSPEED_MIN": 10.0,
    "AIRSPEED_MAX": 30.0,
    "ROLL_LIMIT_DEG": 65.0,
    "TECS_CLMB_MAX": 5.0,
    "TECS_SINK_MIN": 2.0,
}


@pytest.fixture(params=["v10", "v20"])
def wire(request: pytest.FixtureRequest) -> Callable[..., Any]:
    """Return a function that sends a message of a version over a wire of bytes."""
    dialect = importlib.import_module(f"pymavlink.dialects.{request.param}.ardupilotmega")

    def send(name: str, **fields: Any) -> Any:
        sender, receiver = dialect.MAVLink(None, 1, 1), dialect.MAVLink(None)
        kind = getattr(dialect, f"MAVLink_{name.lower()}_message")
        message = kind(**fields)
        (parsed,) = receiver.parse_buffer(message.pack(sender))
        return parsed

    return send


def position(wire: Callable[..., Any], **changes: Any) -> Any:
    """Return a GLOBAL_POSITION_INT."""
    usual = {"time_boot_ms": 12_345, "lat": 474_000_000, "lon": 85_000_000, "alt": 600_000}
    usual |= {"relative_alt": 100_000, "vx": 300, "vy": -400, "vz": -150, "hdg": 0}
    return wire("GLOBAL_POSITION_INT", **(usual | changes))


def vehicle_message(wire: Callable[..., Any], **changes: Any) -> Any:
    """Return an ADSB_VEHICLE with every flag of a field that is read."""
    usual: dict[str, Any] = {"ICAO_address": 0xABC123, "lat": 474_000_000, "lon": 85_000_000}
    usual |= {"altitude_type": 1, "altitude": 650_000, "heading": 9_000, "hor_velocity": 3_000}
    usual |= {"ver_velocity": 200, "callsign": b"ABC", "emitter_type": 14, "tslc": 2}
    usual |= {"flags": 0x8F, "squawk": 0}
    return wire("ADSB_VEHICLE", **(usual | changes))


def test_the_own_state_keeps_place_velocity_and_the_autopilots_time(wire: Any) -> None:
    report = messages.ownship(position(wire), (1.0, 2.0), 5.0)
    assert report.place == pytest.approx((47.4, 8.5))
    assert (report.east, report.north) == pytest.approx((-4.0, 3.0))
    assert report.altitude is not None
    assert (report.altitude.value, report.altitude.vertical_speed) == pytest.approx((600.0, 1.5))
    assert (report.time, report.wind) == (12_345 * SECOND // 1000, (1.0, 2.0))


@pytest.mark.parametrize("bad", [{"lat": 2**31 - 1}, {"alt": 2**31 - 1}])
def test_a_place_that_there_is_not_is_refused_by_its_field(wire: Any, bad: dict[str, int]) -> None:
    with pytest.raises(FieldError, match=f"ownship.{'latitude' if 'lat' in bad else 'altitude'}"):
        messages.ownship(position(wire, **bad))


@given(st.floats(0.0, 60.0), st.floats(-180.0, 360.0))
def test_the_winds_velocity_points_away_from_where_it_comes_from(
    speed: float, direction: float
) -> None:
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    east, north = messages.wind(dialect.MAVLink_wind_message(direction, speed, 0.0))
    away = math.radians(direction + 180.0)
    assert (east, north) == pytest.approx(
        (speed * math.sin(away), speed * math.cos(away)), abs=1e-9
    )


def test_an_aircrafts_report_is_as_old_as_its_last_communication(wire: Any) -> None:
    report = messages.traffic(vehicle_message(wire), 100 * SECOND, {1: "msl"})
    assert isinstance(report, Report)
    assert report.time == 98 * SECOND
    assert (report.east, report.north) == pytest.approx((30.0, 0.0), abs=1e-9)
    assert report.position_std is None
    assert report.altitude is not None
    assert (report.altitude.value, report.altitude.vertical_speed) == (650.0, 2.0)


def test_what_an_aircrafts_flags_do_not_vouch_for_is_unknown(wire: Any) -> None:
    without_height = messages.traffic(vehicle_message(wire, flags=0x8D), 100 * SECOND, {1: "msl"})
    without_climb = messages.traffic(vehicle_message(wire, flags=0x0F), 100 * SECOND, {1: "msl"})
    of_unknown_reference = messages.traffic(vehicle_message(wire), 100 * SECOND)
    assert without_height is not None
    assert without_height.altitude is None
    assert without_climb is not None
    assert without_climb.altitude is not None
    assert without_climb.altitude.vertical_speed is None
    assert of_unknown_reference is not None
    assert of_unknown_reference.altitude is None


@pytest.mark.parametrize("bit", [1, 4, 8])
def test_an_aircraft_without_place_heading_or_velocity_is_a_fault_and_not_forgotten(
    wire: Any, bit: int
) -> None:
    message = vehicle_message(wire, flags=0x8F & ~bit)
    received = take(Received(), message, 100 * SECOND, READING)
    (track,) = received.situation.traffic.values()
    assert track.fault is not None
    assert "adsb.flags" in track.fault.field


STANDING = {"hor_velocity": 500, "ver_velocity": 0, "altitude": 400_000}


@pytest.mark.parametrize("kind", [17, 18])
def test_surface_vehicles_on_the_ground_are_no_traffic_and_counted(wire: Any, kind: int) -> None:
    received = take(Received(), position(wire), SECOND, READING)
    message = vehicle_message(wire, emitter_type=kind, **STANDING)
    received = take(received, message, 13 * SECOND, READING)
    assert not received.situation.traffic
    assert list(received.left_out.values()) == [1]


@pytest.mark.parametrize(
    ("kind", "changes"),
    [
        (18, {"hor_velocity": 3_000}),  # cm/s
        (17, {"ver_velocity": -325}),
        (17, {"altitude": 6_000_000}),  # mm; no airfield is so high
        (18, {"altitude": 590_000}),  # as high as the ownship
        (19, {}),  # a tethered balloon
    ],
)
def test_a_type_that_height_or_speed_contradict_removes_no_aircraft(
    wire: Any, kind: int, changes: dict[str, int]
) -> None:
    reading = Reading({1: "msl"})
    received = take(Received(), position(wire, vx=2_000), 12_345_000_000, reading)
    message = vehicle_message(wire, emitter_type=kind, **(STANDING | changes))
    received = take(received, message, 13 * SECOND, reading)
    assert list(received.situation.traffic) == ["abc123"]
    assert not received.left_out


@pytest.mark.parametrize(
    ("flags", "problem"),
    [(831, ""), (831 | 128, "constant"), (831 & ~16, "absolute"), (1024, "begun")],
)
def test_an_estimate_without_a_position_stops_planning(wire: Any, flags: int, problem: str) -> None:
    spread = dict.fromkeys(
        ("velocity_variance", "pos_horiz_variance", "pos_vert_variance", "compass_variance"), 0.1
    )
    message = wire("EKF_STATUS_REPORT", flags=flags, terrain_alt_variance=0.0, **spread)
    assert problem in messages.estimate_problem(message)
    received = take(Received(), message, SECOND, READING)
    received = take(received, position(wire), 13 * SECOND, READING)
    assert (received.situation.own.fault is None) == (problem == "")


def test_a_clock_follows_the_quickest_message_and_begins_anew_with_the_autopilot() -> None:
    clock = Clock()
    assert clock.now(5.0) == 0
    clock.hear(10 * SECOND, 100.0)
    clock.hear(11 * SECOND, 101.4)  # late by 0.4 s
    assert clock.now(102.0) == pytest.approx(12 * SECOND, abs=SECOND // 100)
    assert clock.hear(SECOND // 2, 103.0)
    assert clock.now(103.5) == pytest.approx(SECOND, abs=SECOND // 100)


def test_every_mode_of_the_autopilot_has_its_name() -> None:
    """But for numbers that ArduPlane does not have, by pymavlink's own list."""
    mavutil = importlib.import_module("pymavlink.mavutil")
    for number, name in mavutil.mode_mapping_apm.items():
        assert messages.mode_name(number).replace("_", "") == name.replace("_", "")
    assert messages.mode_name(9) == "mode 9"


@pytest.mark.parametrize("speed", [1.0, 6.0])
def test_a_clock_knows_how_fast_a_simulation_runs(speed: float) -> None:
    clock = Clock(simulated=True)
    for tenth in range(100):
        clock.hear(round(0.1 * tenth * speed * SECOND), 50.0 + 0.1 * tenth)
    assert clock.speed == pytest.approx(speed, rel=1e-6)


@given(st.lists(st.tuples(st.floats(0.01, 2.0), st.floats(0.0, 1.0)), max_size=20))
def test_a_clock_never_goes_back(steps: list[tuple[float, float]]) -> None:
    clock, ours, arrived, last = Clock(), 0.0, 0.0, 0
    for seconds, late in steps:
        ours += seconds
        arrived = max(arrived, ours + late)  # in their order
        clock.hear(round((ours + 7.0) * SECOND), arrived)
        now = clock.now(arrived)
        assert now >= last
        last = now


# Missions and fences.


def waypoint(number: int, east: float, command: int = 16, parameter: float = 0.0) -> Item:
    """Return an item so many km to the east."""
    return Item(number, command, 47.4, 8.5 + east / 75.0, 100.0, parameter)


def test_a_route_goes_through_waypoints_until_something_else_is_flown() -> None:
    items = [waypoint(0, 0), waypoint(1, 1, 22), waypoint(2, 2), waypoint(3, 3, 178)]
    items += [waypoint(4, 5), waypoint(5, 7, 21), waypoint(6, 9)]
    assert [item.number for item in mission.remaining_items(items, 2)] == [2, 4]
    assert [item.number for item in mission.remaining_items(items, 4)] == [4]
    assert mission.remaining_items(items, 5) == ()
    before = mission.item_before(items, 4)
    assert before is not None
    assert before.number == 2


@given(st.lists(st.floats(0.3, 9.0), min_size=1, max_size=4), st.floats(100.0, 2000.0))
def test_a_routes_points_lie_on_its_legs_and_say_where_the_mission_goes_on(
    lengths: list[float], spacing: float
) -> None:
    items, east = [waypoint(0, 0.0)], 0.0
    for number, length in enumerate(lengths, 1):
        east += length
        items.append(waypoint(number, east))
    route = mission.route((47.4, 8.5), items[1:], spacing)
    assert len({route_point.index for route_point in route}) == len(route) >= 2
    places = [
        (47.4, 8.5),
        *((route_point.latitude, route_point.longitude) for route_point in route),
    ]
    gaps = [distance(*a, *b) for a, b in itertools.pairwise(places)]
    if len(lengths) > 1:  # a lone waypoint's leg may be doubled
        assert max(gaps) < 1.6 * spacing
    for route_point in route:
        number = mission.item_after_rejoin(route_point.index, items)
        assert 1 <= number <= len(lengths) + 1
        if route_point.index % SUB not in (0, SUB - 1):
            assert number == route_point.index // SUB


def test_a_place_that_no_item_has_is_flown_to_instead_of_the_current_item() -> None:
    items = tuple(waypoint(number, number) for number in range(1, 4))
    elsewhere = waypoint(9, 7.0)
    at = [round(1e7 * degrees) for degrees in elsewhere.place]
    assert mission.begin_at_target(items[1:], items, *at)[0].place == pytest.approx(elsewhere.place)
    assert mission.begin_at_target(items[1:], items, *at)[1:] == items[2:]
    # The item that has just been passed, or is next, is no news of the mission.
    for item in items:
        at = [round(1e7 * degrees) for degrees in item.place]
        assert mission.begin_at_target(items[1:], items, *at) == items[1:]


def judged_on(route: Route, situation: Situation, now: int, judging_rules: Rules) -> Judgement:
    question = Question(
        Judgement(judging_rules.begin()), situation, Course(route, (route,)), now, flown=False
    )
    return answer(question, judging_rules)


def test_what_is_assumed_of_traffic_and_air_is_remarked(wire: Any) -> None:
    """Of an aircraft that is known within nothing, and an ownship that reports no wind."""
    flown = vehicle.vehicle_of(PARAMETERS, 200.0)
    policy = Policy.load().for_aircraft(flown.aircraft)
    judging_rules = rules(
        flown.aircraft,
        policy,
        margin=25.0,
        vertical=100.0,
        unknown=USUAL._replace(wind_std=1.2, reported_wind_std=0.2),
        deadline=5.0,
    )
    route = mission.route((47.4, 8.5), [waypoint(1, 3.0)], 1_000.0)
    # Eastward, and one head-on 900 m ahead, at a height and climb that it does not report.
    own = position(wire, vx=0, vy=2_000, lat=474_000_000, lon=85_000_000)
    ahead = vehicle_message(wire, lon=85_120_000, heading=27_000, hor_velocity=2_000, flags=0x0D)
    received, now = Received(), 12_345 * SECOND // 1_000
    for message in (own, ahead):
        received = take(received, message, now, READING)
    judgement = judged_on(route, received.situation, now, judging_rules)
    assert judgement.conflict is not None, judgement.problem
    remarks = "\n".join(judgement.remarks)
    assert "ownship.wind is unknown and taken as calm within 1.2 m/s" in remarks
    for field in ("position_std", "velocity_std"):
        assert f"intruder abc123.{field} is unknown and taken as" in remarks
    assert "intruder abc123.header.stamp is known within 0.58 s" in remarks


def test_what_is_kept_from_traffic_of_unknown_accuracy_is_told() -> None:
    options = options_of(["--connect", "udp:0.0.0.0:14550", "--separation", "200"])
    (line,) = separation_lines(rules_of(options, vehicle.vehicle_of(PARAMETERS, 200.0)))
    required = 200.0 + options.margin + 2.0 * USUAL.position_std
    assert f"separation 200 m, margin {options.margin:g} m" in line
    assert f"{required:.0f} m and more" in line


def test_an_emitter_category_is_kept_its_own_separation(wire: Any) -> None:
    """Eastward, and one westward that passes 400 m beside it: a conflict for its category alone."""
    flown = vehicle.vehicle_of(PARAMETERS, 200.0)
    policy = Policy.load().for_aircraft(flown.aircraft)
    route = mission.route((47.4, 8.5), [waypoint(1, 3.0)], 1_000.0)
    own = position(wire, vx=0, vy=2_000, lat=474_000_000, lon=85_000_000)
    beside = vehicle_message(
        wire, lat=474_036_000, lon=85_200_000, heading=27_000, hor_velocity=2_000, emitter_type=14
    )
    received, now = Received(), 12_345 * SECOND // 1_000
    for message in (own, beside, wire("WIND", direction=0.0, speed=0.0, speed_z=0.0)):
        received = take(received, message, now, READING)
    required = []
    for categories in (Categories({14: 600.0}), Categories({14: 600.0}, {14: 20.0}), Categories()):
        judging_rules = rules(
            flown.aircraft,
            policy,
            margin=25.0,
            vertical=100.0,
            unknown=Unknown(5.0, 0.2, 0.0, 0.0),
            deadline=5.0,
            categories=categories,
        )
        judged = judged_on(route, received.situation, now, judging_rules)
        assert judged.problem == ""
        required.append(judged.conflict and judged.conflict.required)
    assert required[0] is not None and required[0] > 625.0
    assert required[2] is None


def test_a_way_beside_a_fence_within_its_clearance_is_a_conflict(wire: Any) -> None:
    """Eastward, past a circle whose edge is 60 m beside the way, 1.4 km ahead."""
    flown = vehicle.vehicle_of(PARAMETERS, 200.0)
    circle = Item(0, 5004, 47.4 + 160.0 / 111_200.0, 8.52, 0.0, 100.0)
    route = mission.route((47.4, 8.5), [waypoint(1, 3.0)], 1_000.0)
    received, now = Received(), 12_345 * SECOND // 1_000
    own = position(wire, vx=0, vy=2_000, lat=474_000_000, lon=85_000_000)
    for message in (own, wire("WIND", direction=0.0, speed=0.0, speed_z=0.0)):
        received = take(received, message, now, READING)
    unknown = Unknown(5.0, 0.2, 0.0, 0.0)
    policy = Policy.load().for_aircraft(flown.aircraft)
    judging_rules = rules(
        flown.aircraft, policy, margin=25.0, vertical=100.0, unknown=unknown, deadline=5.0
    )
    for clearance, loss in ((100.0, 66.0), (30.0, None)):
        fenced = replace(received.situation, fixed_areas=mission.fence([circle], clearance))
        judged = judged_on(route, fenced, now, judging_rules)
        assert judged.problem == ""
        assert (judged.conflict and judged.conflict.time) == (loss and pytest.approx(loss, abs=6.0))


def test_a_mission_without_a_waypoint_left_is_said_so() -> None:
    with pytest.raises(FieldError, match="no waypoint left"):
        mission.route((47.4, 8.5), [], 100.0)


def test_fences_become_areas_on_the_side_that_they_mean() -> None:
    corners = [
        Item(n, 5002, 47.4 + a, 8.5 + b, 0.0, 3.0)
        for n, (a, b) in enumerate([(0.0, 0.0), (0.01, 0.0), (0.0, 0.01)])
    ]
    circle = Item(3, 5003, 47.4, 8.5, 0.0, 900.0)
    outside, inside = mission.fence([*corners, circle, Item(4, 5000, 47.4, 8.5, 0.0)], 30.0)
    assert (outside.keep, len(outside.rings[0]), outside.more["clearance"]) == (Keep.OUT, 3, 30.0)
    assert (inside.keep, inside.radius) == (Keep.IN, 900.0)
    with pytest.raises(FieldError, match="begins 3 corners"):
        mission.fence(corners[:2], 0.0)
    for count in (math.nan, math.inf, 2.5):
        with pytest.raises(FieldError, match=r"item 0 begins .* corners, expected a whole"):
            mission.fence([corners[0]._replace(parameter=count), *corners[1:]], 0.0)


# The aircraft.


@given(st.floats(8.0, 20.0), st.floats(1.5, 3.5), st.floats(15.0, 80.0), st.floats(50.0, 1500.0))
def test_an_aircraft_stays_inside_what_its_autopilot_flies(
    slow: float, ratio: float, bank: float, separation: float
) -> None:
    parameters = PARAMETERS | {
        "AIRSPEED_MIN": slow,
        "AIRSPEED_MAX": ratio * slow,
        "ROLL_LIMIT_DEG": bank,
    }
    try:
        read_vehicle = vehicle.vehicle_of(parameters, separation)
    except vehicle.ParameterError as problem:
        assert "no aircraft" in str(problem)
        return
    able = read_vehicle.aircraft.vehicle_limits
    assert slow <= able.speed_min < able.speed_max <= ratio * slow
    assert math.atan(able.yaw_rate_max * able.speed_max / 9.81) <= math.radians(bank) + 1e-9
    decided = read_vehicle.aircraft.limits
    assert decided.yaw_rate_max <= able.yaw_rate_max
    assert decided.acceleration_max <= able.acceleration_max


def test_what_was_assumed_is_said_and_what_is_missing_is_refused() -> None:
    parameters = {name: PARAMETERS[name] for name in ("AIRSPEED_MIN", "AIRSPEED_MAX")}
    notes = " ".join(vehicle.vehicle_of(parameters, 200.0).notes)
    assert all(name in notes for name in ("ROLL_LIMIT_DEG", "TECS_CLMB_MAX", "TECS_SINK_MIN"))
    with pytest.raises(vehicle.ParameterError, match="AIRSPEED_MAX is not among"):
        vehicle.vehicle_of({"AIRSPEED_MIN": 10.0}, 200.0)
    with pytest.raises(vehicle.ParameterError, match="0 < min < max"):
        vehicle.vehicle_of(PARAMETERS | {"AIRSPEED_MIN": 40.0}, 200.0)


def test_names_of_older_autopilots_are_read() -> None:
    old = {"ARSPD_FBW_MIN": 10.0, "ARSPD_FBW_MAX": 30.0, "LIM_ROLL_CD": 6500.0}
    old |= {name: PARAMETERS[name] for name in ("TECS_CLMB_MAX", "TECS_SINK_MIN")}
    assert vehicle.vehicle_of(old, 200.0) == vehicle.vehicle_of(PARAMETERS, 200.0)


@pytest.mark.parametrize(
    ("changes", "note"),
    [
        ({}, ""),
        ({"FS_GCS_ENABL": 0.0}, "stays in GUIDED"),
        ({"MAV_GCS_SYSID": 255.0}, "stays in GUIDED"),
        ({"FS_LONG_ACTN": 0.0}, "stays in GUIDED"),
        ({"MIS_RESTART": 1.0}, "begins anew"),
    ],
)
def test_what_keeps_the_failsafe_from_going_on_with_the_mission_is_said(
    changes: dict[str, float], note: str
) -> None:
    safe = {"FS_GCS_ENABL": 1.0, "MAV_GCS_SYSID": 245.0, "FS_LONG_ACTN": 4.0, "MIS_RESTART": 0.0}
    assert note in " ".join(vehicle.failsafe_notes(safe | changes, 245))
    assert bool(vehicle.failsafe_notes(safe | changes, 245)) == bool(changes)


@pytest.mark.parametrize(
    ("name", "note"),
    [("MAV_GCS_SYSID", "stays in GUIDED"), ("MIS_RESTART", "begins anew")],
)
def test_an_unknown_setting_of_the_failsafe_is_taken_for_the_worse(name: str, note: str):
    settings = {
        "FS_GCS_ENABL": 1.0,
        "MAV_GCS_SYSID": 255.0,
        "FS_LONG_ACTN": 1.0,
        "MIS_RESTART": 0.0,
    }
    assert not vehicle.failsafe_notes(settings, 255)
    del settings[name]
    assert note in " ".join(vehicle.failsafe_notes(settings, 255))


def test_both_avoidances_at_once_are_refused() -> None:
    vehicle.check_flyable(PARAMETERS | {"AVD_ENABLE": 0.0})
    with pytest.raises(vehicle.ParameterError, match="AVD_ENABLE is 1; expected 0 with --fly"):
        vehicle.check_flyable(PARAMETERS | {"AVD_ENABLE": 1.0})


# Who flies.


def make_observation(time: float = 0.0, mode: int = Mode.AUTO, **changes: Any) -> Observation:
    """Return a moment with a conflict and a plan."""
    usual = {"armed": True, "fresh": True, "conflict": True, "flyable": True, "rejoined": False}
    return Observation(time, mode, **(usual | changes))


def after(*moments: Observation, fly: bool = True) -> Step:
    """Return the last step of some moments."""
    last_step = Step(Control())
    for moment in moments:
        last_step = step(last_step.control, moment, fly=fly)
    return last_step


def test_a_conflict_is_flown_and_the_mission_given_back() -> None:
    moments = [
        make_observation(0.0),
        make_observation(0.2, Mode.GUIDED),
        make_observation(0.4, Mode.GUIDED),
    ]
    assert after(*moments[:1]).orders == (Order.TAKE_OVER,)
    assert after(*moments).orders == (Order.STEER,)
    back = after(*moments, make_observation(60.0, Mode.GUIDED, rejoined=True))
    assert back.orders == (Order.GIVE_BACK,)
    again = step(back.control, make_observation(60.2, Mode.AUTO, conflict=False), fly=True)
    assert (again.control.phase, again.orders) == (Phase.WATCHING, ())


_MOMENTS = st.builds(
    make_observation,
    mode=st.sampled_from([*Mode, 5, 0]),
    armed=st.booleans(),
    fresh=st.booleans(),
    conflict=st.booleans(),
    flyable=st.booleans(),
    rejoined=st.booleans(),
)


@given(st.lists(_MOMENTS, max_size=40))
def test_nothing_is_ordered_in_advice_nor_in_a_mode_of_the_operators(
    moments: list[Observation],
) -> None:
    advised = flown = Control()
    for number, moment in enumerate(moments):
        now = moment._replace(time=0.2 * number)
        stepped = step(advised, now, fly=False)
        advised = stepped.control
        assert stepped.orders == ()
        stepped = step(flown, now, fly=True)
        flown = stepped.control
        if moment.mode not in (Mode.AUTO, Mode.GUIDED):
            assert stepped.orders == ()
            assert stepped.control.phase in (Phase.WATCHING, Phase.YIELDED)
        if Order.TAKE_OVER in stepped.orders:
            assert moment.mode == Mode.AUTO
            assert moment.armed
        if Order.STEER in stepped.orders:
            assert moment.mode == Mode.GUIDED
            assert moment.fresh


@pytest.mark.parametrize("mode", [Mode.RTL, Mode.LOITER, Mode.AVOID_ADSB, Mode.AUTO, 5])
def test_a_mode_of_somebody_elses_ends_it_until_the_mission_flies_in_peace(mode: int) -> None:
    ended = after(
        make_observation(0.0), make_observation(0.2, Mode.GUIDED), make_observation(0.4, mode)
    )
    assert (ended.control.phase, ended.orders) == (Phase.YIELDED, ())
    assert "set by others" in ended.text
    for later in (1.0, 5.0, 30.0):
        ended = step(ended.control, make_observation(later), fly=True)
        assert ended.orders == ()
    peace = step(ended.control, make_observation(31.0 + CLEAR, conflict=False), fly=True)
    assert peace.control.phase is Phase.WATCHING
    assert step(peace.control, make_observation(50.0), fly=True).orders == (Order.TAKE_OVER,)


def test_a_target_of_somebody_elses_in_guided_ends_it_too() -> None:
    flown = after(make_observation(0.0), make_observation(0.2, Mode.GUIDED))
    ended = step(flown.control, make_observation(0.4, Mode.GUIDED, diverted=True), fly=True)
    assert (ended.control.phase, ended.orders) == (Phase.YIELDED, ())
    assert "commanding ends" in ended.text
    later = step(ended.control, make_observation(9.0, Mode.GUIDED, diverted=True), fly=True)
    assert later.orders == ()


def test_an_operators_mode_that_our_request_crossed_is_restored() -> None:
    crossed = after(make_observation(0.0), make_observation(0.1, Mode.RTL))
    assert crossed.control.restore == Mode.RTL
    assert step(crossed.control, make_observation(0.2, Mode.GUIDED), fly=True).orders == (
        Order.RESTORE,
    )
    assert step(crossed.control, make_observation(0.2, Mode.RTL), fly=True).orders == ()


@pytest.mark.parametrize("before", [[], [make_observation(0.4, Mode.LOITER)]])
def test_auto_that_the_failsafe_has_set_is_the_mission_again(before: list[Observation]) -> None:
    """Watched at once, and taken over from, where the operator's AUTO is only advised in."""
    moments = [make_observation(0.0), make_observation(0.2, Mode.GUIDED), *before]
    back = after(*moments, make_observation(6.0, failsafe=True))
    assert (back.control.phase, back.orders) == (Phase.WATCHING, ())
    assert "failsafe" in back.text
    assert step(back.control, make_observation(6.2), fly=True).orders == (Order.TAKE_OVER,)
    operators = after(*moments, make_observation(6.0))
    assert operators.control.phase is Phase.YIELDED
    assert step(operators.control, make_observation(6.2), fly=True).orders == ()


def test_a_request_that_the_link_has_lost_is_made_again_later() -> None:
    control, orders = Control(), list[tuple[float, Order]]()
    for number in range(100):
        stepped = step(control, make_observation(0.2 * number), fly=True)
        control = stepped.control
        orders += [(0.2 * number, order) for order in stepped.orders]
    times = [time for time, _ in orders]
    assert {order for _, order in orders} == {Order.TAKE_OVER}
    gaps = [b - a for a, b in itertools.pairwise(times)]
    assert len([gap for gap in gaps if gap > CROSSING]) == 2  # a rest, in which it is undone


SAFE = {"FS_GCS_ENABL": 1.0, "MAV_GCS_SYSID": 245.0, "FS_LONG_ACTN": 4.0, "FS_LONG_TIMEOUT": 4.0}


@pytest.mark.parametrize(
    ("changes", "timeout"),
    [
        ({}, 4.0),
        ({"FS_GCS_ENABL": 0.0}, math.inf),
        ({"FS_GCS_ENABL": 3.0}, math.inf),  # heartbeats are watched in AUTO alone
        ({"MAV_GCS_SYSID": 255.0}, math.inf),
        ({"FS_LONG_ACTN": 1.0}, math.inf),
    ],
)
@pytest.mark.parametrize("was", [Mode.GUIDED, Mode.AUTO])
@pytest.mark.parametrize(("silence", "status"), [(0.2, 4), (0.2, 5), (3.0, 4), (6.0, 4), (6.0, 5)])
def test_whose_auto_it_is_follows_from_silence_status_and_settings(
    wire: Any, changes: dict[str, float], timeout: float, was: int, silence: float, status: int
) -> None:
    def beat(mode: int, state: int) -> Any:
        fields = {"type": 1, "autopilot": 3, "base_mode": 0x80, "mavlink_version": 3}
        return wire("HEARTBEAT", **fields, custom_mode=mode, system_status=state)

    assert vehicle.failsafe_timeout(SAFE | changes, 245) == timeout
    before = take(Received(), beat(was, 4), 100 * SECOND, READING)
    now = round((100.0 + silence) * SECOND)
    received = take(before, beat(Mode.AUTO, status), now, READING)
    acted = timeout < math.inf and was == Mode.GUIDED and (silence > timeout or status == 5)
    assert failsafe_acted(before, received, timeout) == acted
    loiter = take(before, beat(Mode.LOITER, status), now, READING)
    assert not failsafe_acted(before, loiter, timeout)


@pytest.mark.parametrize("phase", list(Phase))
def test_an_autopilot_that_begins_anew_is_watched_again_and_an_operators_word_holds(
    phase: Phase,
) -> None:
    """Its clock begins anew with it, an hour back: what was timed by the old one ends."""
    before = Control(phase, since=3_600.0, request_time=3_600.0, conflict_at=3_600.0, restore=10)
    control = begin_anew(before, 5.0)
    assert not control.flies
    assert (control.phase is Phase.YIELDED) == (phase is Phase.YIELDED)
    quiet = Observation(6.0, Mode.AUTO, True, True, False, False, False)
    assert step(control, quiet, fly=True).control.phase is control.phase
    later = step(control, quiet._replace(time=5.5 + CLEAR), fly=True).control
    assert later.phase is Phase.WATCHING
    conflict = Observation(6.5 + CLEAR, Mode.AUTO, True, True, True, True, False)
    assert step(later, conflict, fly=True).orders == (Order.TAKE_OVER,)


def test_an_autopilot_that_does_not_change_is_not_left_in_guided() -> None:
    late = after(make_observation(0.0), make_observation(3.1))
    assert late.control.phase is Phase.YIELDED
    assert step(late.control, make_observation(3.4, Mode.GUIDED), fly=True).orders == (
        Order.RESTORE,
    )


@pytest.mark.parametrize("phase", ["taking", "guiding", "returning"])
def test_what_is_flown_when_it_is_switched_off_is_handed_back_and_nothing_after(phase: str) -> None:
    """As where AVD_ENABLE is set in flight; a request that was on its way is undone too."""
    moments = [make_observation(0.0), make_observation(0.2, Mode.GUIDED)]
    moments = moments[:1] if phase == "taking" else moments
    if phase == "returning":
        moments.append(make_observation(0.3, Mode.GUIDED, rejoined=True))
    control, mode, orders = after(*moments).control, moments[-1].mode, []
    for number in range(200):
        if number == 1 and phase == "taking":
            mode = Mode.GUIDED  # our request arrives
        stepped = step(control, make_observation(0.5 + 0.2 * number, mode), fly=False)
        control = stepped.control
        orders += stepped.orders
        if stepped.orders:
            mode = Mode.AUTO
    assert set(orders) <= {Order.GIVE_BACK, Order.RESTORE}
    assert len(orders) == 1
    assert mode == Mode.AUTO
    assert not control.flies


@given(st.lists(_MOMENTS, max_size=30), st.integers(0, 30))
def test_switched_off_it_never_changes_a_mode_of_the_operators(
    moments: list[Observation], off: int
) -> None:
    control = Control()
    for number, moment in enumerate(moments):
        stepped = step(control, moment._replace(time=0.2 * number), fly=number < off)
        control = stepped.control
        if number >= off:
            assert set(stepped.orders) <= {Order.GIVE_BACK, Order.RESTORE}
            assert not stepped.orders or moment.mode in (Mode.AUTO, Mode.GUIDED)


def test_a_stale_state_is_not_steered_by() -> None:
    moments = [
        make_observation(0.0),
        make_observation(0.2, Mode.GUIDED),
        make_observation(0.4, Mode.GUIDED, fresh=False),
    ]
    assert after(*moments).orders == ()


# Bad input.


@pytest.mark.parametrize(
    "text",
    [
        "",
        "nonsense",
        "/dev/absent",
        "udp:",
        "tcp:host",
        "udp:0.0.0.0:0",
        "tcp:h:99999",
        "tcpin:h:1",
    ],
)
def test_an_address_that_cannot_be_is_refused_in_a_sentence(text: str) -> None:
    with pytest.raises(InputError, match=r"^--connect is .*: expected udp:HOST:PORT"):
        Link(text)


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--separation", "1"], "--separation is 1 m; expected 10 to 10000 m"),
        (["--margin", "nan"], "--margin is nan m"),
        (["--system", "0"], "--system: '0'; expected a whole number, 1 to 255"),
        (["--baud", "-1"], "--baud: '-1'; expected a whole number of at least 1"),
        (["--seconds", "-1"], "--seconds is -1 s"),
        (["--adsb", "host:30003"], "--adsb is 'host:30003', expected tcp://HOST:30003"),
        (["--own", "abc123"], "--own goes with --adsb"),
        (["--own", "abc12", "--adsb", "tcp://h:30003"], "--own is 'abc12'; expected six hex"),
        (["--policy", "/absent/p"], "--policy /absent/p.*no such policy file"),
        (["--record", "/absent/f.mcap"], "--record /absent/f.mcap: there is no folder /absent"),
        (["--record", "/dev/null"], "--record /dev/null exists already"),
        (["--plan-file", "/absent/p.kml"], "--plan-file /absent/p.kml: there is no folder"),
        (["--category-separations", "A5"], "--category-separations holds 'A5', expected a"),
    ],
)
def test_an_option_out_of_its_range_is_refused(arguments: list[str], problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        options_of(["--connect", "tcp:h:1", *arguments])


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--wind", "9"], "--wind is 9 m/s; expected 0 to 8 m/s"),
        (["--out", "/absent/p.png"], "--out /absent/p.png: there is no folder /absent"),
        (["--out", "/tmp"], "--out /tmp is a folder"),
        (["--out", "picture.doc"], "--out picture.doc: expected a name that ends in .*png"),
        (["--record", "/absent/f.mcap"], "--record /absent/f.mcap: there is no folder /absent"),
    ],
)
def test_the_demo_refuses_before_anything_flies(arguments: list[str], problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        demo.main(arguments)


def test_a_simulation_that_is_not_there_or_whose_port_is_taken_is_said_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RLCAS_SITL", str(tmp_path))
    with pytest.raises(InputError, match=f"RLCAS_SITL is '{tmp_path}' .* holds no arduplane"):
        Sitl(5)
    for name in ("arduplane", "plane.parm"):
        (tmp_path / name).touch()
    for wrong in (-1, 256, 310):  # ArduPlane itself makes 0 of 256
        with pytest.raises(InputError, match=f"the instance is {wrong}; expected 0 to 255"):
            Sitl(wrong)
    with socket.create_server(("", 0)) as server:
        first = server.getsockname()[1]
        monkeypatch.setattr(sitl, "_FIRST_PORT", first)
        with pytest.raises(InputError, match=f"port {first} cannot be used: Address already"):
            Sitl(0)


def test_an_address_is_needed() -> None:
    with pytest.raises(ConfigError, match="--connect"):
        options_of([])


def test_a_closed_port_and_a_silent_one_are_said_so() -> None:
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        port = server.getsockname()[1]
        with pytest.raises(InputError, match=f"--connect tcp:127.0.0.1:{port}: cannot be opened"):
            main(["--connect", f"tcp:127.0.0.1:{port}"])
        server.listen()
        link = Link(f"tcp:127.0.0.1:{port}")
        with pytest.raises(InputError, match=r"no autopilot was found within 0.5 s: no heartbeat"):
            link.find(0.5)
        link.close()


def test_an_autopilot_on_a_serial_port_is_found_and_its_loss_is_silence() -> None:
    """A pair of pseudo-terminals is a serial port and its cable."""
    pytest.importorskip("serial", reason="the extra mavlink is not installed")
    dialect = importlib.import_module("pymavlink.dialects.v20.ardupilotmega")
    autopilot, port = pty.openpty()
    tty.setraw(autopilot)
    link = Link(os.ttyname(port), baud=115_200)
    beat = dialect.MAVLink_heartbeat_message(1, 3, 0x80, Mode.AUTO, 4, 3)
    os.write(autopilot, beat.pack(dialect.MAVLink(None, 7, 1)))
    link.find(5.0)
    assert (link.system, link.component) == (7, 1)
    parsed = dialect.MAVLink(None).parse_buffer(os.read(autopilot, 4_096))
    assert {message.get_type() for message in parsed} == {"HEARTBEAT"}
    os.close(autopilot)
    os.close(port)
    link.beat()
    assert list(link.receive(time.monotonic() + 0.2)) == []
    link.close()


@pytest.mark.parametrize("length", [3, 50, 51, 100, 130])
def test_a_long_text_is_sent_in_parts_that_a_ground_station_joins(length: int) -> None:
    dialect = importlib.import_module("pymavlink.dialects.v20.ardupilotmega")
    text = "".join(chr(97 + n % 26) for n in range(length))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        station.settimeout(5.0)
        link = Link(f"udpout:127.0.0.1:{station.getsockname()[1]}")
        link.say(text)
        link.say("end")
        reader, parts = dialect.MAVLink(None), []
        while not parts or parts[-1].text != "end":
            parts += reader.parse_buffer(station.recv(4_096))
        link.close()
    *ours, _ = parts
    assert "".join(part.text for part in ours) == text
    assert [part.chunk_seq for part in ours] == list(range(len(ours)))
    assert {part.id == 0 for part in ours} == {length <= 50}
    # A part that is not full ends the text.
    assert len(ours) == 1 or len(ours[-1].text) < 50


@pytest.mark.parametrize("text", ["/dev/null", "/dev/zero"])
def test_a_device_that_is_no_serial_port_is_refused_in_a_sentence(text: str) -> None:
    pytest.importorskip("serial", reason="the extra mavlink is not installed")
    with pytest.raises(InputError, match=f"--connect {text}: cannot be opened: "):
        Link(text)


@given(st.lists(st.integers(0, 5), max_size=60), st.integers(1, 5))
def test_a_download_is_whole_whatever_is_lost_doubled_or_out_of_order(
    arrivals: list[int], count: int
) -> None:
    dialect = importlib.import_module("pymavlink.dialects.v20.ardupilotmega")

    def answer(number: int | None) -> Any:
        if number is None:
            return dialect.MAVLink_mission_count_message(245, 191, count, 1)
        values = (float(number), 0.0, 0.0, 0.0, 10 * number, 20, 0.0)
        fields = (245, 191, number, 0, 5003, 0, 1, *values, 1)
        return dialect.MAVLink_mission_item_int_message(*fields)

    download, now = Download(1), 0.0
    for number in arrivals:
        download = accept(download, answer(number if number < count else None))
    while not download.complete:
        now += 2.0 * AGAIN
        assert due(download, now)
        asked_number = None if download.count is None else len(download.items)
        download = accept(note_question(download, now), answer(asked_number))
    assert [item.number for item in download.items] == list(range(count))
    assert not due(download, now + 100.0)
