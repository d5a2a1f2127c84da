"""Workers fail loudly, stop when asked, and leave no process behind."""

import multiprocessing
import os
import signal
from dataclasses import replace
from pathlib import Path

import pytest

from envs.encounters import SCENARIOS, EncounterError
from envs.kinematics import SURROGATE
from envs.outcome import RULES
from eval.flights.chunks import Evaluation, Pilot, columns
from eval.runner.workers import Chunk, Task, WorkerError, fly_chunks

TASK = Task(Pilot, columns)
CHUNKS = [Chunk(0, 4), Chunk(4, 4), Chunk(8, 4), Chunk(12, 4)]


def evaluation(policy_path: Path, scenario: str = "circle", **changes: float) -> Evaluation:
    return Evaluation(policy_path, replace(SCENARIOS[scenario], **changes), None, 0, RULES, SURROGATE)


@pytest.mark.parametrize("workers", [1, 2])
def test_stopping_begins_no_further_chunk(workers: int, policy_path: Path) -> None:
    stopped: list[bool] = []
    finished = []
    for chunk, table in fly_chunks(TASK, evaluation(policy_path), workers, CHUNKS, lambda: bool(stopped)):
        finished.append(chunk)
        assert table["encounter"].tolist() == list(range(chunk.first, chunk.first + chunk.size))
        stopped.append(True)
    # Those that were in the air are finished.
    assert 1 <= len(finished) <= workers
    assert multiprocessing.active_children() == []


@pytest.mark.parametrize("workers", [1, 2])
def test_an_encounter_that_cannot_be_drawn_is_the_user_s_affair(workers: int, policy_path: Path) -> None:
    impossible = evaluation(policy_path, conflicts_closer_than=1e-9, attempts=1)
    with pytest.raises(EncounterError, match="does not meet the conditions of scenario 'circle' in 1 attempts"):
        list(fly_chunks(TASK, impossible, workers, CHUNKS, lambda: False))
    assert multiprocessing.active_children() == []


def test_a_worker_that_is_killed_ends_the_run(policy_path: Path) -> None:
    chunks = fly_chunks(TASK, evaluation(policy_path), 2, CHUNKS, lambda: False)
    next(chunks)
    for process in multiprocessing.active_children():
        assert process.pid is not None
        os.kill(process.pid, signal.SIGKILL)
    with pytest.raises(WorkerError, match="a worker process has ended unexpectedly"):
        list(chunks)
    assert multiprocessing.active_children() == []


def test_a_failure_inside_a_worker_comes_with_its_traceback(tmp_path: Path) -> None:
    with pytest.raises(WorkerError, match=r"no such policy file"):
        list(fly_chunks(TASK, evaluation(tmp_path / "none.safetensors"), 2, CHUNKS, lambda: False))
