"""Least-cost witnesses must fly, cost no more than any escape known before, and depend on no other encounter."""

import numpy as np
import pytest

from agents.manoeuvres.escape_search import search
from agents.resolvability.classify import Method, classify, least_cost, replay
from agents.resolvability.witness import SECOND
from envs.encounters import Encounter, scenario
from envs.kinematics import SURROGATE
from envs.outcome import RULES
from envs.starts import joined, numbered
from envs.trees import take
from tests.agents.resolvability.scenes import CLOSE, check_witness, duel, reflected

QUICK = RULES._replace(t_max=150.0)
"""Time enough for short encounters."""

FEW = 4
"""Rounds of refinement: enough for the properties, not for the best cost."""


@pytest.fixture(scope="module")
def encounters() -> Encounter:
    """Conflicts, manoeuvring intruders, and close starts, some of them beyond help: 11."""
    conflicts = numbered(scenario("circle", radius=(3_000.0, 3_200.0), conflicts_closer_than=1_000.0), 1, 0, 4)
    turning = numbered(scenario("maneuvering", radius=(3_000.0, 3_200.0)), 1, 0, 4)
    return joined(joined(conflicts, turning), numbered(CLOSE, 1, 0, 3))


@pytest.fixture(scope="module")
def witnesses(encounters: Encounter):
    return least_cost(encounters, QUICK, SURROGATE, rounds=FEW)


def test_witnesses_succeed_in_an_independent_simulation(encounters: Encounter, witnesses):
    known = np.flatnonzero(~np.isnan(witnesses.path))
    assert known.size >= 8
    for number in known[::2]:
        encounter = take(encounters, number)
        flown = replay(encounter, take(witnesses.manoeuvre, number), QUICK, SURROGATE)
        check_witness(encounter, flown)
        assert flown.time[-1] == witnesses.arrival[number]
        assert flown.separation.min() == pytest.approx(witnesses.separation[number], abs=1e-5)
        # The last step counts up to the goal's circle only.
        length = np.cumsum(0.5 * (flown.own.speed[1:] + flown.own.speed[:-1]))
        assert length[-2] - 1e-6 <= witnesses.path[number] <= length[-1] + 1e-6


def test_no_witness_is_cheaper_than_the_straight_line_or_dearer_than_the_first_found(encounters: Encounter, witnesses):
    own = encounters.own
    straight = np.hypot(encounters.goal_x - own.x, encounters.goal_y - own.y) - QUICK.goal_radius
    found = search(encounters, QUICK, SURROGATE)
    np.testing.assert_array_equal(np.isnan(witnesses.path), np.isnan(found.path))
    known = ~np.isnan(found.path)
    # Where the goal's circle is entered inside a step is known to a fraction of a metre only.
    assert (witnesses.path[known] >= straight[known] - 1.0).all()
    dearer = witnesses.path + SECOND * witnesses.arrival - found.path - SECOND * found.arrival
    assert dearer[known].max() <= 1e-9
    assert dearer[known].min() < -10.0


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
    some = take(encounters, slice(0, 4))
    again = least_cost(some, QUICK, SURROGATE, start=take(witnesses.manoeuvre, slice(0, 4)), rounds=1)
    cost, before = (w.path + SECOND * w.arrival for w in (again, take(witnesses, slice(0, 4))))
    assert (cost <= before).all()
    judged = classify(some, QUICK, SURROGATE)
    assert (judged.method == Method.SEARCH).all()


def test_witnesses_depend_on_neither_batch_nor_order(encounters: Encounter, witnesses):
    order = np.array([7, 3, 9])
    again = least_cost(take(encounters, order), QUICK, SURROGATE, rounds=FEW)
    np.testing.assert_array_equal(again.path, witnesses.path[order])
    np.testing.assert_array_equal(np.stack(again.manoeuvre), np.stack(witnesses.manoeuvre)[:, order])


def test_the_cost_hardly_knows_left_from_right(encounters: Encounter, witnesses):
    here = witnesses.path[:6]
    there = least_cost(reflected(take(encounters, slice(0, 6))), QUICK, SURROGATE, rounds=FEW)
    ratio = there.path / here
    known = ~np.isnan(here)
    assert np.isnan(there.path[~known]).all()
    # The refinement draws at random, so that both sides end a little apart.
    np.testing.assert_allclose(ratio[known], 1.0, atol=0.02)
    assert np.mean(np.abs(ratio[known] - 1.0)) < 0.003
