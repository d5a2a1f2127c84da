"""What a configuration names is refused where nothing would show that it is outside the domain."""

import pytest

from agents.policy.domain import OutsideDomainError
from envs.aircraft import PAPER
from eval.config import MonteCarloConfig
from eval.runner.options import load_extensions, named_evaluation


def make_crowd(mode: str) -> MonteCarloConfig:
    """Return encounters with twelve intruders, two more than the policy was trained with."""
    return MonteCarloConfig.model_validate(
        {"mode": mode, "scenario": "multi", "changes": {"intruders": (12, 12)}, "encounters": 2}
    )


def test_many_intruders_are_refused_where_the_policy_decides_alone() -> None:
    with pytest.raises(OutsideDomainError, match="there are 12 intruders; expected 10"):
        named_evaluation(make_crowd("policy"))


@pytest.mark.parametrize("mode", ["plan", "assured"])
def test_many_intruders_are_flown_where_plans_are_validated(mode: str) -> None:
    evaluation, _, _ = named_evaluation(make_crowd(mode))
    assert evaluation.mode == mode


def test_names_of_scenarios_that_are_older_than_modifiers_need_no_code() -> None:
    load_extensions(["envs.own_separations:separations", "envs.partly_seen:late"])
    config = MonteCarloConfig.model_validate({"scenario": "envs.partly_seen:late"})
    assert config.sampled_scenario(PAPER).name == "envs.partly_seen:late"
