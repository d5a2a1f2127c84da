"""Witnesses must fly, proofs must hold, and the two must never contradict each other."""

import math

import numpy as np
import pytest

from agents.manoeuvres.escape_manoeuvre import Manoeuvre, steps
from agents.manoeuvres.escape_search import search
from agents.resolvability.classify import Method, Verdict, classify, replay
from agents.resolvability.proof import containment_time, look_ahead, split
from agents.resolvability.reachable_bound import (
    EPSILON,
    delta,
    relax,
)
from agents.resolvability.witness import SECOND, least_cost
from envs.aircraft import PAPER
from envs.encounters import Encounter, Scenario
from envs.intruder import Intent
from envs.kinematics import C208_PUBLISHED, SURROGATE, Limits, VehicleState
from envs.outcome import RULES
from envs.scenarios import scenario
from envs.starts import encounters_of_seed, join
from envs.trees import take
from tests.agents.scenes import CLOSE, CROWDED, check_witness, duel, reflect


@pytest.mark.parametrize(
    ("family", "count"),
    [
        (scenario("circle", PAPER), 12),
        (CLOSE, 12),
        (scenario("maneuvering", PAPER), 12),
        pytest.param(scenario("multi", PAPER), 20, marks=pytest.mark.slow),
    ],
)
def test_witnesses_succeed_in_an_independent_simulation(family: Scenario, count: int):
    encounters = encounters_of_seed(family, 3, 0, count)
    judged = classify(encounters, RULES, SURROGATE)
    solved = np.flatnonzero(judged.method == Method.SEARCH)
    assert solved.size > 0.5 * count
    hardest = solved[np.argsort(judged.separation[solved])[:2]]
    for number in np.unique([*hardest, solved[0]]):
        encounter = take(encounters, number)
        flown = replay(encounter, take(judged.witness, number), RULES, SURROGATE)
        check_witness(encounter, flown)
        assert flown.time[-1] == judged.arrival[number]
        assert flown.separation.min() == pytest.approx(judged.separation[number], abs=1e-6)
        assert flown.separation.shape == (flown.time.size - 1,) == (flown.own.x.size - 1,)
        assert flown.intruders.x.shape == (flown.time.size, encounter.mask.size)


def test_nearly_every_circle_encounter_is_decided():
    judged = classify(encounters_of_seed(scenario("circle", PAPER), 11, 0, 400), RULES, SURROGATE)
    assert np.mean(judged.verdict == Verdict.UNDECIDED) <= 0.005
    assert np.mean(judged.verdict == Verdict.RESOLVABLE) > 0.99


def test_head_on_is_lost_at_short_range_and_won_at_long_range():
    judged = classify(duel([900.0, 1_500.0, 2_500.0, 6_000.0, 12_000.0]), RULES, SURROGATE)
    lost, won = Verdict.UNRESOLVABLE, Verdict.RESOLVABLE
    assert judged.verdict.tolist() == [lost, lost, lost, won, won]
    assert judged.method.tolist()[:2] == [Method.START, Method.CONTAINMENT]
    # The discs touch when the range has closed to the separation, and no proof can be had before.
    assert judged.proof_time[1] >= 500.0 / 150.0
    assert judged.proof_time[0] == 0.0
    assert np.isnan(judged.proof_time[3:]).all()


def test_the_verdict_changes_once_as_the_range_opens():
    judged = classify(duel(np.arange(2_600.0, 4_400.0, 100.0)), RULES, SURROGATE)
    rank = np.array([1, 2, 0])[judged.verdict]
    assert (np.diff(rank) >= 0).all()
    assert rank[0] == 0
    assert rank[-1] == 2
    assert np.sum(rank == 1) <= 1


def test_a_goal_out_of_reach_is_unresolvable():
    encounters = duel([12_000.0, 12_000.0], course=0.0)
    rules = RULES._replace(t_max=120.0)
    near = encounters._replace(goal_x=np.array([15_000.0, 9_000.0]))
    judged = classify(near, rules, SURROGATE)
    assert judged.verdict.tolist() == [Verdict.UNRESOLVABLE, Verdict.RESOLVABLE]
    assert judged.method[0] == Method.GOAL
    assert judged.proof_time[0] == 120.0
    # Behind, it costs a turn about: out of reach although not too far for a straight flight.
    behind = near._replace(goal_x=np.array([-9_800.0, -5_000.0]))
    assert classify(behind, rules, SURROGATE).verdict.tolist() == [
        Verdict.UNRESOLVABLE,
        Verdict.RESOLVABLE,
    ]


def test_a_violation_beyond_the_goal_proves_nothing():
    # The collision course is deadly, but the goal comes first.
    encounter = duel([2_400.0])
    assert classify(encounter, RULES, SURROGATE).verdict[0] == Verdict.UNRESOLVABLE
    assert (
        classify(encounter._replace(goal_x=np.array([1_000.0])), RULES, SURROGATE).verdict[0]
        == Verdict.RESOLVABLE
    )


def test_a_goal_beside_the_ownship_lies_inside_its_turning_circle():
    encounters = duel([9_000.0] * 3, course=0.0)
    encounters = encounters._replace(
        goal_x=np.array([0.0, 500.0, -500.0]), goal_y=np.array([1_000.0, 900.0, -1_200.0])
    )
    judged = classify(encounters, RULES, SURROGATE)
    assert (judged.verdict == Verdict.RESOLVABLE).all()


@pytest.mark.slow
def test_no_proof_touches_a_solved_encounter():
    for family, count in (
        (CLOSE, 300),
        (scenario("maneuvering", PAPER, radius=(1_500.0, 5_000.0)), 200),
        (CROWDED, 60),
    ):
        encounters = encounters_of_seed(family, 5, 0, count)
        ahead = look_ahead(encounters, RULES, SURROGATE)
        unproven = np.flatnonzero(np.isnan(containment_time(ahead, RULES, SURROGATE)))
        solutions = search(take(encounters, unproven), RULES, SURROGATE)
        solved = unproven[~np.isnan(solutions.arrival)]
        tight = solved[np.argsort(solutions.separation[~np.isnan(solutions.arrival)])[:6]]
        assert np.isnan(split(take(ahead, tight), RULES, SURROGATE, nodes=40)).all()


@pytest.mark.slow
def test_no_search_finds_a_way_out_of_what_is_proven():
    encounters = encounters_of_seed(CLOSE, 6, 0, 2_000)
    ahead = look_ahead(encounters, RULES, SURROGATE)
    times = containment_time(ahead, RULES, SURROGATE)
    doomed = np.flatnonzero(times > 0.0)
    assert doomed.size > 100
    # Those proven last are the nearest to a way out.
    last = doomed[np.argsort(-times[doomed])[:24]]
    assert np.isnan(search(take(encounters, last), RULES, SURROGATE).arrival).all()


def test_a_proof_survives_what_makes_the_task_harder():
    encounters = encounters_of_seed(CLOSE, 8, 0, 100)
    wider = Limits(45.0, 110.0, -0.6, 0.6, math.radians(3.5))
    assert C208_PUBLISHED.yaw_rate_max > wider.yaw_rate_max
    proven = ~np.isnan(containment_time(look_ahead(encounters, RULES, SURROGATE), RULES, SURROGATE))
    for rules, limits in ((RULES._replace(separation=900.0), SURROGATE), (RULES, wider)):
        easier = containment_time(look_ahead(encounters, rules, limits), rules, limits)
        assert proven[~np.isnan(easier)].all()
        assert np.isnan(easier).sum() > (~proven).sum()
    # An easier task never turns a witness into a proof.
    sample = take(encounters, slice(0, 20))
    usual = classify(sample, RULES, SURROGATE).verdict
    for rules, limits in ((RULES._replace(separation=950.0), SURROGATE), (RULES, wider)):
        harder = classify(sample, rules, limits).verdict
        assert not np.any((usual == Verdict.RESOLVABLE) & (harder == Verdict.UNRESOLVABLE))


@pytest.mark.slow
@pytest.mark.parametrize(
    "family", [scenario("circle", PAPER), scenario("maneuvering", PAPER), CLOSE]
)
def test_verdicts_do_not_know_left_from_right(family: Scenario):
    encounters = encounters_of_seed(family, 9, 0, 80)
    original = classify(encounters, RULES, SURROGATE)
    mirrored = classify(reflect(encounters), RULES, SURROGATE)
    differ = original.verdict != mirrored.verdict
    # The refinement draws at random: what it finds only on one side is undecided on the other,
    # never disproven.
    assert np.all((np.minimum(original.verdict, mirrored.verdict) == Verdict.UNDECIDED)[differ])
    assert differ.sum() <= 1


def test_verdicts_do_not_depend_on_the_batch():
    encounters = encounters_of_seed(CLOSE, 10, 0, 60)
    whole = classify(encounters, RULES, SURROGATE)
    parts = [classify(take(encounters, slice(i, i + 20)), RULES, SURROGATE) for i in (0, 20, 40)]
    np.testing.assert_array_equal(whole.verdict, np.concatenate([part.verdict for part in parts]))
    np.testing.assert_array_equal(whole.arrival, np.concatenate([part.arrival for part in parts]))


def test_an_absent_intruder_does_not_count():
    encounters = duel([1_500.0])
    crowd = encounters._replace(
        intruders=VehicleState(*(np.tile(field, (1, 2)) for field in encounters.intruders)),
        mask=np.array([[True, False]]),
        intent=Intent(*(np.tile(field, (1, 2)) for field in encounters.intent)),
    )
    assert classify(crowd, RULES, SURROGATE).verdict[0] == Verdict.UNRESOLVABLE
    far = crowd._replace(intruders=crowd.intruders._replace(x=np.array([[30_000.0, 1_500.0]])))
    assert classify(far, RULES, SURROGATE).verdict[0] == Verdict.RESOLVABLE


def test_what_others_have_solved_is_resolvable_without_a_search():
    judged = classify(duel([900.0, 12_000.0]), RULES, SURROGATE, solved=np.array([False, True]))
    assert judged.verdict.tolist() == [Verdict.UNRESOLVABLE, Verdict.RESOLVABLE]
    assert judged.method.tolist() == [Method.START, Method.SOLVED_ELSEWHERE]
    assert judged.verdict.dtype == judged.method.dtype == np.int8
    assert np.isnan(judged.arrival[1])
    with pytest.raises(ValueError, match="no witness"):
        replay(take(duel([900.0]), 0), take(judged.witness, 0), RULES, SURROGATE)


def test_wrong_shapes_are_refused():
    with pytest.raises(ValueError, match="leading axis"):
        classify(take(duel([900.0]), 0), RULES, SURROGATE)
    with pytest.raises(ValueError, match=r"bool \[1\]"):
        classify(duel([900.0]), RULES, SURROGATE, solved=np.array([True, False]))


SHORT = RULES._replace(t_max=60.0)
"""Time enough for a goal 3 km away."""


@pytest.mark.slow
def test_the_margins_of_a_proof_are_honoured():
    assert delta(RULES, SURROGATE) == 0.1
    assert EPSILON == 1e-4
    assert relax(SURROGATE).yaw_rate_max == pytest.approx(SURROGATE.yaw_rate_max * 1.0001)
    assert relax(SURROGATE).speed_min < SURROGATE.speed_min
    # Half the margin short of the separation and opening: a violation, but no proof.
    ahead = duel([999.95, 999.5], course=0.0, speed=50.0, intruder_speed=100.0)
    opening = ahead._replace(goal_x=np.full(2, 3_000.0))
    assert classify(opening, SHORT, SURROGATE).verdict.tolist() == [
        Verdict.UNDECIDED,
        Verdict.UNRESOLVABLE,
    ]
    half_a_metre = take(opening, slice(1, 2))
    assert classify(half_a_metre, SHORT, SURROGATE, reserve=0.75).verdict[0] == Verdict.UNDECIDED
    assert steps(RULES) == 300
    assert len(Manoeuvre._fields) == 8


# Least-cost witnesses must fly, cost no more than any escape known before, and depend on no other
# encounter.

QUICK = RULES._replace(t_max=150.0)
"""Time enough for short encounters."""
FEW = 4
"""Rounds of refinement: enough for the properties, not for the best cost."""


@pytest.fixture(scope="module")
def encounters() -> Encounter:
    """Conflicts, manoeuvring intruders, and close starts, some of them beyond help: 11."""
    conflicts = encounters_of_seed(
        scenario("circle", PAPER, radius=(3_000.0, 3_200.0), conflicts_closer_than=1_000.0), 1, 0, 4
    )
    turning = encounters_of_seed(scenario("maneuvering", PAPER, radius=(3_000.0, 3_200.0)), 1, 0, 4)
    return join(join(conflicts, turning), encounters_of_seed(CLOSE, 1, 0, 3))


@pytest.fixture(scope="module")
def witnesses(encounters: Encounter):
    return least_cost(encounters, QUICK, SURROGATE, rounds=FEW)


@pytest.mark.slow
def test_least_cost_witnesses_succeed_in_an_independent_simulation(
    encounters: Encounter, witnesses
):
    solved = np.flatnonzero(~np.isnan(witnesses.path))
    assert solved.size >= 8
    for number in solved[::3]:
        encounter = take(encounters, number)
        flown = replay(encounter, take(witnesses.manoeuvre, number), QUICK, SURROGATE)
        check_witness(encounter, flown)
        assert flown.time[-1] == witnesses.arrival[number]
        assert flown.separation.min() == pytest.approx(witnesses.separation[number], abs=1e-5)
        # The last step counts up to the goal's circle only.
        length = np.cumsum(0.5 * (flown.own.speed[1:] + flown.own.speed[:-1]))
        assert length[-2] - 1e-6 <= witnesses.path[number] <= length[-1] + 1e-6


@pytest.mark.slow
def test_no_witness_is_cheaper_than_the_straight_line_or_dearer_than_the_first_found(
    encounters: Encounter, witnesses
):
    own = encounters.own
    straight = np.hypot(encounters.goal_x - own.x, encounters.goal_y - own.y) - QUICK.goal_radius
    first_solutions = search(encounters, QUICK, SURROGATE)
    np.testing.assert_array_equal(np.isnan(witnesses.path), np.isnan(first_solutions.path))
    solved = ~np.isnan(first_solutions.path)
    # Where the goal's circle is entered inside a step is known to a fraction of a metre only.
    assert (witnesses.path[solved] >= straight[solved] - 1.0).all()
    dearer = (
        witnesses.path
        + SECOND * witnesses.arrival
        - first_solutions.path
        - SECOND * first_solutions.arrival
    )
    assert dearer[solved].max() <= 1e-9
    assert dearer[solved].min() < -10.0


def test_what_cannot_be_resolved_has_no_witness():
    encounters = duel([900.0])
    none = least_cost(encounters, QUICK, SURROGATE, rounds=1)
    assert np.isnan(none.path).all()
    assert np.isnan(none.arrival).all()
    assert np.isnan(np.stack(none.manoeuvre)).all()
    with pytest.raises(ValueError, match="no witness"):
        replay(take(encounters, 0), take(none.manoeuvre, 0), QUICK, SURROGATE)
    with pytest.raises(ValueError, match="leading axis"):
        least_cost(take(encounters, 0), QUICK, SURROGATE)


def test_a_clear_way_is_flown_straight():
    encounter = duel([9_000.0], course=0.0)._replace(goal_x=np.array([8_000.0]))
    witness = least_cost(encounter, QUICK, SURROGATE, rounds=1)
    assert witness.path[0] == pytest.approx(7_500.0, abs=0.1)
    # As fast as it gets, since a second costs a little too.
    assert witness.arrival[0] <= 88.0


def test_a_start_that_is_known_already_is_never_made_worse(encounters: Encounter, witnesses):
    sample = take(encounters, slice(0, 4))
    again = least_cost(
        sample, QUICK, SURROGATE, start=take(witnesses.manoeuvre, slice(0, 4)), rounds=1
    )
    cost, before = (w.path + SECOND * w.arrival for w in (again, take(witnesses, slice(0, 4))))
    assert (cost <= before).all()
    judged = classify(sample, QUICK, SURROGATE)
    assert (judged.method == Method.SEARCH).all()


def test_witnesses_depend_on_neither_batch_nor_order(encounters: Encounter, witnesses):
    order = np.array([7, 3])
    again = least_cost(take(encounters, order), QUICK, SURROGATE, rounds=FEW)
    np.testing.assert_array_equal(again.path, witnesses.path[order])
    np.testing.assert_array_equal(
        np.stack(again.manoeuvre), np.stack(witnesses.manoeuvre)[:, order]
    )


def test_the_cost_hardly_knows_left_from_right(encounters: Encounter, witnesses):
    original = witnesses.path[[0, 1, 4, 5]]
    mirrored = least_cost(reflect(take(encounters, [0, 1, 4, 5])), QUICK, SURROGATE, rounds=FEW)
    ratio = mirrored.path / original
    solved = ~np.isnan(original)
    assert np.isnan(mirrored.path[~solved]).all()
    # The refinement draws at random, so that both sides end a little apart.
    np.testing.assert_allclose(ratio[solved], 1.0, atol=0.02)
    assert np.mean(np.abs(ratio[solved] - 1.0)) < 0.003
