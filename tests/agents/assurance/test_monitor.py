"""The monitor's transitions, its hysteresis and its bound on requests."""

import math
from dataclasses import replace

import numpy as np
import pytest

from agents import assurance
from agents.assurance.inputs import no_areas
from agents.assurance.monitor import Cause, FlyMode, State
from agents.kernel.areas import ActiveArea
from agents.kernel.traffic import Requirement, Traffic
from envs.areas import Area, Circle
from envs.kinematics import VehicleState
from envs.waypoints import PlanStates
from tests.agents.scenes import (
    NAN,
    THRESHOLDS,
    causes_of,
    far,
    flying,
    intruder_at,
    on_plan,
    reply,
    state_of,
    straight,
    tell,
)

NOWHERE: VehicleState = VehicleState(*(np.array([NAN]) for _ in range(4)))
HEAD_ON = 9_000.0  # m ahead at first: the loss of separation is more than 50 s away


def opposing(time: float, ahead: float = HEAD_ON) -> object:
    return intruder_at(ahead - 75.0 * time, 0.0, math.pi)


def test_without_a_plan_nothing_is_flown_or_asked_for() -> None:
    monitor = assurance.start(1, 1, THRESHOLDS)
    for time in range(5):
        monitor, decision = tell(monitor, float(time))
        assert state_of(monitor) is State.IDLE
        assert decision.fly[0] == FlyMode.NOTHING
        assert not decision.replan[0]


def test_a_plan_that_is_kept_is_monitored_and_asks_for_nothing() -> None:
    monitor = flying()
    for time in range(0, 300, 2):
        monitor, decision = tell(monitor, float(time))
        assert state_of(monitor) is State.MONITORING
        assert decision.fly[0] == FlyMode.PLAN
        assert not decision.replan[0] and causes_of(monitor) == Cause(0)
    assert decision.separation[0] == pytest.approx(50_000.0)


def test_a_plan_that_is_not_safe_is_not_flown() -> None:
    idle = assurance.start(1, 1, THRESHOLDS)
    monitor = assurance.activate(
        idle,
        np.array([0]),
        straight(),
        np.array([False]),
        0.0,
        Traffic.straight(far(0.0)),
        THRESHOLDS,
    )
    monitor, decision = tell(monitor, 0.0)
    assert state_of(monitor) is State.BACKUP and decision.fly[0] == FlyMode.BACKUP
    assert decision.replan[0] and np.isfinite(monitor.backup.plan_states.x).all()
    monitor, accepted = reply(monitor, decision, safe=True)
    assert accepted.all() and state_of(monitor) is State.MONITORING


@pytest.mark.parametrize("damage", ["nan", "times", "contradiction"])
def test_a_plan_that_is_no_plan_is_not_flown_whatever_it_is_called(damage: str) -> None:
    plan_states = straight()
    if damage == "nan":
        plan_states.speed[0, 7] = NAN
    elif damage == "times":
        plan_states.time[0, 7] = plan_states.time[0, 6]
    else:
        plan_states.x[0, 7] += 2_500.0
    idle = assurance.start(1, 1, THRESHOLDS)
    monitor = assurance.activate(
        idle,
        np.array([0]),
        plan_states,
        np.array([True]),
        0.0,
        Traffic.straight(far(0.0)),
        THRESHOLDS,
    )
    monitor, _ = tell(monitor, 0.0)
    assert state_of(monitor) is State.BACKUP


@pytest.mark.parametrize("margin", [0.02, 210.0])
def test_what_the_margin_covers_is_no_reason_for_a_new_plan(margin: float) -> None:
    options = replace(THRESHOLDS.options, requirement=Requirement(1_000.0, margin, 2.0))
    usual = assurance.Thresholds.for_plans(options)
    tight = assurance.Thresholds.for_plans(options, cross_track=1.0, along_track=1.0)
    slowest = options.aircraft.limits.speed_min
    assert (usual.cross_track, usual.along_track) == (max(25.0, margin), max(50.0, margin))
    assert usual.time_error == max(options.aircraft.dt, margin / slowest)
    assert tight.cross_track == tight.along_track == max(1.0, margin)


@pytest.mark.parametrize(
    ("left", "ahead", "cause"),
    [(1.0, 0.0, Cause.CROSS_TRACK), (0.0, -1.0, Cause.ALONG_TRACK), (-1.0, 0.0, Cause.CROSS_TRACK)],
)
def test_an_error_begins_at_its_threshold_and_ends_at_a_share_of_it(
    left: float, ahead: float, cause: Cause
) -> None:
    limit = THRESHOLDS.cross_track if left else THRESHOLDS.along_track
    monitor = flying()
    expected = [
        (0.99, False),
        (1.01, True),
        (0.75, True),
        (0.71, True),
        (0.65, False),
        (0.99, False),
    ]
    for time, (share, there) in enumerate(expected):
        # 1.0 s of 75 m/s is more than the limit along the track: the time error stays out of it.
        monitor, _ = tell(
            monitor,
            float(time),
            on_plan(float(time), left=left * limit * share, ahead=ahead * limit * share),
        )
        assert bool(causes_of(monitor) & cause) is there
        assert state_of(monitor) is (State.REPLAN_REQUESTED if there else State.MONITORING)


def test_being_late_is_an_error_of_time() -> None:
    monitor, decision = tell(flying(), 10.0, on_plan(10.0, ahead=-90.0))
    assert causes_of(monitor) & Cause.TIME_ERROR
    assert decision.time_error[0] == pytest.approx(90.0 / 75.0)
    assert decision.along_track[0] == pytest.approx(-90.0)


def test_small_errors_accumulate() -> None:
    monitor, began = flying(), None
    for time in range(120):
        monitor, _ = tell(
            monitor, float(time), on_plan(float(time), left=0.6 * THRESHOLDS.cross_track)
        )
        if causes_of(monitor):
            began = time
            break
    assert causes_of(monitor) == Cause.ACCUMULATED
    # A share q of the limit reaches s limit tau after tau ln(q / (q - s)).
    assert began == pytest.approx(30.0 * math.log(0.6 / 0.1), abs=2.0)
    monitor = flying()
    for time in range(0, 300, 3):
        monitor, _ = tell(
            monitor, float(time), on_plan(float(time), left=0.45 * THRESHOLDS.cross_track)
        )
        assert causes_of(monitor) == Cause(0)


def test_an_intruder_that_leaves_its_prediction_asks_for_a_plan_only_where_it_matters() -> None:
    near = intruder_at(0.0, 1_500.0)
    monitor = flying(near)
    monitor, _ = tell(monitor, 1.0, intruders=intruder_at(75.0, 1_500.0))
    assert state_of(monitor) is State.MONITORING
    monitor, decision = tell(monitor, 2.0, intruders=intruder_at(150.0, 1_500.0, 0.1))
    assert causes_of(monitor) & Cause.INTRUDER_DEVIATION and decision.replan[0]
    monitor, decision = tell(flying(), 1.0, intruders=intruder_at(75.0, 50_000.0, 0.1))
    assert (
        causes_of(monitor) == Cause(0)
        and decision.intruder_velocity[0] > THRESHOLDS.intruder_velocity
    )


def test_no_plan_and_an_unsafe_rest_lead_to_the_backup_and_only_a_safe_plan_leads_back() -> None:
    monitor, decision = tell(flying(), 0.0, intruders=opposing(0.0))
    assert state_of(monitor) is State.REPLAN_REQUESTED and causes_of(monitor) & Cause.SEPARATION
    assert 40.0 < decision.loss[0] < HEAD_ON / 150.0
    monitor, accepted = reply(monitor, decision, safe=False)
    assert (
        not accepted.any()
        and state_of(monitor) is State.BACKUP
        and causes_of(monitor) & Cause.REFUSED
    )
    for time in range(1, 12):
        # The intruder is gone, and all would be well: but the backup is left for a safe plan only.
        monitor, decision = tell(monitor, float(time), mask=np.array([[False]]))
        assert state_of(monitor) is State.BACKUP and decision.fly[0] == FlyMode.BACKUP
        assert decision.replan[0] == (time % 2 == 0)
        if decision.replan[0]:
            monitor, _ = reply(monitor, decision, safe=time == 10)
        if time == 10:
            assert state_of(monitor) is State.MONITORING
            break


def test_no_plan_and_a_safe_rest_are_denied_until_the_cause_ends() -> None:
    monitor, decision = tell(flying(), 0.0, on_plan(0.0, left=30.0))
    monitor, _ = reply(monitor, decision, safe=False)
    assert state_of(monitor) is State.DENIED
    monitor, decision = tell(monitor, 1.0, on_plan(1.0, left=28.0))
    assert (
        state_of(monitor) is State.DENIED
        and decision.fly[0] == FlyMode.PLAN
        and not decision.replan[0]
    )
    monitor, decision = tell(monitor, 2.0, on_plan(2.0, left=26.0))
    assert state_of(monitor) is State.DENIED and decision.replan[0]
    monitor, _ = tell(monitor, 3.0, on_plan(3.0, left=5.0))
    assert state_of(monitor) is State.MONITORING and not causes_of(monitor) & Cause.REFUSED


def test_denied_becomes_backup_when_the_rest_is_no_longer_safe() -> None:
    monitor, decision = tell(flying(), 0.0, on_plan(0.0, left=30.0))
    monitor, _ = reply(monitor, decision, safe=False)
    monitor, _ = tell(monitor, 1.0, on_plan(1.0, left=30.0), opposing(1.0))
    assert state_of(monitor) is State.BACKUP


@pytest.mark.parametrize("period", [0.5, 1.0, 1.5])
def test_requests_are_bounded_in_rate(period: float) -> None:
    monitor, times = flying(), []
    for index in range(32):
        time = index * period
        monitor, decision = tell(monitor, time, on_plan(time, left=30.0))
        if decision.replan[0]:
            times.append(time)
            monitor, _ = reply(monitor, decision, safe=False)
    assert np.diff(times).min() >= THRESHOLDS.replan_interval
    assert np.diff(times).max() <= THRESHOLDS.replan_interval + period
    assert len(times) >= 8


def test_a_planner_that_does_not_answer_is_denied_and_asked_again() -> None:
    monitor, asked = flying(), []
    for time in range(10):
        monitor, decision = tell(monitor, float(time), on_plan(float(time), left=30.0))
        asked += [time] if decision.replan[0] else []
        silent = bool(causes_of(monitor) & Cause.NO_ANSWER)
        assert state_of(monitor) is (State.DENIED if silent else State.REPLAN_REQUESTED)
    assert asked == [0, 4, 8]


def test_an_urgent_loss_does_not_wait_for_an_answer() -> None:
    near = 75.0 * 2 * 15.0 + 1_000.0
    monitor, decision = tell(flying(), 0.0, intruders=opposing(0.0, near))
    assert state_of(monitor) is State.REPLAN_REQUESTED and decision.loss[0] <= THRESHOLDS.urgent
    monitor, _ = tell(monitor, 1.0, intruders=opposing(1.0, near))
    assert state_of(monitor) is State.BACKUP
    # Where there is time, the answer is waited for.
    monitor, _ = tell(flying(), 0.0, intruders=opposing(0.0))
    monitor, _ = tell(monitor, 1.0, intruders=opposing(1.0))
    assert state_of(monitor) is State.REPLAN_REQUESTED


def test_an_urgent_loss_does_not_wait_until_a_plan_may_be_asked_for_again() -> None:
    near = 75.0 * 2 * 15.0 + 1_000.0
    monitor, decision = tell(flying(), 0.0, on_plan(0.0, left=30.0))
    monitor, accepted = reply(monitor, decision, safe=True)
    assert accepted.all()
    monitor, decision = tell(monitor, 1.0, intruders=opposing(1.0, near))
    assert state_of(monitor) is State.BACKUP and not decision.replan[0]


def test_an_unsafe_rest_does_not_wait_where_no_plan_may_be_asked_for() -> None:
    """An intruder is lost, and an area lies ahead, though farther than what is urgent."""
    monitor, _ = tell(flying(), 0.0)
    areas = no_areas(1)
    areas[0] = (ActiveArea(0, Area(Circle(9_000.0, 0.0, 1_000.0)), 0.0, 400.0),)
    lost = intruder_at(NAN, NAN)
    monitor, decision = tell(monitor, THRESHOLDS.intruder_age + 1.0, intruders=lost, areas=areas)
    assert decision.loss[0] > THRESHOLDS.urgent and not decision.replan[0]
    assert state_of(monitor) is State.BACKUP


def test_only_the_answer_to_the_last_request_counts() -> None:
    monitor = flying()
    numbers = []
    for time in range(5):
        monitor, decision = tell(monitor, float(time), on_plan(float(time), left=30.0))
        if decision.replan[0]:
            numbers.append(decision.number.copy())
    assert len(numbers) == 2
    row, safe = np.array([0]), np.array([True])
    for number in (numbers[0], numbers[1] + 1, np.array([0]), np.array([-1])):
        same, accepted = assurance.answer(monitor, row, number, straight(4.0), safe, THRESHOLDS)
        assert (
            not accepted.any()
            and same.state[0] == monitor.state[0]
            and same.answered[0] == monitor.answered[0]
        )
    monitor, accepted = assurance.answer(monitor, row, numbers[1], straight(4.0), safe, THRESHOLDS)
    assert accepted.all() and monitor.answered[0] == numbers[1]
    _, accepted = assurance.answer(monitor, row, numbers[1], straight(4.0), safe, THRESHOLDS)
    assert not accepted.any(), "an answer counts once"


@pytest.mark.parametrize("safe", [True, False])
def test_an_answer_while_the_ownship_is_not_seen_changes_nothing_that_is_flown(safe: bool) -> None:
    monitor, asked = tell(flying(), 0.0, intruders=opposing(0.0))
    monitor, _ = tell(monitor, 1.0, NOWHERE, far(1.0) if safe else opposing(1.0))
    after, accepted = reply(monitor, asked, safe=safe, plan_states=straight(0.0))
    assert not accepted.any()
    assert state_of(after) is State.DENIED and not after.on_backup[0]


def test_a_new_plan_begins_without_the_errors_of_the_last() -> None:
    monitor, decision = tell(flying(), 0.0, on_plan(0.0, left=30.0))
    monitor, decision = tell(monitor, 2.0, on_plan(2.0, left=30.0))
    assert monitor.sums[0, 0] > 0.0
    monitor, decision = tell(monitor, 4.0, on_plan(4.0, left=30.0))
    monitor, accepted = reply(monitor, decision, safe=True)
    assert accepted.all() and not monitor.sums.any()


def test_a_safe_plan_that_came_too_late_to_be_safe_is_refused() -> None:
    monitor, decision = tell(flying(), 0.0, on_plan(0.0, left=30.0))
    monitor, _ = tell(monitor, 1.0, on_plan(1.0, left=30.0), opposing(1.0))
    monitor, accepted = reply(monitor, decision, safe=True, plan_states=straight(0.0))
    assert not accepted.any() and state_of(monitor) is State.BACKUP


def test_a_plan_that_ends_asks_for_another() -> None:
    monitor, _ = tell(flying(), 339.0)
    assert state_of(monitor) is State.MONITORING
    monitor, _ = tell(flying(), 341.0)
    assert causes_of(monitor) == Cause.PLAN_ENDING


def test_where_no_plan_follows_one_that_has_ended_the_backup_is_flown() -> None:
    monitor = flying()
    for time in range(380, 411, 2):
        monitor, decision = tell(monitor, float(time))
        assert (state_of(monitor) is State.BACKUP) == (time >= 400)
        assert decision.fly[0] == (FlyMode.BACKUP if time >= 400 else FlyMode.PLAN)
        if decision.replan[0]:
            monitor, _ = reply(monitor, decision, safe=False)
    assert np.isfinite(monitor.backup.started[0])
    monitor, decision = tell(monitor, 412.0)
    monitor, accepted = reply(monitor, decision, safe=True, plan_states=straight(412.0))
    assert accepted.all() and state_of(monitor) is State.MONITORING


def test_while_the_ownship_is_not_seen_what_is_flown_stays() -> None:
    """Also where the plan ends meanwhile; what is flown next is decided when it is seen again."""
    monitor, _ = tell(flying(), 399.0)
    monitor, decision = tell(monitor, 401.0, NOWHERE)
    assert state_of(monitor) is State.DENIED and decision.fly[0] == FlyMode.PLAN
    monitor, decision = tell(monitor, 402.0)
    assert state_of(monitor) is State.BACKUP and decision.fly[0] == FlyMode.BACKUP


def test_no_plan_is_asked_for_where_it_would_begin_nowhere() -> None:
    monitor, decision = tell(flying(), 0.0, intruders=opposing(0.0))
    monitor, _ = reply(monitor, decision, safe=False)
    monitor, decision = tell(monitor, 5.0, NOWHERE, mask=np.array([[False]]))
    assert decision.fly[0] == FlyMode.BACKUP and not decision.replan[0]


def test_a_refusal_is_told_as_long_as_the_backup_is_flown_for_it() -> None:
    monitor, decision = tell(flying(), 0.0, intruders=opposing(0.0))
    monitor, _ = reply(monitor, decision, safe=False)
    monitor, _ = tell(monitor, 1.0, mask=np.array([[False]]))
    assert causes_of(monitor) & Cause.REFUSED


def test_a_refusal_outlasts_a_moment_in_which_the_ownship_is_not_seen() -> None:
    # Carried on it would be back on its plan after a second.
    back = on_plan(0.0, left=30.0)._replace(heading=np.array([-0.3]))
    monitor, decision = tell(flying(), 0.0, back)
    monitor, _ = reply(monitor, decision, safe=False)
    monitor, _ = tell(monitor, 1.0, NOWHERE)
    assert not causes_of(monitor) & Cause.CROSS_TRACK
    assert causes_of(monitor) & Cause.REFUSED


def test_references_lead_along_the_plan_or_the_backup() -> None:
    monitor, decision = tell(flying(), 7.0)
    states = assurance.references(monitor, 7.0, 0.5, 4)
    np.testing.assert_allclose(states.x[:, 0], 75.0 * (7.0 + 0.5 * np.arange(5)))
    monitor, decision = tell(monitor, 8.0, intruders=opposing(8.0))
    monitor, _ = reply(monitor, decision, safe=False)
    states = assurance.references(monitor, 8.0, 0.5, 10)
    assert states.x[0, 0] == pytest.approx(600.0)
    backup = monitor.backup.plan_states
    np.testing.assert_allclose(
        [states.x[10, 0], states.y[10, 0]], [backup.x[0, 1], backup.y[0, 1]], atol=1e-3
    )


@pytest.mark.parametrize("margin", [0.1, 5.0, 50.0])
@pytest.mark.parametrize("geometry", ["diverging", "parallel"])
@pytest.mark.parametrize("every", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_no_start_inside_the_margin_is_refused_or_flutters(
    margin: float, geometry: str, every: bool
) -> None:
    # Every centimetre in the slow run; else of the first and the last half metre.
    requirement = THRESHOLDS.requirement._replace(margin=margin)
    thresholds = assurance.Thresholds.for_plans(
        replace(THRESHOLDS.options, requirement=requirement)
    )
    distance = np.arange(1_000.0, 1_000.0 + margin + 0.005, 0.01)
    if margin > 1.0 and not every:
        distance = np.concatenate([distance[:50], distance[50:-50:100], distance[-50:]])
    count = distance.size
    reported = intruder_at(0.0, 0.0, count=count)
    if geometry == "diverging":
        reported = reported._replace(x=-distance[:, None], heading=reported.heading + math.pi)
    else:
        reported = reported._replace(y=distance[:, None])
    rows, safe = np.arange(count), np.ones(count, bool)
    monitor = assurance.start(count, 1, THRESHOLDS)
    # The first plan is refused by decree: a new one must then be taken up at any distance, and left
    # in peace.
    monitor = assurance.activate(
        monitor, rows, straight(count=count), ~safe, 0.0, Traffic.straight(reported), thresholds
    )
    monitor, decision = assurance.step(
        monitor, assurance.inputs(0.0, on_plan(0.0, count), reported), thresholds
    )
    assert (monitor.state == State.BACKUP).all() and decision.replan.all()
    assert monitor.backup.safe.all(), "a backup that does not come closer is safe"
    monitor, accepted = assurance.answer(
        monitor, rows, decision.number, straight(count=count), safe, thresholds
    )
    assert accepted.all()
    for time in (1.0, 2.0, 200.0):
        moved = reported._replace(x=reported.x + 75.0 * time * np.cos(reported.heading))
        monitor, decision = assurance.step(
            monitor, assurance.inputs(time, on_plan(time, count), moved), thresholds
        )
        assert (monitor.state == State.MONITORING).all() and not decision.replan.any()


def test_the_monitor_never_changes_what_it_is_given() -> None:
    monitor, decision = tell(flying(), 0.0, intruders=opposing(0.0))

    def flat(tree: object) -> list[np.ndarray]:
        return (
            [leaf for part in tree for leaf in flat(part)]
            if isinstance(tree, tuple)
            else [np.array(tree)]
        )

    before = flat(monitor)
    reply(monitor, decision, safe=True, plan_states=PlanStates(*straight(0.0)))
    reply(monitor, decision, safe=False)
    tell(monitor, 1.0, intruders=opposing(1.0))
    for old, new in zip(before, flat(monitor), strict=True):
        np.testing.assert_array_equal(old, new)
