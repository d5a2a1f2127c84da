"""Flights of the true aircraft: judged by their definition, and marked with a reason where they fail."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.config.load import load
from envs.c208.air_mass import NO_WIND, over_ground
from envs.c208.conditions import Conditions
from envs.c208.guidance import Path as Track
from envs.c208.vehicle import FlightError
from envs.encounters import SCENARIOS
from envs.follower import PERIOD
from envs.kinematics import C208_PUBLISHED, VehicleState
from envs.outcome import RULES
from envs.starts import numbered
from envs.waypoints import Knots, Legs, at, legs
from eval.hifi import flights as hifi_flights
from eval.hifi.conditions import Drawn
from eval.hifi.config import HifiConfig
from eval.hifi.errors import against
from eval.hifi.flight import Flight, Guided, Traffic
from eval.hifi.flight import fly as follow
from eval.hifi.flights import Campaign, Flown, LoadedCampaign, flown
from eval.hifi.pilots import Follower
from eval.hifi.rows import row_of
from eval.hifi.run import campaign_of
from eval.hifi.vehicle import Navigation, begin, lookahead_of

KNOTS = Knots(
    np.array([0.0, 1400.0, 2700.0, 3900.0]),
    np.array([0.0, 0.0, 350.0, 1050.0]),
    np.array([0.0, 0.1, 0.4, 0.55]),
    np.array([70.0, 70.0, 69.0, 71.0]),
    np.array([0.0, 20.0, 40.0, 60.0]),
)
PLAN = legs(KNOTS)


POLICY: list[Path] = []


@pytest.fixture(autouse=True, scope="module")
def _hand_made(policy_path: Path) -> None:
    """Fly a policy that does not change with the one that ships."""
    POLICY[:] = [policy_path]


def campaign(*overrides: str) -> Campaign:
    return campaign_of(load(HifiConfig, None, [f"policy={POLICY[0]}", *overrides]))[0]


def fly(flying: Campaign, number: int) -> tuple[Flown, dict[str, Any]]:
    one = flown(LoadedCampaign(flying), number)
    return one, row_of(flying, number, one)


def along(plan: Legs, time: np.ndarray) -> VehicleState:
    return at(Legs(*(np.broadcast_to(field, (time.size, *field.shape)) for field in plan)), time)


def flight(own: VehicleState, late: np.ndarray) -> Flight:
    nothing = VehicleState(*(np.zeros((1, 1)) for _ in range(4)))
    return Flight(own, np.full(late.size, 2500.0), late, nothing, np.zeros(0), np.zeros(late.size), None)


@settings(max_examples=15)
@given(st.floats(-3.0, 3.0), st.floats(-30.0, 30.0), st.tuples(st.floats(-15.0, 15.0), st.floats(-15.0, 15.0)))
def test_delay_and_offset_are_kept_apart(delay: float, left: float, wind: tuple[float, float]) -> None:
    clock = PERIOD * np.arange(50, 550)
    place = over_ground(along(PLAN, clock - delay), wind, clock - delay)
    moved = place._replace(x=place.x - left * np.sin(place.heading), y=place.y + left * np.cos(place.heading))
    # Errors are taken from time 0 on: the first five seconds are filled with the plan itself.
    first = over_ground(along(PLAN, PERIOD * np.arange(50)), wind, PERIOD * np.arange(50))
    own = VehicleState(*(np.concatenate(pair) for pair in zip(first, moved, strict=True)))
    found = against(flight(own, np.concatenate([np.zeros(50), np.full(500, delay)])), PLAN, wind)
    np.testing.assert_allclose(found.late[50:], delay, atol=1e-4)
    np.testing.assert_allclose(found.cross_track[50:], left, atol=1e-3)
    np.testing.assert_allclose(found.position[:50], 0.0, atol=1e-6)
    # At 69 to 71 m/s a delay is that many metres; turns shorten the chord by little.
    expected = np.hypot(70.0 * delay, left)
    np.testing.assert_allclose(found.position[50:], expected, rtol=0.6, atol=0.5)


def test_a_flight_along_the_plan_has_no_error() -> None:
    clock = PERIOD * np.arange(600)
    found = against(flight(along(PLAN, clock), np.zeros(600)), PLAN, NO_WIND, along(PLAN, np.arange(60.0)))
    for field in found:
        np.testing.assert_allclose(field, 0.0, atol=1e-6)


@pytest.mark.parametrize(("condition", "number"), [("calm", 0), ("mixed", 1)])
def test_no_more_separation_is_lost_than_the_aircraft_is_off_its_plan(condition: str, number: int) -> None:
    one, row = fly(campaign(f"condition.name={condition}"), number)
    assert row["plan_status"] == "safe"
    assert one.flight is not None
    assert one.errors is not None
    assert row["separation_loss_m"] <= row["position_error_max_m"] + 0.05
    assert row["cross_track_max_m"] <= row["position_error_max_m"] + 0.01
    if row["plan_source"] == "policy":
        assert row["total_error_max_m"] <= row["path_definition_max_m"] + row["position_error_max_m"] + 1e-6
    assert row["altitude_error_max_m"] < 100.0


@pytest.mark.parametrize(("gain", "top", "beyond"), [(0.375, 99.6, True), (0.21, 89.6, False)])
def test_plans_beyond_the_aircrafts_power_are_flown_late(gain: float, top: float, beyond: bool) -> None:
    time = 20.0 * np.arange(8)
    speed = np.minimum(80.0 + gain * time, top)
    ramp = (top - 80.0) / gain
    x = np.where(time < ramp, 80.0 * time + 0.5 * gain * time**2, top * time - 0.5 * gain * ramp**2)
    plan = legs(Knots(x, 0.0 * x, 0.0 * x, speed, time))
    rough = Drawn(Conditions(turbulence="moderate", seed=2), 2500.0, NO_WIND, 0.0)
    vehicle = begin("c208_ex", VehicleState(0.0, 0.0, 0.0, 80.0), rough, C208_PUBLISHED)
    nobody = Traffic(numbered(SCENARIOS["circle"], 0, 0, 1), NO_WIND)
    guided = Guided(vehicle, Follower(Track(plan), lookahead_of("c208_ex")), Navigation(0.0, 0, 0))
    found = against(follow(guided, nobody, (1e6, 0.0), RULES, 140), plan, NO_WIND)
    assert bool(found.position.max() > 60.0) is beyond
    assert np.abs(found.cross_track).max() < 5.0


def judged(row: dict[str, Any]) -> None:
    """Hold a verdict against its definition."""
    assert row["outcome"] in ("reached", "violation", "timeout")
    assert (row["min_separation_m"] < 1_000.0) == (row["outcome"] == "violation")
    if row["outcome"] == "reached":
        assert row["goal_distance_m"] <= 500.0
    assert (row["reason"] == "") == (row["outcome"] == "reached")


def test_a_flight_in_closed_loop_ends_where_it_is_decided() -> None:
    for number in range(3):
        one, row = fly(campaign("mode=closed", "condition.name=wind"), number)
        judged(row)
        assert one.flight is not None
        assert math.ceil(row["duration_s"]) == one.flight.separation.size
        assert row["plan_status"] == "none"


def test_the_assured_loop_plans_anew_for_an_intruder_that_turns() -> None:
    turning = ("scenario=maneuvering", "condition.name=wind", "planner.margin=60", "rules.t_max=100")
    rows = [fly(campaign("mode=assured", *turning), number)[1] for number in (0, 2)]
    for row in rows:
        judged(row)
        assert row["taken_up"] <= row["replans"]
    assert any(row["taken_up"] for row in rows)


class _Lost:
    """Flies straight east for two seconds, then is lost."""

    altitude = 2500.0

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
def test_an_aircraft_that_is_lost_is_a_failed_flight(mode: str, nan: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hifi_flights, "begin", lambda _, own, *rest: _Lost(own, nan))
    _, row = fly(campaign(f"mode={mode}"), 1)
    assert row["outcome"] == "failed"
    assert ("not finite at 2." if nan else "120 m above the sea") in row["reason"]
    assert math.isnan(row["position_error_max_m"])


def test_a_start_that_the_aircraft_cannot_fly_is_refused() -> None:
    flying = campaign("changes.own_speed=[50,50]", "condition.altitude_m=[6500,6500]", "mode=closed")
    one, row = fly(flying, 0)
    assert one.flight is None
    assert row["outcome"] == "refused"
    assert "the flight cannot begin: no equilibrium" in row["reason"]
    _, row = fly(flying._replace(mode="plan"), 0)
    assert row["outcome"] == "refused"
    assert "the plan asks for air speeds of" in row["reason"]


def test_a_plan_that_is_not_safe_is_no_success() -> None:
    flying = campaign("scenario=circle", "changes.min_initial_separation=0", "changes.radius=[1100,1200]")
    rows = [fly(flying._replace(aircraft="point_mass"), number)[1] for number in range(2)]
    unresolved = [row for row in rows if row["plan_status"] == "unresolved"]
    assert unresolved
    assert all(row["outcome"] != "reached" for row in unresolved)
