"""What the monitor shows: bands by true directions of what it predicts, alerts by the aircraft's
names.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from agents.assurance.alerts import Alerting, Level, Region
from agents.assurance.state import State
from agents.assurance.thresholds import Cause
from envs.formats.areas.geodetic import GeodeticArea
from envs.formats.local_frame import LocalFrame
from envs.waypoints import at, legs, plan_states
from ros_bridge.core import updates
from ros_bridge.core.assurance import Supervision, activate, initial, step_monitor
from ros_bridge.core.guidance import TRACKS, Guidance, blank, guidance
from ros_bridge.core.replies import to_frame
from ros_bridge.core.situation import Situation
from ros_bridge.core.status import status
from ros_bridge.core.tracks import Rules
from tests.ros_bridge.scenes import FRAME, NOW, SECOND, THRESHOLDS, aircraft, situation_after
from tests.ros_bridge.test_assurance import publish_plan, traffic

RULES = Rules()


def with_report(situation: Situation, name: str, x: float, y: float, heading: float) -> Situation:
    message = aircraft(x, y, heading, 75.0, id=name, time=NOW + SECOND)
    return updates.traffic(situation, message, NOW + SECOND, RULES)


def display(situation: Situation, frame: LocalFrame | None = None) -> Guidance:
    """Return what is shown a second after a plan began."""
    situation_before = traffic(situation_after(), 0.0)
    plan = publish_plan(situation_before)
    supervision: Supervision = activate(initial(THRESHOLDS), situation_before, plan)
    _, points = to_frame(FRAME, plan)
    start, _ = to_frame(FRAME, plan)
    place = at(legs(plan_states(start, points)), np.float64(1.0))
    own = aircraft(*(float(value) for value in place), id="own", time=NOW + SECOND)
    situation = updates.ownship(situation, own, NOW + SECOND, RULES)
    supervision = step_monitor(supervision, situation, NOW + SECOND)
    supervision_shown = replace(supervision, frame=frame or supervision.frame)
    _, bands = guidance(blank(THRESHOLDS), supervision_shown, NOW + SECOND)
    assert bands is not None
    return bands


def test_an_aircraft_head_on_closes_the_way_to_it() -> None:
    # The ownship flies east.
    bands = display(with_report(traffic(situation_after(), 1.0), "new001", 7_000.0, 0.0, math.pi))
    tracks = bands.tracks
    assert tracks.target == tuple(TRACKS.tolist()) and len(tracks.region) == len(tracks.loss) == 72
    east, west = tracks.target.index(90.0), tracks.target.index(270.0)
    assert tracks.region[east] == Region.CORRECTIVE and 30.0 < tracks.loss[east] < 45.0
    assert tracks.region[west] == Region.FREE and tracks.loss[west] == -1.0
    assert bands.recovery == -1
    level, loss = bands.levels["new001"]
    assert level == Level.CORRECTIVE and loss == pytest.approx(tracks.loss[east], abs=1.0)
    assert len(bands.speeds.target) == len(bands.speeds.region) > 10
    assert bands.look_ahead == Alerting.for_aircraft(THRESHOLDS.options.aircraft).look_ahead


def test_an_area_ahead_is_named_and_closes_the_way_into_it() -> None:
    situation = with_report(traffic(situation_after(), 1.0), "new001", 0.0, 40_000.0, 0.5 * math.pi)
    place = FRAME.geodetic(4_000.0, 0.0)
    field = GeodeticArea(
        "areas.areas[0]",
        name="north field",
        centre=(float(place.latitude), float(place.longitude)),
        radius=1_000.0,
        more={"clearance": 100.0},
    )
    bands = display(replace(situation, fixed_areas=(field,)))
    tracks = bands.tracks
    east, west = tracks.target.index(90.0), tracks.target.index(270.0)
    assert list(bands.areas) == ["areas[0] (north field)"]
    assert tracks.area[east] == 0 and tracks.area[west] == -1
    assert tracks.region[east] == Region.CORRECTIVE and tracks.region[west] == Region.FREE
    level, loss = bands.areas["areas[0] (north field)"]
    assert level == Level.CORRECTIVE and loss == pytest.approx(tracks.loss[east], abs=1.0)
    assert "new001" in bands.levels and bands.speeds.area.count(0) > 10


def test_directions_are_true_where_the_map_is_turned() -> None:
    situation = with_report(traffic(situation_after(), 1.0), "new001", 7_000.0, 0.0, math.pi)
    straight = display(situation)

    # The same states on a map about a place far to the west at a high latitude.
    class Turned(LocalFrame):
        def geodetic(self, x: Any, y: Any) -> Any:
            return super().geodetic(x, y)._replace(convergence=np.full(np.shape(x), 0.5 * math.pi))

    turned = display(situation, Turned(FRAME.latitude, FRAME.longitude))
    quarter = 18  # of 72 directions
    assert (
        turned.tracks.region
        == straight.tracks.region[-quarter:] + straight.tracks.region[:-quarter]
    )


def test_where_nothing_is_free_there_is_a_way_out() -> None:
    bands = display(with_report(traffic(situation_after(), 1.0), "new001", 900.0, 100.0, math.pi))
    assert bands.tracks.region[bands.recovery] == Region.RECOVERY
    assert Region.FREE not in bands.tracks.region
    assert bands.recovery_shortfall > 0.0


def test_nothing_is_shown_of_an_ownship_that_is_unknown() -> None:
    situation = traffic(situation_after(), 0.0)
    supervision = activate(initial(THRESHOLDS), situation, publish_plan(situation))
    supervision = step_monitor(supervision, situation, NOW + 10 * SECOND)
    assessment = supervision.assessment
    assert assessment is not None
    assert assessment.state is State.DENIED
    assert assessment.measured.causes[0] & Cause.OWN_STALE
    shown_before = blank(THRESHOLDS)
    shown_after, bands = guidance(shown_before, supervision, NOW + 10 * SECOND)
    assert bands is None and shown_after is shown_before


@pytest.mark.parametrize("seconds", [0, -10, 5])
def test_errors_from_the_plan_are_told_only_where_the_ownship_is_known(seconds: int) -> None:
    situation = traffic(situation_after(), 0.0)
    supervision = activate(initial(THRESHOLDS), situation, publish_plan(situation))
    supervision = step_monitor(supervision, situation, NOW + SECOND // 10)
    report = situation.own.last
    assert report is not None and status(supervision).measured
    shifted = replace(report, time=report.time + seconds * SECOND)
    own = replace(situation.own, last=shifted)
    supervision = step_monitor(supervision, replace(situation, own=own), NOW + SECOND // 5)
    told = status(supervision)
    assert told.measured == (seconds == 0)
    assert told.measured or (told.causes == Cause.OWN_OUT_OF_ORDER and told.state is State.DENIED)
