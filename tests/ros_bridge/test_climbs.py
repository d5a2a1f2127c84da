"""Plans that climb through the bridge: from reports to messages and back, and their flight."""

import functools
import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from agents.assurance.backup import Sense
from agents.assurance.backup_heights import backup_profile
from agents.assurance.space import climb_of_backup
from agents.assurance.thresholds import Thresholds
from agents.kernel.levels import Altitude
from agents.planner.answer import Plan, RequestError, Source
from agents.planner.request.options import Maneuvers, Options
from agents.policy.inference import Policy
from envs.areas import Level
from envs.follower import PERIOD
from envs.formats.local_frame import LocalFrame
from envs.profile import Height, climbing, height_flown, profile_of, rise_to_level
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.waypoints import Waypoint, legs, plan_states
from ros_bridge.core import conversions, replies, updates
from ros_bridge.core.aircraft import aircraft_of
from ros_bridge.core.assurance import activate, backup, initial, step_monitor
from ros_bridge.core.conversions import PlanPoint, Published
from ros_bridge.core.fields import Code, FieldError, Refusal
from ros_bridge.core.motion import Turns
from ros_bridge.core.planning import plan_task, rehearse
from ros_bridge.core.reach import with_climbs
from ros_bridge.core.replies import to_frame
from ros_bridge.core.reports import EXACT as EXACT_REPORTS
from ros_bridge.core.situation import Situation
from ros_bridge.core.tasks import PlanTask, Settings, refusal_of, task
from ros_bridge.display.heights import Heights
from ros_bridge.display.shapes import draw_plan
from ros_bridge.sim.climbing import follow
from ros_bridge.sim.guidance import Flying
from ros_bridge.sim.world import ALTITUDE, EncounterFlight
from tests.ros_bridge.scenes import (
    EXACT,
    FRAME,
    NOW,
    RULES,
    SECOND,
    aircraft,
    geo_reference,
    point,
    route_points,
    situation_after,
    stamp,
)

UAS = aircraft_of("uas", "")
POLICY = Policy.load().for_aircraft(UAS)
assert UAS.vertical is not None
VERTICAL = UAS.vertical
KNOWN = EXACT | conversions.ALTITUDE | conversions.VERTICAL_SPEED
MSL, PRESSURE = 2, 3
FLOOR = Level(480.0, "msl")


def settings(maneuvers: Maneuvers = Maneuvers.VERTICAL, **changes: Any) -> Settings:
    option_values = {"deadline_s": math.inf, "extend_route": True, "maneuvers": maneuvers} | changes
    options = Options.for_aircraft(UAS, **option_values)
    return Settings(options, Turns.of(Thresholds.for_plans(options)), unknown=EXACT_REPORTS)


def meeting(
    undulation: float | None = None,
    points: Any = None,
    intruder_reference: int = MSL,
    climb: float = 0.0,
) -> Situation:
    """Return an ownship that flies east along its route, 500 m above the sea, with a climb, m/s,
    and an intruder that meets it head-on at the same height.
    """
    level = {"valid": KNOWN, "altitude": 500.0}
    return situation_after(
        aircraft(3_000.0, 0.0, math.pi, 25.0, altitude_reference=intruder_reference, **level),
        own=aircraft(0.0, 0.0, 0.0, 25.0, id="own", altitude_reference=MSL, climb=climb, **level),
        reference=geo_reference(
            geoid_undulation_valid=undulation is not None, geoid_undulation=undulation or 0.0
        ),
        points=points,
    )


def made(situation: Situation, chosen_settings: Settings) -> tuple[PlanTask, Plan]:
    requested = task(situation, NOW, chosen_settings)
    return requested, plan_task(requested, POLICY, exhaustive=False)


@functools.cache
def usual(maneuvers: Maneuvers = Maneuvers.VERTICAL) -> tuple[PlanTask, Plan]:
    return made(meeting(), settings(maneuvers))


def published(requested: PlanTask, answer: Plan) -> Published:
    return replies.published(answer, requested, 1, bytes(16))


# From reports to plans.


def test_a_plan_climbs_over_what_comes_head_on():
    answer = usual()[1]
    assert answer.safe and answer.source is Source.VERTICAL
    heights = [point.altitude for point in answer.waypoints]
    assert max(abs(height - 500.0) for height in heights if height) > VERTICAL.separation
    in_plane = usual(Maneuvers.HORIZONTAL)[1]
    assert all(point.altitude is None for point in in_plane.waypoints)


def test_floor_and_ceiling_are_above_the_sea_also_where_altitudes_are_above_the_ellipsoid():
    bounded = settings(floor=FLOOR, ceiling=Level(700.0, "msl"))
    requested = task(meeting(undulation=48.0), NOW, bounded)
    assert requested.own_altitude is not None and requested.own_altitude.value == 548.0
    assert requested.options.floor == Level(528.0, "wgs84")
    assert requested.options.ceiling == Level(748.0, "wgs84")
    answer = plan_task(requested, POLICY, exhaustive=False)
    assert answer.safe
    assert all(528.0 <= (point.altitude or 0.0) <= 748.0 for point in answer.waypoints)


def test_a_floor_of_another_reference_is_refused_by_its_name():
    requested = task(meeting(), NOW, settings(floor=Level(100.0, "pressure")))
    with pytest.raises(RequestError) as caught:
        plan_task(requested, POLICY, exhaustive=False)
    refusal = refusal_of(caught.value, requested)
    assert refusal.code is Code.INVALID_TASK and refusal.field == "options.floor.reference"
    assert "expected the ownship's" in str(refusal)


def test_an_ownship_without_a_vertical_speed_is_refused_where_plans_may_climb():
    own = aircraft(0.0, 0.0, 0.0, 25.0, id="own", valid=EXACT | conversions.ALTITUDE)
    own.altitude_reference = MSL
    in_plane = task(situation_after(own=own), NOW, settings(Maneuvers.HORIZONTAL))
    assert plan_task(in_plane, POLICY, exhaustive=False).safe
    requested = task(situation_after(own=own), NOW, settings())
    with pytest.raises(RequestError) as caught:
        plan_task(requested, POLICY, exhaustive=False)
    refusal = refusal_of(caught.value, requested)
    assert refusal.code is Code.INVALID_OWNSHIP
    assert refusal.field == "own_altitude.vertical_speed"


def points_at(height: float, reference: int) -> list[Any]:
    points = route_points()
    for point_message in points:
        point_message.valid, point_message.altitude, point_message.altitude_reference = (
            1,
            height,
            reference,
        )
    return points


def test_the_route_keeps_its_altitudes_where_they_can_be_compared():
    vertical = settings()
    requested = task(meeting(points=points_at(520.0, MSL)), NOW, vertical)
    assert {place.altitude for place in requested.points} == {520.0}
    assert not any(note.field == "route.altitude" for note in requested.notes)
    by_pressure = task(meeting(points=points_at(520.0, PRESSURE)), NOW, vertical)
    assert {place.altitude for place in by_pressure.points} == {None}
    (note,) = [note for note in by_pressure.notes if note.field == "route.altitude"]
    assert "pressure" in note.text and "not kept" in note.text
    in_plane = task(meeting(points=points_at(520.0, MSL)), NOW, settings(Maneuvers.HORIZONTAL))
    assert {place.altitude for place in in_plane.points} == {None}


def test_who_is_above_counts_as_far_as_the_ownship_may_climb():
    situation = meeting()
    vertical = settings()
    own = situation.own.last
    assert own is not None
    climbing_own = with_climbs(own, vertical.options)
    assert climbing_own.altitude is not None
    assert climbing_own.altitude.climb(0.0) == (0.0, VERTICAL.climb_max)
    # 900 m above, silent: of no concern in the plane, and within reach of a climb.
    silent = aircraft(
        3_000.0, 0.0, math.pi, 25.0, valid=KNOWN, altitude=1_400.0, altitude_reference=MSL
    )
    own = aircraft(
        0.0, 0.0, 0.0, 25.0, id="own", valid=KNOWN, altitude=500.0, altitude_reference=MSL
    )
    now = NOW + 6 * SECOND
    situation = updates.traffic(situation_after(own=own), silent, NOW, RULES)
    later = aircraft(
        150.0,
        0.0,
        0.0,
        25.0,
        id="own",
        time=now,
        valid=KNOWN,
        altitude=500.0,
        altitude_reference=MSL,
    )
    situation = updates.ownship(situation, later, now, RULES)
    assert task(situation, now, settings(Maneuvers.HORIZONTAL)).excluded
    with pytest.raises(Refusal) as caught:
        task(situation, now, vertical)
    assert caught.value.code is Code.STALE_INTRUDER


def test_a_runner_that_climbs_can_rehearse():
    rehearse(POLICY, settings(Maneuvers.BOTH, floor=Level(3_000.0, "pressure")).options)


# On the ellipsoid and in messages.


def test_altitudes_survive_their_way_over_the_ellipsoid():
    requested, answer = usual()
    plan = published(requested, answer)
    assert plan.climbs and plan.start.altitude == requested.own_altitude
    _, waypoints = to_frame(FRAME, plan)
    for back, sent in zip(waypoints, answer.waypoints, strict=True):
        assert (back.altitude, back.climb) == (sent.altitude, sent.climb)
    _, flat = to_frame(FRAME, published(*usual(Maneuvers.HORIZONTAL)))
    assert all((back.altitude, back.climb) == (None, None) for back in flat)


def test_the_monitor_takes_the_altitude_that_the_plan_was_made_for():
    bounded = settings(floor=FLOOR)
    situation = meeting(undulation=48.0)
    watch = initial(Thresholds.for_plans(bounded.options), EXACT_REPORTS)
    after = activate(watch, situation, published(*made(situation, bounded)))
    assert after.thresholds.options.floor == Level(528.0, "wgs84")
    assert after.published_plan is not None and after.published_plan.climbs


def test_a_backup_names_the_altitude_in_which_the_ownship_levels_off():
    vertical, situation = settings(), meeting(climb=4.0)
    watch = initial(Thresholds.for_plans(vertical.options), EXACT_REPORTS)
    plan = published(*made(situation, vertical))
    after = step_monitor(activate(watch, situation, plan), situation, NOW)
    made_now = backup(after, Altitude(500.0, "msl", vertical_speed=4.0))
    assert made_now is not None and not made_now.climbs
    # From 4 m/s to level flight with 1 m/s^2.
    (level,) = {plan_point.altitude for plan_point in made_now.points}
    assert level is not None and level.vertical_speed is None and level.reference == "msl"
    assert level.value == pytest.approx(508.0)


@pytest.mark.parametrize(("sense", "side"), [(Sense.CLIMB, 1.0), (Sense.DESCEND, -1.0)])
@pytest.mark.parametrize("climb", [-2.0, 0.0, 3.0])
def test_a_backup_that_climbs_or_descends_is_published_with_its_profile(
    sense: Sense, side: float, climb: float
) -> None:
    given, situation = settings(), meeting()
    watch = initial(Thresholds.for_plans(given.options), EXACT_REPORTS)
    after = step_monitor(activate(watch, situation, published(*usual())), situation, NOW)
    held = after.monitor.backup._replace(sense=np.array([sense], dtype=np.int8))
    own, began = Altitude(500.0, "msl", vertical_speed=climb), float(held.started[0])
    after = replace(
        after,
        monitor=after.monitor._replace(backup=held),
        backup_climb=climb_of_backup(sense, own, began, given.options),
    )
    made_now = backup(after, own)
    assert made_now is not None and made_now.climbs and after.frame is not None
    _, waypoints = to_frame(after.frame, made_now)
    rebuilt = profile_of(500.0, climb, waypoints, given.options.vertical.acceleration)
    certified = backup_profile(sense, own, given.options)
    assert rebuilt is not None and certified is not None
    times = np.linspace(0.0, waypoints[-1].time, 200)
    np.testing.assert_allclose(rebuilt.at(times), certified.at(times), atol=1e-5)
    assert side * (rebuilt.altitude[-1] - 500.0) > 200.0
    # One of unknown altitude stays in the plane.
    flat = backup(replace(after, backup_climb=None), own)
    assert flat is not None and not flat.climbs


def fields(plan_point: PlanPoint, **changes: Any) -> Any:
    """Return a waypoint's message as a plain object."""
    assert plan_point.altitude is not None
    climb = plan_point.altitude.vertical_speed
    values = {
        "valid": 0x0F if climb is None else 0x1F,
        "altitude": plan_point.altitude.value,
        "altitude_reference": MSL,
        "climb": climb or 0.0,
        "track_deg": plan_point.track_deg,
        "ground_speed": plan_point.speed,
        "time_of_arrival": stamp(plan_point.time),
    }
    return point(
        plan_point.index, plan_point.latitude, plan_point.longitude, origin=1, **(values | changes)
    )


def trajectory(plan: Published, **changes: Any) -> Any:
    """Return a plan's message, with some fields of its third waypoint changed."""
    waypoints = [
        fields(plan_point, **(changes if number == 2 else {}))
        for number, plan_point in enumerate(plan.points)
    ]
    return SimpleNamespace(
        header=SimpleNamespace(stamp=stamp(plan.began)),
        id=SimpleNamespace(uuid=bytes(16)),
        revision=1,
        start=fields(plan.start),
        waypoints=waypoints,
        intruder_ids=list(plan.identifiers),
        wind=SimpleNamespace(x=0.0, y=0.0, z=0.0),
        wind_std=0.0,
    )


def test_the_display_shows_the_altitudes_of_a_plan_that_climbs():
    plan = published(*usual())
    drawn = draw_plan(plan, FRAME, None, Heights("msl", None), NOW)
    heights = [round(place.altitude.value, 1) for place in plan.points if place.altitude]
    assert [place.altitude for place in drawn.points] == heights
    flat = draw_plan(
        published(*usual(Maneuvers.HORIZONTAL)), FRAME, None, Heights("msl", None), NOW
    )
    assert {place.altitude for place in flat.points} == {None}


def test_a_viewer_draws_a_plan_at_its_heights_above_the_start():
    pytest.importorskip("rclpy", reason="rclpy is not installed; to have it: make ros")
    from ros_bridge.transport.views import markers, path

    requested, answer = usual()
    heights = [(item.altitude or math.nan) - 500.0 for item in answer.waypoints]
    poses = path(answer, requested, "map").poses
    assert [item.pose.position.z for item in poses] == pytest.approx([0.0, *heights])
    drawn = markers(answer, requested, "map").markers
    (line,) = [item.points for item in drawn if item.ns == "plan"]
    assert line[0].z == 0.0 and max(item.z for item in line) == pytest.approx(max(heights))
    (disc,) = [item.pose.position for item in drawn if item.ns == "traffic"]
    assert disc.z == 0.0
    requested, answer = usual(Maneuvers.HORIZONTAL)
    assert {item.pose.position.z for item in path(answer, requested, "map").poses} == {0.0}


@pytest.mark.parametrize(
    ("changes", "field", "says"),
    [
        ({"climb": math.nan}, "climb", "is nan, expected -100 to 100 m/s"),
        ({"climb": math.inf}, "climb", "is inf"),
        ({"altitude": math.nan}, "altitude", "is nan, expected -1000 to 30000 m"),
        ({"valid": 0x0F}, "valid", "has no climb, expected one as the start"),
        ({"valid": 0x1E}, "valid", "is 0x1e, expected the altitude beside the climb"),
        ({"altitude_reference": 1}, "altitude_reference", "is that of wgs84, expected the start's"),
        ({"valid": 0x3F}, "valid", "is 0x3f, expected bits of 0x1f only"),
    ],
)
def test_a_plan_climbs_as_a_whole_or_not_at_all(changes: dict[str, Any], field: str, says: str):
    plan = published(*usual())
    assert conversions.trajectory(trajectory(plan)).climbs
    with pytest.raises(FieldError) as caught:
        conversions.trajectory(trajectory(plan, **changes))
    assert caught.value.field == f"trajectory.waypoints[2].{field}"
    assert says in str(caught.value)


def test_a_plan_in_the_plane_has_no_climb_at_any_waypoint():
    plan = published(*usual(Maneuvers.HORIZONTAL))
    assert not conversions.trajectory(trajectory(plan)).climbs
    with pytest.raises(FieldError, match=r"waypoints\[2\].valid has a climb, expected none"):
        conversions.trajectory(trajectory(plan, valid=0x1F))


# In flight.


def test_an_ownship_follows_a_profile_within_its_limits_and_then_levels_off():
    profile = climbing(1_000.0, 0.0, [20.0, 40.0], [1_080.0, 1_080.0], acceleration=1.0)
    height, period = Height(1_000.0, 0.0), 0.1
    for step in range(3, 400):  # taken up 0.3 s late
        before, time = height, step * period
        height = follow(height, profile, time, VERTICAL, period)
        assert abs(height.climb - before.climb) <= VERTICAL.acceleration * period + 1e-9
        assert abs(height.climb) <= VERTICAL.climb_max
        off = height.altitude - height_flown(profile, VERTICAL.acceleration, time + period).altitude
        assert abs(off) < 1.5
    assert height.altitude == pytest.approx(1_080.0, abs=0.1)
    falling = Height(1_000.0, -4.0)
    for _ in range(100):
        falling = follow(falling, None, 0.0, VERTICAL, period)
    assert falling.climb == 0.0 and falling.altitude == pytest.approx(992.0, abs=0.3)


def test_a_flight_keeps_the_separation_in_height():
    encounter = encounters_of_seed(scenario("head_on", UAS), 0, 0, 1)
    flight = EncounterFlight(encounter, UAS, UAS.vehicle_limits)
    own = flight.own
    frame = LocalFrame(47.0, 8.0)
    east, north = flight.goal[0] - own.x, flight.goal[1] - own.y
    at = frame.geodetic(own.x + east * np.arange(1.0, 9.0), own.y + north * np.arange(1.0, 9.0))
    places = zip(at.latitude.tolist(), at.longitude.tolist(), strict=True)
    level = {"valid": KNOWN, "altitude": ALTITUDE, "altitude_reference": MSL, "frame": frame}
    situation = situation_after(
        *(aircraft(*state, id=name, **level) for name, state in flight.traffic.items()),
        own=aircraft(*own, id="own", **level),
        points=[point(number, *place) for number, place in enumerate(places)],
        frame=frame,
    )
    requested, answer = made(situation, settings())
    assert answer.safe and answer.source is Source.VERTICAL
    flying = Flying(
        legs(plan_states(own, answer.waypoints)), 0, None, answer.waypoints, requested.own_altitude
    )
    profile = flying.profile(VERTICAL)
    assert profile is not None
    flight.fly(flying.legs, 0.0, plan=True, profile=profile)
    margin = requested.options.vertical_margin
    while not flight.over() and flight.time < 200.0:
        flight.step()
        off = flight.height_at(flight.time).altitude - float(profile.at(np.array(flight.time)))
        assert abs(off) <= margin + 0.1
    assert flight.truth.separation >= UAS.separation
    assert VERTICAL.separation <= flight.truth.height < math.inf
    with pytest.raises(FieldError, match="states no limits of climb"):
        flying.profile(None)


@pytest.mark.parametrize("vehicle", ["point_mass", "c208"])
def test_a_vehicle_with_lags_flies_a_climb_and_levels_off(vehicle: str):
    pytest.importorskip("jsbsim", reason="JSBSim is not installed")
    c208 = aircraft_of("c208", "")
    assert c208.vertical is not None
    encounter = encounters_of_seed(scenario("head_on", c208), 0, 0, 1)
    flight = EncounterFlight(encounter, c208, c208.vehicle_limits, vehicle)
    top = ALTITUDE + 100.0
    profile = climbing(
        ALTITUDE, 0.0, [60.0, 100.0], [top, top - 100.0], acceleration=c208.vertical.acceleration
    )
    own = flight.own
    x = own.x + 200.0 * own.speed * math.cos(own.heading)
    y = own.y + 200.0 * own.speed * math.sin(own.heading)
    end = Waypoint(0, x, y, own.heading, own.speed, 200.0)
    curves = legs(plan_states(own, [end]))
    flight.fly(curves, 0.0, plan=True, profile=profile)
    for number in range(1, 801):
        flight.step()
        planned = height_flown(profile, c208.vertical.acceleration, number * PERIOD)
        assert flight.height_at(flight.time).altitude == pytest.approx(planned.altitude, abs=1.0)
    flight.fly(curves, 0.0, plan=False)
    for _ in range(200):
        flight.step()
    # It levels off where the descent of 2.5 m/s ends.
    height = flight.height_at(flight.time)
    assert height.climb == pytest.approx(0.0, abs=0.1)
    level = top - 50.0 + rise_to_level(-2.5, c208.vertical.acceleration)
    assert height.altitude == pytest.approx(level, abs=1.0)
