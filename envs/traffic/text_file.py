"""Reading a text file, whatever is wrong with it told in one sentence."""

from pathlib import Path

__all__ = ["lines_of"]


def lines_of(source: str, error: type[Exception]) -> list[str]:
    """Return the lines of a file in UTF-8, with or without a byte order mark.

    Args:
        source: its path.
        error: what is raised, with a sentence that names the file, where it cannot be read.
    """
    try:
        return Path(source).read_text(encoding="utf-8-sig").splitlines()
    except FileNotFoundError:
        raise error(f"{source}: there is no such file") from None
    except UnicodeDecodeError as problem:
        raise error(f"{source}: not a text in UTF-8 (byte {problem.start})") from None
    except OSError as problem:
        raise error(f"{source}: cannot be read: {problem.strerror}") from None
