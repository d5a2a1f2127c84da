"""What splitting a training costs: ``python -m benchmarks.devices [--config FILE] [--updates 10]
[--turns 2]``.

The training program itself, in turns: one process on all cores, and as many processes as there are
cores, each held to one of them, which exchange their gradients over the loopback. Same
configuration, same global batch. A rate is the median over a run's updates without the first two;
the ratio is the median of the turns' ratios. The last line is one JSON object.
"""

import argparse
import os
import socket
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from agents.config.load import load
from benchmarks.measure import report
from commands.command import InputError, Parser, run_cli, whole
from rlcas_jax import metrics
from rlcas_jax.config import TrainConfig

__all__ = ["main"]

_IGNORED = 2  # updates at the beginning: compilation, first touch


def main() -> None:
    """Measure and print."""
    options = _parse()
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) < 2:
        raise InputError("two cores or more are needed, this process may use one")
    common = _training_arguments(options.config, options.updates)
    single_rates, group_rates = [], []
    with tempfile.TemporaryDirectory() as folder:
        for turn in range(options.turns):
            single_rates.append(_train_in_one(common, Path(folder) / f"one-{turn}", cores))
            group_rates.append(_train_in_many(common, Path(folder) / f"many-{turn}", cores))
            print(
                f"turn {turn}: one process {single_rates[-1]:.0f}, {len(cores)} processes "
                f"{group_rates[-1]:.0f} steps/s",
                flush=True,
            )
    figures = {
        "benchmark": "devices",
        "one_process_steps_per_s": single_rates,
        "processes": len(cores),
        "many_processes_steps_per_s": group_rates,
        "ratio": statistics.median(b / a for a, b in zip(single_rates, group_rates, strict=True)),
    }
    report(figures, ("jax", "jaxlib", "numpy"))


def _parse() -> argparse.Namespace:
    parser = Parser(description=__doc__)
    add = parser.add_argument
    default = "configs/sprint.yaml"
    add("--config", default=default, help=f"what is trained, from nothing (default {default})")
    add("--updates", type=whole(_IGNORED + 1), default=10, help="updates of each run (default 10)")
    add("--turns", type=whole(1), default=2, help="runs of each kind (default 2)")
    return parser.parse_args()


def _training_arguments(config: str, updates: int) -> list[str]:
    """Return the arguments of a training of so many updates without evaluations."""
    steps = updates * load(TrainConfig, Path(config), []).samples
    changes = [
        f"steps={steps}",
        "warm_start=null",
        "evaluation.final_encounters=10",
        "evaluation.every_steps=1000000000",
    ]
    return [
        "--config",
        config,
        "--quiet",
        *(part for change in changes for part in ("--set", change)),
    ]


def _train_in_one(common: list[str], folder: Path, cores: list[int]) -> float:
    """Train by one process on all cores; return steps per second."""
    _wait([_start([*common, "--out", str(folder)], cores)])
    return _rate(folder)


def _train_in_many(common: list[str], folder: Path, cores: list[int]) -> float:
    """Train by a process a core; return steps per second."""
    group = [*common, "--out", str(folder), "--processes", str(len(cores))]
    group += ["--coordinator", f"127.0.0.1:{_free_port()}"]
    _wait([_start([*group, "--process", str(number)], [core]) for number, core in enumerate(cores)])
    return _rate(folder)


def _start(arguments: list[str], cores: list[int]) -> "subprocess.Popen[bytes]":
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores)  # inherited by the child
    try:
        return subprocess.Popen(
            [sys.executable, "-m", "rlcas_jax.train", *arguments], stdout=subprocess.DEVNULL
        )
    finally:
        os.sched_setaffinity(0, before)


def _wait(processes: list["subprocess.Popen[bytes]"]) -> None:
    for process in processes:
        if process.wait() != 0:
            raise SystemExit(
                f"a training ended with status {process.returncode}; its message stands above"
            )


def _rate(folder: Path) -> float:
    return float(statistics.median(metrics.read(folder)["steps_per_s"][_IGNORED:]))


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


if __name__ == "__main__":
    run_cli(main)
