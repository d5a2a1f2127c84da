"""The key ``draws`` of an evaluation: bits unchanged by default, quasi-random on demand, else refused."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from agents.config.load import ConfigError, load
from envs.encounters import scenario
from envs.kinematics import SURROGATE
from envs.sobol import REPLICATES, quasi_numbered
from envs.starts import numbered
from eval.config import MonteCarloConfig
from eval.flights.sources import drawn, read_source
from eval.hifi.config import HifiConfig
from eval.metrics.replicated import replicated
from eval.monte_carlo import run as monte_carlo


def test_random_draws_are_what_they_were() -> None:
    source, _ = read_source(MonteCarloConfig(), SURROGATE)
    made, usual = drawn(source, 7, 5, 20)[0], numbered(scenario("circle"), 7, 5, 20)
    np.testing.assert_array_equal(made.own.x, usual.own.x)


def test_sobol_draws_are_quasi_random() -> None:
    source, _ = read_source(load(MonteCarloConfig, None, ["draws=sobol", "encounters=64"]), SURROGATE)
    made, wanted = drawn(source, 7, 5, 20)[0], quasi_numbered(scenario("circle"), 7, 5, 20)
    np.testing.assert_array_equal(made.own.x, wanted.own.x)
    assert not np.array_equal(made.own.x, numbered(scenario("circle"), 7, 5, 20).own.x)


def test_a_quasi_random_run_takes_its_intervals_from_the_randomisations(tmp_path: Path, policy_path: Path) -> None:
    out = tmp_path / "run"
    quick = ["--set", "figures=false", "--set", "resamples=100", "--workers", "1"]
    asked = ["--policy", str(policy_path), "--encounters", "32", "--set", "draws=sobol", *quick]
    assert monte_carlo.main([*asked, "--out", str(out)]) == 0
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["draws"] == "sobol"
    read = pq.read_table(out / "encounters.parquet")
    table = {name: read[name].to_numpy(zero_copy_only=False) for name in read.column_names}
    expected = replicated(table, REPLICATES, 0.95)
    assert {key: summary[key] for key in expected} == expected


@pytest.mark.parametrize(
    ("model", "overrides", "said"),
    [
        (MonteCarloConfig, ["draws=halton"], "draws: 'halton' is not available here; expected random or sobol"),
        (MonteCarloConfig, ["draws=sobol", "encounters=1000"], "encounters is 1000; expected a multiple of 16"),
        (MonteCarloConfig, ["draws=sobol", "scenario=file:x.csv", "encounters=16"], "is a file; expected random"),
        (HifiConfig, ["draws=sobol"], "draws: 'sobol' is not available here; expected random"),
    ],
)
def test_draws_that_cannot_be_had_are_refused(model: type[MonteCarloConfig], overrides: list[str], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        load(model, None, overrides)
