"""A lock on a run's folder, so that two processes never write into the same one."""

import fcntl
import os
import socket
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

from commands.command import ConfigError

LOCK = ".lock"
"""Name of the lock's file; it stays in the folder and says which process had it last."""


@contextmanager
def lock(folder: Path, option: str = "--out") -> Generator[None]:
    """Make a folder if it is not there and hold it for this process alone; ``option`` names it in
    messages.

    The system releases the lock when the process ends, however it ends (``flock``). A forked child
    shares the lock.

    Raises:
        ConfigError: another process has it, or it cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        held = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as problem:
        raise ConfigError(f"{option} {folder} cannot be written ({problem.strerror})") from None
    with os.fdopen(held, "r+") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(held, 200).decode(errors="replace").strip() or "another process"
            raise ConfigError(
                f"{option} {folder} is in use by {holder}; wait for its end, or name another"
            ) from None
        except OSError as problem:
            raise ConfigError(f"{option} {folder} cannot be locked ({problem.strerror})") from None
        with suppress(OSError):  # on a full disk the lock holds all the same
            os.truncate(held, 0)
            os.pwrite(held, f"process {os.getpid()} on {socket.gethostname()}\n".encode(), 0)
        yield


def is_unused(folder: Path) -> bool:
    """Return whether a run may begin in a folder: there is none, or it is empty but for a lock."""
    if not folder.exists():
        return True
    return folder.is_dir() and all(entry.name == LOCK for entry in folder.iterdir())
