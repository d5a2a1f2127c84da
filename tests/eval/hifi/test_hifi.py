"""The program as its user meets it: files, repeatability, interruption, the margin, a sentence for
every mistake.
"""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.config.load import ConfigError
from eval.hifi import run as hifi
from eval.hifi.rows import HIFI_OUTCOMES
from eval.hifi.summary import margin, upper_bound
from eval.stats.intervals import clopper_pearson

ROOT = Path(__file__).resolve().parents[3]
SMALL = ("--condition", "mixed", "--flights", "3", "--seed", "3")


def run(out: Path, *arguments: str) -> bytes:
    assert hifi.main([*arguments, "--workers", "1", "--out", str(out)]) == 0
    return (out / "flights.parquet").read_bytes()


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory, policy_path: Path) -> Path:
    out = tmp_path_factory.mktemp("hifi") / "whole"
    run(out, *SMALL, "--policy", str(policy_path), "--set", "figures=false")
    return out


def table_of(out: Path) -> dict[str, np.ndarray]:
    table = pq.read_table(out / "flights.parquet")
    return {name: table.column(name).to_numpy() for name in table.column_names}


@pytest.mark.slow
def test_files_of_a_run(finished: Path, tmp_path: Path, policy_path: Path) -> None:
    files = {".lock", "summary.json", "flights.parquet", "config.yaml"}
    assert {path.name for path in finished.iterdir()} == files
    out = tmp_path / "drawn"
    run(out, "--policy", str(policy_path), "--vehicle", "point_mass", "--flights", "1")
    figures = {
        f"{name}.{kind}"
        for name in ("flights", "min_separation", "errors")
        for kind in ("png", "svg")
    }
    assert {path.name for path in out.iterdir()} == files | figures
    assert all(
        path.stat().st_size > 5_000 for path in out.iterdir() if path.suffix in (".png", ".svg")
    )


def test_summary_follows_from_the_table(finished: Path) -> None:
    summary, table = json.loads((finished / "summary.json").read_text()), table_of(finished)
    assert summary["flights"] == len(table["flight"]) == 3
    for key, name in [
        ("success_rate", "reached"),
        *((f"{name}_rate", name) for name in HIFI_OUTCOMES[1:]),
    ]:
        count = int((table["outcome"] == name).sum())
        low, high = clopper_pearson(count, 3)
        assert summary[key] == {
            "value": count / 3,
            "low": low,
            "high": high,
            "count": count,
            "total": 3,
        }
    safe = table["plan_status"] == "safe"
    assert summary["success_of_safe"]["total"] == safe.sum()
    assert set(table["verdict"]) <= {"resolvable", "unresolvable", "undecided", "outside"}
    possible = np.isin(table["verdict"], ["resolvable", "undecided"])
    flown = safe & (table["outcome"] != "refused") & possible
    of_resolvable = summary["safe_of_resolvable"]
    assert (of_resolvable["count"], of_resolvable["total"]) == (flown.sum(), possible.sum())
    assert summary["errors"]["position_error_max_m"]["1"] == np.nanmax(
        table["position_error_max_m"][safe]
    )
    assert sum(summary["reasons"].values()) == sum(text != "" for text in table["reason"])


@pytest.mark.slow
def test_unresolvable_is_not_what_the_planner_gave_up(tmp_path: Path, policy_path: Path) -> None:
    def verdicts(*more: str) -> np.ndarray:
        out = tmp_path / str(len(list(tmp_path.iterdir())))
        run(out, "--policy", str(policy_path), "--vehicle", "surrogate", "--flights", "1", *more)
        return table_of(out)["verdict"]

    head_on = (
        "--scenario",
        "head_on",
        "--set",
        "changes.radius=[2500,2500]",
        "--set",
        "figures=false",
    )
    assert (verdicts(*head_on) == "resolvable").all()
    # Nobody keeps 6 km away from an intruder that begins 5 km ahead.
    assert (verdicts(*head_on, "--set", "planner.margin=5000") == "unresolvable").all()
    slow = (
        "--set",
        "changes.own_speed=[51,52]",
        "--set",
        "planner.vehicle=configs/vehicle_c208.yaml",
    )
    assert (verdicts(*head_on, *slow, "--set", "planner.margin=5000") == "outside").all()


def test_every_column_and_key_is_documented(finished: Path) -> None:
    text = (ROOT / "docs" / "reference" / "evaluation-files.md").read_text(encoding="utf-8")
    names = [*table_of(finished), *json.loads((finished / "summary.json").read_text())]
    assert [name for name in names if f"`{name}`" not in text] == []


@pytest.mark.slow
def test_neither_chunks_nor_workers_change_a_byte(finished: Path, tmp_path: Path) -> None:
    arguments = (
        "--config",
        str(finished / "config.yaml"),
        "--set",
        "chunk=2",
        "--set",
        "figures=false",
    )
    assert hifi.main([*arguments, "--workers", "2", "--out", str(tmp_path / "other")]) == 0
    assert (tmp_path / "other" / "flights.parquet").read_bytes() == (
        finished / "flights.parquet"
    ).read_bytes()


@pytest.mark.slow
def test_a_killed_run_goes_on_to_the_same_table_and_leaves_no_process(
    finished: Path, tmp_path: Path
) -> None:
    out = tmp_path / "killed"
    command = [
        sys.executable,
        "-m",
        "eval.hifi",
        "--config",
        str(finished / "config.yaml"),
        "--out",
        str(out),
    ]
    command += ["--set", "chunk=1", "--set", "figures=false", "--workers", "2"]
    process = subprocess.Popen(
        command, cwd=ROOT, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL
    )
    deadline = time.monotonic() + 600.0
    while not list((out / "parts").glob("*.parquet")):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.01)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    workers = children.read_text().split() if children.exists() else []
    process.kill()
    process.wait()
    while any(_alive(int(worker)) for worker in workers):
        assert time.monotonic() < deadline, "a worker outlives its parent"
        time.sleep(0.02)
    assert not (out / "flights.parquet").exists()
    assert hifi.main(["--resume", "--workers", "1", "--out", str(out)]) == 0
    assert (out / "flights.parquet").read_bytes() == (finished / "flights.parquet").read_bytes()
    with pytest.raises(ConfigError, match="--resume: seed is 4, expected 3"):
        hifi.main(["--resume", "--seed", "4", "--out", str(out)])


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] not in "ZX"
    except (OSError, ValueError):
        return False


@pytest.mark.slow
def test_an_interrupted_run_finishes_what_is_in_the_air(tmp_path: Path) -> None:
    out = tmp_path / "interrupted"
    command = [
        sys.executable,
        "-m",
        "eval.hifi",
        "--flights",
        "40",
        "--workers",
        "1",
        "--out",
        str(out),
    ]
    process = subprocess.Popen(
        [*command, "--set", "chunk=1"], cwd=ROOT, stderr=subprocess.PIPE, text=True
    )
    while not list((out / "parts").glob("*.parquet")):
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, printed = process.communicate(timeout=1_200)
    assert process.returncode == 130
    assert "Go on with: python -m eval.hifi --resume" in printed


NARROW = (
    "{speed_min_mps: 50, speed_max_mps: 50.5, acceleration_min_mps2: -0.5, "
    "acceleration_max_mps2: 0.5, yaw_rate_max_deg_s: 3}"
)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--scenario", "headon"], "did you mean head_on"),
        (
            ["--condition", "stormy"],
            "condition.name is 'stormy'; expected one of calm, loaded, wind",
        ),
        (["--vehicle", "c280"], "vehicle is 'c280'; expected one of"),
        (["--vehicle", "point_mass", "--condition", "light"], "flies in no turbulence"),
        (["--mode", "policy"], "expected one of plan, closed, assured"),
        (["--flights", "0"], "expected a whole number of at least 1"),
        (["--set", "condition.wind_mps=[0,40]"], "expected .low, high. within 0.0 to 30.0"),
        (["--set", "condition.turbulence=[severe]"], "expected a list of none, light, moderate"),
        (["--set", f"planner.vehicle={NARROW}"], "planner.vehicle: allows 50 to 50.5 m/s"),
        (
            ["--set", "planner.vehicle.speed_max_mps=50.5"],
            "planner.vehicle.speed_min_mps is missing",
        ),
        (["--resume"], "holds no run"),
    ],
)
def test_mistakes_get_one_sentence_and_leave_nothing(
    tmp_path: Path, arguments: list[str], sentence: str
) -> None:
    with pytest.raises(ConfigError, match=sentence):
        hifi.main([*arguments, "--out", str(tmp_path / "none")])
    assert not (tmp_path / "none").exists()


@settings(max_examples=20)
@given(st.integers(1, 400), st.floats(0.5, 0.999), st.floats(0.5, 0.99))
def test_the_bound_is_the_least_order_statistic_that_suffices(
    count: int, share: float, confidence: float
) -> None:
    from scipy.stats import binom

    bound = upper_bound(np.arange(1.0, count + 1.0), share, confidence)
    if bound is None:
        # Not even the largest of all: all of them may lie below the quantile.
        assert share**count > 1.0 - confidence - 1e-12
        return
    number = int(bound)
    assert binom.cdf(number - 1, count, share) >= confidence - 1e-9
    assert number == 1 or binom.cdf(number - 2, count, share) < confidence + 1e-9


def rows(errors: list[float]) -> dict[str, np.ndarray]:
    text = {
        "plan_status": np.full(len(errors), "safe", object),
        "outcome": np.full(len(errors), "reached", object),
    }
    return text | {"position_error_max_m": np.array(errors)}


def test_a_margin_covers_the_bound_and_is_refused_without_grounds() -> None:
    covering = margin(rows([float(n % 100) for n in range(400)]), 0.95)
    assert covering == {"bound_m": 99.0, "margin_m": 100.0, "flights_needed": 299}
    assert margin(rows([1.0] * 100), 0.95)["margin_m"] is None
    # One aircraft lost counts as infinitely far away: the largest value is no bound any more.
    lost = rows([1.0] * 299 + [np.nan])
    lost["outcome"][-1] = "failed"
    assert margin(lost, 0.95)["margin_m"] is None
    assert margin(rows([1.0] * 300), 0.95)["margin_m"] == 5.0
