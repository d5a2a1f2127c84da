"""Alert levels follow the time to loss, and what is shown changes by M of N."""

import math

import numpy as np
import pytest

from agents.assurance.alerts import (
    Alerting,
    Alerts,
    Level,
    Region,
    Times,
    levels,
    no_alerts,
    rearrange,
    regions,
    update,
)
from agents.assurance.backup import STEPS
from agents.assurance.bands import heading_bands, losses_on_course
from agents.assurance.inputs import inputs
from agents.assurance.monitor import step
from agents.assurance.state import State
from agents.assurance.thresholds import Cause
from agents.kernel.traffic import Requirement, Traffic
from envs.aircraft import PAPER, new_aircraft
from envs.kinematics import C208_PUBLISHED, VehicleState
from tests.agents.scenes import THRESHOLDS, flying, intruder_at, on_plan
from tests.support import random_states, vehicle

USUAL = Alerting.for_aircraft(PAPER)
NOT_HELD = Alerting(USUAL.reached, USUAL.reached, hold=0.0, forget=5.0)


def show(alerting: Alerting, losses: list[float], step: float = 1.0) -> list[int]:
    """Return the levels that are shown of one intruder, update by update."""
    alerts, shown = no_alerts(1, 1, alerting), []
    exists = np.ones((1, 1), dtype=bool)
    for index, loss in enumerate(losses):
        alerts = update(alerts, np.array([index * step]), np.array([[loss]]), exists, alerting)
        shown.append(int(alerts.level[0, 0]))
    return shown


def test_levels_follow_the_time_to_loss() -> None:
    losses = [math.inf, 120.1, 120.0, 55.1, 55.0, 25.1, 25.0, 0.0]
    assert levels(losses, USUAL.reached).tolist() == [0, 0, 1, 1, 2, 2, 3, 3]
    assert levels(math.nan, USUAL.reached) == Level.WARNING  # unknown is no reason to be silent


def test_one_stray_look_neither_raises_nor_ends_an_alert() -> None:
    far, near = math.inf, 40.0
    assert show(NOT_HELD, [far, far, near, far, far, far]) == [0] * 6
    assert show(NOT_HELD, [far, near, near, far, near, near]) == [0, 0, 2, 2, 2, 2]


def test_an_alert_ends_when_fewer_than_m_of_n_ask_for_it() -> None:
    far, near = math.inf, 40.0
    assert show(NOT_HELD, [near, near, near, far, far, far, far]) == [2, 2, 2, 2, 2, 0, 0]


def test_the_first_look_and_one_after_a_gap_show_at_once() -> None:
    assert show(NOT_HELD, [20.0]) == [Level.WARNING]
    assert show(NOT_HELD, [math.inf, 20.0], step=6.0) == [Level.NONE, Level.WARNING]


def test_a_level_is_left_later_than_it_is_reached() -> None:
    alerting = Alerting(USUAL.reached, USUAL.left, hold=0.0, forget=5.0)
    losses = [50.0, 60.0, 70.0, 74.0, 76.0, 76.0, 76.0, 76.0]
    assert show(alerting, losses)[:4] == [2, 2, 2, 2]
    assert show(alerting, losses)[-1] == 1
    assert show(alerting, [60.0, 60.0, 60.0]) == [1, 1, 1]


def test_a_raised_level_is_held() -> None:
    alerting = Alerting(USUAL.reached, USUAL.reached, hold=20.0, forget=5.0)
    shown = show(alerting, [math.inf, 20.0, 20.0] + [math.inf] * 22)
    assert shown[2:22] == [3] * 20
    assert shown[-1] == 0


def test_one_intruders_alert_does_not_depend_on_the_others() -> None:
    generator = np.random.default_rng(4)
    losses = generator.choice([10.0, 40.0, 80.0, np.inf], (30, 5, 3))
    mask = generator.random((30, 5, 3)) < 0.9
    alerts = no_alerts(5, 3, USUAL)
    alone = [[no_alerts(1, 1, USUAL) for _ in range(3)] for _ in range(5)]
    for index in range(30):
        time = np.full(5, float(index))
        alerts = update(alerts, time, losses[index], mask[index], USUAL)
        for row in range(5):
            for k in range(3):
                part = slice(row, row + 1), slice(k, k + 1)
                own_alerts: Alerts = update(
                    alone[row][k], time[:1], losses[index][part], mask[index][part], USUAL
                )
                alone[row][k] = own_alerts
                assert own_alerts.level[0, 0] == alerts.level[row, k]
    assert (alerts.level[~mask[-1]] == Level.NONE).all()


def test_an_alert_follows_its_intruder_to_another_place() -> None:
    alerts = update(
        no_alerts(1, 2, USUAL),
        np.zeros(1),
        np.array([[10.0, np.inf]]),
        np.ones((1, 2), bool),
        USUAL,
    )
    moved = rearrange(alerts, [-1, 1, 0], USUAL)
    assert moved.level.tolist() == [[Level.NONE, Level.NONE, Level.WARNING]]
    # What is new shows its level at once, what is known by M of N.
    after = update(
        moved, np.ones(1), np.array([[40.0, 40.0, np.inf]]), np.ones((1, 3), bool), USUAL
    )
    assert after.level.tolist() == [[Level.CORRECTIVE, Level.NONE, Level.WARNING]]


def test_the_loss_on_the_present_course_is_that_of_the_present_heading() -> None:
    generator = np.random.default_rng(6)
    own, state = random_states(generator, 50, extent=1_000.0), random_states(generator, 50, 4)
    rate = generator.choice([0.0, 0.05], (50, 4))
    zero = np.zeros((50, 4))
    traffic = Traffic(
        state, generator.random((50, 4)) < 0.9, rate, 15.0 * (rate > 0), zero, zero, zero
    )
    requirement = Requirement(1_000.0)
    losses = losses_on_course(own, traffic, requirement, 120.0)
    bands = heading_bands(own, traffic, requirement, C208_PUBLISHED, 120.0, own.heading[:, None])
    # A 1280th of the look-ahead early at most.
    np.testing.assert_allclose(losses.min(axis=1), bands.loss[:, 0], atol=0.1)
    lost = np.isfinite(bands.loss[:, 0])
    assert np.all(losses.min(axis=1)[lost] <= bands.loss[lost, 0] + 1e-9)
    assert np.isinf(losses[~traffic.mask]).all() and np.isfinite(losses).any()
    head_on = Traffic.straight(VehicleState(*(np.array([[v]]) for v in (9e3, 0.0, math.pi, 70.0))))
    losses_ahead = losses_on_course(vehicle(0.0, 0.0, 0.0, 80.0), head_on, requirement, 120.0)
    assert losses_ahead[0, 0] == pytest.approx(8_000.0 / 150.0, abs=0.1)


def test_regions_are_the_levels_of_bands_and_the_way_out() -> None:
    requirement, right = Requirement(1_000.0), np.radians([-90.0, 0.0])
    for distance, expected in ((9_000.0, Region.CORRECTIVE), (4_000.0, Region.WARNING)):
        other = VehicleState(*(np.array([[v]]) for v in (distance, 0.0, math.pi, 70.0)))
        bands = heading_bands(
            vehicle(0.0, 0.0, 0.0, 80.0),
            Traffic.straight(other),
            requirement,
            C208_PUBLISHED,
            120.0,
            right,
        )
        assert regions(bands, USUAL, 1_000.0).tolist() == [[Region.FREE, expected]]
    inside = VehicleState(*(np.array([[v]]) for v in (700.0, 150.0, math.pi, 80.0)))
    bands = heading_bands(
        vehicle(0.0, 0.0, 0.0, 80.0), Traffic.straight(inside), requirement, C208_PUBLISHED, 120.0
    )
    shown = regions(bands, USUAL, 1_000.0)[0].tolist()
    assert shown.count(Region.RECOVERY) == 1
    assert set(shown) == {Region.WARNING, Region.RECOVERY}


def test_a_monitored_plan_has_no_alert_and_an_unsafe_one_has() -> None:
    monitor = flying(intruder_at(30_000.0, 8_000.0, math.pi))
    levels_shown = set()
    for time in range(40):
        # It turns towards the plan at 10 s.
        place = 20_000.0 - 75.0 * time, 0.0 if time >= 10 else 8_000.0, math.pi
        given = inputs(float(time), on_plan(float(time)), intruder_at(*place))
        monitor, decision = step(monitor, given, THRESHOLDS)
        level = int(levels(decision.loss, USUAL.reached)[0])
        assert (level > 0) == bool(int(decision.causes[0]) & Cause.SEPARATION)
        if decision.state[0] == State.MONITORING:
            assert level == Level.NONE
        levels_shown.add((int(decision.state[0]), level))
    assert {level for _, level in levels_shown} >= {Level.NONE, Level.PREVENTIVE}


def test_the_monitor_does_not_wait_for_an_answer_within_a_warning_only() -> None:
    assert THRESHOLDS.urgent < USUAL.reached.warning < USUAL.reached.corrective
    assert USUAL.look_ahead == sum(STEPS) * PAPER.dt


def test_times_scale_with_the_aircraft() -> None:
    small = new_aircraft(PAPER.limits._replace(speed_max=200.0, speed_min=50.0), 1_000.0)
    factor = small.dt / PAPER.dt
    assert factor != 1.0
    scaled = Alerting.for_aircraft(small)
    assert scaled.reached == Times(*(factor * time for time in USUAL.reached))
    assert scaled.hold == factor * USUAL.hold
