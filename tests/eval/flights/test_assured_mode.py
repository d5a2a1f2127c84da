"""The assured loop saves what the plan flown once loses, and depends on nobody else."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from agents.planner.request import Options
from agents.policy.inference import Policy
from envs.encounters import Encounter, scenario
from envs.kinematics import C208_PUBLISHED
from envs.outcome import RULES
from envs.starts import numbered
from envs.trees import take
from eval.config import Setting
from eval.flights.assured_mode import Assured, fly_assured
from eval.flights.plan_mode import fly_once, plan_at_start
from eval.flights.simulate import OUTCOMES
from eval.monte_carlo import run as monte_carlo

REACHED = OUTCOMES.index("reached")
SETTING = Setting(Options(), C208_PUBLISHED)


@pytest.fixture(scope="module")
def policy() -> Policy:
    return Policy.load()


@pytest.fixture(scope="module")
def encounters() -> Encounter:
    return numbered(scenario("maneuvering"), 3, 0, 24)


@pytest.fixture(scope="module")
def assured(encounters: Encounter, policy: Policy) -> Assured:
    plans = plan_at_start(encounters, policy, SETTING)
    return fly_assured(encounters, plans, policy, RULES, SETTING)


def test_more_is_saved_than_by_the_plan_flown_once(encounters: Encounter, policy: Policy, assured: Assured) -> None:
    once = fly_once(encounters, plan_at_start(encounters, policy, SETTING), RULES, SETTING)
    outcome = assured.flown.flights.outcome
    assert (outcome == REACHED).mean() >= 0.95
    assert (outcome == REACHED).sum() > (once.flights.outcome == REACHED).sum()
    # Every flight saved had a new plan.
    saved = (outcome == REACHED) & (once.flights.outcome != REACHED)
    assert np.all(assured.replans[saved] > 0)


@pytest.mark.slow
def test_assured_flights_do_not_depend_on_their_company(
    encounters: Encounter, policy: Policy, assured: Assured
) -> None:
    few = take(encounters, slice(12, 16))
    part = fly_assured(few, plan_at_start(few, policy, SETTING), policy, RULES, SETTING)
    for a, b in zip(part.flown.flights, assured.flown.flights, strict=True):
        np.testing.assert_array_equal(a, b[12:16])
    np.testing.assert_array_equal(part.replans, assured.replans[12:16])


@pytest.mark.slow
def test_a_run_tells_of_all_modes_side_by_side(tmp_path: Path) -> None:
    out = tmp_path / "run"
    arguments = ["--mode", "assured", "--scenario", "maneuvering", "--encounters", "3", "--set", "resamples=200"]
    assert monte_carlo.main([*arguments, "--workers", "1", "--out", str(out)]) == 0
    table, summary = pq.read_table(out / "encounters.parquet"), json.loads((out / "summary.json").read_text("utf-8"))
    for name in ("baseline", "policy", "plan"):
        assert f"{name}_outcome" in table.column_names
    for key in ("policy_success_rate", "plan_success_rate", "success_rate", "replans_mean", "backup_used_rate"):
        assert key in summary
    assert (out / "trajectories.png").stat().st_size > 20_000
