"""The command that writes generated pages of the documentation into a directory."""

import sys
from collections.abc import Mapping
from pathlib import Path

from agents.config.load import ConfigError, Parser
from envs.edge.files import write_file


def write_pages(program: str, description: str | None, pages: Mapping[str, str]) -> None:
    """Write pages, texts by the name of their file, into the directory that the command line names.

    Args:
        program: such as ``python -m rlcas_jax.reference``.
        description: what ``--help`` says.

    Raises:
        ConfigError: there is no such directory.
    """
    parser = Parser(prog=program, description=description)
    parser.add_argument("directory", type=Path, metavar="DIR", help="where the pages go: docs/reference")
    directory: Path = parser.parse_args().directory
    if not directory.is_dir():
        raise ConfigError(f"{directory}: there is no such directory")
    for name, text in pages.items():
        write_file(directory / name, text)
        print(directory / name, file=sys.stderr)
