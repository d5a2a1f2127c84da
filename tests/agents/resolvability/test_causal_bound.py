"""The oracle without foresight must fly what it claims, never beat a proof, and see nothing of the intents."""

import math

import numpy as np
import pytest

from agents.manoeuvres.escape_manoeuvre import steps, tracks
from agents.resolvability.causal_bound import Causal, Foresight, causal
from agents.resolvability.classify import Replay
from agents.resolvability.proof import contained, look_ahead
from envs.encounters import Encounter, scenario
from envs.kinematics import SURROGATE, VehicleState
from envs.outcome import RULES
from envs.starts import joined, numbered
from envs.trees import take
from tests.agents.resolvability.scenes import CLOSE, check_witness, duel

SHORT = (3_000.0, 3_200.0)

QUICK = RULES._replace(t_max=150.0)
"""Time enough for short encounters."""


@pytest.fixture(scope="module")
def encounters() -> Encounter:
    straight = numbered(scenario("circle", radius=SHORT, conflicts_closer_than=1_000.0), 2, 0, 3)
    return joined(straight, numbered(scenario("maneuvering", radius=SHORT), 2, 0, 3))


@pytest.fixture(scope="module")
def flown(encounters: Encounter) -> Causal:
    return causal(encounters, QUICK, SURROGATE)


def recorded(encounter: Encounter, result: Causal, number: int) -> Replay:
    """Return one flight of the oracle against the true intruders, flown alone."""
    count = int(np.sum(~np.isnan(result.own.x[:, number])))
    traffic = VehicleState(*(field[:count] for field in tracks(encounter, steps(QUICK), QUICK)))
    own = VehicleState(*(field[:count, number] for field in result.own))
    return Replay(np.arange(count) * QUICK.dt, own, traffic, np.zeros(count - 1))


def test_what_it_solves_is_solved_in_an_independent_simulation(encounters: Encounter, flown: Causal):
    assert flown.solved[:3].all()
    assert flown.solved.sum() >= 5
    for number in np.flatnonzero(flown.solved):
        encounter = take(encounters, number)
        alone = recorded(encounter, flown, int(number))
        check_witness(encounter, alone)
        assert alone.time[-1] == flown.arrival[number]
        apart = np.hypot(alone.intruders.x[:, 0] - alone.own.x, alone.intruders.y[:, 0] - alone.own.y)
        assert apart.min() >= flown.separation[number] - 0.1 >= QUICK.separation - 0.1
        length = 0.5 * np.sum(alone.own.speed[1:] + alone.own.speed[:-1])
        assert flown.path[number] == pytest.approx(length)


def test_it_never_solves_what_is_proven_unresolvable():
    encounters = numbered(CLOSE, 6, 0, 300)
    proven = ~np.isnan(contained(look_ahead(encounters, QUICK, SURROGATE), QUICK, SURROGATE))
    assert proven.sum() > 20
    lost = causal(take(encounters, np.flatnonzero(proven)[:4]), QUICK, SURROGATE)
    assert (lost.outcome == 0).all()
    assert np.isnan(lost.arrival).all()
    assert (lost.separation < QUICK.separation).all()


def test_it_does_not_see_an_intent_before_it_shows():
    encounter = duel([7_000.0], course=math.pi + 0.3)._replace(goal_x=np.array([7_000.0]))
    intent = encounter.intent._replace(onset=np.array([[20.0]]), heading_change=np.array([[-0.5]]))
    one, other = (
        causal(each, QUICK._replace(t_max=100.0), SURROGATE) for each in (encounter._replace(intent=intent), encounter)
    )
    # The turn begins at 20 s, shows at 21 s, and changes what is flown from then on.
    np.testing.assert_array_equal(one.own.heading[:22], other.own.heading[:22])
    np.testing.assert_array_equal(one.own.x[:22], other.own.x[:22])
    assert not np.array_equal(one.own.x, other.own.x, equal_nan=True)


def test_it_depends_on_neither_batch_nor_order(encounters: Encounter, flown: Causal):
    order = np.array([2, 1])
    again = causal(take(encounters, order), QUICK, SURROGATE)
    np.testing.assert_array_equal(again.outcome, flown.outcome[order])
    np.testing.assert_array_equal(again.path, flown.path[order])


def test_without_a_turn_in_mind_it_still_flies(encounters: Encounter):
    bold = causal(take(encounters, slice(0, 1)), QUICK, SURROGATE, Foresight(turn=0.0, observed=False))
    assert bold.solved.all()
    with pytest.raises(ValueError, match="leading axis"):
        causal(take(encounters, 0), QUICK, SURROGATE)
