"""How a flight conforms to its plan: what is measured, when it counts, and for how long."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from agents import assurance
from agents.assurance.conformance import floor
from agents.assurance.monitor import Cause, State
from agents.kernel.traffic import Traffic
from envs.kinematics import VehicleState
from tests.agents.scenes import (
    NAN,
    SPEED,
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

BESIDE = 1_500.0  # m: an intruder of concern on a parallel course


def expecting(traffic: Traffic) -> Any:
    """Return a monitor whose plan expects traffic."""
    monitor, of = assurance.start(1, 1, THRESHOLDS), np.array([0])
    safe = np.array([True])
    return assurance.activate(monitor, of, straight(), safe, 0.0, traffic, THRESHOLDS)


def flying_beside(position_std: float = 0.0, velocity_std: float = 0.0) -> Any:
    """Return a monitor whose plan expects an intruder beside it that is so well known."""
    known = np.full((1, 1), position_std), np.full((1, 1), velocity_std)
    expected = Traffic.straight(intruder_at(0.0, BESIDE))
    return expecting(expected._replace(position_std=known[0], velocity_std=known[1]))


def test_a_plan_is_held_to_what_it_had_to_keep_less_the_band_and_to_the_separation() -> None:
    separation, band = THRESHOLDS.requirement.separation, THRESHOLDS.separation_band
    traffic = Traffic.straight(intruder_at(0.0, 5_000.0))
    for required in (separation, separation + 0.5 * band, separation + 40.0):
        least = floor(np.array([[required]]), traffic, THRESHOLDS).item()
        assert least >= separation
        assert least == pytest.approx(max(separation, required - band), abs=1e-9)


@pytest.mark.parametrize(("left", "ahead"), [(9.0, 0.0), (0.0, 12.0), (-6.0, -8.0)])
def test_the_whole_distance_from_the_plan_is_taken_off_its_separation(
    left: float, ahead: float
) -> None:
    reported = intruder_at(SPEED, BESIDE)
    _, exact = tell(flying(intruder_at(0.0, BESIDE)), 1.0, intruders=reported)
    own = on_plan(1.0, left=left, ahead=ahead)
    _, off = tell(flying(intruder_at(0.0, BESIDE)), 1.0, own, reported)
    lost = exact.separation.item() - off.separation.item()
    assert lost == pytest.approx(math.hypot(left, ahead), abs=1e-6)


def test_nothing_accumulates_while_the_ownship_is_not_seen() -> None:
    monitor = flying()
    for time in range(4):
        monitor, _ = tell(monitor, float(time), on_plan(float(time), left=20.0))
    before = monitor.sums
    assert before[0, 0] == pytest.approx(60.0, rel=0.1)
    nowhere: VehicleState = VehicleState(*(np.array([NAN]) for _ in range(4)))
    for time in range(4, 12):
        monitor, _ = tell(monitor, float(time), nowhere)
        assert (monitor.sums[0] <= before[0]).all()
        before = monitor.sums
    # A time constant later a share 1 / e is left.
    assert before[0, 0] == pytest.approx(60.0 * math.exp(-8.0 / THRESHOLDS.memory), rel=0.1)


def test_of_a_plan_that_is_not_flown_nothing_is_wanted_but_reports() -> None:
    monitor, decision = tell(flying(), 0.0, intruders=intruder_at(9_000.0, 0.0, math.pi))
    monitor, _ = reply(monitor, decision, safe=False)
    assert state_of(monitor) is State.BACKUP
    # Beside the plan, towards an intruder that flies otherwise than expected.
    monitor, decision = tell(
        monitor, 1.0, on_plan(1.0, left=500.0), intruder_at(8_900.0, 0.0, math.pi + 0.1)
    )
    of_plan = Cause.CROSS_TRACK | Cause.SEPARATION | Cause.INTRUDER_DEVIATION | Cause.ACCUMULATED
    assert not causes_of(monitor) & of_plan
    assert not int(decision.intruder_causes[0, 0]) & int(of_plan)
    gone = intruder_at(NAN, NAN)
    monitor, decision = tell(monitor, 2.0, on_plan(2.0, left=500.0), gone)
    assert causes_of(monitor) & Cause.INTRUDER_MISSING
    assert int(decision.intruder_causes[0, 0]) & int(Cause.INTRUDER_MISSING)


def test_without_a_plan_only_what_is_not_known_is_said() -> None:
    monitor = assurance.start(1, 1, THRESHOLDS)
    monitor, _ = tell(monitor, 0.0)
    monitor, _ = tell(monitor, 1.0, intruders=intruder_at(NAN, NAN))
    assert causes_of(monitor) == Cause(0)
    monitor, _ = tell(monitor, 20.0, intruders=intruder_at(NAN, NAN))
    assert causes_of(monitor) == Cause.INTRUDER_STALE
    assert state_of(monitor) is State.IDLE


@pytest.mark.parametrize(
    ("expected", "reported_std"), [(0.0, 0.0), (40.0, 0.0), (0.0, 30.0), (40.0, 30.0)]
)
def test_an_intruder_may_be_off_by_what_is_not_known_of_its_place(
    expected: float, reported_std: float
) -> None:
    allowed = THRESHOLDS.intruder_position + 3.0 * math.hypot(expected, reported_std)
    for share, there in ((0.97, False), (1.03, True)):
        # Ahead of where it is expected: its predicted separation stays the same.
        reported = intruder_at(share * allowed, BESIDE)
        monitor, decision = tell(
            flying_beside(expected),
            0.0,
            intruders=reported,
            position_std=np.full((1, 1), reported_std),
        )
        assert bool(causes_of(monitor) & Cause.INTRUDER_DEVIATION) is there
        assert decision.intruder_position.item() == pytest.approx(share * allowed)


@pytest.mark.parametrize(
    ("expected", "reported_std"), [(0.0, 0.0), (2.0, 0.0), (0.0, 1.5), (2.0, 1.5)]
)
def test_an_intruder_may_fly_otherwise_by_what_is_not_known_of_its_velocity(
    expected: float, reported_std: float
) -> None:
    allowed = THRESHOLDS.intruder_velocity + 3.0 * math.hypot(expected, reported_std)
    for share, there in ((0.97, False), (1.03, True)):
        reported = intruder_at(0.0, BESIDE, speed=SPEED + share * allowed)
        monitor, _ = tell(
            flying_beside(velocity_std=expected),
            0.0,
            intruders=reported,
            velocity_std=np.full((1, 1), reported_std),
        )
        assert bool(causes_of(monitor) & Cause.INTRUDER_DEVIATION) is there


def test_an_intruder_is_of_concern_by_as_much_more_as_its_own_separation() -> None:
    usual = THRESHOLDS.requirement.separation
    for more, there in ((0.0, False), (500.0, True)):
        beside = intruder_at(0.0, THRESHOLDS.concern + 200.0)
        own_separation = np.full((1, 1), usual + more)
        expected = Traffic.straight(beside)._replace(separation=own_separation)
        monitor = expecting(expected)
        slower = beside._replace(speed=beside.speed - 20.0)
        monitor, _ = tell(monitor, 0.0, intruders=slower, separation=own_separation)
        assert bool(causes_of(monitor) & Cause.INTRUDER_DEVIATION) is there


def test_who_was_not_expected_deviates_where_it_comes_near() -> None:
    for y, there in ((BESIDE, True), (50_000.0, False)):
        nobody = Traffic.straight(far(0.0), np.array([[False]]))
        monitor = expecting(nobody)
        monitor, decision = tell(monitor, 0.0, intruders=intruder_at(0.0, y))
        assert math.isinf(decision.intruder_position.item())
        assert bool(causes_of(monitor) & Cause.INTRUDER_DEVIATION) is there


def test_too_small_a_separation_is_over_only_a_band_above_what_began_it() -> None:
    requirement, band = THRESHOLDS.requirement, THRESHOLDS.separation_band
    least, wide = requirement.separation, requirement.separation + requirement.margin + 3.0 * band

    def is_lost(monitor: Any, time: float, y: float) -> tuple[Any, bool]:
        monitor, _ = tell(monitor, time, intruders=intruder_at(SPEED * time, y))
        return monitor, bool(causes_of(monitor) & Cause.SEPARATION)

    _, lost = is_lost(flying(), 0.0, least + 0.5 * band)
    assert not lost
    monitor = flying()
    for time, (y, expected) in enumerate(
        [
            (least - 1.0, True),
            (least + 0.5 * band, True),
            (wide, False),
            (least + 0.5 * band, False),
        ]
    ):
        monitor, lost = is_lost(monitor, float(time), y)
        assert lost is expected


def test_a_plan_that_began_inside_the_margin_is_held_to_what_it_kept_then() -> None:
    requirement = THRESHOLDS.requirement._replace(margin=50.0)
    thresholds = assurance.Thresholds.for_plans(
        replace(THRESHOLDS.options, requirement=requirement)
    )
    for y, there in ((1_005.0, False), (1_045.0, True)):
        monitor = assurance.activate(
            assurance.start(1, 1, thresholds),
            np.array([0]),
            straight(),
            np.array([True]),
            0.0,
            Traffic.straight(intruder_at(0.0, y)),
            thresholds,
        )
        # A little farther away, and back to 1008 m at the end of the plan.
        closing = math.asin((1_048.0 - 1_008.0) / (399.0 * SPEED))
        reported = intruder_at(SPEED, 1_048.0, -closing)
        given = assurance.inputs(1.0, on_plan(1.0), reported)
        monitor, _ = assurance.step(monitor, given, thresholds)
        assert bool(causes_of(monitor) & Cause.SEPARATION) is there
