"""What every benchmark prints beside its figures, and how a rate is taken on a noisy machine."""

import json
import os
import platform
import shutil
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.planner import Options, prepare
from agents.policy.inference import Policy
from commands.command import ConfigError, InputError, Parser, real, require, whole
from commands.json_text import parse_json

__all__ = [
    "Kind",
    "config_options",
    "deadline_option",
    "deadlines_option",
    "find_chromium",
    "hold_to_one_core",
    "layers",
    "machine",
    "parse_names",
    "percentiles_ms",
    "processor_time",
    "read_done",
    "report",
    "request_options",
    "seconds",
    "show",
    "usual_options",
]


class Kind(NamedTuple):
    """A row of a table of flights: its name, and which flights it holds."""

    name: str
    holds: Callable[[dict[str, Any]], bool]


def request_options(parser: Parser, requests: int) -> None:
    """Add the options of a benchmark that asks for plans: policy, number and seed of requests."""
    add = parser.add_argument
    add("--policy", type=Path, help="policy file (default: the one that ships)")
    add(
        "--requests", type=whole(1), default=requests, help=f"requests to plan (default {requests})"
    )
    add("--seed", type=whole(0), default=0, help="seed of the requests (default 0)")


def deadline_option(parser: Parser) -> None:
    """Add the option for the deadline of a plan."""
    help_text = "deadline of computation, ms (default: the planner's, 50)"
    parser.add_argument("--deadline", type=real(1.0, 60_000.0, "ms"), metavar="MS", help=help_text)


def deadlines_option(parser: Parser, default: list[float]) -> None:
    """Add the option for several deadlines of a plan, ms."""
    parser.add_argument(
        "--deadlines",
        type=real(1.0, 60_000.0, "ms"),
        nargs="+",
        metavar="MS",
        default=default,
        help=f"deadlines of computation, ms (default: {' '.join(f'{ms:g}' for ms in default)})",
    )


def config_options(parser: Parser, default: str) -> None:
    """Add the options for a training's configuration: its file and changes of single keys."""
    add = parser.add_argument
    add(
        "--config",
        type=Path,
        default=Path(default),
        help=f"file of the training (default {default})",
    )
    add(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change one key of it; may be given many times",
    )


def usual_options(policy: Policy, deadline: float | None) -> Options:
    """Return the planner's usual options for a policy, with another deadline, ms, or its own."""
    usual = Options.for_aircraft(policy.aircraft)
    return usual if deadline is None else replace(usual, deadline_s=1e-3 * deadline)


def policy_in_flight(path: Path | None = None) -> Policy:
    """Return a policy, by default the one that ships, with all compiled that flies it, as in a
    node.
    """
    prepare()
    return Policy.load(path)


def layers(policy: Policy) -> list[tuple[int, ...]]:
    """Return inputs and outputs of each layer of a policy's network; those of its encoder count
    once.
    """
    return [tensor.shape for name, tensor in policy.tensors.items() if name.endswith("/kernel")]


def machine() -> dict[str, Any]:
    """Return the processor's name and the number of cores that this process may use."""
    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        models = [
            line.split(":", 1)[1].strip()
            for line in info.read_text().splitlines()
            if "model name" in line
        ]
        name = models[0] if models else name
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {"processor": name, "cores": cores, "system": platform.system()}


def hold_to_one_core() -> None:
    """Keep this process on one of its cores, where the system lets it."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def processor_time(process: int) -> float:
    """Return the processor time that a process of Linux has had, s."""
    fields = Path(f"/proc/{process}/stat").read_text("utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def find_chromium() -> str:
    """Return the path of Chromium; raise an InputError where none is installed, or Playwright is
    not.
    """
    require("the benchmark", "playwright")
    for name in ("chromium", "chromium-browser", "google-chrome"):
        path = shutil.which(name)
        if path is not None:
            return path
    raise InputError("no Chromium is installed; expected Debian's package chromium, or Chrome")


def seconds(work: Callable[[], Any], repeats: int = 5) -> list[float]:
    """Return the wall time of each repeat, s, after one that is not counted; ``work`` waits for its
    own result.
    """
    work()
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return times


def parse_names(only: str, names_known: Iterable[str]) -> list[str]:
    """Return the names, with commas, of an option ``--only``; raise InputError where one is not
    known.
    """
    names, there = only.split(","), list(names_known)
    for name in names:
        if name not in there:
            raise InputError(f"--only has {name!r}; expected some of {', '.join(there)}")
    return names


def read_done(path: Path, settings: dict[str, Any], kind: str = "run") -> list[Any]:
    """Return the JSON lines that a run so far has written to a file, which begins with what was
    asked; a line that was cut off by an interruption is dropped. A new file is begun.

    Raises:
        ConfigError: the file is of a run that was asked for something else.
    """
    if not path.exists():
        path.write_text(json.dumps(settings) + "\n", encoding="utf-8")
        return []
    first, *lines = path.read_text(encoding="utf-8").split("\n")[:-1]
    if parse_json(first) != settings:
        raise ConfigError(
            f"--out: {path} holds another {kind}, {first}; expected {json.dumps(settings)}, "
            "or another folder"
        )
    path.write_text("\n".join([first, *lines, ""]), encoding="utf-8")
    return [parse_json(line) for line in lines]


_PERCENTILES = {"median": 50.0, "p90": 90.0, "p99": 99.0, "p99_9": 99.9, "max": 100.0}


def percentiles_ms(name: str, seconds: Sequence[float], marks: Iterable[str]) -> dict[str, float]:
    """Return percentiles of times, ms, as ``name_mark_ms``.

    Args:
        name: of what was timed.
        seconds: one time at least, s.
        marks: ``median``, ``p90``, ``p99``, ``p99_9`` or ``max``.
    """
    return {
        f"{name}_{mark}_ms": 1e3 * float(np.percentile(seconds, _PERCENTILES[mark]))
        for mark in marks
    }


def show(figures: dict[str, Any]) -> None:
    """Print a figure a line, a fraction with four digits."""
    width = max(map(len, figures))
    for name, value in figures.items():
        print(f"{name:{width}}", f"{value:.4g}" if isinstance(value, float) else value)


def report(figures: dict[str, Any], packages: tuple[str, ...]) -> None:
    """Print one JSON object with the figures, the machine and the packages' versions as the last
    line.
    """
    versions = {"python": platform.python_version()} | {
        name: metadata.version(name) for name in packages
    }
    print(json.dumps(figures | {"machine": machine(), "versions": versions}))
