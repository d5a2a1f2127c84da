"""The attack in space confirms plans that climb and finds whatever is spoiled of their altitudes."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.kernel.traffic import Traffic
from agents.planner import plan
from agents.planner.answer import Plan
from agents.planner.request.options import Maneuvers, Options
from agents.planner.request.request import Altitude, Intruder, Request
from agents.policy.inference import Policy
from benchmarks.safety import attack, heights, published, sky
from benchmarks.safety.attack import Batch
from benchmarks.safety.resimulation import CHECKS, Route, fly, resimulate
from envs.aircraft import PAPER, Vertical
from envs.areas import Area, Circle, Keep, Level
from envs.frames import Air, Ground
from envs.kinematics import VehicleState
from envs.profile import height_flown, profile_of
from envs.trees import take
from envs.waypoints import RoutePoint, Waypoint

VERTICAL = Vertical(climb_max=6.0, descent_max=8.0, acceleration=1.0, separation=150.0)
AIRCRAFT = PAPER._replace(vertical=VERTICAL)
OPTIONS = Options.for_aircraft(AIRCRAFT, maneuvers=Maneuvers.VERTICAL, deadline_s=math.inf)
OWN: VehicleState[Ground] = VehicleState(0.0, 0.0, 0.0, 70.0)
ALTITUDE = Altitude(2_000.0, "msl", 0.0)
ROUTE = [RoutePoint(100 + number, 12_000.0 + 5_000.0 * number, 0.0) for number in range(9)]


class Climbing(NamedTuple):
    """A SAFE plan that climbs or descends, and its request."""

    question: published.Question
    answer: Plan


@pytest.fixture(scope="module")
def policy() -> Policy:
    return Policy.load().for_aircraft(AIRCRAFT, outside="allow")


@pytest.fixture(scope="module")
def climbing(policy: Policy) -> Climbing:
    # Meets the ownship after 100 s at its level.
    other: VehicleState[Ground] = VehicleState(7_000.0, 7_000.0, -0.5 * math.pi, 70.0)
    intruder = Intruder(other, altitude=Altitude(2_000.0, "msl", 0.0))
    answer = plan(OWN, [intruder], ROUTE, policy, OPTIONS, own_altitude=ALTITUDE)
    assert answer.safe
    assert len({point.altitude for point in answer.waypoints}) > 1
    question = published.question(0, 0, _request(other), AIRCRAFT.separation)
    return Climbing(
        question._replace(
            own=OWN, intruders=[intruder], route=ROUTE, altitude=ALTITUDE, sky=published.STILL
        ),
        answer,
    )


def _request(other: VehicleState[Ground]) -> Any:
    """Return the request as arrays, without leading axis."""
    row: VehicleState[Air] = VehicleState(*(np.array([[field]]) for field in other))
    own: VehicleState[Air] = VehicleState(*(np.array([field]) for field in OWN))
    x, y = (np.array([[getattr(point, name) for point in ROUTE]]) for name in ("x", "y"))
    traffic = Traffic.straight(row, np.ones((1, 1), dtype=bool))
    return take(Request(own, traffic, x, y, np.array([len(ROUTE)])), 0)


def broken(climbing: Climbing, answer: Plan, options: Options = OPTIONS) -> set[str]:
    """Return what a plan breaks, all checks of the attack together."""
    question, altitude = climbing.question, climbing.question.altitude
    assert altitude is not None
    faults = published.faults(question, answer, options)
    arrays = take(published.as_arrays(question, answer, options), None)
    flown = fly(take(arrays.plan_states, 0))
    faults += heights.faults(altitude, answer.waypoints, flown, question.sky.areas, options)
    faults += sky.faults(question.sky, flown, options, altitude, answer.waypoints)
    request = arrays.request
    route = Route(request.route_x, request.route_y, request.points, arrays.last)
    judged = resimulate(
        arrays.plan_states, request.own, request.traffic, route, options, options.limits
    )
    return {*faults, *(name for name, bad in zip(CHECKS, judged.wrong[:, 0], strict=True) if bad)}


def test_a_plan_that_climbs_is_confirmed(climbing: Climbing) -> None:
    assert broken(climbing, climbing.answer) == set()


def test_a_plan_is_near_its_intruder_where_it_would_not_climb(climbing: Climbing) -> None:
    points = [replace(point, altitude=2_000.0, climb=0.0) for point in climbing.answer.waypoints]
    level = replace(climbing.answer, waypoints=tuple(points))
    assert {"required", "separation"} <= broken(climbing, level)


def moved(answer: Plan, rise: Callable[[int], float]) -> Plan:
    """Return a plan with its altitudes moved by waypoint, m, and the climbs that follow."""
    points: list[Waypoint] = []
    for number, point in enumerate(answer.waypoints):
        assert point.altitude is not None
        points.append(replace(point, altitude=point.altitude + rise(number)))
    for number, (point, after) in enumerate(pairwise(points)):
        assert point.altitude is not None and after.altitude is not None
        climb = (after.altitude - point.altitude) / (after.time - point.time)
        points[number] = replace(point, climb=climb)
    return replace(answer, waypoints=tuple(points))


@pytest.mark.parametrize(
    ("rise", "fault"),
    [
        (lambda number: 400.0 * (number == 10), "climb"),
        (lambda number: 50.0 * (number % 2), "off the profile"),
        (lambda number: 300.0 * (number == 0), "changes of climb"),
    ],
)
def test_altitudes_that_cannot_be_flown_are_found(
    climbing: Climbing, rise: Callable[[int], float], fault: str
) -> None:
    answer = moved(climbing.answer, rise)
    options = OPTIONS
    if fault == "off the profile":
        options = replace(OPTIONS, vertical_margin=0.1)
    assert fault in broken(climbing, answer, options)


def test_a_stated_climb_that_is_not_flown_is_found(climbing: Climbing) -> None:
    points = list(climbing.answer.waypoints)
    points[3] = replace(points[3], climb=(points[3].climb or 0.0) + 0.1)
    spoiled = replace(climbing.answer, waypoints=tuple(points))
    assert broken(climbing, spoiled) == {"climb of a waypoint"}


def test_waypoints_without_altitudes_are_found(climbing: Climbing) -> None:
    points = list(climbing.answer.waypoints)
    points[3] = replace(points[3], altitude=None, climb=None)
    spoiled = replace(climbing.answer, waypoints=tuple(points))
    assert published.faults(climbing.question, spoiled, OPTIONS) == ["altitudes"]


@pytest.mark.parametrize("of_area", [False, True])
def test_a_floor_and_a_ceiling_inside_the_flight_are_found(
    climbing: Climbing, *, of_area: bool
) -> None:
    altitudes = [point.altitude or 0.0 for point in climbing.answer.waypoints]
    low, high = min(*altitudes, ALTITUDE.value), max(*altitudes, ALTITUDE.value)
    spread = OPTIONS.vertical_margin
    for floor, ceiling, faults in (
        (low - spread - 1.0, high + spread + 1.0, set[str]()),
        (low - spread + 1.0, high + spread - 1.0, {"floor", "ceiling"}),
    ):
        levels: dict[str, Any] = {"floor": Level(floor, "msl"), "ceiling": Level(ceiling, "msl")}
        if of_area:
            keep_in = Area(Circle(12_000.0, 0.0, 30_000.0), keep=Keep.IN, **levels)
            around = sky.Sky(None, (keep_in,))
            changed = climbing._replace(question=climbing.question._replace(sky=around))
            found = broken(changed, climbing.answer)
            names = {f"{name} of an area" for name in faults}
        else:
            found, names = broken(climbing, climbing.answer, replace(OPTIONS, **levels)), faults
        # The one that the plan climbs away from, or both.
        assert found <= names
        assert bool(found) == bool(names)


def test_an_area_counts_where_the_plan_is_level_with_it(climbing: Climbing) -> None:
    point = next(point for point in climbing.answer.waypoints if point.altitude != 2_000.0)
    assert point.altitude is not None
    for middle, faults in ((point.altitude, {"area"}), (point.altitude + 1_000.0, set[str]())):
        floor, ceiling = Level(middle - 20.0, "msl"), Level(middle + 20.0, "msl")
        area = Area(Circle(point.x, point.y, 300.0), floor=floor, ceiling=ceiling)
        around = climbing.question._replace(sky=sky.Sky(None, (area,)))
        assert broken(climbing._replace(question=around), climbing.answer) == faults


@given(
    climb=st.floats(-8.0, 6.0),
    rises=st.lists(st.floats(-150.0, 110.0), min_size=2, max_size=19),
)
def test_the_judge_flies_profiles_as_the_planner_says(climb: float, rises: Sequence[float]) -> None:
    options = replace(OPTIONS, vertical_margin=1_000.0)
    altitude = replace(ALTITUDE, vertical_speed=climb)
    levels = 2_000.0 + 20.0 * climb + np.cumsum(rises)
    points = [
        Waypoint(number, 0.0, 0.0, 0.0, 50.0, 20.0 * (number + 1), level, 0.0)
        for number, level in enumerate(levels.tolist())
    ]
    try:
        profile = profile_of(2_000.0, climb, points, VERTICAL.acceleration)
    except ValueError:
        return  # the first altitude cannot be reached
    assert profile is not None
    time = np.linspace(0.0, points[-1].time, 500)
    corners = heights.corners(altitude, points, options)
    assert np.interp(time, *corners) == pytest.approx(profile.at(time), abs=1e-6)
    flown = heights.flown_height(corners, climb, VERTICAL, time)
    expected = height_flown(profile, VERTICAL.acceleration, time).altitude
    assert flown == pytest.approx(expected, abs=1e-4)


@pytest.mark.slow
def test_a_small_attack_in_space_finds_nothing(policy: Policy) -> None:
    batch = Batch(6, (100,), 100, 130, single=True, any_aircraft=True, in_space=True)
    tally = attack.attack(batch, policy)
    assert tally.violations == []
    assert tally.counts["climbs and descents, safe"] >= 1
    assert tally.counts["certificate moved and wrong"] >= 1


@pytest.mark.slow
def test_a_planner_that_keeps_too_little_above_and_below_is_found(
    policy: Policy, monkeypatch: pytest.MonkeyPatch
) -> None:
    ask = published.Question.ask

    def careless(question: published.Question, policy: Policy, options: Options) -> Plan:
        vertical = options.vertical
        lower = vertical._replace(separation=max(1.0, 0.5 * vertical.separation))
        aircraft = options.aircraft._replace(vertical=lower)
        return ask(question, policy, replace(options, aircraft=aircraft))

    monkeypatch.setattr(published.Question, "ask", careless)
    batch = Batch(6, (100,), 100, 130, single=True, any_aircraft=True, in_space=True)
    checks = {violation["check"] for violation in attack.attack(batch, policy).violations}
    assert "required" in checks
