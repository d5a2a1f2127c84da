"""Reading text and JSON files: regular files of bounded size, plain or gzipped; every fault is one
sentence.
"""

import gzip
import json
import zlib
from pathlib import Path
from typing import Any

from commands.files import check_regular
from commands.json_text import parse_json

_MOST_BYTES = 128 * 2**20  # of the text, after unpacking
_MOST_LINES = 2_000_000
_MOST_PARTS = 10_000_000  # lists and objects in a JSON file


def text_of(source: str, error: type[Exception]) -> str:
    """Return the text of a file in UTF-8, with or without a byte order mark, plain or gzipped, or
    raise the error.
    """
    try:
        check_regular(source)
        with Path(source).open("rb") as file:
            packed = file.peek(2)[:2] == b"\x1f\x8b"
            data = (gzip.GzipFile(fileobj=file) if packed else file).read(_MOST_BYTES + 1)
    except FileNotFoundError:
        raise error(f"{source}: there is no such file") from None
    except (EOFError, zlib.error, gzip.BadGzipFile) as problem:
        raise error(f"{source}: not a gzip file, or cut off: {problem}") from None
    except OSError as problem:
        raise error(f"{source}: cannot be read: {problem.strerror or problem}") from None
    if len(data) > _MOST_BYTES:
        most = f"{_MOST_BYTES >> 20} MiB{' unpacked' if packed else ''}"
        raise error(f"{source}: more than {most}, expected at most so much: divide the file")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        raise error(f"{source}: not a text in UTF-8 (byte {problem.start})") from None


def lines_of(source: str, error: type[Exception]) -> list[str]:
    """Return the lines of a file; raises as :func:`text_of` does."""
    text = text_of(source, error)
    if text.count("\n") > _MOST_LINES:
        raise error(
            f"{source}: more than {_MOST_LINES} lines, expected at most so many: divide the file"
        )
    return text.splitlines()


def json_of(source: str, error: type[Exception]) -> Any:
    """Return the content of a JSON file, NaN and Infinity allowed; raises as
    :func:`text_of` does.
    """
    text = text_of(source, error)
    if text.count("{") + text.count("[") > _MOST_PARTS:
        most = f"{_MOST_PARTS} lists and objects"
        raise error(f"{source}: more than {most}, expected at most so many: divide the file")
    try:
        return parse_json(text)
    except json.JSONDecodeError as problem:
        raise error(
            f"{source} line {problem.lineno}: not JSON, or cut off: {problem.msg}"
        ) from None
    except (ValueError, RecursionError) as problem:
        raise error(f"{source}: not usable as JSON: {problem}") from None


def number_of(text: str) -> float:
    """Return the number that a text is, which may be nan or infinite; raises a ValueError where it
    is none.
    """
    if "_" in text:  # float() takes underscores, but they are no part of a number in a data file
        raise ValueError
    return float(text)
