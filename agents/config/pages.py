"""The command that writes tables of the documentation's pages anew, from the code."""

import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from agents.config.load import ConfigError, Parser
from commands.files import write_file

_TABLE = re.compile(r"^\|.*\n\|---.*\n(?:\|.*\n)*", re.MULTILINE)


def with_tables(page: str, tables: Sequence[str]) -> str:
    """Return a page in Markdown with its tables replaced, one after the other."""
    new = iter(tables)
    return _TABLE.sub(lambda _: next(new), page)


def write_tables(
    program: str, description: str | None, tables: Mapping[str, Sequence[str]]
) -> None:
    """Write the tables of pages, by the name of the page's file, in the directory that the command
    line names.

    Program and description are what ``--help`` says. Raises a ConfigError where the directory lacks
    a page.
    """
    parser = Parser(prog=program, description=description)
    parser.add_argument(
        "directory", type=Path, metavar="DIR", help="where the pages are: docs/reference"
    )
    directory: Path = parser.parse_args().directory
    for name, new in tables.items():
        page = directory / name
        if not page.is_file():
            raise ConfigError(f"{page}: there is no such page; expected the directory of all")
        write_file(page, with_tables(page.read_text(encoding="utf-8"), new))
        print(page, file=sys.stderr)
