"""A real scheduler and real workers on the loopback: the same bits, whatever dies, one sentence for
every mistake.
"""

import contextlib
import importlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from agents.config.load import ConfigError
from agents.policy.file import PolicyFileError
from commands.installation import versions
from envs.aircraft import PAPER
from envs.scenarios import scenario
from eval.compare import run as compare
from eval.hifi import run as hifi
from eval.monte_carlo import run as monte_carlo

pytest.importorskip("distributed", reason="the extra cluster is not installed")

ROOT = Path(__file__).resolve().parents[3]
RUN = ("--encounters", "48", "--seed", "4", "--set", "figures=false", "--set", "resamples=200")


class Processes:
    """A scheduler and its workers, ended together."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._all = folder, list[subprocess.Popen[bytes]]()
        self._file = folder / "scheduler.json"
        self.scheduler = self._start(
            "scheduler", "--port", "0", "--scheduler-file", str(self._file), "--no-dashboard"
        )
        wait_until(lambda: self._file.is_file() and self._file.read_bytes().endswith(b"}"))
        self.address = json.loads(self._file.read_text(encoding="utf-8"))["address"]

    def worker(self, *options: str, **environment: str) -> subprocess.Popen[bytes]:
        return self._start(
            "worker", self.address, "--nthreads", "1", "--no-dashboard", *options, **environment
        )

    def _start(self, *arguments: str, **environment: str) -> subprocess.Popen[bytes]:
        with (self._folder / f"log_{len(self._all)}.txt").open("wb") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "dask", *arguments, "--host", "127.0.0.1"],
                cwd=self._folder,
                stdout=log,
                stderr=log,
                env=os.environ | environment,
                start_new_session=True,
            )
        self._all.append(process)
        return process

    def end(self) -> None:
        for process in self._all[::-1]:
            # With the nanny's child, which has the group of its parent.
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def wait_until(true: Callable[[], bool], seconds: float = 1_200.0) -> None:
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.02)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Processes]:
    """A scheduler with two workers, none of which has the toolkit's folder as its working
    directory.
    """
    processes = Processes(tmp_path_factory.mktemp("cluster"))
    try:
        for _ in range(2):
            processes.worker("--no-nanny")
        yield processes
    finally:
        processes.end()


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory, policy_path: Path) -> Path:
    """The folder of the same run in one process."""
    out = tmp_path_factory.mktemp("runs") / "alone"
    assert (
        monte_carlo.main(["--policy", str(policy_path), *RUN, "--workers", "1", "--out", str(out)])
        == 0
    )
    return out


def start(out: Path, *arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "eval.monte_carlo", *arguments, "--out", str(out)]
    return subprocess.Popen(
        command,
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        start_new_session=True,
    )


def parts(out: Path) -> list[Path]:
    return list((out / "parts").glob("*.parquet"))


@pytest.mark.slow
def test_a_comparison_on_a_cluster_has_the_bits_of_one_process(
    cluster: Processes, tmp_path: Path
) -> None:
    flown = ("--encounters", "7", "--baseline", "mvp", "--set", "chunk=3")
    where = {"alone": ("--workers", "1"), "cluster": ("--scheduler", cluster.address)}
    for name, arguments in where.items():
        assert (
            compare.main(
                [*flown, "--set", "resamples=100", *arguments, "--out", str(tmp_path / name)]
            )
            == 0
        )
    tables = [(tmp_path / name / "encounters.parquet").read_bytes() for name in where]
    assert tables[0] == tables[1]


@pytest.mark.slow
def test_a_cluster_gives_the_bits_of_one_process(
    cluster: Processes, alone: Path, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    process = start(
        out,
        "--config",
        str(alone / "config.yaml"),
        "--set",
        "chunk=13",
        "--scheduler",
        cluster.address,
    )
    _, errors = process.communicate(timeout=1_200)
    assert process.returncode == 0, errors
    assert "48 of 48 encounters" in errors
    # Progress, and nothing of Dask's own.
    assert all(" of 48 encounters, " in line for line in errors.splitlines()), errors
    assert (out / "encounters.parquet").read_bytes() == (alone / "encounters.parquet").read_bytes()


@pytest.mark.slow
def test_a_driver_that_is_killed_leaves_its_chunks_and_a_free_cluster(
    cluster: Processes, alone: Path, tmp_path: Path
) -> None:
    out = tmp_path / "killed"
    process = start(
        out,
        "--config",
        str(alone / "config.yaml"),
        "--set",
        "chunk=4",
        "--scheduler",
        cluster.address,
    )
    wait_until(lambda: len(parts(out)) >= 2 or process.poll() is not None)
    process.kill()
    process.communicate()
    stored = len(parts(out))
    assert 2 <= stored < 12
    # On another kind of workers it goes on to the same table.
    assert monte_carlo.main(["--resume", "--workers", "1", "--out", str(out)]) == 0
    assert (out / "encounters.parquet").read_bytes() == (alone / "encounters.parquet").read_bytes()
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["encounters_flown_now"] == 48 - 4 * stored

    from distributed import Client

    with Client(cluster.address, set_as_default=False) as client:
        wait_until(
            lambda: not client.run_on_scheduler(lambda dask_scheduler: len(dask_scheduler.tasks))
        )


@pytest.mark.slow
def test_ctrl_c_keeps_what_is_flown_and_another_cluster_goes_on(
    cluster: Processes, alone: Path, tmp_path: Path
) -> None:
    out = tmp_path / "stopped"
    process = start(
        out,
        "--config",
        str(alone / "config.yaml"),
        "--set",
        "chunk=4",
        "--scheduler",
        cluster.address,
    )
    wait_until(lambda: bool(parts(out)) or process.poll() is not None)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=1_200)
    assert process.returncode == 130, errors
    assert "finishing the chunks in the air" in errors
    assert f"Go on with: python -m eval.monte_carlo --resume --out {out}" in errors
    assert "Traceback" not in errors
    assert 1 <= len(parts(out)) < 12
    assert monte_carlo.main(["--resume", "--scheduler", cluster.address, "--out", str(out)]) == 0
    assert (out / "encounters.parquet").read_bytes() == (alone / "encounters.parquet").read_bytes()


@pytest.mark.slow
def test_flights_of_the_true_aircraft_are_the_same_there(
    cluster: Processes, policy_path: Path, tmp_path: Path
) -> None:
    run = (
        "--vehicle",
        "point_mass",
        "--flights",
        "3",
        "--policy",
        str(policy_path),
        "--set",
        "figures=false",
    )
    assert hifi.main([*run, "--workers", "1", "--out", str(tmp_path / "here")]) == 0
    cluster_run = tmp_path / "there"
    assert (
        hifi.main(
            [*run, "--set", "chunk=1", "--scheduler", cluster.address, "--out", str(cluster_run)]
        )
        == 0
    )
    assert (cluster_run / "flights.parquet").read_bytes() == (
        tmp_path / "here" / "flights.parquet"
    ).read_bytes()


@pytest.mark.slow
def test_an_encounter_that_cannot_be_drawn_is_the_user_s_affair(
    cluster: Processes, tmp_path: Path
) -> None:
    impossible = ("--set", "changes.conflicts_closer_than=1e-9", "--set", "changes.attempts=1")
    out = tmp_path / "run"
    process = start(out, *RUN, *impossible, "--scheduler", cluster.address)
    _, errors = process.communicate(timeout=1_200)
    assert process.returncode == 2, errors
    assert len(errors.splitlines()) == 1, errors
    assert "does not meet the conditions of scenario 'circle' in 1 attempts" in errors


@pytest.mark.slow
def test_a_disk_that_fills_ends_the_run_with_one_sentence(
    cluster: Processes, alone: Path, tmp_path: Path
) -> None:
    out = tmp_path / "full"
    command = [
        sys.executable,
        "-m",
        "eval.monte_carlo",
        "--config",
        str(alone / "config.yaml"),
        "--out",
        str(out),
    ]
    process = subprocess.run(
        # No file may grow beyond what the configuration takes, KiB, as on a disk that is full.
        ["bash", "-c", 'ulimit -f 6; exec "$@"', "-", *command, "--scheduler", cluster.address],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 1, process.stderr
    problem, advice = process.stderr.splitlines()[-2:]
    assert problem.startswith(f"error: {out}: what was flown cannot be stored: ")
    assert "File too large" in problem
    assert advice.startswith("Go on with: python -m eval.monte_carlo --resume")
    assert "Traceback" not in process.stderr


@pytest.mark.slow
def test_strangers_are_no_schedulers(cluster: Processes, tmp_path: Path) -> None:
    """One listens and keeps silent, one speaks another language, one is a worker."""
    with (
        socket.create_server(("127.0.0.1", 0)) as silent,
        socket.create_server(("127.0.0.1", 0)) as closing,
    ):

        def answer() -> None:
            connection, _ = closing.accept()
            with connection:
                connection.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")

        threading.Thread(target=answer, daemon=True).start()
        for listener in (silent, closing):
            begun = time.monotonic()
            with pytest.raises(ConfigError, match="no Dask scheduler answers"):
                monte_carlo.main(["--scheduler", f"tcp://127.0.0.1:{listener.getsockname()[1]}"])
            assert time.monotonic() - begun < 10.0

    from distributed import Client

    with Client(cluster.address, set_as_default=False) as client:
        worker = next(iter(client.scheduler_info()["workers"]))
    with pytest.raises(
        ConfigError, match="is the address of a Worker, expected that of a Dask scheduler"
    ):
        monte_carlo.main(["--scheduler", worker, "--out", str(tmp_path / "run")])
    assert not (tmp_path / "run").exists()


def test_a_worker_that_joins_later_is_held_to_the_run_too(
    policy_path: Path, tmp_path: Path
) -> None:
    """What it is sent is checked there before it flies: versions and the policy's digest."""
    from agents.policy.inference import Policy
    from eval.flights.chunks import Evaluation, ReadyEvaluation, columns
    from eval.runner.payload import Work, WorkerError, fly, pack, unpack

    policy = Policy.load(policy_path)
    evaluation = Evaluation(policy_path, scenario("circle", PAPER), None, 0, policy.aircraft)
    payload = unpack(pack("run", Work(ReadyEvaluation, columns), evaluation, policy.sha256))
    assert payload.work.policy is None
    assert payload.versions == {name: versions(name)[name] for name in ("rlcas-toolkit", "numpy")}
    with_other_versions = replace(payload, name="other", versions={"numpy": "1.0"})
    with pytest.raises(
        WorkerError,
        match=r"^a worker has numpy .* instead of 1.0; expected the same versions every",
    ):
        fly(with_other_versions, 0, 1)
    assert payload.policy is not None
    other_policy = replace(payload.policy, sha256="0" * 64)
    with pytest.raises(WorkerError, match=f"SHA-256 {policy.sha256}, expected 00"):
        fly(replace(payload, name="another", policy=other_policy), 0, 1)
    with pytest.raises(
        PolicyFileError, match=f"has changed since it was loaded: its SHA-256 is {policy.sha256}"
    ):
        pack("run", Work(ReadyEvaluation, columns), evaluation, "0" * 64)
    folder = tmp_path / "trained"
    folder.mkdir()
    (folder / "policy.safetensors").write_bytes(policy_path.read_bytes())
    in_folder = pack(
        "run", Work(ReadyEvaluation, columns), evaluation._replace(policy=folder), policy.sha256
    )
    assert unpack(in_folder).policy == payload.policy
    with pytest.raises(PolicyFileError, match="cannot be read again: No such file"):
        pack(
            "run",
            Work(ReadyEvaluation, columns),
            evaluation._replace(policy=policy_path.with_name("none")),
            policy.sha256,
        )


@pytest.mark.slow
def test_other_versions_on_a_worker_are_refused(tmp_path: Path) -> None:
    """The worker finds another version of numpy's metadata first, as if that were installed
    there.
    """
    metadata = tmp_path / "other" / "numpy-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: numpy\nVersion: 1.0\n", encoding="utf-8"
    )
    processes = Processes(tmp_path)
    try:
        processes.worker("--no-nanny", PYTHONPATH=str(tmp_path / "other"))
        own_version = versions("numpy")["numpy"]
        with pytest.raises(
            ConfigError,
            match=f"has numpy 1.0 instead of {own_version}, expected the same versions everywher",
        ):
            monte_carlo.main(["--scheduler", processes.address, "--out", str(tmp_path / "run")])
        assert not (tmp_path / "run").exists()
    finally:
        processes.end()


@pytest.mark.slow
def test_a_worker_that_is_killed_costs_its_chunks_time_alone(alone: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    processes = Processes(tmp_path)
    try:
        first, _ = (processes.worker("--no-nanny") for _ in range(2))
        process = start(
            out,
            "--config",
            str(alone / "config.yaml"),
            "--set",
            "chunk=4",
            "--scheduler",
            processes.address,
        )
        wait_until(lambda: len(parts(out)) >= 2 or process.poll() is not None)
        first.kill()
        _, errors = process.communicate(timeout=1_200)
        assert process.returncode == 0, errors
        assert (out / "encounters.parquet").read_bytes() == (
            alone / "encounters.parquet"
        ).read_bytes()
    finally:
        processes.end()


@pytest.mark.slow
def test_a_scheduler_that_is_killed_ends_the_run_with_one_sentence(
    alone: Path, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    processes = Processes(tmp_path)
    try:
        processes.worker("--no-nanny")
        process = start(
            out,
            "--config",
            str(alone / "config.yaml"),
            "--set",
            "chunk=4",
            "--scheduler",
            processes.address,
        )
        wait_until(lambda: bool(parts(out)) or process.poll() is not None)
        processes.scheduler.kill()
        begun = time.monotonic()
        _, errors = process.communicate(timeout=1_200)
        assert time.monotonic() - begun < 60.0
        assert process.returncode == 1, errors
        assert f"error: the scheduler at {processes.address} has gone" in errors
        assert f"Go on with: python -m eval.monte_carlo --resume --out {out}" in errors
        assert "Traceback" not in errors
        assert parts(out)
    finally:
        processes.end()


POISON = """
import os, signal
from typing import NamedTuple
import numpy as np

class Work(NamedTuple):
    policy: None

def prepare(work, policy):
    return work

def columns(crew, first, count):
    if first == 8:
        os.kill(os.getpid(), signal.SIGKILL)
    return {"encounter": np.arange(first, first + count)}
"""


@pytest.mark.slow
def test_a_chunk_that_workers_die_of_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from agents.policy.inference import Policy
    from eval.runner.cluster import connect_scheduler
    from eval.runner.payload import DECISIVE, Chunk, Work, WorkerError

    (tmp_path / "poison.py").write_text(POISON, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    poison = importlib.import_module("poison")
    processes = Processes(tmp_path)
    try:
        for _ in range(2):
            processes.worker(
                PYTHONPATH=str(tmp_path)
            )  # with a nanny, which starts another one each time
        chunks = [Chunk(first, 4) for first in range(0, 40, 4)]
        with connect_scheduler(processes.address, DECISIVE) as cluster:
            run = cluster.fly(
                Work(poison.prepare, poison.columns),
                poison.Work(None),
                Policy.load().sha256,
                chunks,
                lambda: False,
            )
            with pytest.raises(WorkerError, match=r"several workers have died that had encounters"):
                list(run)
    finally:
        processes.end()
