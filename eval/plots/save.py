"""The folder of a command: made anew with the configuration, then a JSON file with what was found,
and pictures as PNG and SVG.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agents.config.load import ConfigError, Strict, dump
from commands.figures import save_figure
from commands.files import check_space, write_file
from eval.runner.outputs import check_unused

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def check_room(folder: Path) -> None:
    """Refuse a folder without room for a command's JSON file and pictures, with ``ConfigError``."""
    check_space(folder, 2_000_000, "the files of this command")


def create(folder: Path, config: Strict | None = None) -> None:
    """Make a folder that is new, or take one that is empty, else ``ConfigError``; and write the
    configuration as resolved into it, of a command that has one.
    """
    check_room(folder)
    check_unused(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if config is not None:
            write_file(folder / "config.yaml", dump(config))
    except OSError as problem:
        raise ConfigError(f"--out {folder}: cannot be written: {problem.strerror}") from None


def write(
    folder: Path,
    name: str,
    content: Mapping[str, Any],
    figure: "Figure | None" = None,
    dpi: int = 130,
) -> None:
    """Write ``name.json`` and, of a matplotlib figure, ``name.png`` (pixels per inch) and
    ``name.svg``.
    """
    write_file(folder / f"{name}.json", json.dumps(content, indent=2, allow_nan=False) + "\n")
    if figure is not None:
        save_figure(figure, folder / name, dpi)
