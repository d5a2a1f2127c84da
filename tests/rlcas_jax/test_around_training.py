"""What stands around a training: its precision, its other processes, its memory, its end."""

import json
import time
from pathlib import Path
from typing import Any

import jax
import pytest

from agents.config.load import ConfigError
from rlcas_jax import cli, devices, finish, metrics
from rlcas_jax.config import TrainConfig
from rlcas_jax.memory import needed_bytes


def test_double_precision_is_refused_before_a_training(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jax.config, "read", lambda name: name == "jax_enable_x64")
    with pytest.raises(ConfigError, match=r"JAX_ENABLE_X64 .* is on; expected it off"):
        devices.connect()


def test_the_policy_is_there_whatever_happens_to_the_evaluation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[float | None] = []

    def fail(_: Any) -> dict[str, Any]:
        assert written == [None]
        raise OSError("no space")

    monkeypatch.setattr(finish, "export", lambda _, score: written.append(score))
    monkeypatch.setattr(finish, "evaluate", fail)
    with pytest.raises(OSError, match="no space"):
        finish.finish(None)  # pyright: ignore[reportArgumentType]
    assert written == [None]


def test_the_time_before_a_resumption_counts(tmp_path: Path) -> None:
    rows = [{"update": number, "step": 8 * number, "wall_s": 10.0 * number} for number in (1, 2, 3)]
    (tmp_path / metrics.FILE).write_text("".join(json.dumps(row) + "\n" for row in rows))
    with metrics.Writer(tmp_path, resume_update=2) as log:
        assert log.wall_s == 20.0
    (tmp_path / "new").mkdir()
    with metrics.Writer(tmp_path / "new") as log:
        assert log.wall_s == 0.0


def test_the_memory_said_to_be_needed_is_that_of_a_process() -> None:
    # Measured: a training with 15 MiB of arrays holds 984 MiB at its peak.
    few = TrainConfig(steps=32_768)
    assert 0.7 * 984 <= needed_bytes(few) / 2**20 <= 1.5 * 984


@pytest.mark.parametrize(
    "given", [["--set", "steps=-5", "--steps", "32768"], ["--set", "seed=1", "--set", "seed=2"]]
)
def test_a_key_that_is_given_twice_is_refused(given: list[str]) -> None:
    with pytest.raises(ConfigError, match=r"is given as .* and as .*; expected it once"):
        cli.parse(["--config", "quick", *given])


def test_a_process_says_that_it_waits_for_the_others(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def wait(*_: Any) -> None:
        time.sleep(0.2)
        raise RuntimeError("nobody came")

    monkeypatch.setattr(devices, "_PATIENCE_S", 0.05)
    monkeypatch.setattr(jax.distributed, "initialize", wait)
    with pytest.raises(ConfigError, match="the processes did not find each other"):
        devices.connect(processes=cli.Processes("host:1234", 2, 0))
    assert "note: --coordinator host:1234: waiting for 1 others" in capsys.readouterr().err
