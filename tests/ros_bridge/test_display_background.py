"""A display beside a program that supervises a plan by the monitor's core, without ROS."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("websockets", reason="websockets is not installed")
pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from envs.waypoints import at, legs, plan_states
from ros_bridge.core import updates
from ros_bridge.core.assurance import activate, initial, step_monitor, withdraw
from ros_bridge.core.guidance import blank
from ros_bridge.core.replies import to_frame
from ros_bridge.core.reports import USUAL
from ros_bridge.display.background import supervised_scene
from ros_bridge.display.scene import DisplayScene
from tests.ros_bridge.displays import page_document
from tests.ros_bridge.scenes import (
    FRAME,
    NOW,
    SECOND,
    SETTINGS,
    THRESHOLDS,
    aircraft,
    situation_after,
)
from tests.ros_bridge.test_assurance import publish_plan, traffic
from tests.ros_bridge.test_guidance import RULES, with_report


def test_plan_monitor_bands_and_alerts_of_the_core_are_shown():
    before = traffic(situation_after(), 0.0)
    plan = publish_plan(before)
    supervision = activate(initial(THRESHOLDS), before, plan)
    start, points = to_frame(FRAME, plan)
    own = at(legs(plan_states(start, points)), np.float64(1.0))
    message = aircraft(*(float(value) for value in own), id="own", time=NOW + SECOND)
    now = NOW + SECOND
    situation = with_report(traffic(before, 1.0), "new001", 7_000.0, 0.0, math.pi)
    situation = updates.ownship(situation, message, now, RULES)
    supervision = step_monitor(supervision, situation, now)
    scene, alerts = supervised_scene(DisplayScene(), situation, supervision, blank(THRESHOLDS), now)
    picture = page_document(scene, now)
    assert picture["separation"] == THRESHOLDS.requirement.separation
    assert picture["plan"]["revision"] == plan.revision
    assert [point["index"] for point in picture["plan"]["points"]] == [p.index for p in plan.points]
    assert picture["monitor"]["cross_track"] == pytest.approx(0.0, abs=0.2)
    assert {alert["id"]: alert["level"] for alert in picture["alerts"]}["new001"] == 2
    east = picture["bands"]["track_deg"].index(90.0)
    assert picture["bands"]["track_region"][east] == 2
    unjudged = replace(supervision, assessment=None)
    later, _ = supervised_scene(scene, situation, unjudged, alerts, now + SECOND)
    assert page_document(later, now + SECOND)["monitor"] is None


def test_a_backup_is_shown_in_the_wind_that_it_is_flown_in():
    blows, now = SimpleNamespace(x=12.0, y=-9.0, z=0.0), NOW + SECOND
    own = aircraft(0.0, 0.0, 0.0, 75.0, id="own", valid=0xE5, wind=blows)
    before = traffic(situation_after(own=own), 0.0)
    settings = replace(SETTINGS, unknown=USUAL._replace(reported_wind_std=1.5))
    plan = publish_plan(before, settings=settings)
    supervision = withdraw(activate(initial(THRESHOLDS), before, plan), plan.revision + 1)
    own = aircraft(75.0, 0.0, 0.0, 75.0, id="own", valid=0xE5, wind=blows, time=now)
    situation = updates.ownship(traffic(before, 1.0), own, now, RULES)
    supervision = step_monitor(supervision, situation, now)
    scene, _ = supervised_scene(DisplayScene(), situation, supervision, blank(THRESHOLDS), now)
    assert scene.backup is not None
    assert scene.backup.wind == pytest.approx((12.0, -9.0), abs=1e-3)
    assert scene.backup.wind_std == 1.5
