"""The policy resolves nothing that is proven unresolvable by separations of the intruders' own."""

import pytest

from agents.policy.inference import Policy
from agents.resolvability.classify import Verdict, classify
from envs.aircraft import PAPER
from envs.kinematics import SURROGATE
from envs.outcome import RULES
from envs.scenarios import resolve, scenario
from envs.starts import EVERY_FIELD, encounters_of_seed
from eval.flights.simulate import OUTCOMES, ByPolicy, fly


@pytest.mark.slow
def test_the_policy_solves_nothing_that_is_proven() -> None:
    name = "envs.own_separations:separations"
    resolve(name)
    close = scenario(name, PAPER, radius=(2_000.0, 5_000.0))
    encounters = encounters_of_seed(close, 4, 0, 60, heeds=EVERY_FIELD)
    proven = classify(encounters, RULES, SURROGATE).verdict == Verdict.UNRESOLVABLE
    policy = Policy.load().for_aircraft(PAPER, outside="allow")
    solved = fly(encounters, ByPolicy(policy), PAPER).outcome == OUTCOMES.index("reached")
    assert proven.sum() >= 8 and solved.sum() >= 20
    assert not (solved & proven).any()
