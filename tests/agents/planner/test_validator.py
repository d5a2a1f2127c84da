"""The validator finds every fault of the legs, the audit every fault of what is published; the
bound is a tight one.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.kernel import separation
from agents.kernel.traffic import Requirement, Traffic, predict, requirement_of
from agents.planner.answer import WAYPOINTS, Kind, Status
from agents.planner.judge.audit import audit
from agents.planner.judge.validator import CHECKS, validate
from agents.planner.planner import plan
from agents.planner.publish import publish
from agents.policy.inference import Policy
from envs.compiled import Entry
from envs.kinematics import C208_PUBLISHED, SURROGATE, VehicleState, advance
from envs.trees import map_leaves, take
from envs.waypoints import PlanStates, RoutePoint, Waypoint, at, legs
from tests.agents.scenes import PATIENT
from tests.support import random_states


def plans(count: int, seed: int) -> PlanStates:
    """Return gently flown plans ``[count, 11]``."""
    rng = np.random.default_rng(seed)
    state = random_states(rng, count, extent=3_000.0)
    limits = SURROGATE._replace(speed_min=52.0, speed_max=98.0)
    states = [state]
    for second in range(200):
        if second % 10 == 0:
            acceleration, yaw_rate = (
                rng.uniform(-0.3, 0.3, count),
                rng.uniform(-1.0, 1.0, count) * math.radians(2.0),
            )
        state = advance(state, acceleration, yaw_rate, 1.0, limits, np)
        if second % 20 == 19:
            states.append(state)
    fields = [np.stack(field, axis=-1) for field in zip(*states, strict=True)]
    return PlanStates(*fields, np.broadcast_to(20.0 * np.arange(11.0), fields[0].shape).copy())


def traffic(count: int, intruders: int, seed: int, *, turning: bool = False) -> Traffic:
    """Return intruders ``[count, intruders]`` around the plans."""
    rng = np.random.default_rng(seed)
    straight = Traffic.straight(random_states(rng, count, intruders, extent=8_000.0))
    if not turning:
        return straight
    shape = straight.mask.shape
    rate = rng.uniform(-1.0, 1.0, shape) * math.radians(3.0) * (rng.random(shape) < 0.7)
    return straight._replace(turn_rate=rate, turn_time=rng.uniform(0.0, 60.0, shape))


def sample_distances(plan_states: PlanStates, intruders: Traffic, step: float) -> np.ndarray:
    """Return the distances to the intruders at times ``step`` apart, m, ``[T, N, K]``."""
    curves, times = legs(plan_states), np.arange(0.0, plan_states.time[0, -1] + 1e-9, step)
    apart = []
    for block in np.array_split(times[:, None], 1 + times.size // 500):
        own, intruder_states = at(curves, block), predict(intruders, block[..., None])
        apart.append(
            np.hypot(intruder_states.x - own.x[..., None], intruder_states.y - own.y[..., None])
        )
    return np.concatenate(apart)


@pytest.mark.parametrize("turning", [False, True])
def test_the_separation_is_a_tight_lower_bound(turning: bool) -> None:
    plan_states, intruders = plans(50, 1), traffic(50, 3, 2, turning=turning)
    judged = validate(plan_states, intruders, Requirement(300.0), C208_PUBLISHED)
    truth = sample_distances(plan_states, intruders, 0.02).min(axis=(0, 2))
    # Samples 0.02 s apart miss a closest approach by at most 0.02 m wherever it is 100 m or more.
    assert np.all(judged.min_separation <= truth + 1e-6)
    assert np.all(judged.min_separation >= truth - 0.05)
    first = judged.wrong[:, CHECKS.index("separation")]
    np.testing.assert_array_equal(first, judged.clearance < 0.0)
    base = np.minimum(300.0, sample_distances(plan_states, intruders, 1e9)[0])
    assert np.all((truth < 299.9) <= (first | (base.min(axis=-1) < 300.0)))


@pytest.mark.parametrize("turning", [False, True])
@pytest.mark.parametrize("velocity_std", [0.0, 1.0])
def test_legs_far_from_an_intruder_are_left_out_without_a_trace(
    monkeypatch: pytest.MonkeyPatch, turning: bool, velocity_std: float
) -> None:
    plan_states, near, far = plans(30, 3), traffic(30, 20, 4, turning=turning), traffic(30, 20, 5)
    away = far.state._replace(x=4.0 * far.state.x, y=4.0 * far.state.y)
    reports = map_leaves(
        lambda *columns: np.concatenate(columns, axis=1), near, far._replace(state=away)
    )._replace(velocity_std=np.full((30, 40), velocity_std))
    if turning:  # the nearest is not always the one that is nearest to what is required
        own = np.random.default_rng(9).choice([np.nan, 100.0, 2_500.0], (30, 40))
        reports = reports._replace(separation=own)
    monkeypatch.setattr(Entry, "ready", False)  # which leaves legs out without a trace, too
    looked_at: list[float] = []
    near = separation.Separation.near

    def count_and_look(*arguments: Any, **more: Any) -> Any:
        judged = near(*arguments, **more)
        looked_at.append(judged.row.size / (plan_states.time[:, 1:].size * 40))
        return judged

    monkeypatch.setattr(separation.Separation, "near", count_and_look)
    judged = validate(plan_states, reports, Requirement(300.0, 20.0), C208_PUBLISHED)
    monkeypatch.setattr(separation, "_FEW", 40)
    every = validate(plan_states, reports, Requirement(300.0, 20.0), C208_PUBLISHED)
    for field, expected in zip(judged, every, strict=True):
        np.testing.assert_array_equal(field, expected)
    assert looked_at[0] < 0.5 and looked_at[1] == 1.0
    assert judged.wrong.any() and not judged.wrong.all(axis=0).any()


@pytest.mark.parametrize("duration", [20.0, 50.0])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_circle_keeps_its_radius_from_its_centre(duration: float, sign: float) -> None:
    rate, speed = math.radians(2.0), 60.0
    radius, turn = speed / rate, sign * rate * duration
    x, y = radius * math.sin(rate * duration), sign * radius * (1.0 - math.cos(rate * duration))
    plan = PlanStates(
        *np.array([[[0.0, x]], [[0.0, y]], [[0.0, turn]], [[speed, speed]], [[0.0, duration]]])
    )
    centre = Traffic.straight(
        VehicleState(*np.array([[[0.0]], [[sign * radius]], [[0.0]], [[0.0]]]))
    )
    judged = validate(plan, centre, Requirement(1_000.0), C208_PUBLISHED)
    # Each of an arc's 32 parts is judged on its chord, v w h^2 / 8 inside the circle, less as much
    # for its bend.
    sagitta = speed * rate * (duration / 320.0) ** 2 / 8.0
    assert radius - 2.0 * sagitta - 1e-6 <= judged.min_separation[0] <= radius + 1e-6
    assert judged.safe[0]


def test_the_first_violation_has_time_and_place() -> None:
    # Head-on at 80 + 80 m/s from 8 km: 1000 m are left after 43.75 s.
    times = 20.0 * np.arange(6.0)[None]
    plan_states = PlanStates(80.0 * times, times * 0.0, times * 0.0, times * 0.0 + 80.0, times)
    intruder = Traffic.straight(
        VehicleState(*(np.array([[value]]) for value in (8_000.0, 0.0, math.pi, 80.0)))
    )
    judged = validate(plan_states, intruder, Requirement(1_000.0), C208_PUBLISHED)
    row = CHECKS.index("separation")
    assert judged.time[0, row] == pytest.approx(43.75, abs=0.1)
    assert judged.x[0, row] == pytest.approx(3_500.0, abs=10.0)
    assert judged.intruder[0] == 0
    assert judged.leg[0, row] == 2
    assert judged.min_separation[0] == pytest.approx(0.0, abs=0.01)
    assert judged.time_of_min_separation[0] == pytest.approx(50.0, abs=0.1)


@pytest.mark.parametrize(("end", "safe"), [(16_380.0, True), (16_400.0, False)])
def test_plan_longer_than_its_rounding_is_bounded_for_is_not_safe(end: float, safe: bool) -> None:
    times = np.array([[0.0, 20.0, 40.0, end]])
    plan_states = PlanStates(80.0 * times, times * 0.0, times * 0.0, times * 0.0 + 80.0, times)
    judged = validate(plan_states, traffic(1, 0, 0), Requirement(1_000.0), C208_PUBLISHED)
    assert judged.safe[0] == safe
    assert judged.wrong[0, CHECKS.index("times")] != safe


def test_standing_still_is_not_safe() -> None:
    times = 20.0 * np.arange(3.0)[None]
    plan_states = PlanStates(*np.zeros((4, 1, 3)), times)
    judged = validate(
        plan_states, traffic(1, 0, 0), Requirement(1_000.0), C208_PUBLISHED._replace(speed_min=0.0)
    )
    assert [CHECKS[check] for check in np.flatnonzero(judged.wrong[0])] == ["speed"]


def spoilt(plan_states: PlanStates, name: str, change: Any) -> PlanStates:
    """Return the plans with one waypoint changed."""
    field = getattr(plan_states, name).copy()
    field[:, 5] = change(field[:, 5])
    return plan_states._replace(**{name: field})


@pytest.mark.parametrize(
    ("name", "change", "checks"),
    [
        ("x", lambda v: v * math.nan, {"not_finite"}),
        ("time", lambda v: v + math.inf, {"not_finite"}),
        ("time", lambda v: v - 20.0, {"times"}),
        ("time", lambda v: v - 25.0, {"times"}),
        ("speed", lambda v: v * 0.0 + 103.0, {"speed"}),
        ("speed", lambda v: v * 0.0 + 29.0, {"speed"}),
        ("x", lambda v: v + 900.0, {"acceleration", "turn_rate", "speed"}),
        ("time", lambda v: v - 6.0, {"acceleration", "speed", "turn_rate"}),
        ("heading", lambda v: v + 1.5, {"turn_rate"}),
        ("y", lambda v: v + 1e9, {"leg", "speed", "acceleration", "turn_rate"}),
    ],
)
def test_every_fault_is_found(name: str, change: Any, checks: set[str]) -> None:
    good, intruders = plans(40, 3), traffic(40, 0, 0)
    assert validate(good, intruders, Requirement(1_000.0), C208_PUBLISHED).safe.mean() > 0.8
    judged = validate(spoilt(good, name, change), intruders, Requirement(1_000.0), C208_PUBLISHED)
    found_wrong = np.zeros(40, dtype=bool)
    for check in checks:
        found_wrong |= judged.wrong[:, CHECKS.index(check)]
    assert found_wrong.all()
    assert not judged.safe.any()


@pytest.mark.parametrize(("speed", "sign"), [(100.0, 1.0), (31.0, -1.0), (100.6, 1.0)])
def test_rounding_does_not_add_up_beyond_a_limit(speed: float, sign: float) -> None:
    time = 20.0 * np.arange(11.0)[None]
    plan_states = PlanStates(speed * time, 0.0 * time, 0.0 * time, speed + 0.0 * time, time)
    curves = legs(plan_states)
    creeping = np.full_like(curves.acceleration, sign * 0.4e-6 / 2.0)  # 0.4 um/s an arc of 2 s
    gained = np.arange(curves.speed.size).reshape(curves.speed.shape) * sign * 0.4e-6
    intruders, check = traffic(1, 0, 0), CHECKS.index("speed")
    assert not validate(
        plan_states, intruders, Requirement(1_000.0), C208_PUBLISHED, curves=curves
    ).wrong[0, check]
    judged = validate(
        plan_states,
        intruders,
        Requirement(1_000.0),
        C208_PUBLISHED,
        curves=curves._replace(acceleration=creeping, speed=speed + gained),
    )
    assert judged.wrong[0, check] and judged.leg[0, check] == 0


def test_no_plans_are_no_trouble() -> None:
    judged = validate(
        PlanStates(*np.zeros((5, 0, 21))), traffic(0, 0, 0), Requirement(1_000.0), C208_PUBLISHED
    )
    assert judged.safe.shape == (0,)


def test_plans_are_judged_one_by_one() -> None:
    plan_states, intruders = plans(60, 5), traffic(60, 4, 6, turning=True)
    whole = validate(plan_states, intruders, Requirement(1_000.0, 5.0), C208_PUBLISHED)
    part = validate(
        PlanStates(*(field[20:30] for field in plan_states)),
        take(intruders, slice(20, 30)),
        Requirement(1_000.0, 5.0),
        C208_PUBLISHED,
    )
    np.testing.assert_array_equal(part.min_separation, whole.min_separation[20:30])
    np.testing.assert_array_equal(part.wrong, whole.wrong[20:30])


@pytest.mark.parametrize("margin", [0.1, 5.0, pytest.param(50.0, marks=pytest.mark.slow)])
def test_no_start_is_refused_by_its_own_margin(margin: float) -> None:
    # Every centimetre inside the margin: flying apart, side by side, and turning away.
    away = np.arange(1_000.0, 1_000.0 + margin + 0.005, 0.01)
    times = np.broadcast_to(20.0 * np.arange(6.0), (away.size, 6))
    zero = times * 0.0
    straight = PlanStates(80.0 * times, zero, zero, zero + 80.0, times)
    rate = -math.radians(1.0)
    radius = 80.0 / rate
    turning = PlanStates(
        radius * np.sin(rate * times),
        radius * (1.0 - np.cos(rate * times)),
        rate * times,
        zero + 80.0,
        times,
    )
    column = away[:, None]
    for plan_states, x, y, heading in (
        (straight, -column, column * 0.0, math.pi),
        (straight, column * 0.0, column, 0.0),
        (turning, column * 0.0, column + 0.001, 0.0),
        (turning, column * 0.0, column, 0.5),
    ):
        intruder = Traffic.straight(VehicleState(x, y, column * 0.0 + heading, column * 0.0 + 80.0))
        judged = validate(plan_states, intruder, Requirement(1_000.0, margin), C208_PUBLISHED)
        assert judged.safe.all(), away[~judged.safe][:5]


def test_absent_intruders_do_not_count() -> None:
    plan_states, intruders = plans(30, 7), traffic(30, 3, 8)
    none = intruders._replace(mask=np.zeros_like(intruders.mask))
    judged = validate(plan_states, none, Requirement(1_000.0), C208_PUBLISHED)
    assert np.all(np.isinf(judged.min_separation))
    assert not judged.wrong[:, CHECKS.index("separation")].any()


def test_uncertainty_enlarges_what_is_required() -> None:
    times = 20.0 * np.arange(6.0)[None]
    plan_states = PlanStates(80.0 * times, times * 0.0, times * 0.0, times * 0.0 + 80.0, times)
    abeam = Traffic.straight(
        VehicleState(*(np.array([[value]]) for value in (0.0, 1_300.0, 0.0, 80.0)))
    )
    sure = validate(plan_states, abeam, Requirement(1_000.0, 0.0), C208_PUBLISHED)
    assert sure.safe[0]
    assert sure.clearance[0] == pytest.approx(300.0, abs=0.1)
    # 2 sigmas of sqrt(30^2 + (2 t)^2) exceed 300 m from t = 73.5 s on.
    vague = abeam._replace(position_std=np.array([[30.0]]), velocity_std=np.array([[2.0]]))
    judged = validate(plan_states, vague, Requirement(1_000.0, 0.0), C208_PUBLISHED)
    assert not judged.safe[0]
    assert judged.time[0, CHECKS.index("separation")] == pytest.approx(73.5, abs=2.1)


@pytest.mark.parametrize("distance", [1_000.0, 1_000.01, 1_020.0, 1_049.99, 1_050.0, 1_500.0])
def test_a_start_inside_the_margin_must_only_not_come_closer(distance: float) -> None:
    intruder = Traffic.straight(
        VehicleState(*(np.array([[value]]) for value in (0.0, distance, 0.0, 80.0)))
    )
    need = requirement_of(intruder, VehicleState(*np.zeros((4, 1))), Requirement(1_000.0, 50.0))
    assert need[0, 0] == min(distance, 1_050.0)
    times = 20.0 * np.arange(6.0)[None]
    plan_states = PlanStates(80.0 * times, times * 0.0, times * 0.0, times * 0.0 + 80.0, times)
    assert validate(plan_states, intruder, Requirement(1_000.0, 50.0), C208_PUBLISHED).safe[0]


def test_the_slowest_turn_is_not_taken_for_a_straight_flight() -> None:
    time = 20.0 * np.arange(51)[None]
    zero, unit = np.zeros((1, 51)), np.ones((1, 1))
    straight = PlanStates(80.0 * time, zero, zero, zero + 80.0, time)
    # In 1000 s at 400 m/s and 1e-9 rad/s it comes 0.2 m to its right, and then it is abeam.
    state = VehicleState(-320_000.0 * unit, 1_000.05 * unit, 0.0 * unit, 400.0 * unit)
    turning = Traffic.straight(state)._replace(turn_rate=-1e-9 * unit, turn_time=1_000.0 * unit)
    assert validate(
        straight, Traffic.straight(state), Requirement(1_000.0), C208_PUBLISHED
    ).safe.all()
    judged = validate(straight, turning, Requirement(1_000.0), C208_PUBLISHED)
    assert judged.wrong[0, CHECKS.index("separation")]
    assert judged.min_separation == pytest.approx([999.85], abs=0.006)


# Waypoints that are published wrongly are found out, each fault under its name and at its place.

ROUTE = [RoutePoint(100 + i, 12_000.0 + 5_000.0 * i, 300.0 * i) for i in range(6)]
OWN = VehicleState(0.0, 0.0, 0.0, 80.0)


def make_waypoints() -> list[Waypoint]:
    """Return waypoints with nothing wrong."""
    fresh = [
        Waypoint(i, 1_600.0 * (i + 1), 0.0, 0.0, 80.0, 20.0 * (i + 1)) for i in range(WAYPOINTS - 1)
    ]
    return [*fresh, Waypoint(105, ROUTE[5].x, ROUTE[5].y, 0.0, 80.0, 470.0)]


def test_nothing_is_wrong_with_what_is_right() -> None:
    assert audit(make_waypoints(), ROUTE, count=WAYPOINTS) == []
    beyond = replace(make_waypoints()[-1], index=50, x=ROUTE[5].x + 5_000.0, y=ROUTE[5].y + 300.0)
    assert audit([*make_waypoints()[:-1], beyond], ROUTE, count=WAYPOINTS, extended=True) == []


@given(st.integers(0, WAYPOINTS - 2), st.integers(0, WAYPOINTS - 2))
def test_a_repeated_index_is_found(a: int, b: int) -> None:
    wrong = make_waypoints()
    wrong[a] = replace(wrong[a], index=wrong[b].index)
    findings = audit(wrong, ROUTE, count=WAYPOINTS)
    if a == b:
        assert findings == []
    else:
        assert [(finding.kind, finding.field) for finding in findings] == [
            (Kind.INDICES, f"waypoints[{number}]") for number in sorted((a, b))
        ]


@given(st.integers(0, WAYPOINTS - 2), st.integers(0, 5))
def test_an_index_of_the_route_is_found(number: int, route_number: int) -> None:
    wrong = make_waypoints()
    wrong[number] = replace(wrong[number], index=ROUTE[route_number].index)
    assert (Kind.INDICES, f"waypoints[{number}]") in {
        (finding.kind, finding.field) for finding in audit(wrong, ROUTE, count=WAYPOINTS)
    }


@given(st.sampled_from(["x", "y"]), st.floats(0.01, 1e6), st.booleans())
def test_a_last_waypoint_beside_its_point_is_found(axis: str, off: float, extended: bool) -> None:
    wrong = make_waypoints()
    wrong[-1] = replace(wrong[-1], **{axis: getattr(wrong[-1], axis) + off})
    (finding,) = audit(wrong, ROUTE, count=WAYPOINTS, extended=extended)
    assert finding.kind is Kind.OFF_ROUTE
    assert finding.field == f"waypoints[{WAYPOINTS - 1}]"


def test_a_last_waypoint_of_no_point_is_found() -> None:
    wrong = [*make_waypoints()[:-1], replace(make_waypoints()[-1], index=77)]
    assert [finding.kind for finding in audit(wrong, ROUTE, count=WAYPOINTS)] == [Kind.OFF_ROUTE]
    # It stands at the route's end: there the extension begins.
    assert audit(wrong, ROUTE, count=WAYPOINTS, extended=True) == []
    wrong[-1] = replace(wrong[-1], x=ROUTE[5].x - 5_000.0, y=ROUTE[5].y - 300.0)
    assert [finding.kind for finding in audit(wrong, ROUTE, count=WAYPOINTS, extended=True)] == [
        Kind.OFF_ROUTE
    ]


@given(
    st.sampled_from(["x", "y", "heading", "speed", "time"]),
    st.integers(0, 19),
    st.sampled_from([math.nan, math.inf]),
)
def test_what_is_not_finite_is_found(field: str, number: int, value: float) -> None:
    wrong = make_waypoints()
    wrong[number] = replace(wrong[number], **{field: value})
    assert (Kind.NOT_FINITE, f"waypoints[{number}]") in {
        (finding.kind, finding.field) for finding in audit(wrong, ROUTE, count=WAYPOINTS)
    }


@pytest.mark.parametrize("count", [0, 1, 19, 21])
def test_another_number_of_waypoints_is_found(count: int) -> None:
    wrong = (
        (make_waypoints()[:1] * 2 + make_waypoints()[1:])
        if count == 21
        else make_waypoints()[20 - count :]
    )
    assert Kind.COUNT in {finding.kind for finding in audit(wrong, ROUTE, count=WAYPOINTS)}


def test_a_plan_that_is_published_wrongly_is_not_safe(monkeypatch: pytest.MonkeyPatch) -> None:
    policy, right = Policy.load(), publish._waypoints
    assert plan(OWN, [], ROUTE * 1, policy, replace(PATIENT, extend_route=True)).safe

    def twice(*values: object) -> tuple[Waypoint, ...]:
        points = right(*values)  # pyright: ignore[reportArgumentType]
        return (*points[:5], replace(points[5], index=points[4].index), *points[6:])

    monkeypatch.setattr(publish, "_waypoints", twice)
    answer = plan(OWN, [], ROUTE, policy, replace(PATIENT, extend_route=True))
    assert answer.status is Status.UNRESOLVED
    assert {finding.kind for finding in answer.reasons} == {Kind.INDICES}
