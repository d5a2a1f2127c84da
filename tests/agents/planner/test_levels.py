"""An intruder counts while it may be level, no longer and no shorter: by dense simulation in three
dimensions.
"""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents import check
from agents.assurance import bands
from agents.assurance.monitor import Cause
from agents.assurance.single import activate, begin, step
from agents.assurance.thresholds import Thresholds
from agents.kernel.levels import ALWAYS, Altitude, vertical_gap, window
from agents.kernel.traffic import Requirement, Traffic, Window
from agents.planner.judge.validator import validate
from agents.planner.planner import plan
from agents.planner.request.request import Intruder, check_request
from envs.kinematics import C208_PUBLISHED, VehicleState
from envs.trees import take
from envs.waypoints import RoutePoint, at, legs, plan_states
from tests.agents.planner.test_separations import OPTIONS, OWN, POLICY, ROUTE
from tests.agents.planner.test_validator import plans, sample_distances, traffic

UNKNOWN = 10.0
heights = st.builds(
    Altitude,
    st.floats(1_000.0, 5_000.0),
    st.just("msl"),
    st.one_of(st.none(), st.sampled_from([0.0, -5.0, 5.0]), st.floats(-20.0, 20.0)),
    st.sampled_from([0.0, 10.0, 200.0]),
    st.sampled_from([0.0, 0.5, 3.0]),
)
ages = st.sampled_from([0.0, 2.0, -0.5])
verticals = st.sampled_from([150.0, 600.0])


def extreme_gaps(
    own: Altitude, intruder: Altitude, age: float, time: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return how far the other altitude may be above at some times at least and at most, m."""
    mine = [] if own.vertical_speed is None else [own.vertical_speed]
    theirs = [] if intruder.vertical_speed is None else [intruder.vertical_speed]
    ranges = []
    for speeds, altitude in ((mine, own), (theirs, intruder)):
        low, high = (
            (speeds[0] - altitude.climb_error, speeds[0] + altitude.climb_error)
            if speeds
            else (-UNKNOWN, UNKNOWN)
        )
        ranges.append((low, high))
    gaps = []
    for climb in ranges[0]:
        for rise in ranges[1]:
            for off in (-1.0, 1.0):
                for away in (-1.0, 1.0):
                    a = own.value + off * own.error + climb * time
                    b = intruder.value + away * intruder.error + rise * (age + time)
                    gaps.append(b - a)
    return np.min(gaps, axis=0), np.max(gaps, axis=0)


def least_gap(own: Altitude, intruder: Altitude, age: float, time: np.ndarray) -> np.ndarray:
    """Return how near two altitudes may be at some times, m: all that is possible, by its ends."""
    low, high = extreme_gaps(own, intruder, age, time)
    near = np.minimum(np.abs(low), np.abs(high))
    return np.where((low <= 0.0) & (high >= 0.0), 0.0, near)


@given(heights, heights, ages, verticals)
def test_a_window_holds_all_times_at_which_two_may_be_level_and_no_others(
    own: Altitude, intruder: Altitude, age: float, vertical: float
) -> None:
    first, last = window(own, intruder, age, vertical, UNKNOWN)
    times = np.linspace(0.0, 500.0, 2_001)
    near = least_gap(own, intruder, age, times)
    inside = (first <= times) & (times <= last)
    assert (near[~inside] > vertical).all()
    # A report from the future is worse by what it may have climbed until then either way.
    assert (near[inside] <= vertical + 1e-3 + 2.0 * 23.0 * max(-age, 0.0)).all()
    gap = abs(vertical_gap(own, intruder, age, 500.0, UNKNOWN))
    assert (gap > vertical + 2e-6) <= (not inside.any())
    if age >= 0.0:
        # Between the times, too: where one passes the other they are level for a moment.
        low, high = extreme_gaps(own, intruder, age, times)
        passes = (low > 0.0).any() and (high < 0.0).any()
        assert gap == pytest.approx(0.0 if passes else near.min(), abs=1e-6)


@given(heights, heights, ages, verticals, st.floats(0.0, 300.0), st.integers(0, 5))
def test_a_wider_uncertainty_never_makes_a_window_smaller(
    own: Altitude, intruder: Altitude, age: float, vertical: float, more: float, case: int
) -> None:
    first, last = window(own, intruder, age, vertical, UNKNOWN)
    wider = [
        (replace(own, error=own.error + more), intruder, vertical),
        (own, replace(intruder, error=intruder.error + more), vertical),
        (own, replace(intruder, climb_error=intruder.climb_error + 0.02 * more), vertical),
        (replace(own, climb_error=own.climb_error + 0.02 * more), intruder, vertical),
        (own, intruder, vertical + more),
        (
            replace(own, vertical_speed=None) if own.vertical_speed == 0.0 else own,
            intruder,
            vertical,
        ),
    ][case]
    begins, ends = window(wider[0], wider[1], age, wider[2], UNKNOWN)
    if first <= last and first < math.inf:
        assert begins <= first and ends >= last


def test_what_cannot_be_compared_always_counts() -> None:
    low, high = Altitude(1_000.0, "msl", 0.0), Altitude(9_000.0, "wgs84", 0.0)
    for own, intruder in ((low, high), (None, high), (low, None)):
        assert window(own, intruder, 0.0, 600.0, UNKNOWN) == ALWAYS


def test_windows_of_the_validator_are_two_sided() -> None:
    flown, intruders = plans(40, 7), traffic(40, 4, 8, turning=True)
    rng, shape = np.random.default_rng(9), intruders.mask.shape
    first = rng.uniform(-100.0, 200.0, shape)
    windows = Window(first, first + rng.uniform(0.0, 120.0, shape))
    timed = intruders._replace(window=windows)
    judged = validate(flown, timed, Requirement(300.0), C208_PUBLISHED)
    times = np.arange(0.0, flown.time[0, -1] + 1e-9, 0.05)
    apart = sample_distances(flown, intruders, 0.05)
    counts = (windows.begin <= times[:, None, None]) & (times[:, None, None] <= windows.end)
    least = np.where(counts, apart, np.inf).min(axis=(0, 2))
    assert (judged.min_separation <= least + 1e-9).all()
    # A part at an end of a window counts whole, in 0.06 s of which both fly 15 m at most.
    close = np.isfinite(least)
    assert (judged.min_separation[close] >= least[close] - 15.0).all()
    assert np.median(least[close] - judged.min_separation[close]) < 1.0
    safe = least > 315.0
    assert judged.safe[safe].all() and not judged.safe[least < 299.0].any()


OWN_ALTITUDE = Altitude(3_000.0, "msl", 0.0)


def question(seed: int) -> tuple[VehicleState, list[Intruder], list[RoutePoint]]:
    """Return ownship, one to four intruders that cross its way at heights of their own, and the
    route.
    """
    rng, own, intruders = np.random.default_rng([seed, 53]), VehicleState(0.0, 0.0, 0.0, 80.0), []
    for _ in range(int(rng.integers(1, 5))):
        conflict_time = rng.uniform(50.0, 300.0)
        course, speed = rng.uniform(-math.pi, math.pi), rng.uniform(40.0, 110.0)
        x = (
            own.speed * conflict_time
            + rng.uniform(-1_500.0, 1_500.0)
            - speed * conflict_time * math.cos(course)
        )
        y = rng.uniform(-1_500.0, 1_500.0) - speed * conflict_time * math.sin(course)
        if math.hypot(x, y) < 2_000.0:
            continue
        climb = float(rng.choice([0.0, 1.0]) * rng.uniform(-12.0, 12.0))
        height = OWN_ALTITUDE.value + rng.uniform(-1_200.0, 1_200.0) - climb * conflict_time
        altitude = Altitude(float(height), "msl", climb, error=30.0)
        intruders.append(Intruder(VehicleState(x, y, course, speed), altitude=altitude))
    return own, intruders, [RoutePoint(i, 12_000.0 + 5_000.0 * i, 0.0) for i in range(9)]


def test_a_window_that_covers_all_is_judged_like_none() -> None:
    flown, reports = plans(40, 7), traffic(40, 6, 8, turning=True)
    always = reports._replace(window=Window(reports.age - np.inf, reports.age + np.inf))
    for mine, expected in zip(
        validate(flown, reports, Requirement(300.0), C208_PUBLISHED),
        validate(flown, always, Requirement(300.0), C208_PUBLISHED),
        strict=True,
    ):
        np.testing.assert_array_equal(mine, expected)
    vague = Altitude(3_000.0, "msl", 0.0, error=25_000.0)
    for seed in range(4):
        own, intruders, route = question(seed)
        level = [replace(intruder, altitude=vague) for intruder in intruders]
        unknown = [replace(intruder, altitude=None) for intruder in intruders]
        first, second = (
            plan(own, reported, route, POLICY, OPTIONS, own_altitude=OWN_ALTITUDE)
            for reported in (level, unknown)
        )
        assert first == second


@pytest.mark.slow
def test_plans_keep_all_intruders_away_in_three_dimensions_and_prove_it() -> None:
    timed = safe = 0
    for seed in range(24):
        start, intruders, route = question(seed)
        answer = plan(start, intruders, route, POLICY, OPTIONS, own_altitude=OWN_ALTITUDE)
        if not answer.safe:
            continue
        safe += 1
        timed += bool(answer.windows)
        curves, end = legs(plan_states(start, answer.waypoints)), answer.waypoints[-1].time
        for time in np.arange(0.0, end, 0.5):
            own = at(curves, np.array(time))
            for entry in intruders:
                state, level = entry.state, entry.altitude
                assert level is not None
                x = state.x + state.speed * time * math.cos(state.heading) - float(own.x)
                y = state.y + state.speed * time * math.sin(state.heading) - float(own.y)
                near = least_gap(OWN_ALTITUDE, level, 0.0, np.array([time]))[0]
                assert math.hypot(x, y) >= 1_000.0 or near >= 600.0
        assert answer.certificate is not None
        data = json.loads(answer.certificate)
        check.accept(data)
        if data["apart"]:
            apart_rows = data["apart"]
            for edited in (
                [[entry[0], entry[1], entry[2] + 30.0, *entry[3:]] for entry in apart_rows],
                [
                    [entry[0], entry[1], entry[2], *entry[3:8], entry[8] + 5_000.0]
                    for entry in apart_rows
                ],
                [[99, *entry[1:]] for entry in apart_rows],
            ):
                ends_with_plan = all(entry[2] > end for entry in apart_rows)
                if edited[0][2] > apart_rows[0][2] and ends_with_plan:
                    continue
                with pytest.raises(check.RefusedError):
                    check.accept(data | {"apart": edited})
    assert safe >= 20 and timed >= 8


def descending() -> Intruder:
    """Return an aircraft that meets the ownship at 40 s, 800 m above, and is level from 60 s on."""
    altitude = Altitude(2_000.0 + 600.0 + 600.0, "msl", -10.0)
    return Intruder(VehicleState(3_200.0, -4_000.0, math.pi / 2.0, 100.0), altitude=altitude)


LEVEL = Altitude(2_000.0, "msl", 0.0)


def test_an_intruder_counts_between_two_times_and_the_answer_says_which() -> None:
    answer = plan(OWN, [descending()], ROUTE, POLICY, OPTIONS, own_altitude=LEVEL)
    (counted,) = answer.windows
    assert (counted.number, counted.begin, counted.end) == pytest.approx((0, 60.0, 180.0), abs=1e-3)
    assert answer.excluded == ()
    # Where they meet it is above: nothing has to turn.
    assert answer.safe and answer.cost < 100.0 and answer.min_separation > 1_000.0
    later = replace(descending(), altitude=replace(LEVEL, value=2_600.0, vertical_speed=-10.0))
    turned = plan(OWN, [later], ROUTE, POLICY, OPTIONS, own_altitude=LEVEL)
    assert turned.windows[0].begin == 0.0 and turned.cost > 100.0
    assert "apart" in json.loads(turned.certificate or b"")


def test_the_start_margin_is_no_matter_of_an_intruder_that_counts_later() -> None:
    near = Intruder(
        VehicleState(0.0, 400.0, math.pi / 2.0, 80.0),
        altitude=Altitude(3_200.0, "msl", -10.0),
        velocity_std=5.0,
    )
    answer = plan(OWN, [near], ROUTE, POLICY, OPTIONS, own_altitude=LEVEL)
    assert answer.safe  # 400 m away, but 1200 m above


def test_bands_are_closed_by_an_intruder_while_it_is_level() -> None:
    own = VehicleState(*(np.array([value]) for value in OWN))
    state = VehicleState(*(np.array([[value]]) for value in (8_000.0, 0.0, math.pi, 80.0)))
    for first, last, lost in ((0.0, 20.0, False), (60.0, 200.0, False), (40.0, 50.0, True)):
        reports = Traffic.straight(state)._replace(
            window=Window(np.array([[first]]), np.array([[last]]))
        )
        # The range is below 1 km from 43.75 s until 56.25 s.
        losses = bands.losses_on_course(own, reports, Requirement(1_000.0), 120.0)
        assert np.isfinite(losses[0, 0]) == lost
        ahead = bands.heading_bands(
            own, reports, Requirement(1_000.0), C208_PUBLISHED, 120.0, np.array([0.0])
        )
        assert bool(ahead.closed[0, 0]) is lost


def test_the_monitor_knows_when_an_intruder_counts() -> None:
    answer = plan(OWN, [descending()], ROUTE, POLICY, OPTIONS, own_altitude=LEVEL)
    thresholds = Thresholds.for_plans(OPTIONS)
    reports = {"a": descending()}
    for levels_off, lost in ((False, False), (True, True)):
        watch = activate(begin(thresholds), answer, OWN, reports, 0.0, own_altitude=LEVEL)
        now = reports["a"]
        if levels_off:  # at once it is level: the plan passes in front of it
            now = replace(now, altitude=replace(LEVEL, value=2_100.0))
        _, verdict = step(watch, 0.5, OWN._replace(x=40.0), {"a": now}, own_altitude=LEVEL)
        causes = {why.cause for why in verdict.reasons}
        assert (Cause.SEPARATION in causes) is lost
        if verdict.ask is not None:
            assert verdict.ask.own_altitude == LEVEL
            assert verdict.ask.intruders[0].altitude == now.altitude


def test_a_request_among_others_counts_its_own_windows() -> None:
    request, _, _ = check_request(*question(3), OPTIONS, OWN_ALTITUDE)
    assert request.traffic.window is not None
    begin = take(request.traffic.window, 0).begin
    assert begin.shape == request.traffic.mask.shape[1:]
