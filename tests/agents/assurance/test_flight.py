"""The monitor at work for one aircraft, in plain words (whole encounters: tests/eval/flights/test_assured_mode.py)."""

import math
from dataclasses import replace

import numpy as np
import pytest

from agents.assurance import single as watching
from agents.assurance.monitor import Cause, Flown, State, Thresholds
from agents.planner.answer import Plan, Status
from agents.planner.planner import plan
from agents.planner.request import Intruder
from agents.policy.inference import Policy
from envs.kinematics import VehicleState
from envs.waypoints import RoutePoint
from tests.agents.assurance.scenes import causes_of, flying, on_plan, other, tell

ROUTE = [RoutePoint(7 + number, 12_000.0 + 5_000.0 * number, 0.0) for number in range(8)]
OWN = VehicleState(0.0, 0.0, 0.0, 75.0)


@pytest.fixture(scope="module")
def policy() -> Policy:
    return Policy.load()


@pytest.fixture(scope="module")
def first(policy: Policy) -> Plan:
    return plan(OWN, [parallel(0.0)], ROUTE, policy)


def parallel(time: float) -> Intruder:
    return Intruder(VehicleState(75.0 * time, 8_000.0, 0.0, 75.0))


def on(plan: Plan, time: float, watch: watching.Watch) -> VehicleState:
    from agents.assurance.monitor import references

    state = references(watch.monitor, time, 0.1, 0)
    return VehicleState(*(float(field[0, 0]) for field in state))


def test_one_aircraft_from_plan_to_replan(policy: Policy, first: Plan) -> None:
    watch = watching.activate(watching.begin(), first, OWN, {"a": parallel(0.0)}, 0.0)
    for time in range(3):
        watch, verdict = watching.step(watch, float(time), on(first, time, watch), {"a": parallel(time)})
        assert verdict.state is State.MONITORING and verdict.fly is Flown.PLAN
        assert verdict.ask is None and verdict.reasons == () and len(verdict.backup) == 11
    # Somebody new comes head-on.
    meeting = Intruder(VehicleState(9_000.0, 0.0, math.pi, 75.0))
    own = on(first, 3.0, watch)
    watch, verdict = watching.step(watch, 3.0, own, {"b": meeting, "a": parallel(3.0)})
    assert watch.names == ("a", "b") and verdict.state is State.REPLAN_REQUESTED
    assert {why.cause for why in verdict.reasons} == {Cause.SEPARATION, Cause.INTRUDER_DEVIATION}
    assert any(why.message.startswith("separation of the rest of the plan is ") for why in verdict.reasons)
    assert verdict.ask is not None and len(verdict.ask.intruders) == 2
    answer = plan(verdict.ask.own, verdict.ask.intruders, ROUTE, policy)
    assert answer.status is Status.SAFE
    refused, taken_up = watching.answer(watch, verdict.ask.number, replace(answer, status=Status.UNRESOLVED))
    assert not taken_up and refused.monitor.state[0] == State.BACKUP
    watch, taken_up = watching.answer(watch, verdict.ask.number, answer)
    assert taken_up
    meeting = Intruder(VehicleState(9_000.0 - 75.0, 0.0, math.pi, 75.0))
    watch, verdict = watching.step(watch, 4.0, on(answer, 4.0, watch), {"a": parallel(4.0), "b": meeting})
    assert verdict.state is State.MONITORING and verdict.reasons == ()
    assert watching.answer(watch, 99, answer) == (watch, False)


def test_an_intruder_that_is_not_reported_is_missing_until_it_is_gone(first: Plan) -> None:
    watch = watching.activate(watching.begin(), first, OWN, {"a": parallel(0.0)}, 0.0)
    watch, _ = watching.step(watch, 0.0, OWN, {"a": parallel(0.0)})
    watch, verdict = watching.step(watch, 1.0, on(first, 1.0, watch), {})
    assert [why.cause for why in verdict.reasons] == [Cause.INTRUDER_MISSING]
    assert verdict.state is State.REPLAN_REQUESTED
    watch, verdict = watching.step(watch, 2.0, on(first, 2.0, watch), {}, gone=["a"])
    assert verdict.state is State.MONITORING and watch.names == ()
    watch, verdict = watching.step(watch, 3.0, None, {})
    assert verdict.state is State.DENIED and verdict.backup
    assert [why.message for why in verdict.reasons] == ["own is missing, not finite or out of range"]
    assert watching.step(watching.deactivate(watch), 4.0, None, {})[1].state is State.IDLE


def test_every_cause_has_its_words(first: Plan) -> None:
    watch = watching.activate(watching.begin(), first, OWN, {"a": parallel(0.0)}, 0.0)
    _, verdict = watching.step(watch, 0.0, OWN, {"a": parallel(0.0)})
    every = np.array([int(~Cause(0))], dtype=np.int32)
    reasons = watching.reasons(verdict.measured._replace(causes=every), Thresholds())
    assert [why.cause for why in reasons] == list(Cause)
    assert all(why.message.startswith(why.field + " ") and "{" not in why.message for why in reasons)


def test_the_own_distance_from_the_plan_is_taken_off_the_separation_of_its_rest() -> None:
    beside = other(0.0, 1_010.0)
    monitor, _ = tell(flying(beside), 0.0, seen=beside)
    for time, left, there in ((1.0, -9.0, False), (2.0, -20.0, True), (3.0, -5.0, False)):
        # Away from the intruder: what counts is that it may be the other way a moment later.
        monitor, _ = tell(monitor, time, on_plan(time, left=left), other(75.0 * time, 1_010.0))
        assert bool(causes_of(monitor) & Cause.SEPARATION) is there
