"""A branch that is shown to a policy does save the time that it is said to save."""

from pathlib import Path

import numpy as np
import pytest

from agents.config.load import ConfigError
from agents.policy.inference import Policy
from envs.encounters import SCENARIOS
from envs.outcome import RULES
from envs.starts import numbered
from envs.trees import take
from eval.branches import main
from eval.branching import MOMENTS, WHILE, branched
from eval.flights.simulate import fly
from eval.monte_carlo import run as monte_carlo
from tests.eval.report_runs import report_run

__all__ = ["report_run"]

SECONDS = int(WHILE)


@pytest.mark.parametrize("name", ["circle", "maneuvering"])
def test_a_branch_saves_what_it_says(name: str, policy_path: Path) -> None:
    policy = Policy.load(policy_path)
    starts = numbered(SCENARIOS[name], 3, 0, 60)
    flights, film = fly(starts, policy.rowwise, RULES, policy.limits, record=True)
    assert film is not None
    best = branched(starts, flights, film, policy.rowwise, RULES, policy.limits, least=2.0)
    assert len(best.of) > 5
    assert np.all(np.diff(best.of) >= 0)
    assert np.bincount(best.of).max() <= 2
    assert np.all(best.saved >= 2.0)
    assert set(best.time) <= set(MOMENTS)
    assert np.all(np.abs(best.action) <= 1.0)
    assert np.all(flights.outcome[best.of] != 0)
    observation, action = best.observation.reshape(-1, SECONDS, 8), best.action.reshape(-1, SECONDS, 2)
    for row in range(0, len(best.of), 5):
        begins, seen = int(best.time[row]), []

        def decide(observed: np.ndarray, row: int = row, begins: int = begins, seen: list = seen) -> np.ndarray:
            seen.append(observed)
            since = len(seen) - 1 - begins
            return action[row, since][None] if 0 <= since < SECONDS else policy.rowwise(observed)

        again, flown = fly(take(starts, best.of[row : row + 1]), decide, RULES, policy.limits, record=True)
        assert flown is not None
        assert again.outcome[0] == 1
        assert again.duration[0] == flights.duration[best.of[row]] - best.saved[row]
        assert np.nanmin(flown.separation[begins:, 0]) >= RULES.separation + 40.0
        np.testing.assert_allclose(np.concatenate(seen)[begins : begins + SECONDS], observation[row], atol=1e-3)
        heading = flown.intruders.heading[begins:, 0]
        assert np.nanmax(heading) - np.nanmin(heading) < 2e-3  # no intruder turns any more


def test_branches_of_a_run_become_examples(report_run: Path, policy_path: Path, tmp_path: Path) -> None:
    out = tmp_path / "examples.npz"
    asked = ["--run", str(report_run), "--policy", str(policy_path), "--out", str(out)]
    with pytest.raises(ConfigError, match="nothing to learn here"):
        main([*asked, "--later", "3600"])
    assert main([*asked, "--later", "5", "--saves", "2"]) == 0
    with np.load(out) as stored:
        assert stored["observation"].shape == (len(stored["action"]), 8)
        assert len(stored["action"]) % SECONDS == 0
        assert len(stored["action"]) > 0
    with pytest.raises(ConfigError, match="exists, expected the name of a new file"):
        main(asked)


def test_a_run_without_its_policy_alone_or_with_noisy_reports_is_refused(policy_path: Path, tmp_path: Path) -> None:
    for name, options, problem in (
        ("plans", ["--mode", "plan"], "flew in mode plan, expected policy"),
        ("noisy", ["--mode", "policy", "--scenario", "noisy"], "noisy or late reports, expected perfect ones"),
    ):
        run = tmp_path / name
        flown = ["--policy", str(policy_path), "--encounters", "20", "--workers", "1", "--set", "figures=false"]
        assert monte_carlo.main([*flown, *options, "--out", str(run)]) == 0
        with pytest.raises(ConfigError, match=problem):
            main(["--run", str(run), "--out", str(tmp_path / "examples.npz"), "--later", "1"])
