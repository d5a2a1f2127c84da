"""Ctrl-C and SIGTERM: answered at once, whatever runs, and never a crash."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from agents.config.load import ConfigError
from rlcas_jax import metrics
from rlcas_jax.train import main

ROOT = Path(__file__).resolve().parents[2]
TINY = """\
steps: 2_000_000_000
network: {hidden: [8]}
ppo: {environments: 16, rollout: 16, minibatch: 64, segment: 8, epochs: 1}
pool_rows: 2
evaluation: {final_encounters: 16}
checkpoint: {every_seconds: 0.0}
"""

BUSY = """
import hashlib, sys
from rlcas_jax.interrupt import Interrupt
with Interrupt() as interrupt:
    interrupt.waits_for("the call" if sys.argv[1] == "work" else None)
    print("busy", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 100_000_000)  # a long call, as that of a compiler
"""


def started(*arguments: object) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT
    )


def busy(*arguments: str) -> "subprocess.Popen[str]":
    process = started("-c", BUSY, *arguments)
    assert process.stdout is not None
    assert process.stdout.readline() == "busy\n"
    return process


def test_the_first_signal_says_what_it_waits_for_and_the_second_ends() -> None:
    process = busy("work")
    assert process.stdout is not None
    began = time.monotonic()
    process.send_signal(signal.SIGINT)
    assert process.stdout.readline().startswith("stopping: waits for the call; Ctrl-C again ends at once")
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=10)
    assert process.returncode == 130
    assert "interrupted; the last checkpoint is kept" in output
    assert time.monotonic() - began < 5.0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_where_nothing_is_lost_the_first_signal_ends(number: signal.Signals) -> None:
    process = busy("nothing")
    process.send_signal(number)
    output, _ = process.communicate(timeout=10)
    assert (process.returncode, output) == (130, "interrupted\n")


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("config") / "tiny.yaml"
    path.write_text(TINY)
    return path


@pytest.mark.parametrize("after_s", [1.0, 2.5])
def test_a_signal_while_a_training_starts_ends_it_with_130(after_s: float, config: Path, tmp_path: Path) -> None:
    process = started("-m", "rlcas_jax.train", "--config", config, "--out", tmp_path / "run", "--quiet")
    time.sleep(after_s)
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=120)
    assert process.returncode == 130, output
    assert "Traceback" not in output


def test_one_folder_has_one_training(config: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    process = started("-m", "rlcas_jax.train", "--config", config, "--out", out, "--quiet")
    try:
        deadline = time.monotonic() + 120
        while time.monotonic() < deadline and len(metrics.read(out / metrics.FILE).get("update", ())) < 1:
            time.sleep(0.05)
        with pytest.raises(ConfigError, match=f"--resume {out} is in use by process {process.pid} on "):
            main(["--resume", str(out), "--quiet"])
    finally:
        process.kill()
        process.communicate()
