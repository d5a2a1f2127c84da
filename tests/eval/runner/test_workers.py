"""Workers fail loudly, stop when asked, and leave no process behind; a cluster that cannot serve is
refused.
"""

import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from agents.config.load import ConfigError
from envs import scenarios
from envs.aircraft import PAPER
from envs.encounters import EncounterError
from eval.flights.chunks import Evaluation, ReadyEvaluation, columns
from eval.monte_carlo import run as monte_carlo
from eval.runner.payload import Chunk, Work, WorkerError
from eval.runner.workers import fly_chunks

ROOT = Path(__file__).resolve().parents[3]
TASK = Work(ReadyEvaluation, columns)
CHUNKS = [Chunk(0, 4), Chunk(4, 4), Chunk(8, 4), Chunk(12, 4)]


def evaluation(policy_path: Path, scenario: str = "circle", **changes: float) -> Evaluation:
    return Evaluation(policy_path, scenarios.scenario(scenario, PAPER, **changes), None, 0, PAPER)


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_stopping_begins_no_further_chunk(workers: int, policy_path: Path) -> None:
    stopped: list[bool] = []
    finished = []
    for chunk, table in fly_chunks(
        TASK, evaluation(policy_path), workers, CHUNKS, lambda: bool(stopped)
    ):
        finished.append(chunk)
        assert table["encounter"].tolist() == list(range(chunk.first, chunk.first + chunk.size))
        stopped.append(True)
    # Those that were in the air are finished.
    assert 1 <= len(finished) <= workers
    assert multiprocessing.active_children() == []


@pytest.mark.parametrize("workers", [1, 2])
def test_an_encounter_that_cannot_be_drawn_is_the_user_s_affair(
    workers: int, policy_path: Path
) -> None:
    impossible = evaluation(policy_path, conflicts_closer_than=1e-9, attempts=1)
    with pytest.raises(
        EncounterError, match="does not meet the conditions of scenario 'circle' in 1 attempts"
    ):
        list(fly_chunks(TASK, impossible, workers, CHUNKS, lambda: False))
    assert multiprocessing.active_children() == []


@pytest.mark.slow
def test_a_worker_that_is_killed_ends_the_run(policy_path: Path) -> None:
    chunks = fly_chunks(TASK, evaluation(policy_path), 2, CHUNKS, lambda: False)
    next(chunks)
    for process in multiprocessing.active_children():
        assert process.pid is not None
        os.kill(process.pid, signal.SIGKILL)
    with pytest.raises(WorkerError, match="a worker process has ended unexpectedly"):
        list(chunks)
    assert multiprocessing.active_children() == []


def test_a_failure_inside_a_worker_comes_with_its_traceback(policy_path: Path) -> None:
    broken = Work(ReadyEvaluation, divmod)
    with pytest.raises(
        WorkerError, match=r"Traceback[\s\S]*TypeError: divmod expected 2 arguments, got 3"
    ):
        list(fly_chunks(broken, evaluation(policy_path), 2, CHUNKS, lambda: False))


@pytest.mark.parametrize(
    ("address", "sentence"),
    [
        ("node7", "'node7' is no address; expected tcp://HOST:PORT"),
        ("tcp://node7", "'tcp://node7' is no address"),
        ("http://node7:80", "is no address"),
        ("tcp://node7:99999", "is no address"),
        pytest.param(
            "tcp://127.0.0.1:1", "no Dask scheduler answers within 5 s", marks=pytest.mark.slow
        ),
    ],
)
def test_wrong_addresses_are_refused(address: str, sentence: str, tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="the extra cluster is not installed")
    with pytest.raises(ConfigError, match=sentence):
        monte_carlo.main(["--scheduler", address, "--out", str(tmp_path / "run")])
    assert not (tmp_path / "run").exists()


def test_workers_and_scheduler_exclude_each_other() -> None:
    with pytest.raises(ConfigError, match="--workers and --scheduler: expected one of them"):
        monte_carlo.main(["--scheduler", "tcp://127.0.0.1:1", "--workers", "2"])


def test_a_disk_without_room_is_refused_before_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "deep" / "run"
    paths_asked = []

    def usage(path: Path) -> SimpleNamespace:
        paths_asked.append(Path(path))
        return SimpleNamespace(free=3_000_000, total=9_000_000)

    monkeypatch.setattr(shutil, "disk_usage", usage)
    with pytest.raises(
        ConfigError,
        match=rf"--out {out}: 3.0 MB are free there, expected about 5.5 MB for 10000 rows",
    ):
        monte_carlo.main(["--workers", "1", "--set", "backend=numpy", "--out", str(out)])
    assert paths_asked == [tmp_path]
    assert not out.parent.exists()


def test_nothing_of_dask_is_loaded_without_a_scheduler() -> None:
    program = (
        "import sys, eval.monte_carlo.run as m, eval.hifi.run\ntry: "
        "m.main(['--help'])\nexcept SystemExit: pass\n"
    )
    program += (
        "print(sorted({'distributed', 'dask', 'tornado'} & set(sys.modules)), file=sys.stderr)"
    )
    process = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert process.stderr.strip() == "[]"
    assert "--scheduler ADDRESS" in process.stdout
