"""The MAVLink program where plans may climb and descend: from parameters and options to the altitude
that the autopilot is told; with pymavlink's own messages, without a simulation."""

import json
import math
import socket
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

pytest.importorskip("pymavlink", reason="the extra mavlink is not installed")

from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from agents.assurance.backup import Sense
from agents.assurance.backup_heights import backup_profile
from agents.assurance.space import climb_of_backup
from agents.assurance.state import FlyMode
from agents.kernel.levels import Altitude
from agents.planner.answer import Source
from commands.command import InputError
from envs.areas import Level
from envs.formats.local_frame import LocalFrame
from envs.profile import climbing
from ros_bridge.core.assurance import fly_mode, step_monitor, withdraw
from ros_bridge.core.fields import SECOND
from ros_bridge.mavlink import mission, pilot, vehicle
from ros_bridge.mavlink.control import Control
from ros_bridge.mavlink.course import Course
from ros_bridge.mavlink.effects import Reposition, Say, Steer
from ros_bridge.mavlink.intake import Reading, Received, take
from ros_bridge.mavlink.judging import Judgement, Question, Rules, answer, local_plan
from ros_bridge.mavlink.link import Link
from ros_bridge.mavlink.mission import Item
from ros_bridge.mavlink.options import options_of, rules_of, vertical_separation_of
from ros_bridge.mavlink.pilot import Pilot
from ros_bridge.mavlink.plan_file import geojson, kml
from ros_bridge.mavlink.program import separation_lines
from ros_bridge.mavlink.state import State
from ros_bridge.mavlink.steering import Command, PlannedHeight
from ros_bridge.mavlink.telling import advise, explain
from ros_bridge.mavlink.vehicle import HeightLag, Vehicle, fence_levels, vehicle_of
from ros_bridge.mavlink.view import View
from tests.ros_bridge.test_mavlink import PARAMETERS

HOME, GROUND, ABOVE = LocalFrame(47.4, 8.5), 500.0, 100.0  # m above the sea, and above home
SPEED, NOW = 22.0, 100 * SECOND  # m/s, of the ownship, which flies east
CLIMBS = ("--maneuvers", "both", "--traffic-altitude", "msl", "--vertical-separation", "50")
KNOWN = ("--unknown-position-std", "5", "--unknown-velocity-std", "0.2", "--deadline", "10")


def chosen(*more: str) -> Any:
    return options_of(["--connect", "tcp:h:1", "--separation", "200", *KNOWN, *more])


def made(*more: str, fence: Any = (None, None), kind: str = "both") -> tuple[Vehicle, Rules]:
    options = chosen(CLIMBS[0], kind, *CLIMBS[2:], *more)
    flown = vehicle_of(PARAMETERS, options.separation, vertical_separation_of(options))
    return flown, rules_of(options, flown, fence)


@pytest.fixture(scope="module")
def flown() -> tuple[Vehicle, Rules]:
    return made()


def items(*heights: float, frame: int = 3) -> tuple[Item, ...]:
    """Return a mission to the east: home, and a waypoint every 5 km."""
    at = [HOME.geodetic(5_000.0 * number, 0.0) for number in range(len(heights) + 1)]
    places = [(float(corner.latitude), float(corner.longitude)) for corner in at]
    home = Item(0, 16, *places[0], GROUND, frame=0)
    legs_ends = zip(places[1:], heights, strict=True)
    return home, *(
        Item(number, 16, *place, height, frame=frame)
        for number, (place, height) in enumerate(legs_ends, 1)
    )


def heard(
    height: float = 0.0,
    climb: float = 0.0,
    own_climb: float = 0.0,
    own_above: float = 0.0,
    ahead: float = 1_600.0,
    time: int = NOW,
) -> Received:
    """Return what is known at a time, ns, of an ownship above the mission's altitude, m, and of an
    aircraft that comes head-on, so much higher than that altitude, m, with a climb, m/s.
    """
    at = HOME.geodetic(ahead, 0.0)
    position = round(1e7 * float(at.latitude)), round(1e7 * float(at.longitude))
    sea = round(1e3 * (GROUND + ABOVE))
    messages = [
        dialect.MAVLink_wind_message(270.0, 0.0, 0.0),
        dialect.MAVLink_global_position_int_message(
            time // 1_000_000,
            *(474_000_000, 85_000_000),
            sea + round(1e3 * own_above),
            *(100_000, 0, round(100 * SPEED), round(-100 * own_climb), 9_000),
        ),
        dialect.MAVLink_adsb_vehicle_message(
            0xABC123,
            *position,
            1,
            sea + round(1e3 * height),
            heading=27_000,
            hor_velocity=2_500,
            ver_velocity=round(100 * climb),
            callsign=b"ABC",
            emitter_type=14,
            tslc=0,
            flags=0x8F,
            squawk=0,
        ),
    ]
    received = Received(parameters=PARAMETERS)
    for message in messages:
        received = take(received, message, time, Reading({0: "msl", 1: "msl"}))
    return received


def judge(
    received: Received, judging_rules: Rules, mission_items: Sequence[Item] = ()
) -> Judgement:
    """Return what is made of it on a mission."""
    mission_items = mission_items or items(ABOVE, ABOVE)
    remaining = mission.remaining_items(mission_items, 1)
    altitudes = {item.number: mission.altitude_of(item, mission_items) for item in remaining}
    route = mission.route((47.4, 8.5), remaining, 200.0, None, altitudes)
    fresh, course = Judgement(judging_rules.begin()), Course(route, (route,))
    return answer(Question(fresh, received.situation, course, NOW, flown=False), judging_rules)


def heights(judgement: Judgement) -> list[float]:
    assert judgement.plan is not None and judgement.plan.safe
    return [point.altitude for point in judgement.plan.waypoints if point.altitude is not None]


# The aircraft and its fence.


@settings(max_examples=30)
@given(st.floats(0.3, 20.0), st.floats(0.3, 10.0), st.floats(0.3, 20.0), st.floats(1.0, 10.0))
def test_an_aircraft_climbs_no_faster_than_its_autopilot_with_power_left_over(
    climb: float, sink: float, fastest_sink: float, change: float
) -> None:
    stated = {"TECS_CLMB_MAX": climb, "TECS_SINK_MIN": sink, "TECS_SINK_MAX": fastest_sink}
    aircraft = vehicle_of(PARAMETERS | stated | {"TECS_VERT_ACC": change}, 200.0, 50.0).aircraft
    vertical, able = aircraft.vertical, aircraft.limits
    assert vertical is not None and vertical.separation == 50.0
    used = vertical.climb_max + able.acceleration_max * able.speed_max / 9.80665
    assert 0.0 < vertical.climb_max < climb and used <= climb + 1e-9
    assert 0.0 < vertical.descent_max <= min(sink, fastest_sink)
    assert vertical.acceleration <= min(change, 1.0)


def test_what_is_assumed_of_climbs_is_said_and_in_the_plane_nothing_of_them() -> None:
    notes = " ".join(vehicle_of(PARAMETERS, 200.0, 50.0).notes)
    assert "TECS_SINK_MAX is unknown and taken as 5 m/s" in notes
    assert "TECS_VERT_ACC is unknown and taken as 7 m/s^2" in notes
    assert "climbs of 3.5 m/s at most of TECS_CLMB_MAX 5 m/s, descents of 1.4 m/s" in notes
    in_plane = vehicle_of(PARAMETERS, 200.0)
    assert in_plane.aircraft.vertical is None
    assert not any("climbs of" in note for note in in_plane.notes)
    lag = vehicle_of(PARAMETERS | {"TECS_HDEM_TCONST": 2.0}, 200.0, 50.0).height_lag
    assert lag == HeightLag(filter=2.0) and HeightLag().filter == 3.0


def test_a_fences_heights_count_where_its_type_has_them_above_home() -> None:
    heights = {"FENCE_ALT_MAX": 120.0, "FENCE_ALT_MIN": 30.0}
    assert fence_levels(heights | {"FENCE_TYPE": 4.0}, None) == (None, None)
    floor, ceiling = fence_levels(heights | {"FENCE_TYPE": 13.0}, GROUND)
    assert (floor, ceiling) == (Level(530.0, "msl"), Level(620.0, "msl"))
    assert fence_levels(heights | {"FENCE_TYPE": 1.0}, GROUND) == (None, ceiling)
    with pytest.raises(vehicle.ParameterError, match="FENCE_ALT_MAX is 120 m above home, whose"):
        fence_levels(heights | {"FENCE_TYPE": 1.0}, None)


def test_the_narrower_of_the_fences_and_the_given_heights_counts() -> None:
    fence = Level(530.0, "msl"), Level(720.0, "msl")
    options = made("--ceiling", "700", "--floor", "400", fence=fence)[1].settings.options
    assert (options.floor, options.ceiling) == (Level(530.0, "msl"), Level(700.0, "msl"))
    with pytest.raises(InputError, match="--floor is 800 m, expected less than the ceiling, 720 m"):
        made("--floor", "800", fence=fence)


def test_what_is_kept_above_and_below_is_told() -> None:
    _, line = separation_lines(made("--ceiling", "700")[1])
    assert "or vertical separation 50 m, margin" in line
    assert "no floor, ceiling 700 m above mean sea level" in line


# Options.


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--floor", "100"], "--floor goes with --maneuvers vertical or both"),
        (["--vertical-separation", "50"], "--vertical-separation goes with --maneuvers"),
        (["--maneuvers", "up"], "--maneuvers"),
        (["--maneuvers", "both"], "--maneuvers both goes with --traffic-altitude msl, or a rec"),
        (["--maneuvers", "both", "--adsb", "tcp://h:1"], "goes with --traffic-altitude msl"),
        ([*CLIMBS, "--floor", "nan"], "--floor is nan m; expected -1000 to 30000 m"),
        ([*CLIMBS, "--floor", "900", "--ceiling", "800"], "--floor is 900 m; expected less than"),
        (
            [*CLIMBS[:4], "--vertical-separation", "0"],
            "--vertical-separation is 0 m; expected 1 to",
        ),
        ([*CLIMBS, "--vertical-margin", "-1"], "--vertical-margin is -1 m; expected 0 to 5000 m"),
    ],
)
def test_options_that_no_plan_could_climb_by_are_refused(
    arguments: list[str], problem: str
) -> None:
    with pytest.raises(InputError, match=problem):
        chosen(*arguments)


def test_a_receiver_of_known_altitudes_is_enough_and_a_margin_below_a_corners_error_is_not() -> (
    None
):
    assert chosen("--maneuvers", "both", "--adsb", "flarm://h:2000").maneuvers == "both"
    with pytest.raises(InputError, match=r"--vertical-margin is 1 m; expected 1\.6 m or more"):
        made("--vertical-margin", "1")


# The mission's altitudes.


@pytest.mark.parametrize(
    ("frame", "altitude"),
    [(0, 100.0), (5, 100.0), (3, 600.0), (6, 600.0), (10, None), (11, None)],
)
def test_an_item_has_the_altitude_that_its_frame_says(frame: int, altitude: float | None) -> None:
    mission_items = items(100.0, frame=frame)
    item_altitude = mission.altitude_of(mission_items[1], mission_items)
    assert (item_altitude and item_altitude.value) == altitude
    higher = mission.altitude_of(mission_items[1], mission_items, offset=7.0)
    assert (higher and higher.value) == (altitude and altitude + 7.0)
    assert (mission.altitude_of(mission_items[1], mission_items[1:]) is None) == (
        frame not in (0, 5)
    )


@pytest.mark.parametrize("frame", [0, 3])
def test_an_altitude_that_is_no_number_is_unknown(frame: int) -> None:
    mission_items = items(math.nan, frame=frame)
    assert mission.altitude_of(mission_items[1], mission_items) is None
    assert mission.altitude_of(items(100.0, frame=frame)[1], mission_items, math.inf) is None


def test_a_parameter_that_is_no_number_changes_nothing() -> None:
    received = Received(parameters=MappingProxyType({"ALT_OFFSET": 7.0}))
    for value in (math.nan, math.inf):
        message = dialect.MAVLink_param_value_message(b"ALT_OFFSET", value, 9, 1, 0)
        assert take(received, message, 0, Reading({})).altitude_offset == 7.0


def test_an_items_frame_is_read() -> None:
    values = (0.0, 0.0, 0.0, 0.0, 474_000_000, 85_000_000, 80.0)
    message = dialect.MAVLink_mission_item_int_message(245, 191, 2, 10, 16, 0, 1, *values, 0)
    assert mission.item(message).frame == 10


# What is watched and planned.


def test_head_on_it_climbs_along_the_mission_and_comes_back_to_its_altitude(
    flown: tuple[Vehicle, Rules],
) -> None:
    _, judging_rules = flown
    judgement = judge(heard(), judging_rules)
    plan, published = judgement.plan, judgement.supervision.published_plan
    assert plan is not None and plan.source is Source.VERTICAL
    assert published is not None and published.climbs and judgement.rejoin is not None
    plan_heights = heights(judgement)
    level = GROUND + ABOVE
    assert max(plan_heights) - level > 50.0 + judging_rules.settings.options.vertical_margin
    # Given back not before it is on the mission's altitude for good.
    back = (judgement.rejoin.time - NOW) / SECOND
    later = [
        height
        for height, waypoint in zip(plan_heights, plan.waypoints, strict=True)
        if waypoint.time >= back
    ]
    assert later == pytest.approx([level] * len(later))
    assert back > plan.waypoints[int(np.argmax(plan_heights))].time
    state = State(judgement, received=heard())
    texts = [getattr(effect, "text", "") for effect in advise(state, NOW, 60.0).effects]
    assert any(f"climb to {max(plan_heights):.0f} m" in text for text in texts)


@pytest.mark.parametrize(
    ("height", "climb", "meets"),
    [(0.0, 0.0, True), (150.0, 0.0, False), (-150.0, 0.0, False), (150.0, -3.75, True)],
)
def test_traffic_is_a_conflict_where_it_may_be_level_with_the_mission(
    flown: tuple[Vehicle, Rules], height: float, climb: float, meets: bool
) -> None:
    judgement = judge(heard(height, climb), flown[1])
    assert judgement.problem == ""
    assert (judgement.conflict is not None) == meets


def test_a_mission_that_climbs_to_traffic_is_a_conflict_before_it_climbs(
    flown: tuple[Vehicle, Rules],
) -> None:
    assert judge(heard(100.0), flown[1]).conflict is None
    assert judge(heard(100.0), flown[1], items(200.0, 200.0)).conflict is not None


def test_an_aircraft_that_climbs_towards_it_is_passed_at_another_altitude(
    flown: tuple[Vehicle, Rules],
) -> None:
    plan_heights = heights(judge(heard(-68.0, 2.0), flown[1]))
    assert max(abs(height - (GROUND + ABOVE)) for height in plan_heights) > 50.0


def test_above_terrain_the_plan_keeps_the_height_and_that_is_said(
    flown: tuple[Vehicle, Rules],
) -> None:
    judgement = judge(heard(), flown[1], items(ABOVE, ABOVE, frame=10))
    assert judgement.plan is not None and judgement.plan.safe
    assert heights(judgement) == []
    assert any("plans keep the height" in remark for remark in judgement.remarks)


def test_a_ceiling_is_not_climbed_through() -> None:
    _, judging_rules = made("--ceiling", "640", kind="vertical")
    judgement = judge(heard(), judging_rules)
    assert judgement.plan is not None
    assert not judgement.plan.safe or max(heights(judgement)) <= 640.0
    _, judging_rules = made("--ceiling", "590")
    assert "expected the ceiling, 590 m, or less" in judge(heard(), judging_rules).problem


# What the autopilot is told.


@pytest.mark.slow
@settings(max_examples=20)
@given(st.floats(0.5, 5.0), st.floats(0.5, 5.0), st.floats(0.2, 1.0))
def test_the_altitude_that_is_told_undoes_the_autopilots_lag(
    climb: float, filtered: float, acceleration: float
) -> None:
    """An autopilot that is late, and filters what it is told, flies the plan's altitude."""
    top = climb * (40.0 - 0.5 * climb / acceleration)
    profile = climbing(0.0, 0.0, [40.0, 60.0], [top, top], acceleration=acceleration)
    height, lag = PlannedHeight(profile, acceleration), HeightLag(0.5, filtered)
    step, demands, flown = 0.05, [], 0.0
    for number in range(round(60.0 / step)):
        time = number * step
        demands.append(height.to_demand(time, lag))
        late = demands[max(number - round(0.5 / step), 0)]
        flown += step * (late - flown) / filtered
        # The beginning that it is late for stays as an error that dies away.
        if time > 1.0 + 5.0 * filtered:
            assert flown == pytest.approx(height.at(time + step).altitude, abs=0.1 * climb)


def steered(judgement: Judgement, received: Received, flown: Vehicle, seconds: float = 1.0) -> Any:
    """Return the pilot and what it asks for so long after the request."""
    return pilot.steer(Pilot(), judgement, received, flown, NOW + round(seconds * SECOND))


def test_it_is_told_the_plans_altitude_less_what_it_adds_itself(
    flown: tuple[Vehicle, Rules],
) -> None:
    received = heard()
    judgement = judge(received, flown[1])
    (log, steer) = steered(judgement, received, flown[0]).effects
    assert "m above mean sea level" in log.text
    assert isinstance(steer, Steer) and steer.speed
    demanded = steer.steered.command.altitude
    assert demanded is not None and GROUND + ABOVE < demanded < GROUND + ABOVE + 30.0
    assert abs(steer.steered.above) < 2.0
    offset = replace(received, parameters={**PARAMETERS, "ALT_OFFSET": 10.0})
    less = steered(judgement, offset, flown[0]).effects[1].steered.command.altitude
    assert less == pytest.approx(demanded - 10.0)
    own = received.situation.own.last
    (reposition,) = pilot.take_over(
        Pilot(), judgement.supervision.published_plan, own, 10.0
    ).effects
    assert isinstance(reposition, Reposition)
    assert reposition.target.altitude == pytest.approx(GROUND + ABOVE - 10.0)


def test_another_altitude_in_guided_is_somebody_elses(flown: tuple[Vehicle, Rules]) -> None:
    received, ours = heard(), (1, 2)
    judgement = judge(received, flown[1])
    piloted = Pilot(targets=frozenset({ours}), reached_ours=True)
    for half in range(12):
        time = NOW + half * SECOND // 2
        piloted = pilot.steer(piloted, judgement, received, flown[0], time).pilot
    seconds, demanded = piloted.altitudes[-1]
    assert not pilot.is_diverted(piloted, ours, demanded, seconds)
    assert not pilot.is_diverted(piloted, ours, piloted.altitudes[0][1], seconds)
    assert not pilot.is_diverted(piloted, ours, None, seconds)
    assert pilot.is_diverted(piloted, ours, demanded + 40.0, seconds)
    assert pilot.is_diverted(piloted, (3, 4), demanded, seconds)
    # In the plane it is told no altitude, and whoever changes it does no harm.
    assert not pilot.is_diverted(pilot.release(piloted), ours, demanded + 40.0, seconds)


def on_backup(
    judgement: Judgement, received: Received, time: int, sense: Sense = Sense.LEVEL_OFF
) -> Judgement:
    """Return the judgement at a time, ns, where the backup is flown, of a sense."""
    published = judgement.supervision.published_plan
    supervision = step_monitor(judgement.supervision, received.situation, time)
    supervision = withdraw(supervision, supervision.revision + 1)
    assert fly_mode(supervision) is FlyMode.BACKUP
    assessment, options = supervision.assessment, supervision.thresholds.options
    assert assessment is not None and assessment.in_height is not None
    begin = assessment.in_height.space.begin_backup(assessment.in_height.own)
    held = supervision.monitor.backup._replace(sense=np.array([sense], dtype=np.int8))
    backed = replace(
        supervision,
        monitor=supervision.monitor._replace(backup=held),
        backup_climb=climb_of_backup(sense, begin, float(held.started[0]), options),
        published_plan=published,
    )
    return replace(judgement, supervision=backed)


def test_a_backup_levels_off(flown: tuple[Vehicle, Rules]) -> None:
    received = heard(own_climb=3.0)
    backed = on_backup(judge(received, flown[1]), received, NOW)
    followed = local_plan(backed)
    assert followed is not None and followed.profile is not None
    # 3 m/s that end with 1 m/s^2 take 3 s and 4.5 m.
    height = PlannedHeight(followed.profile, 1.0)
    assert height.at(0.0) == pytest.approx((GROUND + ABOVE, 3.0), abs=0.1)
    assert height.at(60.0) == pytest.approx((GROUND + ABOVE + 4.5, 0.0), abs=0.1)
    assert height.at(3.2) == pytest.approx(height.at(60.0), abs=0.01)


@pytest.mark.parametrize("sense", list(Sense))
def test_a_backup_after_a_plan_begins_at_the_planned_altitude_which_no_gust_moves(
    flown: tuple[Vehicle, Rules], sense: Sense
) -> None:
    """It is judged anew time and again, and told some time after that."""
    judgement, begin = judge(heard(), flown[1]), NOW + 8 * SECOND
    options, started = flown[1].settings.options, local_plan(judgement)
    assert started is not None and started.profile is not None
    acceleration = options.vertical.acceleration
    altitude, climb = PlannedHeight(started.profile, acceleration).at(8.0)
    assert climb > 0.5
    certified = backup_profile(sense, Altitude(altitude, "msl", climb), options)
    assert certified is not None
    expected = PlannedHeight(certified, acceleration)
    for number in range(30):
        time = begin + round(0.3 * number * SECOND)
        off = (-0.9, 0.5, 0.9)[number % 3] * options.vertical_margin
        above = expected.at(0.3 * number).altitude + off - (GROUND + ABOVE)
        gust = heard(own_climb=-8.0, own_above=above, time=time)
        judgement = on_backup(judgement, gust, time, sense)
        for late in (0.15, 0.25):
            told = time + round(late * SECOND)
            piloted = pilot.steer(Pilot(), judgement, gust, flown[0], told).pilot
            assert piloted.followed is not None and piloted.followed.follower.height is not None
            demanded = piloted.followed.follower.height.at(late)
            assert demanded == pytest.approx(expected.at(0.3 * number + late), abs=0.05), number
    # Where the ownship is farther off than the margin, a backup begins where it is.
    above, time = above + 2.0 * options.vertical_margin, time + SECOND // 2
    judgement = on_backup(judgement, heard(own_above=above, time=time), time)
    followed = local_plan(judgement)
    assert followed is not None and followed.profile is not None
    assert followed.profile.altitude[-1] == pytest.approx(GROUND + ABOVE + above, abs=0.05)


@pytest.mark.parametrize("safe", [True, False])
@pytest.mark.parametrize(
    ("sense", "does"),
    [(Sense.LEVEL_OFF, "level"), (Sense.CLIMB, "climbing"), (Sense.DESCEND, "descending")],
)
def test_a_backup_that_is_flown_is_told(
    flown: tuple[Vehicle, Rules], sense: Sense, does: str, safe: bool
) -> None:
    received = heard()
    backed = on_backup(judge(received, flown[1]), received, NOW + SECOND // 10, sense)
    supervision = backed.supervision
    held = supervision.monitor.backup._replace(safe=np.array([safe]))
    supervision = replace(supervision, monitor=supervision.monitor._replace(backup=held))
    state = State(replace(backed, supervision=supervision), received=received)
    texts = [effect.text for effect in explain(state, NOW).effects if isinstance(effect, Say)]
    promise = "" if safe else ": separation not assured"
    assert texts == [f"RLCAS: backup, {does}{promise}"]


def test_the_altitude_is_sent_alone_and_with_the_speed() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot:
        autopilot.bind(("127.0.0.1", 0))
        autopilot.settimeout(5.0)
        link = Link(f"udpout:127.0.0.1:{autopilot.getsockname()[1]}")
        link.steer(Command(0.1, 22.0, 654.3), 1_000, speed=False)
        link.steer(Command(0.1, 22.0, None), 1_100, speed=True)
        link.steer(Command(0.1, 22.0, 654.3), 1_200, speed=True)
        link.say("end")
        reader, messages = dialect.MAVLink(None), []
        while not messages or messages[-1].get_type() != "STATUSTEXT":
            messages += reader.parse_buffer(autopilot.recv(4_096)) or []
        link.close()
    kinds = [message.get_type() for message in messages]
    roll, altitude, speed = "SET_ATTITUDE_TARGET", "SET_POSITION_TARGET_GLOBAL_INT", "COMMAND_INT"
    assert kinds == [roll, roll, speed, roll, altitude, speed, "STATUSTEXT"]
    target = messages[kinds.index(altitude)]
    assert target.alt == pytest.approx(654.3)
    assert (target.type_mask, target.coordinate_frame) == (0xFFFF - 4, 5)


# What is shown.


def test_a_plan_that_climbs_has_altitudes_for_map_programs(flown: tuple[Vehicle, Rules]) -> None:
    published = judge(heard(), flown[1]).supervision.published_plan
    assert published is not None
    shape = json.loads(geojson(published))
    planned = [
        plan_point.altitude.value
        for plan_point in published.points
        if plan_point.altitude is not None
    ]
    assert {len(place) for place in shape["geometry"]["coordinates"]} == {2}
    assert shape["properties"]["altitudes_m"] == pytest.approx(planned, abs=0.05)
    assert shape["properties"]["altitude_reference"] == "msl"
    line = ElementTree.fromstring(kml(published)).find(".//{*}LineString")
    assert line is not None and line.findtext("{*}altitudeMode") == "absolute"
    places = (line.findtext("{*}coordinates") or "").split()
    heights = [float(place.split(",")[2]) for place in places]
    assert heights[1:] == pytest.approx(planned, abs=0.05)
    assert not math.isnan(heights[0])


@pytest.mark.parametrize("recorded", [False, True])
def test_a_display_and_its_recording_draw_a_plan_at_its_altitudes(
    flown: tuple[Vehicle, Rules], recorded: bool, tmp_path: Path
) -> None:
    pytest.importorskip("websockets", reason="the extra display is not installed")
    from ros_bridge.mavlink.adapter import SceneAdapter
    from tests.ros_bridge.displays import page_document

    received = heard()
    judgement = judge(received, flown[1])
    view = View(NOW, received, judgement, Control(), items(ABOVE, ABOVE))
    if recorded:
        pytest.importorskip("mcap_ros2", reason="the extra display is not installed")
        from ros_bridge.display.document import to_json
        from ros_bridge.display.recording import GraphRecording
        from ros_bridge.display.scene_recording import SceneRecorder

        file = tmp_path / "flight.mcap"
        recorder = SceneRecorder(file)
        SceneAdapter(flown[1], recorder.feed)(view)
        recorder.close()
        picture = to_json(GraphRecording(file).player()(0.0))
    else:
        from ros_bridge.display.server import LiveSource

        live = LiveSource()
        SceneAdapter(flown[1], live.feed)(view)
        picture = page_document(live.scene, NOW)
    drawn_altitudes = [point["altitude"] for point in picture["plan"]["points"]]
    assert max(drawn_altitudes) == pytest.approx(max(heights(judgement)), abs=0.1)
