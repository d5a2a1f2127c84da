"""A plan that took long is SAFE only if it still is from where everybody is by then."""

import math
from dataclasses import replace

import pytest

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from agents.planner.answer import Plan
from agents.planner.planner import plan
from agents.policy.inference import Policy
from ros_bridge.core import updates
from ros_bridge.core.lateness import revalidated
from ros_bridge.core.situation import Settings, Situation, Task, task
from ros_bridge.core.tracks import Rules
from tests.ros_bridge.scenes import NOW, SECOND, aircraft, geo_reference, published, route_points


def at(seconds: float, intruder: tuple[float, float, float], own: tuple[float, float, float] | None = None) -> Task:
    """Return the task some seconds after NOW, the ownship having flown straight on where nothing else is said."""
    now = NOW + round(seconds * SECOND)
    rules = Rules(jump_distance=1e5)
    situation = updates.geo_reference(Situation(), geo_reference(), now)
    situation = updates.route(situation, published(route_points()), now)
    place = own or (75.0 * seconds, 0.0, 0.0)
    situation = updates.ownship(situation, aircraft(*place, 75.0, time=now, id="own"), now, rules)
    situation = updates.traffic(situation, aircraft(*intruder, 75.0, time=now), now, rules)
    return task(situation, now, Settings())


@pytest.fixture(scope="module")
def asked() -> Task:
    return at(0.0, (9_000.0, 0.0, math.pi))


@pytest.fixture(scope="module")
def made(asked: Task) -> Plan:
    result = plan(asked.own, asked.intruders, asked.points, Policy.load(), asked.options)
    assert result.safe
    return result


def test_plan_without_delay_is_unchanged(made: Plan, asked: Task):
    assert revalidated(made, asked, asked) is made


@pytest.mark.parametrize("late", [0.5, 2.0])
def test_ownship_on_its_prediction_keeps_the_plan(made: Plan, asked: Task, late: float):
    roomy = replace(asked.options, requirement=asked.options.requirement._replace(margin=0.0, separation=950.0))
    present = replace(at(late, (9_000.0 - 75.0 * late, 0.0, math.pi)), options=roomy)
    assert revalidated(made, asked, present).safe


def test_intruder_off_its_prediction_voids_the_plan(made: Plan, asked: Task):
    side = math.copysign(1.0, made.waypoints[1].y)
    late = revalidated(made, asked, at(2.0, (2_500.0, side * 600.0, math.pi)))
    assert not late.safe
    assert late.reasons[0].message.startswith("plan was found 2.0 s after the request and is too late")
    assert "separation" in late.reasons[0].message


def test_an_ownship_that_turned_away_cannot_join_it(made: Plan, asked: Task):
    away = revalidated(made, asked, at(4.0, (8_700.0, 0.0, math.pi), own=(0.0, 0.0, math.pi)))
    assert not away.safe


def test_unsafe_plan_stays_unsafe(made: Plan, asked: Task):
    unsafe = replace(made, status=type(made.status).UNRESOLVED)
    assert revalidated(unsafe, asked, at(1.0, (8_925.0, 0.0, math.pi))) is unsafe
