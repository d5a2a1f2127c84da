"""Plans in a wind: what is called SAFE keeps its limits in the air and its separation over the
ground, whatever the wind is within its uncertainty.
"""

import cmath
import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from agents.check import RefusedError, accept
from agents.planner import plan
from agents.planner.answer import Kind, Plan, RequestError, Status
from agents.planner.planner import plan_many
from agents.planner.recheck import recheck
from agents.planner.request.options import Options
from agents.planner.request.request import Intruder, check_request, in_wind
from agents.policy.inference import Policy
from envs.aircraft import new_aircraft
from envs.kinematics import Limits, VehicleState
from envs.trees import map_leaves
from envs.waypoints import RoutePoint, at, legs, plan_states
from envs.wind import Wind, over_ground, through_air

UAS = new_aircraft(Limits(18.0, 36.0, -0.5, 0.5, math.radians(10.0)), 610.0)
POLICY = Policy.load().for_aircraft(UAS, outside="allow")
OPTIONS = Options.for_aircraft(UAS, deadline_s=math.inf, exhaustive=False)
ROUTE = [RoutePoint(n, 3_000.0 * n, 0.0) for n in range(1, 12)]
TURN = 0.02  # rad/s, of the intruder that turns


def scene(seed: int, wind: Wind) -> tuple[VehicleState, list[Intruder]]:
    """Return an ownship and two intruders near its way over the ground, one of which turns."""
    rng = np.random.default_rng(seed)
    own = VehicleState(0.0, 0.0, float(rng.uniform(-0.3, 0.3)), 28.0)
    reports = []
    for turn in (0.0, TURN):
        meet, course = float(rng.uniform(60.0, 150.0)), float(rng.uniform(-math.pi, math.pi))
        speed = float(rng.uniform(20.0, 35.0))
        place = 28.0 * meet - speed * meet * cmath.exp(1j * course)
        intruder = VehicleState(place.real, place.imag + 100.0, course, speed)
        reports.append(Intruder(over_ground(intruder, wind, 0.0), 0.8, turn, 12.0, 10.0, 0.3))
    return over_ground(own, wind, 0.0), reports


def place_over_ground(answer: Plan, own: VehicleState, wind: Wind, times: Any) -> VehicleState:
    """Return where the plan is over the ground."""
    curves = legs(plan_states(own, answer.waypoints, wind=wind))
    shape = np.shape(times)
    repeated_curves = map_leaves(
        lambda field: np.broadcast_to(field, (*shape, *field.shape)), curves
    )
    return at(repeated_curves, times, wind)


def velocity(state: VehicleState) -> Any:
    return state.speed * np.exp(1j * state.heading)


def place_of(report: Intruder, wind: Wind, times: Any) -> Any:
    """Return where an intruder is over the ground, x + iy: small steps of its turn through the
    air.
    """
    step = 0.01
    count = round((report.age + float(times[-1])) / step) + 2
    clock = np.arange(count) * step
    turned = report.turn_rate * np.minimum(clock + 0.5 * step, report.turn_time)
    blows = complex(wind.east, wind.north)
    air = velocity(report.state) - blows
    moved = np.cumsum(air * np.exp(1j * turned) + blows) * step
    path = complex(report.state.x, report.state.y) + np.concatenate([[0.0], moved])
    return np.interp(times + report.age, np.arange(count + 1) * step, path)


WINDS = [
    Wind(10.0, 0.0),
    Wind(-7.0, 7.0),
    Wind(0.0, -12.0, 0.5),
    Wind(-6.0, 3.0, 1.0),
    Wind(4.0, 11.0, 0.2),
]


@pytest.mark.parametrize("number", range(len(WINDS)))
def test_a_safe_plan_keeps_limits_in_the_air_and_separation_over_the_ground(number: int) -> None:
    wind = WINDS[number]
    safe = 0
    for seed in range(4):
        own, reports = scene(10 * number + seed, wind)
        answer = plan(own, reports, ROUTE, POLICY, OPTIONS, wind=wind)
        if not answer.safe:
            continue
        safe += 1
        accept(json.loads(answer.certificate or b""))
        last = answer.waypoints[-1]
        point = next(point for point in ROUTE if point.index == last.index)
        assert math.hypot(last.x - point.x, last.y - point.y) < 1e-3
        times = np.arange(0.0, last.time, 0.05)
        path = place_over_ground(answer, own, wind, times)
        ground = path.x + 1j * path.y
        np.testing.assert_allclose(np.gradient(ground, 0.05)[1:-1], velocity(path)[1:-1], atol=0.1)
        rng = np.random.default_rng(seed)
        # Winds on the edge of what is within its uncertainty.
        error = OPTIONS.requirement.sigmas * wind.std
        for wind_error in error * np.exp(1j * rng.uniform(-math.pi, math.pi, 4)):
            blows = Wind(wind.east + wind_error.real, wind.north + wind_error.imag)
            _keeps_limits(path, blows)
            for report in reports:
                away = np.abs(place_of(report, blows, times) - ground)
                assert away.min() >= UAS.separation - 0.01
    assert safe >= 2


def _keeps_limits(path: VehicleState, wind: Wind) -> None:
    """Demand the vehicle's limits of a flight over the ground, ``[T]``, in the air of a wind."""
    air = velocity(path) - complex(wind.east, wind.north)
    speed = np.abs(air)
    limits = OPTIONS.limits
    assert speed.min() >= limits.speed_min - 1e-3 and speed.max() <= limits.speed_max + 1e-3
    turned = np.diff(np.unwrap(np.angle(air))) / 0.05
    assert np.abs(turned).max() <= limits.yaw_rate_max + 1e-4
    gained = np.diff(speed) / 0.05
    assert gained.min() >= limits.acceleration_min - 1e-3
    assert gained.max() <= limits.acceleration_max + 1e-3


def test_the_same_conflict_in_a_wind_is_solved_alike() -> None:
    """The goal drifts through the air and all else is the same: most plans are found in both."""
    calm, windy = 0, 0
    for seed in range(12):
        calm_plan = plan(*scene(seed, Wind()), ROUTE, POLICY, OPTIONS)
        wind = Wind(7.0 * math.cos(seed), 7.0 * math.sin(seed))
        blown = plan(*scene(seed, wind), ROUTE, POLICY, OPTIONS, wind=wind)
        calm += calm_plan.safe
        windy += calm_plan.safe and blown.safe
    assert calm >= 8
    assert windy >= calm - 1


def test_still_air_is_no_wind() -> None:
    own, reports = scene(1, Wind())
    without = plan(own, reports, ROUTE, POLICY, OPTIONS)
    calm_plan = plan(own, reports, ROUTE, POLICY, OPTIONS, wind=Wind())
    assert calm_plan.waypoints == without.waypoints
    assert calm_plan.min_separation == without.min_separation


def test_a_plan_is_the_same_among_others() -> None:
    winds = [Wind(9.0, -3.0), Wind(-4.0, 2.0)]
    requests = [check_request(*scene(5, wind), ROUTE, OPTIONS, wind=wind)[0] for wind in winds]
    batch = map_leaves(lambda *fields: np.concatenate(fields), *requests)
    together = plan_many(batch, POLICY, OPTIONS).candidates
    for row, request in enumerate(requests):
        alone = plan_many(request, POLICY, OPTIONS).candidates
        for state, states in zip(alone.plan_states, together.plan_states, strict=True):
            np.testing.assert_array_equal(state[0], states[row])


def test_the_certificate_of_another_wind_is_refused() -> None:
    wind = Wind(8.0, 4.0, 0.3)
    answer = plan(*scene(3, wind), ROUTE, POLICY, OPTIONS, wind=wind)
    assert answer.safe
    data = json.loads(answer.certificate or b"")
    for name, value in (("east", 8.1), ("north", -4.0), ("std", 5.0)):
        with pytest.raises(RefusedError):
            accept({**data, "wind": {**data["wind"], name: value}})


def test_the_checker_follows_what_goes_with_the_air() -> None:
    wind = Wind(6.0, -4.0, 0.3)
    balloon = over_ground(VehicleState(2_500.0, 100.0, 0.0, 0.0), wind, 0.0)
    own = over_ground(VehicleState(0.0, 0.0, 0.0, 28.0), wind, 0.0)
    for turn_time in (0.0, 20.0):
        report = Intruder(balloon, 0.4, TURN, turn_time)
        answer = plan(own, [report], ROUTE, POLICY, OPTIONS, wind=wind)
        assert answer.safe
        data = json.loads(answer.certificate or b"")
        accept(data)
        path = place_over_ground(answer, own, wind, 60.0)
        data["intruders"][0][:2] = [
            float(path.x) - 60.0 * wind.east,
            float(path.y) - 60.0 * wind.north,
        ]
        with pytest.raises(RefusedError, match="too close"):
            accept(data)


def test_a_late_plan_is_still_right_in_its_wind() -> None:
    wind = Wind(6.0, -5.0)
    own, reports = scene(2, wind)
    answer = plan(own, reports, ROUTE, POLICY, OPTIONS, wind=wind)
    assert answer.safe
    late = 1.5
    place = place_over_ground(answer, own, wind, np.array(late))
    late_own = VehicleState(*(float(field) for field in place))
    older = [replace(report, age=report.age + late) for report in reports]
    again = recheck(answer, late, late_own, older, ROUTE, OPTIONS, wind=wind)
    assert again.safe
    calm = recheck(answer, late, late_own, older, ROUTE, OPTIONS)
    assert calm.status is Status.UNRESOLVED


@pytest.mark.parametrize(
    ("wind", "sentence"),
    [
        (Wind(40.0, 0.0), r"wind is 40\.0 m/s, expected less than the 35\.9 m/s"),
        (
            Wind(30.0, 0.0, 4.0),
            r"or 38.0 m/s with its uncertainty, expected less than the 35.9 m/s",
        ),
        (Wind(math.nan, 0.0), r"wind\.east is nan"),
        (Wind(0.0, math.inf), r"wind\.north is inf"),
        (Wind(1.0, 1.0, -0.5), r"wind\.std is -0\.5"),
        (Wind(0.0, 0.0, 6.0), r"wind\.std is 6 m/s: 2 sigmas of that leave nothing"),
        (Wind("a", 0.0), r"wind\.east is 'a'"),
        ((1.0, 2.0), r"wind is tuple, expected a Wind"),
    ],
)
def test_a_bad_wind_is_refused_in_one_sentence(wind: Any, sentence: str) -> None:
    own = VehicleState(0.0, 0.0, 0.0, 28.0)
    with pytest.raises(RequestError, match=sentence):
        plan(own, [], ROUTE, POLICY, OPTIONS, wind=wind)


def test_an_airspeed_outside_the_envelope_is_refused_by_both_speeds() -> None:
    own = VehicleState(0.0, 0.0, 0.0, 40.0)
    assert plan(own, [], ROUTE, POLICY, OPTIONS, wind=Wind(10.0, 0.0)).safe
    with pytest.raises(RequestError, match=r"own\.speed is 40 m/s, 50 m/s through the air"):
        plan(own, [], ROUTE, POLICY, OPTIONS, wind=Wind(-10.0, 0.0))


def test_a_goal_that_the_wind_keeps_out_of_reach_is_said_to_be() -> None:
    wind = Wind(-30.0, 0.0)
    own = over_ground(VehicleState(0.0, 0.0, 0.0, 35.0), wind, 0.0)
    far = [RoutePoint(n, 9_000.0 * n, 0.0) for n in range(1, 4)]
    answer = plan(own, [], far, POLICY, OPTIONS, wind=wind)
    assert [reason.kind for reason in answer.reasons] == [Kind.GOAL_TOO_FAR]


def test_limits_of_plans_are_narrowed_by_the_uncertainty_only() -> None:
    assert in_wind(OPTIONS, Wind(10.0, 5.0)) == OPTIONS
    sure, unsure = OPTIONS.limits, in_wind(OPTIONS, Wind(10.0, 5.0, 0.5)).limits
    assert unsure.speed_min == sure.speed_min + 1.0
    assert unsure.yaw_rate_max < sure.yaw_rate_max


def test_a_turn_is_one_through_the_air() -> None:
    wind = Wind(10.0, 0.0)
    report = Intruder(VehicleState(0.0, 0.0, 0.0, 30.0), turn_rate=TURN, turn_time=50.0)
    own = VehicleState(-9_000.0, 9_000.0, 0.0, 28.0)
    request, _, _ = check_request(own, [report], ROUTE, OPTIONS, wind=wind)
    air = VehicleState(*(float(field[0, 0]) for field in request.traffic.state))
    assert air.speed == pytest.approx(20.0)
    assert through_air(report.state, wind, 0.0) == pytest.approx(air)
    assert request.traffic.turn_rate[0, 0] == TURN
