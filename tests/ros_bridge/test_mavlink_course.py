"""The way that is watched is the way that is flown: what comes after the plain waypoints, on both
sides of the antimeridian and of the equator."""

import itertools
import math
from typing import Any

import pytest

pytest.importorskip("pymavlink", reason="the extra mavlink is not installed")

from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from agents.policy.inference import Policy
from envs.formats.local_frame import LocalFrame, distance
from ros_bridge.core.fields import SECOND, FieldError
from ros_bridge.core.reports import Unknown
from ros_bridge.mavlink import mission, vehicle
from ros_bridge.mavlink.course import NEAR, Course, course
from ros_bridge.mavlink.intake import Reading, Received, take
from ros_bridge.mavlink.judging import Judgement, Question, Rules, answer, rules
from ros_bridge.mavlink.mission import SUB, Item
from tests.ros_bridge.test_mavlink import PARAMETERS

Z, SPEED, SEPARATION, RADIUS = (47.4, 8.5), 22.0, 200.0, 60.0
NOW = 100 * SECOND


@pytest.fixture(scope="module")
def watched() -> Rules:
    """Return the rules of a drone that keeps 200 m."""
    flown = vehicle.vehicle_of(PARAMETERS, SEPARATION)
    return rules(
        flown.aircraft,
        Policy.load().for_aircraft(flown.aircraft),
        margin=25.0,
        vertical=100.0,
        unknown=Unknown(5.0, 0.2, 0.0, 0.0),
        deadline=20.0,
    )


def item(number: int, command: int, at: Any = None, home: Any = Z, *more: float) -> Item:
    """Return an item at x and y, m, of home, with its parameters."""
    if at is None:
        return Item(number, command, 0.0, 0.0, 100.0, *more)
    geodetic = LocalFrame(*home).geodetic(*at)
    return Item(number, command, float(geodetic.latitude), float(geodetic.longitude), 100.0, *more)


def heard(own: Any, traffic: Any = (), *, home: Any = Z, eastward: float = SPEED) -> Received:
    """Return what is known: the ownship flies east; others at x, y, vx, vy."""
    frame = LocalFrame(*home)

    def place(x: float, y: float) -> tuple[int, int]:
        at = frame.geodetic(x, y)
        return round(1e7 * float(at.latitude)), round(1e7 * float(at.longitude))

    messages: list[Any] = [
        dialect.MAVLink_wind_message(270.0, 0.0, 0.0),
        dialect.MAVLink_global_position_int_message(
            NOW // 1_000_000, *place(*own), 600_000, 100_000, 0, round(100 * eastward), 0, 9_000
        ),
    ]
    for number, (x, y, vx, vy) in enumerate(traffic):
        track = round(100 * (math.degrees(math.atan2(vx, vy)) % 360.0))
        messages.append(
            dialect.MAVLink_adsb_vehicle_message(
                0xABC123 + number,
                *place(x, y),
                1,
                600_000,
                heading=track,
                hor_velocity=round(100 * math.hypot(vx, vy)),
                ver_velocity=0,
                callsign=b"ABC",
                emitter_type=14,
                tslc=0,
                flags=0x8F,
                squawk=0,
            )
        )
    received = Received()
    for message in messages:
        received = take(received, message, NOW, Reading({}))
    return received


def ahead(items: Any, current: int, received: Received) -> Course:
    """Return the course as the program makes it."""
    own = received.situation.own.last
    assert own is not None
    remaining = mission.remaining_items(items, current)
    return course(items, current, remaining, own.place, own, spacing=SEPARATION, radius=RADIUS)


def judge(items: Any, current: int, received: Received, judging_rules: Rules) -> Judgement:
    """Return what is made of it."""
    fresh, course_ahead = Judgement(judging_rules.begin()), ahead(items, current, received)
    question = Question(fresh, received.situation, course_ahead, NOW, flown=False)
    return answer(question, judging_rules)


LAST = 600.0  # m east, where the last plain waypoint is
BEGIN = (item(0, 16, (-2_500.0, 0.0)), item(1, 22), item(2, 16, (-2_000.0, 0.0)))
BEFORE = (*BEGIN, item(3, 16, (LAST, 0.0)))
TAGGED = (*BEGIN[:2], item(2, 600, None, Z, 7.0), item(3, 16, (LAST, 0.0)))
NORTH = item(2, 16, (LAST, 3_000.0))
# What comes after the last plain waypoint, and which way the mission is flown from there: north or
# on to the east.
AFTER = {
    "nothing": (BEFORE, "east"),
    "loiter": ((*BEFORE, item(4, 18, (2_600.0, 0.0), Z, 3.0)), "east"),
    "landing": ((*BEFORE, item(4, 21, (2_600.0, 0.0))), "east"),
    "an action and a landing": (
        (*BEFORE, item(4, 178), item(5, 21, (LAST, 2_000.0))),
        "north",
    ),
    "jump": ((*BEGIN[:2], NORTH, BEFORE[3], item(4, 177, None, Z, 2.0, -1.0)), "north"),
    "jump, thrice": ((*BEGIN[:2], NORTH, BEFORE[3], item(4, 177, None, Z, 2.0, 3.0)), "north"),
    "jump that is done": (
        (*BEFORE, item(4, 177, None, Z, 2.0, 3.0), item(5, 16, (LAST, 2e3))),
        "north",
    ),
    "jump to a tag": (
        (
            *TAGGED[:3],
            NORTH._replace(number=3),
            TAGGED[3]._replace(number=4),
            item(5, 601, None, Z, 7.0, -1.0),
        ),
        "north",
    ),
    "a script": ((*BEFORE, item(4, 42_702), item(5, 16, (LAST, 2e3))), "east"),
    "an attitude": ((*BEFORE, item(4, 42_703), item(5, 16, (LAST, 2e3))), "east"),
    "a return": ((*BEFORE, item(4, 20), item(5, 16, (LAST, 2e3))), "east"),
}


@pytest.mark.parametrize("distance_left", [pytest.param(450.0, marks=pytest.mark.slow), 40.0])
@pytest.mark.parametrize("action", AFTER)
def test_a_conflict_after_the_last_plain_waypoint_is_found_where_the_mission_is_flown(
    action: str, distance_left: float, watched: Rules
) -> None:
    """An aircraft that crosses 400 m behind the waypoint, and one where nothing leads."""
    items, way = AFTER[action]
    number = next(
        mission_item.number
        for mission_item in items
        if mission_item.number and mission_item.place == BEFORE[3].place
    )
    seconds = (distance_left + 400.0) / SPEED
    crossing = {
        "east": (LAST + 400.0, -20.0 * seconds, 0.0, 20.0),
        "north": (LAST + 20.0 * seconds, 400.0, -20.0, 0.0),
    }
    own = LAST - distance_left, 0.0
    judged = judge(items, number, heard(own, [crossing[way]]), watched)
    assert judged.conflict is not None and judged.conflict.name == "abc123"
    assert judged.problem == "" and judged.plan is not None
    assert judged.conflict.time == pytest.approx(seconds, abs=12.0)
    # Safe where there is time enough to turn.
    assert judged.safe or distance_left < 450.0
    aside = (LAST + 400.0 + 20.0 * seconds, -1_500.0, -20.0, 0.0)
    assert judge(items, number, heard(own, [aside]), watched).conflict is None


@pytest.mark.parametrize("command", [17, 18, 19, 31])
@pytest.mark.parametrize(("distance_left", "seconds"), [(1_500.0, 20.0), (60.0, 40.0)])
def test_a_loiter_is_watched_on_the_way_and_while_it_is_circled(
    command: int, distance_left: float, seconds: float, watched: Rules
) -> None:
    items = (*BEGIN, item(3, command, (LAST, 0.0)), item(4, 16, (9_000.0, 0.0)))
    reached = min(LAST - distance_left + SPEED * seconds, LAST)
    intruder = (reached, -20.0 * seconds, 0.0, 20.0)
    received = heard((LAST - distance_left, 0.0), [intruder])
    judged = judge(items, 3, received, watched)
    assert judged.conflict is not None and judged.plan is not None, judged.problem
    # Straight on over the circle nothing is flown.
    passed = LAST + 900.0, -20.0 * (distance_left + 900.0) / SPEED, 0.0, 20.0
    assert judge(items, 3, heard((LAST - distance_left, 0.0), [passed]), watched).conflict is None


@pytest.mark.parametrize(("radius", "side"), [(300.0, -1.0), (-300.0, 1.0)])
def test_a_circle_has_the_items_radius_and_direction(radius: float, side: float) -> None:
    items = (*BEGIN, item(3, 18, (LAST, 0.0), Z, 3.0, 0.0, radius))
    (way,) = ahead(items, 3, heard((LAST - 900.0, 0.0))).ways
    frame = LocalFrame(*items[3].place)
    at = frame.place([value.latitude for value in way], [value.longitude for value in way])
    far = [math.hypot(x, y) for x, y in zip(at.x.tolist(), at.y.tolist(), strict=True)]
    first = next(n for n, value in enumerate(far) if value < 301.0)
    assert far[first : first + 60] == pytest.approx([300.0] * 60, abs=0.1)
    # Clockwise from the west is by the north.
    assert at.y[first + 5] * side < 0.0


def test_a_landing_is_watched_and_told_but_never_left(watched: Rules) -> None:
    items = (*BEFORE, item(4, 21, (2_600.0, 0.0)))
    crossing = (LAST + 700.0, -400.0, 0.0, 20.0)
    judged = judge(items, 4, heard((LAST + 260.0, 0.0), [crossing]), watched)
    assert judged.conflict is not None and judged.conflict.name == "abc123"
    assert judged.plan is None and judged.problem == "item 4 cannot be left"


def test_a_conflict_that_cannot_be_planned_round_is_kept(watched: Rules) -> None:
    """The points that would be rejoined are at one place."""
    received = heard((0.0, 0.0), [(300.0, -300.0, 0.0, 22.0)])
    own = received.situation.own.last
    assert own is not None
    geodetic = LocalFrame(*Z).geodetic(50.0, 0.0)
    far = LocalFrame(*Z).geodetic(0.0, 20_000_000.0)
    # A route that leaves the frame after its conflict would be refused as a whole.
    items = (
        *BEGIN,
        Item(3, 16, float(geodetic.latitude), float(geodetic.longitude), 100.0),
        Item(4, 16, float(far.latitude), float(far.longitude), 100.0),
    )
    judged = judge(items, 3, received, watched)
    assert judged.conflict is not None and judged.conflict.name == "abc123"


@pytest.mark.parametrize("current", [0, 1, 9])
def test_where_nothing_is_flown_to_it_is_said_so(current: int) -> None:
    with pytest.raises(FieldError, match=f"is at item {current}, where no waypoint"):
        ahead(BEFORE[:2] if current == 0 else BEFORE, current, heard((0.0, 0.0)))


def test_the_navigation_commands_are_ardupilots() -> None:
    """AP_Mission::is_nav_cmd: up to MAV_CMD_NAV_LAST, and three more."""
    more = {213, 42_702, 42_703}
    for command in (*range(16, 96), *more):
        assert item(1, command).flies
    for command in (112, 177, 178, 189, 212, 214, 600, 601, 42_701, 42_704):
        assert not item(1, command).flies
    assert dialect.MAV_CMD_NAV_LAST == 95
    names = ("MAV_CMD_NAV_SET_YAW_SPEED", "MAV_CMD_NAV_SCRIPT_TIME", "MAV_CMD_NAV_ATTITUDE_TIME")
    assert {getattr(dialect, name) for name in names} == more


@pytest.mark.parametrize("kind", ["jump", "jump, thrice", "jump to a tag", "loiter", "landing"])
def test_beyond_the_last_waypoint_the_mission_goes_on_by_its_own_rules(kind: str) -> None:
    """At a jump itself, which the autopilot counts; a landing begins at the waypoint before it."""
    items, _ = AFTER[kind]
    last = next(entry.number for entry in items if entry.number and entry.place == BEFORE[3].place)
    route = ahead(items, last, heard((LAST - 300.0, 0.0))).route
    beyond = [entry for entry in route if entry.index // SUB != last]
    assert len(beyond) >= 12
    expected = last if kind == "landing" else last + 1
    assert {mission.item_after_rejoin(entry.index, items) for entry in beyond} == {expected}
    at_waypoint = last * SUB + SUB - 1
    assert mission.item_after_rejoin(at_waypoint, items) == last + 1


@pytest.mark.parametrize("turn", [0.0, 1.0, 2.5, -2.0])
def test_behind_the_last_waypoint_the_route_goes_on_as_the_last_leg(turn: float) -> None:
    corner = (LAST + 2_000.0 * math.cos(turn), 2_000.0 * math.sin(turn))
    items = (*BEFORE, item(4, 16, corner))
    for repeated in ((), (item(5, 16, corner),)):  # a waypoint at the same place
        route = ahead((*items, *repeated), 2, heard((-2_200.0, 0.0))).route
        frame = LocalFrame(*Z)
        first, last = (
            frame.place(route_point.latitude, route_point.longitude)
            for route_point in (route[-12], route[-1])
        )
        course_on = math.atan2(float(last.y - first.y), float(last.x - first.x))
        assert math.remainder(course_on - turn, math.tau) == pytest.approx(0.0, abs=1e-3)
        assert math.dist((float(first.x), float(first.y)), corner) == pytest.approx(200.0, abs=1.0)


@given(
    st.integers(0, 8),
    st.lists(st.sampled_from([16, 17, 18, 21, 177, 178, 600, 601, 42_702]), max_size=8),
    st.lists(st.integers(-1, 9), min_size=16, max_size=16),
)
@settings(max_examples=40)
def test_every_mission_has_a_course_or_is_said_to_have_none(
    current: int, commands: list[int], values: list[int]
) -> None:
    items = [item(0, 16, (0.0, 0.0))]
    for number, command in enumerate(commands, 1):
        at = None if command in (177, 178, 600, 601) else (300.0 * number, 50.0 * values[number])
        items.append(item(number, command, at, Z, float(values[number]), float(values[-number])))
    try:
        course_ahead = ahead(items, current, heard((100.0, 0.0)))
    except FieldError as error:
        assert "no waypoint" in str(error)
        return
    for route in (course_ahead.route, *course_ahead.ways):
        assert len(route) >= 2
        assert len({route_point.index for route_point in route}) == len(route)
        places = [(route_point.latitude, route_point.longitude) for route_point in route]
        assert min(distance(*a, *b) for a, b in itertools.pairwise(places)) >= 1.0
    assert course_ahead.ways


def test_a_waypoint_that_the_plan_skips_is_remarked_and_no_point_between_two(watched: Rules):
    items = (item(0, 16, (0.0, 0.0)), *(item(n, 16, (900.0 * n - 200.0, 0.0)) for n in (1, 2, 3)))
    slow = heard((0.0, 0.0), [(700.0, 60.0, 0.5, 0.0)])  # at the first waypoint, all the time
    judged = judge(items, 1, slow, watched)
    assert judged.safe
    assert [text for text in judged.remarks if "skipped" in text] == ["waypoint 1 skipped"]


# Longitudes.


@given(
    st.floats(-75.0, 75.0),
    st.floats(-179.9, 179.9),
    st.lists(
        st.tuples(st.floats(-4_000.0, 4_000.0), st.floats(-4_000.0, 4_000.0)),
        min_size=1,
        max_size=4,
        unique=True,
    ),
)
def test_a_route_is_the_same_at_every_longitude(
    latitude: float, longitude: float, corners: list[tuple[float, float]]
) -> None:
    """Turned round the earth's axis, over the antimeridian too."""
    reference = _turned(latitude, 10.0, corners)
    for east in (longitude, 180.0, -180.0, 179.99, -179.99):
        turned = _turned(latitude, east, corners)
        assert len(turned) == len(reference)
        for (a_lat, a_lon), (b_lat, b_lon) in zip(reference, turned, strict=True):
            assert b_lat == pytest.approx(a_lat, abs=1e-9)
            assert math.remainder(b_lon - east - a_lon + 10.0, 360.0) == pytest.approx(
                0.0, abs=1e-9
            )
            assert -180.0 <= b_lon <= 180.0


def _turned(
    latitude: float, longitude: float, corners: list[tuple[float, float]]
) -> list[tuple[float, float]]:
    frame = LocalFrame(latitude, 0.0)
    items = []
    for number, corner in enumerate(corners, 1):
        at = frame.geodetic(*corner)
        east = math.remainder(longitude + float(at.longitude), 360.0)
        items.append(Item(number, 16, float(at.latitude), east, 100.0))
    route = mission.route((latitude, longitude), items, 200.0)
    return [(route_point.latitude, route_point.longitude) for route_point in route]


@pytest.mark.parametrize("home", [(-45.0, 179.98), (0.0, 10.0), (-17.0, -179.98), (0.0, 180.0)])
def test_a_conflict_is_the_same_everywhere(home: tuple[float, float], watched: Rules) -> None:
    reference, elsewhere = _crossed(Z, watched), _crossed(home, watched)
    assert reference.conflict is not None and elsewhere.conflict is not None, elsewhere.problem
    assert elsewhere.conflict.time == pytest.approx(reference.conflict.time, abs=0.5)
    assert reference.safe and elsewhere.safe


def _crossed(home: tuple[float, float], watched: Rules) -> Judgement:
    items = [
        item(number, 16, at, home)
        for number, at in enumerate([(0.0, 0.0), (0.0, 0.0), (3e3, 0.0), (6e3, 3e3)])
    ]
    received = heard((500.0, 0.0), [(500.0 + 25.0 * SPEED, -500.0, 0.0, 20.0)], home=home)
    return judge(items, 2, received, watched)


def test_a_leg_that_is_longer_than_a_frame_is_watched_and_planned(watched: Rules) -> None:
    """300 km, in its midst: what is far behind and far ahead is left out."""
    items = [item(0, 16, (0.0, 0.0)), item(1, 16, (-150e3, 0.0)), item(2, 16, (150e3, 0.0))]
    frame = LocalFrame(*Z)
    middle = mission.route(items[1].place, items[2:], 150e3)[0]
    at = frame.place(middle.latitude, middle.longitude)
    x, y = float(at.x), float(at.y)
    received = heard((x, y), [(x + 25.0 * SPEED, y - 500.0, 0.0, 20.0)])
    course_ahead = ahead(items, 2, received)
    own = received.situation.own.last
    assert own is not None
    assert all(
        distance(*own.place, route_point.latitude, route_point.longitude) <= NEAR
        for route_point in course_ahead.route
    )
    judged = judge(items, 2, received, watched)
    assert judged.problem == "" and judged.conflict is not None
    assert judged.safe


def test_the_leg_before_begins_at_a_waypoint_on_the_equator() -> None:
    items = (Item(1, 16, 0.0, 10.0, 100.0), Item(2, 16, 0.01, 10.01, 100.0))
    assert mission.item_before(items, 2) == items[0]
