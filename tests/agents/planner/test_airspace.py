"""Plans among areas keep clear of them, or say of which, where and when not."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from agents.planner.answer import AdvisoryCode, Kind, Plan, RequestError
from agents.planner.planner import plan
from agents.planner.recheck import recheck
from agents.planner.request.request import Altitude, Options
from agents.policy.inference import Policy
from envs.area_geometry import signed_distance
from envs.areas import Area, Circle, Keep, Level, Polygon
from envs.kinematics import VehicleState
from envs.waypoints import RoutePoint, at, legs, plan_states
from envs.wind import Wind

POLICY = Policy.load()
OPTIONS = replace(Options.for_aircraft(POLICY.aircraft), deadline_s=math.inf, exhaustive=False)
OWN = VehicleState(0.0, 0.0, 0.0, 80.0)
ROUTE = [RoutePoint(100 + i, 12_000.0 + 5_000.0 * i, 0.0) for i in range(9)]
CROSSING = VehicleState(9_000.0, -9_000.0, math.pi / 2.0, 80.0)


def least(answer: Plan, area: Area, own: VehicleState = OWN, wind: Wind | None = None) -> float:
    """Return the smallest sampled signed distance of a plan from an area, m."""
    curves, end = legs(plan_states(own, answer.waypoints, wind=wind)), answer.waypoints[-1].time
    times = np.arange(0.0, end, 0.5)
    states = [at(curves, np.array(time), wind) for time in times]
    x, y = (np.array([float(getattr(state, axis)) for state in states]) for axis in "xy")
    return float(signed_distance(area, x, y, times).min())


def test_areas_that_are_not_met_change_nothing() -> None:
    request: Any = OWN, [CROSSING], ROUTE, POLICY, OPTIONS
    alone = plan(*request)
    for area in (
        Area(Circle(-90_000.0, 0.0, 1e3)),
        Area(Circle(9e3, 0.0, 1e3), valid_until=-1.0),
        Area(Circle(9e3, 0.0, 25e3), Keep.IN, valid_from=1e4),
    ):
        beside = plan(*request, areas=[area])
        assert beside.waypoints == alone.waypoints
        assert beside.safe
    far = Area(Circle(6e3, -30_000.0, 1e3), clearance=100.0)
    beside = plan(*request, areas=[far])
    assert beside.safe and beside.waypoints == alone.waypoints


def test_what_is_not_kept_names_the_area_the_place_and_the_time() -> None:
    wall = Area(Polygon(((8e3, -29e3), (9e3, -29e3), (9e3, 29e3), (8e3, 29e3))), name="wall")
    answer = plan(OWN, [], ROUTE, POLICY, OPTIONS, areas=[Area(Circle(-9e4, 0.0, 1.0)), wall])
    assert not answer.safe and answer.certificate is None
    (reason,) = [finding for finding in answer.reasons if finding.kind is Kind.AREA]
    assert reason.field == "areas[1]" and "areas[1] (wall)" in reason.message
    assert reason.time is not None and reason.x is not None and reason.y is not None
    assert abs(float(signed_distance(wall, reason.x, reason.y, reason.time))) < 200.0


def test_points_of_the_route_in_an_area_are_passed_over() -> None:
    over = Area(Circle(17_000.0, 4_000.0, 4_100.0))
    answer = plan(OWN, [], ROUTE, POLICY, OPTIONS, areas=[over])
    (note,) = [
        advisory for advisory in answer.advisories if advisory.code is AdvisoryCode.PASSED_OVER
    ]
    assert str(note.field) == "route[1]" and "lies in areas[0]" in note.text
    assert answer.waypoints[-1].index in {point.index for point in ROUTE}
    with pytest.raises(RequestError, match=r"route has \d of its 9 points where areas"):
        plan(OWN, [], ROUTE, POLICY, OPTIONS, areas=[Area(Circle(32e3, 0.0, 29e3))])


def test_points_of_the_route_outside_of_an_area_to_be_kept_in_are_passed_over() -> None:
    field = Area(Circle(16e3, 0.0, 28.5e3), Keep.IN, name="field")
    answer = plan(OWN, [], ROUTE, POLICY, OPTIONS, areas=[field])
    (note,) = [
        advisory for advisory in answer.advisories if advisory.code is AdvisoryCode.PASSED_OVER
    ]
    # No plan lasts until the point after it.
    assert str(note.field) == "route[7]" and "lies outside of areas[0] (field)" in note.text
    assert answer.safe


def test_an_ownship_in_an_area_is_told() -> None:
    for area, word in (
        (Area(Circle(0.0, 0.0, 500.0), name="here"), "holds"),
        (Area(Circle(20e3, 0.0, 19e3), Keep.IN, name="here"), "is left by"),
    ):
        answer = plan(OWN, [], ROUTE, POLICY, OPTIONS, areas=[area])
        (reason,) = [
            finding for finding in answer.reasons if finding.kind is Kind.START_IN_VIOLATION
        ]
        assert reason.message.startswith(f"areas[0] (here) {word} the ownship")


def test_heights_decide_and_what_is_unknown_is_told() -> None:
    low = Area(Circle(6e3, 0.0, 2e3), ceiling=Level(300.0, "msl"))
    high = plan(
        OWN, [], ROUTE, POLICY, OPTIONS, own_altitude=Altitude(900.0, "msl", 0.0), areas=[low]
    )
    assert high.safe and least(high, low) < 0.0
    unknown = plan(OWN, [], ROUTE, POLICY, OPTIONS, own_altitude=Altitude(9e2, "msl"), areas=[low])
    assert any(advisory.code is AdvisoryCode.ASSUMED for advisory in unknown.advisories)


def test_a_late_plan_is_judged_by_the_areas_of_then() -> None:
    answer = plan(OWN, [], ROUTE, POLICY, OPTIONS)
    own = OWN._replace(x=80.0)
    arguments: Any = answer, 1.0, own, [], ROUTE, OPTIONS
    assert recheck(*arguments).safe
    new = recheck(*arguments, areas=[Area(Circle(20e3, 0.0, 1e3))])
    assert not new.safe and "area" in new.reasons[0].message


@pytest.mark.parametrize(
    ("areas", "sentence"),
    [
        (["fence"], r"areas\[0\] is str, expected an Area"),
        ("fence", "areas is str, expected a sequence"),
        (None, "areas is NoneType, expected a sequence"),
        ([Area(Circle(0.0, 9e4, 1.0))] * 1_001, "areas are 1001, expected 1000 at most"),
    ],
)
def test_what_is_no_area_is_refused(areas: Any, sentence: str) -> None:
    with pytest.raises(RequestError, match=sentence):
        plan(OWN, [], ROUTE, POLICY, OPTIONS, areas=areas)


def test_in_a_wind_areas_stand_over_the_ground() -> None:
    wind = Wind(-6.0, 9.0)
    for area in (
        Area(Circle(9e3, -4_500.0, 1e3), clearance=200.0),
        Area(Circle(9e3, -9e3, 1e3), velocity=(0.0, 30.0)),
    ):
        answer = plan(OWN, [CROSSING], ROUTE, POLICY, OPTIONS, wind=wind, areas=[area])
        away = least(answer, area, wind=wind)
        assert answer.safe == (away > area.clearance - 0.1) or not answer.safe
        lost = [finding for finding in answer.reasons if finding.kind is Kind.AREA]
        assert bool(lost) == (away < area.clearance)


@pytest.mark.parametrize(
    "area",
    [
        Area(Circle(14e3, 300.0, 2e3), clearance=150.0, name="disc"),
        Area(Polygon(((20e3, -6e3), (21e3, -6e3), (21e3, 4e3), (20e3, 2e3)))),
        Area(Circle(16e3, 5e3, 2e3), velocity=(-4.0, -25.0), growth=2.0),
        Area(Polygon(((-2e3, -2e3), (6e4 - 2e3, -2e3), (6e4 - 2e3, 2e3), (-2e3, 2e3))), Keep.IN),
        Area(
            Polygon(
                (
                    (-1e3, -9e3),
                    (5e4, -9e3),
                    (5e4, 9e3),
                    (15e3, 9e3),
                    (15e3, -2e3),
                    (14e3, -2e3),
                    (14e3, 9e3),
                    (-1e3, 9e3),
                )
            ),
            Keep.IN,
        ),
    ],
)
@pytest.mark.parametrize("wind", [None, Wind(3.0, -8.0)])
def test_plans_go_round_what_lies_in_the_way(area: Area, wind: Wind | None) -> None:
    intruders = [] if wind is None else [CROSSING]
    answer = plan(OWN, intruders, ROUTE, POLICY, OPTIONS, wind=wind, areas=[area])
    assert answer.safe, answer.reasons
    assert least(answer, area, wind=wind) >= area.clearance - 0.01
    assert answer.waypoints[-1].index in {point.index for point in ROUTE}
    assert answer.goal_index in {point.index for point in ROUTE}


def test_a_route_that_may_be_extended_goes_on_round_an_area() -> None:
    options = replace(OPTIONS, extend_route=True)
    area = Area(Circle(14.5e3, 100.0, 1.2e3))
    answer = plan(OWN, [], ROUTE[:2], POLICY, options, areas=[area])
    assert answer.safe, answer.reasons
    assert least(answer, area) >= -0.01
    assert answer.waypoints[-1].y == pytest.approx(0.0, abs=1e-3)
