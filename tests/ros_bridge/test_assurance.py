"""The monitor's memory between messages: which reports it gets, on which clock, and which plans it
takes.
"""

import functools
import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from agents.assurance.state import FlyMode, State
from agents.planner.planner import plan
from agents.planner.request.request import Altitude, in_wind
from agents.policy.inference import Policy
from envs.formats.areas.geodetic import GeodeticArea
from envs.kinematics import VehicleState
from envs.waypoints import at, legs, plan_states
from envs.wind import Wind
from ros_bridge.core import replies, updates
from ros_bridge.core.areas import AreaReport
from ros_bridge.core.assurance import (
    Supervision,
    accept_answer,
    activate,
    fly_mode,
    initial,
    read_plan,
    step_monitor,
    withdraw,
)
from ros_bridge.core.conversions import Published
from ros_bridge.core.fields import FieldError
from ros_bridge.core.reach import Reach, vertically_apart
from ros_bridge.core.replies import to_frame, wind_of
from ros_bridge.core.reports import USUAL, Report
from ros_bridge.core.situation import Held, Situation
from ros_bridge.core.tasks import Settings, task
from ros_bridge.core.tracks import Rules
from tests.ros_bridge.scenes import (
    FRAME,
    NOW,
    OPTIONS,
    SECOND,
    SETTINGS,
    THRESHOLDS,
    aircraft,
    point,
    situation_after,
    stamp,
)

RULES = Rules()
FAR = 30_000.0


def traffic(
    situation: Situation, seconds: float, heading: float = math.pi, x: float | None = None
) -> Situation:
    """Return the situation with a report of an aircraft that comes from the east, 4 km to the left
    of the path.
    """
    place = FAR - 75.0 * seconds if x is None else x
    message = aircraft(place, 4_000.0, heading, 75.0, time=NOW + round(seconds * SECOND))
    return updates.traffic(situation, message, NOW + round(seconds * SECOND), RULES)


def own(situation: Situation, seconds: float) -> Situation:
    message = aircraft(75.0 * seconds, 0.0, 0.0, 75.0, id="own", time=NOW + round(seconds * SECOND))
    return updates.ownship(situation, message, NOW + round(seconds * SECOND), RULES)


def publish_plan(
    situation: Situation, revision: int = 1, seconds: float = 0.0, settings: Settings = SETTINGS
) -> Published:
    requested = task(situation, NOW + round(seconds * SECOND), settings)
    result = plan(
        requested.own,
        requested.intruders,
        requested.points,
        Policy.load(),
        requested.options,
        wind=requested.wind,
    )
    assert result.safe
    return replies.published(result, requested, revision, bytes(16))


@functools.cache
def begin_watch() -> tuple[Supervision, Situation]:
    """Return a monitor that has just begun to watch a plan, and what was heard."""
    situation = traffic(situation_after(), 0.0)
    return activate(initial(THRESHOLDS), situation, publish_plan(situation)), situation


def test_a_plan_in_a_wind_is_monitored_in_it():
    blows = SimpleNamespace(x=12.0, y=-9.0, z=0.0)

    def situation_at(seconds: float, place: VehicleState) -> Situation:
        message = aircraft(
            *(float(value) for value in place),
            id="own",
            time=NOW + round(seconds * SECOND),
            valid=0xE5,
            wind=blows,
        )
        before = traffic(situation_after(own=message), 0.0) if seconds == 0.0 else situation
        after = updates.ownship(before, message, NOW + round(seconds * SECOND), RULES)
        return traffic(after, seconds)

    situation = situation_at(0.0, VehicleState(0.0, 0.0, 0.5, 75.0))
    published = publish_plan(situation)
    assert published.wind == pytest.approx((12.0, -9.0))
    supervision = activate(initial(THRESHOLDS), situation, published)
    assert supervision.frame is not None
    wind = wind_of(supervision.frame, published)
    curves = legs(plan_states(*to_frame(supervision.frame, published), wind=wind))
    for second in range(1, 13):
        place = at(curves, np.float64(second), wind)
        situation = situation_at(float(second), place)
        supervision = step_monitor(supervision, situation, NOW + second * SECOND)
        assessment = supervision.assessment
        assert assessment is not None
        assert assessment.state is State.MONITORING, assessment.reasons
        assert abs(assessment.measured.cross_track.item()) < 0.1
    # In still air the same flight is not the plan.
    calm = activate(initial(THRESHOLDS), situation, published._replace(wind=(0.0, 0.0), revision=9))
    assessment = step_monitor(calm, situation, NOW + 12 * SECOND).assessment
    assert assessment is not None
    assert abs(assessment.measured.cross_track.item()) > 0.2


def test_a_turn_is_one_through_the_air_of_the_plan_that_is_taken_up():
    situation, radius, rate = situation_after(), 50.0 / 0.03, 0.03
    for second in range(-2, 1):
        moment, heading = NOW + second * SECOND, rate * second
        place = 8_000.0 + radius * math.sin(heading), 4_000.0 - radius * math.cos(heading)
        message = aircraft(*place, heading, 50.0, time=moment)
        situation = updates.traffic(situation, message, moment, RULES)
    calm = publish_plan(situation)
    windy = calm._replace(wind=(-20.0, 0.0), revision=2)

    def turn_rate(supervision: Supervision) -> float:
        return float(supervision.monitor.expected.turn_rate.item())

    before = activate(initial(THRESHOLDS), situation, calm)
    assert turn_rate(before) == pytest.approx(rate, rel=0.01)
    after, at_once = (activate(begun, situation, windy) for begun in (before, initial(THRESHOLDS)))
    # Through the air it flies 20 m/s faster than over the ground, and turns less quickly.
    assert turn_rate(at_once) == turn_rate(after) == pytest.approx(rate * 50.0 / 70.0, rel=0.03)


def test_the_uncertainty_of_the_wind_counts_in_the_monitor_as_in_the_plan():
    settings = replace(SETTINGS, unknown=USUAL._replace(reported_wind_std=1.5))
    situation = traffic(
        situation_after(own=aircraft(0.0, 0.0, 0.0, 75.0, id="own", valid=0xE5)), 0.0
    )
    published = publish_plan(situation, settings=settings)
    assert (published.wind, published.wind_std) == ((0.0, 0.0), 1.5)
    watch = activate(initial(THRESHOLDS), situation, published)
    assert watch.air.wind == (0.0, 0.0, 1.5)
    assert watch.monitor.state[0] == State.MONITORING
    assert watch.thresholds_in_air.limits == in_wind(OPTIONS, Wind(std=1.5)).limits


@pytest.mark.parametrize(
    ("std", "field"),
    [
        (-1.0, "trajectory.wind_std"),
        (math.nan, "trajectory.wind_std"),
        (15.0, "trajectory.wind.std"),
    ],
)
def test_a_plan_whose_wind_is_too_uncertain_is_refused(std: float, field: str):
    # As a message of Trajectory has them.
    stamps = (stamp(NOW + n * 20 * SECOND) for n in range(1, 21))
    message: Any = SimpleNamespace(
        header=SimpleNamespace(stamp=stamp(NOW)),
        status=1,
        start=point(0, 47.0, 8.0, valid=14, time_of_arrival=stamp(NOW)),
        waypoints=[point(n, 47.0, 8.0, valid=14, time_of_arrival=t) for n, t in enumerate(stamps)],
        wind=SimpleNamespace(x=1.0, y=0.0, z=0.0),
        wind_std=0.5,
        intruder_ids=[],
        id=SimpleNamespace(uuid=bytes(16)),
        revision=1,
    )
    assert read_plan(message, THRESHOLDS).wind_std == 0.5
    message.wind_std = std
    with pytest.raises(FieldError) as caught:
        read_plan(message, THRESHOLDS)
    assert caught.value.field == field


def test_there_is_no_verdict_before_the_first_plan():
    supervision = step_monitor(initial(THRESHOLDS), situation_after(), NOW)
    assessment = supervision.assessment
    assert assessment is None
    assert fly_mode(supervision) is FlyMode.NOTHING
    assert fly_mode(withdraw(supervision, 1)) is FlyMode.NOTHING


@given(
    st.integers(SECOND // 1000, SECOND),
    st.lists(st.integers(SECOND // 1000, SECOND // 3), min_size=1, max_size=6),
)
def test_report_handed_over_again_is_in_order(first: int, steps: list[int]):
    supervision, situation = begin_watch()
    situation = own(traffic(situation, first / SECOND), first / SECOND)
    now = NOW + first
    for step in steps:
        now += step
        if now - NOW - first > SECOND:
            break
        supervision = step_monitor(supervision, situation, now)
        assessment = supervision.assessment
        assert assessment is not None
        assert [why.message for why in assessment.reasons] == []
        assert assessment.state is State.MONITORING


def test_changed_report_is_handed_over_at_once():
    supervision, situation = begin_watch()
    situation = own(traffic(situation, 0.5), 0.5)
    supervision = step_monitor(supervision, situation, NOW + SECOND // 2)
    situation = own(traffic(situation, 0.6, heading=math.pi - 0.1, x=FAR - 45.0), 0.6)
    supervision = step_monitor(supervision, situation, NOW + round(0.6 * SECOND))
    assessment = supervision.assessment
    assert supervision.reported["4b1a2c"].report.time == NOW + round(0.6 * SECOND)
    assert assessment is not None and assessment.measured.intruder_velocity[0] > 5.0


def noisy(second: int, random: np.random.Generator) -> Any:
    """Return a report, noisy as it declares, of an aircraft that comes from the east, 500 m to the
    left of the path.
    """
    x, y, u, v = random.normal(size=4)
    east, north = -75.0 + 3.0 * u, 3.0 * v
    place = 9_000.0 - 75.0 * second + 30.0 * x, 500.0 + 30.0 * y
    spread = {
        "valid": 0xC5,
        "position_std": 30.0,
        "velocity_std": 3.0,
        "time": NOW + second * SECOND,
    }
    return aircraft(*place, math.atan2(north, east), math.hypot(east, north), **spread)


@pytest.mark.parametrize("seed", range(2))
def test_a_plan_survives_noise_that_is_declared(seed: int):
    random = np.random.default_rng(seed)
    situation, supervision = situation_after(), initial(THRESHOLDS)
    state, requests, curve = VehicleState(0.0, 0.0, 0.0, 75.0), 0, None
    for second in range(100):
        now = NOW + second * SECOND
        if curve is not None:
            state = VehicleState(*map(float, at(curve, np.float64(second - 5.0))))
        else:
            state = state._replace(x=75.0 * second)
        situation = updates.ownship(situation, aircraft(*state, id="own", time=now), now, RULES)
        situation = updates.traffic(situation, noisy(second, random), now, RULES)
        if second == 5:
            published = publish_plan(situation, seconds=5.0)
            supervision = activate(supervision, situation, published)
            curve = legs(plan_states(*to_frame(FRAME, published)))
        supervision = step_monitor(supervision, situation, now)
        assessment = supervision.assessment
        requests += assessment is not None and assessment.ask is not None
    assert requests == 0


def test_faulty_aircraft_is_missed_and_a_forgotten_one_is_not():
    supervision, situation = begin_watch()
    bad = aircraft(0.0, 9_000.0, 0.0, 75.0, id="bad001", latitude=math.nan, time=NOW + SECOND)
    situation = updates.traffic(own(traffic(situation, 1.0), 1.0), bad, NOW + SECOND, RULES)
    supervision = step_monitor(supervision, situation, NOW + SECOND)
    assessment = supervision.assessment
    assert assessment is not None and assessment.state is State.DENIED
    (message,) = (why.message for why in assessment.reasons if "lack a report" in why.message)
    assert message.startswith("intruders lack a report") and message.endswith(" (bad001)")
    situation = replace(
        situation,
        traffic={name: track for name, track in situation.traffic.items() if name != "bad001"},
    )
    situation = own(traffic(situation, 2.0), 2.0)
    assessment = step_monitor(supervision, situation, NOW + 2 * SECOND).assessment
    assert assessment is not None and assessment.state is State.MONITORING


def test_older_plan_is_ignored_and_a_withdrawal_ends_the_newer():
    supervision, situation = begin_watch()
    newer = activate(supervision, situation, publish_plan(situation)._replace(revision=5))
    assert newer.published_plan is not None and newer.published_plan.revision == 5
    assert activate(newer, situation, publish_plan(situation)._replace(revision=4)) is newer
    assert withdraw(newer, 5) is newer
    ended = withdraw(newer, 6)
    assert ended.published_plan is None
    assert fly_mode(ended) is FlyMode.BACKUP


def test_an_answer_that_came_late_is_flown_on_its_own_times():
    supervision, situation = begin_watch()
    # An aircraft appears ahead on the path: a plan is wanted.
    situation = own(traffic(situation, 1.0), 1.0)
    ahead = aircraft(9_000.0, -9_000.0, 0.5 * math.pi, 75.0, id="new001", time=NOW + SECOND)
    situation = updates.traffic(situation, ahead, NOW + SECOND, RULES)
    supervision = step_monitor(supervision, situation, NOW + SECOND)
    assessment = supervision.assessment
    assert assessment is not None and assessment.ask is not None
    # The runner begins 80 ms after the monitor has asked.
    answer = publish_plan(situation, revision=2, seconds=1.08)
    supervision, taken_up = accept_answer(supervision, assessment.ask.number, answer)
    assert taken_up and supervision.published_plan == answer
    situation = own(traffic(situation, 1.1), 1.1)
    supervision = step_monitor(supervision, situation, NOW + round(1.1 * SECOND))
    assessment = supervision.assessment
    assert assessment is not None and assessment.state is State.MONITORING
    assert abs(float(assessment.measured.along_track[0])) < 0.1
    assert abs(float(assessment.measured.time_error[0])) < 1e-3


def test_a_refusal_denies_the_plan():
    supervision, situation = begin_watch()
    situation = own(traffic(situation, 1.0), 1.0)
    ahead = aircraft(9_000.0, -9_000.0, 0.5 * math.pi, 75.0, id="new001", time=NOW + SECOND)
    situation = updates.traffic(situation, ahead, NOW + SECOND, RULES)
    supervision = step_monitor(supervision, situation, NOW + SECOND)
    assessment = supervision.assessment
    assert assessment is not None and assessment.ask is not None
    supervision, taken_up = accept_answer(supervision, assessment.ask.number, None)
    assert not taken_up
    assert State(int(supervision.monitor.state[0])) in (State.DENIED, State.BACKUP)


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        (Altitude(1_000.0, "msl", 0.0), Altitude(2_000.0, "msl", 0.0), True),
        (Altitude(1_000.0, "msl", 0.0), Altitude(1_500.0, "msl", 0.0), False),
        (Altitude(1_000.0, "msl", 0.0), Altitude(2_000.0, "wgs84", 0.0), False),
        (Altitude(1_000.0, "msl", 0.0), None, False),
        (Altitude(1_000.0, "msl", 0.0), Altitude(2_000.0, "msl", -3.0), False),
        (Altitude(1_000.0, "msl", 0.0), Altitude(2_000.0, "msl", 3.0), True),
        (Altitude(1_000.0, "msl", 0.0), Altitude(2_000.0, "msl"), False),
        (Altitude(1_000.0, "msl"), Altitude(2_000.0, "msl", 0.0), False),
        (Altitude(1_000.0, "msl", 0.0), Altitude(7_000.0, "msl"), True),
        (Altitude(1_000.0, "msl"), Altitude(7_000.0, "msl"), False),
    ],
)
def test_only_comparable_altitudes_set_aircraft_apart(a, b, expected: bool):
    own = Report("own", NOW, 47.0, 8.0, 60.0, 0.0, a)
    reach = Reach(own, NOW, 500.0, 1_000.0, 600.0, 100.0, 150.0)
    assert (abs(vertically_apart(own, b, NOW, reach)) > 600.0) is expected


def lasting(supervision: Supervision, seconds: float) -> Supervision:
    """Return a monitor whose plan ends so long after it began."""
    published = supervision.published_plan
    assert published is not None
    *points, last = published.points
    last = replace(last, time=published.began + round(seconds * SECOND))
    return replace(supervision, published_plan=published._replace(points=(*points, last)))


def test_silent_aircraft_that_cannot_come_near_asks_for_nothing():
    usual, situation = begin_watch()
    # What comes near before a long plan ends is not left out.
    for x, ends, reached in (
        (320_000.0, 400.0, True),
        (40_000.0, 400.0, False),
        (320_000.0, 3_400.0, False),
    ):
        supervision = lasting(usual, ends)
        message = aircraft(x, 0.0, math.pi, 75.0, id="far", time=NOW)
        now, remaining = NOW, supervision
        received = updates.traffic(situation, message, NOW, RULES)
        for second in range(1, 9):
            now = NOW + second * SECOND
            received = own(traffic(received, float(second)), float(second))
            remaining = step_monitor(remaining, received, now)
            assessment = remaining.assessment
        assert assessment is not None
        assert (assessment.state is State.MONITORING) == reached


def test_areas_of_the_topic_and_of_a_file_are_monitored_and_stay_with_the_frame():
    supervision, situation = begin_watch()
    now = NOW + SECOND
    situation = own(situation, 1.0)
    assessment = step_monitor(supervision, situation, now).assessment
    assert assessment is not None and assessment.state is State.MONITORING
    latitude, longitude = geodetic_place(6_000.0, 0.0)
    disc = GeodeticArea("disc", centre=(latitude, longitude), radius=500.0)
    # An area that came towards the plan, as of a message of 20 s ago; it is there now.
    coming = disc._replace(centre=geodetic_place(6_000.0, -3_000.0), more={"velocity": (0.0, 30.0)})
    for among_areas in (
        replace(situation, fixed_areas=(disc,)),
        replace(situation, areas=Held(AreaReport(now, (disc,)))),
        replace(situation, areas=Held(AreaReport(now - 20 * SECOND, (coming,)))),
    ):
        after = step_monitor(supervision, among_areas, now)
        assessment = after.assessment
        assert assessment is not None and assessment.state is State.REPLAN_REQUESTED
        assert [why.field for why in assessment.reasons] == ["areas"]
        again = step_monitor(after, among_areas, now + SECOND // 2)
        assert again.areas is after.areas
        # Where the newest cannot be used, those before count on.
        crossed = disc._replace(centre=None, rings=(((47.0, 8.0), (47.1, 8.0), (47.2, 8.0)),))
        spoilt = replace(among_areas, areas=Held(AreaReport(now, (crossed,))))
        assessment = step_monitor(after, spoilt, now + SECOND // 2).assessment
        assert assessment is not None and assessment.state is State.REPLAN_REQUESTED
    beside = disc._replace(centre=geodetic_place(6_000.0, 20_000.0))
    assessment = step_monitor(
        supervision, replace(situation, fixed_areas=(beside,)), now
    ).assessment
    assert assessment is not None and assessment.state is State.MONITORING


def geodetic_place(x: float, y: float) -> tuple[float, float]:
    place = FRAME.geodetic(x, y)
    return float(place.latitude), float(place.longitude)
