"""Whatever the monitor is given: a reason where something is wrong, never a pass, never an
exception.
"""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents import assurance
from agents.assurance.inputs import blank, update
from agents.assurance.monitor import Cause, FlyMode, Inputs, State
from agents.assurance.thresholds import BLIND
from agents.kernel.traffic import Window
from envs.kinematics import VehicleState
from envs.trees import map_leaves, take
from tests.agents.scenes import (
    FAR,
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

GONE = VehicleState(*(np.array([NAN]) for _ in range(4)))
UNSEEN = VehicleState(*(np.full((1, 1), NAN) for _ in range(4)))


def flat(tree: Any) -> list[np.ndarray]:
    return (
        [leaf for part in tree for leaf in flat(part)]
        if isinstance(tree, tuple)
        else [np.asarray(tree)]
    )


@pytest.mark.parametrize("field", ["x", "y", "heading", "speed"])
@pytest.mark.parametrize("value", [NAN, math.inf, -math.inf, 1e9, -1e300])
def test_an_own_state_that_is_no_state_is_denied_and_holds_the_backup(
    field: str, value: float
) -> None:
    monitor, _ = tell(flying(), 0.0)
    held = monitor.backup
    for time in (1.0, 2.0, 30.0):
        own = on_plan(time)._replace(**{field: np.array([value])})
        monitor, decision = tell(monitor, time, own)
        assert state_of(monitor) is State.DENIED and causes_of(monitor) & Cause.OWN_MISSING
        assert decision.fly[0] == FlyMode.PLAN and not decision.replan[0]
        assert monitor.backup.started[0] == held.started[0] == 0.0
        np.testing.assert_array_equal(monitor.backup.plan_states.x, held.plan_states.x)
    monitor, _ = tell(monitor, 31.0)
    assert state_of(monitor) is State.MONITORING and monitor.backup.started[0] == 31.0


def test_a_flown_backup_goes_on_without_an_own_state() -> None:
    ahead = [intruder_at(9_000.0 - SPEED * time, 0.0, math.pi) for time in range(3)]
    monitor, decision = tell(flying(), 0.0, intruders=ahead[0])
    monitor, _ = reply(monitor, decision, safe=False)
    monitor, decision = tell(monitor, 1.0, GONE, ahead[1])
    assert (
        state_of(monitor) is State.DENIED
        and decision.fly[0] == FlyMode.BACKUP
        and not decision.replan[0]
    )
    assert np.isfinite(np.stack(assurance.references(monitor, 1.0, 0.1, 10))).all()
    monitor, decision = tell(monitor, 2.0, intruders=ahead[2])
    assert state_of(monitor) is State.BACKUP and decision.replan[0]


@pytest.mark.parametrize(
    ("age", "cause"),
    [(2.0, Cause.OWN_STALE), (NAN, Cause.OWN_MISSING), (-1.0, Cause.OWN_OUT_OF_ORDER)],
)
def test_the_own_age_counts(age: float, cause: Cause) -> None:
    monitor, _ = tell(flying(), 0.0)
    monitor, _ = tell(monitor, 3.0, own_age=np.array([age]))
    assert state_of(monitor) is State.DENIED and causes_of(monitor) & cause


def test_an_own_state_from_before_the_last_is_out_of_order() -> None:
    monitor, _ = tell(flying(), 0.0)
    monitor, _ = tell(monitor, 1.0)
    monitor, _ = tell(monitor, 2.0, on_plan(0.8), own_age=np.array([1.2]))
    assert causes_of(monitor) == Cause.OWN_OUT_OF_ORDER and state_of(monitor) is State.DENIED


def test_a_repeated_report_is_in_order_however_its_age_rounds() -> None:
    """Of times since 1970, now less age is rounded by up to 0.24 us, differently at every
    telling.
    """
    monitor, _ = tell(flying(), 0.0)
    known = []
    for later, jitter in enumerate((0.0, 4e-7, -4e-7, 4e-7)):
        ages = {"own_age": np.array([later + jitter]), "age": np.full((1, 1), later + jitter)}
        monitor, _ = tell(monitor, 1.0 + later, on_plan(1.0), far(1.0), **ages)
        assert not causes_of(monitor) & (Cause.OWN_OUT_OF_ORDER | Cause.INTRUDER_OUT_OF_ORDER)
        known.append((float(monitor.memory.own_time[0]), float(monitor.memory.reported[0, 0])))
    # And the times that are known never go back.
    assert known == sorted(known)


def test_an_old_own_state_is_carried_on() -> None:
    monitor, _ = tell(flying(), 0.0)
    monitor, decision = tell(monitor, 5.0, on_plan(4.0), own_age=np.array([1.0]))
    assert state_of(monitor) is State.MONITORING and decision.own.x[0] == pytest.approx(375.0)


@pytest.mark.parametrize("time", [5.0, 4.0, NAN, math.inf, -math.inf, 1e300])
def test_a_clock_that_does_not_go_on_is_denied(time: float) -> None:
    monitor, _ = tell(flying(), 5.0)
    monitor, _ = assurance.step(monitor, assurance.inputs(time, on_plan(5.0), far(5.0)), THRESHOLDS)
    assert state_of(monitor) is State.DENIED and causes_of(monitor) & Cause.CLOCK
    monitor, _ = tell(monitor, 6.0)
    assert state_of(monitor) is State.MONITORING


@pytest.mark.parametrize("value", [NAN, math.inf, 1e9])
def test_an_intruder_that_is_missing_asks_for_a_plan_and_then_denies(value: float) -> None:
    monitor, _ = tell(flying(), 0.0)
    states, asked = [], []
    for time in range(1, 8):
        reported = far(float(time))._replace(y=np.full((1, 1), value))
        monitor, decision = tell(monitor, float(time), intruders=reported)
        assert causes_of(monitor) & Cause.INTRUDER_MISSING
        states.append(state_of(monitor))
        asked.append(bool(decision.replan[0]))
        if decision.replan[0]:
            assert decision.traffic.state.x[0, 0] == pytest.approx(75.0 * time), "dead-reckoned"
            monitor, accepted = reply(monitor, decision, safe=True)
            assert accepted.all()
    assert states == [State.REPLAN_REQUESTED] * 5 + [State.DENIED] * 2
    assert asked == [True, False, True, False, True, False, False]
    assert causes_of(monitor) & Cause.INTRUDER_STALE


def test_a_lost_intruder_on_its_way_to_us_leads_to_the_backup() -> None:
    monitor, _ = tell(flying(), 0.0, intruders=intruder_at(9_000.0, 0.0, math.pi))
    monitor, _ = tell(monitor, 6.0, intruders=UNSEEN)
    assert state_of(monitor) is State.BACKUP and causes_of(monitor) & Cause.INTRUDER_STALE


def test_an_intruder_that_has_never_been_seen_is_denied() -> None:
    monitor, decision = tell(flying(), 0.0, intruders=UNSEEN)
    assert (
        state_of(monitor) is State.DENIED
        and not decision.replan[0]
        and not decision.traffic.mask.any()
    )


@pytest.mark.parametrize("age", [1.5, -1.0])
def test_an_intruder_out_of_order_changes_nothing_but_the_causes(age: float) -> None:
    monitor, _ = tell(flying(), 0.0)
    monitor, _ = tell(monitor, 1.0)
    monitor, decision = tell(monitor, 2.0, intruders=far(30.0), age=np.full((1, 1), age))
    assert causes_of(monitor) == Cause.INTRUDER_OUT_OF_ORDER and decision.replan[0]
    assert decision.traffic.state.x[0, 0] == pytest.approx(150.0)


def test_an_intruder_out_of_the_mask_is_forgotten() -> None:
    monitor, _ = tell(flying(), 0.0, intruders=intruder_at(9_000.0, 0.0, math.pi))
    assert causes_of(monitor) & Cause.SEPARATION
    monitor, _ = tell(monitor, 1.0, intruders=UNSEEN, mask=np.array([[False]]))
    assert state_of(monitor) is State.MONITORING and causes_of(monitor) == Cause(0)


def test_a_turn_is_expected_as_it_is_believed_within_what_an_aircraft_can() -> None:
    memory, most = blank(1, 4, np.full(1, 75.0)), THRESHOLDS.turn_rate_max
    rates = np.array([[0.03, 0.001, -0.03, -2.0 * most]])
    reported = VehicleState(
        *(np.zeros((1, 4)) for _ in range(2)), np.zeros((1, 4)), np.full((1, 4), 75.0)
    )
    given = assurance.inputs(0.0, on_plan(0.0), reported, turn_rate=rates)
    _, _own, traffic, *_causes = update(memory, given, THRESHOLDS)
    np.testing.assert_allclose(traffic.turn_rate[0], [0.03, 0.0, -0.03, -most])
    lasts = THRESHOLDS.turn_time
    np.testing.assert_allclose(traffic.turn_time[0], [lasts, 0.0, lasts, lasts])


def test_a_turn_rate_is_outside_the_domain_beyond_its_range_and_its_noise() -> None:
    _, most = THRESHOLDS.traffic["intruder_turn_rate"]
    for rate, std, there in (
        (most, 0.0, False),
        (1.2 * most, 0.0, True),
        (1.2 * most, 0.2 * most, False),
    ):
        more = {"turn_rate": np.full((1, 1), rate), "turn_std": np.full((1, 1), std)}
        memory, given = (
            blank(1, 1, np.full(1, SPEED)),
            assurance.inputs(0.0, on_plan(0.0), far(0.0), **more),
        )
        *_, causes = update(memory, given, THRESHOLDS)
        assert bool(causes[0, 0] & Cause.OUTSIDE_RANGE) is there


def story(generator: np.random.Generator, count: int, seconds: int) -> list[Inputs]:
    """Return reports of which one in twenty is spoilt."""
    given = []
    heading = generator.uniform(-math.pi, math.pi, (count, 2))
    turn = generator.choice([0.0, 0.02, -0.05], (count, 2))
    start = generator.uniform(-6_000.0, 6_000.0, (2, count, 2))
    for second in range(seconds):
        course = np.angle(np.exp(1j * (heading + turn * second)))
        x, y = (start[i] + 60.0 * second * f(heading) for i, f in enumerate((np.cos, np.sin)))
        reported = VehicleState(x, y, course, np.full((count, 2), 60.0))
        own = on_plan(float(second), count, left=generator.choice([0.0, 0.0, 20.0, 30.0]))

        def spoilt(field: np.ndarray) -> np.ndarray:
            wrong = generator.random(field.shape) < 0.0125
            return np.where(wrong, generator.choice([NAN, math.inf, -1e200]), field)

        given.append(
            Inputs(
                np.full(count, float(second)),
                map_leaves(spoilt, own),
                spoilt(generator.choice([0.0, 0.4], count)),
                map_leaves(spoilt, reported),
                spoilt(generator.choice([0.0, 1.3], (count, 2))),
                np.ones((count, 2), dtype=bool),
                np.zeros((count, 2)),
                spoilt(generator.choice([0.0, 2.0], (count, 2))),
                spoilt(turn),
                np.zeros((count, 2)),
            )
        )
    return given


def play(given: list[Inputs], rows: Any) -> list[tuple[Any, Any]]:
    """Play a story for some rows; every third request is answered by a plan."""
    monitor = take(flying(count=given[0].time.size), rows)
    room = assurance.start(monitor.state.size, 2, THRESHOLDS)
    monitor = assurance.activate(
        room,
        np.arange(monitor.state.size),
        straight(count=monitor.state.size),
        np.ones(monitor.state.size, bool),
        0.0,
        take(
            update(
                blank(given[0].time.size, 2, np.full(given[0].time.size, 75.0)),
                given[0],
                THRESHOLDS,
            )[2],
            rows,
        ),
        THRESHOLDS,
    )
    steps = []
    for second, inputs in enumerate(given):
        monitor, decision = assurance.step(monitor, take(inputs, rows), THRESHOLDS)
        asking = np.flatnonzero(decision.replan)
        monitor, _ = assurance.answer(
            monitor,
            asking,
            decision.number[asking],
            straight(float(second), asking.size),
            decision.number[asking] % 3 == 0,
            THRESHOLDS,
        )
        steps.append((monitor, decision))
    return steps


def test_one_aircraft_is_judged_alike_alone_and_in_any_company() -> None:
    given = story(np.random.default_rng(5), 12, 25)
    together = play(given, np.arange(12))
    assert len({int(code) for monitor, _ in together for code in monitor.state}) >= 4
    for rows in (np.array([3]), np.array([11, 0, 7])):
        alone = play(given, rows)
        for (monitor, decision), (part, part_decision) in zip(together, alone, strict=True):
            for a, b in zip(
                flat(take((monitor, decision), rows)), flat((part, part_decision)), strict=True
            ):
                if a.dtype == float:
                    np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-6)
                else:
                    np.testing.assert_array_equal(a, b)


wild = st.one_of(
    st.floats(), st.floats(-1e4, 1e4), st.sampled_from([0.0, 1.0, 75.0, NAN, math.inf, -math.inf])
)
calm = st.floats(-3e3, 3e3)


@st.composite
def anything(draw: st.DrawFn) -> Inputs:
    number = st.one_of(calm, wild)
    own = VehicleState(*(np.array([draw(number)]) for _ in range(4)))
    reported = VehicleState(*(np.array([[draw(number) for _ in range(2)]]) for _ in range(4)))
    pairs = [np.array([[draw(st.one_of(st.just(0.0), wild)) for _ in range(2)]]) for _ in range(5)]
    mask = np.array([[draw(st.booleans()) for _ in range(2)]])
    time = np.array([draw(st.one_of(st.floats(0.0, 100.0), wild))])
    return Inputs(
        time,
        own,
        np.array([draw(st.one_of(st.just(0.0), wild))]),
        reported,
        pairs[0],
        mask,
        pairs[1],
        pairs[2],
        pairs[3],
        pairs[4],
    )


@given(st.lists(anything(), min_size=1, max_size=5), st.booleans())
def test_any_input_gives_a_reason_or_a_valid_state(given: list[Inputs], safe: bool) -> None:
    monitor = assurance.activate(
        assurance.start(1, 2, THRESHOLDS),
        np.array([0]),
        straight(),
        np.array([safe]),
        0.0,
        blank_traffic(),
        THRESHOLDS,
    )
    sighted = False
    for inputs in given:
        monitor, decision = assurance.step(monitor, inputs, THRESHOLDS)
        state, causes = state_of(monitor), causes_of(monitor)
        finite = np.isfinite(np.concatenate(list(inputs.own))).all()
        wrong = not (finite and np.isfinite(inputs.own_age[0]) and np.isfinite(inputs.time[0]))
        assert not wrong or causes & BLIND
        assert (state is State.DENIED) if causes & BLIND else (state is not State.IDLE)
        if state is State.MONITORING:
            assert (
                not causes & ~Cause.BACKUP_UNSAFE
                and decision.traffic.mask[0].sum() == inputs.mask[0].sum()
            )
        sighted = sighted or not causes & BLIND
        assert np.isfinite(np.stack(monitor.backup.plan_states)).all()
        assert np.isfinite(monitor.backup.started[0]) == sighted, (
            "from the first own state on there is a backup"
        )
        assert np.isfinite(
            np.stack(assurance.references(monitor, monitor.memory.time, 0.1, 2))
        ).all()
        if decision.replan[0]:
            monitor, _ = reply(monitor, decision, safe=False)


def blank_traffic() -> Any:
    return update(
        blank(1, 2, np.full(1, 75.0)),
        assurance.inputs(
            0.0, on_plan(0.0), map_leaves(lambda f: np.full((1, 2), NAN), on_plan(0.0))
        ),
        THRESHOLDS,
    )[2]


def test_an_aged_turn_is_advanced_along_its_arc_and_lasts_less() -> None:
    memory = blank(1, 1, np.full(1, 75.0))
    known = {"age": np.full((1, 1), 2.0), "turn_rate": np.full((1, 1), 0.03)}
    given = assurance.inputs(3.0, on_plan(3.0), intruder_at(0.0, 0.0, 0.03), **known)
    _, _own, traffic, *_causes = update(memory, given, THRESHOLDS)
    assert traffic.turn_rate[0, 0] == pytest.approx(0.03)
    assert traffic.turn_time[0, 0] == pytest.approx(THRESHOLDS.turn_time - 2.0)
    radius, turned = 75.0 / 0.03, 0.03 * 3.0
    assert traffic.state.heading[0, 0] == pytest.approx(turned)
    assert traffic.state.x[0, 0] == pytest.approx(
        radius * (math.sin(turned) - math.sin(0.03)), abs=1e-6
    )
    assert traffic.state.y[0, 0] == pytest.approx(
        radius * (math.cos(0.03) - math.cos(turned)), abs=1e-6
    )


@pytest.mark.parametrize("std", [NAN, math.inf, -1.0, 1e5])
@pytest.mark.parametrize("name", ["position_std", "velocity_std"])
def test_a_report_whose_accuracy_is_no_size_is_no_report(name: str, std: float) -> None:
    monitor, _ = tell(flying(), 0.0)
    monitor, _ = tell(monitor, 1.0, **{name: np.full((1, 1), std)})
    assert causes_of(monitor) & Cause.INTRUDER_MISSING
    assert monitor.memory.reported[0, 0] == 0.0
    assert monitor.memory.position_std[0, 0] == monitor.memory.velocity_std[0, 0] == 0.0


@pytest.mark.parametrize(
    ("time", "age"), [(1.0, 0.0), (0.5, 0.0), (NAN, 0.0), (2.0, 1.2), (2.0, -1.0)]
)
def test_what_does_not_count_changes_nothing_that_is_remembered(time: float, age: float) -> None:
    """A clock that does not go on, and reports from before the last ones or from the future."""
    monitor, _ = tell(flying(), 0.0)
    monitor, _ = tell(monitor, 1.0)
    before = monitor.memory
    given = assurance.inputs(
        time,
        on_plan(1.0, left=7.0),
        intruder_at(500.0, 9_000.0),
        own_age=np.array([age]),
        age=np.full((1, 1), age),
        position_std=np.full((1, 1), 3.0),
    )
    after = assurance.step(monitor, given, THRESHOLDS)[0].memory
    for name in (
        "own",
        "own_time",
        "intruders",
        "reported",
        "position_std",
        "turn_rate",
        "turn_std",
    ):
        for old, new in zip(flat(getattr(before, name)), flat(getattr(after, name)), strict=True):
            np.testing.assert_array_equal(old, new)


def test_of_an_intruder_that_comes_back_nothing_from_before_counts() -> None:
    monitor, _ = tell(flying(), 0.0)
    monitor, _ = tell(monitor, 1.0, intruders=UNSEEN, mask=np.array([[False]]))
    monitor, decision = tell(monitor, 2.0, intruders=intruder_at(8_000.0, 40_000.0, 2.0))
    assert decision.traffic.turn_rate[0, 0] == 0.0
    # What it sends may be older than what the one before it sent.
    monitor, _ = tell(monitor, 3.0, intruders=UNSEEN, mask=np.array([[False]]))
    monitor, _ = tell(monitor, 4.0, age=np.full((1, 1), 2.5))
    assert not causes_of(monitor) & Cause.INTRUDER_OUT_OF_ORDER


@pytest.mark.parametrize("name", ["position_std", "velocity_std"])
def test_a_declared_noise_is_outside_the_domain_beyond_its_range(name: str) -> None:
    _, most = THRESHOLDS.traffic[name]
    for share, there in ((0.99, False), (1.01, True)):
        monitor, _ = tell(flying(), 0.0, **{name: np.full((1, 1), share * most)})
        assert bool(causes_of(monitor) & Cause.OUTSIDE_RANGE) is there


@pytest.mark.parametrize(
    ("std", "over", "there"),
    [(0.0, -0.1, False), (0.0, 2.0, True), (2.0, 9.0, False), (2.0, 14.0, True)],
)
def test_a_speed_is_outside_the_domain_beyond_its_range_and_its_noise(
    std: float, over: float, there: bool
) -> None:
    _, most = THRESHOLDS.traffic["intruder_speed"]
    reported = far(0.0)._replace(speed=np.full((1, 1), most + over))
    monitor, _ = tell(flying(), 0.0, intruders=reported, velocity_std=np.full((1, 1), std))
    assert bool(causes_of(monitor) & Cause.OUTSIDE_RANGE) is there


def test_an_intruder_is_lost_when_its_last_report_is_older_than_plans_may_use() -> None:
    for late, there in ((-0.01, False), (0.01, True)):
        monitor, _ = tell(flying(), 0.0)
        monitor, _ = tell(monitor, THRESHOLDS.intruder_age + late, intruders=UNSEEN)
        assert bool(causes_of(monitor) & Cause.INTRUDER_STALE) is there


def test_nothing_is_outside_the_domain_of_an_intruder_that_has_never_been_seen() -> None:
    monitor, _ = tell(flying(), 0.0, intruders=UNSEEN)
    assert not causes_of(monitor) & Cause.OUTSIDE_RANGE


def test_when_an_intruder_counts_goes_on_with_the_clock() -> None:
    window = Window(np.full((1, 1), 10.0), np.full((1, 1), 40.0))
    monitor, _ = tell(flying(), 0.0, window=window)
    for time in (1.0, 4.0):
        monitor, decision = tell(monitor, time, intruders=UNSEEN)
        left = decision.traffic.window
        assert left is not None
        assert left.begin.item() == pytest.approx(10.0 - time)
        assert left.end.item() == pytest.approx(40.0 - time)


def test_a_turn_lasts_over_a_repeated_report() -> None:
    monitor, turn = flying(), {"turn_rate": np.full((1, 1), 0.03)}
    monitor, _ = tell(monitor, 0.0, intruders=intruder_at(*FAR), **turn)
    again = {"intruders": intruder_at(*FAR, heading=0.5), "age": np.full((1, 1), 2.0)}
    _, decision = tell(monitor, 1.0, **again)
    assert decision.traffic.turn_rate.item() == pytest.approx(0.03), "that report is too old"


@pytest.mark.parametrize(
    "given",
    [
        {"separation": np.array([[-1_000.0]])},
        {"separation": np.array([[math.inf]])},
        {"window": Window(np.array([[NAN]]), np.array([[math.inf]]))},
        {"window": Window(np.array([[-math.inf]]), np.array([[NAN]]))},
    ],
    ids=str,
)
def test_a_broken_separation_or_window_makes_the_report_missing(given: dict[str, Any]) -> None:
    ahead = intruder_at(5_000.0, 0.0, math.pi)
    monitor, _ = tell(flying(), 0.0, intruders=ahead, **given)
    assert state_of(monitor) is State.DENIED and causes_of(monitor) & Cause.INTRUDER_MISSING
