"""Training on several devices and in several processes: the same steps as on one, and nothing lost on the way."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from agents.config.load import ConfigError, load
from rlcas_jax import metrics
from rlcas_jax.cli import Processes, parse
from rlcas_jax.config import TrainConfig
from rlcas_jax.task import _check_split

# One minibatch and one epoch: nothing depends on the shuffle.
WHOLE = """\
name: whole
steps: 6144
network: {hidden: [16, 16], feature_set: mirror}
ppo: {environments: 32, rollout: 32, minibatch: 1024, segment: 8, epochs: 1}
world: {separation_spread: 0.08}
scenarios: [{name: circle}, {name: multi, intruders: [2, 3]}]
pool_rows: 4
evaluation: {every_steps: 2048, encounters: 64, final_encounters: 64}
checkpoint: {every_seconds: 0.0}
"""


@pytest.fixture(scope="module")
def config_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("config") / "whole.yaml"
    path.write_text(WHOLE)
    return path


def start(*arguments: object) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-m", "rlcas_jax.train", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | {"XLA_FLAGS": ""},
    )


def ended(process: "subprocess.Popen[str]", status: int = 0) -> str:
    output, _ = process.communicate(timeout=240)
    assert process.returncode == status, output
    return output


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def pair(*arguments: object) -> list["subprocess.Popen[str]"]:
    """Start two processes that train together."""
    address = f"127.0.0.1:{free_port()}"
    common = [*arguments, "--coordinator", address, "--processes", 2]
    return [start(*common, "--process", number) for number in range(2)]


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory, config_file: Path) -> Path:
    out = tmp_path_factory.mktemp("alone") / "run"
    ended(start("--config", config_file, "--out", out))
    return out


def assert_same_curve(out: Path, expected: Path) -> None:
    """Compare all figures of two runs but those of the clock; sums over devices round differently."""
    curve, wanted = metrics.read(out), metrics.read(expected)
    assert curve.keys() == wanted.keys()
    assert len(curve["step"]) == 6
    for name in curve.keys() - {"wall_s", "steps_per_s"}:
        np.testing.assert_allclose(curve[name], wanted[name], rtol=2e-3, atol=2e-4, err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("devices", [2, 4])
def test_virtual_devices_learn_what_one_learns(devices: int, tmp_path: Path, config_file: Path, alone: Path) -> None:
    ended(start("--config", config_file, "--out", tmp_path / "run", "--devices", devices))
    assert_same_curve(tmp_path / "run", alone)


@pytest.mark.slow
def test_two_processes_learn_what_one_learns_and_the_first_one_writes(
    tmp_path: Path, config_file: Path, alone: Path
) -> None:
    outputs = [ended(process) for process in pair("--config", config_file, "--out", tmp_path / "run")]
    assert_same_curve(tmp_path / "run", alone)
    assert "resolved, of all" in outputs[0]
    assert "resolved" not in outputs[1]
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == sorted(p.name for p in alone.iterdir())


@pytest.mark.slow
def test_a_run_of_two_processes_is_stopped_by_either_and_goes_on_on_two_devices(
    tmp_path: Path, config_file: Path
) -> None:
    out = tmp_path / "run"
    processes = pair("--config", config_file, "--set", "steps=40960", "--out", out)
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline and len(metrics.read(out / metrics.FILE).get("update", ())) < 2:
        time.sleep(0.02)
    processes[1].send_signal(signal.SIGINT)
    for process in processes:
        ended(process, 130)
    stopped = json.loads((out / "summary.json").read_text())
    assert not stopped["finished"]
    ended(start("--resume", out, "--devices", 2))
    assert json.loads((out / "summary.json").read_text())["finished"]
    np.testing.assert_array_equal(metrics.read(out)["update"], np.arange(1, 41))


@pytest.mark.parametrize(
    ("devices", "overrides", "message"),
    [
        (3, [], r"ppo\.environments is 1024; expected a multiple of 3 devices"),
        (2, ["ppo.minibatch=16"], r"ppo\.minibatch is 16; expected a multiple of 2 devices times segment, 32"),
    ],
)
def test_what_cannot_be_split_is_refused(devices: int, overrides: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        _check_split(load(TrainConfig, None, overrides), devices)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--devices", "0"], "--devices is 0; expected 1 or more"),
        (["--processes", "2"], "--processes needs --coordinator"),
        (["--coordinator", "here"], "--coordinator is 'here'; expected HOST:PORT"),
        (["--coordinator", "here:1", "--processes", "2"], "needs --processes and --process"),
        (["--coordinator", "here:1", "--processes", "2", "--process", "2"], "--process is 2 of --processes 2"),
        (["--coordinator", "here:1", "--processes", "2", "--process", "1"], "needs --out"),
    ],
)
def test_what_is_said_of_processes_is_checked(arguments: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        parse(arguments)


def test_processes_are_read(tmp_path: Path) -> None:
    where = ["--out", str(tmp_path / "run")]
    assert parse([*where, "--coordinator", "a:9", "--processes", "2", "--process", "1"]).processes == Processes(
        "a:9", 2, 1
    )
    assert parse([*where, "--coordinator", "auto"]).processes == Processes("auto", None, None)
