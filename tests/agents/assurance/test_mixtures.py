"""What the assurance says of several intruders together is what it says of each alone, however
different they are: known exactly or not, turning, counting for a while only, or absent.
"""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents import assurance
from agents.assurance import single
from agents.assurance.alerts import Alerting, Region, no_alerts, regions, update
from agents.assurance.backup import search, surroundings
from agents.assurance.bands import (
    Bands,
    area_losses,
    heading_bands,
    losses_on_course,
    recovery,
    speed_bands,
    stretches,
)
from agents.assurance.monitor import references
from agents.assurance.thresholds import BLIND, Thresholds
from agents.kernel.traffic import Requirement, Traffic, Window
from agents.planner import Options, RequestError, plan
from agents.policy.inference import Policy
from envs.kinematics import C208_PUBLISHED, VehicleState
from envs.waypoints import RoutePoint
from envs.wind import Wind
from tests.agents.extremes import altitudes, areas, intruders
from tests.agents.scenes import on_plan, straight
from tests.support import random_states, vehicle

REQUIREMENT = Requirement(1_000.0, margin=0.02, sigmas=2.0)
LOOK_AHEAD = 120.0
INTEREST = 200.0  # m of clearance, beyond which a lower bound will do
GOOD = 0.6  # m that a clearance may be off


@st.composite
def numbers(draw: Any) -> dict[str, float]:
    """Draw one intruder: near or far, exact or not, turning or not, always there or for a while."""
    away = draw(st.sampled_from([900.0, 3_000.0, 9_000.0, 60_000.0]))
    bearing = draw(st.floats(-math.pi, math.pi))
    exact, turning, timed = draw(st.booleans()), draw(st.booleans()), draw(st.booleans())
    begin = draw(st.floats(-50.0, 150.0)) if timed else -math.inf
    return {
        "x": away * math.cos(bearing),
        "y": away * math.sin(bearing),
        "heading": draw(st.floats(-math.pi, math.pi)),
        "speed": draw(st.sampled_from([0.0, 40.0, 75.0, 110.0])),
        "mask": draw(st.sampled_from([True, True, True, False])),
        "turn_rate": draw(st.sampled_from([-0.05, 1e-12, 0.03])) if turning else 0.0,
        "turn_time": draw(st.sampled_from([0.0, 15.0, 200.0])) if turning else 0.0,
        "position_std": 0.0 if exact else draw(st.sampled_from([0.0, 30.0, 400.0])),
        "velocity_std": 0.0 if exact else draw(st.sampled_from([0.0, 1.0, 5.0])),
        "age": 0.0 if exact else draw(st.sampled_from([0.0, 3.0])),
        "separation": draw(st.sampled_from([math.nan, 300.0, 2_000.0])),
        "begin": begin,
        "end": begin + draw(st.floats(0.0, 100.0)) if timed else math.inf,
    }


def traffic_of(group: list[dict[str, float]], windows: bool = True) -> Traffic:
    """Return the intruders of one ownship, ``[1, K]``."""
    field = {
        name: np.array(
            [[intruder[name] for intruder in group]], dtype=bool if name == "mask" else float
        )
        for name in intruder_fields()
    }
    state = VehicleState(*(field[name] for name in VehicleState._fields))
    window = Window(field["begin"], field["end"]) if windows else None
    rest = {name: field[name] for name in Traffic._fields if name not in ("state", "window")}
    return Traffic(state=state, window=window, **rest)


def intruder_fields() -> tuple[str, ...]:
    """Return the names of what one intruder is drawn with."""
    return (*VehicleState._fields, *Traffic._fields[1:-1], "begin", "end")


def bands_of(traffic: Traffic) -> tuple[Bands, Bands]:
    """Return the bands of headings and of speeds of an ownship that flies east."""
    given = vehicle(0.0, 0.0, 0.0, 75.0), traffic, REQUIREMENT, C208_PUBLISHED, LOOK_AHEAD
    return heading_bands(*given), speed_bands(*given)


@settings(max_examples=15, deadline=None)
@given(st.lists(numbers(), min_size=1, max_size=4))
def test_a_mixture_closes_what_one_of_its_intruders_closes(group: list[dict[str, float]]) -> None:
    together = bands_of(traffic_of(group))
    bands_alone = [bands_of(traffic_of([alone])) for alone in group]
    for kind, mixed in enumerate(together):
        alone = [bands[kind].clearance for bands in bands_alone]
        least = np.minimum.reduce(alone)
        np.testing.assert_allclose(
            np.minimum(mixed.clearance, INTEREST), np.minimum(least, INTEREST), atol=GOOD
        )
        clear = np.abs(least) > GOOD
        closed = np.logical_or.reduce([bands[kind].closed for bands in bands_alone])
        assert (mixed.closed == closed)[clear].all()
        # The time of a loss is told, and by whom.
        first = np.minimum.reduce([bands[kind].loss for bands in bands_alone])
        lost = closed & clear
        np.testing.assert_allclose(mixed.loss[lost], first[lost], atol=1.1)
        assert (mixed.intruder[lost] >= 0).all()

    losses = losses_on_course(
        vehicle(0.0, 0.0, 0.0, 75.0), traffic_of(group), REQUIREMENT, LOOK_AHEAD
    )
    alone_losses = [
        losses_on_course(
            vehicle(0.0, 0.0, 0.0, 75.0), traffic_of([alone]), REQUIREMENT, LOOK_AHEAD
        ).item()
        for alone in group
    ]
    assert losses.shape == (1, len(group))
    # A graze of less than a clearance's error may be a loss or none.
    both = np.isfinite(losses[0]) & np.isfinite(alone_losses)
    np.testing.assert_allclose(losses[0][both], np.array(alone_losses)[both], atol=1.1)


def test_bands_of_an_exact_intruder_beside_a_far_one_that_is_not() -> None:
    near = {**dict.fromkeys(intruder_fields(), 0.0), "x": 6_000.0, "heading": math.pi}
    near |= {"speed": 75.0, "mask": True, "separation": math.nan}
    near |= {"begin": -math.inf, "end": math.inf}
    far = near | {"x": -60_000.0, "velocity_std": 2.0}
    alone, both = bands_of(traffic_of([near], False)), bands_of(traffic_of([near, far], False))
    for kind in range(2):
        assert both[kind].closed.any()
        assert (both[kind].closed == alone[kind].closed).all()


POLICY = Policy.load()
OPTIONS = Options.for_aircraft(POLICY.aircraft, deadline_s=math.inf, exhaustive=False, goals=1)
THRESHOLDS = Thresholds.for_plans(OPTIONS)
ALERTING = Alerting.for_aircraft(POLICY.aircraft)
ROUTE = [RoutePoint(number, 12_000.0 + 5_000.0 * number, 0.0) for number in range(9)]


def look_at(verdict: single.Assessment, thresholds: Thresholds) -> None:
    """Compute all that a display shows of a verdict."""
    measured = verdict.measured
    if int(measured.causes[0]) & BLIND:
        return
    own, traffic, areas = measured.own, measured.traffic, measured.areas
    given = own, traffic, thresholds.requirement
    about = thresholds.manoeuvre, LOOK_AHEAD, None, areas
    for bands, circle in (
        (heading_bands(*given, *about), True),
        (speed_bands(*given, *about), False),
    ):
        for field in bands:
            assert not np.isnan(np.asarray(field, dtype=float)).any()
        parts = stretches(bands, circle=circle)
        for part, after in itertools.pairwise(parts):
            assert part.low < part.high == after.low and part.closed != after.closed
        shown = regions(bands, ALERTING, POLICY.aircraft.separation)
        assert ((shown == Region.FREE).any() | bands.closed.all()).all()
        assert (recovery(bands, POLICY.aircraft.separation).index >= 0) == bands.closed.all()
    losses = losses_on_course(*given, LOOK_AHEAD)
    assert losses.shape == traffic.mask.shape and not np.isnan(losses).any()
    area_losses(own, areas[0], thresholds.requirement.margin, LOOK_AHEAD)


@settings(max_examples=8, deadline=None)
@given(st.data())
def test_monitor_and_guidance_go_on_whatever_the_traffic_is(data: st.DataObject) -> None:
    draw = data.draw
    wind = draw(st.sampled_from([None, Wind(10.0, -5.0, 1.0)]))
    altitude, fences = draw(altitudes()), draw(st.lists(areas(), max_size=2))
    reports = {name: draw(intruders()) for name in draw(st.sampled_from(["", "a", "abc"]))}
    own, time = VehicleState(0.0, 0.0, 0.0, 70.0), 0.0
    first = plan(own, [], ROUTE, POLICY, OPTIONS, wind=wind)
    watch = single.activate(single.begin(THRESHOLDS), first, own, {}, time)
    for number in range(4):
        time += draw(st.sampled_from([1.0, 1.0, 0.2, 0.0, 30.0]))
        reports[draw(st.sampled_from(["a", "b", f"new {number}"]))] = draw(intruders())
        own = VehicleState(70.0 * time, draw(st.sampled_from([0.0, 40.0])), 0.0, 70.0)
        watch, verdict = single.step(
            watch,
            time,
            draw(st.sampled_from([own, own, None])),
            {name: report for name, report in reports.items() if draw(st.booleans())},
            own_altitude=altitude,
            gone=[name for name in watch.names if draw(st.integers(0, 5)) == 0],
            areas=fences,
        )
        look_at(verdict, watch.thresholds_in_air)
        if verdict.ask is not None:
            asked = verdict.ask.own, verdict.ask.intruders, ROUTE, POLICY, OPTIONS
            try:
                again = plan(*asked, own_altitude=altitude, wind=wind, areas=fences)
            except RequestError:
                continue
            watch, _ = single.answer(watch, verdict.ask.number, again)


@pytest.mark.parametrize("count", [0, 1, 3])
@pytest.mark.parametrize("others", [0, 1, 2])
def test_any_number_of_aircraft_is_watched(count: int, others: int) -> None:
    rows, times = np.arange(count), np.zeros(count)
    own = on_plan(0.0, count)
    traffic = Traffic.straight(random_states(np.random.default_rng(1), count, others))
    monitor = assurance.start(count, others, THRESHOLDS)
    monitor = assurance.activate(
        monitor, rows, straight(count=count), times == 0.0, 0.0, traffic, THRESHOLDS
    )
    monitor, decision = assurance.step(
        monitor, assurance.inputs(1.0, on_plan(1.0, count), traffic.state), THRESHOLDS
    )
    assert decision.state.shape == (count,)
    assert references(monitor, times, 1.0, 2).x.shape == (3, count)
    assert search(own, surroundings(traffic), times, THRESHOLDS).safe.shape == (count,)
    for targets in (np.array([0.3]), np.zeros(0)):
        given = own, traffic, REQUIREMENT, C208_PUBLISHED, LOOK_AHEAD, targets
        for bands in (heading_bands(*given), speed_bands(*given)):
            assert bands.closed.shape == (count, targets.size)
    losses = losses_on_course(own, traffic, REQUIREMENT, LOOK_AHEAD)
    shown = update(no_alerts(count, others, ALERTING), times, losses, traffic.mask, ALERTING)
    assert shown.level.shape == (count, others)
