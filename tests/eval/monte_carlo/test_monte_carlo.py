"""The program as its user meets it: files, repeatability, interruption, and sentences for every
mistake.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from argparse import Namespace
from pathlib import Path
from typing import get_args

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml

from agents.baselines.baselines import BASELINES
from agents.config.load import ConfigError
from agents.policy.inference import Policy
from commands.command import run_cli
from commands.folder_lock import lock
from envs.aircraft import PAPER
from envs.formats import encounter_file
from envs.kinematics import SURROGATE
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.trees import take
from eval.config import MonteCarloConfig
from eval.flights import simulate
from eval.flights.simulate import OUTCOMES
from eval.monte_carlo import run as monte_carlo
from eval.stats.intervals import clopper_pearson

ROOT = Path(__file__).resolve().parents[3]
FIGURES = ("initial_conditions", "min_separation", "trajectories")
FILES = {
    ".lock",
    "summary.json",
    "encounters.parquet",
    "config.yaml",
    *(f"{n}.{k}" for n in FIGURES for k in ("png", "svg")),
}
QUICK = ("--set", "resamples=200", "--set", "figures=false", "--workers", "1")


def fly(out: Path, *arguments: str) -> bytes:
    """Run the program in this process and return the bytes of the table."""
    assert monte_carlo.main([*arguments, "--out", str(out)]) == 0
    return (out / "encounters.parquet").read_bytes()


def start(*arguments: str) -> subprocess.Popen[str]:
    """Start the program in a process group of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "eval.monte_carlo", *arguments],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        start_new_session=True,
    )


def parts(out: Path) -> list[Path]:
    return sorted((out / "parts").glob("*.parquet"))


def wait_for_parts(out: Path, count: int, process: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + 1_200.0
    while len(parts(out)) < count:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.005)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory, policy_path: Path) -> Path:
    """Return the folder of a whole run of 120 encounters."""
    out = tmp_path_factory.mktemp("runs") / "whole"
    fly(out, "--policy", str(policy_path), "--encounters", "120", "--seed", "4", "--workers", "1")
    return out


def test_files_of_a_run(finished: Path) -> None:
    assert {path.name for path in finished.iterdir()} == FILES
    for name in FIGURES:
        assert (finished / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert b"<svg" in (finished / f"{name}.svg").read_bytes()


def test_summary_follows_from_the_table(finished: Path) -> None:
    summary = json.loads((finished / "summary.json").read_text(encoding="utf-8"))
    table = {name: column.to_numpy() for name, column in zip(*_columns(finished), strict=True)}
    assert summary["encounters"] == len(table["encounter"]) == 120
    assert table["encounter"].tolist() == list(range(120))
    outcome, possible = table["outcome"], table["verdict"] != "unresolvable"
    expected = {
        "success_rate": (outcome == "reached", 120),
        "violation_rate": (outcome == "violation", 120),
        "timeout_rate": (outcome == "timeout", 120),
        "resolvable_rate": (possible, 120),
        "success_given_resolvable": (outcome == "reached", possible.sum()),
        "baseline_violation_rate": (table["baseline_outcome"] == "violation", 120),
    }
    for key, (mask, total) in expected.items():
        count = int(mask.sum())
        low, high = clopper_pearson(count, int(total))
        assert summary[key] == {
            "value": count / total,
            "low": low,
            "high": high,
            "count": count,
            "total": total,
        }
    scores = {"reached": 100.0, "violation": -100.0, "timeout": -10.0}
    assert table["score"].tolist() == [scores[o] for o in outcome]
    assert summary["score_mean"] == pytest.approx(table["score"].mean())
    assert summary["outside_domain"] == dict.fromkeys(
        ("own_speed", "intruder_speed", "distance", "intruders"), 0
    )
    ends = summary["score_mean_interval"]
    assert ends["low"] < summary["score_mean"] < ends["high"]
    assert (
        summary["risk_ratio"]
        == (outcome == "violation").sum() / (table["baseline_outcome"] == "violation").sum()
    )
    assert summary["risk_ratio_unresolved"] + summary["risk_ratio_induced"] == pytest.approx(
        summary["risk_ratio"]
    )
    excess = table["path_excess"]
    assert np.array_equal(np.isfinite(excess), outcome == "reached")
    assert (excess[np.isfinite(excess)] >= 0.0).all()
    assert summary["path_excess_mean"] == pytest.approx(np.nanmean(excess))
    assert (table["min_separation_m"][outcome != "violation"] >= 1_000.0).all()
    assert (table["min_separation_m"][outcome == "violation"] < 1_000.0).all()
    # A success shows that the encounter is resolvable.
    assert (
        table["verdict"][(outcome == "reached") | (table["baseline_outcome"] == "reached")]
        == "resolvable"
    ).all()


def _columns(out: Path):
    table = pq.read_table(out / "encounters.parquet")
    return table.column_names, table.columns


def test_every_column_and_key_is_documented(finished: Path) -> None:
    text = (ROOT / "docs" / "reference" / "evaluation-files.md").read_text(encoding="utf-8")
    names = [
        *_columns(finished)[0],
        *json.loads((finished / "summary.json").read_text(encoding="utf-8")),
    ]
    assert [name for name in names if f"`{name}`" not in text] == []


def test_a_run_repeats_from_its_own_configuration(finished: Path, tmp_path: Path) -> None:
    again = fly(tmp_path / "again", "--config", str(finished / "config.yaml"), *QUICK)
    assert again == (finished / "encounters.parquet").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("workers", ["1", "2"])
def test_chunks_and_workers_change_no_byte(finished: Path, tmp_path: Path, workers: str) -> None:
    config = ("--config", str(finished / "config.yaml"))
    table_bytes = fly(
        tmp_path / "other", *config, *QUICK[:4], "--workers", workers, "--set", "chunk=57"
    )
    assert table_bytes == (finished / "encounters.parquet").read_bytes()


@pytest.mark.slow
def test_chunks_and_workers_change_no_byte_of_compiled_flights(tmp_path: Path) -> None:
    arguments = (
        "--encounters",
        "400",
        "--set",
        "backend=jax",
        "--set",
        "resamples=200",
        "--set",
        "figures=false",
    )
    table_bytes = fly(tmp_path / "one", *arguments, "--workers", "1")
    assert fly(tmp_path / "two", *arguments, "--workers", "2", "--set", "chunk=70") == table_bytes
    assert yaml.safe_load((tmp_path / "two" / "config.yaml").read_text())["backend"] == "jax"


def test_a_backend_is_chosen_by_what_is_installed_and_flown(
    monkeypatch: pytest.MonkeyPatch, policy_path: Path
) -> None:
    shipped, auto = Policy.load(), MonteCarloConfig()
    assert auto.backend_for(shipped, 10_000) == "jax"
    assert auto.backend_for(shipped, 10) == "numpy"
    assert auto.backend_for(Policy.load(policy_path), 10_000) == "numpy"
    assert MonteCarloConfig(mode="plan").backend_for(shipped, 10_000) == "numpy"
    monkeypatch.setattr("eval.config.find_spec", lambda name: None)
    assert auto.backend_for(shipped, 10_000) == "numpy"


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in BASELINES if name != "none"])
def test_every_baseline_flies_in_the_policy_s_place(
    name: str, tmp_path: Path, policy_path: Path
) -> None:
    arguments = ("--policy", str(policy_path), "--encounters", "24", *QUICK)
    fly(tmp_path / "run", *arguments, "--baseline", name)
    summary = json.loads((tmp_path / "run" / "summary.json").read_text(encoding="utf-8"))
    assert summary["baseline"] == name
    table = pq.read_table(tmp_path / "run" / "encounters.parquet").to_pydict()
    starts = encounters_of_seed(scenario("circle", PAPER), 0, 0, 24)
    expected = simulate.fly(starts, BASELINES[name](PAPER), PAPER)
    assert table["outcome"] == [OUTCOMES[code] for code in expected.outcome]
    np.testing.assert_allclose(table["min_separation_m"], expected.min_separation)


@pytest.mark.parametrize("aircraft", ["null", "{speed_max_mps: 120}"])
def test_the_aircraft_flown_is_named(
    aircraft: str, tmp_path: Path, policy_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    allowed = [] if aircraft == "null" else ["--allow-outside-domain"]
    fly(
        tmp_path / "run",
        "--policy",
        str(policy_path),
        "--encounters",
        "2",
        *QUICK,
        "--set",
        f"aircraft={aircraft}",
        *allowed,
    )
    summary = json.loads((tmp_path / "run" / "summary.json").read_text(encoding="utf-8"))
    assert summary["policy_aircraft"]["yaw_rate_max"] == SURROGATE.yaw_rate_max
    assert summary["aircraft"]["speed_max"] == (100.0 if aircraft == "null" else 120.0)
    assert bool(summary["aircraft_warning"]) is (aircraft != "null")
    printed = capsys.readouterr().out
    assert "aircraft: 50 to 1" in printed
    assert ("warning: outside_domain: speed_min is 0.417 V; expected 0.5 to 0.5" in printed) is (
        aircraft != "null"
    )


def test_a_longer_run_begins_like_a_shorter_one(finished: Path, tmp_path: Path) -> None:
    fly(tmp_path / "short", "--config", str(finished / "config.yaml"), *QUICK, "--encounters", "30")
    short, whole = (
        pq.read_table(out / "encounters.parquet") for out in (tmp_path / "short", finished)
    )
    # numpy, unlike pyarrow, takes two not-a-numbers for equal
    np.testing.assert_equal(short.to_pydict(), whole.slice(0, 30).to_pydict())


@pytest.mark.slow
def test_another_seed_is_another_run(finished: Path, tmp_path: Path) -> None:
    table_bytes = fly(
        tmp_path / "other", "--config", str(finished / "config.yaml"), *QUICK, "--seed", "5"
    )
    assert table_bytes != (finished / "encounters.parquet").read_bytes()


@pytest.mark.slow
def test_killed_runs_go_on_and_leave_no_process(finished: Path, tmp_path: Path) -> None:
    out = tmp_path / "killed"
    process = start(
        "--config",
        str(finished / "config.yaml"),
        "--set",
        "chunk=15",
        "--set",
        "figures=false",
        "--workers",
        "2",
        "--out",
        str(out),
    )
    wait_for_parts(out, 2, process)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    workers = children.read_text().split() if children.exists() else []
    process.kill()
    process.communicate()
    stored = {path: path.stat().st_mtime_ns for path in parts(out)}
    assert 2 <= len(stored) < 8
    deadline = time.monotonic() + 20.0
    while any(_alive(worker) for worker in workers):
        assert time.monotonic() < deadline, "a worker outlives its parent"
        time.sleep(0.02)
    # One part is damaged as well, as by a disk that was full.
    broken = max(stored)
    broken.write_bytes(broken.read_bytes()[:100])

    resumed = start("--resume", "--workers", "1", "--out", str(out))
    _, errors = resumed.communicate(timeout=1_200)
    assert resumed.returncode == 0, errors
    assert f"{15 * (len(stored) - 1)} of 120 encounters are stored already" in errors
    assert (out / "encounters.parquet").read_bytes() == (
        finished / "encounters.parquet"
    ).read_bytes()
    assert {path.name for path in out.iterdir()} == {
        ".lock",
        "summary.json",
        "encounters.parquet",
        "config.yaml",
    }
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["encounters_flown_now"] == 120 - 15 * (len(stored) - 1)


def _alive(process: str) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.slow
@pytest.mark.parametrize("workers", ["1", "2"])
def test_ctrl_c_keeps_finished_chunks_and_says_how_to_go_on(
    finished: Path, tmp_path: Path, workers: str
) -> None:
    out = tmp_path / "stopped"
    with start(
        "--config",
        str(finished / "config.yaml"),
        "--set",
        "chunk=15",
        "--set",
        "figures=false",
        "--workers",
        workers,
        "--out",
        str(out),
    ) as process:
        wait_for_parts(out, 1, process)
        os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=1_200)
    assert process.returncode == 130, errors
    assert f"Go on with: python -m eval.monte_carlo --resume --out {out}" in errors
    assert "Traceback" not in errors
    assert 1 <= len(parts(out)) < 8
    assert not list(out.rglob("*.tmp"))
    again = fly(out, "--resume", "--set", "resamples=200", "--workers", "1")
    assert again == (finished / "encounters.parquet").read_bytes()


@pytest.mark.slow
def test_a_finished_run_is_resumed_without_flying(
    finished: Path, tmp_path: Path, policy_path: Path
) -> None:
    out = tmp_path / "run"
    before = fly(out, "--policy", str(policy_path), "--encounters", "20", *QUICK)
    (out / "summary.json").unlink()
    assert fly(out, "--resume", "--set", "figures=true") == before
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert (summary["encounters_flown_now"], summary["encounters_per_s"]) == (0, None)
    assert {path.name for path in out.iterdir()} == FILES


@pytest.mark.slow
def test_own_file_of_encounters(
    tmp_path: Path, policy_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine.csv"
    starts = encounters_of_seed(scenario("multi", PAPER), 9, 0, 30)
    encounter_file.write(mine, starts, [f"flight {i}" for i in range(30)])
    common = ("--policy", str(policy_path), "--allow-outside-domain", *QUICK)
    fly(tmp_path / "mine", *common, "--scenario", f"file:{mine}")
    sampled = fly(
        tmp_path / "sampled", *common, "--scenario", "multi", "--seed", "9", "--encounters", "30"
    )
    assert sampled
    ours, theirs = (
        pq.read_table(tmp_path / name / "encounters.parquet") for name in ("mine", "sampled")
    )
    assert ours.column("name").to_pylist() == [f"flight {i}" for i in range(30)]
    assert ours.column("outcome").equals(theirs.column("outcome"))
    np.testing.assert_allclose(
        ours.column("min_separation_m").to_numpy(),
        theirs.column("min_separation_m").to_numpy(),
        atol=0.5,
    )
    config = yaml.safe_load((tmp_path / "mine" / "config.yaml").read_text(encoding="utf-8"))
    assert config["encounters"] == 30
    assert len(config["scenario_sha256"]) == 64

    # The file's digest is kept: the run cannot be repeated from another content by accident.
    encounter_file.write(mine, take(starts, slice(0, 29)))
    with pytest.raises(
        ConfigError, match=r"mine.csv has SHA-256 .* expected .* \(key scenario_sha256\)"
    ):
        fly(tmp_path / "again", "--config", str(tmp_path / "mine" / "config.yaml"))
    with pytest.raises(ConfigError, match="encounters is 31; expected at most 29"):
        fly(tmp_path / "more", *common, "--scenario", f"file:{mine}", "--encounters", "31")
    capsys.readouterr()


@pytest.mark.slow
def test_one_encounter_and_no_failure_are_no_trouble(tmp_path: Path, policy_path: Path) -> None:
    mine = tmp_path / "clear.csv"
    text = "encounter,own_x_m,own_y_m,own_heading_deg,own_speed_m_s,goal_x_m,goal_y_m,"
    text += "intruder_x_m,intruder_y_m,intruder_heading_deg,intruder_speed_m_s\n"
    mine.write_text(text + "a,0,0,0,80,8000,0,0,30000,90,80\n", encoding="utf-8")
    fly(
        tmp_path / "run",
        "--policy",
        str(policy_path),
        "--scenario",
        f"file:{mine}",
        "--workers",
        "1",
    )
    summary = json.loads((tmp_path / "run" / "summary.json").read_text(encoding="utf-8"))
    assert summary["risk_ratio"] is None
    assert summary["success_rate"]["value"] == 1.0
    assert {path.name for path in (tmp_path / "run").iterdir()} == FILES


@pytest.mark.parametrize(
    "name",
    [
        "crossing_left",
        pytest.param("crossing_right", marks=pytest.mark.slow),
        "head_on",
        pytest.param("same_course", marks=pytest.mark.slow),
        "maneuvering",
        pytest.param("noisy", marks=pytest.mark.slow),
    ],
)
def test_scenarios_fly(name: str, tmp_path: Path, policy_path: Path) -> None:
    fly(
        tmp_path / "run",
        "--policy",
        str(policy_path),
        "--encounters",
        "12",
        "--scenario",
        name,
        *QUICK,
    )


def test_the_table_on_standard_output(
    finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fly(tmp_path / "run", "--config", str(finished / "config.yaml"), *QUICK, "--encounters", "20")
    output, errors = capsys.readouterr()
    for words in (
        "success of all encounters",
        "success of those not proven unresolvable",
        "losses of separation",
        "time-outs",
        "mean score",
        "extra track distance",
    ):
        assert words in output
    assert "95 % interval" in output
    assert "summary.json" in output
    assert "\x1b" not in output + errors
    assert "20 of 20 encounters" in errors


def mistakes(folder: Path) -> dict[str, tuple[list[str], str]]:
    """Return arguments that are wrong and a part of the sentence each must give."""
    (folder / "full").mkdir()
    (folder / "full" / "notes.txt").touch()
    os.mkfifo(folder / "pipe")
    (folder / "file.txt").write_text("no policy", encoding="utf-8")
    (folder / "wrong.yaml").write_text("seeds: 3\n", encoding="utf-8")
    (folder / "bad.csv").write_text("encounter\n", encoding="utf-8")
    return {
        "not empty": (
            ["--out", str(folder / "full")],
            "holds something already, expected a folder",
        ),
        "a file": (["--out", str(folder / "file.txt")], "holds something already"),
        "unwritable": (["--out", "/proc/run"], "--out /proc/run cannot be written"),
        "scenario": (
            ["--scenario", "circel"],
            "--scenario: 'circel' is unknown; expected one of circle",
        ),
        "nearest": (["--scenario", "circel"], "did you mean circle?"),
        "no file": (
            ["--scenario", f"file:{folder / 'none.csv'}"],
            "none.csv: there is no such file",
        ),
        "bad file": (
            ["--scenario", f"file:{folder / 'bad.csv'}"],
            "bad.csv line 1: column own_x_m is missing",
        ),
        "policy": (["--policy", str(folder / "file.txt")], "file.txt: "),
        "no policy": (["--policy", str(folder / "none.safetensors")], "no such policy file"),
        "encounters": (
            ["--encounters", "0"],
            "argument --encounters: '0'; expected a whole number of at least 1",
        ),
        "many": (["--encounters", "1e4"], "argument --encounters: '1e4'; expected a whole number"),
        "seed": (["--seed", "-1"], "argument --seed"),
        "mode": (["--mode", "glide"], "mode is 'glide'; expected one of policy, plan"),
        "backend": (
            ["--mode", "plan", "--set", "backend=jax"],
            "backend is 'jax'; expected auto or numpy",
        ),
        "baseline": (["--baseline", "mpv"], "baseline is 'mpv'; expected one of none, rules"),
        "baseline plans": (["--baseline", "mvp", "--mode", "plan"], "expected none with mode plan"),
        "config": (
            ["--config", str(folder / "wrong.yaml")],
            "seeds is unknown (its value is 3); did you mean seed?",
        ),
        "no config": (["--config", str(folder / "none.yaml")], "none.yaml: there is no such file"),
        "set": (["--set", "chunk=0"], "--set: chunk is 0; expected a whole number at least 1"),
        "changes": (
            ["--set", "changes.radios=[1, 2]"],
            "changes.radios is unknown (its value is [1, 2]); did you mean",
        ),
        "twice": (["--seed", "1", "--seed", "2"], "--seed stands twice"),
        "pipe": (["--scenario", f"file:{folder / 'pipe'}"], "not a regular file"),
        "outside": (
            ["--aircraft", "configs/aircraft/uas.yaml"],
            "outside_domain: acceleration_min is -0.235 V^2/D",
        ),
        "several": (
            ["--scenario", "multi"],
            "outside_domain: there are 8 intruders; expected 1 at most",
        ),
        "no aircraft": (["--aircraft", "configs/aircraft/kite.yaml"], "kite.yaml"),
        "speeds": (
            ["--set", "changes.own_speed=[18, 36]"],
            "changes.own_speed is [18, 36]; expected [low, high] within 50 to 100, the speeds of "
            "the aircraft",
        ),
        "pinned": (["--policy-sha256", "0" * 64], "expected 000"),
        "digest": (["--set", f"policy_sha256={'0' * 64}"], "expected 000"),
        "resume": (["--resume", "--out", str(folder / "none")], "holds no run (no config.yaml)"),
        "resume what": (["--resume"], "--resume: expected --out with the folder of the run"),
        "argument": (["--polcy", "x"], "unrecognized arguments: --polcy"),
    }


def test_mistakes_end_before_the_run_with_one_sentence(
    tmp_path: Path, policy_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, (arguments, sentence) in mistakes(tmp_path).items():
        policy = [] if "--policy" in arguments else ["--policy", str(policy_path)]
        out = (
            []
            if "--out" in arguments or "--resume" in arguments
            else ["--out", str(tmp_path / "run")]
        )
        sys.argv = ["eval.monte_carlo", *policy, *out, *arguments]
        with pytest.raises(SystemExit) as ended:
            run_cli(monte_carlo.main)
        output, errors = capsys.readouterr()
        assert ended.value.code == 2, (name, errors)
        assert sentence in errors, (name, errors)
        assert len(errors.splitlines()) == 1, (name, errors)
        assert output == "", name
        assert not (tmp_path / "run").exists(), name


def test_a_folder_in_use_is_refused(
    finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(finished, tmp_path / "run")
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "run").iterdir()}
    with lock(tmp_path / "run"), pytest.raises(ConfigError, match="is in use by process"):
        monte_carlo.main(["--resume", "--out", str(tmp_path / "run")])
    del before[tmp_path / "run" / ".lock"]
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert capsys.readouterr().out == ""


def test_resume_refuses_another_run(finished: Path, tmp_path: Path, policy_path: Path) -> None:
    out = tmp_path / "run"
    fly(out, "--policy", str(policy_path), "--encounters", "20", *QUICK)
    with pytest.raises(
        ConfigError, match=r"--resume: seed is 7, expected 0 as in .*config.yaml; use another --out"
    ):
        fly(out, "--resume", "--seed", "7")
    with pytest.raises(ConfigError, match="--resume: changes is"):
        fly(out, "--resume", "--set", "changes.displacement=100")


def test_help_is_complete_and_imports_nothing_heavy() -> None:
    program = (
        "import sys, eval.monte_carlo.run as m\ntry: m.main(['--help'])\nexcept SystemExit: pass\n"
    )
    program += (
        "print(sorted({'scipy', 'matplotlib', 'pyarrow', 'rich', 'jax'} & "
        "set(sys.modules)), file=sys.stderr)"
    )
    process = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    for option in (
        "--config",
        "--set",
        "--policy",
        "--encounters",
        "--scenario",
        "--seed",
        "--workers",
        "--resume",
    ):
        assert option in process.stdout
    assert "default: 10000" in process.stdout
    assert "plan" in process.stdout
    assert process.stderr.strip() == "[]"


def test_every_baseline_can_be_named() -> None:
    assert get_args(MonteCarloConfig.model_fields["baseline"].annotation) == tuple(BASELINES)


def test_keys_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert monte_carlo.main(["--help-keys"]) == 0
    assert "aircraft.separation_m" in capsys.readouterr().out


def test_the_shipped_configuration_is_the_defaults() -> None:
    from agents.config.load import dump, load
    from eval.config import MonteCarloConfig

    assert dump(load(MonteCarloConfig, ROOT / "configs" / "monte_carlo.yaml")) == dump(
        load(MonteCarloConfig)
    )


@pytest.mark.parametrize("encounters", [100, 100_000])
def test_a_cluster_computes_decisions_as_this_machine_does(encounters: int) -> None:
    config = MonteCarloConfig(encounters=encounters)
    local, remote = (
        monte_carlo._resolve(config, Namespace(scheduler=where)).config.backend
        for where in (None, "tcp://10.0.0.1:8786")
    )
    assert local == remote
