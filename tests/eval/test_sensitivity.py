"""Success by geometry and noise: bins that lose none, and sweeps on the same encounters."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.config.load import ConfigError
from commands.command import run_cli
from envs.aircraft import PAPER, new_aircraft
from eval.flights.aircraft import describe
from eval.runner.command import UnfinishedError
from eval.sensitivity import run as sensitivity
from eval.sensitivity.bins import Quantity, Run, bins_of, quantities, rates
from eval.sensitivity.sweep import PARAMETERS, Sweep, change_of, parse_sweep
from eval.stats.intervals import clopper_pearson

COUNT = 400


def make_run(
    path: Path, mode: str = "policy", table: str = "encounters.parquet", **columns
) -> Path:
    """Write the folder of a run whose success falls with the distance."""
    rng = np.random.default_rng(0)
    distance = rng.uniform(1_000.0, 22_000.0, COUNT)
    verdict = np.where(distance < 1_200.0, "unresolvable", "resolvable")
    outcome = np.where(
        (rng.random(COUNT) < 0.9) & (verdict == "resolvable"), "reached", "violation"
    )
    values = {
        "outcome": outcome.astype(object),
        "verdict": verdict.astype(object),
        "baseline_outcome": np.where(np.arange(COUNT) % 2 == 0, "violation", "reached").astype(
            object
        ),
        "relative_heading_deg": rng.uniform(-180.0, 180.0, COUNT),
        "distance_m": distance,
        "own_speed_m_s": np.full(COUNT, 75.0),
        **columns,
    }
    path.mkdir()
    pq.write_table(pa.table(values), path / table)
    summary = describe(PAPER, None) | {"mode": mode, "scenario": "circle", "seed": 0}
    (path / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    return path


def numbers(values: list[float]) -> tuple[Run, Quantity]:
    count = len(values)
    table = {
        "x": np.array(values),
        "outcome": np.full(count, "reached", object),
        "verdict": np.full(count, "resolvable", object),
    }
    return Run(Path("run"), "policy", table, PAPER), Quantity("x", "x", "m", "x", (0.0, 1.0, 5.0))


@settings(deadline=None)
@given(st.lists(st.one_of(st.floats(-1e6, 1e6), st.just(float("nan"))), min_size=1, max_size=40))
def test_every_value_falls_into_one_bin(values: list[float]) -> None:
    run, quantity = numbers(values)
    binned = bins_of(run, quantity, 0.95)
    if binned is None:  # all in one bin
        return
    assert sum(row["encounters"] for row in binned["bins"]) == np.count_nonzero(~np.isnan(values))
    for row in binned["bins"]:
        inside = [value for value in values if row["low"] <= value < row["high"]]
        assert row["encounters"] >= len(inside)
    edges = [row["low"] for row in binned["bins"]]
    assert edges == sorted(edges)


def test_rates_are_counted_by_hand() -> None:
    table = {
        "outcome": np.array(["reached", "violation", "reached", "timeout", "violation"], object),
        "verdict": np.array(
            ["resolvable", "unresolvable", "resolvable", "undecided", "resolvable"], object
        ),
        "policy_outcome": np.array(
            ["reached", "violation", "timeout", "timeout", "reached"], object
        ),
        "baseline_outcome": np.array(
            ["violation", "violation", "reached", "reached", "violation"], object
        ),
    }
    counted = rates(
        Run(Path("run"), "plan", table, PAPER), np.array([True, True, True, True, False]), 0.95
    )
    assert counted["encounters"] == 4
    assert (counted["unresolvable_rate"]["count"], counted["unresolvable_rate"]["total"]) == (1, 4)
    assert counted["violation_rate"]["count"] == 1
    assert counted["baseline_violation_rate"]["count"] == 2
    plan, policy = counted["success"]["plan"], counted["success"]["policy"]
    assert (plan["success_rate"]["count"], plan["success_rate"]["total"]) == (2, 4)
    # The undecided count with the resolvable.
    assert (
        plan["success_given_resolvable"]["count"],
        plan["success_given_resolvable"]["total"],
    ) == (2, 3)
    assert (policy["success_given_resolvable"]["count"], policy["success_rate"]["value"]) == (
        1,
        0.25,
    )
    low, high = clopper_pearson(2, 4)
    assert (plan["success_rate"]["low"], plan["success_rate"]["high"]) == (low, high)


@pytest.mark.slow
def test_files_of_a_run_cut_into_bins(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert sensitivity.main(["--run", str(make_run(tmp_path / "run")), "--out", str(out)]) == 0
    written = json.loads((out / "sensitivity.json").read_text(encoding="utf-8"))
    # The own speed never changes, and the rest is not recorded.
    assert [row["name"] for row in written["quantities"]] == ["relative_heading", "distance"]
    distance = written["quantities"][1]["bins"]
    assert (distance[0]["low"], distance[-1]["low"]) == (1_000.0, 20_000.0)
    assert distance[0]["unresolvable_rate"]["count"] > 0
    for row in distance:
        success, bound = (
            row["success"]["policy"]["success_rate"]["value"],
            1.0 - row["unresolvable_rate"]["value"],
        )
        assert success <= bound + 1e-12
    names = {"relative_heading", "distance", "overview"}
    assert {path.name for path in out.iterdir()} == {
        "config.yaml",
        "sensitivity.json",
        *(f"{name}.{kind}" for name in names for kind in ("png", "svg")),
    }


@pytest.mark.slow
def test_flights_of_the_true_aircraft_show_wind_and_turbulence(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    words = np.array(["none", "light", "moderate"], object)[rng.integers(0, 3, COUNT)]
    columns = {"wind_m_s": rng.uniform(0.0, 15.0, COUNT), "turbulence": words}
    run = make_run(tmp_path / "run", "closed", "flights.parquet", **columns)
    out = tmp_path / "out"
    assert sensitivity.main(["--run", str(run), "--out", str(out)]) == 0
    written = json.loads((out / "sensitivity.json").read_text(encoding="utf-8"))
    by_name = {row["name"]: row for row in written["quantities"]}
    assert [row["word"] for row in by_name["turbulence"]["bins"]] == ["none", "light", "moderate"]
    assert [row["encounters"] for row in by_name["turbulence"]["bins"]] == [
        int(np.count_nonzero(words == word)) for word in ("none", "light", "moderate")
    ]
    assert by_name["wind"]["bins"][-1]["high"] == 15.0
    assert (out / "turbulence.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_a_sweep_flies_the_same_encounters_and_goes_on(tmp_path: Path, policy_path: Path) -> None:
    out = tmp_path / "out"
    arguments = [
        "--vary",
        "position_std=0,200",
        "--encounters",
        "12",
        "--seed",
        "3",
        "--workers",
        "1",
    ]
    arguments += ["--policy", str(policy_path), "--set", "resamples=100", "--out", str(out)]
    assert sensitivity.main(arguments) == 0
    written = json.loads((out / "sensitivity.json").read_text(encoding="utf-8"))
    (sweep,) = written["sweeps"]
    assert [row["value"] for row in sweep["values"]] == [0.0, 200.0]
    first, second = (out / "sweeps" / row["run"] for row in sweep["values"])
    before, after = (pq.read_table(path / "encounters.parquet") for path in (first, second))
    for column in ("own_speed_m_s", "distance_m", "bearing_deg", "intruder_speed_m_s"):
        assert before[column].equals(after[column])
    assert not before["min_separation_m"].equals(after["min_separation_m"])
    assert sweep["values"][0]["difference"]["policy"]["value"] == 0.0
    # Interrupted after the first value: the second is flown again, the first is not.
    for path in second.iterdir():
        path.unlink()
    second.rmdir()
    stamp = (first / "encounters.parquet").stat().st_mtime_ns
    assert sensitivity.main([*arguments, "--resume"]) == 0
    assert (first / "encounters.parquet").stat().st_mtime_ns == stamp
    again = json.loads((out / "sensitivity.json").read_text(encoding="utf-8"))
    assert again["sweeps"] == written["sweeps"]


@pytest.mark.slow
def test_the_configuration_of_a_study_repeats_it(tmp_path: Path, policy_path: Path) -> None:
    out, again = tmp_path / "out", tmp_path / "again"
    arguments = ["--run", str(make_run(tmp_path / "run")), "--vary", "latency=0,2"]
    arguments += ["--encounters", "6", "--seed", "3", "--workers", "1", "--confidence", "0.9"]
    arguments += ["--policy", str(policy_path), "--set", "resamples=100", "--scenario", "head_on"]
    assert sensitivity.main([*arguments, "--out", str(out)]) == 0
    assert sensitivity.main(["--config", str(out / "config.yaml"), "--out", str(again)]) == 0
    written = [json.loads((item / "sensitivity.json").read_text("utf-8")) for item in (out, again)]
    for item in written:
        del item["wall_s"]
    assert written[0] == written[1]
    for path in out.glob("*.*"):
        if path.name != "sensitivity.json":
            assert (again / path.name).read_bytes() == path.read_bytes()


def test_an_interrupted_sweep_says_how_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise UnfinishedError("interrupted; finished chunks are kept. ", 130)

    monkeypatch.setattr(sensitivity, "fly", interrupt)
    out = tmp_path / "out"
    assert sensitivity.main(["--vary", "latency", "--out", str(out)]) == 130
    assert f"Go on with: python -m eval.sensitivity --resume --out {out}" in capsys.readouterr().err
    monkeypatch.setattr(sensitivity, "fly", lambda *_, **__: None)
    monkeypatch.setattr(sensitivity, "collect", lambda *_: {"name": "x"})
    with pytest.raises(ConfigError, match="--resume: seed is 1, expected 0"):
        sensitivity.main(["--resume", "--seed", "1", "--out", str(out)])


def test_a_turn_rate_of_zero_means_no_turn() -> None:
    assert change_of("turn_rate", 0.0) == {"turn_rate_deg_s": "0", "heading_change_deg": "0"}
    assert change_of("turn_rate", 2.0)["heading_change_deg"] == "120"


def test_edges_of_bins_scale_with_the_aircraft() -> None:
    twice = new_aircraft(PAPER.limits._replace(speed_min=100.0, speed_max=200.0), 4_000.0)
    ours, theirs = quantities(PAPER), quantities(twice)
    for name, factor in (
        ("distance", 4.0),
        ("miss_distance", 4.0),
        ("time_to_conflict", 2.0),
        ("own_speed", 2.0),
    ):
        assert theirs[name].edges == pytest.approx([factor * edge for edge in ours[name].edges])
    for quantity in ours.values():
        assert list(quantity.edges) == sorted(set(quantity.edges))


def test_sweeps_are_read() -> None:
    assert parse_sweep("latency") == Sweep("latency", PARAMETERS["latency"].values)
    assert parse_sweep("latency=0,1.5") == Sweep("latency", (0.0, 1.5))


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ([], "expected at least one of them"),
        (["--run", "nowhere"], "nowhere holds no encounters.parquet or flights.parquet"),
        (["--vary", "wind"], "the surrogate has no wind; expected a run of eval.hifi"),
        (["--vary", "latence"], "did you mean latency?"),
        (["--vary", "latency=0,3"], "--vary latency: 3 s; expected 0 to 2 s"),
        (["--vary", "latency=1,0"], "expected at least two values, rising"),
        (["--vary", "latency=1"], "expected at least two values, rising"),
        (["--vary", "latency=0,nan"], "--vary latency: nan s"),
        (["--vary", "latency=0,much"], "'much'; expected a number, 0 to 2 s"),
        (["--vary", "latency", "--vary", "latency=0,1"], "given 2 times"),
        (["--vary", "latency", "--set", "changes.latency=[0, 1]"], "is varied by --vary latency"),
        (["--vary", "latency", "--scenario", "file:mine.csv"], "has no numbers to vary"),
        (["--vary", "latency", "--confidence", "2"], "--confidence: 2"),
        (["--run", "nowhere", "--encounters", "10"], "--encounters: is for sweeps"),
        (["--run", "nowhere", "--resume"], "holds no run (no config.yaml)"),
    ],
)
def test_bad_input_is_one_sentence(
    tmp_path: Path, capsys, arguments: list[str], problem: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        run_cli(lambda: sensitivity.main([*arguments, "--out", str(tmp_path / "x")]))
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert problem in line
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(
    ("spoil", "problem"),
    [
        (lambda run: (run / "summary.json").unlink(), "summary.json cannot be read"),
        (lambda run: (run / "encounters.parquet").write_bytes(b"PAR1 no"), "cannot be read"),
        (
            lambda run: (run / "summary.json").write_text("[", encoding="utf-8"),
            "summary.json cannot be read",
        ),
        (lambda run: (run / "summary.json").write_text("{}", encoding="utf-8"), "aircraft is None"),
        (
            lambda run: pq.write_table(pa.table({"x": [1]}), run / "encounters.parquet"),
            "has no column outcome",
        ),
    ],
)
def test_a_damaged_run_is_one_sentence(tmp_path: Path, capsys, spoil, problem: str) -> None:
    run = make_run(tmp_path / "run")
    spoil(run)
    with pytest.raises(SystemExit) as ended:
        run_cli(lambda: sensitivity.main(["--run", str(run), "--out", str(tmp_path / "x")]))
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert problem in line
