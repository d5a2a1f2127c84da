"""Bands and alerts of an ownship that may climb and descend: altitudes count as they are flown."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")
pytest.importorskip("websockets", reason="websockets is not installed")
pytest.importorskip("mcap_ros2", reason="mcap is not installed")

from mcap_ros2._dynamic import generate_dynamic

from agents.assurance.alerts import Level, Region
from agents.assurance.bands import losses_on_course
from agents.assurance.thresholds import Thresholds
from agents.planner.request.options import Maneuvers
from envs.areas import Level as Height
from envs.kinematics import VehicleState
from envs.profile import height_flown, profile_of
from envs.trees import take
from envs.waypoints import at, legs, plan_states
from ros_bridge.core.assurance import Supervision, activate, initial, step_monitor
from ros_bridge.core.guidance import Guidance, Shown, blank, guidance
from ros_bridge.core.lookout import step_without_plan
from ros_bridge.core.replies import to_frame
from ros_bridge.core.reports import EXACT as EXACT_REPORTS
from ros_bridge.core.situation import Situation
from ros_bridge.core.status import Status, status
from ros_bridge.display import scene_messages as messages
from ros_bridge.display.background import supervised_scene
from ros_bridge.display.scene import DisplayScene, MonitorStatus
from ros_bridge.display.scene import take as take_in
from ros_bridge.display.scene_recording import encoder
from tests.ros_bridge.displays import guidance as guidance_message
from tests.ros_bridge.displays import status as status_message
from tests.ros_bridge.displays import up_and_down
from tests.ros_bridge.scenes import FRAME, NOW, SECOND, aircraft, situation_after
from tests.ros_bridge.test_climbs import KNOWN, MSL, VERTICAL, published, settings, usual

SPEED = 25.0  # m/s


def begin(maneuvers: Maneuvers = Maneuvers.BOTH, **changes: Any) -> Supervision:
    options = settings(maneuvers, **changes).options
    return initial(Thresholds.for_plans(options), EXACT_REPORTS)


def report(x: float, y: float, heading: float, height: float, climb: float, **more: Any) -> Any:
    message = aircraft(
        x,
        y,
        heading,
        more.pop("speed", SPEED),
        valid=KNOWN,
        altitude=height,
        altitude_reference=MSL,
        **more,
    )
    message.velocity.z = climb
    return message


def situation_of(*traffic: Any, climb: float = 0.0) -> Situation:
    """Return an ownship that flies east 500 m above the sea among others."""
    return situation_after(*traffic, own=report(0.0, 0.0, 0.0, 500.0, climb, id="own"))


def shown(supervision: Supervision, now: int, before: Shown | None = None) -> Guidance:
    _, bands = guidance(before or blank(supervision.thresholds), supervision, now)
    assert bands is not None
    return bands


def looked_at(situation: Situation, maneuvers: Maneuvers = Maneuvers.BOTH, **more: Any) -> Guidance:
    """Return what a monitor without a plan shows."""
    return shown(step_without_plan(begin(maneuvers, **more), situation, NOW), NOW)


def fly(now: int, height: float, climb: float, place: VehicleState) -> Situation:
    """Return the meeting of :func:`tests.ros_bridge.test_climbs.meeting` at a time, ns."""
    passed = (now - NOW) / SECOND
    intruder = report(3_000.0 - SPEED * passed, 0.0, math.pi, 500.0, 0.0, time=now)
    own = report(
        *(float(part) for part in place[:3]),
        height,
        climb,
        speed=float(place.speed),
        id="own",
        time=now,
    )
    return situation_after(intruder, own=own, now=now)


def flight(off: float = 0.0) -> Iterator[tuple[float, int, Supervision]]:
    """Yield times, s and ns, and a monitor of a SAFE plan that climbs over what comes head-on; the
    ownship is so far above the plan, m.
    """
    requested, answer = usual()
    plan = published(requested, answer)
    start, points = to_frame(FRAME, plan)
    curves = legs(take(plan_states(start, points), None))
    assert requested.own_altitude is not None
    profile = profile_of(requested.own_altitude.value, 0.0, answer.waypoints, VERTICAL.acceleration)
    assert profile is not None
    watch = begin(Maneuvers.VERTICAL)
    state = take(at(curves, np.array([0.0])), 0)
    watch = activate(watch, fly(NOW, 500.0, 0.0, state), plan)
    for time in np.arange(0.0, 120.0, 3.0).tolist():
        now = NOW + round(time * SECOND)
        rounded = height_flown(profile, VERTICAL.acceleration, time)
        state = take(at(curves, np.array([time])), 0)
        watch = step_monitor(watch, fly(now, rounded.altitude + off, rounded.climb, state), now)
        yield time, now, watch


def test_an_aircraft_that_a_safe_plan_passes_in_height_raises_no_alert() -> None:
    before, by_climb = blank(begin().thresholds), []
    for time, now, watch in flight():
        before, bands = guidance(before, watch, now)
        assert bands is not None
        assert set(bands.levels.values()) <= {(Level.NONE, -1.0)}, time
        assert watch.assessment is not None
        measured, limits = watch.assessment.measured, watch.thresholds_in_air
        lost = losses_on_course(measured.own, measured.traffic, limits.requirement, 120.0)
        by_climb.append(float(lost.min()))
        told_status = status(watch)
        assert abs(told_status.altitude_error) < 1.5 and told_status.altitude_error_limit > 1.5
    assert min(by_climb) < 60.0, "the present climb that is held would raise one"


def test_how_far_the_ownship_is_from_the_plan_in_height_is_said() -> None:
    off = 4.0 * settings().options.vertical_margin
    _, _, watch = next(flight(-off))
    told_status = status(watch)
    assert told_status.altitude_error == pytest.approx(-off, abs=1.5)
    assert told_status.altitude_error_limit == settings().options.vertical_margin
    in_plane = replace(begin(Maneuvers.HORIZONTAL), assessment=watch.assessment)
    assert status(in_plane).altitude_error_limit == -1.0


def test_where_nobody_climbs_bands_are_those_in_the_plane() -> None:
    intruders = (
        report(3_000.0, 200.0, math.pi, 500.0, 0.0, id="one"),
        report(1_000.0, 2_000.0, -0.5 * math.pi, 500.0, 0.0, id="two"),
    )
    flat, solid = (
        looked_at(situation_of(*intruders), maneuvers)
        for maneuvers in (Maneuvers.HORIZONTAL, Maneuvers.BOTH)
    )
    assert flat.vertical is None and solid.vertical is not None
    assert solid._replace(vertical=None) == flat
    assert max(level for level, _ in flat.levels.values()) > Level.NONE
    assert set(flat.tracks.region) > {0}


def test_who_stays_above_closes_no_heading_but_a_climb() -> None:
    above = report(2_000.0, 0.0, math.pi, 500.0 + VERTICAL.separation + 60.0, 0.0)
    bands = looked_at(situation_of(above))
    assert [level for level, _ in bands.levels.values()] == [Level.NONE]
    assert set(bands.tracks.region) == {Region.FREE}
    assert bands.vertical is not None
    speeds, altitudes = bands.vertical.speeds, bands.vertical.altitudes
    assert speeds.target[0] == -VERTICAL.descent_max and speeds.target[-1] == VERTICAL.climb_max
    assert speeds.region[0] == Region.FREE and speeds.region[-1] > Region.FREE
    assert bands.vertical.reference == "msl"
    assert altitudes.target[0] < 500.0 < altitudes.target[-1]
    assert altitudes.region[0] == Region.FREE and max(altitudes.region) > Region.FREE
    # It climbs towards the level of the other.
    climbing = looked_at(situation_of(above, climb=VERTICAL.climb_max))
    [(level, loss)] = climbing.levels.values()
    assert level > Level.NONE and loss > 0.0


def test_alone_everything_is_free() -> None:
    bands = looked_at(situation_of(climb=2.0))
    assert bands.vertical is not None and bands.levels == {}
    for row in (bands.tracks, bands.speeds, bands.vertical.speeds, bands.vertical.altitudes):
        assert set(row.region) == {Region.FREE}


def test_without_an_own_altitude_or_climb_there_are_no_bands_up_and_down() -> None:
    intruder = report(3_000.0, 0.0, math.pi, 500.0, 0.0)
    for valid in (0xC5, 0xC7):
        own = report(0.0, 0.0, 0.0, 500.0, 0.0, id="own")
        own.valid = valid
        bands = looked_at(situation_after(intruder, own=own))
        [(level, _)] = bands.levels.values()
        assert bands.vertical is None and level > Level.NONE


def test_an_aircraft_of_unknown_altitude_shuts_all_altitudes_and_leaves_no_way_out() -> None:
    intruder = aircraft(1_500.0, 0.0, math.pi, SPEED)
    bands = looked_at(situation_of(intruder))
    assert bands.vertical is not None
    for row in (bands.vertical.speeds, bands.vertical.altitudes):
        assert Region.FREE not in row.region and Region.RECOVERY not in row.region


def test_floor_and_ceiling_close_climbs() -> None:
    intruder = report(3_000.0, 3_000.0, 0.0, 500.0, 0.0)
    bands = looked_at(situation_of(intruder), floor=Height(480.0, "msl"))
    assert bands.vertical is not None
    altitudes = bands.vertical.altitudes
    closed = [
        target for target, code in zip(altitudes.target, altitudes.region, strict=True) if code
    ]
    assert closed and max(closed) < 500.0
    assert set(altitudes.area) == {-1}


def test_bands_up_and_down_survive_a_message_and_a_recording() -> None:
    above = report(2_000.0, 0.0, math.pi, 500.0 + VERTICAL.separation + 60.0, 0.0)
    situation = situation_of(above)
    watch = step_without_plan(begin(), situation, NOW)
    scene, _ = supervised_scene(DisplayScene(), situation, watch, blank(watch.thresholds), NOW)
    for bands in (scene.guidance, scene.guidance and scene.guidance._replace(vertical=None)):
        assert bands is not None
        back = through_file("GuidanceBands", messages.guidance(bands))
        after = take_in(DisplayScene(), "rlcas_monitor/output/guidance", back, NOW)
        assert after.guidance == bands and not after.problems
    monitor_status = Status(measured=True, altitude_error=-3.5, altitude_error_limit=10.0)
    back = through_file("AssuranceStatus", messages.status(MonitorStatus(NOW, monitor_status), 1))
    after = take_in(DisplayScene(), "rlcas_monitor/output/status", back, NOW)
    assert after.monitor == MonitorStatus(NOW, monitor_status)


def through_file(name: str, fields: Any) -> Any:
    """Return a message as a recording gives it back."""
    kind = f"rlcas_msgs/msg/{name}"
    text = messages.definition(kind)
    return generate_dynamic(kind, text)[kind](encoder(kind, text)(fields))


def test_messages_of_earlier_versions_are_shown_without_what_they_lack() -> None:
    scene = take_in(DisplayScene(), "rlcas_monitor/output/status", status_message(), NOW)
    scene = take_in(scene, "rlcas_monitor/output/guidance", guidance_message(), NOW)
    assert scene.monitor is not None and scene.monitor.status.altitude_error_limit == -1.0
    assert scene.guidance is not None and scene.guidance.vertical is None
    strange = guidance_message(**up_and_down(reference=9))
    refused = take_in(scene, "rlcas_monitor/output/guidance", strange, NOW)
    assert "altitude_reference is 9, expected one of" in refused.problems["guidance"].text
    assert refused.guidance == scene.guidance
