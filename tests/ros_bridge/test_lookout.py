"""Before the first plan: what the monitor sees, in the winds that may blow."""

import math
from types import SimpleNamespace

import pytest

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from agents.planner.request.request import in_wind
from envs.wind import Wind
from ros_bridge.core.assurance import Supervision, initial
from ros_bridge.core.lookout import step_without_plan
from ros_bridge.core.reports import USUAL
from ros_bridge.core.situation import Situation
from ros_bridge.core.tasks import task
from tests.ros_bridge.scenes import (
    NOW,
    OPTIONS,
    SECOND,
    SETTINGS,
    THRESHOLDS,
    aircraft,
    crossing,
    situation_after,
)


def situation_in(wind: tuple[float, float] | None) -> Situation:
    fields = {}
    if wind is not None:
        fields = {"valid": 0xE5, "wind": SimpleNamespace(x=wind[0], y=wind[1], z=0.0)}
    return situation_after(crossing(), own=aircraft(0.0, 0.0, 0.0, 75.0, id="own", **fields))


def wind_of(looking: Supervision) -> Wind:
    return looking.air.wind


def assert_as_for_plans(looking: Supervision) -> None:
    unsure = in_wind(OPTIONS, wind_of(looking))
    assert looking.thresholds_in_air.limits == unsure.limits != OPTIONS.limits


def test_a_wind_that_is_not_reported_may_blow_from_anywhere() -> None:
    looking = step_without_plan(initial(THRESHOLDS), situation_in(None), NOW)
    assessment = looking.assessment
    assert assessment is not None
    assert wind_of(looking) == Wind(std=USUAL.wind_std)
    assert_as_for_plans(looking)


@pytest.mark.parametrize("wind", [(0.0, 0.0), (8.0, -6.0)])
def test_a_wind_that_is_reported_is_as_uncertain_as_for_plans(wind: tuple[float, float]) -> None:
    situation = situation_in(wind)
    looking = step_without_plan(initial(THRESHOLDS), situation, NOW)
    assessment = looking.assessment
    assert assessment is not None
    assert wind_of(looking) == pytest.approx((*wind, USUAL.reported_wind_std))
    assert wind_of(looking) == task(situation, NOW, SETTINGS).wind
    assert_as_for_plans(looking)


def test_it_begins_anew_where_the_wind_becomes_known_or_unknown() -> None:
    looking = step_without_plan(initial(THRESHOLDS), situation_in(None), NOW)
    looking = step_without_plan(looking, situation_in((0.0, 0.0)), NOW)
    assessment = looking.assessment
    assert assessment is not None and wind_of(looking) == Wind(std=USUAL.reported_wind_std)
    assert step_without_plan(looking, situation_in((0.5, 0.5)), NOW).air == looking.air
    looking = step_without_plan(looking, situation_in((8.0, -6.0)), NOW)
    assert wind_of(looking) == pytest.approx((8.0, -6.0, USUAL.reported_wind_std))
    looking = step_without_plan(looking, situation_in(None), NOW)
    assert wind_of(looking) == Wind(std=USUAL.wind_std)


def test_nothing_is_seen_where_an_uncertain_wind_leaves_nothing_of_the_limits() -> None:
    unsure = initial(THRESHOLDS, USUAL._replace(wind_std=40.0))
    looking = step_without_plan(unsure, situation_in(None), NOW)
    assessment = looking.assessment
    assert assessment is None
    looking = step_without_plan(looking, situation_in(None), NOW)
    assessment = looking.assessment
    assert assessment is None
    looking = step_without_plan(looking, situation_in((8.0, -6.0)), NOW)
    assessment = looking.assessment
    assert assessment is not None
    unsure = initial(THRESHOLDS, USUAL._replace(reported_wind_std=40.0))
    assert step_without_plan(unsure, situation_in((8.0, -6.0)), NOW).assessment is None


def test_who_can_come_near_in_a_wind_within_its_uncertainty_counts() -> None:
    """One that has long been silent, too far away unless both have the wind behind them."""
    fields = {"valid": 0xE5, "wind": SimpleNamespace(x=0.0, y=0.0, z=0.0)}
    silent = aircraft(128_000.0, 0.0, math.pi, 75.0, time=NOW - 6 * SECOND)
    own = aircraft(0.0, 0.0, 0.0, 75.0, id="own", **fields)
    situation = situation_after(silent, own=own)
    for std, counts in ((0.0, False), (5.0, True)):
        begun = initial(THRESHOLDS, USUAL._replace(reported_wind_std=std))
        looking = step_without_plan(begun, situation, NOW)
        assert ("4b1a2c" in looking.names) == counts
