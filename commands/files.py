"""Files: written whole or not at all, and read only where they are regular ones."""

import errno
import os
import shutil
import stat
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from commands.command import ConfigError


@contextmanager
def write_whole(target: str | os.PathLike[str]) -> Generator[Path, None, None]:
    """Give the path of a new file that takes the name ``target`` when the block ends well, even
    over a power cut.

    Readers see the old file or the whole new one; where the block raises, nothing is left behind.
    A target that is no regular file, such as a device, is not replaced by one.

    Raises:
        OSError: it cannot be written, with the target as its file name; the folder is tried before
            the block.
    """
    target = Path(target)
    temporary: Path | None = None
    try:
        if target.is_dir():
            raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
        if target.exists() and not target.is_file():
            raise OSError(errno.EPERM, os.strerror(errno.EPERM))
        # In the same folder, because a rename is atomic only within one file system.
        descriptor, name = tempfile.mkstemp(
            prefix=f".{target.name[:200]}.", suffix=".tmp", dir=target.parent
        )
        temporary = Path(name)
        os.close(descriptor)
        yield temporary
        temporary.chmod(0o644)  # mkstemp's files are the owner's only
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(target)
        folder = os.open(target.parent, os.O_RDONLY)
        try:
            os.fsync(folder)  # the new name too
        finally:
            os.close(folder)
    except OSError as problem:
        others = problem.filename is not None and Path(problem.filename).parent != target.parent
        if others or problem.errno is None:
            raise  # about another file
        raise OSError(problem.errno, os.strerror(problem.errno), str(target)) from problem
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def write_file(target: str | os.PathLike[str], content: str | bytes) -> None:
    """Write a text, in UTF-8 and with line feeds alone, or bytes; atomic and with the errors of
    :func:`write_whole`.
    """
    with write_whole(target) as path:
        path.write_bytes(content.encode() if isinstance(content, str) else content)


def check_regular(path: str | os.PathLike[str]) -> None:
    """Raise an OSError where there is no such file or it is no regular one: a named pipe, a device,
    a folder.
    """
    if not stat.S_ISREG(Path(path).stat().st_mode):
        raise OSError(errno.EINVAL, "not a regular file", os.fspath(path))


def check_space(folder: Path, needed: int, content: str) -> None:
    """Raise a ConfigError where the disk of an output folder, new or not, has less room than
    needed, bytes.

    ``content`` says what the room is for, such as ``10000 rows``.
    """
    existing = next(
        path for path in (folder.absolute(), *folder.absolute().parents) if path.exists()
    )
    disk = shutil.disk_usage(existing)
    # What has no size, such as /proc, refuses by itself.
    if disk.total and disk.free < needed:
        raise ConfigError(
            f"--out {folder}: {disk.free / 1e6:.1f} MB are free there, expected about "
            f"{needed / 1e6:.1f} MB for {content}"
        ) from OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
