"""Finished parts of a command's work, kept in its folder, so that an interrupted run goes on from
them.
"""

import shutil
import sys
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from agents.config.load import Strict
from commands.files import write_whole
from eval.runner.outputs import ResumableFolder

_IDENTITY = "identity of the run"  # name of an array that no part has


class PartsFolder(ResumableFolder):
    """A context in which parts of a run are made or, where they are stored, read.

    On Ctrl-C it says how to go on. When the block ends well the parts are deleted.
    """

    def __init__(
        self, path: Path, config: Strict, command: str, free: tuple[str, ...] = ()
    ) -> None:
        """Name the run's folder and configuration, the command (``python -m eval.COMMAND``), and
        keys on which no part depends.
        """
        super().__init__(path, config)
        self.free, self._command = free, command

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        problem: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            shutil.rmtree(self.path / self.parts, ignore_errors=True)
        elif kind is KeyboardInterrupt:
            again = f"python -m eval.{self._command} --resume --out {self.path}"
            print(f"finished parts are kept. Go on with: {again}", file=sys.stderr)

    def part(self, name: str, make: Callable[[], Mapping[str, Any]]) -> dict[str, np.ndarray]:
        """Return a part, arrays by name: as it is stored, or made now; words are objects.

        Raises:
            ConfigError: other versions have made it.
        """
        path = self.path / self.parts / f"{name}.npz"
        part = _read(path)
        if part is None:
            _write(path, {**make(), _IDENTITY: self.identity()})
            part = _read(path)
            assert part is not None
        self.check_made_here(path, str(part.pop(_IDENTITY, "")))
        return part


def _write(path: Path, part: Mapping[str, Any]) -> None:
    arrays = {name: np.asarray(values) for name, values in part.items()}
    # Words as texts of fixed width: objects would be pickled.
    plain: dict[str, Any] = {
        name: a.astype(str) if a.dtype == object else a for name, a in arrays.items()
    }
    with write_whole(path) as new, new.open("wb") as file:
        np.savez(file, **plain)


def _read(path: Path) -> dict[str, np.ndarray] | None:
    """Return the arrays of a file; None where there is none, or a damaged one."""
    try:
        with np.load(path, allow_pickle=False) as arrays:
            columns = dict(arrays)
    except (OSError, ValueError, zipfile.BadZipFile):
        return None
    return {name: a.astype(object) if a.dtype.kind == "U" else a for name, a in columns.items()}
