"""Flights of the true aircraft in calm air and wind: judged by their definition, marked where they
fail.
"""

import itertools
import math
import socket
import struct
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from agents.config.load import load, validate
from agents.kernel.levels import Altitude
from agents.kernel.traffic import Traffic as Known
from agents.planner.request.options import Maneuvers
from agents.planner.request.reports import Intruder
from agents.planner.request.request import Options
from agents.policy.inference import Policy
from commands.command import ConfigError
from envs.aircraft import PAPER
from envs.altitudes import REFERENCE
from envs.c208.conditions import Conditions
from envs.c208.flightgear import FlightGear, flightgear_at
from envs.c208.guidance import Path as Track
from envs.c208.vehicle import FlightError
from envs.follower import PERIOD
from envs.formats.local_frame import geocentric
from envs.frames import Ground
from envs.kinematics import C208_PUBLISHED, SURROGATE, VehicleState
from envs.outcome import RULES
from envs.profile import Height, corner_error, height_flown
from envs.relative import straight_cpa
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.trees import take
from envs.waypoints import Legs, PlanStates, at, legs, repeat
from envs.wind import NO_WIND, Wind, narrow, over_ground, through_air
from eval.flights.plan_flight import SUBSTEPS
from eval.hifi import flights as hifi_flights
from eval.hifi import pilots as hifi_pilots
from eval.hifi.config import (
    CONDITIONS,
    ConditionConfig,
    Drawn,
    HifiConfig,
    LevelRanges,
    draw_conditions,
)
from eval.hifi.errors import against
from eval.hifi.figures import distributions, sheet
from eval.hifi.flight import Flight, Levels, Traffic
from eval.hifi.flight import fly as follow
from eval.hifi.flights import Beginning, Campaign, FlightRecord, fly_one, prepare, scene_of
from eval.hifi.pilots import Assured, Follower
from eval.hifi.rows import ERRORS, row_of
from eval.hifi.run import campaign_of, main
from eval.hifi.summary import error_rows, rate_rows, summarise
from eval.hifi.vehicle import Navigation, begin, lookahead_of
from eval.hifi.wind import PlanResult, Route, plan_for, plan_in_space, unflyable
from eval.hifi.wind import Route as Straight
from ros_bridge.sim.world import EncounterFlight

ROOT = Path(__file__).resolve().parents[3]
SEPARATIONS = "envs.own_separations:separations"
OPTIONS = Options.for_aircraft(PAPER)
STATES = PlanStates(
    np.array([0.0, 1400.0, 2700.0, 3900.0]),
    np.array([0.0, 0.0, 350.0, 1050.0]),
    np.array([0.0, 0.1, 0.4, 0.55]),
    np.array([70.0, 70.0, 69.0, 71.0]),
    np.array([0.0, 20.0, 40.0, 60.0]),
)
PLAN = legs(STATES)
POLICY: list[Path] = []


@pytest.fixture(autouse=True, scope="module")
def _hand_made(policy_path: Path) -> None:
    """Fly a policy that does not change with the one that ships."""
    POLICY[:] = [policy_path]


def campaign(*overrides: str) -> Campaign:
    return campaign_of(load(HifiConfig, None, [f"policy={POLICY[0]}", *overrides]))[0]


def fly(flying: Campaign, number: int) -> tuple[FlightRecord, dict[str, Any]]:
    record = fly_one(*prepare(flying, policy()), number)
    return record, row_of(flying, number, record)


def along(plan: Legs, time: np.ndarray) -> VehicleState:
    return at(repeat(plan, time.size), time)


def flight(own: VehicleState, late: np.ndarray) -> Flight:
    return Flight(
        own=own,
        altitude=np.full(late.size, 2500.0),
        late=late,
        intruders=VehicleState(*(np.zeros((1, 1)) for _ in range(4))),
        separation=np.zeros(0),
        distance=np.zeros(0),
        goal_distance=np.zeros(late.size),
        failure=None,
    )


@settings(max_examples=15)
@given(
    st.floats(-3.0, 3.0),
    st.floats(-30.0, 30.0),
    st.tuples(st.floats(-15.0, 15.0), st.floats(-15.0, 15.0)),
)
def test_delay_and_offset_are_kept_apart(
    delay: float, left: float, blows: tuple[float, float]
) -> None:
    wind = Wind(*blows)
    clock = PERIOD * np.arange(50, 550)
    place = over_ground(along(PLAN, clock - delay), wind, clock - delay)
    moved = place._replace(
        x=place.x - left * np.sin(place.heading), y=place.y + left * np.cos(place.heading)
    )
    # Errors are taken from time 0 on: the first five seconds are filled with the plan itself.
    first = over_ground(along(PLAN, PERIOD * np.arange(50)), wind, PERIOD * np.arange(50))
    own = VehicleState(*(np.concatenate(pair) for pair in zip(first, moved, strict=True)))
    errors = against(flight(own, np.concatenate([np.zeros(50), np.full(500, delay)])), PLAN, wind)
    np.testing.assert_allclose(errors.late[50:], delay, atol=1e-4)
    np.testing.assert_allclose(errors.cross_track[50:], left, atol=1e-3)
    np.testing.assert_allclose(errors.position[:50], 0.0, atol=1e-6)
    # At 69 to 71 m/s a delay is that many metres; turns shorten the chord by little.
    expected = np.hypot(70.0 * delay, left)
    np.testing.assert_allclose(errors.position[50:], expected, rtol=0.6, atol=0.5)


def test_a_flight_along_the_plan_has_no_error() -> None:
    clock = PERIOD * np.arange(600)
    errors = against(
        flight(along(PLAN, clock), np.zeros(600)), PLAN, NO_WIND, along(PLAN, np.arange(60.0))
    )
    for field in errors:
        np.testing.assert_allclose(field, 0.0, atol=1e-6)


@pytest.mark.parametrize(
    ("condition", "number"), [pytest.param("calm", 0, marks=pytest.mark.slow), ("mixed", 1)]
)
def test_no_more_separation_is_lost_than_the_aircraft_is_off_its_plan(
    condition: str, number: int
) -> None:
    record, row = fly(campaign(f"condition.name={condition}"), number)
    assert row["plan_status"] == "safe"
    assert record.flight is not None
    assert record.errors is not None
    assert row["separation_loss_m"] <= row["position_error_max_m"] + 0.05
    assert row["cross_track_max_m"] <= row["position_error_max_m"] + 0.01
    if row["plan_source"] == "policy":
        assert (
            row["total_error_max_m"]
            <= row["path_definition_max_m"] + row["position_error_max_m"] + 1e-6
        )
    assert row["altitude_error_max_m"] < 100.0


@pytest.mark.parametrize(("gain", "top", "beyond"), [(0.375, 99.6, True), (0.21, 89.6, False)])
def test_plans_beyond_the_aircrafts_power_are_flown_late(
    gain: float, top: float, beyond: bool
) -> None:
    time = 20.0 * np.arange(8)
    speed = np.minimum(80.0 + gain * time, top)
    ramp = (top - 80.0) / gain
    x = np.where(time < ramp, 80.0 * time + 0.5 * gain * time**2, top * time - 0.5 * gain * ramp**2)
    plan = legs(PlanStates(x, 0.0 * x, 0.0 * x, speed, time))
    rough = Drawn(Conditions(turbulence="moderate", seed=2), 2500.0, NO_WIND, 0.0)
    vehicle = begin("c208_ex", VehicleState(0.0, 0.0, 0.0, 80.0), rough, C208_PUBLISHED)
    nobody = Traffic(encounters_of_seed(scenario("circle", PAPER), 0, 0, 1), NO_WIND)
    flown_with = vehicle, Follower(Track(plan), lookahead_of("c208_ex")), Navigation(0.0, 0, 0)
    errors = against(follow(*flown_with, nobody, (1e6, 0.0), RULES, 140), plan, NO_WIND)
    assert bool(errors.position.max() > 60.0) is beyond
    assert np.abs(errors.cross_track).max() < 5.0


def check_verdict(row: dict[str, Any]) -> None:
    """Hold a verdict against its definition."""
    assert row["outcome"] in ("reached", "violation", "timeout")
    assert (row["min_separation_m"] < 1_000.0) == (row["outcome"] == "violation")
    if row["outcome"] == "reached":
        assert row["goal_distance_m"] <= 500.0
    assert (row["reason"] == "") == (row["outcome"] == "reached")


@pytest.mark.slow
def test_a_flight_in_closed_loop_ends_where_it_is_decided() -> None:
    for number in range(3):
        record, row = fly(campaign("mode=closed", "condition.name=wind"), number)
        check_verdict(row)
        assert record.flight is not None
        assert math.ceil(row["duration_s"]) == record.flight.separation.size
        assert row["plan_status"] == "none"


@pytest.mark.slow
def test_the_assured_loop_plans_anew_for_an_intruder_that_turns() -> None:
    turning = (
        "scenario=maneuvering",
        "condition.name=wind",
        "planner.margin=60",
        "aircraft.t_max_s=100",
    )
    rows = [fly(campaign("mode=assured", *turning), number)[1] for number in (0, 2)]
    for row in rows:
        check_verdict(row)
        assert row["taken_up"] <= row["replans"]
    assert any(row["taken_up"] for row in rows)


class _Lost:
    """Flies straight east for two seconds, then is lost."""

    height = Height(2500.0, 0.0)

    def __init__(self, own: VehicleState, nan: bool) -> None:
        self.state, self._nan, self._time = own, nan, 0.0

    def step(self, acceleration: Any, yaw_rate: Any, dt: float) -> None:
        self._time += dt
        if self._time > 2.0 and not self._nan:
            raise FlightError("the aircraft is 120 m above the sea, below 150 m, at 2.10 s")
        x = math.nan if self._time > 2.0 else self.state.x + self.state.speed * dt
        self.state = self.state._replace(x=x)


@pytest.mark.parametrize("mode", ["plan", "closed", "assured"])
@pytest.mark.parametrize("nan", [False, True])
def test_an_aircraft_that_is_lost_is_a_failed_flight(
    mode: str, nan: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hifi_flights, "begin", lambda _, own, *arguments: _Lost(own, nan))
    _, row = fly(campaign(f"mode={mode}"), 1)
    assert row["outcome"] == "failed"
    assert ("not finite at 2." if nan else "120 m above the sea") in row["reason"]
    assert math.isnan(row["position_error_max_m"])


class _Straight:
    """Flies straight on whatever is commanded."""

    height = Height(2500.0, 0.0)

    def __init__(self, own: VehicleState) -> None:
        self.state = own

    def step(self, acceleration: Any, yaw_rate: Any, dt: float) -> None:
        east = self.state.speed * math.cos(self.state.heading) * dt
        north = self.state.speed * math.sin(self.state.heading) * dt
        self.state = self.state._replace(x=self.state.x + east, y=self.state.y + north)


def test_a_safe_plan_promised_what_an_aircraft_that_leaves_it_loses(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(hifi_flights, "begin", lambda _, own, *arguments: _Straight(own))
    record, row = fly(campaign("scenario=head_on"), 0)
    assert row["plan_status"] == "safe" and row["outcome"] == "violation"
    assert row["plan_loss"] == "broken"
    assert record.flight is not None
    # Among intruders that do fly straight, both separations are the same.
    assert row["promised_min_separation_m"] == pytest.approx(row["min_separation_m"], abs=0.05)


@pytest.mark.slow
def test_no_safe_plan_promised_what_an_intruder_that_turns_costs() -> None:
    turning = campaign("scenario=maneuvering", "planner.margin=30")._replace(vehicle="surrogate")
    rows = [fly(turning, number)[1] for number in (0, 1, 2, 9)]
    lost = [row for row in rows if row["outcome"] == "violation" and row["plan_status"] == "safe"]
    assert lost
    for row in lost:
        assert row["plan_loss"] == "not_promised"
        assert row["promised_min_separation_m"] >= 1_000.0 > row["min_separation_m"]
    flown_clear = [row for row in rows if row not in lost]
    assert flown_clear and all(row["plan_loss"] == "" for row in flown_clear)


def test_a_start_that_the_aircraft_cannot_fly_is_refused() -> None:
    flying = campaign(
        "changes.own_speed=[50,50]", "condition.altitude_m=[6500,6500]", "mode=closed"
    )
    record, row = fly(flying, 0)
    assert record.flight is None
    assert row["outcome"] == "refused"
    assert "the flight cannot begin: no equilibrium" in row["reason"]
    _, row = fly(flying._replace(mode="plan"), 0)
    assert row["outcome"] == "refused"
    assert "the plan asks for air speeds of" in row["reason"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mode", "areas"), [("plan", 0), ("assured", 0), ("closed", 0), ("closed", 2)]
)
def test_the_usual_separation_of_each_changes_no_row(mode: str, areas: int) -> None:
    starts = encounters_of_seed(scenario("multi", PAPER), 2, 0, 1)
    flying = campaign(f"mode={mode}", "vehicle=point_mass")._replace(source=starts, areas=areas)
    usual = starts._replace(separation=np.full(starts.mask.shape, PAPER.separation))
    _, row = fly(flying, 0)
    _, row_of_usual = fly(flying._replace(source=usual), 0)
    np.testing.assert_equal(row_of_usual, row)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["plan", "assured"])
def test_safe_plans_keep_the_separation_of_each_intruder(mode: str) -> None:
    flying = campaign(f"mode={mode}", f"scenario={SEPARATIONS}", "seed=5")
    for number in range(2):
        record, row = fly(flying, number)
        assert record.flight is not None and row["plan_status"] == "safe"
        assert row["outcome"] == "reached" and row["verdict"] == "resolvable"
        start = record.scene.encounter
        own = take(record.flight.own, slice(None, None, SUBSTEPS))
        away = np.hypot(
            own.x[:, None] - record.flight.intruders.x, own.y[:, None] - record.flight.intruders.y
        )
        counted = (away * (PAPER.separation / start.separation))[:301, start.mask[0]]
        assert PAPER.separation <= row["min_separation_m"] <= counted.min()
        assert row["min_separation_m"] == pytest.approx(counted.min(), rel=0.02)
        assert row["min_separation_m"] != pytest.approx(
            record.flight.distance[:300].min(), rel=0.02
        )


def test_a_separation_of_its_own_is_lost_far_beyond_the_usual_one() -> None:
    start = encounters_of_seed(scenario("head_on", PAPER), 0, 0, 1)
    record, row = fly(
        campaign("mode=closed", "vehicle=surrogate")._replace(
            source=start._replace(separation=np.full((1, 1), 50_000.0))
        ),
        0,
    )
    assert row["outcome"] == "violation" and row["duration_s"] == 1.0
    assert record.flight is not None and record.flight.distance.min() > 2.0 * PAPER.separation
    assert row["min_separation_m"] == pytest.approx(record.flight.distance.min() / 50.0)


@pytest.mark.slow
def test_a_plan_that_is_not_safe_is_no_success() -> None:
    flying = campaign(
        "scenario=circle", "changes.min_initial_separation=0", "changes.radius=[1100,1200]"
    )
    rows = [fly(flying._replace(vehicle="point_mass"), number)[1] for number in range(2)]
    unresolved = [row for row in rows if row["plan_status"] == "unresolved"]
    assert unresolved
    assert all(row["outcome"] != "reached" for row in unresolved)


# Plans for a wind keep in it what plans keep in calm air: limits in the air, separation, the goal
# on the ground.

FORWARD = Route(np.array([0.0, 10_000.0, 50_000.0]), np.zeros(3))


@cache
def policy() -> Policy:
    return Policy.load(POLICY[0])


def plan_scene(scene: Beginning, options: Options) -> PlanResult:
    ground = over_ground(scene.encounter.intruders, scene.wind, 0.0)
    traffic = Known.straight(through_air(ground, scene.frame, 0.0), scene.encounter.mask)
    own = through_air(scene.own, scene.frame, 0.0)
    return plan_for(own, traffic, scene.route, 0.0, scene.frame, policy(), options)


@settings(max_examples=15)
@given(st.integers(0, 500), st.floats(0.0, 15.0))
def test_a_plan_for_a_wind_enters_the_goal_on_the_ground(number: int, wind: float) -> None:
    flying = campaign(f"condition.wind_mps=[{wind},{wind}]")
    scene = scene_of(flying, number)
    planned = plan_scene(scene, flying.options)
    candidates = planned.plans.candidates
    if planned.problem is not None or not candidates.safe[0] or candidates.goal[0] != 1:
        return  # refused, or rejoined elsewhere: said so
    curves, rejoin = legs(take(candidates.plan_states, 0)), float(candidates.rejoin_time[0])
    place = over_ground(VehicleState(*(float(f) for f in at(curves, rejoin))), scene.frame, rejoin)
    assert (
        math.hypot(scene.route.x[1] - place.x, scene.route.y[1] - place.y)
        <= flying.aircraft.goal_radius
    )
    # 0.4 m/s is the swing of the smoothing that plans are made for.
    assert unflyable(curves, (SURROGATE.speed_min - 1.0, SURROGATE.speed_max + 1e-9)) is None


@pytest.mark.parametrize("number", [1, pytest.param(4, marks=pytest.mark.slow)])
def test_in_a_wind_the_surrogate_flies_its_plan_as_in_calm_air(number: int) -> None:
    flying = campaign("vehicle=surrogate", "condition.wind_mps=[15,15]")
    _, row = fly(flying, number)
    assert row["plan_status"] == "safe"
    assert row["position_error_max_m"] < 0.02
    assert abs(row["separation_loss_m"]) < 0.05
    assert row["outcome"] == "reached"


def test_a_plan_in_an_uncertain_wind_keeps_the_limits_in_every_wind_within_it() -> None:
    flying = campaign("condition.wind_mps=[10,10]", "condition.wind_error_mps=1")
    scene, limits = scene_of(flying, 3), flying.options.limits
    assert scene.frame.std == 1.0
    planned = plan_scene(scene, flying.options)
    assert planned.problem is None and planned.plans.candidates.safe[0]
    curves = legs(take(planned.plans.candidates.plan_states, 0))
    narrowed = narrow(limits, flying.options.requirement.sigmas)
    assert np.abs(curves.yaw_rate).max() <= narrowed.yaw_rate_max + 1e-6 < limits.yaw_rate_max
    assert curves.acceleration.min() >= narrowed.acceleration_min - 1e-6 > limits.acceleration_min
    assert curves.acceleration.max() <= narrowed.acceleration_max + 1e-6 < limits.acceleration_max


@pytest.mark.slow
def test_the_assured_loop_keeps_the_limits_in_every_wind_within_its_uncertainty(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    flown: list[Legs] = []

    def follow_legs(curves: Legs, *arguments: Any) -> Track:
        flown.append(curves)
        return Track(curves, *arguments)

    monkeypatch.setattr(hifi_pilots, "Path", follow_legs)
    flying = campaign(
        "mode=assured",
        "scenario=maneuvering",
        "condition.wind_mps=[10,10]",
        "condition.wind_error_mps=1",
        "planner.margin=60",
        "aircraft.t_max_s=100",
    )
    rows = [fly(flying, number)[1] for number in (0, 2)]
    # The planner knows the monitor's limits, so its new plans are taken up.
    assert any(row["taken_up"] for row in rows)
    assert any(row["backup_s"] > 0.0 for row in rows)
    narrowed = narrow(flying.options.limits, flying.options.requirement.sigmas)
    for curves in flown:
        assert np.abs(curves.yaw_rate).max() <= narrowed.yaw_rate_max + 1e-6
        assert curves.acceleration.min() >= narrowed.acceleration_min - 1e-6
        assert curves.acceleration.max() <= narrowed.acceleration_max + 1e-6


def test_a_wind_known_so_badly_that_nothing_can_be_flown_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"condition.wind_error_mps is 15: wind.std is 15 m/s"):
        campaign("condition.wind_error_mps=15")


def test_an_encounter_is_the_same_conflict_in_any_wind() -> None:
    calm, windy = (scene_of(campaign(f"condition.wind_mps=[{w},{w}]"), 3) for w in (0, 15))
    for a, b in zip(calm.encounter.own, windy.encounter.own, strict=True):
        assert a == b
    assert through_air(windy.own, windy.wind, 0.0).speed == pytest.approx(calm.own.speed)
    # Straight on at this speed the goal is met in both.
    away = math.hypot(calm.route.x[1] - calm.own.x, calm.route.y[1] - calm.own.y) / calm.own.speed
    drift = windy.route.x[1] - calm.route.x[1], windy.route.y[1] - calm.route.y[1]
    assert drift == pytest.approx([windy.wind[0] * away, windy.wind[1] * away])


@pytest.mark.parametrize("wind", [Wind(-95.0, 0.0), Wind(0.0, 105.0), Wind(-70.0, 90.0)])
def test_a_goal_that_the_wind_keeps_out_of_reach_has_no_plan(wind: Wind) -> None:
    nobody = Known.straight(
        VehicleState(*(np.full((1, 1), value) for value in (9e4, 9e4, 0.0, 70.0)))
    )
    planned = plan_for(
        VehicleState(0.0, 0.0, 0.0, 70.0),
        nobody,
        FORWARD,
        0.0,
        wind,
        policy(),
        Options.for_aircraft(PAPER),
    )
    assert not planned.plans.candidates.safe[0]


def test_an_air_speed_outside_the_envelope_is_refused() -> None:
    nobody = Known.straight(
        VehicleState(*(np.full((1, 1), value) for value in (9e4, 9e4, 0.0, 70.0)))
    )
    planned = plan_for(
        VehicleState(0.0, 0.0, 0.0, 44.0),
        nobody,
        FORWARD,
        0.0,
        NO_WIND,
        policy(),
        Options.for_aircraft(PAPER),
    )
    assert planned.problem == "own air speed is 44.0 m/s, expected 49 to 101 m/s"


def test_legs_beyond_the_air_speeds_of_the_vehicle_are_refused() -> None:
    curves = legs(
        take(
            plan_scene(scene_of(campaign(), 0), campaign().options).plans.candidates.plan_states, 0
        )
    )
    slow, fast = float(curves.speed.min()), float(curves.speed.max())
    assert unflyable(curves, (slow - 0.5, fast + 0.5)) is None
    assert "the plan asks for air speeds of" in str(unflyable(curves, (slow + 0.5, fast + 0.5)))


@given(st.integers(0, 10_000), st.sampled_from(sorted(CONDITIONS)))
def test_conditions_follow_from_the_number_and_keep_their_ranges(number: int, name: str) -> None:
    family = validate(ConditionConfig, {"name": name})
    assert validate(ConditionConfig, family.model_dump()) == family
    assert family.model_dump() == {"name": name}
    conditions = draw_conditions(family, 5, number, 8807.0)
    assert conditions == draw_conditions(family, 5, number, 8807.0)
    wind = math.hypot(conditions.air.wind_east, conditions.air.wind_north)
    assert family.wind_mps[0] - 1e-9 <= wind <= family.wind_mps[1] + 1e-9
    low, high = family.weight_lb or (8807.0, 8807.0)
    assert low <= (conditions.air.loading.weight or 0.0) <= high
    assert conditions.air.turbulence in family.turbulence
    if family.wind_error_mps == 0.0:
        assert conditions.believed_wind == Wind(conditions.air.wind_east, conditions.air.wind_north)


def test_the_error_of_the_navigation_is_as_large_as_stated_and_changes_slowly() -> None:
    own = VehicleState(0.0, 0.0, 0.0, 70.0)
    assert Navigation(0.0, 0, 0).believe(own, 10.0) is own
    places = np.array([Navigation(5.0, 0, number).believe(own, 200.0)[:2] for number in range(200)])
    assert 4.3 < np.sqrt(np.mean(places**2)) < 5.7
    navigation = Navigation(5.0, 0, 1)
    track = np.array([navigation.believe(own, 0.1 * tick)[:2] for tick in range(3000)])
    assert np.hypot(*np.diff(track, axis=0).T).max() < 0.5


def test_gentle_manoeuvres_keep_the_limits_of_the_vehicle_too() -> None:
    options = load(HifiConfig, None, ["planner.vehicle=configs/vehicle_c208.yaml"]).planner.options(
        PAPER
    )
    assert options.manoeuvre.speed_min == 55.0
    assert options.manoeuvre.speed_max < 90.0
    assert options.manoeuvre.acceleration_max < 0.28
    assert replace(options, manoeuvre=Options.for_aircraft(PAPER).manoeuvre) != options
    assert (
        load(HifiConfig).planner.options(PAPER).manoeuvre == Options.for_aircraft(PAPER).manoeuvre
    )


# What FlightGear is sent, read back from UDP sockets by the layouts of FlightGear's own headers.


OWN = struct.Struct(">I4x3d22f I40I I4f I12I IiI10f")
"""FGNetFDM of version 24 (src/Network/net_fdm.hxx): four engines and tanks, three wheels."""
OTHER = struct.Struct(">6I8s96s2d3d3f3f9fI")
"""T_MsgHdr and T_PositionMsg (src/MultiPlayer/mpmessages.hxx)."""

Ports = tuple[socket.socket, socket.socket]


@pytest.fixture
def ports() -> Iterator[Ports]:
    """Two sockets at ports that follow each other."""
    for port in range(42_000, 60_000, 2):
        with (
            socket.socket(type=socket.SOCK_DGRAM) as first,
            socket.socket(type=socket.SOCK_DGRAM) as second,
        ):
            try:
                first.bind(("127.0.0.1", port))
                second.bind(("127.0.0.1", port + 1))
            except OSError:
                continue
            yield first, second
            return


def viewer(ports: Ports, *, paced: bool) -> FlightGear:
    return flightgear_at(f"localhost:{ports[0].getsockname()[1]}", paced=paced)


def receive(udp: socket.socket, layout: struct.Struct) -> list[tuple]:
    udp.setblocking(False)
    packets = []
    while True:
        try:
            packets.append(layout.unpack(udp.recv(2_000)))
        except BlockingIOError:
            return packets


@pytest.mark.slow
def test_flightgear_is_sent_the_flight_in_real_time(policy_path: Path, ports: Ports) -> None:
    overrides = [f"policy={policy_path}", "mode=closed", "scenario=crossing_left"]
    campaign, _ = campaign_of(load(HifiConfig, None, overrides))
    campaign = campaign._replace(aircraft=campaign.aircraft._replace(t_max=2.0))
    viewed_campaign = campaign._replace(viewer=viewer(ports, paced=True))
    began = time.monotonic()
    flight = fly_one(*prepare(viewed_campaign, Policy.load(policy_path)), 0).flight
    assert time.monotonic() - began > 1.9
    assert flight is not None
    # It is the flight that nobody watches.
    unseen = fly_one(*prepare(campaign, Policy.load(policy_path)), 0).flight
    assert unseen is not None
    np.testing.assert_array_equal(flight.own, unseen.own)

    own = np.array(receive(ports[0], OWN))[5::6]  # 60 a second, of which every sixth ends a period
    assert len(own) == 20 and (own[:, 0] == 24).all()
    longitude, latitude, altitude = own[:, 1:4].T
    np.testing.assert_allclose(altitude, flight.altitude[1:], atol=1e-6)
    places = geocentric(latitude, longitude, 2500.0)
    moved = np.hypot(*(np.diff(field[1:]) for field in flight.own[:2]))
    np.testing.assert_allclose(np.linalg.norm(np.diff(places, axis=0), axis=1), moved, atol=1e-3)
    turned = (
        np.remainder(own[:, 7] + flight.own.heading[1:] - math.pi / 2.0 + math.pi, 2.0 * math.pi)
        - math.pi
    )
    np.testing.assert_allclose(turned, 0.0, atol=0.01)  # no wind: the nose is where the track leads

    messages = receive(ports[1], OTHER)
    assert len(messages) == 20
    assert {(message[0], message[1], message[2], message[3]) for message in messages} == {
        (0x46474653, 0x10001, 7, OTHER.size)
    }
    assert messages[0][6].rstrip(b"\0") == b"INTR1"
    intruder_places = np.array([message[10:13] for message in messages])
    for second, number in ((1, 9), (2, 19)):
        apart = math.hypot(
            *(flight.own[axis][10 * second] - flight.intruders[axis][second, 0] for axis in (0, 1))
        )
        assert np.linalg.norm(places[number] - intruder_places[number]) == pytest.approx(
            apart, abs=0.5
        )
    # Ahead along its nose goes the intruder, and its belly looks at the Earth.
    attitude, speed = (
        Rotation.from_rotvec([message[13:16] for message in messages]),
        messages[0][16],
    )
    ahead = attitude.apply([speed * 0.1, 0.0, 0.0])
    np.testing.assert_allclose(np.diff(intruder_places, axis=0), ahead[:-1], atol=2e-3)
    down = attitude.apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(
        down, -intruder_places / np.linalg.norm(intruder_places, axis=1)[:, None], atol=1e-3
    )


def test_flightgear_is_sent_what_the_ros_simulator_flies(ports: Ports) -> None:
    encounter = encounters_of_seed(scenario("circle", PAPER), 0, 0, 1)
    flight = EncounterFlight(encounter, PAPER, C208_PUBLISHED, "c208", viewer(ports, paced=False))
    flight.step()
    assert len(receive(ports[0], OWN)) == 6
    assert len(receive(ports[1], OTHER)) == len(flight.names)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["localhost"], "flightgear is 'localhost'; expected HOST:PORT"),
        (["localhost:65535"], "flightgear is 'localhost:65535'; expected HOST:PORT"),
        (["no host:5550"], "host cannot be resolved"),
        (
            ["localhost:5550", "--vehicle", "point_mass"],
            "vehicle is point_mass; expected c208_ex or c208",
        ),
        (["localhost:5550", "--workers", "2"], "expected no --scheduler, and no --workers but 1"),
    ],
)
def test_what_cannot_be_shown_is_refused_before_the_flight(
    arguments: list[str], says: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=says):
        main(["--flights", "1", "--out", str(tmp_path / "run"), "--flightgear", *arguments])
    assert not (tmp_path / "run").exists()


def test_the_table_names_every_rate_and_error_of_a_summary() -> None:
    table = {
        "outcome": np.array(["reached", "reached", "violation"], dtype=object),
        "plan_status": np.array(["safe", "safe", "none"], dtype=object),
        "verdict": np.array(["resolvable"] * 3, dtype=object),
        "reason": np.array([""] * 3, dtype=object),
        "min_separation_m": np.array([1_200.0, 1_100.0, 900.0]),
        "whole_min_separation_m": np.array([1_200.0, 1_100.0, np.nan]),
        "separation_loss_m": np.array([-3.0, 4.0, np.nan]),
        "plan_loss": np.array(["", "", ""], dtype=object),
        **{name: np.array([1.0, 2.0, np.nan]) for name in ERRORS},
    }
    summary = summarise(table, 0.95)
    rates = rate_rows(summary)
    assert [row[1:] for row in rates if row[0] == "losses of separation"] == [
        ("33.33 %", "0.84 % to 90.57 %", "1 of 3")
    ]
    shares = [
        name for name, value in summary.items() if isinstance(value, dict) and "total" in value
    ]
    assert len(rates) == len(shares) + 4 and ("its median", "1100.0 m", "", "") in rates
    errors = error_rows(summary)
    assert len(errors) == len(summary["errors"])
    assert ("arrival", "1.5 s", "1.95 s", "2 s") in errors


def test_the_figure_of_errors_begins_at_a_loss_and_ends_below_one_flight() -> None:
    loss = np.array([-20.0, -1.0, 5.0, 50.0])
    table = {"plan_status": np.full(4, "safe"), "separation_loss_m": loss}
    errors = ("path_definition_max_m", "position_error_max_m", "total_error_max_m")
    axes = distributions({**table, **dict.fromkeys(errors, np.full(4, np.nan))}).axes[0]
    (line,) = axes.get_lines()
    x, y = np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float)
    assert axes.get_xlim()[0] > 0.0 and axes.get_ylim()[0] < 25.0
    # Two of four flights lost separation, one of them more than 5 m.
    assert y[x <= 1.0][-1] == 50.0 and y[(x >= 5.0) & (x < 50.0)][-1] == 25.0


@pytest.mark.slow
def test_a_flight_in_closed_loop_is_judged_against_areas() -> None:
    flying = campaign("mode=closed", "vehicle=point_mass", "condition.name=wind", "areas=2")
    for number in range(3):
        record, row = fly(flying, number)
        assert record.scene.areas and row["areas"] == len(record.scene.areas)
        assert (row["outcome"] == "breach") == (row["duration_s"] == row["area_breach_s"])


# In space: plans that climb and descend, among intruders at levels of their own.


def climbing_campaign(*overrides: str) -> Campaign:
    usual = "aircraft=c208", "allow_outside_domain=true", "changes.own_speed=[65,80]"
    return campaign(*usual, *overrides)


@pytest.mark.parametrize(("below", "safe"), [(0.1, True), (0.01, False)])
def test_a_plan_is_not_safe_that_is_too_fast_with_its_climb(below: float, safe: bool) -> None:
    """It keeps its speed over the horizon: with a climb of 2.5 m/s 99.97 m/s are the most."""
    options = replace(climbing_campaign("planner.maneuvers=vertical").options, extend_route=True)
    own: VehicleState[Ground] = VehicleState(0.0, 0.0, 0.0, options.limits.speed_max - below)
    intruder = Intruder(
        VehicleState(12_000.0, 0.0, math.pi, 70.0), altitude=Altitude(2_000.0, REFERENCE, 0.0)
    )
    route = Straight(5_000.0 * np.arange(1, 10), np.zeros(9))
    made = plan_in_space(own, [intruder], route, 2_000.0, NO_WIND, Policy.load(), options)
    assert made.profile is not None and made.plans.candidates.last[0] >= 0
    assert bool(made.plans.candidates.safe[0]) == safe


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", ["c208_ex", "point_mass", "surrogate"])
def test_a_climb_along_the_route_passes_a_head_on_intruder(vehicle: str) -> None:
    vertical = "planner.maneuvers=vertical", "planner.vertical_margin_m=3"
    far = "scenario=head_on", "changes.radius=[8000,9000]"  # time enough to climb
    flying = climbing_campaign(f"vehicle={vehicle}", *far, *vertical)
    record, row = fly(flying, 0)
    assert row["plan_status"] == "safe" and row["plan_source"] == "vertical"
    assert row["outcome"] == "reached" and row["verdict"] == "resolvable"
    # It stays on its route, and is above or below where the other one passes.
    assert row["cross_track_max_m"] < 1.0
    assert record.flight is not None
    apart = np.abs(record.flight.altitude - 2_500.0)
    assert row["altitude_deviation_m"] == apart.max() > flying.options.vertical.separation
    assert row["plan_climbed_m"] == pytest.approx(2.0 * apart.max(), abs=5.0)
    assert apart[-1] < 1.0
    assert row["min_separation_m"] >= 1_000.0
    # At the corners of its profile it is rounded by 1.56 m.
    assert row["altitude_error_max_m"] < (1.57 if vehicle == "surrogate" else 2.5)


@pytest.mark.slow
def test_plans_in_space_keep_both_separations_from_intruders_that_climb() -> None:
    levels = "above_m=[-200,200]", "climb_mps=[-5,5]"
    overrides = "planner.maneuvers=both", "planner.vertical_margin_m=40", "planner.margin=100"
    flying = climbing_campaign(*overrides, *levels, "condition.name=moderate")
    climbed = 0
    for number in range(6):
        record, row = fly(flying, number)
        assert row["outcome"] == "reached" and row["plan_status"] == "safe"
        climbed += row["plan_climbed_m"] > 0.0
        flight, levels = record.flight, record.scene.levels
        assert flight is not None and levels is not None
        # Second by second, without the program's own distances.
        own = take(flight.own, slice(None, None, SUBSTEPS))
        away = np.hypot(own.x[:, None] - flight.intruders.x, own.y[:, None] - flight.intruders.y)
        height = levels.start.altitude + levels.start.climb * np.arange(own.x.size)[:, None]
        above = np.abs(height - flight.altitude[::SUBSTEPS, None])
        mask = record.scene.encounter.mask[0]
        lost = (away < PAPER.separation) & (above < flying.options.vertical.separation)
        assert not lost[:, mask].any()
    assert climbed


def watched_campaign(vehicle: str, *overrides: str) -> Campaign:
    """Return an encounter that begins with a backup that descends, levels off after half a minute,
    and ends with a plan.
    """
    vertical = "planner.maneuvers=vertical", "planner.vertical_margin_m=30", "planner.margin=215"
    levels = "above_m=[-275,275]", "climb_mps=[-5,5]"
    usual = "mode=assured", "scenario=multi", "seed=1", "changes.own_speed=[58,87]"
    flying = climbing_campaign(f"vehicle={vehicle}", *usual, *vertical, *levels, *overrides)
    return flying._replace(aircraft=flying.aircraft._replace(t_max=60.0))


def check_altitudes(flying: Campaign, record: FlightRecord, row: dict[str, Any]) -> None:
    """Check that a flight has flown the altitudes of its backups and its plan."""
    flight, pilot, vertical = record.flight, record.pilot, flying.options.vertical
    assert flight is not None and isinstance(pilot, Assured)
    assert row["outcome"] != "violation"
    (*backups, plan), time = pilot.held, PERIOD * np.arange(flight.altitude.size)
    assert all(held.backup for held in backups) and not plan.backup
    levels_at = row["climbing_backup_s"]
    assert [held.since for held in backups] == list(range(row["backup_s"])) and levels_at > 20.0
    assert row["backup_s"] == plan.since
    # It goes down at the greatest rate, and is level then.
    for held in backups:
        climb = -vertical.descent_max if held.since < levels_at else 0.0
        assert held.profile.climbs[-2 if climb else -1] == pytest.approx(climb)
    # A backup goes on from the profile before, round its corners.
    assert backups[0].profile.at(np.array(0.0)) == pytest.approx(flight.altitude[0], abs=1e-6)
    for before, after in itertools.pairwise(backups):
        height = height_flown(before.profile, vertical.acceleration, np.array(after.since))
        assert after.profile.at(np.array(after.since)) == pytest.approx(height.altitude, abs=1e-6)
    begins = [round(held.since / PERIOD) for held in pilot.held]
    assert plan.profile.at(time[begins[-1]]) == pytest.approx(flight.altitude[begins[-1]], abs=1e-6)
    for held, first, last in zip(pilot.held, begins, [*begins[1:], time.size - 1], strict=True):
        off = np.abs(held.profile.at(time) - flight.altitude)[first : last + 1].max()
        assert off <= row["altitude_error_max_m"] < flying.options.vertical_margin
        assert not held.backup or off <= row["backup_altitude_error_max_m"]
    descended = flight.altitude[0] - flight.altitude[round(levels_at / PERIOD)]
    assert descended == pytest.approx(vertical.descent_max * (levels_at - 3.0), rel=0.2)


@pytest.mark.slow
def test_under_the_monitor_altitudes_are_those_of_backup_and_plan() -> None:
    flying = watched_campaign("surrogate")
    record, row = fly(flying, 1)
    check_altitudes(flying, record, row)
    # The surrogate leaves the lines only at their corners.
    vertical = flying.options.vertical
    change = vertical.climb_max + vertical.descent_max
    assert row["altitude_error_max_m"] <= corner_error(change, vertical.acceleration)


@pytest.mark.slow
def test_the_cessna_flies_a_backup_that_descends_in_gusts() -> None:
    flying = watched_campaign("c208_ex", "condition.name=moderate")
    check_altitudes(flying, *fly(flying, 1))


def test_under_the_monitor_plans_in_the_plane_hold_their_altitude() -> None:
    flying = climbing_campaign("vehicle=surrogate", "mode=assured", "scenario=head_on")
    flying = flying._replace(aircraft=flying.aircraft._replace(t_max=20.0))
    record, row = fly(flying, 0)
    assert record.flight is not None and record.pilot is not None
    assert set(record.flight.altitude) == {2500.0} and not record.pilot.held
    assert "climbing_backup_s" not in row and math.isnan(row["altitude_error_max_m"])


@given(
    st.lists(st.floats(-300.0, 300.0), min_size=3, max_size=3),
    st.floats(-200.0, 200.0),
    st.floats(-10.0, 10.0),
)
def test_heights_of_a_period_are_the_least_of_its_moments(
    own: list[float], start: float, climb: float
) -> None:
    flatness = 1_000.0 / 137.2
    levels = Levels(Height(np.array([[start]]), np.array([[climb]])), np.array([[flatness]]))
    time = np.array([0.0, PERIOD, 2.0 * PERIOD])
    heights = levels.heights(np.array(own), time)[:, 0]
    for period in range(2):
        moments = np.linspace(time[period], time[period + 1], 1_001)
        above = start + climb * moments - np.interp(moments, time, own)
        assert heights[period] == pytest.approx(flatness * np.abs(above).min(), abs=5.0)
        assert heights[period] <= flatness * np.abs(above).min() + 1e-9


@pytest.mark.slow
def test_a_loss_is_one_of_both_separations() -> None:
    over = climbing_campaign("vehicle=surrogate", "scenario=head_on", "planner.maneuvers=both")
    level = replace(over.options, maneuvers=Maneuvers.HORIZONTAL)
    outcomes = []
    for above in (130.0, 140.0):
        flying = over._replace(levels=LevelRanges((above, above), (0.0, 0.0)))
        scene = scene_of(flying, 0)
        nobody = scene.encounter._replace(mask=np.zeros_like(scene.encounter.mask))
        alone = flying._replace(source=nobody, options=level)
        straight, _ = fly(alone, 0)
        assert straight.legs is not None and scene.levels is not None
        vehicle = begin("surrogate", scene.own, scene.drawn, flying.options.limits)
        traffic = Traffic(scene.encounter, NO_WIND, levels=scene.levels)
        pilot = Follower(Track(straight.legs), lookahead_of("surrogate"))
        steered = vehicle, pilot, Navigation(0.0, 0, 0), traffic, (1e6, 0.0)
        flight = follow(*steered, flying.aircraft.rules(), 200)
        outcomes.append(bool(flight.separation.min() < flying.aircraft.separation))
    assert outcomes == [True, False]


def test_an_intruder_is_drawn_where_it_is_met() -> None:
    flying = climbing_campaign(
        "planner.maneuvers=both", "above_m=[50,50]", "climb_mps=[4,4]", "scenario=head_on"
    )
    climbs = set()
    for number in range(8):
        scene = scene_of(flying, number)
        assert scene.levels is not None
        start, intruders = scene.levels.start, take(scene.encounter.intruders, (0, slice(None)))
        own = take(scene.encounter.own, 0)
        closest = straight_cpa(own, intruders, np).time
        met = start.altitude[0] + start.climb[0] * closest
        np.testing.assert_allclose(met, 2_550.0, atol=1e-6)
        climbs |= set(start.climb[0].tolist())
    assert climbs == {0.0, 4.0}


@pytest.mark.parametrize(
    ("overrides", "says"),
    [
        (["planner.maneuvers=both"], r'maneuvers is "both", expected "horizontal"'),
        (["planner.maneuvers=up"], "planner.maneuvers"),
        (
            ["aircraft=c208", "mode=closed", "planner.maneuvers=both"],
            "planner.maneuvers is 'both'; expected horizontal in mode closed",
        ),
        (["above_m=[0,100]"], r"above_m is \[0, 100\]; expected \[0, 0\] with planner.maneuvers"),
        (
            ["aircraft=c208", "planner.maneuvers=both", "climb_mps=[5,-5]"],
            r"climb_mps is \[5, -5\]; expected \[low, high\] within -50 to 50",
        ),
        (
            [
                "aircraft=c208",
                "allow_outside_domain=true",
                "planner.maneuvers=both",
                "planner.floor_m=3000",
                "planner.ceiling_m=2000",
            ],
            "ceiling",
        ),
    ],
)
def test_climbs_that_cannot_be_are_refused(overrides: list[str], says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        campaign(*overrides)


def test_a_floor_above_the_flight_is_a_reason_not_to_fly() -> None:
    flying = climbing_campaign("planner.maneuvers=both", "planner.floor_m=2600")
    _, row = fly(flying, 0)
    assert row["outcome"] == "refused"
    assert "2500 m, expected the floor, 2600 m, or more" in row["reason"]


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["plan", "assured"])
def test_what_climbs_is_said_and_documented(mode: str) -> None:
    flying = climbing_campaign(f"mode={mode}", "vehicle=surrogate", "planner.maneuvers=both")
    rows = [fly(flying, number)[1] for number in range(2)]
    table = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    summary = summarise(table, 0.95)
    assert summary["plan_climbs_rate"]["total"] == 2
    text = (ROOT / "docs" / "reference" / "evaluation-files.md").read_text(encoding="utf-8")
    assert [name for name in (*table, *summary) if f"`{name}`" not in text] == []
    assert "altitude, m" in str([axes.get_ylabel() for axes in sheet_of(flying, 0).axes])


def sheet_of(flying: Campaign, number: int) -> Figure:
    return sheet([("", fly(flying, number)[0])], flying.aircraft.rules())
