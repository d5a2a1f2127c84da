"""What a worker gets and does: an evaluation with its policy's bytes, and chunks of it to fly.

A worker of a cluster shares neither the file system nor the past of the program that sends it
chunks: all that their rows follow from is in the payload, and the worker checks what it has against
it before it flies.
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

from agents.policy.file import PolicyFileError, locate, parse
from agents.policy.inference import Policy, input_table
from agents.policy.inputs import Input
from commands.command import InputError
from commands.installation import versions

DECISIVE = ("rlcas-toolkit", "numpy")
"""Packages that must have one version everywhere, because rows depend on it."""


class Chunk(NamedTuple):
    """Consecutive encounters."""

    first: int
    size: int


class Work(NamedTuple):
    """How chunks of one kind of evaluation are flown; its functions are found again by their names
    in a worker.
    """

    prepare: Callable[
        [Any, Any], Any
    ]  # (what is flown, its policy) -> what the next function flies with
    columns: Callable[[Any, int, int], dict[str, np.ndarray]]
    """(what was prepared, first encounter, how many) -> table of the chunk."""
    packages: tuple[str, ...] = DECISIVE  # on whose versions the rows depend
    names_policy: bool = True
    """Whether what is flown names the file of a policy, as ``policy``, which goes with it; else its
    policy is None.
    """


class WorkerError(RuntimeError):
    """A worker has failed, though its input is good; the message says how. What is stored
    remains.
    """


_SHIPPED = "data/policy.safetensors"


@dataclass(frozen=True)
class SentPolicy:
    """A policy on its way to a worker."""

    content: bytes  # of the policy file
    sha256: str  # digest that the policy must have
    inputs: tuple[Input, ...]  # of the user's own that the policy needs

    def policy(self) -> Policy:
        """Return the policy; ``WorkerError``: it is another one."""
        source = "the policy that was sent"
        policy = Policy(parse(self.content, source), source=source, inputs=self.inputs)
        if policy.sha256 != self.sha256:
            raise WorkerError(f"{source} has SHA-256 {policy.sha256}, expected {self.sha256}")
        return policy


@dataclass(frozen=True)
class Payload:
    """All that the chunks of a run follow from."""

    name: str  # of the run; no two have the same
    task: Work
    work: Any  # an evaluation or a campaign, without the path of its policy
    policy: SentPolicy | None  # None: the work names none
    versions: Mapping[str, str]  # of the packages on which rows depend, where the run was begun


def pack(name: str, task: Work, work: Any, sha256: str | None) -> bytes:
    """Return the payload of a run as bytes; ``work`` names its policy's file, None: the one that
    ships. Of work that names no policy the digest is None.

    ``PolicyFileError``: the file cannot be read again, or is no longer the one with this digest.
    """
    policy = None
    if task.names_policy:
        assert sha256 is not None
        policy, work = _sent(work.policy, sha256), work._replace(policy=None)
    installed = versions(*task.packages)
    decisive = {name: installed[name] for name in task.packages}
    try:
        return pickle.dumps(Payload(name, task, work, policy, decisive))
    except (pickle.PicklingError, AttributeError) as problem:
        raise InputError(
            f"code of your own cannot be sent to another process: {problem}; expected a "
            "function of a module, or one worker"
        ) from None


def _sent(file: Path | None, sha256: str) -> SentPolicy:
    """Return the policy of a file (None: the one that ships), read again, to be sent."""
    path = resources.files("agents").joinpath(_SHIPPED) if file is None else locate(file)
    try:
        content = path.read_bytes()
    except OSError as problem:
        raise PolicyFileError(f"{path}: cannot be read again: {problem.strerror}") from None
    parsed = parse(content, str(path))
    if parsed.sha256 != sha256:
        raise PolicyFileError(
            f"{path}: has changed since it was loaded: its SHA-256 is {parsed.sha256}, expected "
            f"{sha256}"
        )
    return SentPolicy(content, sha256, input_table(parsed, source=str(path)).extra)


def unpack(data: bytes) -> Payload:
    """Return the payload of :func:`pack`; a task of its own, so that each worker is sent one
    copy.
    """
    try:
        return pickle.loads(data)
    except (ModuleNotFoundError, AttributeError) as problem:
        raise WorkerError(
            f"a worker lacks code of your own ({problem}); expected its module there too"
        ) from None


def fly(payload: Payload, first: int, count: int) -> dict[str, np.ndarray]:
    """Fly the chunk of ``count`` encounters from ``first`` on and return its table.

    ``InputError``: an encounter cannot be drawn; ``WorkerError``: anything else, with its
    traceback.
    """
    # Of several threads of a worker one flies: a step is hundreds of short array operations, and
    # threads would mostly wait for the interpreter's lock.
    with _flying:
        try:
            # For good, not for the chunk: BLAS rounds differently with several threads, and
            # restoring their number would do so beneath another chunk. Libraries that were loaded
            # meanwhile are held, too.
            threadpool_limits(1)
            if payload.name not in _prepared:
                prepared = _assemble(payload)
                _prepared.clear()
                _prepared[payload.name] = prepared
            return payload.task.columns(_prepared[payload.name], first, count)
        except (InputError, WorkerError):
            raise
        except Exception:
            raise WorkerError(traceback.format_exc()) from None


def differences(expected: Mapping[str, str], installed: Mapping[str, str]) -> str:
    """Return what differs, in words; empty where nothing does."""
    return ", ".join(
        f"{name} {installed.get(name, 'not installed')} instead of {version}"
        for name, version in expected.items()
        if installed.get(name) != version
    )


_flying = threading.Lock()
_prepared: dict[str, Any] = {}
"""Of a worker's process: what flies the run that it has last worked for, by the run's name."""


def _assemble(payload: Payload) -> Any:
    unlike = differences(payload.versions, versions(*payload.versions))
    if unlike:
        raise WorkerError(f"a worker has {unlike}; expected the same versions everywhere")
    policy = None if payload.policy is None else payload.policy.policy()
    return payload.task.prepare(payload.work, policy)
