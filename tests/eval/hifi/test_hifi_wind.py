"""Plans for a wind keep in it what plans keep in calm air: limits in the air, separation, the goal on the ground."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.config.load import load
from agents.planner.request import Options
from agents.planner.traffic import Traffic as Known
from agents.policy.inference import Policy
from envs.c208.air_mass import NO_WIND, over_ground, through_air
from envs.kinematics import SURROGATE, VehicleState
from envs.trees import take
from envs.waypoints import at, legs
from eval.hifi.conditions import CONDITIONS, drawn
from eval.hifi.config import HifiConfig
from eval.hifi.flights import Campaign, LoadedCampaign, Scene, flown, scene_of
from eval.hifi.rows import row_of
from eval.hifi.run import campaign_of
from eval.hifi.vehicle import Navigation
from eval.hifi.wind import Made, Route, airspeeds, made_good, plan_for, unflyable

FORWARD = Route(np.array([0.0, 10_000.0, 50_000.0]), np.zeros(3))


POLICY: list[Path] = []


@pytest.fixture(autouse=True, scope="module")
def _hand_made(policy_path: Path) -> None:
    """Plan with a policy that does not change with the one that ships."""
    POLICY[:] = [policy_path]


@cache
def policy() -> Policy:
    return Policy.load(POLICY[0])


def campaign(*overrides: str) -> Campaign:
    return campaign_of(load(HifiConfig, None, [f"policy={POLICY[0]}", *overrides]))[0]


def planned(scene: Scene, options: Options) -> Made:
    ground = over_ground(scene.encounter.intruders, scene.wind, 0.0)
    known = Known.straight(through_air(ground, scene.frame, 0.0), scene.encounter.mask)
    own = through_air(scene.own, scene.frame, 0.0)
    return plan_for(own, known, scene.route, 0.0, scene.frame, policy(), options)


@settings(max_examples=15)
@given(st.integers(0, 500), st.floats(0.0, 15.0))
def test_a_plan_for_a_wind_enters_the_goal_on_the_ground(number: int, wind: float) -> None:
    flying = campaign(f"condition.wind_mps=[{wind},{wind}]")
    scene = scene_of(flying, number)
    made = planned(scene, flying.setting.options)
    found = made.plans.proposals
    if made.problem is not None or not found.safe[0] or found.goal[0] != 1:
        return  # refused, or rejoined elsewhere: said so
    curves, rejoin = legs(take(found.knots, 0)), float(found.rejoin_time[0])
    there = over_ground(VehicleState(*(float(f) for f in at(curves, rejoin))), scene.frame, rejoin)
    assert math.hypot(scene.route.x[1] - there.x, scene.route.y[1] - there.y) <= flying.rules.goal_radius
    slow, fast = airspeeds(curves, scene.frame, scene.wind)
    # 0.4 m/s is the swing of the smoothing that plans are made for.
    assert SURROGATE.speed_min - 1.0 <= slow <= fast <= SURROGATE.speed_max + 1e-9


@pytest.mark.parametrize("number", [1, 4])
def test_in_a_wind_the_surrogate_flies_its_plan_as_in_calm_air(number: int) -> None:
    flying = campaign("aircraft=surrogate", "condition.wind_mps=[15,15]")
    one = flown(LoadedCampaign(flying), number)
    row = row_of(flying, number, one)
    assert row["plan_status"] == "safe"
    assert row["position_error_max_m"] < 0.02
    assert abs(row["separation_loss_m"]) < 0.05
    assert row["outcome"] == "reached"


def test_an_encounter_is_the_same_conflict_in_any_wind() -> None:
    calm, windy = (scene_of(campaign(f"condition.wind_mps=[{w},{w}]"), 3) for w in (0, 15))
    for a, b in zip(calm.encounter.own, windy.encounter.own, strict=True):
        assert a == b
    assert through_air(windy.own, windy.wind, 0.0).speed == pytest.approx(calm.own.speed)
    # Straight on at this speed the goal is met in both.
    away = math.hypot(calm.route.x[1] - calm.own.x, calm.route.y[1] - calm.own.y) / calm.own.speed
    drift = windy.route.x[1] - calm.route.x[1], windy.route.y[1] - calm.route.y[1]
    assert drift == pytest.approx([windy.wind[0] * away, windy.wind[1] * away])


@given(st.floats(45.0, 100.0), st.floats(-3.1, 3.1), st.tuples(st.floats(-30.0, 30.0), st.floats(-30.0, 30.0)))
def test_the_wind_triangle_closes(airspeed: float, course: float, wind: tuple[float, float]) -> None:
    speed = made_good(airspeed, course, wind)
    east, north = speed * math.cos(course) - wind[0], speed * math.sin(course) - wind[1]
    assert math.hypot(east, north) == pytest.approx(airspeed)


@pytest.mark.parametrize("wind", [(-72.0, 0.0), (0.0, 75.0), (-50.0, 60.0)])
def test_a_wind_that_cannot_be_made_good_is_refused(wind: tuple[float, float]) -> None:
    nobody = Known.straight(VehicleState(*(np.full((1, 1), value) for value in (9e4, 9e4, 0.0, 70.0))))
    made = plan_for(VehicleState(0.0, 0.0, 0.0, 70.0), nobody, FORWARD, 0.0, wind, policy(), Options())
    assert made.problem is not None
    assert "cannot be made good" in made.problem
    assert not made.plans.proposals.safe[0]


def test_an_air_speed_outside_the_envelope_is_refused() -> None:
    nobody = Known.straight(VehicleState(*(np.full((1, 1), value) for value in (9e4, 9e4, 0.0, 70.0))))
    made = plan_for(VehicleState(0.0, 0.0, 0.0, 44.0), nobody, FORWARD, 0.0, NO_WIND, policy(), Options())
    assert made.problem == "own air speed is 44.0 m/s, expected 49 to 101 m/s"


def test_a_plan_without_wind_is_refused_outside_the_envelope() -> None:
    flying = campaign("wind_plan=ground", "condition.wind_mps=[15,15]", "changes.own_speed=[50,52]")
    rows = [row_of(flying, number, flown(LoadedCampaign(flying), number)) for number in range(3)]
    flying = flying._replace(wind_plan="air")
    assert all(
        row["plan_status"] == "safe" for row in (row_of(flying, n, flown(LoadedCampaign(flying), n)) for n in range(1))
    )
    refused = [row["reason"] for row in rows if row["outcome"] == "refused"]
    assert refused
    assert all("air speed" in reason for reason in refused)


def test_legs_are_judged_by_the_speed_relative_to_the_air_that_blows() -> None:
    knots = take(planned(scene_of(campaign(), 0), campaign().setting.options).plans.proposals.knots, 0)
    curves = legs(knots)
    slow, fast = airspeeds(curves, (3.0, 4.0), (3.0, 4.0))
    assert slow == pytest.approx(curves.speed.min(), abs=0.5)
    assert unflyable(curves, NO_WIND, NO_WIND, (slow - 0.1, fast + 0.1)) is None
    problem = unflyable(curves, NO_WIND, (20.0, 0.0), (slow - 0.1, fast + 0.1))
    assert problem is not None
    assert "the plan asks for air speeds of" in problem


@given(st.integers(0, 10_000), st.sampled_from(sorted(CONDITIONS)))
def test_conditions_follow_from_the_number_and_keep_their_ranges(number: int, name: str) -> None:
    family = CONDITIONS[name]
    one = drawn(family, 5, number, 8807.0)
    assert one == drawn(family, 5, number, 8807.0)
    wind = math.hypot(one.air.wind_east, one.air.wind_north)
    assert family.wind_mps[0] - 1e-9 <= wind <= family.wind_mps[1] + 1e-9
    low, high = family.weight_lb or (8807.0, 8807.0)
    assert low <= (one.air.loading.weight or 0.0) <= high
    assert one.air.turbulence in family.turbulence
    if family.wind_error_mps == 0.0:
        assert one.believed_wind == (one.air.wind_east, one.air.wind_north)


def test_the_error_of_the_navigation_is_as_large_as_stated_and_changes_slowly() -> None:
    here = VehicleState(0.0, 0.0, 0.0, 70.0)
    assert Navigation(0.0, 0, 0).seen(here, 10.0) is here
    seen = np.array([Navigation(5.0, 0, number).seen(here, 200.0)[:2] for number in range(200)])
    assert 4.3 < np.sqrt(np.mean(seen**2)) < 5.7
    one = Navigation(5.0, 0, 1)
    track = np.array([one.seen(here, 0.1 * tick)[:2] for tick in range(3000)])
    assert np.hypot(*np.diff(track, axis=0).T).max() < 0.5


def test_gentle_manoeuvres_keep_the_limits_of_the_vehicle_too() -> None:
    setting = load(HifiConfig, None, ["planner.vehicle=configs/vehicle_c208.yaml"]).planner.setting()
    assert setting.options.manoeuvre.speed_min == 55.0
    assert setting.options.manoeuvre.speed_max < 90.0
    assert setting.options.manoeuvre.acceleration_max < 0.28
    assert replace(setting.options, manoeuvre=Options().manoeuvre) != setting.options
    assert load(HifiConfig).planner.setting().options.manoeuvre == Options().manoeuvre
