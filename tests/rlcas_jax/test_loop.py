"""The training run as a whole: repeatable, resumable after anything, and loud when it goes
wrong.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import jax
import numpy as np
import pytest

from agents.config.load import ConfigError, load
from agents.policy.inference import Policy
from commands.yaml import read, write
from rlcas_jax import checkpoint, metrics
from rlcas_jax.config import PpoConfig, TrainConfig, configuration_of_run
from rlcas_jax.finish import table
from rlcas_jax.progress import Reporter
from rlcas_jax.task import build
from rlcas_jax.train import main

TINY = """\
name: tiny
steps: 25600
network: {hidden: [8, 8]}
environments: 16
rollout: 16
ppo: {minibatch: 64, segment: 8, epochs: 2}
pool_rows: 4
evaluation: {every_steps: 5120, encounters: 8, final_encounters: 16}
checkpoint: {every_seconds: 0.0}
"""
UPDATES = 100


@pytest.fixture(scope="module")
def config_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("config") / "tiny.yaml"
    path.write_text(TINY)
    return path


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "rlcas_jax.train", *map(str, arguments)]


def train(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command(*arguments), capture_output=True, text=True, timeout=1_200, check=False
    )


def stop_midway(out: Path, config_file: Path, number: signal.Signals) -> tuple[int, str]:
    """Start a training, send it a signal once two updates are logged, and return its exit status
    and output.
    """
    process = subprocess.Popen(
        command("--config", config_file, "--set", "steps=2_000_000_000", "--out", out),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    deadline = time.monotonic() + 1_200
    while time.monotonic() < deadline and process.poll() is None:
        if len(metrics.read(out / metrics.FILE).get("update", ())) >= 2:
            break
        time.sleep(0.02)
    process.send_signal(number)
    output, _ = process.communicate(timeout=1_200)
    return process.returncode, output


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory, config_file: Path) -> Path:
    out = tmp_path_factory.mktemp("runs") / "whole"
    done = train("--config", config_file, "--out", out, "--quiet")
    assert done.returncode == 0, done.stderr
    return out


def figures(directory: Path) -> list[dict[str, float | None]]:
    """Return the logged rows without what depends on the clock."""
    rows = [json.loads(line) for line in (directory / metrics.FILE).read_text().splitlines()]
    return [
        {name: value for name, value in row.items() if name not in metrics.WALL_CLOCK}
        for row in rows
    ]


def final_state(directory: Path) -> bytes:
    """Return the bytes of the newest checkpoint's arrays."""
    return checkpoint.latest(directory / "checkpoints").read_bytes()


@pytest.mark.slow
def test_a_run_leaves_what_is_promised(uninterrupted: Path) -> None:
    assert {
        "config.yaml",
        "versions.json",
        "metrics.jsonl",
        "policy.safetensors",
        "summary.json",
    } <= {path.name for path in uninterrupted.iterdir()}
    for name in ("episode_reward", "loss", "entropy", "neg_log_probability"):
        assert (uninterrupted / "figures" / f"{name}.png").stat().st_size > 5_000
        assert (uninterrupted / "figures" / f"{name}.svg").exists()
    summary = json.loads((uninterrupted / "summary.json").read_text())
    assert summary["finished"]
    assert summary["steps"] == 25600
    evaluated = summary["evaluation"]
    assert evaluated["success_rate"] + evaluated["violation_rate"] + evaluated[
        "timeout_rate"
    ] == pytest.approx(1.0)
    assert evaluated["success_given_resolvable"] >= evaluated["success_rate"]
    policy = Policy.load(uninterrupted / "policy.safetensors")
    assert policy.sha256 == summary["policy_sha256"]


@pytest.mark.slow
def test_a_runs_own_configuration_repeats_it(uninterrupted: Path, tmp_path: Path) -> None:
    done = train("--config", uninterrupted / "config.yaml", "--out", tmp_path / "again", "--quiet")
    assert done.returncode == 0, done.stderr
    assert figures(tmp_path / "again") == figures(uninterrupted)
    for name in ("config.yaml", "policy.safetensors"):
        assert (tmp_path / "again" / name).read_bytes() == (uninterrupted / name).read_bytes()


@pytest.mark.slow
def test_resuming_after_a_kill_equals_an_uninterrupted_run(
    uninterrupted: Path, config_file: Path, tmp_path: Path
) -> None:
    killed = tmp_path / "killed"
    process = subprocess.Popen(command("--config", config_file, "--out", killed, "--quiet"))
    deadline = time.monotonic() + 1_200
    while time.monotonic() < deadline and process.poll() is None:
        if 5 <= len(metrics.read(killed / metrics.FILE).get("update", ())) < UPDATES:
            break
    process.kill()
    process.wait()
    done = len(metrics.read(killed / metrics.FILE)["update"])
    assert done < UPDATES, "the run ended before it was killed: nothing was tested"

    resumed = train("--resume", killed, "--quiet")
    assert resumed.returncode == 0, resumed.stderr
    assert figures(killed) == figures(uninterrupted)
    assert final_state(killed) == final_state(uninterrupted)
    assert (killed / "policy.safetensors").read_bytes() == (
        uninterrupted / "policy.safetensors"
    ).read_bytes()


def test_before_an_episode_has_ended_there_is_no_training_score() -> None:
    judged = dict.fromkeys(
        ("score_mean", "success_rate", "success_given_resolvable", "violation_rate"), 0.0
    )
    judged |= {"timeout_rate": 1.0, "unresolvable_proven": 0, "undecided": 0, "encounters": 1}
    begun = {
        "seed": 0,
        "steps": 1,
        "wall_s": 1.0,
        "finished": False,
        "training_score": None,
        "evaluation": judged,
    }
    assert "none yet" in table(Path("runs"), [begun])
    assert "2 seeds: resolved of" in table(Path("runs"), [begun, begun])
    assert "2 seeds: training score +7.0 to +7.0, resolved of" in table(
        Path("runs"), [begun, begun | {"training_score": 7.0}]
    )


@pytest.mark.slow
def test_ctrl_c_saves_and_exports(config_file: Path, tmp_path: Path) -> None:
    out = tmp_path / "stopped"
    status, output = stop_midway(out, config_file, signal.SIGINT)
    assert status == 130, output
    assert f"--resume {out}" in output
    assert "Traceback" not in output
    summary = json.loads(
        (out / "summary.json").read_text(),
        parse_constant=lambda name: pytest.fail(f"{name} in JSON"),
    )
    assert not summary["finished"]
    Policy.load(out / "policy.safetensors")
    stored = checkpoint.latest(out / "checkpoints")
    assert int(stored.stem.rpartition("-")[2]) == metrics.read(out)["update"][-1]


@pytest.mark.slow
def test_another_seed_is_another_run_and_the_same_seed_the_same(
    uninterrupted: Path, config_file: Path, tmp_path: Path
) -> None:
    done = train("--config", config_file, "--seeds", 2, "--out", tmp_path / "two", "--quiet")
    assert done.returncode == 0, done.stderr
    assert "2 seeds" in done.stdout
    assert (tmp_path / "two" / "figures" / "training.png").exists()
    assert figures(tmp_path / "two" / "seed-0") == figures(uninterrupted)
    assert figures(tmp_path / "two" / "seed-1") != figures(uninterrupted)


@pytest.mark.slow
def test_what_is_not_finite_stops_the_run_and_keeps_the_last_good_checkpoint(
    config_file: Path, tmp_path: Path
) -> None:
    out = tmp_path / "diverged"
    done = train("--config", config_file, "--out", out, "--set", "reward_scale=1e30", "--quiet")
    assert done.returncode == 1
    assert "not finite" in done.stderr
    assert "Traceback" not in done.stderr
    kept = checkpoint.latest(out / "checkpoints")
    assert str(kept) in done.stderr
    state = checkpoint.restore(kept, like=build(load(TrainConfig, out / "config.yaml")).initial())
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(state.learner))


@pytest.mark.slow
def test_a_run_whose_files_cannot_be_written_says_so_and_goes_on_later(
    uninterrupted: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(uninterrupted, copy)
    (copy / "policy.safetensors").unlink()
    (copy / "policy.safetensors").mkdir()
    done = train("--resume", copy, "--quiet")
    assert done.returncode == 1, done.stderr
    assert "policy.safetensors: cannot be written" in done.stderr
    assert f"--resume {copy}" in done.stderr
    assert "Traceback" not in done.stderr
    (copy / "policy.safetensors").rmdir()
    assert train("--resume", copy, "--quiet").returncode == 0
    assert (copy / "policy.safetensors").read_bytes() == (
        uninterrupted / "policy.safetensors"
    ).read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("every_seconds", [0.0, 3_600.0])
def test_a_run_whose_folder_is_moved_says_so_and_goes_on_later(
    every_seconds: float, config_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"

    def update(reporter: Reporter, row: Mapping[str, float]) -> None:
        if row["update"] == 3:
            out.rename(elsewhere)

    monkeypatch.setattr(Reporter, "update", update)
    given = [
        "--config",
        str(config_file),
        "--set",
        f"checkpoint.every_seconds={every_seconds}",
        "--quiet",
    ]
    assert main([*given, "--out", str(out)]) == 1
    assert not out.exists()
    elsewhere.rename(out)
    monkeypatch.undo()
    assert main(["--resume", str(out), "--quiet"]) == 0


@pytest.mark.slow
@pytest.mark.long
def test_kept_and_broken_programs_change_no_bit(
    tmp_path: Path, config_file: Path, uninterrupted: Path
) -> None:
    """Compiled anew, loaded, and compiled beside entries that are cut off."""
    folder = tmp_path / "kept"
    environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(folder)}
    for name in ("anew", "loaded", "cut off"):
        out = tmp_path / name
        program = command("--config", config_file, "--out", out, "--quiet")
        done = subprocess.run(
            program, env=environment, capture_output=True, text=True, timeout=1_200, check=False
        )
        assert done.returncode == 0, done.stderr
        assert ("Error reading persistent compilation cache" in done.stderr) == (name == "cut off")
        assert figures(out) == figures(uninterrupted)
        entries = list(folder.glob("*-cache"))
        assert entries
        for entry in entries:
            os.truncate(
                entry, entry.stat().st_size // 2 if name == "loaded" else entry.stat().st_size
            )


@pytest.mark.slow
def test_a_full_disk_ends_a_training_in_one_sentence(
    uninterrupted: Path, config_file: Path, tmp_path: Path
) -> None:
    """The limit on the size of files stands in for it; the second thing that grows is the file for
    TensorBoard.
    """
    out = tmp_path / "full"
    done = subprocess.run(
        # A shell sets the limit, in KiB: a fork is nothing for the threads of JAX.
        [
            "bash",
            "-c",
            'ulimit -f 29; exec "$@"',
            "limited",
            *command("--config", config_file, "--out", out, "--quiet"),
        ],
        capture_output=True,
        text=True,
        timeout=1_200,
        check=False,
    )
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    assert f"--resume {out}" in done.stderr.strip().splitlines()[-1]
    assert train("--resume", out, "--quiet").returncode == 0
    assert figures(out) == figures(uninterrupted)


@pytest.mark.slow
def test_a_run_from_before_keys_moved_goes_on(uninterrupted: Path, tmp_path: Path) -> None:
    before = tmp_path / "before"
    shutil.copytree(uninterrupted, before)
    final = checkpoint.latest(before / "checkpoints")
    final.unlink()
    config = configuration_of_run(before / "config.yaml")
    shapes = build(config).shapes()
    state = checkpoint.restore(checkpoint.latest(before / "checkpoints"), shapes)
    values = read(before / "config.yaml")
    values["ppo"] |= {key: values.pop(key) for key in PpoConfig.MOVED}
    (before / "config.yaml").write_text(write(values))
    meta = {"config": write(values), "phase": 0}
    checkpoint.save(before / "checkpoints", int(state.update), state, meta)
    done = train("--resume", before, "--quiet")
    assert done.returncode == 0, done.stderr
    assert figures(before) == figures(uninterrupted)
    assert final.read_bytes() == final_state(uninterrupted)


@pytest.mark.slow
def test_a_resumed_run_must_be_the_run_that_was_begun(uninterrupted: Path, tmp_path: Path) -> None:
    copy = tmp_path / "edited"
    copy.mkdir()
    (copy / "checkpoints").mkdir()
    for name in ("config.yaml", "metrics.jsonl"):
        (copy / name).write_text((uninterrupted / name).read_text())
    newest = checkpoint.latest(uninterrupted / "checkpoints")
    (copy / "checkpoints" / newest.name).write_bytes(newest.read_bytes())
    (copy / "config.yaml").write_text(
        (copy / "config.yaml").read_text().replace("discount: 0.995", "discount: 0.9")
    )
    with pytest.raises(ConfigError, match="another configuration"):
        main(["--resume", str(copy), "--quiet"])
