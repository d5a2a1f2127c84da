"""Failures of a run are grouped without loss, and the cases drawn are those of the run."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.config.load import ConfigError
from eval.failures.groups import HOW, failures, grouped, representatives
from eval.failures.run import main
from eval.monte_carlo import run as monte_carlo
from tests.eval.report.report_runs import COUNT


def tables(count: int, seed: int) -> dict[str, np.ndarray]:
    """Return made-up columns of a run, with the ends of all ranges among them."""
    rng = np.random.default_rng(seed)
    edges = np.array([0.0, 30.0, 60.0, 135.0, 180.0, 12.3])
    return {
        "outcome": rng.choice(np.array(["reached", "violation", "timeout"], dtype=object), count),
        "verdict": rng.choice(np.array(["resolvable", "unresolvable", "undecided"], dtype=object), count),
        "relative_heading_deg": rng.choice(edges, count) * rng.choice([-1.0, 1.0], count),
        "distance_m": rng.choice([1_000.0, 1_500.0, 3_000.0, 25_000.0], count),
        "min_separation_m": rng.choice([0.0, 949.9, 950.0, 999.9, 1_200.0], count),
    }


@given(st.integers(1, 200), st.integers(0, 2**32 - 1))
def test_every_failure_is_in_one_group(count: int, seed: int) -> None:
    table = tables(count, seed)
    groups = grouped(table, 1_000.0)
    members = np.concatenate([group.members for group in groups]) if groups else np.array([], int)
    np.testing.assert_array_equal(np.sort(members), np.flatnonzero(failures(table)))
    assert [group.members.size for group in groups] == sorted((group.members.size for group in groups), reverse=True)
    for group in groups:
        assert group.such >= group.members.size
        assert np.all((table["outcome"][group.members] == "timeout") == (group.how == HOW[2]))


@given(st.integers(1, 200), st.integers(0, 2**32 - 1), st.integers(0, 30))
def test_cases_are_different_failures_of_the_groups(count: int, seed: int, wanted: int) -> None:
    table = tables(count, seed)
    chosen = representatives(grouped(table, 1_000.0), wanted)
    assert len(set(chosen)) == len(chosen) <= wanted
    assert failures(table)[chosen].all()
    if wanted and failures(table).any():
        assert chosen


def test_a_run_s_failures_are_listed_and_drawn(report_run: Path, policy_path: Path, tmp_path: Path) -> None:
    out = tmp_path / "failed"
    assert main(["--run", str(report_run), "--policy", str(policy_path), "--cases", "4", "--out", str(out)]) == 0
    found = json.loads((out / "failures.json").read_text())
    summary = json.loads((report_run / "summary.json").read_text())
    resolved, resolvable = (summary["success_given_resolvable"][key] for key in ("count", "total"))
    assert found["encounters"] == COUNT
    assert found["failures"] == resolvable - resolved > 0
    with (out / "failures.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == found["failures"]
    assert {int(row["encounter"]) for row in rows} >= set(found["cases"])
    assert (out / "failures.png").stat().st_size > 10_000
    # The file of their starts is flown as they were.
    again = tmp_path / "again"
    flown = ["--mode", "policy", "--policy", str(policy_path), "--scenario", f"file:{out / 'encounters.csv'}"]
    assert monte_carlo.main([*flown, "--workers", "1", "--set", "figures=false", "--out", str(again)]) == 0
    counts = json.loads((again / "summary.json").read_text())["counts"]
    assert (counts["success"], counts["violation"] + counts["timeout"]) == (0, found["failures"])


@pytest.mark.parametrize(
    ("arguments", "said"), [(["--cases", "500"], "--cases: '500'"), (["--cases", "-1"], "--cases: '-1'")]
)
def test_bad_input_is_a_sentence(arguments: list[str], said: str, report_run: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=said):
        main(["--run", str(report_run), "--out", str(tmp_path / "x"), *arguments])


def test_what_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="does not exist"):
        main(["--run", str(tmp_path / "nowhere"), "--out", str(tmp_path / "x")])
