"""Search and proof keep from each intruder the separation that is its own."""

import numpy as np
import pytest

from agents.manoeuvres.escape_manoeuvre import Manoeuvre, steps, tracks
from agents.manoeuvres.escape_search import fly_out
from agents.resolvability import causal, least_cost
from agents.resolvability.classify import Method, Resolvability, Verdict, classify, replay
from agents.resolvability.proof import LEAST_SHARE, containment_time, look_ahead
from envs.aircraft import PAPER
from envs.encounters import Encounter
from envs.kinematics import SURROGATE
from envs.outcome import RULES
from envs.scenarios import scenario
from envs.starts import EVERY_FIELD, encounters_of_seed
from envs.trees import take
from tests.agents.scenes import CLOSE, CROWDED, check_witness, duel

NAME = "envs.own_separations:separations"


@pytest.fixture(scope="module")
def encounters() -> Encounter:
    """Two to four intruders from each of which 300 to 3000 m are to be kept, near enough that some
    are beyond help: 60.
    """
    close = scenario(NAME, PAPER, radius=(2_000.0, 5_000.0))
    return encounters_of_seed(close, 4, 0, 60, heeds=EVERY_FIELD)


@pytest.fixture(scope="module")
def judged(encounters: Encounter) -> Resolvability:
    return classify(encounters, RULES, SURROGATE)


def of_all(encounters: Encounter, separation: float) -> Encounter:
    """Return encounters in which one separation is to be kept from every intruder, m."""
    return encounters._replace(separation=np.full(encounters.mask.shape, separation))


@pytest.mark.slow
def test_the_usual_separation_as_their_own_changes_nothing():
    for family in (CLOSE, CROWDED):
        sample = encounters_of_seed(family, 2, 0, 25)
        usual = classify(sample, RULES, SURROGATE)
        with_own = classify(of_all(sample, RULES.separation), RULES, SURROGATE)
        for ours, theirs in zip(usual, with_own, strict=True):
            np.testing.assert_array_equal(ours, theirs)


@pytest.mark.slow
@pytest.mark.parametrize("separation", [600.0, 2_000.0])
def test_one_separation_of_all_is_that_of_the_rules(separation: float):
    sample = encounters_of_seed(CLOSE, 2, 0, 40)
    rules = RULES._replace(separation=separation)
    with_own = classify(of_all(sample, separation), RULES, SURROGATE).verdict
    usual = classify(sample, rules, SURROGATE).verdict
    differ = with_own != usual
    # Horizon and grid of a proof are guides that may differ: they decide how much is proven.
    assert np.all((np.minimum(with_own, usual) == Verdict.UNDECIDED)[differ])
    assert differ.sum() <= 1
    assert len(set(with_own.tolist()) - {Verdict.UNDECIDED}) == 2


@pytest.mark.slow
def test_witnesses_keep_every_separation_in_an_independent_simulation(
    encounters: Encounter, judged: Resolvability
):
    solved = np.flatnonzero(judged.method == Method.SEARCH)
    assert solved.size >= 20
    hardest = solved[np.argsort(judged.separation[solved])[:4]]
    for number in hardest:
        encounter = take(encounters, number)
        flown = replay(encounter, take(judged.witness, number), RULES, SURROGATE)
        check_witness(encounter, flown)
        assert flown.separation.min() >= RULES.separation
        assert flown.separation.min() == pytest.approx(judged.separation[number], abs=1e-6)
    sample = take(encounters, hardest[:2])
    cheapest = least_cost(sample, RULES, SURROGATE, take(judged.witness, hardest[:2]), rounds=2)
    for number in range(2):
        encounter = take(sample, number)
        flown = replay(encounter, take(cheapest.manoeuvre, number), RULES, SURROGATE)
        check_witness(encounter, flown)


@pytest.mark.slow
def test_nobody_solves_what_is_proven(encounters: Encounter, judged: Resolvability):
    proven = np.flatnonzero(judged.verdict == Verdict.UNRESOLVABLE)
    assert proven.size >= 8
    assert not causal(take(encounters, proven), RULES, SURROGATE).solved.any()


@pytest.mark.slow
def test_no_draw_of_many_solves_what_is_proven(encounters: Encounter, judged: Resolvability):
    proven = np.flatnonzero(judged.verdict == Verdict.UNRESOLVABLE)
    sample, draws = take(encounters, proven), np.random.default_rng(1)
    numbers = np.repeat(np.arange(proven.size), 1_000)
    low = np.array([-3.1, -1.0, 0.0, -3.1, -1.0, 0.0, -300.0, -1.0])
    high = np.array([3.1, 1.0, 60.0, 3.1, 1.0, 120.0, 300.0, 1.0])
    drawn = draws.uniform(low[:, None], high[:, None], (8, numbers.size))
    traffic = tracks(sample, steps(RULES), RULES)
    flown = fly_out(sample, traffic, numbers, Manoeuvre(*drawn), RULES, SURROGATE, first=False)
    assert np.isnan(flown.arrival).all()


@pytest.mark.slow
def test_a_larger_separation_makes_nothing_resolvable(encounters: Encounter, judged: Resolvability):
    sample = take(encounters, slice(0, 30))
    more = sample._replace(separation=sample.separation * np.array([1.5, 1.0, 1.2, 2.0]))
    with_larger = classify(more, RULES, SURROGATE).verdict
    usual = judged.verdict[:30]
    assert not np.any((usual == Verdict.UNRESOLVABLE) & (with_larger == Verdict.RESOLVABLE))
    assert np.sum(with_larger == Verdict.UNRESOLVABLE) > np.sum(usual == Verdict.UNRESOLVABLE)


@pytest.mark.slow
def test_verdicts_do_not_depend_on_the_others_separations(
    encounters: Encounter, judged: Resolvability
):
    for number in (0, 7, 21):
        alone = classify(take(encounters, slice(number, number + 1)), RULES, SURROGATE)
        assert alone.verdict[0] == judged.verdict[number]
        np.testing.assert_array_equal(alone.proof_time[0], judged.proof_time[number])


def test_a_start_inside_a_separation_is_lost_and_one_of_the_next_is_not():
    duels = duel([2_500.0, 2_500.0], course=0.0, speed=50.0, intruder_speed=75.0)
    judged = classify(duels._replace(separation=np.array([[2_600.0], [2_400.0]])), RULES, SURROGATE)
    assert judged.method.tolist() == [Method.START, Method.SEARCH]


def test_proofs_do_without_an_intruder_that_may_come_very_near():
    least = LEAST_SHARE * RULES.separation
    for separation, proves in ((1.01 * least, True), (0.99 * least, False)):
        inside = of_all(duel([0.5 * least]), separation)
        ahead = look_ahead(inside, RULES, SURROGATE)
        assert np.isfinite(containment_time(ahead, RULES, SURROGATE)[0]) == proves
