"""What a cluster's worker gets and does: an evaluation with its policy's bytes, and chunks of it to fly.

A worker shares neither the file system nor the past of the program that sends it chunks: all that their rows follow
from is in the kit, and the worker checks what it has against it before it flies.
"""

import pickle
import threading
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from agents.policy.file import PolicyFileError, parse
from agents.policy.inference import Policy
from agents.policy.versions import versions
from envs.encounters import EncounterError
from eval.runner.workers import WorkerError

__all__ = ["DECISIVE", "Flier", "Kit", "differences", "fly", "packed", "unpacked"]

DECISIVE = ("rlcas-toolkit", "numpy")
"""Packages that must have one version everywhere, because rows depend on it."""

_SHIPPED = "data/policy.safetensors"


class Flier(NamedTuple):
    """How chunks of one kind of evaluation are flown; its functions are found again by their names on a worker."""

    crew: Callable[[Any, Policy], Any]
    """(what is flown, without the policy's path; the policy) -> what flies it."""
    columns: Callable[[Any, int, int], dict[str, np.ndarray]]
    """(crew, first encounter, how many) -> table of the chunk."""
    packages: tuple[str, ...] = DECISIVE
    """On whose versions the rows depend."""


@dataclass(frozen=True)
class Kit:
    """All that the chunks of a run follow from."""

    name: str
    """Of the run; no two have the same."""
    flier: Flier
    work: Any
    """An evaluation or a campaign, without the path of its policy."""
    policy: bytes
    """Content of the policy file."""
    sha256: str
    """Digest that the policy must have."""
    versions: Mapping[str, str]
    """Of the packages on which rows depend, where the run was begun."""


def packed(name: str, flier: Flier, work: Any, sha256: str) -> bytes:
    """Return the kit of a run as bytes.

    Args:
        name: of the run.
        flier: for this kind of work.
        work: with a field ``policy``: the path of the policy's file, None for the one that ships.
        sha256: digest of that policy.

    Raises:
        PolicyFileError: the policy's file cannot be read again, or is no longer the one with this digest.
    """
    path = resources.files("agents").joinpath(_SHIPPED) if work.policy is None else Path(work.policy)
    try:
        content = path.read_bytes()
    except OSError as problem:
        raise PolicyFileError(f"{path}: cannot be read again: {problem.strerror}") from None
    now = parse(content, str(path)).sha256
    if now != sha256:
        raise PolicyFileError(f"{path}: has changed since it was loaded: its SHA-256 is {now}, expected {sha256}")
    found = versions(*flier.packages)
    decisive = {name: found[name] for name in flier.packages}
    return pickle.dumps(Kit(name, flier, work._replace(policy=None), content, sha256, decisive))


def unpacked(data: bytes) -> Kit:
    """Return the kit of :func:`packed`; a task of its own, so that each worker is sent one copy."""
    return pickle.loads(data)


def fly(kit: Kit, first: int, count: int) -> dict[str, np.ndarray]:
    """Fly the chunk of ``count`` encounters from ``first`` on and return its table.

    Raises:
        EncounterError: an encounter cannot be drawn.
        WorkerError: anything else, with its traceback, or one sentence where the worker does not fit the run.
    """
    # Of several threads of a worker one flies: a step is hundreds of short array operations, and threads would
    # mostly wait for the interpreter's lock.
    with _flying:
        try:
            # For good, not for the chunk: BLAS rounds differently with several threads, and restoring their
            # number would do so beneath another chunk. Libraries that were loaded meanwhile are held, too.
            threadpool_limits(1)
            if kit.name not in _crews:
                crew = _assembled(kit)
                _crews.clear()
                _crews[kit.name] = crew
            return kit.flier.columns(_crews[kit.name], first, count)
        except (EncounterError, WorkerError):
            raise
        except Exception:
            raise WorkerError(traceback.format_exc()) from None


def differences(expected: Mapping[str, str], found: Mapping[str, str]) -> str:
    """Return what differs, in words; empty where nothing does."""
    return ", ".join(
        f"{name} {found.get(name, 'not installed')} instead of {version}"
        for name, version in expected.items()
        if found.get(name) != version
    )


_flying = threading.Lock()
_crews: dict[str, Any] = {}
"""Of a worker's process: what flies the run that it has last worked for, by the run's name."""


def _assembled(kit: Kit) -> Any:
    unlike = differences(kit.versions, versions(*kit.versions))
    if unlike:
        raise WorkerError(f"a worker has {unlike}; expected the same versions everywhere")
    policy = Policy(parse(kit.policy, "the policy that was sent"), source="the policy that was sent")
    if policy.sha256 != kit.sha256:
        raise WorkerError(f"the policy that was sent has SHA-256 {policy.sha256}, expected {kit.sha256}")
    return kit.flier.crew(kit.work, policy)
