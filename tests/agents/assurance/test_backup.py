"""The outlook is a lower bound; a backup is always at hand, can be flown, and is flown when the
monitor says so.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from agents.assurance import single as watching
from agents.assurance.backup import (
    STEPS,
    Around,
    Sense,
    Surroundings,
    backup_states,
    in_plane,
    refresh,
    resting,
    search,
    surroundings,
)
from agents.assurance.monitor import Cause, FlyMode, State, Thresholds
from agents.kernel.clearance import Clearance, clearance
from agents.kernel.separation import Separation
from agents.kernel.traffic import Requirement, Traffic, predict
from agents.kernel.trajectory import trajectory
from agents.planner.answer import Plan, Status
from agents.planner.judge.validator import validate
from agents.planner.planner import plan
from agents.planner.request.options import Maneuvers, Options
from agents.planner.request.request import Intruder
from agents.policy.inference import Policy
from envs.aircraft import PAPER, Vertical
from envs.kinematics import C208_PUBLISHED, SURROGATE, VehicleState
from envs.trees import take
from envs.waypoints import PlanStates, RoutePoint, at, legs
from tests.agents.scenes import PATIENT, causes_of, flying, intruder_at, on_plan, tell
from tests.support import random_states

REQUIREMENT = Requirement(1_000.0, margin=0.1)
THRESHOLDS = Thresholds.for_plans(Options.for_aircraft(PAPER, requirement=REQUIREMENT))


def turning(generator: np.random.Generator, count: int, intruders: int = 2) -> Traffic:
    state = random_states(generator, count, intruders, extent=6_000.0)
    zero = np.zeros((count, intruders))
    rate = generator.choice([0.0, 0.03, -0.05], zero.shape)
    mask = generator.random(zero.shape) < 0.9
    return Traffic(state, mask, rate, np.where(rate == 0.0, 0.0, 12.0), zero, zero, zero)


def winding(generator: np.random.Generator, count: int) -> PlanStates:
    """Return plans of 20 legs that turn all the time, from within 2 km of the origin."""
    state = random_states(generator, count, extent=2_000.0)
    parts, first = [], 0.0
    for _ in range(2):
        plan_states = backup_states(
            state, state.heading + generator.uniform(-2.0, 2.0, count), state.speed, THRESHOLDS
        )
        parts.append(PlanStates(*plan_states[:4], plan_states.time + first))
        state = VehicleState(*(field[:, -1] for field in plan_states[:4]))
        first += sum(STEPS)
    return PlanStates(
        *(np.concatenate([a, b[:, 1:]], axis=1)[:, :21] for a, b in zip(*parts, strict=True))
    )


def ahead_of(
    plan_states: PlanStates, since: np.ndarray, traffic: Traffic, level: float
) -> Clearance:
    """Return what the rest of plans keeps of 1000 m, exactly where the margin is below a level."""
    required = np.full(traffic.mask.shape, 1_000.0)
    return clearance(
        trajectory(plan_states).since(since), Separation(traffic, required, None, 2.0), level
    )


def test_the_outlook_is_a_sharp_lower_bound_of_the_rest() -> None:
    generator = np.random.default_rng(3)
    count = 60
    plan_states = winding(generator, count)
    curves = legs(plan_states)
    since = generator.uniform(0.0, 150.0, count)
    traffic = turning(generator, count)
    ahead = ahead_of(plan_states, since, traffic, 1e9)
    end = plan_states.time[:, -1] - since
    least = np.full(traffic.mask.shape, np.inf)
    for share in np.linspace(0.0, 1.0, 6_001):
        own, there = at(curves, since + share * end), predict(traffic, (share * end)[:, None])
        least = np.minimum(least, np.hypot(there.x - own.x[:, None], there.y - own.y[:, None]))
    mask = traffic.mask
    least -= 1_000.0
    assert np.isinf(ahead.margin[~mask]).all()
    assert (ahead.margin[mask] <= least[mask] + 1e-6).all()
    assert (ahead.margin[mask] >= least[mask] - 0.02).all()
    coarse = ahead_of(plan_states, since, traffic, 0.0)
    assert (coarse.margin[mask] <= least[mask] + 1e-6).all()
    close = mask & (least < 0.0)
    np.testing.assert_allclose(coarse.margin[close], ahead.margin[close], atol=1e-9)
    assert (
        close.any()
        and np.isfinite(coarse.loss[close]).all()
        and np.isinf(coarse.loss[~close]).all()
    )


def test_the_past_of_a_plan_does_not_count() -> None:
    seconds = np.arange(21.0)[None] * 20.0
    zero = np.zeros_like(seconds)
    plan_states = PlanStates(75.0 * seconds, zero, zero, zero + 75.0, seconds)
    # The intruder stands at 500 m on the way: at 7 s and more it lies behind.
    standing = Traffic.straight(intruder_at(500.0, 0.0, 0.0, 0.0))
    for since in (7.0, 13.3, 47.0):
        ahead = ahead_of(plan_states, np.array([since]), standing, 1e9)
        assert ahead.distance[0, 0] == pytest.approx(abs(75.0 * since - 500.0), abs=0.01)


def test_backups_are_flyable_and_their_legs_are_exact() -> None:
    own = random_states(np.random.default_rng(4), 300)
    generator = np.random.default_rng(5)
    plan_states = backup_states(
        own,
        own.heading + generator.uniform(-2.6, 2.6, 300),
        generator.uniform(50.0, 100.0, 300),
        THRESHOLDS,
    )
    curves = legs(plan_states)
    assert plan_states.x.shape == (300, len(STEPS) + 1) and np.all(
        plan_states.time[:, -1] == sum(STEPS)
    )
    assert (
        np.ptp(curves.yaw_rate, axis=-1).max() < 1e-6
        and np.ptp(curves.acceleration, axis=-1).max() < 1e-5
    )
    # Where nothing else is left, backups turn as fast as the vehicle can.
    limits = THRESHOLDS.limits
    assert SURROGATE.yaw_rate_max < np.abs(curves.yaw_rate).max() <= limits.yaw_rate_max + 1e-9
    assert curves.acceleration.max() <= limits.acceleration_max + 1e-6
    assert curves.acceleration.min() >= limits.acceleration_min - 1e-6
    assert plan_states.speed.min() >= 50.0 - 1e-6 and plan_states.speed.max() <= 100.0 + 1e-6


def test_a_search_returns_a_safe_backup_or_the_clearest() -> None:
    generator = np.random.default_rng(6)
    own = random_states(generator, 80, extent=2_000.0)
    traffic = turning(generator, 80)
    backups = search(own, surroundings(traffic), np.zeros(80), THRESHOLDS)
    assert np.isfinite(np.stack(backups.plan_states)).all()
    checked = validate(backups.plan_states, traffic, REQUIREMENT, C208_PUBLISHED)
    np.testing.assert_allclose(checked.clearance, backups.clearance)
    assert (checked.clearance[backups.safe] > -0.006).all()
    assert 0 < backups.safe.sum() < 80
    # None of the plain courses of the family is much clearer where none is safe.
    for turn in np.radians([0.0, 30.0, -30.0, 90.0, -90.0, 150.0, -150.0]):
        plain = backup_states(own, own.heading + turn, np.clip(own.speed, 50.0, 100.0), THRESHOLDS)
        other_clearance = validate(plain, traffic, REQUIREMENT, C208_PUBLISHED).clearance
        worse = ~backups.safe
        gain = other_clearance[worse] - backups.clearance[worse]
        # A radian of turn must yield 30 m.
        assert gain.max() < 30.0 * 2.7 + 5.0


def test_a_backup_is_kept_while_it_passes_and_searched_for_where_it_does_not() -> None:
    zero = np.zeros(1)
    own = VehicleState(zero, zero, zero, zero + 75.0)
    none = resting(1, THRESHOLDS)
    away = Traffic.straight(intruder_at(9_000.0, 0.0, math.pi))
    first = refresh(none, own, in_plane(surroundings(away)), zero, THRESHOLDS)
    assert first.safe[0] and first.course[0] != 0.0
    moved = own._replace(x=own.x + 75.0)
    second = refresh(first, moved, in_plane(surroundings(away)), zero + 1.0, THRESHOLDS)
    assert second.safe[0] and second.started[0] == 1.0
    assert second.course[0] == first.course[0] and second.plan_states.x[0, 0] == 75.0
    np.testing.assert_allclose(second.legs.x[0, 0, 0], 75.0)
    into = Traffic.straight(
        intruder_at(
            6_000.0 * math.cos(first.course[0]),
            6_000.0 * math.sin(first.course[0]),
            first.course[0] + math.pi,
        )
    )
    third = refresh(second, moved, in_plane(surroundings(into)), zero + 2.0, THRESHOLDS)
    assert third.safe[0] and third.course[0] != first.course[0]
    np.testing.assert_allclose(
        third.legs.heading[0, -1, 0], third.plan_states.heading[0, -2], atol=1e-6
    )


def test_on_top_of_an_intruder_there_is_still_a_backup() -> None:
    zero = np.zeros(1)
    own = VehicleState(zero, zero, zero, zero + 100.9)
    backup = search(own, surroundings(Traffic.straight(intruder_at(0.0, 0.0))), zero, THRESHOLDS)
    assert not backup.safe[0] and np.isfinite(np.stack(backup.plan_states)).all()
    nobody = take(Traffic.straight(intruder_at(0.0, 0.0)), slice(0, 1))._replace(
        mask=np.array([[False]])
    )
    backup = search(own._replace(speed=zero + 75.0), surroundings(nobody), zero, THRESHOLDS)
    assert backup.safe[0] and backup.course[0] == 0.0


def test_an_unsafe_backup_is_exchanged_for_much_more_clearance_only() -> None:
    zero = np.zeros(1)
    own = VehicleState(zero, zero, zero, zero + 75.0)
    near = Traffic.straight(intruder_at(1_800.0, 300.0, math.pi, 75.0))
    best = search(own, surroundings(near), zero, THRESHOLDS)
    assert not best.safe[0]
    slightly = best._replace(course=best.course - 0.02 * np.sign(best.course))
    held = refresh(slightly, own, in_plane(surroundings(near)), zero + 1.0, THRESHOLDS)
    assert (
        held.clearance[0] < best.clearance[0]
        and held.course[0] == slightly.course[0]
        and not held.safe[0]
    )
    wrong = best._replace(course=zero, speed=zero + 75.0)
    changed = refresh(wrong, own, in_plane(surroundings(near)), zero + 1.0, THRESHOLDS)
    assert changed.course[0] == best.course[0]


def test_a_climb_that_is_not_possible_any_more_is_given_up_without_a_gain() -> None:
    zero, climb = np.zeros(1), np.full(1, Sense.CLIMB, dtype=np.int8)
    own = VehicleState(zero, zero, zero, zero + 75.0)
    aircraft = PAPER._replace(vertical=Vertical(5.0, 5.0, 1.0, separation=137.0))
    options = Options.for_aircraft(aircraft, requirement=REQUIREMENT, maneuvers=Maneuvers.BOTH)
    thresholds = Thresholds.for_plans(options)
    near = surroundings(Traffic.straight(intruder_at(1_800.0, 300.0, math.pi, 75.0)))
    before = search(own, near, zero, thresholds)._replace(sense=climb)

    def find(sense: Sense, rows: np.ndarray) -> Surroundings:
        return take(near._replace(possible=np.array([sense is Sense.LEVEL_OFF])), rows)

    around = Around((Sense.LEVEL_OFF, Sense.CLIMB), find)
    after = refresh(before, own, around, zero + 1.0, thresholds)
    assert not after.safe[0] and after.sense[0] == Sense.LEVEL_OFF
    assert after.course[0] == before.course[0]


# The monitor at work for one aircraft, in plain words (whole encounters:
# tests/eval/flights/test_plan_mode.py).

ROUTE = [RoutePoint(7 + number, 12_000.0 + 5_000.0 * number, 0.0) for number in range(8)]
OWN = VehicleState(0.0, 0.0, 0.0, 75.0)


@pytest.fixture(scope="module")
def policy() -> Policy:
    return Policy.load()


@pytest.fixture(scope="module")
def first(policy: Policy) -> Plan:
    return plan(OWN, [parallel(0.0)], ROUTE, policy, PATIENT)


def parallel(time: float) -> Intruder:
    return Intruder(VehicleState(75.0 * time, 8_000.0, 0.0, 75.0))


def on(plan: Plan, time: float, watch: watching.Watch) -> VehicleState:
    from agents.assurance.monitor import references

    state = references(watch.monitor, time, 0.1, 0)
    return VehicleState(*(float(field[0, 0]) for field in state))


def test_one_aircraft_from_plan_to_replan(policy: Policy, first: Plan) -> None:
    watch = watching.activate(watching.begin(THRESHOLDS), first, OWN, {"a": parallel(0.0)}, 0.0)
    for time in range(3):
        watch, verdict = watching.step(
            watch, float(time), on(first, time, watch), {"a": parallel(time)}
        )
        assert verdict.state is State.MONITORING and verdict.fly is FlyMode.PLAN
        assert verdict.ask is None and verdict.reasons == ()
    # Somebody new comes head-on.
    meeting = Intruder(VehicleState(9_000.0, 0.0, math.pi, 75.0))
    own = on(first, 3.0, watch)
    watch, verdict = watching.step(watch, 3.0, own, {"b": meeting, "a": parallel(3.0)})
    assert watch.names == ("a", "b") and verdict.state is State.REPLAN_REQUESTED
    assert {why.cause for why in verdict.reasons} == {Cause.SEPARATION, Cause.INTRUDER_DEVIATION}
    assert any(
        why.message.startswith("separation of the rest of the plan is ") for why in verdict.reasons
    )
    assert verdict.ask is not None and len(verdict.ask.intruders) == 2
    answer = plan(verdict.ask.own, verdict.ask.intruders, ROUTE, policy, PATIENT)
    assert answer.status is Status.SAFE
    refused, taken_up = watching.answer(
        watch, verdict.ask.number, replace(answer, status=Status.UNRESOLVED)
    )
    assert not taken_up and refused.monitor.state[0] == State.BACKUP
    watch, taken_up = watching.answer(watch, verdict.ask.number, answer)
    assert taken_up
    meeting = Intruder(VehicleState(9_000.0 - 75.0, 0.0, math.pi, 75.0))
    watch, verdict = watching.step(
        watch, 4.0, on(answer, 4.0, watch), {"a": parallel(4.0), "b": meeting}
    )
    assert verdict.state is State.MONITORING and verdict.reasons == ()
    assert watching.answer(watch, 99, answer) == (watch, False)


def test_an_intruder_that_is_not_reported_is_missing_until_it_is_gone(first: Plan) -> None:
    watch = watching.activate(watching.begin(THRESHOLDS), first, OWN, {"a": parallel(0.0)}, 0.0)
    watch, _ = watching.step(watch, 0.0, OWN, {"a": parallel(0.0)})
    watch, verdict = watching.step(watch, 1.0, on(first, 1.0, watch), {})
    assert [why.cause for why in verdict.reasons] == [Cause.INTRUDER_MISSING]
    assert verdict.state is State.REPLAN_REQUESTED
    watch, verdict = watching.step(watch, 2.0, on(first, 2.0, watch), {}, gone=["a"])
    assert verdict.state is State.MONITORING and watch.names == ()
    watch, verdict = watching.step(watch, 3.0, None, {})
    assert verdict.state is State.DENIED and np.isfinite(watch.monitor.backup.started[0])
    assert [why.message for why in verdict.reasons] == [
        "own is missing, not finite or out of range"
    ]


def test_every_cause_has_its_words(first: Plan) -> None:
    watch = watching.activate(watching.begin(THRESHOLDS), first, OWN, {"a": parallel(0.0)}, 0.0)
    _, verdict = watching.step(watch, 0.0, OWN, {"a": parallel(0.0)})
    every = np.array([int(~Cause(0))], dtype=np.int32)
    reasons = watching.reasons(verdict.measured._replace(causes=every), THRESHOLDS)
    assert [why.cause for why in reasons] == list(Cause)
    assert all(
        why.message.startswith(why.field + " ") and "{" not in why.message for why in reasons
    )


def test_reasons_name_the_intruders_that_they_are_about(first: Plan) -> None:
    names = [f"c{number}" for number in range(7)]
    known = {name: parallel(0.0) for name in ("far", *names)}
    watch = watching.activate(watching.begin(THRESHOLDS), first, OWN, known, 0.0)
    watch, _ = watching.step(watch, 0.0, OWN, known)
    meeting = Intruder(VehicleState(9_000.0 - 75.0, 0.0, math.pi, 75.0))
    reported = {"far": parallel(1.0), "meets": meeting}  # the others are missing
    _, verdict = watching.step(watch, 1.0, on(first, 1.0, watch), reported)
    said = {why.cause: why.message for why in verdict.reasons}
    assert said[Cause.INTRUDER_MISSING].endswith(" (c0, c1, c2, c3, c4 and 2 more)")
    for cause in (Cause.SEPARATION, Cause.INTRUDER_DEVIATION):
        assert said[cause].endswith(" (meets)")
    assert not any("far" in message for message in said.values())


def test_the_own_distance_from_the_plan_is_taken_off_the_separation_of_its_rest() -> None:
    beside = intruder_at(0.0, 1_010.0)
    monitor, _ = tell(flying(beside), 0.0, intruders=beside)
    for time, left, there in ((1.0, -9.0, False), (2.0, -20.0, True), (3.0, -5.0, False)):
        # Away from the intruder: what counts is that it may be the other way a moment later.
        monitor, _ = tell(
            monitor, time, on_plan(time, left=left), intruder_at(75.0 * time, 1_010.0)
        )
        assert bool(causes_of(monitor) & Cause.SEPARATION) is there
