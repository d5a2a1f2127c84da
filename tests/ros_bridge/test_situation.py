"""From what was received to the planner's task: what is refused, under which code, and what the
task holds.
"""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from agents.planner.answer import AdvisoryCode, Apart, Plan
from agents.planner.planner import plan
from agents.planner.recheck import recheck
from agents.planner.request.options import Options
from agents.planner.request.request import check_request
from agents.policy.inference import Policy
from envs.formats.local_frame import LocalFrame
from ros_bridge.core import updates
from ros_bridge.core.aircraft import aircraft_of
from ros_bridge.core.conversions import Published
from ros_bridge.core.fields import Code
from ros_bridge.core.replies import plan_points, start_point, to_frame
from ros_bridge.core.reports import USUAL, Unknown
from ros_bridge.core.situation import NOTHING, Situation
from ros_bridge.core.tasks import PlanTask, in_terms_of_messages, task
from ros_bridge.core.tracks import Rules
from tests.ros_bridge.scenes import (
    FRAME,
    NOW,
    RULES,
    SECOND,
    SETTINGS,
    aircraft,
    alert,
    crossing,
    geo_reference,
    point,
    publish,
    refusal,
    route_points,
    situation_after,
)


def test_complete_situation_is_a_task():
    requested = task(situation_after(crossing()), NOW, SETTINGS)
    assert requested.own == pytest.approx((0.0, 0.0, 0.0, 75.0), abs=1e-6)
    assert requested.identifiers == ("4b1a2c",)
    assert requested.intruders[0].state == pytest.approx(
        (8_000.0, -8_000.0, math.pi / 2.0, 75.0), abs=1e-6
    )
    assert [place.index for place in requested.points] == list(range(7, 17))
    assert requested.points[0].x == pytest.approx(5_000.0, abs=1e-6)
    assert [(note.code, note.field) for note in requested.notes] == [
        (AdvisoryCode.WIND_UNKNOWN, "ownship.wind")
    ]


def test_what_an_intruder_does_not_report_is_assumed_and_said_by_its_name():
    unknown = Unknown(200.0, 2.0)
    requested = task(situation_after(crossing(valid=0x05)), NOW, replace(SETTINGS, unknown=unknown))
    assert (requested.intruders[0].position_std, requested.intruders[0].velocity_std) == unknown[:2]
    assert [
        in_terms_of_messages(note.field, requested.identifiers)
        for note in requested.notes
        if note.code is AdvisoryCode.ASSUMED
    ] == ["intruder 4b1a2c.position_std", "intruder 4b1a2c.velocity_std"]


@pytest.mark.parametrize("valid", [0xC5, 0x05])
def test_a_velocity_that_jumps_is_refused(valid: int):
    late = NOW + SECOND
    own = aircraft(0.0, 0.0, 0.0, 75.0, id="own", time=late)
    reports = [
        aircraft(8_000.0, y, heading, 75.0, time=time, valid=valid)
        for y, heading, time in (
            (-8_000.0, math.pi / 2.0, NOW),
            (-7_930.0, -math.pi / 2.0, late),
        )
    ]
    assert refusal(situation_after(*reports, own=own, now=late), late) == (
        Code.INVALID_INTRUDER,
        "intruder 4b1a2c.velocity",
    )


@given(
    st.sampled_from([(0.0, 0.0), (47.0, 8.0), (-33.0, 179.99), (89.0, 20.0)]),
    st.floats(-60_000.0, 60_000.0),
    st.floats(-60_000.0, 60_000.0),
    st.floats(-math.pi, math.pi, exclude_max=True),
    st.floats(0.0, 1.5),
)
def test_the_ownship_is_carried_to_the_request(
    origin, x: float, y: float, heading: float, age: float
):
    frame = LocalFrame(*origin)
    late = NOW + round(age * SECOND)
    state = task(
        situation_after(own=aircraft(x, y, heading, 75.0, id="own", frame=frame), frame=frame),
        late,
        SETTINGS,
    ).own
    assert state.x == pytest.approx(x + 75.0 * age * math.cos(heading), abs=1e-3)
    assert state.y == pytest.approx(y + 75.0 * age * math.sin(heading), abs=1e-3)
    assert abs(math.remainder(state.heading - heading, 2.0 * math.pi)) < 1e-9


def test_intruder_keeps_its_position_and_gets_an_age():
    late = NOW + SECOND
    situation = situation_after(
        crossing(), own=aircraft(0.0, 0.0, 0.0, 75.0, id="own", time=late), now=late
    )
    [intruder] = task(situation, late, SETTINGS).intruders
    assert intruder.age == pytest.approx(1.0)
    assert intruder.state.y == pytest.approx(-8_000.0, abs=1e-6)


def test_turn_shown_by_reports_is_expected_to_go_on():
    later, late = math.pi / 2.0 + math.radians(3.0), NOW + SECOND
    turned = aircraft(8_000.0, -7_925.0, later, 75.0, time=late)
    situation = situation_after(
        crossing(), turned, own=aircraft(0.0, 0.0, 0.0, 75.0, id="own", time=late), now=late
    )
    [intruder] = task(situation, late + SECOND // 2, SETTINGS).intruders
    assert intruder.turn_rate == pytest.approx(math.radians(3.0), rel=1e-3)
    assert (intruder.age, intruder.turn_time) == (
        pytest.approx(0.5),
        15.0,
    )  # the planner counts it from the report


def test_a_turning_ownship_is_advanced_along_its_arc():
    rate, age = math.radians(3.0), 1.2
    late, second = NOW + SECOND, aircraft(74.0, 2.0, rate, 75.0, id="own", time=NOW + SECOND)
    situation = updates.ownship(situation_after(), second, late, RULES)
    state = task(situation, late + round(age * SECOND), SETTINGS).own
    radius, turned = 75.0 / rate, rate + rate * age
    assert state.heading == pytest.approx(turned, abs=1e-4)
    assert state.x == pytest.approx(74.0 + radius * (math.sin(turned) - math.sin(rate)), abs=0.01)
    assert state.y == pytest.approx(2.0 + radius * (math.cos(rate) - math.cos(turned)), abs=0.01)


def test_missing_input_is_named():
    complete = situation_after(crossing())
    assert refusal(complete, 0) == (Code.NO_CLOCK, "clock")
    assert refusal(replace(complete, origin=NOTHING)) == (Code.NO_GEO_REFERENCE, "geo_reference")
    assert refusal(replace(complete, own=Situation().own)) == (Code.NO_OWNSHIP, "ownship")
    assert refusal(replace(complete, route=NOTHING)) == (Code.NO_ROUTE, "route")
    assert refusal(situation_after(crossing(), alerts=[alert("4b1a2c", "beef01")])) == (
        Code.NO_INTRUDER,
        "intruder beef01",
    )


def test_stale_input_is_named():
    late = NOW + 2 * SECOND
    assert refusal(situation_after(), late) == (Code.STALE_OWNSHIP, "ownship.header.stamp")
    late = NOW + 6 * SECOND
    situation = situation_after(
        crossing(), own=aircraft(0.0, 0.0, 0.0, 75.0, id="own", time=late), now=late
    )
    assert refusal(situation, late) == (Code.STALE_INTRUDER, "intruder 4b1a2c.header.stamp")


def test_future_stamp_is_named():
    early = NOW - SECOND
    assert refusal(situation_after(now=early), early) == (
        Code.FUTURE_OWNSHIP,
        "ownship.header.stamp",
    )
    ahead = crossing(time=NOW + SECOND)
    assert refusal(situation_after(ahead)) == (Code.FUTURE_INTRUDER, "intruder 4b1a2c.header.stamp")
    assert refusal(situation_after(crossing(), alerts=[alert("4b1a2c", time=NOW + SECOND)])) == (
        Code.INVALID_ALERT,
        "alert.header.stamp",
    )


def test_unreadable_input_is_named_until_it_is_replaced():
    bad = crossing(latitude=math.nan)
    assert refusal(situation_after(bad)) == (Code.INVALID_INTRUDER, "intruder 4b1a2c.latitude")
    assert refusal(situation_after(crossing(), bad)) == (
        Code.INVALID_INTRUDER,
        "intruder 4b1a2c.latitude",
    )
    later = crossing(time=NOW + SECOND // 10)
    assert task(
        situation_after(crossing(), bad, later), NOW + SECOND // 10, SETTINGS
    ).identifiers == ("4b1a2c",)

    broken = aircraft(0.0, 0.0, 0.0, math.inf, id="own")
    assert refusal(situation_after(own=broken)) == (Code.INVALID_OWNSHIP, "ownship.velocity.x")
    assert refusal(situation_after(reference=geo_reference(latitude=math.nan))) == (
        Code.INVALID_GEO_REFERENCE,
        "geo_reference.latitude",
    )
    twice = [point(1, 47.0, 8.0), point(1, 47.0, 8.1)]
    assert refusal(situation_after(points=twice)) == (
        Code.INVALID_ROUTE,
        "route.waypoints[1].index",
    )


def test_places_far_from_the_geo_reference_are_refused_or_left_out():
    assert refusal(situation_after(own=aircraft(101_000.0, 0.0, 0.0, 75.0, id="own"))) == (
        Code.INVALID_OWNSHIP,
        "ownship.position",
    )
    assert refusal(situation_after(points=route_points(spacing=11_000.0))) == (
        Code.INVALID_ROUTE,
        "route.waypoints[9]",
    )
    far = aircraft(301_000.0, 0.0, 0.0, 75.0)
    # The planner leaves out what cannot come near.
    requested = task(situation_after(far), NOW, SETTINGS)
    _, excluded, _ = check_request(
        requested.own, requested.intruders, requested.points, requested.options
    )
    assert requested.identifiers == ("4b1a2c",)
    assert [exclusion.apart for exclusion in excluded] == [Apart.FAR]


@pytest.mark.parametrize(
    ("own_id", "echo"),
    [("own", "own"), ("4B1A2C", "4b1a2c"), ("4b1a2c", " 4B1A2C  "), ("4b1a2c", "4B1A2C\t\n")],
)
def test_own_transmission_received_again_is_no_intruder(own_id: str, echo: str):
    own, copy = aircraft(0.0, 0.0, 0.0, 75.0, id=own_id), aircraft(0.0, 0.0, 0.0, 75.0, id=echo)
    assert task(situation_after(copy, own=own), NOW, SETTINGS).identifiers == ()
    before = updates.traffic(Situation(), copy, NOW, RULES)
    assert list(before.traffic) == ["4b1a2c" if own_id != "own" else "own"]
    assert not updates.ownship(before, own, NOW, RULES).traffic


def test_another_aircraft_with_the_ownships_id_counts():
    own = aircraft(0.0, 0.0, 0.0, 75.0, id="4B1A2C")
    far = aircraft(8_000.0, 0.0, math.pi, 75.0, id="4b1a2c")
    assert task(situation_after(far, own=own), NOW, SETTINGS).identifiers == ("4b1a2c",)
    before = updates.traffic(Situation(), far, NOW, RULES)
    assert list(updates.ownship(before, own, NOW, RULES).traffic) == ["4b1a2c"]
    # Without a place it is taken for the own transmission.
    assert (
        task(
            situation_after(aircraft(0.0, 0.0, 0.0, 75.0, id="4b1a2c", valid=0), own=own),
            NOW,
            SETTINGS,
        ).identifiers
        == ()
    )


def test_alert_names_an_aircraft_in_any_case():
    requested = task(
        situation_after(crossing(id="4B1A2C "), alerts=[alert("4b1A2c")]), NOW, SETTINGS
    )
    assert requested.identifiers == ("4b1a2c",)


def test_copy_of_the_ownship_under_another_id_is_noted():
    requested = task(
        situation_after(aircraft(30.0, -20.0, 0.02, 76.0, id="tisb01"), crossing()), NOW, SETTINGS
    )
    assert requested.identifiers == ("4b1a2c", "tisb01")
    copies = [note for note in requested.notes if note.code is AdvisoryCode.POSSIBLE_COPY]
    assert [in_terms_of_messages(note.field, requested.identifiers) for note in copies] == [
        "intruder tisb01"
    ]


def test_msl_heights_are_comparable_with_the_undulation_only():
    own = aircraft(
        0.0, 0.0, 0.0, 75.0, id="own", valid=0x07, altitude=1_000.0, altitude_reference=1
    )
    intruder = crossing(valid=0x07, altitude=2_000.0, altitude_reference=2)
    without = task(situation_after(intruder, own=own), NOW, SETTINGS)
    assert (
        without.intruders[0].altitude is not None
        and without.intruders[0].altitude.reference == "msl"
    )
    undulated = geo_reference(geoid_undulation_valid=True, geoid_undulation=47.5)
    with_undulation = task(situation_after(intruder, own=own, reference=undulated), NOW, SETTINGS)
    assert with_undulation.intruders[0].altitude is not None
    assert (
        with_undulation.intruders[0].altitude.value,
        with_undulation.intruders[0].altitude.reference,
    ) == (
        2_047.5,
        "wgs84",
    )


@given(st.floats(-12.0, 12.0), st.floats(-12.0, 12.0))
def test_the_wind_is_planned_in_and_narrows_nothing(east: float, north: float):
    settings = replace(SETTINGS, unknown=USUAL._replace(reported_wind_std=0.7))
    blows = SimpleNamespace(x=east, y=north, z=0.0)
    own = aircraft(0.0, 0.0, 0.0, 75.0, id="own", valid=0x25, wind=blows)
    requested = task(situation_after(own=own), NOW, settings)
    assert requested.options == settings.options
    assert requested.wind == pytest.approx((east, north, 0.7))
    assert requested.notes == ()


def test_an_unknown_wind_may_blow_from_anywhere():
    unknown = Unknown(wind_std=4.0, reported_wind_std=0.7)
    requested = task(situation_after(), NOW, replace(SETTINGS, unknown=unknown))
    assert requested.wind == (0.0, 0.0, 4.0)
    texts = [note.text for note in requested.notes if note.code is AdvisoryCode.WIND_UNKNOWN]
    assert texts == ["is unknown and taken as calm within 4 m/s (one sigma)"]


def test_the_wind_turns_with_true_north_into_the_frame():
    far = LocalFrame(FRAME.latitude, FRAME.longitude - 1.2)
    blows = SimpleNamespace(x=10.0, y=0.0, z=0.0)
    at = far.place(FRAME.latitude, FRAME.longitude)
    own = aircraft(float(at.x), float(at.y), 0.0, 75.0, id="own", valid=0x25, wind=blows, frame=far)
    requested = task(situation_after(own=own, frame=far), NOW, SETTINGS)
    turn = float(at.convergence)
    assert abs(turn) > 0.01
    assert (requested.wind.east, requested.wind.north) == pytest.approx(
        (10.0 * math.cos(turn), 10.0 * math.sin(turn)), abs=1e-9
    )


def test_a_turn_of_the_track_is_planned_as_one_through_the_air():
    blows = SimpleNamespace(x=-20.0, y=0.0, z=0.0)
    own = aircraft(0.0, 0.0, 0.0, 55.0, id="own", valid=0x25, wind=blows)
    situation = situation_after(own=own)
    rate = math.radians(2.0)
    # Through the air it flies 20 m/s faster than over the ground, and turns less quickly.
    for second in range(-2, 1):
        moment = NOW + second * SECOND
        heading = rate * second
        radius = 50.0 / rate
        message = aircraft(
            8_000.0 + radius * math.sin(heading),
            -8_000.0 - radius * math.cos(heading),
            heading,
            50.0,
            time=moment,
        )
        situation = updates.traffic(situation, message, moment, RULES)
    turning = task(situation, NOW, SETTINGS).intruders[0]
    assert turning.turn_rate == pytest.approx(rate * 50.0 / 70.0, rel=0.03)


@pytest.mark.parametrize("name", ["c208", "uas", "light"])
@pytest.mark.parametrize("share", [0.25, 0.5, 0.9, 1.01])
def test_a_wind_is_refused_only_where_the_aircraft_cannot_fly_against_it(name: str, share: float):
    """10 m/s are a quarter of what a small aircraft flies, and an ordinary day."""
    aircraft_named = aircraft_of(name, "")
    settings = replace(SETTINGS, options=Options.for_aircraft(aircraft_named))
    speed = share * aircraft_named.limits.speed_max
    blows = SimpleNamespace(x=-0.6 * speed, y=0.8 * speed, z=0.0)
    east = (
        aircraft_named.limits.speed_max + blows.x
    )  # it flies east through the air, as fast as it can
    own = aircraft(
        0.0,
        0.0,
        math.atan2(blows.y, east),
        math.hypot(east, blows.y),
        id="own",
        valid=0x25,
        wind=blows,
    )
    situation = situation_after(own=own)
    if share < 1.0:
        assert task(situation, NOW, settings).wind.speed == pytest.approx(speed, rel=1e-6)
    else:
        assert refusal(situation, settings=settings) == (Code.INVALID_OWNSHIP, "ownship.wind")


@pytest.mark.parametrize("origin", [(0.0, 179.99), (47.0, 8.0), (89.0, -20.0)])
def test_a_plan_survives_its_way_over_the_ellipsoid(origin: tuple[float, float]):
    frame = LocalFrame(*origin)
    situation = situation_after(
        aircraft(8_000.0, -8_000.0, math.pi / 2.0, 75.0, frame=frame), frame=frame
    )
    requested = task(situation, NOW, SETTINGS)
    result = plan(
        requested.own, requested.intruders, requested.points, Policy.load(), requested.options
    )
    points = plan_points(result, requested)
    assert len(points) == 20
    assert [place.of_route for place in points] == [False] * 19 + [True]
    start = start_point(frame, requested.own, requested.time, requested.own_altitude)
    own, waypoints = to_frame(frame, Published(b"", 1, requested.time, start, points, ()))
    assert own == pytest.approx(tuple(requested.own), abs=1e-6)
    for back, sent in zip(waypoints, result.waypoints, strict=True):
        assert back.index == sent.index
        assert math.hypot(back.x - sent.x, back.y - sent.y) <= 1e-6
        assert abs(math.remainder(back.heading - sent.heading, 2.0 * math.pi)) <= 1e-9
        assert back.speed == sent.speed
        assert back.time == pytest.approx(sent.time, abs=1e-9)
    # Ground speed and track of each waypoint point to where the aircraft is a second later.
    at = frame.geodetic(
        np.array([w.x + w.speed * math.cos(w.heading) for w in waypoints]),
        np.array([w.y + w.speed * math.sin(w.heading) for w in waypoints]),
    )
    for place, latitude, longitude in zip(points, at.latitude, at.longitude, strict=True):
        place_back = LocalFrame(place.latitude, place.longitude).place(latitude, longitude)
        track = math.degrees(math.atan2(float(place_back.x), float(place_back.y)))
        assert abs(math.remainder(track - place.track_deg, 360.0)) <= 1e-3


# A plan that took long is SAFE only if it still is from where everybody is by then.


def at(
    seconds: float,
    intruder: tuple[float, float, float],
    own: tuple[float, float, float] | None = None,
) -> PlanTask:
    """Return the task some seconds after NOW, the ownship having flown straight on where nothing
    else is said.
    """
    now = NOW + round(seconds * SECOND)
    rules = Rules(jump_distance=1e5)
    situation = updates.geo_reference(Situation(), geo_reference(), now, rules)
    situation = updates.route(situation, publish(route_points()), now, rules)
    place = own or (75.0 * seconds, 0.0, 0.0)
    situation = updates.ownship(situation, aircraft(*place, 75.0, time=now, id="own"), now, rules)
    situation = updates.traffic(situation, aircraft(*intruder, 75.0, time=now), now, rules)
    return task(situation, now, SETTINGS)


def revalidate(plan: Plan, plan_task: PlanTask, present: PlanTask) -> Plan:
    late, now = (present.time - plan_task.time) / SECOND, present
    return recheck(plan, late, now.own, now.intruders, now.points, now.options, now.own_altitude)


@pytest.fixture(scope="module")
def plan_task() -> PlanTask:
    return at(0.0, (9_000.0, 0.0, math.pi))


@pytest.fixture(scope="module")
def safe_plan(plan_task: PlanTask) -> Plan:
    result = plan(
        plan_task.own, plan_task.intruders, plan_task.points, Policy.load(), plan_task.options
    )
    assert result.safe
    return result


def test_plan_without_delay_is_unchanged(safe_plan: Plan, plan_task: PlanTask):
    assert revalidate(safe_plan, plan_task, plan_task) is safe_plan


@pytest.mark.parametrize("late", [0.5, 2.0])
def test_ownship_on_its_prediction_keeps_the_plan(
    safe_plan: Plan, plan_task: PlanTask, late: float
):
    roomy = replace(
        plan_task.options,
        requirement=plan_task.options.requirement._replace(margin=0.0, separation=950.0),
    )
    present = replace(at(late, (9_000.0 - 75.0 * late, 0.0, math.pi)), options=roomy)
    assert revalidate(safe_plan, plan_task, present).safe


def test_intruder_off_its_prediction_voids_the_plan(safe_plan: Plan, plan_task: PlanTask):
    side = math.copysign(1.0, safe_plan.waypoints[1].y)
    late = revalidate(safe_plan, plan_task, at(2.0, (2_500.0, side * 600.0, math.pi)))
    assert not late.safe
    assert late.reasons[0].message.startswith(
        "plan was found 2.0 s after the request and is too late"
    )
    assert "separation" in late.reasons[0].message


def test_an_ownship_that_turned_away_cannot_join_it(safe_plan: Plan, plan_task: PlanTask):
    away = revalidate(
        safe_plan, plan_task, at(4.0, (8_700.0, 0.0, math.pi), own=(0.0, 0.0, math.pi))
    )
    assert not away.safe


def test_unsafe_plan_stays_unsafe(safe_plan: Plan, plan_task: PlanTask):
    unsafe = replace(safe_plan, status=type(safe_plan.status).UNRESOLVED)
    assert revalidate(unsafe, plan_task, at(1.0, (8_925.0, 0.0, math.pi))) is unsafe
