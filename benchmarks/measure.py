"""What every benchmark prints beside its figures, and how a rate is taken on a noisy machine."""

import json
import platform
import time
from collections.abc import Callable, Iterable
from importlib import metadata
from pathlib import Path
from typing import Any

from agents.policy.inference import Policy
from envs.edge.command import InputError

__all__ = ["layers", "machine", "report", "seconds"]


def layers(policy: Policy) -> list[tuple[int, ...]]:
    """Return inputs and outputs of each layer of a policy's network; those of its encoder count
    once.
    """
    return [tensor.shape for name, tensor in policy.tensors.items() if name.endswith("/kernel")]


def machine() -> dict[str, Any]:
    """Return the processor's name and the number of cores that this process may use."""
    import os

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


def chosen(only: str, known: Iterable[str]) -> list[str]:
    """Return the names, with commas, of an option ``--only``; raise InputError where one is not
    known.
    """
    names, there = only.split(","), list(known)
    for name in names:
        if name not in there:
            raise InputError(f"--only has {name!r}; expected some of {', '.join(there)}")
    return names


def report(figures: dict[str, Any], packages: tuple[str, ...]) -> None:
    """Print one JSON object with the figures, the machine and the packages' versions as the last
    line.
    """
    versions = {"python": platform.python_version()} | {
        name: metadata.version(name) for name in packages
    }
    print(json.dumps(figures | {"machine": machine(), "versions": versions}))
